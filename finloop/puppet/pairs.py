"""How far pictures are apart once the one is drawn in the other's pose (Eq. 5), pair by pair."""

import math

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_kernel
from finloop.puppet.lay import How, paint, plan
from finloop.puppet.strip import Line


@finite_kernel
def apart_in_pose(
    pictures: NDArray[np.uint8], postures: Floats, size_px: float, rows: Ints, to: Ints,
    mirrored: Mask,
) -> Floats:  # fmt: skip
    """Eq. 5 (k,) from pictures `rows` (k,) to pictures `to` (k,), mirrored (k,) or not.

    Those are drawn in the postures of these, or stay as they are where they then are nearer.

    pictures: (n, s, s, c) premultiplied, each in its own posture (n, d), headed right, its mass
    centre in the middle; size_px: typical length of the animals in them.
    """
    side, channels = pictures.shape[1], pictures.shape[3]
    middle, unit = (side - 1) / 2, np.float32(1 / 255)
    apart = np.empty(len(rows))
    canvas = np.empty((side, side, channels), np.float32)
    for k in range(len(rows)):
        here = Line(middle, middle, 0.0, size_px, postures[rows[k]])
        there = Line(middle, middle, 0.0, size_px, postures[to[k]])
        one, other = pictures[rows[k]], pictures[to[k]].astype(np.float32)
        how = How(1.0, mirrored[k], False)
        canvas[:] = 0
        paint(canvas, other, plan(other, there, here, how), how, (0, 0))
        posed = plain = 0.0
        for y in range(side):
            from_y = side - 1 - y if mirrored[k] else y
            for x in range(side):
                for c in range(channels):
                    wanted = one[y, x, c] * unit
                    posed += (canvas[y, x, c] - wanted) ** 2
                    plain += (other[from_y, x, c] * unit - wanted) ** 2
        apart[k] = math.sqrt(min(posed, plain))
    return apart
