"""The visible distance at a jump: a row drawn in the pose of another, against that one (Eq. 5)."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.distance.picture import SPAN, apart
from finloop.pose.film import FilmPoses
from finloop.puppet import draw
from finloop.puppet.pairs import PictureSet, apart_in_pose, nearest_in_pose
from finloop.reel import Reel

Pictures = NDArray[np.uint8]

_LOT = 1000  # pictures at a time


def shape_of(reel: Reel, size: int) -> tuple[int, ...]:
    """The shape (n, s, s, c) of pictures of all rows, `size` px across."""
    return len(reel), size, size, reel.film[0].pixels.shape[2]


@dataclass(frozen=True)
class VisibleDistance:
    """How far rows of a film are apart to the eye: Eq. 5 of two rows drawn in one pose.

    pictures: (n, s, s, c) of the rows, in their own postures (n, d), headed right; natural: the
    median of Eq. 5 from a row to the one a natural step later in its track.
    """

    pictures: Pictures
    postures: Floats
    natural: float

    @classmethod
    def of(
        cls, reel: Reel, poses: FilmPoses, size: int, pictures: Pictures | None = None
    ) -> "VisibleDistance":
        """Draw the rows of a reel, `size` px across; poses: of the same rows.

        pictures: where they are drawn, for a long film a mapped file; None: in memory.
        """
        middle, length = (size - 1) / 2, size / SPAN
        if pictures is None:
            pictures = np.empty(shape_of(reel, size), np.uint8)
        there = poses.pose.at(middle, middle, 0.0, length)
        for row in range(len(reel)):
            picture = draw(reel.film[row], poses.pose[row], there[row], (size, size), sharp=False)
            pictures[row] = np.round(255 * picture).clip(0, 255)
        ends = np.stack(reel.step_ends)
        step = [
            apart(*pictures[some].astype(np.float32) / 255)
            for some in np.array_split(ends, 1 + ends.shape[1] // _LOT, axis=1)
        ]
        natural = float(np.median(np.concatenate(step)))
        return cls(pictures, poses.pose.posture, max(natural, 1e-12))

    def __call__(self, rows: Ints, to: Ints, mirrored: Mask) -> Floats:
        """Natural steps (k,) from rows (k,) to rows `to`, mirrored or not, in the former's pose."""
        rows, to = np.asarray(rows, np.int64), np.asarray(to, np.int64)
        mirrored = np.asarray(mirrored, bool)
        film = PictureSet(self.pictures, self.postures, self.pictures.shape[1] / SPAN)
        parts = np.array_split(np.arange(len(rows)), numba.get_num_threads())
        return self._of_all(lambda k: apart_in_pose(film, rows[k], to[k], mirrored[k]), parts)

    def best(self, near: pd.DataFrame, count: int) -> Floats:
        """Natural steps (k,) of the jumps `near`: columns row, to, mirrored, far.

        A jump costs the sum of `far`, which rises within each row, and the visible distance
        squared. The distance is infinite where `count` other jumps of the row cost less: it is
        not measured there.
        """
        rows, to = (near[name].to_numpy(np.int64) for name in ("row", "to"))
        mirrored, far = near["mirrored"].to_numpy(bool), near["far"].to_numpy(float)
        film = PictureSet(self.pictures, self.postures, self.pictures.shape[1] / SPAN)

        def of_some(k: Ints) -> Floats:
            to_rows = to[k], mirrored[k], far[k]
            return nearest_in_pose(film, rows[k], to_rows, self.natural, count)

        starts = np.flatnonzero(np.diff(rows, prepend=-1))
        few = np.array_split(starts, numba.get_num_threads())[1:]
        parts = np.split(np.arange(len(rows)), [lot[0] for lot in few if len(lot)])
        steps = self._of_all(of_some, parts)
        return np.where(steps < 0, np.inf, steps)

    def _of_all(self, of_some: Callable[[Ints], Floats], parts: list[Ints]) -> Floats:
        """Natural steps of all pairs, by threads: a kernel holds no lock."""
        with ThreadPoolExecutor(len(parts)) as pool:
            return np.concatenate(list(pool.map(of_some, parts))) / self.natural
