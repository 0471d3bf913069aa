"""A morph between two simple curves whose frames are all simple (the curve paper's §4.1 claim).

If the linear morph from a to b is simple, it is the result. Otherwise both curves are simplified
step by step into poses a_i and b_j, and the result is the shortest path a → a_i → b_j → b without
folds. A path always exists, because the last poses can be joined: two polygons by turning and
stretching about their centres, two lines by turning. Then the motion is smoothed in time as far as
it stays simple. Closed frames are scaled so that their areas lie between those of the ends, which
makes no folds. Finally every frame is tested exactly.

A curve is simplified by one of three methods. Vertex i stays vertex i, between poses the vertices
move straight, and a step counts only if it is proved free of contact (`morph.folds.stays_simple`).

- `shorten_polygon`, closed: curve shortening, x_t = x_uu / |x_u|², makes every simple closed curve
  round before it vanishes, and keeps it simple (Gage 1984, Gage and Hamilton 1986, Grayson 1987).
  The tangential part of this form spreads the vertices evenly. Each step restores the area. The
  theorems hold for smooth curves; for polygons each step is checked.
- `cut_ears`, closed: a polygon of more than three corners has a corner whose triangle with its two
  neighbours is empty (two ears theorem, Meisters 1975). Moved onto the opposite side, it leaves
  one corner less. Every polygon ends as a triangle. This is not pretty, so it only takes over
  where `shorten_polygon` fails.
- `straighten_curve`, open: a part of a simple curve is simple, and so is that part enlarged.
  Shorter and shorter parts about the middle end at a line without bends.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.curve.contour import Curve, area_centroids, signed_area
from finloop.morph.folds import (
    count_folds_unchecked,
    count_polygon_folds,
    stays_simple,
    stays_simple_unchecked,
)
from finloop.morph.match import match_curves, misfit_by_start

GROWTH = 1.3  # factor of the time step, from one pose to the next
STEP = 0.1  # longest time step, in areas of the curve
ROUND = 0.97  # 4π area / length² at which a curve is plain; a circle has 1
HALVINGS = 40  # halvings of a time step before giving up
MOST = 200  # poses
SHRINK = 0.9  # factor of an open curve's length, from one part to the next
SLOWEST = 0.999  # largest such factor, where the curve meets itself
JOIN = 64  # poses from one plain end to the other
PARTS = 16  # steps of a straight motion: small boxes, few pairs to compare
SMOOTHING = (1 / 6, 1 / 12, 1 / 18, 1 / 25, 1 / 40)  # widths in time, as shares of it, widest first
REACH = 10  # edges: width of the mean along a curve
NUDGE = 0.1  # edges: how far a proof may stray from the straight motion between two frames


@dataclass(frozen=True)
class SimpleMorph:
    """Frames of a morph that never meet themselves, and whether that is proved between them too."""

    frames: Points  # (f, n, 2), the first and last being the ends
    way: str  # "linear"; "plain" through plainer poses; "joined" through the plain last poses
    # whether a motion from each frame to the next is proved simple at every moment: the straight
    # motion; a motion that strays from it by at most NUDGE of the mean edge length; or, with few
    # frames, the path through the poses. The frames themselves are always tested exactly
    proved: bool


def simple_morph(a: Curve, b: Curve, frames: int, points: int) -> SimpleMorph:
    """Morph curve a into b so that no frame meets itself; return the frames and what is proved.

    frames: their number, ends included; points: of every frame. FinloopError if one curve is open
    and the other closed, or a curve, resampled, meets itself.
    """
    first, second = match_curves(a, b, points)
    closed = a.closed
    for name, ends in (("first", first), ("second", second)):
        meets = count_polygon_folds(ends, closed)[0]
        if meets:
            raise FinloopError(
                f"the {name} curve, at {points} points, meets itself {meets} times",
                "a curve that does not meet itself",
                "correct the drawing, set more points, or use the method linear",
            )
    tau = np.linspace(0, 1, frames)[:, None, None]
    straight = (1 - tau) * first + tau * second
    if not count_polygon_folds(straight, closed).any() and _has_simple_motion(straight, closed):
        return SimpleMorph(straight, "linear", True)
    poses, way = _find_simple_path(first, second, closed)
    stack, on_the_way = _frames_along_path(poses, frames, closed)
    if count_polygon_folds(stack, closed).any():
        raise FinloopError(
            "a morph with frames too narrow to be distinguished from folded frames",
            "curves with some room between their parts",
            "set fewer points (morph.contour_points), or morph.method=linear",
        )
    proved = stays_simple(stack, closed) or (on_the_way and stays_simple(poses, closed))
    return SimpleMorph(stack, way, proved)


def path_lengths(poses: Points) -> Points:
    """Return the mean distance (k,) that the vertices have moved up to each pose (k, n, 2)."""
    steps = np.hypot(*np.moveaxis(np.diff(poses, axis=0), 2, 0)).mean(axis=1)
    return np.r_[0.0, np.cumsum(steps)]


def _find_simple_path(first: Points, second: Points, closed: bool) -> tuple[Points, str]:
    """Find poses (k, n, 2) between two curves (n, 2) without folds; also name the method.

    The name is one of those of `SimpleMorph.way`.
    """
    a, b = _simplify_curve(first, closed), _simplify_curve(second, closed)
    best: tuple[float, Points] | None = None
    for start in _candidate_starts(a, b) if closed else [0]:
        rolled = np.roll(b, -start, axis=1)
        shortest = _find_shortest_path(a, rolled, closed, np.inf if best is None else best[0])
        if shortest:
            far, i, j = shortest
            best = far, np.concatenate([a[: i + 1], rolled[j::-1]])
    if best:
        return best[1], "plain"
    return np.concatenate([a, join_simplified_poses(a[-1], b[-1], closed)[1:-1], b[::-1]]), "joined"


def _candidate_starts(a: Points, b: Points) -> list[int]:
    """Return the points of polygon b that may correspond to the first of a: 0, and the best fits.

    a, b (k, n, 2): poses of both, simplified step by step. Neighbouring start points give similar
    paths, so only local minima of the misfit count.
    """
    starts = [0]
    for share in (0.0, 0.5, 1.0):
        first, second = (poses[int(share * (len(poses) - 1))] for poses in (a, b))
        far = misfit_by_start(first, second)
        least = (far <= np.roll(far, 1)) & (far < np.roll(far, -1))
        starts += [int(s) for s in sorted(np.flatnonzero(least), key=far.__getitem__)[:2]]
    apart = len(far) // 32
    apart_starts: list[int] = []
    for start in starts:
        if all(min((start - s) % len(far), (s - start) % len(far)) > apart for s in apart_starts):
            apart_starts.append(start)
    return apart_starts


def _find_shortest_path(
    a: Points, b: Points, closed: bool, below: float
) -> tuple[float, int, int] | None:
    """Return length, i, j of the shortest path a → a_i → b_j → b without folds.

    a, b (k, n, 2): poses of both curves, simplified step by step. None if no path is shorter than
    `below`. If two poses cannot be joined, all pairs of less simplified poses are skipped too.
    """
    before, after = path_lengths(a), path_lengths(b)
    far = before[:, None] + _pose_distances(a, b) + after
    open_to = far < below

    def is_free(i: int, j: int) -> bool:
        if _straight_motion_is_simple(a[i], b[j], closed):
            return True
        open_to[: i + 1, : j + 1] = False
        return False

    low, high = 0, min(len(a), len(b)) - 1
    while low < high:  # bisection: how plain must both be? This rules out many pairs
        middle = (low + high) // 2
        low, high = (low, middle) if is_free(middle, middle) else (middle + 1, high)
    for way in np.argsort(far, axis=None):
        i, j = divmod(int(way), len(b))
        if open_to[i, j] and is_free(i, j):
            # One pose plainer if that is is_free too: the shortest is_free path almost folds.
            if (
                i + 1 < len(a)
                and j + 1 < len(b)
                and _straight_motion_is_simple(a[i + 1], b[j + 1], closed)
            ):
                return float(far[i, j]), i + 1, j + 1
            return float(far[i, j]), i, j
    return None


def _simplify_curve(points: Points, closed: bool) -> Points:
    """Simplify a curve (n, 2) step by step to a round shape, a triangle or a line: (k, n, 2)."""
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
def _pose_distances(a: Points, b: Points) -> Points:
    """Return the mean vertex distances (k, m) between poses a (k, n, 2) and b (m, n, 2)."""
    far = np.zeros((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            for v in range(a.shape[1]):
                x, y = a[i, v, 0] - b[j, v, 0], a[i, v, 1] - b[j, v, 1]
                far[i, j] += np.sqrt(x * x + y * y)
    return far / a.shape[1]


@kernel
def _straight_motion_is_simple(first: Points, second: Points, closed: bool) -> bool:
    """Return whether a polygon that moves straight to another (n, 2) never meets itself."""
    path = np.empty((PARTS + 1, len(first), 2))
    for k in range(PARTS + 1):
        share = k / PARTS
        for v in range(len(first)):
            for axis in range(2):
                path[k, v, axis] = (1 - share) * first[v, axis] + share * second[v, axis]
    for k in (8, 4, 12, 2, 14):  # most motions that fold do so here: a quick first test
        if count_folds_unchecked(path[k], closed, True):
            return False
    return stays_simple_unchecked(path, closed)


def _frames_along_path(poses: Points, frames: int, closed: bool) -> tuple[Points, bool]:
    """Return frames at constant speed along poses, smoothed in time if they stay simple.

    poses (k, n, 2); frames: their number. Also return whether each frame lies, up to its size, on
    the unsmoothed path.
    """
    on_the_way = True
    along = path_lengths(poses)
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
    return (_limit_areas(even) if closed else even), on_the_way


def _smooth_in_time(stack: Points, width: float) -> Points:
    """Smooth the frames (f, n, 2) of a motion by a Gaussian in time; both ends stay.

    width: its standard deviation in frames. The motion is mirrored beyond its ends.
    """
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


def _limit_areas(stack: Points) -> Points:
    """Scale frames (f, n, 2) so that their areas lie between those of the first and the last."""
    sizes = [signed_area(Curve(pose, True)) for pose in stack]
    goals = np.clip(sizes, min(sizes[0], sizes[-1]), max(sizes[0], sizes[-1]))
    return np.stack(
        [
            pose if size == goal else _resize_polygon(pose, goal)
            for pose, size, goal in zip(stack, sizes, goals, strict=True)
        ]
    )


def _has_simple_motion(stack: Points, closed: bool) -> bool:
    """Return whether it is proved that the motion between frames (f, n, 2) never meets itself.

    An edge that turns round passes through length 0, where it meets its neighbours. So the motion
    may stray slightly, as `SimpleMorph.proved` says, and the edge turns at a positive length.
    """
    for k in range(len(stack) - 1):
        pair = stack[k : k + 2]
        if stays_simple_unchecked(pair, closed):
            continue
        middle = pair.mean(axis=0)
        away = _smooth_contour(middle, closed) - middle
        edge = np.hypot(*np.diff(middle, axis=0).T).mean()
        sizes = (stray * edge / abs(away).max() for stray in (NUDGE / 100, NUDGE / 10, NUDGE))
        detours = (np.stack([pair[0], middle + size * away, pair[1]]) for size in sizes)
        if not any(stays_simple_unchecked(detour, closed) for detour in detours):
            return False
    return True


def _smooth_contour(points: Points, closed: bool) -> Points:
    """Smooth a polygon (n, 2): replace each edge by a mean of the edges near it."""
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


# --- simplifying one curve


def _resize_polygon(points: Points, goal: float) -> Points:
    """Scale a polygon (n, 2) about the mean of its vertices to the signed area `goal`."""
    middle = points.mean(axis=0)
    return middle + (points - middle) * np.sqrt(goal / signed_area(Curve(points, True)))


def shorten_polygon(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from a simple polygon (n, 2) to a round one, and whether it is round.

    All poses have the same area, and no step makes a fold. The last pose is not round if the method
    gives up.
    """
    poses = [np.ascontiguousarray(points, np.float64)]
    edges = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    goal = signed_area(Curve(points, True))
    step, halved = edges.mean() ** 2, 0
    while 4 * np.pi * abs(goal) <= ROUND * edges.sum() ** 2:
        pose = _resize_polygon(_implicit_step(poses[-1], step), goal)
        if stays_simple_unchecked(np.stack([poses[-1], pose]), True):
            poses.append(pose)
            edges = np.hypot(*(np.roll(pose, -1, axis=0) - pose).T)
            step, halved = min(step * GROWTH, STEP * abs(goal)), 0
        elif halved < HALVINGS:
            step, halved = step / 2, halved + 1
        if halved == HALVINGS or len(poses) == MOST:
            return np.stack(poses), False
    return np.stack(poses), True


def _implicit_step(points: Points, step: float) -> Points:
    """Return a polygon (n, 2) after one implicit step of curve shortening, of length `step`.

    It solves (1 + 2 q_i) x_i − q_i (x_{i−1} + x_{i+1}) = points_i, q_i = step / |x_u|². The system
    is tridiagonal but for two corners, which Sherman and Morrison's formula adds.
    """
    edges = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    q = step / ((np.roll(edges, 1) + edges) / 2) ** 2
    corner = -(1 + 2 * q[0])
    ratio = -q[0] / corner
    bands = np.stack([np.roll(-q, 1), 1 + 2 * q, np.roll(-q, -1)])
    bands[1, 0] -= corner
    bands[1, -1] += q[-1] * ratio
    column = np.zeros(len(q))
    column[0], column[-1] = corner, -q[-1]
    solved = scipy.linalg.solve_banded((1, 1), bands, np.column_stack([points, column]))
    share = (solved[0] + ratio * solved[-1]) / (1 + solved[0, 2] + ratio * solved[-1, 2])
    return solved[:, :2] - share[:2] * solved[:, 2:]


def cut_ears(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from a simple polygon (n, 2) to a triangle, and whether it is one.

    Each step straightens one corner (an "ear") and restores the area, so k is n − 2. Only rounding
    can stop the method before the triangle.
    """
    pose = np.ascontiguousarray(points, np.float64)
    goal, n = signed_area(Curve(pose, True)), len(pose)
    poses, corners = [pose], np.arange(n)
    while len(corners) > 3:
        before, after = np.roll(corners, 1), np.roll(corners, -1)
        # Twice the area of each corner's triangle, < 0 outside; small moves come first.
        (x, y), (u, v) = (pose[corners] - pose[before]).T, (pose[after] - pose[corners]).T
        tip = np.sign(goal) * (x * v - y * u)
        for corner in np.argsort(tip):
            first, last = before[corner], after[corner]
            span = np.arange(1, (last - first) % n)  # the vertices between go onto the line
            share = span[:, None] / (len(span) + 1)
            cut = pose.copy()
            cut[(first + span) % n] = pose[first] + (pose[last] - pose[first]) * share
            if tip[corner] >= 0 and stays_simple_unchecked(np.stack([pose, cut]), True):
                break
        else:
            return np.stack(poses), False
        pose, corners = cut, np.delete(corners, corner)
        poses.append(_resize_polygon(pose, goal))
    return np.stack(poses), True


def straighten_curve(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from an open simple curve (n, 2) to a line, and whether it is one.

    Straight means that every edge runs within 45° of the line from end to end.
    """
    points = np.ascontiguousarray(points, np.float64)
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    poses, part, shrink = [points], 1.0, SHRINK
    while not _is_straight(poses[-1]):
        marks = along[-1] * (0.5 + shrink * part * (np.linspace(0, 1, len(points)) - 0.5))
        x, y = (np.interp(marks, along, values) for values in points.T)
        pose = np.stack([x - x.mean(), y - y.mean()], axis=1) / (shrink * part)
        pose += points.mean(axis=0)
        if stays_simple_unchecked(np.stack([poses[-1], pose]), False):
            poses.append(pose)
            part, shrink = shrink * part, max(SHRINK, shrink**2)
        elif shrink < SLOWEST:
            shrink = shrink**0.5
        else:
            return np.stack(poses), False
    return np.stack(poses), True


def _is_straight(points: Points) -> bool:
    """Return whether every edge of an open curve (n, 2) runs within 45° of its chord."""
    edges, chord = np.diff(points, axis=0), points[-1] - points[0]
    ahead, aside = edges @ chord, edges @ [-chord[1], chord[0]]
    return bool((ahead > abs(aside)).all())


def join_simplified_poses(first: Points, second: Points, closed: bool) -> Points:
    """Return JOIN poses from one round or straight pose (n, 2) to another: (JOIN, n, 2).

    Closed: two polygons of one turning sense; open: two lines. From a point that sees a whole plain
    polygon, the vertices lie at increasing angles, less than half a turn apart. This holds for
    every mean of two such polygons, at all radii, so no pose has a fold.
    """
    share = np.linspace(0, 1, JOIN)[:, None]
    ends = first, second
    centres = [area_centroids(end) if closed else end.mean(axis=0) for end in ends]
    a, b = ((end - centre) @ [1, 1j] for end, centre in zip(ends, centres, strict=True))
    if closed:
        angle_a, angle_b = np.unwrap(np.angle(a)), np.unwrap(np.angle(b))
        angle_b = angle_b - 2 * np.pi * np.round((angle_b - angle_a).mean() / (2 * np.pi))
        angle = (1 - share) * angle_a + share * angle_b
        z = ((1 - share) * abs(a) + share * abs(b)) * np.exp(1j * angle)
    else:
        turn = np.angle((b[-1] - b[0]) / (a[-1] - a[0]))
        z = (1 - share) * a * np.exp(1j * share * turn)
        z += share * b * np.exp(1j * (share - 1) * turn)
    middle = centres[0] + share * (centres[1] - centres[0])
    poses = np.stack([z.real, z.imag], axis=-1) + middle[:, None]
    poses[0], poses[-1] = first, second
    return poses
