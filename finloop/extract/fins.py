"""What is seen of a fish beyond its silhouette: pale fins, or a shadow.

A silhouette ends where the difference from the tank falls to a share of the fish's contrast. What
is paler, and still no noise, is a fin that light passes through, the tip of a tail, or a shadow.
Fins keep their place on the fish, and a shadow keeps its side of the picture. Which of them it is,
many fish tell together (`are_fins`). What is brighter than the tank is no shadow.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.extract.backbone import Backbone

_REACH = 0.3  # of the diagonal of a silhouette's box; what is farther away is no part of the fish
_ALIKE = 1.2  # as long as this the two means count as equal: fish that all head the same way
_LEAST = 0.02  # of a silhouette's area; less of it that is pale tells no side

_RIM = 2  # px of tank that a cut-out keeps about its fins

Fins = Literal["all", "darker", "brighter", "none"]
"""Which pale pixels count as fins: by whether they are darker or brighter than the tank."""

Place = tuple[int, int, int, int]  # x, y, width, height of a box


class Pale(NamedTuple):
    """The pale pixels about one silhouette.

    x0, y0: the upper left pixel, in px of the picture. mask: (h, w) bool, none of a silhouette.
    field: (h, w) uint8, the difference image.
    """

    x0: int
    y0: int
    mask: Mask
    field: Picture


class Nearest(NamedTuple):
    """The silhouette that is nearest to each pixel of a patch.

    number: (h, w) int32, one number a silhouette; distance_px: (h, w), 0 inside of one.
    """

    number: NDArray[np.int32]
    distance_px: NDArray[np.float32]


def nearest(bodies: Picture) -> Nearest:
    """The nearest silhouettes; bodies: (h, w) uint8, 1 where one is."""
    distance, number = cv2.distanceTransformWithLabels(
        1 - bodies, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_CCOMP
    )
    return Nearest(np.asarray(number), np.asarray(distance))


def pale_of(box: Place, number: int, near: Nearest, patch: Picture, mask: Mask) -> Pale:
    """The pale pixels about the silhouette of that number.

    box: of the silhouette in the patch, with its rim; patch: (h, w) uint8, the difference image;
    mask: (h, w) the pale pixels. x0 and y0 of the result are px of the patch.
    """
    x, y, w, h = box
    reach = _REACH * float(np.hypot(w, h))
    left, top = max(x - int(reach) - 1, 0), max(y - int(reach) - 1, 0)
    window = np.s_[top : y + h + int(reach) + 1, left : x + w + int(reach) + 1]
    distance = near.distance_px[window]
    own = mask[window] & (near.number[window] == number) & (distance > 0) & (distance <= reach)
    return Pale(left, top, own, patch[window].copy())


def with_fins(
    alpha: Picture, corner: tuple[int, int], fins: Pale, contrast: float
) -> tuple[Picture, tuple[int, int]]:
    """Soft alpha (h, w) uint8 of a silhouette with its fins, and its first pixel, x and y.

    A fin's pixel is as opaque as its difference is a share of the fish's `contrast`, so that any
    tank shines through it. alpha: of the silhouette, its first pixel at `corner`.
    """
    (left, top), (h, w) = corner, alpha.shape
    x, y, right, bottom = left - fins.x0, top - fins.y0, left - fins.x0 + w, top - fins.y0 + h
    if fins.mask.any():
        u, v, width, height = cv2.boundingRect(fins.mask.view(np.uint8))
        x, y = min(x, max(u - _RIM, 0)), min(y, max(v - _RIM, 0))
        right = max(right, min(u + width + _RIM, fins.mask.shape[1]))
        bottom = max(bottom, min(v + height + _RIM, fins.mask.shape[0]))
    mask, field = fins.mask[y:bottom, x:right], fins.field[y:bottom, x:right]
    whole = np.where(mask, np.minimum(field * (255 / contrast) + 0.5, 255), 0).astype(np.uint8)
    x, y = x + fins.x0, y + fins.y0
    body = whole[top - y : top - y + h, left - x : left - x + w]
    np.copyto(body, alpha, where=alpha > 0)
    return whole, (x, y)


def of_tone(fins: Fins, film: Picture, tank: Picture) -> Mask:
    """Where the film (h, w) or (h, w, 3) differs from the tank in the way that `fins` says."""
    if fins in ("all", "none"):
        return np.full(film.shape[:2], fins == "all")
    low, high = (film, tank) if fins == "darker" else (tank, film)
    change = low.astype(np.int16) - high
    return np.asarray((change if change.ndim == 2 else change.sum(axis=2)) < 0)


class Side(NamedTuple):
    """Where the pale pixels of one fish lie, as seen from the middle of its silhouette.

    in_picture: (2,) x, y px; on_fish: (2,) px ahead and to one side.
    """

    in_picture: Floats
    on_fish: Floats


def side(mask: Mask, corner: tuple[int, int], backbone: Backbone, fins: Pale) -> Side | None:
    """The side on which the pale pixels of a fish lie; None if there are next to none.

    mask: (h, w) the silhouette, its first pixel at `corner`, x and y. The thicker half of the
    backbone, in px of the mask, is taken for the front.
    """
    if np.count_nonzero(fins.mask) < _LEAST * np.count_nonzero(mask):
        return None
    origin = np.subtract(fins[:2], corner)
    away = _middle(fins.mask * fins.field) + origin - _middle(mask)
    line, width = backbone.points_px, backbone.half_width_px
    half = len(line) // 2
    ahead = line[0] - line[-1]
    if width[:half].sum() < width[-half:].sum():
        ahead = -ahead
    ahead = ahead / (np.hypot(*ahead) or 1.0)
    across = np.array([-ahead[1], ahead[0]])
    return Side(away, np.array([away @ ahead, away @ across]))


def _middle(weight: Picture | Mask) -> Floats:
    """The centre of mass (2,) x, y px of a picture."""
    moments = cv2.moments(weight.astype(np.uint8))
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def are_fins(sides: Iterable[Side | None]) -> bool:
    """Whether what is pale about fish keeps its place on the fish, rather than in the picture.

    So it is where the mean of the places on the fish is the longer one. True of a film that does
    not tell: one without pale pixels, or one in which all fish head the same way.
    """
    known = [one for one in sides if one is not None]
    if not known:
        return True
    in_picture = np.hypot(*np.mean([one.in_picture for one in known], axis=0))
    on_fish = np.hypot(*np.mean([one.on_fish for one in known], axis=0))
    return bool(in_picture <= on_fish * _ALIKE)
