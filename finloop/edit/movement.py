"""How far the film's body moves from each row to the next."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numba
import numpy as np

from finloop.base.arrays import Floats
from finloop.puppet import Pose

_LOT = 10_000  # rows at a time


class Movement(NamedTuple):
    """How far (n − 1,) the body moves about its centre from each row to the next, in body lengths.

    Both are root mean squares over the points of the backbone. whole: turning and bending; bends:
    bending alone, with the heading kept.
    """

    whole: Floats
    bends: Floats


def movement(pose: Pose) -> Movement:
    """Return how far the body turns and bends from each of n poses to the next."""

    def of_lot(first: int) -> Floats:
        lot = pose[first : first + _LOT + 1]
        line = lot.move_to(0.0, 0.0, 0.0, 1.0).backbone_px()
        turn = np.diff(lot.heading_rad)[:, None]
        cos, sin, x, y = np.cos(turn), np.sin(turn), line[1:, :, 0], line[1:, :, 1]
        turned = np.stack([x * cos + y * sin, y * cos - x * sin], -1)
        return np.stack([_apart(turned, line[:-1]), _apart(line[1:], line[:-1])])

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        lots = list(pool.map(of_lot, range(0, len(pose) - 1, _LOT)))
    return Movement(*np.concatenate([np.empty((2, 0)), *lots], axis=1))


def _apart(lines: Floats, others: Floats) -> Floats:
    return np.sqrt(((lines - others) ** 2).sum(-1).mean(-1))
