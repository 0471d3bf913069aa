"""The backbone of a fish from its silhouette (fish paper §2.2 and §2.2.1, Figs. 2-4).

Thinning leaves a one-pixel skeleton with side branches (open fins). Numbering pixels from one end
and keeping the branch with the greatest number is the longest geodesic of the skeleton graph, a
diagonal step costing √2. That path stops short of head and tail and sits on whole pixels, which
makes measured lengths 2.5-3.7 % too small. So it is carried on to the outline at both ends, centred
between the two flanks at sub-pixel precision, smoothed and resampled at equal arc lengths.

Glossary: `field` is the difference image of one cut-out (grey levels, the fish is high), s the arc
length along the backbone in [0, 1], a *flank* the place on either side where the field has fallen
to half of its local height.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from skimage.morphology import skeletonize

FloatArray = NDArray[np.float32] | NDArray[np.float64]

_STEP = 0.5  # px, sampling step along flanks and at the ends
_DEPTH = 2.0  # in half widths, how far inside an end its direction is taken
_FORK = 3.0  # a path's end is cut where it is nearer to the tip than this share of its half width
_SMOOTHING = 2e-6  # weight of the third-derivative penalty, s in [0, 1]; see smoother()


class Backbone(NamedTuple):
    """A backbone in the coordinates of its cut-out (pixel centres at integers).

    Which end is the head is not decided here.

    points_px: (n, 2) float64, columns x, y, equally spaced along the arc, outline to outline.
    half_width_px: (n,) float64, mean distance from the backbone to its two flanks.
    length_px: arc length.
    """

    points_px: NDArray[np.float64]
    half_width_px: NDArray[np.float64]
    length_px: float


def trace(
    mask: NDArray[np.bool_], field: NDArray[np.uint8], points: int, floor: float
) -> Backbone | None:
    """Backbone of the silhouette `mask` (h, w) with `points` points; None if it has no extent.

    `field` (h, w) is the difference image from which sub-pixel flanks and tips are read; below
    `floor` (grey levels) it is taken for noise.
    """
    half_width = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    path = trimmed(longest_geodesic(skeletonize(mask), half_width), half_width)
    if len(path) < 4:
        return None
    xy, width = _refine(field, path, smoother(points), points, floor)
    length = float(np.hypot(*np.diff(xy, axis=0).T).sum())
    return Backbone(xy, width, length) if np.isfinite(length) else None


@lru_cache
def smoother(points: int) -> NDArray[np.float64]:
    """Whittaker smoother with a third-difference penalty as one (points, points) matrix.

    Straight lines and parabolas pass unchanged, so a steady bend is not flattened.
    """
    third = np.diff(np.eye(points), n=3, axis=0) * (points - 1) ** 2.5
    return np.linalg.inv(np.eye(points) + _SMOOTHING / points * third.T @ third)


@njit(cache=True, nogil=True)
def longest_geodesic(
    skeleton: NDArray[np.bool_], weight: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Longest shortest path of a skeleton, as (m, 2) x, y (§2.2.1, Fig. 4: A to D).

    A step's length is multiplied by the mean `weight` (h, w) of its two pixels. Ones give the
    paper's rule, by which an open fin can outrun the head, which a skeleton stops short of; with
    the distance to the outline as weight a path counts by the area it passes through, and thin fins
    lose.

    Two sweeps: the pixel farthest from any pixel is one end, the pixel farthest from that end is
    the other. Exact on a tree, which the skeleton of a silhouette without holes is. Of several
    separate pieces the one holding the most pixels is used.
    """
    height, width = skeleton.shape
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
    seen = np.zeros(count, np.bool_)
    best_start, best_size = -1, 0
    for start in range(count):
        if not seen[start]:
            reached = np.isfinite(_geodesic(number, xs, ys, weight, start)[0])
            seen |= reached
            if reached.sum() > best_size:
                best_start, best_size = start, reached.sum()
    if best_size == 0:
        return np.empty((0, 2))
    one_end = _farthest(_geodesic(number, xs, ys, weight, best_start)[0])
    distance, previous = _geodesic(number, xs, ys, weight, one_end)
    node = _farthest(distance)
    path = np.empty((count, 2))
    length = 0
    while node >= 0:
        path[length, 0], path[length, 1] = xs[node], ys[node]
        node = previous[node]
        length += 1
    return path[:length].copy()


@njit(cache=True, nogil=True)
def trimmed(path: NDArray[np.float64], half_width: NDArray[np.float32]) -> NDArray[np.float64]:
    """The path without its forks: within half a body width of a blunt end the skeleton runs aside
    into a corner of the outline, so what lies nearer to an end than that is cut off."""
    first, last = 0, len(path) - 1
    while (
        first < len(path) and half_width[int(path[first, 1]), int(path[first, 0])] > _FORK * first
    ):
        first += 1
    while last >= 0 and (
        half_width[int(path[last, 1]), int(path[last, 0])] > _FORK * (len(path) - 1 - last)
    ):
        last -= 1
    return path[first : max(last + 1, first)].copy()


@njit(cache=True, nogil=True)
def _farthest(distance: NDArray[np.float64]) -> int:
    best = 0
    for i in range(distance.size):
        if (np.isfinite(distance[i]) and not distance[i] <= distance[best]) or (
            not np.isfinite(distance[best]) and np.isfinite(distance[i])
        ):
            best = i
    return best


@njit(cache=True, nogil=True)
def _geodesic(number, xs, ys, weight, start):  # type: ignore[no-untyped-def]
    """Distances from `start` over the 8-connected skeleton, and each pixel's predecessor."""
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
                    there = number[y, x]
                    step = np.sqrt(2.0) if dx and dy else 1.0
                    here = weight[ys[node], xs[node]]
                    reach = distance[node] + step * 0.5 * (here + weight[y, x])
                    if there != node and reach < distance[there] - 1e-9:
                        distance[there] = reach
                        previous[there] = node
                        if not waiting[there]:
                            waiting[there] = True
                            queue[tail] = there
                            tail = (tail + 1) % queue.size
    return distance, previous


@njit(cache=True, nogil=True)
def _bilinear(field, x, y):  # type: ignore[no-untyped-def]
    height, width = field.shape
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    if x0 < 0 or y0 < 0 or x0 >= width - 1 or y0 >= height - 1:
        return 0.0
    u, v = x - x0, y - y0
    top = (1 - u) * field[y0, x0] + u * field[y0, x0 + 1]
    return (1 - v) * top + v * ((1 - u) * field[y0 + 1, x0] + u * field[y0 + 1, x0 + 1])


@njit(cache=True, nogil=True)
def resample(xy: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """`points` points at equal arc lengths along the polyline `xy` (m, 2)."""
    arc = np.zeros(len(xy))
    for i in range(1, len(xy)):
        arc[i] = arc[i - 1] + np.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1])
    at = np.linspace(0.0, arc[-1], points)
    out = np.empty((points, 2))
    out[:, 0] = np.interp(at, arc, xy[:, 0])
    out[:, 1] = np.interp(at, arc, xy[:, 1])
    return out


@njit(cache=True, nogil=True)
def _share_below(before, here, half):  # type: ignore[no-untyped-def]
    """Share, in [0, 1], of the last step that lies beyond the crossing of `half`."""
    return 1.0 if before <= half else (half - here) / (before - here)


@njit(cache=True, nogil=True)
def _tip(field, xy, width, floor):  # type: ignore[no-untyped-def]
    """Where the first end of the line `xy` leaves the fish: the field at half its height there.

    The line is carried on straight in the direction that it has one body width inside: nearer to a
    blunt end its own direction is uncertain, farther from a slender one it is another.
    """
    step = np.hypot(xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1])
    wide = np.mean(width[1 : len(xy) // 10 + 1])
    deep = min(max(int(_DEPTH * wide / max(step, 1e-6) + 0.5), 2), len(xy) // 4)
    inside, end = xy[deep], xy[max(deep // 2 - 1, 0)]
    dx, dy = end[0] - inside[0], end[1] - inside[1]
    norm = max(np.hypot(dx, dy), 1e-6)
    dx, dy = dx / norm, dy / norm
    height, steps = 0.0, int(norm / _STEP) + 1
    for k in range(steps):
        height += _bilinear(field, inside[0] + k * _STEP * dx, inside[1] + k * _STEP * dy)
    half = max(0.5 * height / steps, floor)
    low = 0.0
    before = _bilinear(field, inside[0], inside[1])
    for k in range(1, 4 * (field.shape[0] + field.shape[1])):
        low = k * _STEP
        here = _bilinear(field, inside[0] + low * dx, inside[1] + low * dy)
        if here < half:
            low -= _STEP * _share_below(before, here, half)
            break
        before = here
    return np.array([inside[0] + low * dx, inside[1] + low * dy])


@njit(cache=True, nogil=True)
def _flank(field, x, y, nx, ny, half, reach):  # type: ignore[no-untyped-def]
    """Distance from (x, y) along (nx, ny) to where the field falls below `half`."""
    before = _bilinear(field, x, y)
    far = 0.0
    while far < reach:
        far += _STEP
        here = _bilinear(field, x + far * nx, y + far * ny)
        if here < half:
            return far - _STEP * _share_below(before, here, half)
        before = here
    return reach


@njit(cache=True, nogil=True)
def ring(alpha: NDArray[np.uint8], chain: NDArray[np.int32], points: int) -> NDArray[np.float64]:
    """The outline (points, 2) x, y where `alpha` (h, w; 255 = fish) crosses one half.

    `chain` (m, 2) are the pixels just inside it, in order, closed. They are spread evenly, moved
    outwards along the normal to the crossing, and spread evenly again.
    """
    inside = _closed(chain.astype(np.float64), points)
    area = 0.0
    for i in range(points):
        j = (i + 1) % points
        area += inside[i, 0] * inside[j, 1] - inside[j, 0] * inside[i, 1]
    out = inside.copy()
    for i in range(points):
        before, after = inside[i - 1], inside[(i + 1) % points]
        tx, ty = after[0] - before[0], after[1] - before[1]
        norm = np.copysign(max(np.hypot(tx, ty), 1e-9), area)
        nx, ny = ty / norm, -tx / norm
        far = _flank(alpha, inside[i, 0], inside[i, 1], nx, ny, 127.5, 3.0)
        out[i, 0] += far * nx
        out[i, 1] += far * ny
    return _closed(out, points)


@njit(cache=True, nogil=True)
def _closed(xy, points):  # type: ignore[no-untyped-def]
    """`points` points at equal arc lengths along the closed polygon `xy` (m, 2)."""
    line = np.empty((len(xy) + 1, 2))
    line[:-1] = xy
    line[-1] = xy[0]
    return resample(line, points + 1)[:-1].copy()


@njit(cache=True, nogil=True)
def upper_level(patch: NDArray[np.uint8], threshold: float, share: float) -> float:
    """The level below which `share` of the pixels of `patch` that exceed `threshold` lie."""
    count = np.zeros(256, np.int64)
    for y in range(patch.shape[0]):
        for x in range(patch.shape[1]):
            count[patch[y, x]] += 1
    start = int(np.floor(threshold)) + 1
    wanted, seen = share * count[start:].sum(), 0
    for level in range(start, 256):
        seen += count[level]
        if seen > wanted:
            return float(level)
    return float(start)


@njit(cache=True, nogil=True)
def _median3(values):  # type: ignore[no-untyped-def]
    out = values.copy()
    for i in range(1, values.size - 1):
        out[i] = np.median(values[i - 1 : i + 2])
    return out


@njit(cache=True, nogil=True)
def _refine(field, path, smooth, points, floor):  # type: ignore[no-untyped-def]
    """Carry the path on to the outline, centre it between the flanks, smooth and resample it."""
    xy = smooth @ resample(path, points)
    width = np.zeros(points)
    for _ in range(3):
        ends = np.empty((points + 2, 2))
        ends[1:-1] = xy
        ends[0] = _tip(field, xy, width, floor)
        ends[-1] = _tip(field, xy[::-1], width[::-1], floor)
        inner = ends.copy()
        # a point already beyond the outline is dropped in favour of the tip itself
        inner[1] = 0.5 * (ends[0] + ends[2])
        inner[-2] = 0.5 * (ends[-1] + ends[-3])
        xy = resample(inner, points)
        length = np.hypot(xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1]) * (points - 1)
        shift, normal = np.zeros(points), np.zeros((points, 2))
        ridge = np.empty(points)
        for i in range(points):
            ridge[i] = _bilinear(field, xy[i, 0], xy[i, 1])
        for i in range(1, points - 1):
            tx, ty = xy[i + 1, 0] - xy[i - 1, 0], xy[i + 1, 1] - xy[i - 1, 1]
            norm = max(np.hypot(tx, ty), 1e-9)
            nx, ny = -ty / norm, tx / norm
            half = 0.5 * np.median(ridge[max(i - 1, 0) : i + 2])
            left = _flank(field, xy[i, 0], xy[i, 1], nx, ny, half, 0.25 * length)
            right = _flank(field, xy[i, 0], xy[i, 1], -nx, -ny, half, 0.25 * length)
            normal[i, 0], normal[i, 1] = nx, ny
            shift[i], width[i] = 0.5 * (left - right), 0.5 * (left + right)
        # a fin on one side moves one flank only: never by more than the body is wide there
        typical = np.quantile(width, 0.8)
        shift = _median3(np.minimum(np.maximum(shift, -typical), typical))
        shift[0] = shift[-1] = 0.0
        for i in range(points):
            xy[i, 0] += shift[i] * normal[i, 0]
            xy[i, 1] += shift[i] * normal[i, 1]
        xy = resample(smooth @ xy, points)
    return xy, _median3(width)
