"""A film row drawn in any pose, place, heading and size; two rows blended in one pose."""

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.distance.picture import softened
from finloop.puppet.lay import How, lay
from finloop.puppet.pose import Pose
from finloop.puppet.strip import Line

Premultiplied = NDArray[np.float32]


def draw(
    cutout: Cutout,
    pose: Pose,
    target: Pose,
    size: tuple[int, int],
    *,
    mirrored: bool = False,
    sharp: bool = True,
) -> Premultiplied:
    """A fish of the film in another pose: (height, width, c) premultiplied, 0 … 1.

    cutout: of the film, c = 2 or 4. pose: its own, px of the film; target: px of the new picture,
    of `size` height and width. What lies outside the picture is cut off. mirrored: the fish's left
    is drawn as its right; the target is what is seen, it is not mirrored. sharp: Keys' cubic
    filter, as `render.painter`; else a linear one, as the pictures of `distance.picture`.

    Drawn in its own pose at its own place it is the frame itself.
    """
    across = float(pose.size_px / target.size_px)
    film = softened(cutout.pixels.astype(np.float32), 1 / across)
    canvas = np.zeros((*size, cutout.pixels.shape[2]), np.float32)
    source = _line(pose, cutout.x0_px, cutout.y0_px)
    lay(canvas, film, source, _line(target, 0, 0), How(across, mirrored, sharp))
    return canvas


def blend(one: Premultiplied, other: Premultiplied, weight: float) -> Premultiplied:
    """Two pictures (h, w, c) of one pose: 1 − weight of the one and weight of the other.

    Light and skin go over; the shape, which is the same, stays.
    """
    return cv2.addWeighted(one, 1 - weight, other, weight, 0)


def _line(pose: Pose, x0_px: int, y0_px: int) -> Line:
    x, y, heading, size = pose.x_px, pose.y_px, pose.heading_rad, pose.size_px
    return Line(float(x - x0_px), float(y - y0_px), float(heading), float(size), pose.posture)
