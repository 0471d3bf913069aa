"""Eq. 5 for pairs of pictures, the second drawn in the pose of the first."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_kernel
from finloop.puppet.lay import DrawingMode, paint, plan
from finloop.puppet.strip import PlacedBackbone


class PictureSet(NamedTuple):
    """Pictures (n, s, s, c), premultiplied, 0 … 255, and their postures (n, d), headed right.

    Mass centres are in the middle; size_px: typical length of the animals in them.
    """

    pictures: NDArray[np.uint8]
    postures: Floats
    size_px: float


@finite_kernel
def distances_in_pose(film: PictureSet, rows: Ints, to: Ints, mirrored: Mask) -> Floats:
    """Return the distances (k,) of pictures `rows` and `to`, (k,), drawn in one pose (Eq. 5).

    The distance is Euclidean, of pixels 0 … 1. Pictures `to` are drawn in the postures of `rows`,
    mirrored (k,) or not. If a picture is nearer as filmed, that distance counts.
    """
    apart = np.empty(len(rows))
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    for k in range(len(rows)):
        pair = rows[k], to[k], mirrored[k]
        apart[k] = _apart(film, pair, canvas)
    return apart


@finite_kernel
def nearest_in_pose(
    film: PictureSet, rows: Ints, to: tuple[Ints, Mask, Floats], unit: float, count: int
) -> Floats:
    """Return the distances (k,) of `distances_in_pose`, −1 for pairs that cannot be among the best.

    Each row keeps its `count` cheapest pairs. A pair costs its least cost plus the square of
    (distance / unit). rows: (k,), rising. to: the second pictures, whether they are mirrored, and
    the least costs, which rise within each row; (k,) each.
    """
    partner, mirrored, least = to
    apart = np.full(len(rows), -1.0)
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    best = np.empty(count)
    many = 0
    for k in range(len(rows)):
        if k == 0 or rows[k] != rows[k - 1]:
            many = 0
        if many == count and least[k] > best[-1]:
            continue
        pair = rows[k], partner[k], mirrored[k]
        apart[k] = _apart(film, pair, canvas)
        worth = least[k] + (apart[k] / unit) ** 2
        if many == count and worth >= best[-1]:
            continue
        many = min(many + 1, count)
        place = many - 1
        while place > 0 and best[place - 1] > worth:
            best[place] = best[place - 1]
            place -= 1
        best[place] = worth
    return apart


@finite_kernel
def _apart(film, pair, canvas):  # type: ignore[no-untyped-def]
    """Compute Eq. 5 of a pair: picture, partner, whether it is mirrored. canvas: (s, s, c)."""
    pictures, postures, size_px = film
    row, to, mirrored = pair
    side, channels = pictures.shape[1], pictures.shape[3]
    middle, unit = (side - 1) / 2, np.float32(1 / 255)
    here = PlacedBackbone(middle, middle, 0.0, size_px, postures[row])
    there = PlacedBackbone(middle, middle, 0.0, size_px, postures[to])
    picture, partner = pictures[row], pictures[to].astype(np.float32)
    how = DrawingMode(1.0, mirrored, False)
    canvas[:] = 0
    # No literals: numba would compile all kernels of `paint` again for them.
    paint(canvas, partner, plan(partner, there, here, how), how, (np.int64(0), np.int64(0)))
    posed = plain = 0.0
    for y in range(side):
        from_y = side - 1 - y if mirrored else y
        for x in range(side):
            for c in range(channels):
                target = picture[y, x, c] * unit
                posed += (canvas[y, x, c] - target) ** 2
                plain += (partner[from_y, x, c] * unit - target) ** 2
    return math.sqrt(min(posed, plain))
