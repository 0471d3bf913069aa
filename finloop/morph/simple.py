"""A morph between two simple curves whose frames are all simple (the curve paper's §4.1 claim).

If the linear morph from a to b is simple, it is the result. Otherwise both curves are simplified
step by step (`morph.flow`) into poses a_i and b_j, and the result is the shortest path
a → a_i → b_j → b without folds. A path always exists, because the last poses can be joined: two
polygons by turning and stretching about their centres, two lines by turning.

Then the motion is smoothed in time as far as it stays simple. Closed frames are scaled so that
their areas lie between those of the ends, which makes no folds. Finally every frame is tested
exactly.
"""

from dataclasses import dataclass

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.curve.contour import Curve
from finloop.morph.flow import (
    area,
    cut_ears,
    join_plain_ends,
    resize_polygon,
    shorten_polygon,
    straighten_curve,
)
from finloop.morph.folds import count_folds, folds, no_contact, stays_simple
from finloop.morph.match import match_curves, misfit

PARTS = 16  # steps of a straight motion: small boxes, few pairs to compare
SMOOTHING = (1 / 6, 1 / 12, 1 / 18, 1 / 25, 1 / 40)  # widths in time, as shares of it, widest first
REACH = 10  # edges: width of the mean along a curve
NUDGE = 0.1  # edges: how far a proof may stray from the straight motion between two frames


@dataclass(frozen=True)
class SimpleMorph:
    """Frames of a morph, and whether the motion between them is proved simple."""

    frames: Points  # (f, n, 2), the first and last being the ends
    way: str  # "linear"; "plain" through plainer poses; "joined" through the plain last poses
    # whether a motion from each frame to the next is proved simple at every moment: the straight
    # motion; a motion that strays from it by at most NUDGE of the mean edge length; or, with few
    # frames, the path through the poses. The frames themselves are always tested exactly
    proved: bool


def simple_frames(a: Curve, b: Curve, frames: int, points: int) -> Points:
    """Return frames (frames, points, 2) from curve a to b, ends included; none meets itself.

    FinloopError if one curve is open and the other closed, or a curve, resampled, meets itself.
    """
    return simple_morph(a, b, frames, points).frames


def simple_morph(a: Curve, b: Curve, frames: int, points: int) -> SimpleMorph:
    """Return a morph from a to b without folds, the kind of its path, and whether it is proved.

    points: of every frame. FinloopError as in `simple_frames`.
    """
    first, second = match_curves(a, b, points)
    closed = a.closed
    for name, ends in (("first", first), ("second", second)):
        meets = folds(ends, closed)[0]
        if meets:
            raise FinloopError(
                f"the {name} curve, at {points} points, meets itself {meets} times",
                "a curve that does not meet itself",
                "correct the drawing, set more points, or use the method linear",
            )
    tau = np.linspace(0, 1, frames)[:, None, None]
    straight = (1 - tau) * first + tau * second
    if not folds(straight, closed).any() and _has_simple_motion(straight, closed):
        return SimpleMorph(straight, "linear", True)
    poses, way = _find_simple_path(first, second, closed)
    stack, on_the_way = _frames(poses, frames, closed)
    if folds(stack, closed).any():
        raise FinloopError(
            "a morph with frames too narrow to be distinguished from folded frames",
            "curves with some room between their parts",
            "set fewer points (morph.contour_points), or morph.method=linear",
        )
    proved = stays_simple(stack, closed) or (on_the_way and stays_simple(poses, closed))
    return SimpleMorph(stack, way, proved)


def path_length(frames: Points) -> float:
    """Return how far a vertex travels through frames (f, n, 2): the mean, in the points' unit."""
    return float(np.hypot(*np.moveaxis(np.diff(frames, axis=0), 2, 0)).sum(axis=0).mean())


def _find_simple_path(first: Points, second: Points, closed: bool) -> tuple[Points, str]:
    """Return poses (k, n, 2) from one end to the other with simple steps, and the kind of path."""
    a, b = _plainer(first, closed), _plainer(second, closed)
    best: tuple[float, Points] | None = None
    for start in _starts(a, b) if closed else [0]:
        rolled = np.roll(b, -start, axis=1)
        shortest = _shortest(a, rolled, closed, np.inf if best is None else best[0])
        if shortest:
            far, i, j = shortest
            best = far, np.concatenate([a[: i + 1], rolled[j::-1]])
    if best:
        return best[1], "plain"
    return np.concatenate([a, join_plain_ends(a[-1], b[-1], closed)[1:-1], b[::-1]]), "joined"


def _starts(a: Points, b: Points) -> list[int]:
    """Return start points to try: 0, and the best fits of poses of equal rank.

    Neighbouring start points give similar paths, so only local minima count.
    """
    starts = [0]
    for share in (0.0, 0.5, 1.0):
        first, second = (poses[int(share * (len(poses) - 1))] for poses in (a, b))
        far = misfit(first, second)
        least = (far <= np.roll(far, 1)) & (far < np.roll(far, -1))
        starts += [int(s) for s in sorted(np.flatnonzero(least), key=far.__getitem__)[:2]]
    apart = len(far) // 32
    apart_starts: list[int] = []
    for start in starts:
        if all(min((start - s) % len(far), (s - start) % len(far)) > apart for s in apart_starts):
            apart_starts.append(start)
    return apart_starts


def _shortest(a: Points, b: Points, closed: bool, below: float) -> tuple[float, int, int] | None:
    """Return length, i, j of the shortest free path a → a_i → b_j → b shorter than `below`.

    If two poses are not free, all pairs of less plain poses are skipped too.
    """
    before, after = _lengths(a), _lengths(b)
    far = before[:, None] + _apart(a, b) + after
    open_to = far < below

    def free(i: int, j: int) -> bool:
        if _free(a[i], b[j], closed):
            return True
        open_to[: i + 1, : j + 1] = False
        return False

    low, high = 0, min(len(a), len(b)) - 1
    while low < high:  # bisection: how plain must both be? This rules out many pairs
        middle = (low + high) // 2
        low, high = (low, middle) if free(middle, middle) else (middle + 1, high)
    for way in np.argsort(far, axis=None):
        i, j = divmod(int(way), len(b))
        if open_to[i, j] and free(i, j):
            # One pose plainer if that is free too: the shortest free path almost folds.
            if i + 1 < len(a) and j + 1 < len(b) and _free(a[i + 1], b[j + 1], closed):
                return float(far[i, j]), i + 1, j + 1
            return float(far[i, j]), i, j
    return None


def _plainer(points: Points, closed: bool) -> Points:
    if not closed:
        poses, plain = straighten_curve(points)
    else:
        poses, plain = shorten_polygon(points)
        if not plain:
            poses, plain = cut_ears(points)
    if not plain:
        raise FinloopError(
            "a curve whose parts are too near each other to stay separate while it moves",
            "a curve with some room between its parts",
            "set fewer points (morph.contour_points), or morph.method=linear",
        )
    return poses


@kernel
def _apart(a: Points, b: Points) -> Points:
    """Return the mean vertex distance (k, m) of poses a (k, n, 2) from poses b (m, n, 2)."""
    far = np.zeros((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            for v in range(a.shape[1]):
                x, y = a[i, v, 0] - b[j, v, 0], a[i, v, 1] - b[j, v, 1]
                far[i, j] += np.sqrt(x * x + y * y)
    return far / a.shape[1]


@kernel
def _free(first: Points, second: Points, closed: bool) -> bool:
    """Return whether the straight motion from one polygon to the other stays simple."""
    path = np.empty((PARTS + 1, len(first), 2))
    for k in range(PARTS + 1):
        share = k / PARTS
        for v in range(len(first)):
            for axis in range(2):
                path[k, v, axis] = (1 - share) * first[v, axis] + share * second[v, axis]
    for k in (8, 4, 12, 2, 14):  # most motions that fold do so here: a quick first test
        if count_folds(path[k], closed, True):
            return False
    return no_contact(path, closed)


def _frames(poses: Points, frames: int, closed: bool) -> tuple[Points, bool]:
    """Return frames at constant speed, smoothed in time as far as they stay simple.

    Also return whether each frame lies, up to its size, on the unsmoothed path.
    """
    on_the_way = True
    along = _lengths(poses)
    marks = np.linspace(0, along[-1], frames)
    k = np.clip(np.searchsorted(along, marks, side="right") - 1, 0, len(along) - 2)
    share = ((marks - along[k]) / (along[k + 1] - along[k]))[:, None, None]
    even = (1 - share) * poses[k] + share * poses[k + 1]
    even[0], even[-1] = poses[0], poses[-1]
    for width in SMOOTHING:
        smooth = _smooth_in_time(even, width * frames)
        smooth[0], smooth[-1] = poses[0], poses[-1]
        if stays_simple(smooth, closed):
            even, on_the_way = smooth, False
            break
    return (_within(even) if closed else even), on_the_way


def _smooth_in_time(stack: Points, width: float) -> Points:
    """Smooth by a Gaussian in time, SD `width` frames, mirrored at the ends, which stay."""
    f = len(stack)
    reach = min(int(3 * width) + 1, f - 1)
    longer = np.concatenate(
        [2 * stack[0] - stack[reach:0:-1], stack, 2 * stack[-1] - stack[-2 : -reach - 2 : -1]]
    )
    weight = np.exp(-((np.arange(-reach, reach + 1) / width) ** 2) / 2)
    weight /= weight.sum()
    rows = np.zeros((f, len(longer)))
    for row in range(f):
        rows[row, row : row + len(weight)] = weight
    return (rows @ longer.reshape(len(longer), -1)).reshape(stack.shape)


def _within(stack: Points) -> Points:
    """Return the frames, scaled to areas between those of the first and the last."""
    low, high = sorted((area(stack[0]), area(stack[-1])))
    out = stack.copy()
    for pose, size in zip(out, map(area, stack), strict=True):
        if not low <= size <= high:
            pose[:] = resize_polygon(pose, min(max(size, low), high))
    return out


def _lengths(poses: Points) -> Points:
    """Return the mean length of the vertices' paths up to each pose (k,)."""
    steps = np.hypot(*np.moveaxis(np.diff(poses, axis=0), 2, 0)).mean(axis=1)
    return np.r_[0.0, np.cumsum(steps)]


def _has_simple_motion(stack: Points, closed: bool) -> bool:
    """Return whether each simple frame has a proved simple motion to the next; see SimpleMorph.

    An edge that turns round passes through length 0, where it meets its neighbours. Slight
    smoothing on the way, with positive weights, lets it turn at a positive length.
    """
    for k in range(len(stack) - 1):
        pair = stack[k : k + 2]
        if no_contact(pair, closed):
            continue
        middle = pair.mean(axis=0)
        away = _smoothed_along(middle, closed) - middle
        edge = np.hypot(*np.diff(middle, axis=0).T).mean()
        sizes = (stray * edge / abs(away).max() for stray in (NUDGE / 100, NUDGE / 10, NUDGE))
        detours = (np.stack([pair[0], middle + size * away, pair[1]]) for size in sizes)
        if not any(no_contact(detour, closed) for detour in detours):
            return False
    return True


def _smoothed_along(points: Points, closed: bool) -> Points:
    """Return the polygon with each edge a mean of all edges, weighted by distance."""
    longer = np.r_[points, points[:1]] if closed else np.r_[points, points[-2::-1]]
    edges = np.diff(longer, axis=0)
    if not closed:
        edges[len(points) - 1 :] *= -1  # the second half mirrors the first
    turn = np.pi * np.arange(len(edges)) / len(edges)
    weight = 1 / (1 + 4 * REACH**2 * np.sin(turn) ** 2)
    mean = np.fft.ifft(np.fft.fft(edges @ [1, 1j]) * weight)[: len(points) - 1]
    z = np.r_[0, np.cumsum(mean)]
    smooth = np.stack([z.real, z.imag], axis=1)
    return smooth - smooth.mean(axis=0) + points.mean(axis=0)
