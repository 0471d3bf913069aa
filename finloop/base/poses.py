"""Poses: named points of every animal in every frame, as tracking programs give them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask

Software = Literal[
    "DeepLabCut", "SLEAP", "LightningPose", "Anipose", "NWB", "VIA-tracks", "movement",
    "idtracker.ai", "TRex", "FastTrack",
]  # fmt: skip
"""The programs whose files `finloop.io.poses` reads."""


@dataclass(frozen=True)
class Poses:
    """Named points of animals as a tracking program gives them, a row per animal and frame.

    Rows are sorted by frame, then by animal.
    """

    individuals: tuple[str, ...]  # names of the animals
    keypoints: tuple[str, ...]  # names of the points
    frames: int  # of the film
    individual: NDArray[np.int64]  # (rows,) number of the animal in `individuals`
    frame: NDArray[np.int64]  # (rows,) from 0
    places: NDArray[np.float64]  # (rows, keypoints, 2) x, y in px, NaN where missing
    confidence: NDArray[np.float64]  # (rows, keypoints) 0 … 1, NaN where unknown


BLOCK = 1024  # frames in memory at a time


def iterate_blocks(poses: Poses, block: int = BLOCK) -> Iterator[tuple[int, Floats]]:
    """Yield blocks of frames: the number of the block's first frame, and the points in the block.

    The points are an array (frames of the block, individuals, keypoints, 3) of x [px], y [px] and
    confidence, NaN where missing. block: frames per block; the last one may have fewer.
    """
    values = np.concatenate([poses.places, poses.confidence[..., None]], axis=2)
    for start in range(0, poses.frames, block):
        stop = min(start + block, poses.frames)
        first, last = np.searchsorted(poses.frame, [start, stop])
        cells = np.full((stop - start, len(poses.individuals), *values.shape[1:]), np.nan)
        cells[poses.frame[first:last] - start, poses.individual[first:last]] = values[first:last]
        yield start, cells


def poses_from_rows(
    individuals: tuple[str, ...], keypoints: tuple[str, ...], frame: NDArray[np.integer],
    individual: NDArray[np.integer], places: Floats, confidence: Floats | None = None,
) -> Poses:  # fmt: skip
    """Convert rows, each of an animal in a frame, to `Poses`.

    Rows without a known point are left out. frame, individual (rows,): numbers, no pair twice.
    places (rows, keypoints, 2): px, infinite or NaN where missing. confidence (rows, keypoints):
    0 … 1, None = unknown.
    """
    is_known: Mask = np.all(np.isfinite(places), axis=-1)
    has_place: Mask = np.asarray(is_known.any(axis=-1))
    order = np.lexsort((individual, frame))
    rows = order[has_place[order]]
    is_known = is_known[rows]
    if confidence is None:
        row_confidence = np.full(is_known.shape, np.nan)
    else:
        row_confidence = confidence[rows].astype(float)
    return Poses(
        individuals, keypoints,
        frames=int(frame.max()) + 1 if len(frame) else 0,
        individual=individual[rows].astype(np.int64),
        frame=frame[rows].astype(np.int64),
        places=np.where(is_known[..., None], places[rows], np.nan),
        confidence=row_confidence,
    )  # fmt: skip


def poses_from_arrays(
    individuals: tuple[str, ...], keypoints: tuple[str, ...], frame: NDArray[np.integer],
    places: Floats, confidence: Floats | None = None,
) -> Poses:  # fmt: skip
    """Convert arrays with a cell for every animal and frame to `Poses`.

    Animals are left out of the frames in which none of their points is known. frame (times,):
    numbers of the frames, all different. places (times, individuals, keypoints, 2): px, infinite or
    NaN where missing. confidence (times, individuals, keypoints): 0 … 1, None = unknown.
    """
    times, count = places.shape[:2]
    individual = np.tile(np.arange(count), times)
    rows = times * count
    return poses_from_rows(
        individuals, keypoints, np.repeat(np.asarray(frame, np.int64), count), individual,
        places.reshape(rows, *places.shape[2:]),
        None if confidence is None else confidence.reshape(rows, -1),
    )  # fmt: skip
