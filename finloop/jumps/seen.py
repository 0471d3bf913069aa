"""What is seen at a jump: one row drawn in the pose of another, against that row itself (Eq. 5)."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.distance.picture import SPAN, steps
from finloop.pose.film import FilmPoses
from finloop.puppet import draw
from finloop.puppet.pairs import apart_in_pose
from finloop.reel import Reel


@dataclass(frozen=True)
class Seen:
    """How far rows of a film are apart to the eye, where a jump is joined in their pose.

    pictures: (n, s, s, c) of the rows, in their own postures (n, d), headed right; natural: the
    median of Eq. 5 from a row to the next one of its track.
    """

    pictures: NDArray[np.uint8]
    postures: Floats
    natural: float

    @classmethod
    def of(cls, reel: Reel, poses: FilmPoses, size: int) -> "Seen":
        """Draw the rows of a reel, `size` px across; poses: of the same rows."""
        middle, length = (size - 1) / 2, size / SPAN
        made = []
        for row in range(len(reel)):
            pose = poses.pose[row]
            here = pose.at(middle, middle, 0.0, length)
            made.append(np.round(255 * draw(reel.film[row], pose, here, (size, size), sharp=False)))
        pictures = np.stack(made).clip(0, 255).astype(np.uint8)
        step = steps(pictures.astype(np.float32) / 255)[reel.goes_on[:-1]]
        return cls(pictures, poses.pose.posture, max(float(np.median(step)), 1e-12))

    def __call__(self, rows: Ints, to: Ints, mirrored: Mask) -> Floats:
        """Natural steps (k,) from rows (k,) to rows `to`, mirrored or not, in the former's pose."""
        size_px = self.pictures.shape[1] / SPAN
        rows, to = np.asarray(rows, np.int64), np.asarray(to, np.int64)
        mirrored = np.asarray(mirrored, bool)
        threads = numba.get_num_threads()  # the kernel holds no lock; pairs do not know each other

        def of_some(part: Ints) -> Floats:
            return apart_in_pose(
                self.pictures, self.postures, size_px, rows[part], to[part], mirrored[part]
            )

        with ThreadPoolExecutor(threads) as pool:
            parts = np.array_split(np.arange(len(rows)), threads)
            return np.concatenate(list(pool.map(of_some, parts))) / self.natural
