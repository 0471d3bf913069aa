"""The outlines of sprites."""

import cv2
import numpy as np

from finloop.base.arrays import Floats
from finloop.distance.reel import Reel

_SOLID = 64  # alpha from which a pixel belongs to the fish


def outlines(reel: Reel) -> list[Floats]:
    """Return the convex hull (k, 2) of every sprite: px ahead and left of its mass centre.

    The px are those of the drawn animation, where all fish are equally long.
    """
    hulls = []
    for number, row in enumerate(reel.sprites.itertuples()):
        cutout = reel.sprite(number)
        solid = np.argwhere(cutout.pixels[..., -1] >= _SOLID)[:, ::-1].astype(np.float32)
        hull = cv2.convexHull(solid)[:, 0].astype(float)
        offset = hull + np.array([cutout.x0_px - row.x_px, cutout.y0_px - row.y_px])
        hulls.append(offset * np.array([row.scale, -row.scale]))
    return hulls
