"""Draw a film row in any pose, position, heading and size; blend two rows in one pose."""

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture
from finloop.base.cutout import Cutout
from finloop.distance.picture import blur_for_shrinking
from finloop.puppet.lay import DrawingMode, paint_strips, plan_strips
from finloop.puppet.pose import Pose
from finloop.puppet.strip import PlacedBackbone

Premultiplied = NDArray[np.float32]


def draw_in_pose(
    cutout: Cutout, pose: Pose, target: Pose, size: tuple[int, int], *, mirrored: bool = False,
    sharp: bool = True,
) -> Premultiplied:  # fmt: skip
    """Return a cut-out drawn in another pose: (height, width, c), premultiplied, 0 … 1.

    pose: of the cut-out, px of the film; target: the pose as it is seen in the new picture, px of
    that; size: its height and width, px. mirrored, sharp: as in `DrawingMode`. Drawn in its own
    pose at its own place it is the frame itself.
    """
    source = place_backbone(pose, cutout.x0_px, cutout.y0_px)
    picture = PosedPicture(cutout.pixels, source, place_backbone(target), mirrored, sharp)
    height, width = size
    return picture.draw_part((0, 0, height, width))


class PosedPicture:
    """A picture of the film, prepared to be drawn in another pose, wholly or in parts.

    box: rows and columns [px] that the animal may cover, half open: top, left, bottom, right.
    """

    def __init__(
        self, pixels: Picture, source: PlacedBackbone, target: PlacedBackbone, mirrored: bool,
        sharp: bool = True,
    ) -> None:  # fmt: skip
        """Prepare a picture (h, w, c), 0 … 255, premultiplied, to be drawn in another pose.

        source, target: the animal's backbone in it and in the new picture. mirrored, sharp: as in
        `DrawingMode`.
        """
        film_px_per_px = source.size_px / target.size_px
        self._mode = DrawingMode(film_px_per_px, mirrored, sharp)
        self._film = blur_for_shrinking(pixels.astype(np.float32), 1 / film_px_per_px)
        self._plan = plan_strips(self._film, source, target, self._mode)
        self.box: tuple[int, int, int, int] = self._plan.box

    def draw_part(self, box: tuple[int, int, int, int]) -> Premultiplied:
        """Return a rectangle of the new picture, (h, w, c), premultiplied, 0 … 1.

        box: its rows and columns [px], half open: top, left, bottom, right.
        """
        top, left, bottom, right = box
        canvas = np.zeros((bottom - top, right - left, self._film.shape[2]), np.float32)
        paint_strips(canvas, self._film, self._plan, self._mode, (top, left))
        return canvas


def mix_pictures(first: Premultiplied, second: Premultiplied, weight: float) -> Premultiplied:
    """Return the cross-fade of two pictures (h, w, c); `weight` is the share of the second, 0-1."""
    return cv2.addWeighted(first, 1 - weight, second, weight, 0)


def place_backbone(pose: Pose, x0_px: float = 0.0, y0_px: float = 0.0) -> PlacedBackbone:
    """Return a pose's backbone in a picture whose upper left pixel is (x0_px, y0_px)."""
    x, y, heading, size = pose.x_px, pose.y_px, pose.heading_rad, pose.size_px
    return PlacedBackbone(
        float(x - x0_px), float(y - y0_px), float(heading), float(size), pose.posture
    )
