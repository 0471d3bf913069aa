"""Draw a strip of film along another backbone, and compare such pictures: compiled kernels (Eq. 5).

A *section* is a cross-section of the animal; a *step* is the part between one section and the next.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_kernel, finite_leaf
from finloop.base.sampling import keys_cubic_weights
from finloop.puppet.strip import (
    BEYOND,
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
_UNIT, _ONE, _ZERO = np.float32(1 / 255), np.float32(1), np.float32(0)  # else numba takes float64

Rgba = tuple[np.float32, np.float32, np.float32, np.float32]
Corner = tuple[int | np.int64, int | np.int64]  # row and column of a pixel


class DrawingMode(NamedTuple):
    """How a film's picture is drawn in another pose: scale, side and filter.

    across: px of film per px of the new picture; mirrored: whether left is drawn as right; sharp:
    Keys' cubic filter, else a linear one.
    """

    across: float
    mirrored: bool
    sharp: bool


class Section(NamedTuple):
    """One cross-section of a body: a point x, y [px] on the backbone, and how far it extends.

    nx, ny: unit vector to the animal's left; left, right: lengths on both sides, px.
    """

    x: float
    y: float
    nx: float
    ny: float
    left: float
    right: float


class StripLayout(NamedTuple):
    """Which strip of a film's picture is drawn where in a new picture.

    film_strip, new_strip: strips along the backbone in the film and in the new picture, of m
    cross-sections. reach: (m - 1, 2) px beside each step of the new one, left and right, 0 where
    nothing is visible. box: rows and columns of the new picture that the animal may cover, half
    open: top, left, bottom, right.
    """

    film_strip: Strip
    new_strip: Strip
    reach: Floats
    box: tuple[int, int, int, int]


@finite_kernel
def plan_strips(
    film: NDArray[np.float32], source: PlacedBackbone, target: PlacedBackbone, mode: DrawingMode
) -> StripLayout:
    """Return how a film's picture is drawn along another backbone: which strip, where, how wide.

    The width of a step is how far the animal is visible there; on the inner side of a sharp bend of
    the new pose it is only as far as there is room.
    film: (h, w, c) 0 … 255, alpha last; source, target: the backbone in it and in the new picture.
    """
    film_strip, new_strip = cross_sections(source), cross_sections(target)
    reach = _visible_reach(film, film_strip) / mode.across
    low_x = low_y = HIDDEN  # bounds of all that is visible
    high_x = high_y = -HIDDEN
    for i in range(len(reach)):
        shortest_new = _shortest_section(new_strip.limits, i)
        shortest_film = _shortest_section(film_strip.limits, i)
        if min(shortest_new, shortest_film) <= 2 * LEAST:  # a section that shows nothing
            reach[i, 0] = reach[i, 1] = 0
            continue
        if mode.mirrored:
            reach[i, 0], reach[i, 1] = reach[i, 1], reach[i, 0]
        for side in range(2):
            longest = max(new_strip.limits[i, side], new_strip.limits[i + 1, side])
            reach[i, side] = min(reach[i, side], longest)
            sign = 1 - 2 * side  # 1 to the left, −1 to the right
            for k in range(i, i + 2):
                x = new_strip.points[k, 0] + sign * reach[i, side] * new_strip.normals[k, 0]
                y = new_strip.points[k, 1] + sign * reach[i, side] * new_strip.normals[k, 1]
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
    box = 0, 0, 0, 0
    if low_x <= high_x:  # something is visible
        box = math.floor(low_y), math.floor(low_x), math.ceil(high_y) + 1, math.ceil(high_x) + 1
    return StripLayout(film_strip, new_strip, reach, box)


@finite_leaf
def _shortest_section(limits: Floats, i: int) -> float:
    """Return the shortest of the lengths [px], left and right, of both sections around step i.

    limits (m, 2): length of each section on its left and right.
    """
    return min(limits[i, 0], limits[i, 1], limits[i + 1, 0], limits[i + 1, 1])


@finite_kernel
def paint_strips(
    canvas: NDArray[np.float32], film: NDArray[np.float32], layout: StripLayout, mode: DrawingMode,
    corner: Corner, along: NDArray[np.float32],
) -> None:  # fmt: skip
    """Draw a film's picture into a canvas along another backbone, by a plan of `plan_strips`.

    canvas: (H, W, c), zero, becomes 0 … 1; film: (h, w, c) 0 … 255; both premultiplied, alpha last.
    layout: the plan; mode: scale, side and filter; corner: row and column of the canvas's first
    pixel. Where two parts of the body meet, the one with more alpha is visible. along: (H, W),
    becomes the place along the backbone that a drawn pixel shows, 0 head … 1 tail; or empty.
    """
    for i in range(len(layout.reach)):
        if layout.reach[i, 0] + layout.reach[i, 1] > 0:
            _paint_step(canvas, film, layout, i, mode, corner, along)


@finite_kernel
def _visible_reach(film: NDArray[np.float32], strip: Strip) -> Floats:
    """Return how far [px] the animal is visible to either side of each backbone step, (m - 1, 2).

    film: (h, w, c), alpha last. From far outside, a ray along each side of a section is followed
    towards the backbone until a pixel has alpha. Its distance is given as if the backbone were
    straight (`unsqueeze_offset`).
    """
    height, width, channels = film.shape
    m = len(strip.points)
    rays = np.empty((m, 2))
    for i in range(m):
        x, y = strip.points[i]
        for side in range(2):
            sign, limit = 1 - 2 * side, strip.limits[i, side]
            nx, ny = sign * strip.normals[i, 0], sign * strip.normals[i, 1]
            # The ray begins at the edge of the picture; one nearly parallel to an edge misses it.
            offset = min(limit, height + width)
            if abs(nx) > _ONE / 1024:
                offset = min(offset, max((width - 1 - x) / nx, -x / nx))
            if abs(ny) > _ONE / 1024:
                offset = min(offset, max((height - 1 - y) / ny, -y / ny))
            while offset > 0:
                column, row = int(x + offset * nx + 0.5), int(y + offset * ny + 0.5)
                in_picture = 0 <= column < width and 0 <= row < height
                if in_picture and film[row, column, channels - 1] > 0:
                    break
                offset -= _STRIDE
            offset = max(offset, 0.0) + _STRIDE + _RIM
            # What is drawn up to `limit` has an unsqueezed offset below 2 `limit`.
            rays[i, side] = unsqueeze_offset(offset, limit) if offset < limit else 2 * limit
    # A step reaches as far as its two sections and the ones next to them.
    reach = np.empty((m - 1, 2))
    for i in range(m - 1):
        for side in range(2):
            reach[i, side] = rays[i, side]
            for k in range(max(i - 1, 0), min(i + 3, m)):
                reach[i, side] = max(reach[i, side], rays[k, side])
    return reach


@finite_leaf
def _section_at(strip: Strip, i: int) -> Section:
    """Return cross-section i of a `Strip` as a `Section`."""
    return Section(
        strip.points[i, 0], strip.points[i, 1], strip.normals[i, 0], strip.normals[i, 1],
        strip.limits[i, 0], strip.limits[i, 1],
    )  # fmt: skip


@finite_leaf
def _row_span(y: int, front: Section, rear: Section) -> tuple[float, float]:
    """Return the lowest and highest x [px] at which row y of pixels is between two sections.

    front, rear: the sections that bound a step, the front one nearer to the head. Bounds are
    ±HIDDEN where a section is parallel to the row.
    """
    # Between the sections, (x − front.x) · front.ny ≥ (y − front.y) · front.nx, and ≤ for the rear:
    # the sign of ny decides whether the row enters or leaves the step where it crosses a section.
    start, stop = -HIDDEN, HIDDEN
    if abs(front.ny) > 1e-9:
        x_of_section = front.x + (y - front.y) * front.nx / front.ny
        start, stop = (x_of_section, stop) if front.ny > 0 else (start, x_of_section)
    if abs(rear.ny) > 1e-9:
        x_of_section = rear.x + (y - rear.y) * rear.nx / rear.ny
        if rear.ny > 0:
            stop = min(stop, x_of_section)
        else:
            start = max(start, x_of_section)
    return start - 1e-3, stop + 1e-3  # rounding leaves no pixel out


@finite_leaf
def _paint_step(
    canvas: NDArray[np.float32], film: NDArray[np.float32], layout: StripLayout, i: int,
    mode: DrawingMode, corner: Corner, along_body: NDArray[np.float32],
) -> None:  # fmt: skip
    """Draw the part of the animal along step i of its backbone into the canvas, in place.

    canvas: (H, W, c), 0 … 1; film: (h, w, c), 0 … 255; both premultiplied, alpha last. corner: row
    and column of the canvas's first pixel in the picture; along_body: `along` of `paint_strips`.
    For each pixel between the step's two sections: its place beside and along the new backbone, the
    place of that in the film, and the film's colour there.
    """
    height, width, channels = canvas.shape
    front, rear = _section_at(layout.new_strip, i), _section_at(layout.new_strip, i + 1)
    film_front, film_rear = _section_at(layout.film_strip, i), _section_at(layout.film_strip, i + 1)
    left, right = layout.reach[i, 0], layout.reach[i, 1]
    # The four corners of the step: left and right of its front and rear.
    corners_x = (
        front.x + left * front.nx, front.x - right * front.nx,
        rear.x + left * rear.nx, rear.x - right * rear.nx,
    )  # fmt: skip
    corners_y = (
        front.y + left * front.ny, front.y - right * front.ny,
        rear.y + left * rear.ny, rear.y - right * rear.ny,
    )  # fmt: skip
    # The rows and columns that they span, as far as the canvas shows them.
    top_px, left_px = corner
    low_x, high_x = max(min(corners_x), left_px), min(max(corners_x), left_px + width - 1.0)
    low_y, high_y = max(min(corners_y), top_px), min(max(corners_y), top_px + height - 1.0)
    for y in range(math.ceil(low_y), math.floor(high_y) + 1):
        start, stop = _row_span(y, front, rear)
        for x in range(math.ceil(max(start, low_x)), math.floor(min(stop, high_x)) + 1):
            # Distances from both sections: the pixel is between them if none is negative.
            from_front = (x - front.x) * front.ny - (y - front.y) * front.nx
            from_rear = (rear.x - x) * rear.ny - (rear.y - y) * rear.nx
            if min(from_front, from_rear) < -_SEAM or from_front + from_rear < _SEAM:
                continue
            share = from_front / (from_front + from_rear)
            beside, along = _strip_place(x, y, front, rear, share)
            beside, along = beside * mode.across, along * mode.across  # in px of the film
            if mode.mirrored:
                beside = -beside
            u, v = _film_place(beside, along, share, film_front, film_rear)
            if u >= HIDDEN:  # the film does not show it
                continue
            red, green, blue, alpha = (
                _sample_cubically(film, u, v) if mode.sharp else _sample_linearly(film, u, v)
            )
            pixel = canvas[y - top_px, x - left_px]
            if alpha > pixel[channels - 1]:  # of two parts of the body the more opaque one
                pixel[0] = red
                if channels == 4:
                    pixel[1] = green
                    pixel[2] = blue
                pixel[channels - 1] = alpha
                if along_body.size:
                    steps = len(layout.reach) - 2 * BEYOND
                    along_body[y - top_px, x - left_px] = (i - BEYOND + share) / steps


@finite_kernel
def _strip_place(
    x: int, y: int, front: Section, rear: Section, share: float
) -> tuple[float, float]:
    """Return a pixel's coordinates [px] on a strip: beside the backbone (+ = left), and along it.

    Along is positive towards the tail, and counts from the section at `share` (0 … 1) between the
    sections `front` and `rear`. Beside is measured as if the backbone were straight
    (`unsqueeze_offset`).
    """
    nx, ny = front.nx + share * (rear.nx - front.nx), front.ny + share * (rear.ny - front.ny)
    dx = x - front.x - share * (rear.x - front.x)
    dy = y - front.y - share * (rear.y - front.y)
    scale = 1 / (nx * nx + ny * ny)  # a mean of two unit vectors is shorter than 1
    offset, along = (dx * nx + dy * ny) * scale, (dx * ny - dy * nx) * scale
    if offset >= 0:
        return unsqueeze_offset(offset, front.left + share * (rear.left - front.left)), along
    return -unsqueeze_offset(-offset, front.right + share * (rear.right - front.right)), along


@finite_leaf
def _film_place(
    beside: float, along: float, share: float, front: Section, rear: Section
) -> tuple[float, float]:
    """Return the film's pixel (u, v) for a place [px] beside and along the backbone.

    This undoes `_strip_place`, with the film's sections `front` and `rear`. (HIDDEN, HIDDEN) where
    the film's pose does not show the place.
    """
    if beside >= 0:
        offset = squeeze_offset(beside, front.left + share * (rear.left - front.left))
    else:
        offset = -squeeze_offset(-beside, front.right + share * (rear.right - front.right))
    if abs(offset) >= HIDDEN:
        return HIDDEN, HIDDEN
    nx, ny = front.nx + share * (rear.nx - front.nx), front.ny + share * (rear.ny - front.ny)
    u = front.x + share * (rear.x - front.x) + offset * nx + along * ny
    v = front.y + share * (rear.y - front.y) + offset * ny - along * nx
    return u, v


@finite_leaf
def _sample_linearly(film: NDArray[np.float32], u: float, v: float) -> Rgba:
    """Return red (or grey), green, blue, alpha, 0 … 1, at u, v px of a film, bilinear."""
    column, row = math.floor(u), math.floor(v)
    du, dv = np.float32(u - column), np.float32(v - row)
    red, green, blue, alpha = _sum_pixels(film, column, row, (_ONE - du, du), (_ONE - dv, dv))
    return red * _UNIT, green * _UNIT, blue * _UNIT, alpha * _UNIT


@finite_leaf
def _sample_cubically(film: NDArray[np.float32], u: float, v: float) -> Rgba:
    """Return red (or grey), green, blue, alpha, 0 … 1, at u, v px of a film, bicubic.

    They are interpolated by Keys' cubic filter.
    """
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
def _sum_pixels(
    film: NDArray[np.float32],
    left: int,
    top: int,
    across: tuple[np.float32, ...],
    down: tuple[np.float32, ...],
) -> Rgba:
    """Return the weighted sum of a square of pixels: red (or grey), green, blue, alpha.

    left, top: its first pixel; across, down: weights of columns and rows. Outside its borders the
    film is transparent. Separate loops for 2 and 4 channels are faster.
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


class CandidatePairs(NamedTuple):
    """Pairs (k,) of pictures that may be similar, sorted by their first one, then by cost.

    first, second: numbers of the pictures; mirrored: whether the second is mirrored.
    """

    first: Ints
    second: Ints
    mirrored: Mask
    least_cost: Floats


class PictureSet(NamedTuple):
    """Pictures (n, s, s, c), premultiplied, 0 … 255, and their postures (n, d), headed right.

    Mass centres are in the middle; size_px: typical length of the animals in them.
    """

    pictures: NDArray[np.uint8]
    postures: Floats
    size_px: float


@finite_kernel
def distances_in_pose(film: PictureSet, rows: Ints, others: Ints, mirrored: Mask) -> Floats:
    """Return how different pairs of pictures look, (k,), when both are drawn in one pose (Eq. 5).

    The distance is Euclidean, of pixels 0 … 1. The others are drawn in the postures of `rows`,
    mirrored (k,) or not. If a picture is nearer as filmed, that distance counts.
    """
    distances = np.empty(len(rows))
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    for k in range(len(rows)):
        distances[k] = _distance_in_pose(film, rows[k], others[k], mirrored[k], canvas)
    return distances


@finite_kernel
def nearest_in_pose(film: PictureSet, pairs: CandidatePairs, unit: float, count: int) -> Floats:
    """Return how different pictures look in one pose, (k,), for the best pairs only; else −1.

    The distance is that of `distances_in_pose`. It is −1 for pairs that cannot be among the `count`
    cheapest of their first picture. A pair costs its least cost plus (distance / unit)².
    """
    distances = np.full(len(pairs.first), -1.0)
    canvas = np.empty(film.pictures.shape[1:], np.float32)
    best = np.empty(count)  # the least costs so far of one first picture, ascending
    filled = 0
    for k in range(len(pairs.first)):
        row = pairs.first[k]
        if k == 0 or row != pairs.first[k - 1]:
            filled = 0
        if filled == count and pairs.least_cost[k] > best[-1]:
            continue
        distances[k] = _distance_in_pose(film, row, pairs.second[k], pairs.mirrored[k], canvas)
        cost = pairs.least_cost[k] + (distances[k] / unit) ** 2
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
def _distance_in_pose(
    film: PictureSet, row: int, other: int, mirrored: bool, canvas: NDArray[np.float32]
) -> float:
    """Return how different two pictures look, the second drawn in the pose of the first (Eq. 5).

    canvas: (s, s, c), overwritten. If the second is nearer as filmed (mirrored, if so), that
    distance counts.
    """
    pictures, postures, size_px = film
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
    paint_strips(canvas, partner, layout, mode, corner, np.empty((0, 0), np.float32))
    posed = as_filmed = 0.0
    for y in range(side):
        from_y = side - 1 - y if mirrored else y  # animals head right
        for x in range(side):
            for c in range(channels):
                target = picture[y, x, c] * unit
                posed += (canvas[y, x, c] - target) ** 2
                as_filmed += (partner[from_y, x, c] * unit - target) ** 2
    return math.sqrt(min(posed, as_filmed))
