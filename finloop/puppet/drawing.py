"""Draw a film row in any pose, position, heading and size; change from one to another in one pose.

Two pictures in one pose differ in skin and outline: fins, the visible part of a tail. Mixed, both
outlines would be seen half transparent, and a pattern and its mirror image at once: a ghost. So the
skin changes from the tail to the head, and the outline at once, in the middle of the change.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture
from finloop.base.cutout import Cutout
from finloop.base.kernel import kernel
from finloop.distance.picture import blur_for_shrinking
from finloop.puppet.lay import DrawingMode, paint_strips, plan_strips
from finloop.puppet.pose import Pose
from finloop.puppet.strip import PlacedBackbone

Premultiplied = NDArray[np.float32]
_FRONT = 0.1  # of the body's length: over it the skin changes; wider, two patterns are seen at once
_NOWHERE = np.empty((0, 0), np.float32)


def draw_in_pose(
    cutout: Cutout, pose: Pose, target: Pose, size: tuple[int, int], *, mirrored: bool = False,
    sharp: bool = True,
) -> Premultiplied:  # fmt: skip
    """Return a cut-out drawn in another pose: (height, width, c), premultiplied, 0 … 1.

    pose: of the cut-out, px of the film; target: the pose as it is seen in the new picture, px of
    that; size: its height and width, px. mirrored: whether left is drawn as right; sharp: by Keys'
    cubic filter, else a linear one. Drawn in its own pose at its own place it is the frame itself.
    """
    height, width = size
    return pose_cutout(cutout, pose, target, mirrored, sharp).draw_part((0, 0, height, width))


class PosedPicture:
    """A picture of the film, prepared to be drawn in another pose, wholly or in parts.

    box: rows and columns [px] that the animal may cover, half open: top, left, bottom, right.
    """

    def __init__(
        self, pixels: Picture | Premultiplied, source: PlacedBackbone, target: PlacedBackbone,
        mirrored: bool, sharp: bool = True,
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

    def draw_part(
        self, box: tuple[int, int, int, int], along: NDArray[np.float32] = _NOWHERE
    ) -> Premultiplied:
        """Return a rectangle of the new picture, (h, w, c), premultiplied, 0 … 1.

        box: its rows and columns [px], half open: top, left, bottom, right. along (h, w): becomes
        the place along the body that each drawn pixel shows, 0 head … 1 tail; or empty.
        """
        top, left, bottom, right = box
        canvas = np.zeros((bottom - top, right - left, self._film.shape[2]), np.float32)
        paint_strips(canvas, self._film, self._plan, self._mode, (top, left), along)
        return canvas


def pose_cutout(
    cutout: Cutout, pose: Pose, target: Pose, mirrored: bool, sharp: bool
) -> PosedPicture:
    """Return a cut-out prepared to be drawn in another pose.

    pose: of the cut-out, px of the film; target: the pose in the new picture, px of that; mirrored:
    whether left is drawn as right; sharp: by Keys' cubic filter, else a linear one.
    """
    source = place_backbone(pose, cutout.x0_px, cutout.y0_px)
    return PosedPicture(cutout.pixels, source, place_backbone(target), mirrored, sharp)


def change_in_pose(
    first: PosedPicture, second: PosedPicture, weight: float, box: tuple[int, int, int, int]
) -> Premultiplied:
    """Return a rectangle of the picture between two in one pose, without a double image.

    weight: share of the second, 0 … 1, which the first replaces from the tail to the head; the
    outline is that of the larger share. box: rows and columns [px], half open: top, left, bottom,
    right. The result is (h, w, c), premultiplied, 0 … 1.
    """
    top, left, bottom, right = box
    along = np.zeros((bottom - top, right - left), np.float32)
    new, old = (picture.draw_part(box, along) for picture in (first, second))
    outline = old if weight > 0.5 else new
    return _change_skin(new, old, second_shares(along, weight), outline)


@kernel
def _change_skin(new, old, shares, outline):  # type: ignore[no-untyped-def]
    """Return pictures (h, w, c) mixed by the shares (h, w) of the old one, within an outline.

    outline (h, w, c): the picture that has it. It fills in where the mixed skin does not reach it.
    """
    height, width, channels = outline.shape
    picture = np.zeros_like(outline)
    for y in range(height):
        for x in range(width):
            alpha = outline[y, x, channels - 1]
            if alpha > 0:
                share, new_alpha = shares[y, x], new[y, x, channels - 1]
                mixed_alpha = new_alpha + share * (old[y, x, channels - 1] - new_alpha)
                most = max(alpha, mixed_alpha)
                skin, rest = alpha / most, np.float32(1) - mixed_alpha / most
                for k in range(channels):
                    mixed = new[y, x, k] + share * (old[y, x, k] - new[y, x, k])
                    picture[y, x, k] = mixed * skin + outline[y, x, k] * rest
    return picture


def second_shares(along: NDArray[np.float32], weight: float) -> NDArray[np.float32]:
    """Return the share of the second picture's skin at places along the body (…), 0 head … 1 tail.

    weight: share of the second, 0 … 1, over the whole body; the first one comes in from the tail.
    """
    on_body = np.clip(along, np.float32(0), np.float32(1))
    shares = ((1 + _FRONT) * np.float32(weight) - on_body) / np.float32(_FRONT)
    return np.clip(shares, np.float32(0), np.float32(1))


def mix_pictures(first: Premultiplied, second: Premultiplied, weight: float) -> Premultiplied:
    """Return the cross-fade of two pictures (h, w, c); `weight` is the share of the second, 0-1."""
    return cv2.addWeighted(first, 1 - weight, second, weight, 0)


def place_backbone(pose: Pose, x0_px: float = 0.0, y0_px: float = 0.0) -> PlacedBackbone:
    """Return a pose's backbone in a picture whose upper left pixel is (x0_px, y0_px)."""
    x, y, heading, size = pose.x_px, pose.y_px, pose.heading_rad, pose.size_px
    return PlacedBackbone(
        float(x - x0_px), float(y - y0_px), float(heading), float(size), pose.posture
    )
