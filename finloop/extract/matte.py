"""The alpha of a cut-out: a soft edge without the tank's colour, in one piece.

At its outline a pixel is a blend of fish and tank. Its alpha is its difference from the tank as a
share of the difference a little farther inside. Skin has marks and floors have shadows, so alpha is
also bounded by its distance from the outline: a sharp edge, blurred as the film blurs it, passes
through every value within a few pixels. Where an animal is too thin to have an inside, the contrast
of the whole animal takes its place.

Around the fish the film shows more: a soft shadow, what its codec or a lens adds to an edge. This
residue belongs to the cut-out too, as faint black or white, so a fish drawn on its own empty tank
gives the film's pixels back. On any other ground it would be a smudge: `drop_residue`.
"""

from functools import lru_cache
from math import sqrt

import cv2
import numpy as np
import scipy.special
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.kernel import finite_kernel, kernel
from finloop.extract.masks import find_pieces, find_spans, measure_distance

# Chosen on drawn carp, whose alpha is known, and on the mouse, whose tail has no deep pixels.
_DEEP = 2.8  # px from the outline, from which a pixel shows fish alone; of small fish less:
_HALF = 0.5  # share of the largest distance
_WINDOW = 9  # px, side of the square in which such pixels are averaged
_OUTSIDE = 0.5  # px by which the outline of a silhouette lies outside the middle of the edge
_UNSURE = 0.4  # px by which that can differ
# Widths of an edge [px] that the smoothed difference image and its slope add, as a variance [px²].
_ADDED = 1.05
_WIDTH_PER_SD = sqrt(2 * np.pi)  # contrast over the steepest slope of a Gaussian edge
_STEPS, _REACH = 8, 8  # bounds per px of distance, px from the outline that they reach
_VISIBLE = 26  # alpha of a tenth: a part of less is hardly seen
_BLOCK_PX = 8  # least width of a residue: a block of most codecs
_SHADOW_BL = 0.15  # of the animal's length: how far its shadow may reach
_FADE = 0.375  # share of its width over which a residue fades out
_POWER_PX = 5  # side of the square in which the power of a difference is measured
_MOSTLY_GRAIN = 0.5  # share of the power from which a difference counts as grain alone
_FAR_PX = 3  # from the cut-out; what differs there as an animal does is another one
_AS_FISH = (
    0.5  # share of the animal's own difference from the tank from which it does; a shadow less
)
_FEWEST = 50  # pixels of the tank that tell the light beside a fish
_BRIDGE = 5  # px, side of the closing that bridges gaps of up to four pixels


def soft_edge(
    silhouette: Mask, field: Picture, film: Picture, tank: Picture,
    contrast: float, threshold: float, edge_px: float,
) -> Picture:  # fmt: skip
    """Return the alpha (h, w) uint8 of a silhouette, with an edge as soft as the film's.

    silhouette: (h, w); field: (h, w), the difference image; film, tank: (h, w[, 3]), equally
    bright; contrast, threshold: of the animal and of the film, grey levels; edge_px: how wide
    outlines are in this film (`samples.measure_edge_width`).
    """
    shape = (*silhouette.shape, film.size // silhouette.size)
    film, tank = (np.array(picture).reshape(shape) for picture in (film, tank))
    bounds = _edge_bounds(round(edge_px, 2))
    return _blend_edge(silhouette.view(np.uint8), field, film, tank, bounds, (contrast, threshold))


@lru_cache(maxsize=8)
def _edge_bounds(edge_px: float) -> Floats:
    """Return the least and the largest alpha (2, n) by distance from the outline of a silhouette.

    edge_px: width of the edge in the smoothed difference image. The n distances are from −8 px,
    outside, to 8 px, inside, in steps of an eighth.
    """
    spread = sqrt(max((edge_px / _WIDTH_PER_SD) ** 2 - _ADDED, 0.25**2))
    distance = np.arange(2 * _STEPS * _REACH) / _STEPS - _REACH - _OUTSIDE
    return scipy.special.ndtr((distance + np.array([[-_UNSURE], [_UNSURE]])) / spread)


@kernel
def _blend_edge(body, field, film, tank, bounds, levels):  # type: ignore[no-untyped-def]
    """Return a fish's alpha (h, w) uint8: its difference from the tank as a share of a fish's.

    body: the silhouette, 0 or 1; field: difference image, used where the fish is too thin to have
    an inside; film, tank: (h, w, k); bounds: from `_edge_bounds`; levels: contrast and threshold.
    """
    (height, width, channels), (contrast, threshold) = film.shape, levels
    reach = _REACH  # px from the outline within which alpha is not 0
    while reach and bounds[1, _STEPS * (_REACH - reach) + _STEPS // 2] < 0.01:
        reach -= 1
    first, stop = find_spans(body, reach + 1)
    inside = measure_distance(body, 0, first, stop)
    outside = measure_distance(body, 1, first, stop)
    sums = _sum_deep_pixels(film, tank, inside)
    count = sums[channels]
    alpha = np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(first[y], stop[y]):
            distance = inside[y, x] - 0.5 if body[y, x] else 0.5 - outside[y, x]
            step = int(_STEPS * (distance + _REACH) + 0.5)
            step = min(max(step, 0), bounds.shape[1] - 1)
            least, most = bounds[0, step], bounds[1, step]
            if most < 0.01:
                continue
            share = 1.0
            if count[y, x] == 0:  # too thin to have an inside
                share = min(field[y, x] / contrast, most)
            elif least < 0.99:
                along, squared = 0.0, 0.0
                for k in range(channels):
                    fish = np.float32(sums[k, y, x]) / np.float32(count[y, x])
                    change = np.float32(film[y, x, k]) - np.float32(tank[y, x, k])
                    along += change * fish
                    squared += fish * fish
                share = min(max(along / max(squared, threshold * threshold), least), most)
            alpha[y, x] = int(255 * min(share, 1.0) + 0.5)
    return alpha


@kernel
def _sum_deep_pixels(film, tank, inside):  # type: ignore[no-untyped-def]
    """Return the sums of film less tank over the deep pixels around each pixel, and their counts.

    film, tank: (h, w, k). Deep pixels lie far from the outline: `inside` (h, w), px. The sums, and
    after them the counts, are (k + 1, h, w), over a square of `_WINDOW` px that is mirrored at the
    edges of the picture. All fit into 16 bits, so many are added at a time.
    """
    height, width, channels = film.shape
    least = np.float32(min(_DEEP, _HALF * np.float64(inside.max())))
    half = _WINDOW // 2
    # All rows one after the other: one long loop is faster than many short ones.
    wide = width + 2 * half
    layer = np.empty((height + 2 * half) * wide, np.int16)
    size = height * wide
    column, total = np.empty(size, np.int16), np.empty(size - 2 * half, np.int16)
    sums = np.empty((channels + 1, height, width), np.int16)
    for k in range(channels + 1):
        for v in range(height + 2 * half):
            y = _mirror(v - half, height)
            row = layer[v * wide : (v + 1) * wide]
            for x in range(width):
                deep = np.int16(inside[y, x] >= least)
                if k < channels:
                    deep *= np.int16(np.int16(film[y, x, k]) - np.int16(tank[y, x, k]))
                row[half + x] = deep
            for x in range(half):
                row[x] = row[half + _mirror(x - half, width)]
                row[half + width + x] = row[half + _mirror(width + x, width)]
        column[:] = 0
        for shift in range(_WINDOW):
            _add_to(column, layer[shift * wide : shift * wide + size])
        total[:] = 0
        for shift in range(_WINDOW):
            _add_to(total, column[shift : shift + total.size])
        for y in range(height):
            sums[k, y] = total[y * wide : y * wide + width]
    return sums


@kernel
def _add_to(sums, numbers):  # type: ignore[no-untyped-def]
    """Add numbers (n,) of 16 bits to sums (n,)."""
    for i in range(sums.size):
        sums[i] = np.int16(sums[i] + numbers[i])


@kernel
def _mirror(index, size):  # type: ignore[no-untyped-def]
    """Return an index 0 … size − 1 for one beyond the edge, mirrored at the outermost pixel."""
    while (index < 0 or index >= size) and size > 1:
        index = -index if index < 0 else 2 * (size - 1) - index
    return index if size > 1 else 0


def one_piece(alpha: Picture, silhouette: Mask, corner: tuple[int, int]) -> Picture:
    """Return an alpha (h, w) uint8 of one connected piece; crumbs are left out.

    A gap of up to four pixels that parts a tail or fin is bridged: there alpha is that of the paler
    side. Any other pixel is at most as opaque as the way from the silhouette to it, so at every
    opacity that the whole silhouette exceeds, the animal is one piece. silhouette: a mask whose
    first pixel is at `corner`, x and y of alpha.
    """
    if len(find_pieces(alpha, _VISIBLE)) > 1:
        alpha = _bridge_gaps(alpha)
    return _connect(alpha, silhouette, corner)


def _bridge_gaps(alpha: Picture) -> Picture:
    """Return alpha (h, w), closed in the gaps before its detached visible pieces."""
    visible = cv2.threshold(alpha, _VISIBLE - 1, 1, cv2.THRESH_BINARY)[1]
    _, piece, stats, _ = cv2.connectedComponentsWithStats(visible)
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    detached = ((piece > 0) & (piece != largest)).astype(np.uint8)
    # Only the surroundings of these pieces change; pixels up to 2 × _BRIDGE away decide how.
    left, top, width, height = cv2.boundingRect(detached)
    rows = slice(max(0, top - 2 * _BRIDGE), top + height + 2 * _BRIDGE)
    columns = slice(max(0, left - 2 * _BRIDGE), left + width + 2 * _BRIDGE)
    part = np.ascontiguousarray(alpha[rows, columns])
    main = (piece[rows, columns] == largest).astype(np.uint8)
    square = np.ones((2 * _BRIDGE - 1, 2 * _BRIDGE - 1), np.uint8)
    near = cv2.dilate(detached[rows, columns], square) & cv2.dilate(main, square)
    closed = cv2.morphologyEx(part, cv2.MORPH_CLOSE, np.ones((_BRIDGE, _BRIDGE), np.uint8))
    bridged = alpha.copy()
    bridged[rows, columns] = np.where(near > 0, closed, part)
    return bridged


def residue_width(length_px: float) -> int:
    """Return how far [px] the residue around an animal of a length [px] reaches."""
    return max(_BLOCK_PX, round(_SHADOW_BL * length_px))


def cut_with_residue(
    alpha: Picture, film: Picture | NDArray[np.float32], tank: Picture, gains: Floats,
    grain_grey: float, width_px: int = _BLOCK_PX,
) -> Picture:  # fmt: skip
    """Return a fish cut out of a frame, in even light, with the faint residue around it.

    alpha: (h, w), with a rim of the tank; film: (h, w[, k]), as filmed; tank: (h, w[, k]), empty,
    in even light; gains: (k,), of the light of the frame; grain_grey: SD of film less tank where no
    animal is; width_px: of the rim (`residue_width`). The result (h, w, k + 1) uint8 is
    premultiplied, alpha last.

    The light is that beside the fish, which can differ a little from that of the whole frame. On
    its own still tank the result gives the film back, grain included, where the fish is and where
    film and tank differ by more than grain. There alpha is at least 1. What is added around the
    fish has the least alpha that shows the difference, black or white, and less than a tenth.
    """
    shape = (*alpha.shape, len(gains))
    film, tank = (np.ascontiguousarray(picture).reshape(shape) for picture in (film, tank))
    distance = cv2.distanceTransform((alpha == 0).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_3)
    is_near = (distance <= width_px / 2).view(np.uint8)  # a shadow there tells no light
    change, squared, opacity = _measure_change(is_near, film, tank, gains, grain_grey)
    power = cv2.blur(squared, (_POWER_PX, _POWER_PX))
    is_strong = squared > 16 * grain_grey**2  # on a black or white tank, grain alone is opaque
    fish = opacity[alpha == 255]
    like_fish = max(_AS_FISH * float(fish.mean()), _VISIBLE) if len(fish) else _VISIBLE
    other = (is_strong & (opacity >= like_fish) & (distance > _FAR_PX)).view(np.uint8)
    if cv2.countNonZero(other):
        other = cv2.dilate(other, np.ones((2 * _FAR_PX + 1,) * 2, np.uint8))
    fade = np.clip((width_px + 1 - distance) / (_FADE * width_px), 0, 1)
    return _keep_residue(alpha, tank, change, power, opacity, other, fade, grain_grey)


def drop_residue(pixels: Picture) -> Picture:
    """Return a cut-out (h, w, k + 1) uint8 without its residue, for another ground than its tank.

    Of what is hardly seen (alpha below a tenth) only the outermost pixel of the edge remains.
    pixels: premultiplied, alpha last.
    """
    visible = cv2.threshold(pixels[..., -1], _VISIBLE - 1, 1, cv2.THRESH_BINARY)[1]
    return np.asarray(pixels * cv2.dilate(visible, np.ones((3, 3), np.uint8))[..., None])


# These kernels go through a row once for each channel: grey pixels are then worked on in parallel.
@finite_kernel
def _correction_beside(is_near, film, tank, light, grain_grey):  # type: ignore[no-untyped-def]
    """Return by what to multiply the film, so that it is as bright as the tank: (k,) float32.

    It is measured away from the fish; `light`, if fewer than _FEWEST pixels show the tank.
    is_near, film, tank, grain_grey: as in `_measure_change`; light (k,): a first estimate, by which
    pixels count as the tank.
    """
    height, width, channels = film.shape
    limit = np.float32(2 * grain_grey)
    count, of_tank, of_film = 0, np.zeros(channels), np.zeros(channels)
    most = np.empty(width, np.float32)
    for y in range(height):
        for x in range(width):
            most[x] = np.float32(is_near[y, x]) * np.float32(256)
        for k in range(channels):
            gain = light[k]
            for x in range(width):
                empty, level = np.float32(tank[y, x, k]), np.float32(film[y, x, k]) * gain
                most[x] = max(most[x], abs(level - empty))
                # Of levels that are cut off at black or white, the mean tells no light.
                is_cut_off = (empty <= 2 * limit) | (empty >= np.float32(255) - 2 * limit)
                most[x] = max(most[x], np.float32(is_cut_off) * np.float32(256))
        for x in range(width):
            count += most[x] <= limit
        for k in range(channels):
            tank_sum, film_sum = np.float32(0), np.float32(0)
            for x in range(width):
                beside = np.float32(most[x] <= limit)
                tank_sum += beside * np.float32(tank[y, x, k])
                film_sum += beside * np.float32(film[y, x, k])
            of_tank[k] += tank_sum
            of_film[k] += film_sum
    if count < _FEWEST:
        return light
    return (of_tank / np.maximum(of_film, 1.0)).astype(np.float32)


@finite_kernel
def _measure_change(is_near, film, tank, gains, grain_grey):  # type: ignore[no-untyped-def]
    """Return how each pixel of the film differs from the tank, in the light beside the fish.

    Also its mean square over the channels, and the least alpha that shows it.

    is_near (h, w): not 0 at the fish; film, tank: (h, w, k); gains: (k,); grain_grey: standard
    deviation of the film's noise. The change is (h, w, k), its mean square (h, w), and the alpha
    (h, w), which is 255 or more where nothing of the tank is seen: all float32.
    """
    height, width, channels = film.shape
    light = (1 / gains).astype(np.float32)
    for _ in range(2):  # the first time, the choice of pixels leans to the light of the whole frame
        light = _correction_beside(is_near, film, tank, light, grain_grey)
    change = np.empty(film.shape, np.float32)
    squared, opacity = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    for y in range(height):
        for k in range(channels):
            gain = light[k]
            for x in range(width):
                level = np.float32(tank[y, x, k])
                difference = np.float32(film[y, x, k]) * gain - level
                room = max(level if difference < 0 else np.float32(255) - level, np.float32(1))
                change[y, x, k] = difference
                squared[y, x] += difference * difference / np.float32(channels)
                opacity[y, x] = max(opacity[y, x], np.float32(255) * abs(difference) / room)
    return change, squared, opacity


@finite_kernel
def _keep_residue(alpha, tank, change, power, opacity, other, fade, grain_grey):  # type: ignore[no-untyped-def]
    """Return a cut-out (h, w, k + 1) uint8, premultiplied: the change that is no grain, over alpha.

    alpha (h, w), tank (h, w, k); change, opacity: from `_measure_change`; power: mean square of the
    change around a pixel; other: not 0 near another animal; fade (h, w): share of the change that
    is kept, 0 … 1; grain_grey: standard deviation of the film's noise, grey levels.
    """
    height, width, channels = change.shape
    result = np.empty((height, width, channels + 1), np.uint8)
    share, opaque = np.empty(width, np.float32), np.empty(width, np.float32)
    of_grain = np.float32(grain_grey**2)
    for y in range(height):
        for x in range(width):
            shown = np.float32(fade[y, x])
            is_grain = of_grain > np.float32(_MOSTLY_GRAIN) * power[y, x]
            if is_grain | ((other[y, x] > 0) & (alpha[y, x] == 0)):
                shown = np.float32(0)
            least = np.float32(shown > 0)
            faint = np.floor(min(shown * opacity[y, x], np.float32(_VISIBLE - 1)) + np.float32(0.5))
            faint = max(faint, least)
            own = np.float32(alpha[y, x])
            share[x], opaque[x] = max(shown, own / np.float32(255)), max(own, faint)
        for k in range(channels):
            for x in range(width):
                through = opaque[x] / np.float32(255) * np.float32(tank[y, x, k])
                of_fish = share[x] * change[y, x, k] + through + np.float32(0.5)
                result[y, x, k] = np.uint8(min(max(of_fish, np.float32(0)), opaque[x]))
        for x in range(width):
            result[y, x, channels] = np.uint8(opaque[x])
    return result


@kernel
def _connect(alpha, silhouette, corner):  # type: ignore[no-untyped-def]
    """Return alpha (h, w) limited to how opaque the best way from the silhouette to a pixel is.

    silhouette: a mask whose first pixel is at `corner`, x and y of alpha. This is morphological
    reconstruction by dilation; `skimage.morphology.reconstruction` takes fifty times as long.
    """
    height, width = alpha.shape
    (left, top), (rows, columns) = corner, silhouette.shape
    result = np.zeros((height + 2, width + 2), np.uint8)  # with a rim: each pixel has neighbours
    for y in range(rows):
        for x in range(columns):
            if silhouette[y, x]:
                result[top + y + 1, left + x + 1] = alpha[top + y, left + x]
    first, stop = find_spans(alpha, 0)
    passes, changed = 0, True
    while changed or passes < 2:  # a pass down and to the right, then one back, and so on
        turn, changed = 1 - 2 * (passes % 2), False
        for i in range(height):
            y = i if turn == 1 else height - 1 - i
            before, here, limits = result[y + 1 - turn], result[y + 1], alpha[y]
            for j in range(stop[y] - first[y]):
                x = first[y] + j if turn == 1 else stop[y] - 1 - j
                limit = limits[x]
                if here[x + 1] < limit:
                    most = max(before[x], before[x + 1], before[x + 2], here[x + 1 - turn])
                    if min(most, limit) > here[x + 1]:
                        here[x + 1] = min(most, limit)
                        changed = True
        passes += 1
    return result[1:-1, 1:-1].copy()
