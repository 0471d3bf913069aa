"""Convert offsets in a picture (x, y) to an animal's own axes: ahead and to its left."""

import numpy as np

from finloop.base.arrays import Floats, Reals


def to_body_axes(offset: Reals, heading_rad: Reals) -> Floats:
    """Convert offsets (…, 2) in a picture to offsets ahead of an animal and to its left, (…, 2).

    The unit, such as px, stays. offset: x to the right, y down. heading_rad (…,): radians
    anticlockwise as seen on screen, 0 = to the right.
    """
    dx, dy = offset[..., 0], offset[..., 1]
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.stack([dx * cos - dy * sin, -dx * sin - dy * cos], axis=-1)
