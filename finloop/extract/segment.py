"""One frame → its fish: silhouettes, soft cut-outs, outlines, backbones (fish paper §2.1-2.2.1).

Two thresholds: pixels above the noise form *candidate* patches; within a patch the silhouette are
the pixels above a share of that fish's own contrast. The first threshold finds pale fish, the
second keeps soft shadows, wakes and reflections out of the silhouette.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.extract.backbone import Backbone, ring, trace, upper_level
from finloop.extract.background import Scene, difference
from finloop.extract.table import OUTLINE_POINTS

_PAD = 4  # px of tank kept around a silhouette, so that soft edges and tips stay inside the cut-out
_CONTRAST = 0.8  # quantile of the difference inside a candidate that stands for its contrast


@dataclass(frozen=True)
class Silhouette:
    """A connected patch of one frame that may be one fish, several, or none.

    x0, y0: pixel of the cut-out's upper left corner. mask: (h, w) bool. field: (h, w) uint8, the
    difference image. area_px: pixels of the mask. at_border: it touches the edge of the picture or
    of the arena.
    """

    x0: int
    y0: int
    mask: Mask
    field: Picture
    contrast: float
    area_px: float
    at_border: bool


@dataclass(frozen=True)
class Fish:
    """One isolated fish in one frame. Coordinates in px of the picture, pixel centres at integers.

    backbone.points_px and outline_px are in picture coordinates too; outline_px is (m, 2), closed,
    its first point not repeated. cutout: (h, w, 2 or 4) uint8, premultiplied, its upper left pixel
    at (x0, y0).
    """

    x_px: float
    y_px: float
    area_px: float
    contrast: float
    backbone: Backbone
    outline_px: Floats
    x0: int
    y0: int
    cutout: Picture


def silhouettes(
    frame: Picture, scene: Scene, arena: Picture, least_area: float, share: float
) -> Iterator[Silhouette]:
    """Every patch of `frame` of at least `least_area` px² that stands out from the background.

    `scene` is in the light of the frame (`in_light_of`); `arena` (h, w) uint8 is 255 inside. The
    edge of a patch lies at `share` of its own contrast.
    """
    change = difference(frame, scene)
    cv2.bitwise_and(change, arena, dst=change)
    candidates = cv2.threshold(change, int(scene.threshold), 255, cv2.THRESH_BINARY)[1]
    height, width = change.shape
    for contour in cv2.findContours(candidates, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
        x, y, w, h = cv2.boundingRect(contour)
        if w * h < least_area:
            continue
        left, top = max(x - _PAD, 0), max(y - _PAD, 0)
        right, bottom = min(x + w + _PAD, width), min(y + h + _PAD, height)
        patch = change[top:bottom, left:right]
        contrast = upper_level(patch, scene.threshold, _CONTRAST)
        level = max(int(scene.threshold), int(share * contrast))
        for part in _parts(patch, left, top, level, contrast, arena, least_area):
            if _inside(contour, part):  # others may reach into the rectangle
                yield part


def _inside(candidate: NDArray[np.int32], part: Silhouette) -> bool:
    """Whether a silhouette is a part of a candidate, of which `candidate` is the edge.

    It is connected, so one of its pixels tells.
    """
    row, column = divmod(int(part.mask.argmax()), part.mask.shape[1])
    pixel = float(part.x0 + column), float(part.y0 + row)
    return cv2.pointPolygonTest(candidate, pixel, measureDist=False) >= 0


def _parts(
    patch: Picture, left: int, top: int, level: int, contrast: float, arena: Picture, least: float
) -> Iterator[Silhouette]:
    """The connected, hole-free parts of a candidate patch above `level`."""
    above = cv2.threshold(patch, level, 255, cv2.THRESH_BINARY)[1]
    for contour in cv2.findContours(above, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
        x, y, w, h = cv2.boundingRect(contour)
        if w * h < least:
            continue
        x, y = max(x - _PAD, 0), max(y - _PAD, 0)
        w, h = w + 2 * _PAD, h + 2 * _PAD
        field = patch[y : y + h, x : x + w]
        mask = np.zeros(field.shape, np.uint8)
        cv2.drawContours(mask, [contour], -1, 1, cv2.FILLED, offset=(-x, -y))
        area = cv2.countNonZero(mask)
        if area < least:
            continue
        yield Silhouette(
            left + x, top + y, mask.astype(bool), field, contrast, area,
            _touches_border(mask, left + x, top + y, arena),
        )  # fmt: skip


def _touches_border(mask: Picture, x0: int, y0: int, arena: Picture) -> bool:
    """Whether a silhouette reaches the picture's edge, or comes close to the arena's."""
    h, w = mask.shape
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows[0] + y0 <= 1 or columns[0] + x0 <= 1:
        return True
    if rows[-1] + y0 >= arena.shape[0] - 2 or columns[-1] + x0 >= arena.shape[1] - 2:
        return True
    inside = arena[y0 : y0 + h, x0 : x0 + w]
    if inside.all():
        return False
    return bool(((cv2.dilate(mask, np.ones((5, 5), np.uint8)) > 0) & (inside == 0)).any())


def contour(silhouette: Silhouette) -> NDArray[np.int32]:
    """The pixels of a silhouette's edge, (n, 1, 2) int32 px of the picture."""
    chains, _ = cv2.findContours(
        silhouette.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE,
        offset=(silhouette.x0, silhouette.y0),
    )  # fmt: skip
    return max(chains, key=len)


def measure(silhouette: Silhouette, frame: Picture, scene: Scene, points: int) -> Fish | None:
    """Backbone, outline and cut-out of an isolated silhouette; None if it has no backbone.

    `frame` and `scene` are those in which it was found.
    """
    backbone = trace(silhouette.mask, silhouette.field, points, scene.threshold)
    if backbone is None:
        return None
    alpha = matte(silhouette.mask, silhouette.field, scene.threshold)
    moments = cv2.moments(alpha)
    x0, y0 = silhouette.x0, silhouette.y0
    corner = np.array([x0, y0])
    h, w = alpha.shape
    window = np.s_[y0 : y0 + h, x0 : x0 + w]
    return Fish(
        x_px=moments["m10"] / moments["m00"] + x0,
        y_px=moments["m01"] / moments["m00"] + y0,
        area_px=moments["m00"] / 255,
        contrast=silhouette.contrast,
        backbone=backbone._replace(points_px=backbone.points_px + corner),
        outline_px=outline(alpha) + corner,
        x0=x0,
        y0=y0,
        cutout=premultiplied(frame[window], scene.background[window], alpha),
    )


def matte(mask: Mask, field: Picture, threshold: float) -> Picture:
    """Soft alpha (h, w) uint8 of a silhouette.

    Near the outline a pixel is a blend of fish and tank, so alpha is its difference divided by the
    difference just inside the fish, which a dilation carries outwards. Deep inside, where patterned
    skin may resemble the tank, alpha is 1.
    """
    solid = mask.astype(np.uint8) * np.uint8(255)
    height = cv2.dilate(cv2.bitwise_and(field, solid), np.ones((5, 5), np.uint8))
    soft = cv2.divide(field, cv2.max(height, threshold), scale=255)
    soft = cv2.bitwise_or(soft, cv2.erode(solid, np.ones((3, 3), np.uint8)))
    return cv2.bitwise_and(soft, cv2.dilate(solid, np.ones((3, 3), np.uint8)))


def outline(alpha: Picture) -> Floats:
    """The outline as (OUTLINE_POINTS, 2) x, y at equal arc lengths: alpha crosses one half."""
    inside = cv2.threshold(alpha, 127, 255, cv2.THRESH_BINARY)[1]
    chains = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return ring(alpha, max(chains, key=len)[:, 0], OUTLINE_POINTS)


def premultiplied(film: Picture, tank: Picture, alpha: Picture) -> Picture:
    """Cut-out (h, w, 2) grey + alpha or (h, w, 4) RGB + alpha, uint8, premultiplied by alpha.

    It is film − (1 − alpha) · tank: laid over the same tank it gives back the film, and over any
    other picture it has no fringe of tank colour. `film` and `tank` are (h, w) or (h, w, 3),
    `alpha` (h, w).
    """
    through = 255 - alpha
    added = [
        cv2.min(cv2.subtract(channel, cv2.multiply(behind, through, scale=1 / 255)), alpha)
        for channel, behind in zip(cv2.split(film), cv2.split(tank), strict=True)
    ]
    return cv2.merge([*added, alpha])
