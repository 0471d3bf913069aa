"""Poses as DeepLabCut writes them for several animals: a CSV with a header of four rows.

`movement` (`load_poses.from_file`, source "DeepLabCut"), DeepLabCut itself and what is built on it
read that layout. Programs tell it by `scorer, individuals, bodyparts, coords` in the first column;
a fish that is not seen has empty cells.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from finloop.export.tracks import Poses
from finloop.io.atomic import whole_file

SCORER = "finloop"
_BLOCK = 1024  # frames written at a time, so that a long clip does not have to fit into memory


def save_poses(path: Path, poses: Poses) -> None:
    """Write a row per frame of the clip; places with 3 decimals, whole or not at all."""
    columns = pd.MultiIndex.from_product(
        [[SCORER], poses.individuals, poses.keypoints, ["x", "y", "likelihood"]],
        names=["scorer", "individuals", "bodyparts", "coords"],
    )
    values = np.concatenate([poses.places, poses.confidence[..., None]], axis=2)
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        for start in range(0, poses.frames, _BLOCK):
            frames = np.arange(start, min(start + _BLOCK, poses.frames))
            first, last = np.searchsorted(poses.frame, [start, start + _BLOCK])
            cells = np.full((len(frames), len(poses.individuals), *values.shape[1:]), np.nan)
            cells[poses.frame[first:last] - start, poses.individual[first:last]] = values[
                first:last
            ]
            pd.DataFrame(cells.reshape(len(frames), -1), frames, columns).to_csv(
                file, header=start == 0, float_format="%.3f", lineterminator="\n"
            )
