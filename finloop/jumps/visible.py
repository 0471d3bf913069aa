"""The visible distance at a jump: a row drawn in the pose of another, compared by Eq. 5."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.parallel import Workers, ordered_map
from finloop.distance.picture import SPAN, paired_distances
from finloop.jumps.signature import Pictures, RowSource, split_into_blocks
from finloop.puppet import draw_in_pose
from finloop.puppet.lay import CandidatePairs, PictureSet, distances_in_pose, nearest_in_pose

_BATCH = 1000  # pictures at a time


@dataclass(frozen=True)
class VisibleDistance:
    """Measures how different two rows look when both are drawn in one pose (Eq. 5).

    pictures: uint8 (n, s, s, c) of the rows, in their own postures (n, d), headed right; natural:
    the unit, the median distance between the pictures of a row and of a natural step later.
    """

    pictures: Pictures
    postures: Floats
    natural: float

    @classmethod
    def from_source(cls, source: RowSource, workers: Workers) -> "VisibleDistance":
        """Return the measure, with the pictures of all rows drawn into the source's array.

        Its unit is measured in these pictures.
        """
        reel, poses = source.load_film()
        pictures, rows = source.picture_array(), split_into_blocks(len(reel), _BATCH)
        drawn = ordered_map(partial(_draw_rows, source, pictures.shape[1]), rows, workers)
        for block, drawn_block in zip(rows, drawn, strict=True):
            pictures[block] = drawn_block
        source.share_pictures()
        ends = np.stack(reel.step_ends)
        step = [
            paired_distances(*pictures[batch].astype(np.float32) / 255)
            for batch in np.array_split(ends, 1 + ends.shape[1] // _BATCH, axis=1)
        ]
        natural = float(np.median(np.concatenate(step)))
        return cls(pictures, poses.pose.posture, max(natural, 1e-12))

    def __call__(self, rows: Ints, to: Ints, mirrored: Mask) -> Floats:
        """Return how different rows (k,) and rows `to` (k,) look in one pose: (k,), natural steps.

        A natural step is the median step of the film. The rows `to`, mirrored (k,) or not, are
        drawn in the poses of `rows`.
        """
        rows, to = np.asarray(rows, np.int64), np.asarray(to, np.int64)
        mirrored = np.asarray(mirrored, bool)
        film = PictureSet(self.pictures, self.postures, self.pictures.shape[1] / SPAN)
        parts = np.array_split(np.arange(len(rows)), numba.get_num_threads())
        with ThreadPoolExecutor(len(parts)) as pool:  # a kernel holds no lock
            steps = pool.map(lambda k: distances_in_pose(film, rows[k], to[k], mirrored[k]), parts)
            return np.concatenate(list(steps)) / self.natural

    def measure_best(self, neighbours: pd.DataFrame, count: int) -> Floats:
        """Return the visible distances (k,) of jumps that can be among their row's best, else inf.

        Jumps are not measured if `count` jumps of the same row certainly cost less. A jump costs
        its `far` plus the square of its visible distance, in natural steps (median steps of the
        film). neighbours: from `JumpSearch`.
        """
        rows, to = (neighbours[name].to_numpy(np.int64) for name in ("row", "to"))
        mirrored, far = neighbours["mirrored"].to_numpy(bool), neighbours["far"].to_numpy(float)
        film = PictureSet(self.pictures, self.postures, self.pictures.shape[1] / SPAN)
        steps = nearest_in_pose(film, CandidatePairs(rows, to, mirrored, far), self.natural, count)
        return np.where(steps < 0, np.inf, steps / self.natural)


def _draw_rows(source: RowSource, size_px: int, rows: Ints) -> Pictures:
    """Draw the fish of rows (k,) in their own postures, headed right: (k, size_px, size_px, c)."""
    reel, poses = source.load_film()
    middle, length_px, shape = (size_px - 1) / 2, size_px / SPAN, (size_px, size_px)
    filmed = poses.pose[rows]
    target = filmed.move_to(middle, middle, 0.0, length_px)
    pictures = np.stack([
        draw_in_pose(reel.cutouts[row], filmed[k], target[k], shape, sharp=False)
        for k, row in enumerate(rows.tolist())
    ])  # fmt: skip
    return np.round(255 * pictures).clip(0, 255).astype(np.uint8)
