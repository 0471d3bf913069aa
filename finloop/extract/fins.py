"""Decide what pale pixels around a silhouette are: fins, a shadow, or gloom (dimmed floor).

A silhouette ends where the difference from the tank falls to a share of the fish's contrast. Paler
pixels that are no noise are a fin that light passes through, the tip of a tail, a shadow, or the
gloom around an animal that takes the light from its floor. Many fish together show which of them it
is (`classify_pale_pixels`). Pixels brighter than the tank are no shadow.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.kernel import kernel
from finloop.extract.backbone import Backbone
from finloop.extract.masks import find_spans

_ALIKE = 1.2  # largest ratio of two means that count as equal: all fish may head the same way
# Least share of the way round an animal that is gloom; measured: fins 0.00-0.04, a mouse's 0.28.
_AROUND = 0.15
_EDGE = 2.0  # px, width of the soft edge of a silhouette
_LEAST = 0.02  # least pale share of a silhouette's area that shows a side
_RIM = 2  # px of tank that a cut-out keeps about its fins

Fins = Literal["all", "darker", "brighter", "none"]
"""Which pale pixels count as fins: those darker or brighter than the tank, both, or none."""

Kind = Literal["fins", "shadow", "gloom"]
"""The nature of the pale pixels about the fish of a film."""


class PalePixels(NamedTuple):
    """The pixels around a silhouette that differ a little from the tank, and may be fins.

    x0, y0: the upper left pixel, in px of the picture. mask: (h, w) bool, without the silhouette.
    field: (h, w) uint8, the difference from the empty tank.
    """

    x0: int
    y0: int
    mask: Mask
    field: Picture


def add_fins_to_alpha(
    alpha: Picture, corner: tuple[int, int], fins: PalePixels, levels: tuple[float, float]
) -> tuple[Picture, tuple[int, int]]:
    """Add a fish's fins to its alpha (h, w); return the alpha and its upper left pixel x, y.

    A fin's pixel is as opaque as its difference is a share of the fish's contrast; below twice the
    threshold it fades, so a fin has no hard edge. alpha: of the silhouette alone; corner: x, y of
    its first pixel in the picture. levels: the fish's contrast, and the threshold, grey levels.
    """
    corner_in_fins = corner[0] - fins.x0, corner[1] - fins.y0
    new_alpha, x, y = _draw_fins(alpha, corner_in_fins, fins.mask, fins.field, levels)
    return new_alpha, (x + fins.x0, y + fins.y0)


@kernel
def _draw_fins(alpha, corner, mask, field, levels):  # type: ignore[no-untyped-def]
    """Return a silhouette's alpha with its fins, and where in `mask` its upper left pixel lies.

    alpha: of the silhouette alone, whose first pixel is at `corner`, x and y, of the mask; mask,
    field: (h, w), the pale pixels, and the difference from the empty tank; levels: the fish's
    contrast, and the threshold, grey levels. A fin's opacity is its difference as a share of the
    contrast, faded to 0 from twice the threshold down to the threshold.
    """
    (left, top), (contrast, threshold) = corner, levels
    (h, w), (height, width) = alpha.shape, mask.shape
    x, y, right, bottom = left, top, left + w, top + h  # the box of silhouette and fins
    first, stop = find_spans(mask, 0)
    for v in range(height):
        if first[v] < stop[v]:
            x, right = min(x, max(first[v] - _RIM, 0)), max(right, min(stop[v] + _RIM, width))
            y, bottom = min(y, max(v - _RIM, 0)), max(bottom, min(v + 1 + _RIM, height))
    opacity = np.empty(256, np.uint8)
    for level in range(256):
        fade = min(max(level / threshold - 1, 0.0), 1.0)
        opacity[level] = int(min(level * fade * (255 / contrast) + 0.5, 255.0))
    result = np.zeros((bottom - y, right - x), np.uint8)
    for v in range(height):
        for u in range(first[v], stop[v]):
            if mask[v, u]:
                result[v - y, u - x] = opacity[field[v, u]]
    for v in range(h):
        for u in range(w):
            fin = result[top - y + v, left - x + u]
            result[top - y + v, left - x + u] = max(alpha[v, u], fin)  # no gap where a fin begins
    return result, x, y


class PaleSide(NamedTuple):
    """Where the pale pixels around one fish lie, seen from the middle of its silhouette.

    in_picture: (2,) px, to the right and down in the picture; on_fish: (2,) px, ahead of the fish
    and to one side. around: share (0 … 1) of a line around the fish, a quarter of its width away,
    that is pale.
    """

    in_picture: Floats
    on_fish: Floats
    around: float


def find_pale_side(
    mask: Mask, corner: tuple[int, int], backbone: Backbone, fins: PalePixels
) -> PaleSide | None:
    """Return where a fish's pale pixels lie, seen from its middle; None if it has hardly any.

    mask: (h, w), the silhouette, whose first pixel is at `corner`, x and y in px of the picture.
    backbone: in px of the mask; its thicker half counts as the front. fins: the pale pixels around
    it, in px of the picture.
    """
    if np.count_nonzero(fins.mask) < _LEAST * np.count_nonzero(mask):
        return None
    origin = np.array([fins.x0 - corner[0], fins.y0 - corner[1]])
    offset = _centre_of_mass(fins.mask * fins.field) + origin - _centre_of_mass(mask)
    ahead = _thick_end_direction(backbone)
    across = np.array([-ahead[1], ahead[0]])
    outside = np.ones(fins.mask.shape, np.uint8)
    x, y = -origin
    outside[y : y + mask.shape[0], x : x + mask.shape[1]] -= mask
    distance = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_5)
    # A line around the fish, a quarter of its width (two half widths) outside its soft edge.
    ring = np.abs(distance - _EDGE - backbone.half_width_px.max() / 2) <= 1
    on_fish = np.array([offset @ ahead, offset @ across])
    return PaleSide(offset, on_fish, float(fins.mask[ring].mean()))


def _thick_end_direction(backbone: Backbone) -> Floats:
    """Return the unit vector (2,) along a backbone towards its thicker half."""
    line, width = backbone.points_px, backbone.half_width_px
    half, ahead = len(line) // 2, line[0] - line[-1]
    if width[:half].sum() < width[-half:].sum():
        ahead = -ahead
    return ahead / (np.hypot(*ahead) or 1.0)


def _centre_of_mass(picture: Picture | Mask) -> Floats:
    """Return the centre of mass (2,) x, y [px] of a picture's grey levels."""
    moments = cv2.moments(picture.astype(np.uint8))
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def classify_pale_pixels(sides: Iterable[PaleSide | None]) -> Kind:
    """Decide whether the pale pixels around the fish of a film are fins, shadows or gloom.

    sides: of each fish, None where it has next to none. A shadow is always on the same side of the
    picture, fins on the same side of the fish, gloom (dimmed floor) all around. If all fish head
    the same way, both sides are equally constant, and no shadow is assumed. Without pale pixels the
    result is `fins`.
    """
    known = [side for side in sides if side is not None]
    if not known:
        return "fins"
    # Lengths of mean offsets: large where the offsets of all fish agree.
    in_picture = np.hypot(*np.mean([side.in_picture for side in known], axis=0))
    on_fish = np.hypot(*np.mean([side.on_fish for side in known], axis=0))
    if in_picture > on_fish * _ALIKE:
        return "shadow"
    return "gloom" if np.median([side.around for side in known]) > _AROUND else "fins"
