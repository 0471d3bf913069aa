"""Simplifying a simple curve without folds: three methods (for curve paper §4.1).

Each method returns poses from a polygon of n vertices to a plain polygon; vertex i stays vertex i.
Between poses the vertices move straight. A step counts only if it is proved free of contact
(`morph.folds.stays_simple`).

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

`join_plain_ends` morphs one plain end into another.
"""

import numpy as np

from finloop.base.arrays import Points
from finloop.base.kernel import kernel
from finloop.curve.contour import centroid
from finloop.morph.folds import no_contact

GROWTH = 1.3  # factor of the time step, from one pose to the next
STEP = 0.1  # longest time step, in areas of the curve
ROUND = 0.97  # 4π area / length² at which a curve is plain; a circle has 1
HALVINGS = 40  # halvings of a time step before giving up
MOST = 200  # poses
SHRINK = 0.9  # factor of an open curve's length, from one part to the next
SLOWEST = 0.999  # largest such factor, where the curve meets itself
JOIN = 64  # poses from one plain end to the other


@kernel
def area(points: Points) -> float:
    """Return the area within a closed polygon (n, 2), positive if clockwise on screen (y down)."""
    n, twice = len(points), 0.0
    x0, y0 = points[0, 0], points[0, 1]
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        twice += (points[i, 0] - x0) * (points[j, 1] - y0)
        twice -= (points[j, 0] - x0) * (points[i, 1] - y0)
    return twice / 2


@kernel
def resize_polygon(points: Points, goal: float) -> Points:
    """Return a polygon (n, 2) scaled about the mean of its vertices to the area `goal`.

    goal: signed as by `area`, with the same sign as the polygon's area.
    """
    n = len(points)
    size = np.sqrt(goal / area(points))
    out = np.empty_like(points)
    for axis in range(2):
        mean = 0.0
        for i in range(n):
            mean += points[i, axis]
        mean /= n
        for i in range(n):
            out[i, axis] = mean + (points[i, axis] - mean) * size
    return out


def shorten_polygon(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from a simple polygon (n, 2) to a round one, and whether it is round.

    All poses have the same area, and no step makes a fold. The last pose is not round if the method
    gives up.
    """
    poses = [np.ascontiguousarray(points, np.float64)]
    goal = area(poses[0])
    step, halved = (_length(poses[0]) / len(points)) ** 2, 0
    while 4 * np.pi * abs(goal) <= ROUND * _length(poses[-1]) ** 2:
        pose = resize_polygon(_implicit_step(poses[-1], step), goal)
        if no_contact(np.stack([poses[-1], pose]), True):
            poses.append(pose)
            step, halved = min(step * GROWTH, STEP * abs(goal)), 0
        elif halved < HALVINGS:
            step, halved = step / 2, halved + 1
        if halved == HALVINGS or len(poses) == MOST:
            return np.stack(poses), False
    return np.stack(poses), True


@kernel
def _length(points: Points) -> float:
    n, total = len(points), 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        total += np.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
    return total


@kernel
def _implicit_step(points: Points, step: float) -> Points:
    """Solve (1 + 2 q_i) x_i − q_i (x_{i−1} + x_{i+1}) = points_i, q_i = step / |x_u|².

    The system is cyclic and tridiagonal: elimination, with Sherman and Morrison for the corners.
    """
    n = len(points)
    q = np.empty(n)
    behind = np.hypot(points[0, 0] - points[n - 1, 0], points[0, 1] - points[n - 1, 1])
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        ahead = np.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
        q[i] = step / ((behind + ahead) / 2) ** 2
        behind = ahead
    corner = -(1 + 2 * q[0])
    ratio = -q[0] / corner
    upper = np.empty(n)
    solved = np.empty((n, 3))  # x, y and the corners' column
    for i in range(n):
        pivot = 1 + 2 * q[i]
        if i == 0:
            pivot -= corner
        if i == n - 1:
            pivot += q[n - 1] * ratio
        if i > 0:
            pivot += q[i] * upper[i - 1]
        column = corner if i == 0 else (-q[n - 1] if i == n - 1 else 0.0)
        for k in range(3):
            value = points[i, k] if k < 2 else column
            solved[i, k] = (value + (q[i] * solved[i - 1, k] if i > 0 else 0.0)) / pivot
        upper[i] = -q[i] / pivot
    for i in range(n - 2, -1, -1):
        for k in range(3):
            solved[i, k] -= upper[i] * solved[i + 1, k]
    out = np.empty((n, 2))
    share = 1 + solved[0, 2] + ratio * solved[n - 1, 2]
    for k in range(2):
        factor = (solved[0, k] + ratio * solved[n - 1, k]) / share
        for i in range(n):
            out[i, k] = solved[i, k] - factor * solved[i, 2]
    return out


def cut_ears(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from a simple polygon (n, 2) to a triangle, and whether it is one.

    Each step straightens one corner (an "ear") and restores the area, so k is n − 2. Only rounding
    can stop the method before the triangle.
    """
    pose = np.ascontiguousarray(points, np.float64)
    goal = area(pose)
    poses, corners = [pose], np.arange(len(points))
    while len(corners) > 3:
        before, after = np.roll(corners, 1), np.roll(corners, -1)
        # Twice the area of each corner's triangle, < 0 outside; small moves come first.
        (x, y), (u, v) = (pose[corners] - pose[before]).T, (pose[after] - pose[corners]).T
        tip = np.sign(goal) * (x * v - y * u)
        for corner in np.argsort(tip):
            cut = _straighten(pose, before[corner], after[corner])
            if tip[corner] >= 0 and no_contact(np.stack([pose, cut]), True):
                break
        else:
            return np.stack(poses), False
        pose, corners = cut, np.delete(corners, corner)
        poses.append(resize_polygon(pose, goal))
    return np.stack(poses), True


def _straighten(points: Points, first: int, last: int) -> Points:
    """Move the vertices between `first` and `last` onto the line that joins the two."""
    span = (last - first) % len(points)
    share = np.arange(1, span)[:, None] / span
    result = points.copy()
    result[(first + np.arange(1, span)) % len(points)] = (
        points[first] + (points[last] - points[first]) * share
    )
    return result


def straighten_curve(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) from a simple open curve (n, 2) to a straight one, and whether it is.

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
        if no_contact(np.stack([poses[-1], pose]), False):
            poses.append(pose)
            part, shrink = shrink * part, max(SHRINK, shrink**2)
        elif shrink < SLOWEST:
            shrink = shrink**0.5
        else:
            return np.stack(poses), False
    return np.stack(poses), True


def _is_straight(points: Points) -> bool:
    """Return whether every edge of an open curve runs within 45° of its chord."""
    edges, chord = np.diff(points, axis=0), points[-1] - points[0]
    ahead, aside = edges @ chord, edges @ [-chord[1], chord[0]]
    return bool((ahead > abs(aside)).all())


def join_plain_ends(first: Points, second: Points, closed: bool) -> Points:
    """Return JOIN poses from one plain pose (n, 2) to another: (JOIN, n, 2), both included.

    Closed: two polygons of one turning sense; open: two lines. From a point that sees a whole plain
    polygon, the vertices lie at increasing angles, less than half a turn apart. This holds for
    every mean of two such polygons, at all radii, so no pose has a fold.
    """
    share = np.linspace(0, 1, JOIN)
    centres = first.mean(axis=0), second.mean(axis=0)
    if not closed:
        ends = [
            (points - centre) @ [1, 1j]
            for points, centre in zip((first, second), centres, strict=True)
        ]
        turn = np.angle((ends[1][-1] - ends[1][0]) / (ends[0][-1] - ends[0][0]))
        way = [
            ((1 - s) * ends[0] * np.exp(1j * s * turn) + s * ends[1] * np.exp(1j * (s - 1) * turn))
            for s in share
        ]
    else:
        centres = centroid(first), centroid(second)
        radius, angle = [], []
        for points, centre in zip((first, second), centres, strict=True):
            z = (points - centre) @ [1, 1j]
            radius.append(abs(z))
            angle.append(np.unwrap(np.angle(z)))
        apart = (angle[1] - angle[0]).mean()
        angle[1] = angle[1] - 2 * np.pi * np.round(apart / (2 * np.pi))
        way = [
            ((1 - s) * radius[0] + s * radius[1]) * np.exp(1j * ((1 - s) * angle[0] + s * angle[1]))
            for s in share
        ]
    middle = centres[0] + share[:, None] * (centres[1] - centres[0])
    poses = np.stack([np.stack([z.real, z.imag], axis=1) for z in way]) + middle[:, None]
    poses[0], poses[-1] = first, second
    return poses
