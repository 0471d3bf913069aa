"""The backbone of a fish from its silhouette (fish paper §2.2 and §2.2.1, Figs. 2-4).

Thinning leaves a one-pixel skeleton with side branches (open fins); `extract.skeleton` picks its
main path. That path stops short of head and tail and lies on whole pixels, so measured lengths are
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
import skimage
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.kernel import kernel
from finloop.extract.skeleton import longest_geodesic, trim_forks

_STEP = 0.5  # px, sampling step along flanks and at the ends
_DEPTH = 2.0  # half widths from an end to where its direction is measured
_NOTCH = 0.5  # radius of the disc that closes notches, as a share of the largest half width
_SMOOTHING = 2e-6  # weight of the third-derivative penalty, s in [0, 1]; see smoother()


class Backbone(NamedTuple):
    """A backbone in the coordinates of its cut-out (pixel centres at integers).

    Either end may be the head.

    points_px: (n, 2) float64, columns x, y, equally spaced along the arc, outline to outline.
    half_width_px: (n,) float64, mean distance from the backbone to its two flanks. length_px: arc
    length.
    """

    points_px: Floats
    half_width_px: Floats
    length_px: float


def trace(mask: Mask, field: Picture, points: int, floor: float) -> Backbone | None:
    """Trace the backbone of the silhouette `mask` (h, w) with `points` points; None if too short.

    field (h, w): the difference image, from which flanks and tips are read at sub-pixel precision;
    floor: grey levels, lower values are noise.
    """
    whole, filled = without_notches(mask, field)
    skeleton = skimage.morphology.skeletonize(whole)
    half_width = cv2.distanceTransform(whole.view(np.uint8), cv2.DIST_L2, 3)
    line = _line(skeleton, half_width, (field, filled), smoother(points), floor)
    return Backbone(*line) if np.isfinite(line[-1]) else None


def without_notches(mask: Mask, field: Picture) -> tuple[Mask, Picture]:
    """Return the silhouette (h, w) and the field (h, w) without notches far narrower than the body.

    A notch is skin as bright as the tank, like the black eye of a pale fish, and diverts the
    skeleton. Both are closed (dilated, then eroded) with a disc of half the largest half width. If
    that would enclose a hole, head and tail are near each other, and both stay unchanged.
    """
    picture = mask.view(np.uint8)
    widest = float(cv2.distanceTransform(pad_picture(picture, 1), cv2.DIST_L2, 3).max())
    reach = int(_NOTCH * widest + 0.5)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = _closing(picture, disc)
    if _has_holes(closed):
        return mask, field
    inside = np.where(closed, field, 0)  # beside it there may be another fish
    return closed.view(bool), np.maximum(_closing(inside, disc) * closed, field)


def _closing(picture: Picture, disc: Picture) -> Picture:
    """Return the closing (h, w) of a picture in which nothing lies beyond the border."""
    (h, w), rim = picture.shape, len(disc) // 2
    closed = cv2.morphologyEx(pad_picture(picture, rim), cv2.MORPH_CLOSE, disc)
    return closed[rim : rim + h, rim : rim + w].copy()


def pad_picture(picture: Picture, rim: int) -> Picture:
    """Return a picture (h, w) with a rim of zeros, `rim` px wide, on all four sides.

    Unlike np.pad it leaves no cycles of references.
    """
    return np.asarray(cv2.copyMakeBorder(picture, rim, rim, rim, rim, cv2.BORDER_CONSTANT))


def _has_holes(mask: Picture) -> bool:
    kinds = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)[1]
    return kinds is not None and bool((kinds[0, :, 3] >= 0).any())


@lru_cache
def smoother(points: int) -> Floats:
    """Return a Whittaker smoother with a third-difference penalty, a (points, points) matrix.

    Multiplied by a line's points (points, 2), it gives the smoothed line. Straight lines and
    parabolas pass unchanged, so a steady bend is not flattened.
    """
    third = np.diff(np.eye(points), n=3, axis=0) * (points - 1) ** 2.5
    return np.linalg.inv(np.eye(points) + _SMOOTHING / points * third.T @ third)


@kernel
def _bilinear(field, x, y):  # type: ignore[no-untyped-def]
    height, width = field.shape
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    if x0 < 0 or y0 < 0 or x0 >= width - 1 or y0 >= height - 1:
        return 0.0
    u, v = x - x0, y - y0
    top = (1 - u) * field[y0, x0] + u * field[y0, x0 + 1]
    return (1 - v) * top + v * ((1 - u) * field[y0 + 1, x0] + u * field[y0 + 1, x0 + 1])


@kernel
def resample(xy: Floats, points: int) -> Floats:
    """Return points (points, 2) at equal arc lengths along a line `xy` (m, 2), ends included."""
    arc = np.zeros(len(xy))
    for i in range(1, len(xy)):
        arc[i] = arc[i - 1] + np.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1])
    out = np.empty((points, 2))
    step, k = arc[-1] / (points - 1), 0
    for i in range(points):  # np.interp, but without seconds of compilation
        at = i * step if i < points - 1 else arc[-1]
        while k + 1 < len(arc) and arc[k + 1] <= at:
            k += 1
        for axis in range(2):
            value = xy[k, axis]
            if arc[k] != at and k + 1 < len(arc):
                value += (xy[k + 1, axis] - value) / (arc[k + 1] - arc[k]) * (at - arc[k])
            out[i, axis] = value
    return out


@kernel
def _share_below(before, here, half):  # type: ignore[no-untyped-def]
    """Return the share, in [0, 1], of the last step that lies beyond the crossing of `half`."""
    return 1.0 if before <= half else (half - here) / (before - here)


@kernel
def _tip(field, xy, width, floor):  # type: ignore[no-untyped-def]
    """Return the point x, y at which the line `xy`, extended beyond its first end, leaves the fish.

    There the field has half of its height. The extension is straight, in the direction that the
    line has one body width inside: nearer to a blunt end the direction is uncertain, farther from a
    slender end it is a different one.
    """
    step = np.hypot(xy[1, 0] - xy[0, 0], xy[1, 1] - xy[0, 1])
    wide, near = 0.0, len(xy) // 10
    for k in range(1, near + 1):
        wide += width[k]
    wide /= near
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
    return inside[0] + low * dx, inside[1] + low * dy


@kernel
def _flank(field, point, normal, half, reach):  # type: ignore[no-untyped-def]
    """Return the distance from `point` along `normal` to where the field falls below `half`."""
    (x, y), (nx, ny) = point, normal
    before = _bilinear(field, x, y)
    far = 0.0
    while far < reach:
        far += _STEP
        here = _bilinear(field, x + far * nx, y + far * ny)
        if here < half:
            return far - _STEP * _share_below(before, here, half)
        before = here
    return reach


@kernel
def ring(alpha: Picture, chain: NDArray[np.int32], points: int) -> Floats:
    """Return the outline (points, 2) x, y where `alpha` (h, w; 255 = fish) crosses one half.

    `chain` (m, 2) are the pixels just inside it, in order, closed. They are resampled evenly, moved
    outwards along the normal to the crossing, and resampled again.
    """
    inside = _resample_closed(chain.astype(np.float64), points)
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
        far = _flank(alpha, (inside[i, 0], inside[i, 1]), (nx, ny), 127.5, 3.0)
        out[i, 0] += far * nx
        out[i, 1] += far * ny
    return _resample_closed(out, points)


@kernel
def _resample_closed(xy, points):  # type: ignore[no-untyped-def]
    """Return `points` points at equal arc lengths along the closed polygon `xy` (m, 2)."""
    line = np.empty((len(xy) + 1, 2))
    for i in range(len(line)):
        line[i, 0], line[i, 1] = xy[i % len(xy), 0], xy[i % len(xy), 1]
    return resample(line, points + 1)[:-1].copy()


@kernel
def upper_level(patch: Picture, threshold: float, share: float) -> float:
    """Return the quantile `share` of the grey levels above `threshold` in a patch (h, w) uint8.

    It is a whole level; the one above the threshold if no pixel exceeds that.
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
def _median(values, i):  # type: ignore[no-untyped-def]
    a, b = values[i - 1], values[i]
    return max(min(a, b), min(max(a, b), values[i + 1]))


@kernel
def _median3(values):  # type: ignore[no-untyped-def]
    out = values.copy()
    for i in range(1, values.size - 1):
        out[i] = _median(values, i)
    return out


@kernel
def _quantile(values, share):  # type: ignore[no-untyped-def]
    rising = values.copy()
    for i in range(1, values.size):
        k = i
        while k > 0 and rising[k - 1] > values[i]:
            rising[k] = rising[k - 1]
            k -= 1
        rising[k] = values[i]
    rank = 1 + (values.size - 1) * share
    k = int(rank)
    return rising[k - 1] * (1 - (rank - k)) + rising[k] * (rank - k)


@kernel
def _line(skeleton, half_width, fields, smooth, floor):  # type: ignore[no-untyped-def]
    """Return points, half widths and length of a skeleton's backbone; NaN where it is too short."""
    points = len(smooth)
    path = trim_forks(longest_geodesic(skeleton, half_width), half_width)
    if len(path) < 4:
        return np.zeros((points, 2)), np.zeros(points), np.nan
    xy, width = _refine(fields, path, smooth, points, floor)
    length = 0.0
    for i in range(1, points):
        length += np.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1])
    return xy, width, length


@kernel
def _refine(fields, path, smooth, points, floor):  # type: ignore[no-untyped-def]
    """Extend the path to the outline, centre it between the flanks, smooth and resample it.

    fields: unchanged, for the flanks, and without notches, for the tips.
    """
    field, filled = fields
    xy = smooth @ resample(path, points)
    width = np.zeros(points)
    for _ in range(3):
        ends = np.empty((points + 2, 2))
        for i in range(points):
            ends[i + 1, 0], ends[i + 1, 1] = xy[i, 0], xy[i, 1]
        ends[0, 0], ends[0, 1] = _tip(filled, xy, width, floor)
        ends[-1, 0], ends[-1, 1] = _tip(filled, xy[::-1].copy(), width[::-1].copy(), floor)
        inner = ends.copy()
        # a point already beyond the outline is dropped in favour of the tip itself
        for axis in range(2):
            inner[1, axis] = 0.5 * (ends[0, axis] + ends[2, axis])
            inner[-2, axis] = 0.5 * (ends[-1, axis] + ends[-3, axis])
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
            half = 0.5 * _median(ridge, i)
            point = xy[i, 0], xy[i, 1]
            left = _flank(field, point, (nx, ny), half, 0.25 * length)
            right = _flank(field, point, (-nx, -ny), half, 0.25 * length)
            normal[i, 0], normal[i, 1] = nx, ny
            shift[i], width[i] = 0.5 * (left - right), 0.5 * (left + right)
        # a fin on one side moves only one flank: limit the shift to the body's width there
        typical = _quantile(width, 0.8)
        for i in range(points):
            shift[i] = min(max(shift[i], -typical), typical)
        shift = _median3(shift)
        shift[0] = shift[-1] = 0.0
        for i in range(points):
            xy[i, 0] += shift[i] * normal[i, 0]
            xy[i, 1] += shift[i] * normal[i, 1]
        xy = resample(smooth @ xy, points)
    return xy, _median3(width)
