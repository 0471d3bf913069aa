"""Tracks as poses: named points of every fish in every frame, for behavioural programs.

DeepLabCut's layout for several animals is a CSV with a header of four rows. `movement`
(`load_poses.from_file`, source "DeepLabCut"), DeepLabCut itself and programs built on it read it.
They recognise it by `scorer, individuals, bodyparts, coords` in the first column. The cells of a
fish that is not seen are empty.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from finloop.base.poses import BLOCK, Poses, iterate_blocks
from finloop.base.schema import lists_to_points
from finloop.features.area import interpolate_lines
from finloop.features.head import turn_head_first

HEAD, TAIL, CENTRE = "head", "tail", "centre"
SCORER = "finloop"
USED = ("track_id", "frame", "x_px", "y_px", "backbone_x_px", "backbone_y_px")
"""The columns of a table of tracks from which poses are made."""


def keypoints_of_tracks(
    tracks: pd.DataFrame, features: pd.DataFrame, frames: int, body_points: int, least_frames: int,
    most: int, animals: pd.Series | None = None,
) -> Poses:  # fmt: skip
    """Return the poses of the longest tracks: head, equidistant body points, tail, mass centre, px.

    The confidence of head, body and tail is `head_confidence`; that of the mass centre is 1. If all
    tracks are too short, only the longest is returned.

    tracks: the columns `USED` of the table of tracks; features: head_x_px, head_y_px,
    head_confidence of the feature table, whose rows are the same; frames: number of frames of the
    clip, also those without a fish; body_points: how many between head and tail, at least 0;
    least_frames, most: the shortest track, and the largest number of tracks, the longest first;
    animals (rows,): names of animals; with them an individual is an animal, else a track.
    """
    individual = tracks["track_id"] if animals is None else animals
    frame_counts = individual.value_counts(sort=False).sort_index()
    long_enough = frame_counts[frame_counts >= min(least_frames, frame_counts.max())]
    ids = np.sort(long_enough.sort_values(ascending=False, kind="stable").index[:most])
    rows = pd.concat([tracks, features], axis=1).assign(individual=individual)[individual.isin(ids)]
    rows = rows.sort_values(["frame", "individual"], ignore_index=True)
    line = turn_head_first(lists_to_points(rows, "backbone").astype(float), rows)
    places = interpolate_lines(line, np.linspace(0, line.shape[1] - 1, body_points + 2))
    centre = rows[["x_px", "y_px"]].to_numpy(float)
    confidence = rows["head_confidence"].to_numpy(float)[:, None].repeat(body_points + 2, 1)
    return Poses(
        individuals=tuple(f"track_{id}" if animals is None else str(id) for id in ids),
        keypoints=(HEAD, *(f"body_{n}" for n in range(1, body_points + 1)), TAIL, CENTRE),
        frames=frames, individual=np.searchsorted(ids, rows["individual"].to_numpy()),
        frame=rows["frame"].to_numpy(np.int64),
        places=np.concatenate([places, centre[:, None]], axis=1),
        confidence=np.concatenate([confidence, np.ones((len(rows), 1))], axis=1),
    )  # fmt: skip


def deeplabcut_tables(poses: Poses, block: int = BLOCK) -> Iterator[pd.DataFrame]:
    """Yield the poses as tables in DeepLabCut's layout, a row per frame of the clip.

    Columns: x, y (px) and likelihood (0 … 1) of every keypoint of every individual. block: frames
    of a table, so that not all are in memory at once.
    """
    columns = pd.MultiIndex.from_product(
        [[SCORER], poses.individuals, poses.keypoints, ["x", "y", "likelihood"]],
        names=["scorer", "individuals", "bodyparts", "coords"],
    )
    for start, cells in iterate_blocks(poses, block):
        frames = np.arange(start, start + len(cells))
        yield pd.DataFrame(cells.reshape(len(cells), -1), frames, columns)
