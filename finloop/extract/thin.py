"""Thin parts of an animal, such as a mouse's tail or that of a larva, paler than its body.

A silhouette ends where the difference from the tank falls to a share of the animal's contrast. A
part a few pixels wide is blurred, so its own contrast is lower: it is in the silhouette of some
frames only, and the backbone is long in one frame and short in the next.
"""

import cv2
import numpy as np

from finloop.base.arrays import Picture
from finloop.extract.backbone import pad_picture

EDGE = 0.2  # share of the animal's contrast at which a thin part ends
_THIN = 0.4  # share of a body's largest half width; narrower parts are thin


def with_thin_parts(above: Picture, change: Picture, level: int) -> Picture:
    """Return silhouettes (h, w), 0 or 255, together with the pale thin parts that touch them.

    above: the silhouettes, 0 or 255; change: the difference image; level: grey levels that a thin
    part exceeds. A pale and wide part, such as a shadow or the gloom around an animal, is not thin.
    """
    body = np.minimum(above, 1)
    pale = cv2.threshold(change, level, 1, cv2.THRESH_BINARY)[1] | body
    half_width = float(cv2.distanceTransform(pad_picture(body, 1), cv2.DIST_L2, 3).max())
    reach = max(1, int(_THIN * half_width + 0.5))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    rim = 2 * reach + 2
    wide = cv2.morphologyEx(pad_picture(pale, rim), cv2.MORPH_OPEN, disc)[rim:-rim, rim:-rim]
    both = body | (pale & (1 - wide))
    _, number = cv2.connectedComponents(both)
    touch = np.isin(number, number[body.view(bool)])
    _, part, sizes, _ = cv2.connectedComponentsWithStats(both * touch & (1 - body))
    long = sizes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) >= reach
    long[0] = False  # the rest of the picture
    return np.where(long[part], np.uint8(255), above)
