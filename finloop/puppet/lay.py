"""Kernels that lay a strip of film along another backbone, and compare the pictures (Eq. 5)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_kernel, finite_leaf
from finloop.base.sampling import keys_cubic_weights
from finloop.puppet.strip import (
    HIDDEN,
    LEAST,
    PlacedBackbone,
    Strip,
    cross_sections,
    squeeze_offset,
    unsqueeze_offset,
)

_RIM = 1.5  # px that a soft edge reaches beyond the last pixel with alpha
_SEAM = 1e-9  # px by which steps overlap, so that rounding leaves no hole
_STRIDE = 2.0  # px between the places where alpha is sampled
_UNIT, _ONE, _ZERO = np.float32(1 / 255), np.float32(1), np.float32(0)


class DrawingMode(NamedTuple):
    """How a film's picture is drawn in another pose.

    across: px of film per px of the new picture; mirrored: whether left is drawn as right; sharp:
    Keys' cubic filter, else a linear one.
    """

    across: float
    mirrored: bool
    sharp: bool


class StripLayout(NamedTuple):
    """Which strip of a film's picture is drawn where in a new picture.

    film_strip, new_strip: strips along the backbone in the film and in the new picture, of m
    cross-sections;
    reach: (m - 1, 2) px beside each step of the new one, left and right, 0 where nothing is
    visible. box: rows and columns of the new picture that the animal may cover, half open: top,
    left, bottom, right.
    """

    film_strip: Strip
    new_strip: Strip
    reach: Floats
    box: tuple[int, int, int, int]


@finite_kernel
def plan_strips(
    film: NDArray[np.float32], source: PlacedBackbone, target: PlacedBackbone, mode: DrawingMode
) -> StripLayout:
    """Plan how to draw a film's picture along another backbone: from where, to where, how wide.

    film: (h, w, c) 0 … 255, alpha last; source, target: the backbone in it and in the new picture.
    """
    film_strip, new_strip = cross_sections(source), cross_sections(target)
    reach = _visible_reach(film, film_strip) / mode.across
    low_x = low_y = HIDDEN
    high_x = high_y = -HIDDEN
    for i in range(len(reach)):
        if (
            min(_shortest_section(new_strip.limits, i), _shortest_section(film_strip.limits, i))
            <= 2 * LEAST
        ):
            reach[i, 0] = reach[i, 1] = 0
            continue
        if mode.mirrored:
            reach[i, 0], reach[i, 1] = reach[i, 1], reach[i, 0]
        for side in range(2):
            longest = max(new_strip.limits[i, side], new_strip.limits[i + 1, side])
            reach[i, side] = min(reach[i, side], longest)
            sign = 1 - 2 * side
            for k in range(i, i + 2):
                x = new_strip.points[k, 0] + sign * reach[i, side] * new_strip.normals[k, 0]
                y = new_strip.points[k, 1] + sign * reach[i, side] * new_strip.normals[k, 1]
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
    if low_x > high_x:
        return StripLayout(film_strip, new_strip, reach, (0, 0, 0, 0))
    box = math.floor(low_y), math.floor(low_x), math.ceil(high_y) + 1, math.ceil(high_x) + 1
    return StripLayout(film_strip, new_strip, reach, box)


@finite_leaf
def _shortest_section(limits, i):  # type: ignore[no-untyped-def]
    """Return the shorter length of the two cross-sections that bound step i of a backbone."""
    return min(limits[i, 0], limits[i, 1], limits[i + 1, 0], limits[i + 1, 1])


@finite_kernel
def paint_strips(
    canvas: NDArray[np.float32], film: NDArray[np.float32], layout: StripLayout, mode: DrawingMode,
    corner: tuple[int, int],
) -> None:  # fmt: skip
    """Draw a film's picture into a canvas along another backbone, by a plan of `plan_strips`.

    canvas: (H, W, c), zero, becomes 0 … 1; film: (h, w, c) 0 … 255; both premultiplied, alpha last.
    corner: row and column of the canvas's first pixel. Where two parts of the body meet, the one
    with more alpha is visible.
    """
    for i in range(len(layout.reach)):
        if layout.reach[i, 0] + layout.reach[i, 1] > 0:
            _paint_step(
                canvas,
                film,
                (layout.film_strip, layout.new_strip),
                (i, layout.reach[i, 0], layout.reach[i, 1]),
                mode,
                corner,
            )


@finite_kernel
def _visible_reach(film, strip):  # type: ignore[no-untyped-def]
    """Return how far [px] the animal is visible beside each step of its backbone, (m - 1, 2).

    film: (h, w, c), alpha last; strip: the cross-sections along the backbone.
    """
    height, width, channels = film.shape
    m = len(strip.points)
    rays = np.empty((m, 2))
    for i in range(m):
        x, y = strip.points[i]
        for side in range(2):
            sign, limit = 1 - 2 * side, strip.limits[i, side]
            nx, ny = sign * strip.normals[i, 0], sign * strip.normals[i, 1]
            offset = min(limit, height + width)  # at most to the picture's edges
            if abs(nx) > _ONE / 1024:
                offset = min(offset, max((width - 1 - x) / nx, -x / nx))
            if abs(ny) > _ONE / 1024:
                offset = min(offset, max((height - 1 - y) / ny, -y / ny))
            while offset > 0:
                column, row = int(x + offset * nx + 0.5), int(y + offset * ny + 0.5)
                if (
                    0 <= column < width
                    and 0 <= row < height
                    and film[row, column, channels - 1] > 0
                ):
                    break
                offset -= _STRIDE
            offset = max(offset, 0.0) + _STRIDE + _RIM
            rays[i, side] = unsqueeze_offset(offset, limit) if offset < limit else 2 * limit
    reach = np.empty((m - 1, 2))
    for i in range(m - 1):
        for side in range(2):
            reach[i, side] = rays[i, side]
            for k in range(max(i - 1, 0), min(i + 3, m)):
                reach[i, side] = max(reach[i, side], rays[k, side])
    return reach


@finite_leaf
def _section_numbers(strip, i):  # type: ignore[no-untyped-def]
    """Return cross-section i of a strip: point, unit normal, and lengths to the left and right."""
    return (
        (strip.points[i, 0], strip.points[i, 1]),
        (strip.normals[i, 0], strip.normals[i, 1]),
        (strip.limits[i, 0], strip.limits[i, 1]),
    )


@finite_leaf
def _row_span(y, front, rear):  # type: ignore[no-untyped-def]
    """Return from where to where, in x, a row of pixels lies between two cross-sections.

    y: the row; front, rear: the cross-sections that bound a step, each as point, normal, lengths.
    Bounds are ±HIDDEN where a section is parallel to the row.
    """
    (fx, fy), (fnx, fny), _ = front
    (rx, ry), (rnx, rny), _ = rear
    start, stop = -HIDDEN, HIDDEN
    if abs(fny) > 1e-9:
        x_of_section = fx + (y - fy) * fnx / fny
        start, stop = (x_of_section, stop) if fny > 0 else (start, x_of_section)
    if abs(rny) > 1e-9:
        x_of_section = rx + (y - ry) * rnx / rny
        start, stop = (
            (start, min(stop, x_of_section)) if rny > 0 else (max(start, x_of_section), stop)
        )
    return start - 1e-3, stop + 1e-3


@finite_leaf
def _paint_step(canvas, film, strips, part, mode, corner):  # type: ignore[no-untyped-def]
    """Draw the part of the animal along one step of its backbone into the canvas.

    strips: in the film and in the new picture; part: number of the step, its reach [px] to the left
    and to the right; corner: row and column of the canvas's first pixel.
    """
    height, width, channels = canvas.shape
    (film_strip, new_strip), (i, left, right) = strips, part
    front, rear = _section_numbers(new_strip, i), _section_numbers(new_strip, i + 1)
    (fx, fy), (fnx, fny), _ = front
    (rx, ry), (rnx, rny), _ = rear
    film_front, film_rear = _section_numbers(film_strip, i), _section_numbers(film_strip, i + 1)
    xs = (fx + left * fnx, fx - right * fnx, rx + left * rnx, rx - right * rnx)
    ys = (fy + left * fny, fy - right * fny, ry + left * rny, ry - right * rny)
    top, left_px = corner
    low, high = max(min(xs), left_px), min(max(xs), left_px + width - 1.0)
    first, last = max(min(ys), top), min(max(ys), top + height - 1.0)
    for y in range(math.ceil(first), math.floor(last) + 1):
        start, stop = _row_span(y, front, rear)
        for x in range(math.ceil(max(start, low)), math.floor(min(stop, high)) + 1):
            before = (x - fx) * fny - (y - fy) * fnx
            after = (rx - x) * rny - (ry - y) * rnx
            if min(before, after) < -_SEAM or before + after < _SEAM:
                continue
            share = before / (before + after)
            t, along = _strip_place(x, y, front, rear, share)
            place = t * mode.across, along * mode.across, share
            u, v = _film_place(place, film_front, film_rear, mode.mirrored)
            if u >= HIDDEN:
                continue
            red, green, blue, alpha = (
                _sample_cubically(film, u, v) if mode.sharp else _sample_linearly(film, u, v)
            )
            pixel = canvas[y - top, x - left_px]
            if alpha > pixel[channels - 1]:
                pixel[0] = red
                if channels == 4:
                    pixel[1] = green
                    pixel[2] = blue
                pixel[channels - 1] = alpha


@finite_kernel
def _strip_place(x, y, front, rear, share):  # type: ignore[no-untyped-def]
    """Return how far a pixel (x, y) lies beside the backbone and along it, in px, + = left.

    Along counts from the cross-section at `share` (0-1) between `front` and `rear`.
    """
    (fx, fy), (fnx, fny), (fleft, fright) = front
    (rx, ry), (rnx, rny), (rleft, rright) = rear
    nx, ny = fnx + share * (rnx - fnx), fny + share * (rny - fny)
    dx, dy = x - fx - share * (rx - fx), y - fy - share * (ry - fy)
    norm = 1 / (nx * nx + ny * ny)
    o, along = (dx * nx + dy * ny) * norm, (dx * ny - dy * nx) * norm
    if o >= 0:
        return unsqueeze_offset(o, fleft + share * (rleft - fleft)), along
    return -unsqueeze_offset(-o, fright + share * (rright - fright)), along


@finite_leaf
def _film_place(place, front, rear, mirrored):  # type: ignore[no-untyped-def]
    """Return the place (u, v) [px] in the film that a place beside the backbone shows.

    This undoes `_strip_place`. place: how far beside the backbone (+ = left) and along it, px of
    the film, and the share from the section `front` to `rear`; mirrored: whether left and right are
    exchanged. (HIDDEN, HIDDEN) where the film's pose does not show it.
    """
    (fx, fy), (fnx, fny), (fleft, fright) = front
    (rx, ry), (rnx, rny), (rleft, rright) = rear
    unbent, along, share = place
    if mirrored:
        unbent = -unbent
    if unbent >= 0:
        offset = squeeze_offset(unbent, fleft + share * (rleft - fleft))
    else:
        offset = -squeeze_offset(-unbent, fright + share * (rright - fright))
    if abs(offset) >= HIDDEN:
        return HIDDEN, HIDDEN
    nx, ny = fnx + share * (rnx - fnx), fny + share * (rny - fny)
    u = fx + share * (rx - fx) + offset * nx + along * ny
    v = fy + share * (ry - fy) + offset * ny - along * nx
    return u, v


@finite_leaf
def _sample_linearly(film, u, v):  # type: ignore[no-untyped-def]
    """Return red (or grey), green, blue, alpha, 0 … 1, at u, v px of a film, 0 … 255, linearly."""
    column, row = math.floor(u), math.floor(v)
    du, dv = np.float32(u - column), np.float32(v - row)
    red, green, blue, alpha = _sum_pixels(film, column, row, (_ONE - du, du), (_ONE - dv, dv))
    return red * _UNIT, green * _UNIT, blue * _UNIT, alpha * _UNIT


@finite_leaf
def _sample_cubically(film, u, v):  # type: ignore[no-untyped-def]
    """Return red (or grey), green, blue, alpha, 0 … 1, at u, v px of a film, by Keys' filter."""
    column, row = math.floor(u), math.floor(v)
    across, down = keys_cubic_weights(u - column), keys_cubic_weights(v - row)
    red, green, blue, alpha = _sum_pixels(film, column - 1, row - 1, across, down)
    # Where alpha overshoots, the colour is scaled with it: no fringe.
    share = min(_UNIT, _ONE / max(alpha, _ONE))
    alpha = max(alpha, _ZERO) * share
    return (
        min(max(red * share, _ZERO), alpha),
        min(max(green * share, _ZERO), alpha),
        min(max(blue * share, _ZERO), alpha),
        alpha,
    )


@finite_leaf
def _sum_pixels(film, left, top, across, down):  # type: ignore[no-untyped-def]
    """Return the weighted mean of some pixels in a square: red (or grey), green, blue, alpha.

    left, top: column and row of its first pixel; across, down: weights of columns and rows. Outside
    its borders the film is transparent. Loops are written out for each number of channels: speed.
    """
    height, width, channels = film.shape
    red = green = blue = alpha = _ZERO
    taps = len(across)
    inside = left >= 0 and top >= 0 and left + taps <= width and top + taps <= height
    for j in range(taps):
        y = top + j
        r = g = b = a = _ZERO
        if inside and channels == 4:
            for i in range(taps):
                r += across[i] * film[y, left + i, 0]
                g += across[i] * film[y, left + i, 1]
                b += across[i] * film[y, left + i, 2]
                a += across[i] * film[y, left + i, 3]
        elif inside:
            for i in range(taps):
                r += across[i] * film[y, left + i, 0]
                a += across[i] * film[y, left + i, 1]
        elif 0 <= y < height:
            for i in range(max(-left, 0), min(taps, width - left)):
                r += across[i] * film[y, left + i, 0]
                a += across[i] * film[y, left + i, channels - 1]
                if channels == 4:
                    g += across[i] * film[y, left + i, 1]
                    b += across[i] * film[y, left + i, 2]
        red += down[j] * r
        green += down[j] * g
        blue += down[j] * b
        alpha += down[j] * a
    return red, green, blue, alpha


# --- Eq. 5 for pairs of pictures, the second drawn in the pose of the first


class PictureSet(NamedTuple):
    """Pictures (n, s, s, c), premultiplied, 0 … 255, and their postures (n, d), headed right.

    Mass centres are in the middle; size_px: typical length of the animals in them.
    """

    pictures: NDArray[np.uint8]
    postures: Floats
    size_px: float


@finite_kernel
def distances_in_pose(film: PictureSet, rows: Ints, others: Ints, mirrored: Mask) -> Floats:
    """Return how different pairs of pictures look when both are drawn in one pose (k,) (Eq. 5).

    rows, others: (k,) each, the pictures of a pair. The distance is Euclidean, of pixels 0 … 1. The
    others are drawn in the postures of `rows`, mirrored (k,) or not. If a picture is nearer as
    filmed, that distance counts.
    """
    distances = np.empty(len(rows))
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    for k in range(len(rows)):
        pair = rows[k], others[k], mirrored[k]
        distances[k] = _distance_in_pose(film, pair, canvas)
    return distances


@finite_kernel
def nearest_in_pose(
    film: PictureSet, rows: Ints, pairs: tuple[Ints, Mask, Floats], unit: float, count: int
) -> Floats:
    """Measure how unlike pairs of pictures look in one pose, for each row's best pairs only.

    Return distances (k,) (Eq. 5), −1 for pairs that cannot be among the `count` cheapest of their
    row. A pair costs its least cost plus the square of (distance / unit). rows: (k,), the first
    pictures, ascending. pairs: the second pictures, whether they are mirrored, and the least costs,
    ascending within each row; (k,) each.
    """
    partner, mirrored, least_cost = pairs
    distances = np.full(len(rows), -1.0)
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    best = np.empty(count)
    filled = 0
    for k in range(len(rows)):
        if k == 0 or rows[k] != rows[k - 1]:
            filled = 0
        if filled == count and least_cost[k] > best[-1]:
            continue
        pair = rows[k], partner[k], mirrored[k]
        distances[k] = _distance_in_pose(film, pair, canvas)
        cost = least_cost[k] + (distances[k] / unit) ** 2
        if filled == count and cost >= best[-1]:
            continue
        filled = min(filled + 1, count)
        place = filled - 1  # where the cost belongs among the ascending best ones
        while place > 0 and best[place - 1] > cost:
            best[place] = best[place - 1]
            place -= 1
        best[place] = cost
    return distances


@finite_kernel
def _distance_in_pose(film, pair, canvas):  # type: ignore[no-untyped-def]
    """Return the Euclidean distance of two pictures, the second in the pose of the first (Eq. 5).

    film: `PictureSet`; pair: numbers of the two pictures in it, and whether the second is mirrored;
    canvas: (s, s, c), overwritten. If the second is nearer as filmed (mirrored, if so), that
    distance counts.
    """
    pictures, postures, size_px = film
    row, other, mirrored = pair
    side, channels = pictures.shape[1], pictures.shape[3]
    middle, unit = (side - 1) / 2, np.float32(1 / 255)
    target_backbone = PlacedBackbone(middle, middle, 0.0, size_px, postures[row])
    other_backbone = PlacedBackbone(middle, middle, 0.0, size_px, postures[other])
    picture, partner = pictures[row], pictures[other].astype(np.float32)
    mode = DrawingMode(1.0, mirrored, False)  # in the film's scale, sampled linearly
    canvas[:] = 0
    # No literals: numba would compile all kernels of `paint_strips` again for them.
    corner = np.int64(0), np.int64(0)
    layout = plan_strips(partner, other_backbone, target_backbone, mode)
    paint_strips(canvas, partner, layout, mode, corner)
    posed = as_filmed = 0.0
    for y in range(side):
        from_y = side - 1 - y if mirrored else y  # animals head right
        for x in range(side):
            for c in range(channels):
                target = picture[y, x, c] * unit
                posed += (canvas[y, x, c] - target) ** 2
                as_filmed += (partner[from_y, x, c] * unit - target) ** 2
    return math.sqrt(min(posed, as_filmed))
