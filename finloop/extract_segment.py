"""One frame → its fish: silhouettes, soft cut-outs, outlines, backbones (fish paper §2.1-2.2.1).

Two thresholds: pixels above the noise are *candidates*; within each candidate patch the silhouette
is what rises above a share of that fish's own contrast. The first finds pale fish, the second keeps
soft shadows, wakes and reflections out of the silhouette.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.extract_backbone import Backbone, resample, to_outline, trace
from finloop.extract_background import Image, Scene, difference
from finloop.extract_table import OUTLINE_POINTS

_PAD = 4  # px of tank kept around a silhouette, so that soft edges and tips stay inside the cut-out
_CONTRAST = 0.8  # quantile of the difference inside a candidate that stands for its contrast


@dataclass(frozen=True)
class Silhouette:
    """A connected patch of one frame that may be one fish, several, or none.

    x0, y0: pixel of the cut-out's upper left corner. mask: (h, w) bool. field: (h, w) float32, the
    difference image. area_px: pixels of the mask. at_border: it touches the edge of the picture or
    of the arena.
    """

    x0: int
    y0: int
    mask: NDArray[np.bool_]
    field: NDArray[np.float32]
    contrast: float
    area_px: float
    at_border: bool


@dataclass(frozen=True)
class Fish:
    """One isolated fish in one frame. Coordinates in px of the picture, pixel centres at integers.

    backbone.points_px and outline_px are in picture coordinates too; outline_px is (m, 2), closed,
    its first point not repeated. alpha: (h, w) uint8, 255 = fish, soft at the outline.
    """

    x_px: float
    y_px: float
    area_px: float
    contrast: float
    x0: int
    y0: int
    alpha: Image
    backbone: Backbone
    outline_px: NDArray[np.float64]


def silhouettes(
    frame: Image, scene: Scene, arena: Image, least_area: float, share: float
) -> Iterator[Silhouette]:
    """Every patch of `frame` of at least `least_area` px² that stands out of the background.

    `arena` (h, w) uint8 is 255 inside. `share` of a patch's own contrast is where its edge is put.
    """
    change = difference(frame, scene.background, scene.polarity)
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
        above = patch[patch > scene.threshold]
        contrast = float(
            np.partition(above, int(_CONTRAST * (above.size - 1)))[
                int(_CONTRAST * (above.size - 1))
            ]
        )
        level = max(int(scene.threshold), int(share * contrast))
        yield from _parts(patch, left, top, level, contrast, arena, least_area)


def _parts(
    patch: Image, left: int, top: int, level: int, contrast: float, arena: Image, least: float
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
            left + x, top + y, mask.astype(bool), field.astype(np.float32), contrast, area,
            _touches_border(mask, left + x, top + y, arena),
        )  # fmt: skip


def _touches_border(mask: Image, x0: int, y0: int, arena: Image) -> bool:
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


def measure(silhouette: Silhouette, points: int, threshold: float) -> Fish | None:
    """Backbone, outline and soft alpha of an isolated silhouette; None if it has no backbone."""
    backbone = trace(silhouette.mask, silhouette.field, points, threshold)
    if backbone is None:
        return None
    alpha = matte(silhouette, threshold)
    moments = cv2.moments(alpha)
    corner = np.array([silhouette.x0, silhouette.y0])
    return Fish(
        x_px=moments["m10"] / moments["m00"] + silhouette.x0,
        y_px=moments["m01"] / moments["m00"] + silhouette.y0,
        area_px=moments["m00"] / 255,
        contrast=silhouette.contrast,
        x0=silhouette.x0,
        y0=silhouette.y0,
        alpha=alpha,
        backbone=backbone._replace(points_px=backbone.points_px + corner),
        outline_px=outline(alpha) + corner,
    )


def matte(silhouette: Silhouette, threshold: float) -> Image:
    """Soft alpha (h, w) uint8: the difference as a share of the fish's own height near each pixel.

    Near the outline a pixel is a blend of fish and tank, so alpha = difference / (difference that
    the fish makes just inside). That height is carried outwards from the core by a dilation. Deep
    inside, where patterned skin may resemble the tank, alpha is 1.
    """
    mask = silhouette.mask.astype(np.uint8)
    inner = np.where(silhouette.mask, silhouette.field, 0).astype(np.float32)
    height = cv2.dilate(inner, np.ones((5, 5), np.uint8))
    soft = silhouette.field / np.maximum(height, threshold)
    soft[cv2.erode(mask, np.ones((3, 3), np.uint8)) > 0] = 1.0
    soft[cv2.dilate(mask, np.ones((3, 3), np.uint8)) == 0] = 0.0
    return np.round(255 * np.clip(soft, 0, 1)).astype(np.uint8)


def outline(alpha: Image) -> NDArray[np.float64]:
    """The outline as (OUTLINE_POINTS, 2) x, y at equal arc lengths: alpha crosses one half."""
    inside = cv2.threshold(alpha, 127, 255, cv2.THRESH_BINARY)[1]
    chains = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    chain = max(chains, key=len)[:, 0].astype(np.float64)
    chain = resample(np.vstack([chain, chain[:1]]), OUTLINE_POINTS + 1)[:-1]
    edge = to_outline(alpha.astype(np.float32), chain)
    return resample(np.vstack([edge, edge[:1]]), OUTLINE_POINTS + 1)[:-1]


def premultiplied(frame: Image, background: Image, fish: Fish) -> Image:
    """Cut-out (h, w, 2) grey + alpha or (h, w, 4) RGB + alpha, uint8, colour premultiplied by
    alpha.

    What the fish added to the picture: frame − (1 − alpha) · background, so that laying the cut-out
    over the same background gives back the frame, without a fringe of tank colour anywhere else.
    """
    h, w = fish.alpha.shape
    here = np.s_[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w]
    alpha = fish.alpha.reshape(h, w, 1).astype(np.int32)
    film = frame[here].reshape(h, w, -1).astype(np.int32)
    tank = background[here].reshape(h, w, -1).astype(np.int32)
    added = (255 * film - (255 - alpha) * tank + 127) // 255
    return np.concatenate([np.clip(added, 0, alpha), alpha], axis=-1).astype(np.uint8)
