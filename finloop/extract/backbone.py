"""Trace the backbone of a fish in its silhouette (fish paper §2.2 and §2.2.1, Figs. 2-4).

Thinning leaves a one-pixel skeleton with side branches (open fins), of which the longest path is
kept. That path stops short of head and tail and lies on whole pixels, so measured lengths are
2.5-3.7 % too small. Therefore it is extended to the outline at both ends, centred between the two
flanks at sub-pixel precision, smoothed and resampled at equal arc lengths.

Glossary: `field` is the difference image of one cut-out (grey levels, the fish is high), s the arc
length along the backbone in [0, 1], a *flank* the point on either side where the field falls to
half of its local height.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.kernel import kernel
from finloop.extract.masks import (
    close_with_disc,
    count_holes,
    find_spans,
    measure_distance,
    thin,
)

_STEP = 0.5  # px, sampling step along flanks and at the ends
_DEPTH = 2.0  # half widths from an end to where its direction is measured
_NOTCH = 0.5  # radius of the disc that closes notches, as a share of the largest half width
_FORK = 3.0  # a pixel this many times nearer to its path's end than to the outline is cut off
_SMOOTHING = 2e-6  # weight of the third-derivative penalty, s in [0, 1]; see smoothing_matrix()
_THICK = 0.5  # share of the largest half width; parts that hold no disc of this radius are thin
# Share of that disc's half width; a thin part that is nowhere so wide is a limb. Measured: tails
# that taper 0.5-0.8; legs, fins on a stalk and a mouse's tail 0.1-0.4.
_TAPER = 0.5
_SLENDER = 0.072  # half width of a fish in body lengths (zebrafish), for which _SMOOTHING holds


class Backbone(NamedTuple):
    """The line from head to tail through the middle of one fish; either end may be the head.

    It is in px of its cut-out, with pixel centres at integers. points_px: (n, 2) float64, columns
    x, y, equally spaced along the arc, outline to outline. half_width_px: (n,) float64, mean
    distance from the backbone to the two sides of the body. length_px: arc length.
    """

    points_px: Floats
    half_width_px: Floats
    length_px: float


def trace_backbone(
    mask: Mask, field: Picture, points: int, floor: float, limbs: bool = False
) -> Backbone | None:
    """Return the backbone of a silhouette; None if its skeleton is too short.

    mask: (h, w), the silhouette. field: (h, w), the difference from the empty tank, from which
    sides and tips are read at sub-pixel precision. points: number of backbone points. floor: grey
    level below which differences are noise. limbs: whether the animal has limbs. They are cut off,
    and the backbone is smoothed more, so that their stumps do not bend it.
    """
    if limbs:
        mask = cut_limbs(mask)[0]
        field = field * cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))  # 0 on the limbs
    whole, filled = close_notches(mask, field)
    half_width = cv2.distanceTransform(whole.view(np.uint8), cv2.DIST_L2, 3)
    path = _find_path(whole, half_width)
    if len(path) < 4:
        return None
    smoothing = _SMOOTHING
    if limbs:
        # A stout body bends less sharply than a slender one, so the shortest wave that passes shall
        # be proportional to the width. The penalty on the squared third derivative of a wave is
        # proportional to 1 / wavelength⁶, so its weight must grow with the width's sixth power.
        length = np.hypot(*np.diff(path, axis=0).T).sum()
        smoothing *= float(half_width.max() / length / _SLENDER) ** 6
    smooth = smoothing_matrix(points, smoothing)
    return Backbone(*_refine_backbone((field, filled), path, smooth, floor))


def cut_limbs(mask: Mask) -> tuple[Mask, int]:
    """Return a silhouette (h, w) without legs, antennae and stalked fins, and how many it has.

    Limbs are legs, antennae, and fins on a stalk. The silhouette is opened with a disc whose radius
    is half the largest half width: the body remains, thin parts vanish. A thin part is a limb if it
    is narrower than half the disc wherever it is more than half a radius away from the body. A tail
    is wider there, because it tapers. A part that joins two pieces of the body is a waist, no limb.
    Rounded corners of the body vanish, too; they are cut off, but are not counted.
    """
    picture = mask.view(np.uint8)
    distance = cv2.distanceTransform(pad_picture(picture, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    half_width = distance - 0.5  # from the middle of a pixel to the edge of the last
    radius = int(_THICK * half_width.max() + 0.5)
    body = morph_with_disc(picture, cv2.MORPH_OPEN, radius)
    # The largest half width of each part, half a radius outside the body; 0 for a rounded corner.
    away_from_body = picture & (1 - cv2.dilate(body, _disc(radius // 2)))
    part_count, part = cv2.connectedComponents(picture & (1 - body))  # 0: the rest of the picture
    widest = np.zeros(part_count)
    np.maximum.at(widest, part, half_width * away_from_body)
    is_limb = widest < _TAPER * (radius + 0.5)
    is_limb[0] = False
    piece = cv2.connectedComponents(body)[1]  # 0: the rest of the picture
    if piece.max() > 1:  # several pieces of body: a thin part may be a waist
        for limb in np.flatnonzero(is_limb):
            touched = piece[cv2.dilate((part == limb).view(np.uint8), _disc(1)) > 0]
            is_limb[limb] = np.unique(touched[touched > 0]).size < 2
    _, rest, stats, _ = cv2.connectedComponentsWithStats(picture * ~is_limb[part])
    largest_rest = rest == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()
    return largest_rest, int((is_limb & (widest > 0)).sum())


def _disc(radius: int) -> Picture:
    """Return a disc as a picture of 0 and 1, 2 · radius + 1 px wide."""
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def close_notches(mask: Mask, field: Picture) -> tuple[Mask, Picture]:
    """Return a silhouette and its difference image with narrow notches filled, such as a dark eye.

    mask, field: (h, w). A notch is skin as bright as the tank, like the black eye of a pale fish,
    and diverts the skeleton. Both pictures are closed (dilated, then eroded) with a disc of half
    the largest half width. If that would enclose a hole, head and tail are near each other, and
    both are returned unchanged.
    """
    closed, filled = _close_notches(mask.view(np.uint8), field)
    return closed.view(bool), filled


@kernel
def _close_notches(mask, field):  # type: ignore[no-untyped-def]
    """Return a silhouette (h, w) uint8 and its difference image with narrow notches filled."""
    first, stop = find_spans(mask, 0)
    widest = measure_distance(mask, 0, first, stop, 0.0).max()
    radius = int(_NOTCH * np.float64(widest) + 0.5)
    closed = close_with_disc(mask, radius)
    if count_holes(closed):
        return mask, field
    filled = close_with_disc(closed * field, radius)  # beside it there may be another fish
    return closed, np.maximum(filled * closed, field)


def morph_with_disc(picture: Picture, operation: int, radius: int) -> Picture:
    """Return a picture (h, w) morphologically opened or closed with a disc.

    operation: cv2.MORPH_OPEN removes bright parts that are narrower than the disc, cv2.MORPH_CLOSE
    fills dark ones.
    """
    (h, w), rim = picture.shape, radius + 1
    morphed = cv2.morphologyEx(pad_picture(picture, rim), operation, _disc(radius))
    return morphed[rim : rim + h, rim : rim + w].copy()


def pad_picture(picture: Picture, rim_px: int) -> Picture:
    """Return a picture (h, w) with a rim of zeros, `rim_px` wide, on all four sides.

    Unlike np.pad it leaves no cycles of references.
    """
    return np.asarray(
        cv2.copyMakeBorder(picture, rim_px, rim_px, rim_px, rim_px, cv2.BORDER_CONSTANT)
    )


@kernel
def find_longest_path(skeleton: Mask, weight: NDArray[np.float32]) -> Floats:
    """Return the longest path (m, 2) x, y along a silhouette's skeleton (§2.2.1, Fig. 4).

    skeleton: (h, w), True on it; an empty one gives no points. weight: (h, w); the length of a step
    is multiplied by the mean weight of its two pixels. A weight of 1 is the paper's rule, by which
    an open fin can be longer than the head. With the distance to the outline as weight, thin fins
    are not chosen.

    Two sweeps: the pixel farthest from any pixel is one end, and the pixel farthest from that end
    is the other. This is exact on a tree, and the skeleton of a silhouette without holes is one. Of
    several separate pieces the one with the most pixels is used.
    """
    height, width = skeleton.shape
    # The pixels of the skeleton get numbers.
    number = np.full((height, width), -1, np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            if skeleton[y, x]:
                number[y, x] = count
                count += 1
    xs, ys = np.empty(count, np.int64), np.empty(count, np.int64)
    for y in range(height):
        for x in range(width):
            if number[y, x] >= 0:
                xs[number[y, x]], ys[number[y, x]] = x, y
    # Find a pixel of the piece with the most pixels. `best_start` begins with a number that no
    # pixel has; for a literal, of another type, `_measure_paths_from` would be compiled again.
    visited = np.zeros(count, np.bool_)
    best_start, best_size = xs.size, 0
    for start in range(count):
        if not visited[start]:
            distance, size = _measure_paths_from(number, xs, ys, weight, start)[0], 0
            for node in range(count):
                if np.isfinite(distance[node]):
                    visited[node] = True
                    size += 1
            if size > best_size:
                best_start, best_size = start, size
    if best_size == 0:
        return np.empty((0, 2))
    # The two sweeps, and the way back from the second end.
    one_end = _farthest_pixel(_measure_paths_from(number, xs, ys, weight, best_start)[0])
    distance, previous = _measure_paths_from(number, xs, ys, weight, one_end)
    node = _farthest_pixel(distance)
    path = np.empty((count, 2))
    length = 0
    while node >= 0:
        path[length, 0], path[length, 1] = xs[node], ys[node]
        node = previous[node]
        length += 1
    return path[:length].copy()


@kernel
def _find_path(mask, half_width):  # type: ignore[no-untyped-def]
    """Return the longest path (k, 2) x, y along a silhouette's skeleton, without its forks."""
    skeleton = thin(mask).view(np.bool_)
    return trim_forks(find_longest_path(skeleton, half_width), half_width)


@kernel
def trim_forks(path: Floats, half_width: NDArray[np.float32]) -> Floats:
    """Return a skeleton's path (m, 2) x, y without its forked ends: (k, 2).

    half_width: (h, w), px from each pixel to the outline. Near a blunt end the skeleton forks into
    the corners of the outline. So pixels are cut off whose half width is more than `_FORK` times
    their distance to the end, in pixels of the path. Nothing is left of a short path.
    """
    width = np.empty(len(path))
    for i in range(len(path)):
        width[i] = half_width[int(path[i, 1]), int(path[i, 0])]
    first, last = 0, len(path) - 1
    while first < len(path) and width[first] > _FORK * first:
        first += 1
    while last >= 0 and width[last] > _FORK * (len(path) - 1 - last):
        last -= 1
    return path[first : max(last + 1, first)].copy()


@kernel
def _farthest_pixel(distances: Floats) -> int:
    """Return the index of the largest finite distance of (pixels,); −1 if none is finite."""
    best = -1
    for i in range(distances.size):
        if np.isfinite(distances[i]) and (best < 0 or distances[i] > distances[best]):
            best = i
    return best


@kernel
def _measure_paths_from(number, xs, ys, weight, start):  # type: ignore[no-untyped-def]
    """Return the shortest paths from one skeleton pixel: lengths, and predecessor of each pixel.

    Both are (pixels,): a length is infinite where no path leads, a predecessor is the number of the
    pixel before on the path, −1 for none. number: (h, w), the number of each skeleton pixel, −1
    beside it. xs, ys: (pixels,) by number. weight: (h, w), multiplies the length of steps to the
    eight neighbours. start: number of the first pixel. The method is Bellman and Ford's with a
    queue: a pixel waits there when its path has become shorter.
    """
    height, width = number.shape
    distance = np.full(xs.size, np.inf)
    previous = np.full(xs.size, -1, np.int64)
    waiting = np.zeros(xs.size, np.bool_)
    queue = np.empty(xs.size + 1, np.int64)  # circular: a pixel waits at most once
    head, tail = 0, 1
    queue[0] = start
    distance[start] = 0.0
    while head != tail:
        node = queue[head]
        head = (head + 1) % queue.size
        waiting[node] = False
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                y, x = ys[node] + dy, xs[node] + dx
                if 0 <= y < height and 0 <= x < width and number[y, x] >= 0:
                    neighbour = number[y, x]
                    step = np.sqrt(2.0) if dx and dy else 1.0
                    node_weight = weight[ys[node], xs[node]]
                    length = distance[node] + step * 0.5 * (node_weight + weight[y, x])
                    if neighbour != node and length < distance[neighbour] - 1e-9:
                        distance[neighbour] = length
                        previous[neighbour] = node
                        if not waiting[neighbour]:
                            waiting[neighbour] = True
                            queue[tail] = neighbour
                            tail = (tail + 1) % queue.size
    return distance, previous


@lru_cache
def smoothing_matrix(points: int, weight: float = _SMOOTHING) -> Floats:
    """Return the matrix (points, points) that smooths a line (points, 2) if multiplied by it.

    weight: of the penalty, for an arc length that runs from 0 to 1.
    This is a Whittaker smoother with a third-difference penalty. Straight lines and parabolas pass
    unchanged, so a steady bend is not flattened.
    """
    # Third differences, scaled so that the smoothing does not depend on the number of points: a
    # third derivative is (points − 1)³ differences, and its integral a sum over points − 1.
    third = np.diff(np.eye(points), n=3, axis=0) * (points - 1) ** 2.5
    return np.linalg.inv(np.eye(points) + weight / points * third.T @ third)


@kernel
def _interpolate_field(field, x, y):  # type: ignore[no-untyped-def]
    """Return the grey level of a picture, `field` (h, w), at x, y [px], bilinear.

    It is 0 outside of the picture, and on its last row and column.
    """
    height, width = field.shape
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    if x0 < 0 or y0 < 0 or x0 >= width - 1 or y0 >= height - 1:
        return 0.0
    u, v = x - x0, y - y0
    top = (1 - u) * field[y0, x0] + u * field[y0, x0 + 1]
    return (1 - v) * top + v * ((1 - u) * field[y0 + 1, x0] + u * field[y0 + 1, x0 + 1])


@kernel
def resample_line(xy: Floats, points: int) -> Floats:
    """Return points (points, 2) at equal arc lengths along a line `xy` (m, 2), ends included."""
    arc = np.zeros(len(xy))
    for i in range(1, len(xy)):
        arc[i] = arc[i - 1] + np.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1])
    result = np.empty((points, 2))
    step, k = arc[-1] / (points - 1), 0
    for i in range(points):  # np.interp, but without seconds of compilation
        place = i * step if i < points - 1 else arc[-1]
        while k + 1 < len(arc) and arc[k + 1] <= place:
            k += 1
        for axis in range(2):
            value = xy[k, axis]
            if arc[k] != place and k + 1 < len(arc):
                value += (xy[k + 1, axis] - value) / (arc[k + 1] - arc[k]) * (place - arc[k])
            result[i, axis] = value
    return result


@kernel
def _share_past_crossing(level_before, level_after, crossing_level):  # type: ignore[no-untyped-def]
    """Return the share (0 … 1) of a step that lies beyond where the grey level falls below a limit.

    It is 1 if the level before the step is no higher. All levels are grey levels.
    """
    return (
        1.0
        if level_before <= crossing_level
        else (crossing_level - level_after) / (level_before - level_after)
    )


@kernel
def _find_tip(field, xy, width, floor):  # type: ignore[no-untyped-def]
    """Return where a line, extended beyond its first end, leaves the fish: x, y.

    field: (h, w), the difference from the empty tank; xy: (n, 2) px; width: (n,) px, half widths;
    floor: grey level below which differences are noise. The fish ends where the field falls below
    half of its mean inside. The direction is that of the line `_DEPTH` half widths from the end:
    nearer to a blunt end it is uncertain.
    """
    step = np.hypot(xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1])
    # The direction: from a point `_DEPTH` half widths inside to one about halfway to the end.
    mean_width, tenth = 0.0, len(xy) // 10
    for k in range(1, tenth + 1):
        mean_width += width[k]
    mean_width /= tenth
    inner_index = min(max(int(_DEPTH * mean_width / max(step, 1e-6) + 0.5), 2), len(xy) // 4)
    inside, end = xy[inner_index], xy[max(inner_index // 2 - 1, 0)]
    dx, dy = end[0] - inside[0], end[1] - inside[1]
    norm = max(np.hypot(dx, dy), 1e-6)
    dx, dy = dx / norm, dy / norm
    level_sum, steps = 0.0, int(norm / _STEP) + 1
    for k in range(steps):
        x, y = inside[0] + k * _STEP * dx, inside[1] + k * _STEP * dy
        level_sum += _interpolate_field(field, x, y)
    edge_level = max(0.5 * level_sum / steps, floor)
    # Outwards from the inner point, to where the field falls below that level.
    distance = 0.0
    previous_level = _interpolate_field(field, inside[0], inside[1])
    for k in range(1, 4 * (field.shape[0] + field.shape[1])):
        distance = k * _STEP
        level = _interpolate_field(field, inside[0] + distance * dx, inside[1] + distance * dy)
        if level < edge_level:
            distance -= _STEP * _share_past_crossing(previous_level, level, edge_level)
            break
        previous_level = level
    return inside[0] + distance * dx, inside[1] + distance * dy


@kernel
def _distance_to_flank(field, point, normal, edge_level, most_px):  # type: ignore[no-untyped-def]
    """Return the distance [px] from a backbone point along a normal to the side of the body.

    The side is where the difference from the empty tank, field (h, w), falls below edge_level.
    point: x, y in px; normal: unit vector. `most_px` if no side is nearer.
    """
    (x, y), (nx, ny) = point, normal
    previous_level = _interpolate_field(field, x, y)
    distance = 0.0
    while distance < most_px:
        distance += _STEP
        level = _interpolate_field(field, x + distance * nx, y + distance * ny)
        if level < edge_level:
            return distance - _STEP * _share_past_crossing(previous_level, level, edge_level)
        previous_level = level
    return most_px


@kernel
def refine_outline(alpha: Picture, chain: NDArray[np.int32], points: int) -> Floats:
    """Return the outline (points, 2) x, y at sub-pixel precision, where a fish's alpha is one half.

    alpha: (h, w), 255 is fish. chain: (m, 2), the pixels just inside the outline, in order, closed.
    They are resampled evenly, moved outwards along the normal to where alpha is one half (3 px at
    most), and resampled again.
    """
    inside = _resample_closed(chain.astype(np.float64), points)
    area = 0.0
    for i in range(points):
        j = (i + 1) % points
        area += inside[i, 0] * inside[j, 1] - inside[j, 0] * inside[i, 1]
    result = inside.copy()
    for i in range(points):
        before, after = inside[i - 1], inside[(i + 1) % points]
        tx, ty = after[0] - before[0], after[1] - before[1]
        # The sign of the area makes the normal point outwards, whichever way the chain runs.
        norm = np.copysign(max(np.hypot(tx, ty), 1e-9), area)
        nx, ny = ty / norm, -tx / norm
        distance = _distance_to_flank(alpha, (inside[i, 0], inside[i, 1]), (nx, ny), 127.5, 3.0)
        result[i, 0] += distance * nx
        result[i, 1] += distance * ny
    return _resample_closed(result, points)


@kernel
def _resample_closed(xy, points):  # type: ignore[no-untyped-def]
    """Return points (points, 2) at equal arc lengths along a closed polygon `xy` (m, 2)."""
    line = np.empty((len(xy) + 1, 2))
    for i in range(len(line)):
        line[i, 0], line[i, 1] = xy[i % len(xy), 0], xy[i % len(xy), 1]
    return resample_line(line, points + 1)[:-1].copy()


@kernel
def quantile_above(patch: Picture, threshold: float, share: float) -> float:
    """Return a quantile of a picture's grey levels (h, w) above a threshold.

    share: the quantile, 0 … 1. The result is a whole level; threshold + 1 if no pixel exceeds it.
    """
    count = np.zeros(256, np.int64)
    for y in range(patch.shape[0]):
        for x in range(patch.shape[1]):
            count[patch[y, x]] += 1
    start = int(np.floor(threshold)) + 1
    limit, total = share * count[start:].sum(), 0
    for level in range(start, 256):
        total += count[level]
        if total > limit:
            return float(level)
    return float(start)


@kernel
def _median_of_three(values, i):  # type: ignore[no-untyped-def]
    """Return the median of values[i − 1], values[i] and values[i + 1]."""
    a, b = values[i - 1], values[i]
    return max(min(a, b), min(max(a, b), values[i + 1]))


@kernel
def _smooth_by_medians(values):  # type: ignore[no-untyped-def]
    """Return values (n,), each replaced by the median of it and its two neighbours."""
    result = values.copy()
    for i in range(1, values.size - 1):
        result[i] = _median_of_three(values, i)
    return result


@kernel
def _quantile_of_few(values, share):  # type: ignore[no-untyped-def]
    """Return the quantile `share`, 0 … below 1, of few values (n,), interpolated linearly."""
    rising = values.copy()  # becomes sorted, by insertion
    for i in range(1, values.size):
        k = i
        while k > 0 and rising[k - 1] > values[i]:
            rising[k] = rising[k - 1]
            k -= 1
        rising[k] = values[i]
    rank = 1 + (values.size - 1) * share  # counted from 1
    k = int(rank)
    return rising[k - 1] * (1 - (rank - k)) + rising[k] * (rank - k)


@kernel
def _refine_backbone(fields, path, smooth, floor):  # type: ignore[no-untyped-def]
    """Turn a skeleton's path into a backbone; return points (n, 2), half widths (n,) and length.

    fields: two difference images (h, w) from the empty tank: unchanged, for the sides, and without
    notches, for the tips; path: (m, 2) px; smooth: matrix (n, n) that smooths the n points; floor:
    grey level below which differences are noise. The path is extended to the outline, centred
    between the sides, smoothed and resampled, three times. Points (n, 2), half widths (n,) and
    length are in px.
    """
    (field, filled), points = fields, len(smooth)
    xy = smooth @ resample_line(path, points)
    width = np.zeros(points)
    for _ in range(3):
        extended = np.empty((points + 2, 2))
        for i in range(points):
            extended[i + 1, 0], extended[i + 1, 1] = xy[i, 0], xy[i, 1]
        # 1. both ends are extended to the outline
        extended[0, 0], extended[0, 1] = _find_tip(filled, xy, width, floor)
        extended[-1, 0], extended[-1, 1] = _find_tip(
            filled, xy[::-1].copy(), width[::-1].copy(), floor
        )
        inner = extended.copy()
        # a point already beyond the outline is dropped in favour of the tip itself
        for axis in range(2):
            inner[1, axis] = 0.5 * (extended[0, axis] + extended[2, axis])
            inner[-2, axis] = 0.5 * (extended[-1, axis] + extended[-3, axis])
        xy = resample_line(inner, points)
        length = np.hypot(xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1]) * (points - 1)
        # 2. the points are centred between the sides, which are at most a quarter length away
        shift, normal = np.zeros(points), np.zeros((points, 2))
        ridge = np.empty(points)  # grey levels along the line; a side is where half is left
        for i in range(points):
            ridge[i] = _interpolate_field(field, xy[i, 0], xy[i, 1])
        for i in range(1, points - 1):
            tx, ty = xy[i + 1, 0] - xy[i - 1, 0], xy[i + 1, 1] - xy[i - 1, 1]
            norm = max(np.hypot(tx, ty), 1e-9)
            nx, ny = -ty / norm, tx / norm
            edge_level = 0.5 * _median_of_three(ridge, i)
            point = xy[i, 0], xy[i, 1]
            left = _distance_to_flank(field, point, (nx, ny), edge_level, 0.25 * length)
            right = _distance_to_flank(field, point, (-nx, -ny), edge_level, 0.25 * length)
            normal[i, 0], normal[i, 1] = nx, ny
            shift[i], width[i] = 0.5 * (left - right), 0.5 * (left + right)
        # a fin on one side moves only one flank: limit the shift to the body's width there
        body_width = _quantile_of_few(width, 0.8)
        for i in range(points):
            shift[i] = min(max(shift[i], -body_width), body_width)
        shift = _smooth_by_medians(shift)
        shift[0] = shift[-1] = 0.0
        for i in range(points):
            xy[i, 0] += shift[i] * normal[i, 0]
            xy[i, 1] += shift[i] * normal[i, 1]
        # 3. the line is smoothed and resampled
        xy = resample_line(smooth @ xy, points)
    length = 0.0
    for i in range(1, points):
        length += np.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1])
    return xy, _smooth_by_medians(width), length
