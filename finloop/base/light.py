"""The light of a picture: which pixels follow it, and how a change of it is undone.

A lamp that becomes g times as bright makes every pixel g times as bright (gamma coding only changes
the g). So one gain per channel suffices.
"""

import cv2
import numpy as np

from finloop.base.arrays import Floats, Picture

BLACK, WHITE = 16, 250
"""Grey levels between which a pixel follows the light; others are black or saturated."""


def undo_gain(frame: Picture, gains: Floats) -> Picture:
    """Return a frame (h, w[, 3]) made as bright as the empty tank: each channel over its gain.

    gains: (1,) or (3,), the frame's brightness relative to the tank; NaN leaves the frame as it is.
    """
    if np.isnan(gains).any():
        return frame
    levels = np.arange(256)[:, None] / gains
    table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)[None]
    return np.asarray(cv2.LUT(frame, table))
