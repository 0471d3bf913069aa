"""Find the fish in one frame: silhouettes, soft cut-outs, outlines, backbones (§2.1-2.2.1).

Two thresholds: pixels above the noise form *candidate* patches; within a patch, the silhouette has
the pixels above a share of that fish's own contrast. The first threshold finds pale fish, the
second keeps soft shadows, wakes and reflections out of the silhouette. If a fish is both brighter
and darker than the tank, its pixels darker than a shadow belong to the silhouette, too.

A part a few pixels wide, such as a mouse's tail, is blurred, so its own contrast is lower: it would
be in the silhouette of some frames only, and the backbone long in one frame and short in the next.
Where that is so, thin parts get a lower threshold.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.kernel import kernel
from finloop.extract.backbone import (
    Backbone,
    morph_with_disc,
    pad_picture,
    quantile_above,
    refine_outline,
    trace_backbone,
)
from finloop.extract.background import Scene, difference_image
from finloop.extract.fins import Fins, PalePixels, add_fins_to_alpha
from finloop.extract.masks import find_pieces, find_spans, trace_edge
from finloop.extract.matte import cut_with_residue, one_piece, residue_width, soft_edge
from finloop.extract.table import OUTLINE_POINTS

_NEAR_ARENA = np.ones((5, 5), np.uint8)  # a silhouette within two pixels of its edge touches it
_PAD = 4  # px of tank kept around a silhouette, so that soft edges and tips stay inside the cut-out
Edge = NDArray[np.int32]  # (n, 1, 2) x, y, px
_CONTRAST = 0.8  # quantile of the difference inside a candidate that stands for its contrast
THIN_EDGE = 0.2  # share of the animal's contrast at which a thin part ends
_THIN = 0.4  # share of a body's largest half width; narrower parts are thin
_REACH = 0.3  # share of the diagonal of a silhouette's box; pixels farther from it are no fin


class Silhouette(NamedTuple):
    """A connected patch of a frame that differs from the tank: one fish, several, or none.

    x0, y0: pixel of the cut-out's upper left corner. mask: (h, w) bool. field: (h, w) uint8, the
    difference image. contrast: of the fish to the tank, grey levels. area_px: pixels of the mask.
    at_border: it touches the edge of the picture or of the arena. pale: pixels around it that
    differ less from the tank, and may be fins; None where they are not searched.
    """

    x0: int
    y0: int
    mask: Mask
    field: Picture
    contrast: float
    area_px: float
    at_border: bool
    pale: PalePixels | None = None


class SegmentedFish(NamedTuple):
    """One isolated fish in one frame, in px of the picture, with pixel centres at integers.

    x_px, y_px: its mass centre; area_px: in px²; contrast: to the tank, grey levels. backbone: its
    points are in picture coordinates, too. outline_px: (m, 2), closed, its first point not
    repeated. cutout: (h, w, 2 or 4) uint8, premultiplied, its upper left pixel at (x0, y0).
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


class SilhouetteEdge(NamedTuple):
    """The limits that decide which pixels belong to a silhouette.

    share: of a fish's own contrast, at which its edge lies; shadow: most of the tank's light that a
    shadow takes away; fins: which pale pixels belong to it; thin: whether its pale thin parts
    belong to it (`add_thin_parts`).
    """

    share: float
    shadow: float
    fins: Fins = "none"
    thin: bool = False


def find_silhouettes(
    frame: Picture, scene: Scene, arena: Picture, least_area_px: float, edge_rule: SilhouetteEdge
) -> Iterator[Silhouette]:
    """Yield the silhouettes in a frame that are at least `least_area_px` [px²] large.

    They are searched in each connected patch of pixels that differ from the background.
    scene: its background is as bright as the frame (`match_scene_to_light`); arena: (h, w) uint8,
    255 inside; edge_rule: which pixels belong to a silhouette.
    """
    change = difference_image(frame, scene)
    height, width = change.shape
    for patch_edge in _find_patch_edges(change, arena, int(scene.threshold)):
        x, y, w, h = cv2.boundingRect(patch_edge)
        if w * h < least_area_px:
            continue
        left, top = max(x - _PAD, 0), max(y - _PAD, 0)
        right, bottom = min(x + w + _PAD, width), min(y + h + _PAD, height)
        patch = change[top:bottom, left:right]
        contrast = quantile_above(patch, scene.threshold, _CONTRAST)
        film, tank = (picture[top:bottom, left:right] for picture in (frame, scene.background))
        animal = _find_animal_pixels(patch, contrast, film, tank, scene, edge_rule)
        parts = []
        for edge in cv2.findContours(animal, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            pixel = float(left + edge[0, 0, 0]), float(top + edge[0, 0, 1])
            if cv2.pointPolygonTest(patch_edge, pixel, measureDist=False) < 0:
                continue  # it belongs to a neighbouring patch in the same rectangle
            part = _silhouette_inside_edge(edge, patch, (left, top), contrast, arena)
            if part.area_px >= least_area_px:
                parts.append((part, edge))
        if edge_rule.fins == "none" or not parts:
            yield from (part for part, _ in parts)
        else:
            pale = (patch > scene.threshold) & _may_show_fin(film, tank, edge_rule.fins)
            yield from _assign_pale_pixels(parts, patch_edge, patch, (left, top), pale)


def _may_show_fin(film: Picture, tank: Picture, fins: Fins) -> Mask:
    """Return a mask (h, w) of pixels that may belong to a fin: all, the darker, or the brighter.

    film, tank: (h, w[, 3]), with and without the fish; equally bright pixels count as brighter.
    """
    if fins == "all":
        return np.ones(film.shape[:2], bool)
    gain = film.astype(np.int16) - tank
    darker = (gain if gain.ndim == 2 else gain.sum(axis=2)) < 0
    return np.asarray(darker if fins == "darker" else ~darker)


def _find_animal_pixels(
    patch: Picture, contrast: float, film: Picture, tank: Picture, scene: Scene,
    edge_rule: SilhouetteEdge,
) -> Picture:  # fmt: skip
    """Return the pixels of a patch that show an animal: (h, w) uint8, 255 where they do.

    patch: (h, w), difference of film and tank, grey levels; contrast: of its animals; film, tank:
    (h, w[, 3]), the patch with and without animals; edge_rule: which pixels belong to them.
    """
    level = max(int(scene.threshold), int(edge_rule.share * contrast))
    animal = cv2.threshold(patch, level, 255, cv2.THRESH_BINARY)[1]
    if edge_rule.thin:
        thin_level = max(int(scene.threshold), int(THIN_EDGE * contrast))
        animal = add_thin_parts(animal, patch, thin_level)
    if scene.polarity == "both":
        animal = _add_dark_skin(animal, patch > scene.threshold, film, tank, edge_rule.shadow)
    return animal


def add_thin_parts(silhouettes: Picture, change: Picture, least_level: int) -> Picture:
    """Return silhouettes (h, w), 0 or 255, together with the pale thin parts that touch them.

    change: (h, w), the difference from the empty tank; least_level: grey levels that a thin part
    exceeds. Wide pale parts, such as shadows, and short ones are left out.
    """
    body = np.minimum(silhouettes, 1)
    pale = cv2.threshold(change, least_level, 1, cv2.THRESH_BINARY)[1] | body
    half_width = float(cv2.distanceTransform(pad_picture(body, 1), cv2.DIST_L2, 3).max())
    radius = max(1, int(_THIN * half_width + 0.5))
    wide = morph_with_disc(pale, cv2.MORPH_OPEN, radius)
    body_and_thin = body | (pale & (1 - wide))
    _, number = cv2.connectedComponents(body_and_thin)
    touches_body = np.isin(number, number[body.view(bool)])
    _, part, sizes, _ = cv2.connectedComponentsWithStats(body_and_thin * touches_body & (1 - body))
    long = sizes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) >= radius
    long[0] = False  # the rest of the picture
    return np.where(long[part], np.uint8(255), silhouettes)


def _add_dark_skin(
    silhouette: Picture, changed: Mask, film: Picture, tank: Picture, shadow: float
) -> Picture:
    """Return a bright fish's silhouette (h, w), 0 or 255, with its dark skin added.

    Such skin lacks more than the share `shadow` of the tank's light in all channels. changed: (h,
    w), where the film differs from the tank. film, tank: (h, w[, 3]), with and without the fish.
    Between bright and dark skin a pixel can be as bright as the tank: such gaps are closed.
    """
    dark = cv2.subtract(tank, film) > shadow * tank
    dark = changed & (dark if dark.ndim == 2 else dark.all(axis=-1))
    if not (dark & (silhouette == 0)).any():
        return silhouette
    both = np.where(dark, np.uint8(255), silhouette)
    return np.asarray(cv2.morphologyEx(both, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))


def _find_patch_edges(change: Picture, arena: Picture, level: int) -> Iterator[Edge]:
    """Yield the edge of each connected patch above a grey level, from the bottom up.

    Edges are in px of the picture. change: (h, w) grey levels, the difference from the empty tank.
    `change` itself is altered: outside of the arena it becomes 0, in the rows of pixels that are
    searched. Those are the rows with a pixel above the level, and the rows near them. arena: (h,
    w), 255 inside, 0 outside.
    """
    rows = np.flatnonzero(change.max(axis=1) > level)
    if not len(rows):
        return
    # Searching only the runs of rows that have such pixels is faster.
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 2 * _PAD) + 1)[::-1]:
        top, bottom = max(run[0] - _PAD, 0), run[-1] + 1 + _PAD
        part = change[top:bottom]
        cv2.bitwise_and(part, arena[top:bottom], dst=part)
        above = cv2.threshold(part, level, 255, cv2.THRESH_BINARY)[1]
        yield from cv2.findContours(
            above, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=(0, int(top))
        )[0]


def _silhouette_inside_edge(
    edge: Edge, patch: Picture, corner: tuple[int, int], contrast: float, arena: Picture
) -> Silhouette:
    """Return the silhouette inside a closed edge, with its holes filled.

    It is at the border within a pixel of the picture's edge, or two pixels of the arena's.
    edge: px of the patch; patch: part of the difference image; corner: x, y of the patch in the
    picture; contrast: of the patch, grey levels; arena: of the whole picture, uint8, 255 inside.
    """
    (left, top), (height, width) = corner, arena.shape
    x, y, w, h = cv2.boundingRect(edge)
    at_edge = min(x + left, y + top) <= 1 or x + w + left >= width - 1 or y + h + top >= height - 1
    # The cut-out is the edge's box with a rim of tank, as far as the patch reaches.
    x, y, right, bottom = max(x - _PAD, 0), max(y - _PAD, 0), x + w + _PAD, y + h + _PAD
    field = patch[y:bottom, x:right].copy()
    mask = np.zeros(field.shape, np.uint8)
    cv2.drawContours(mask, [edge], -1, 1, cv2.FILLED, offset=(-x, -y))
    x0, y0, area = x + left, y + top, cv2.countNonZero(mask)
    inside = arena[y0 : y0 + field.shape[0], x0 : x0 + field.shape[1]]
    at_border = at_edge
    if not at_edge and cv2.countNonZero(inside) < inside.size:
        at_border = bool(cv2.dilate(mask, _NEAR_ARENA)[inside == 0].any())
    return Silhouette(x0, y0, mask.view(bool), field, contrast, area, at_border)


def _assign_pale_pixels(
    parts: list[tuple[Silhouette, Edge]], patch_edge: Edge, patch: Picture, corner: tuple[int, int],
    pale: Mask,
) -> Iterator[Silhouette]:  # fmt: skip
    """Yield the silhouettes of one patch, each with the pale pixels nearest to it.

    Pale pixels differ from the tank less than a silhouette does: fins, or a shadow. parts: the
    silhouettes, and their edges in px of the patch; patch_edge: in px of the picture; patch: part
    of the difference image, at `corner` x, y of the picture; pale: (h, w), mask of the patch.
    Pixels farther than a share of a silhouette's diagonal, `_REACH`, are left out.
    """
    left, top = corner
    inside = np.zeros(patch.shape, np.uint8)
    cv2.drawContours(inside, [patch_edge], -1, 1, cv2.FILLED, offset=(-left, -top))
    pale = pale & inside.view(bool)
    if len(parts) > 1:  # each pixel gets the number of its nearest silhouette
        outside = np.ones(patch.shape, np.uint8)
        cv2.drawContours(outside, [edge for _, edge in parts], -1, 0, cv2.FILLED)
        nearest = cv2.distanceTransformWithLabels(
            outside, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_CCOMP
        )[1]
    for part, edge in parts:
        column, row = edge[0, 0]  # a pixel of the silhouette itself
        nearest_pale = pale if len(parts) == 1 else pale & (nearest == nearest[row, column])
        # The silhouette's box in the patch, and the window that is larger by `reach` on all sides.
        x, y, (h, w) = part.x0 - left, part.y0 - top, part.mask.shape
        reach = int(_REACH * np.hypot(h, w))
        x0, y0 = max(x - reach, 0), max(y - reach, 0)
        window = np.s_[y0 : y + h + reach, x0 : x + w + reach]
        mask = nearest_pale[window].copy()
        mask[y - y0 : y - y0 + h, x - x0 : x - x0 + w] &= ~part.mask
        yield part._replace(pale=PalePixels(x0 + left, y0 + top, mask, patch[window].copy()))


def edge_pixels(silhouette: Silhouette) -> Edge:
    """Return a silhouette's edge pixels (n, 1, 2) int32, x and y in px of the picture."""
    chains, _ = cv2.findContours(
        silhouette.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE,
        offset=(silhouette.x0, silhouette.y0),
    )  # fmt: skip
    return max(chains, key=len)


def measure_fish(
    silhouette: Silhouette, frame: Picture, scene: Scene, points: int, limbs: bool = False,
    edge_px: float = 3.0,
) -> SegmentedFish | None:  # fmt: skip
    """Return a silhouette's backbone, outline and cut-out; None if it has no backbone.

    frame, scene: those in which it was found; points: number of backbone points; limbs: whether the
    animal has limbs, which are no part of the backbone; edge_px: how wide outlines are in the film.
    The fins, and the softer edge of `matte`, are only in the cut-out (pixels with alpha), not in
    the outline or the area.
    """
    mask, field, (x0, y0) = silhouette.mask, silhouette.field, (silhouette.x0, silhouette.y0)
    backbone = trace_backbone(mask, field, points, scene.threshold, limbs)
    if backbone is None:
        return None
    levels = silhouette.contrast, scene.threshold
    (area, x, y), outline = _measure_outline(mask, field, round(scene.threshold), OUTLINE_POINTS)
    window = np.s_[y0 : y0 + mask.shape[0], x0 : x0 + mask.shape[1]]
    shown = soft_edge(mask, field, frame[window], scene.background[window], *levels, edge_px)
    left, top = x0, y0
    if silhouette.pale is not None:
        shown, (left, top) = add_fins_to_alpha(shown, (x0, y0), silhouette.pale, levels)
    shown = one_piece(shown, mask, (x0 - left, y0 - top))
    cutout, (left, top) = _cut_out(frame, scene, shown, (left, top))
    corner = np.array([x0, y0])
    return SegmentedFish(
        x_px=x + x0,
        y_px=y + y0,
        area_px=area,
        contrast=silhouette.contrast,
        backbone=Backbone(backbone.points_px + corner, *backbone[1:]),
        outline_px=outline + corner,
        x0=left,
        y0=top,
        cutout=cutout,
    )


@kernel
def _measure_outline(mask, field, floor, points):  # type: ignore[no-untyped-def]
    """Return a silhouette's area [px²] and mass centre x, y, and its outline (points, 2) x, y.

    mask, field: (h, w), the silhouette and the difference from the tank; floor: grey level below
    which differences are noise. A pixel counts as much as it is opaque. Of several pieces, the one
    with the longest outline counts.
    """
    alpha = soft_alpha(mask, field, floor)
    total, x_sum, y_sum = 0, 0, 0
    for y in range(alpha.shape[0]):
        row, of_row = alpha[y], 0
        for x in range(alpha.shape[1]):
            of_row += row[x]
            x_sum += x * row[x]
        total += of_row
        y_sum += y * of_row
    chain = np.empty((0, 2), np.int32)
    for first in find_pieces(alpha, 128):
        other = trace_edge(alpha, 128, first)
        if len(other) >= len(chain):
            chain = other
    return (total / 255, x_sum / total, y_sum / total), refine_outline(alpha, chain, points)


def _cut_out(
    frame: Picture, scene: Scene, alpha: Picture, corner: tuple[int, int]
) -> tuple[Picture, tuple[int, int]]:
    """Return a fish cut out of a frame in even light, with its residue, and its first pixel x, y.

    scene: in the light of the frame; alpha: (h, w), its first pixel at `corner`, x and y. In a
    light that is unknown, nothing is known of a residue.
    """
    left, top = corner
    bottom, right = top + alpha.shape[0], left + alpha.shape[1]
    if scene.gains is None or scene.even is None:
        window = np.s_[top:bottom, left:right]
        return premultiply_cutout(frame[window], scene.background[window], alpha), corner
    width_px = residue_width(math.hypot(*alpha.shape))
    before = min(width_px, top), min(width_px, left)
    after = min(width_px, len(frame) - bottom), min(width_px, frame.shape[1] - right)
    alpha = cv2.copyMakeBorder(
        alpha, before[0], after[0], before[1], after[1], cv2.BORDER_CONSTANT, value=0
    )
    top, left = top - before[0], left - before[1]
    window = np.s_[top : top + alpha.shape[0], left : left + alpha.shape[1]]
    film, tank = frame[window], scene.even[window]
    cutout = cut_with_residue(alpha, film, tank, scene.gains, scene.grain, width_px)
    return cutout, (left, top)


@kernel
def soft_alpha(mask: Mask, field: Picture, floor: int) -> Picture:
    """Return the alpha (h, w) uint8 of a silhouette: how opaque each pixel is, 0 … 255.

    mask: (h, w), the silhouette; field: (h, w), the difference from the tank. Near the outline a
    pixel is a blend of fish and tank, so alpha is its difference divided by the largest difference
    within two pixels inside the fish, or by `floor` if that is larger. Alpha is 255 where a pixel
    and all its neighbours are in the mask, 0 where none of them is.
    """
    height, width = mask.shape
    first, stop = find_spans(mask, 2)
    largest = _largest_in_mask(mask, field)
    alpha = np.zeros((height, width), np.uint8)
    sums, counts = np.empty(width + 2, np.uint8), np.zeros(width, np.uint8)
    for y in range(height):
        if first[y] >= stop[y]:
            continue
        # How many of a pixel and its neighbours are in the mask, beyond its edges as at them.
        above, here, below = mask[max(y - 1, 0)], mask[y], mask[min(y + 1, height - 1)]
        for x in range(width):
            sums[x + 1] = np.uint8(np.uint8(above[x] + here[x]) + below[x])
        sums[0], sums[width + 1] = sums[1], sums[width]
        for x in range(width):
            counts[x] = np.uint8(np.uint8(sums[x] + sums[x + 1]) + sums[x + 2])
        for x in range(first[y], stop[y]):
            if counts[x] == 9:
                alpha[y, x] = 255
            elif counts[x]:
                most = max(largest[y, x], floor, 1)
                alpha[y, x] = min(round(255 * field[y, x] / most), 255)
    return alpha


@kernel
def _largest_in_mask(mask, field):  # type: ignore[no-untyped-def]
    """Return the largest level (h, w) of a picture within two pixels of each that are in a mask."""
    height, width = mask.shape
    wide = width + 4  # all rows one after the other, with a rim
    flat = np.zeros((height + 4) * wide, np.uint8)
    for y in range(height):
        row = flat[(y + 2) * wide + 2 : (y + 2) * wide + 2 + width]
        for x in range(width):
            row[x] = field[y, x] * mask[y, x]
    size = height * wide
    column, largest = np.zeros(size, np.uint8), np.zeros(size - 4, np.uint8)
    for shift in range(5):
        source = flat[shift * wide : shift * wide + size]
        for i in range(size):
            column[i] = max(column[i], source[i])
    for shift in range(5):
        source = column[shift : shift + largest.size]
        for i in range(largest.size):
            largest[i] = max(largest[i], source[i])
    result = np.empty((height, width), np.uint8)
    for y in range(height):
        result[y] = largest[y * wide : y * wide + width]
    return result


def premultiply_cutout(
    film: Picture | NDArray[np.float32], tank: Picture, alpha: Picture
) -> Picture:
    """Return a fish cut out of a picture, without the tank's colour at its edge.

    The result (h, w, 2) grey + alpha or (h, w, 4) RGB + alpha, uint8, is film − (1 − alpha) · tank,
    limited to 0 … alpha and rounded. Where the limit does not bind, the result laid over the tank
    gives back the film. `film` and `tank` are (h, w) or (h, w, 1 or 3), equally bright; `alpha`
    (h, w).
    """
    shape = (*alpha.shape, film.size // alpha.size)
    return _premultiply_channels(film.reshape(shape), tank.reshape(shape), alpha)


@kernel
def _premultiply_channels(film, tank, alpha):  # type: ignore[no-untyped-def]
    """Return the premultiplied cut-out (h, w, k + 1) of pictures (h, w, k) and alpha (h, w)."""
    height, width, channels = film.shape
    result = np.empty((height, width, channels + 1), np.uint8)
    for y in range(height):
        for x in range(width):
            opaque = np.float32(alpha[y, x])
            through = 1 - opaque / np.float32(255)
            for k in range(channels):
                of_fish = np.float32(film[y, x, k]) - through * np.float32(tank[y, x, k])
                result[y, x, k] = int(min(max(of_fish + np.float32(0.5), np.float32(0)), opaque))
    result[..., channels] = alpha
    return result
