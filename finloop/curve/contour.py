"""Planar curves, closed or open: area, orientation, equal arc lengths (curve paper §2.2).

x is right and y is down, as on a screen and in SVG. The paper's curves run clockwise; as seen on
such a screen that is the direction of positive `signed_area`.
"""

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.drawing import Curve
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel


def signed_area(curve: Curve) -> float:
    """Return the area within a curve, positive if it runs clockwise on screen.

    In the square of the points' unit; y is down. Clockwise is the paper's orientation (§2.2). An
    open curve is closed by its chord.
    """
    x, y = (curve.points - curve.points[0]).T  # small numbers lose fewer digits
    return float(x @ next_corners(y) - y @ next_corners(x)) / 2


def next_corners(values: Floats) -> Floats:
    """Return values (n, …) at a polygon's corners, shifted: row i is that of the next corner.

    It is numpy.roll(values, -1, axis=0) in a fifth of its time, which short curves notice.
    """
    return np.concatenate([values[1:], values[:1]])


def area_centroids(points: Floats) -> Floats:
    """Return the centroids (…, 2) of the areas of closed polygons (…, n, 2)."""
    corner = points - points[..., :1, :]
    next_corner = np.roll(corner, -1, axis=-2)
    cross = corner[..., 0] * next_corner[..., 1] - corner[..., 1] * next_corner[..., 0]
    moment = ((corner + next_corner) * cross[..., None]).sum(axis=-2)
    return points[..., 0, :] + moment / (3 * cross.sum(axis=-1)[..., None])


def orient_clockwise(curve: Curve) -> Curve:
    """Return the curve, reversed if it is closed and runs anticlockwise on screen; y is down.

    A closed curve keeps its first point; an open curve comes back unchanged.
    """
    if not curve.closed or signed_area(curve) >= 0:
        return curve
    return Curve(np.roll(curve.points[::-1], 1, axis=0), closed=True)


def resample_curve(curve: Curve, n: int) -> Curve:
    """Return a curve as n points at equal distances along its polyline (t(l) = l / L, §2.2).

    A closed curve keeps its first point, an open curve both ends. The new polygon cuts corners, so
    it is never longer than the curve. FinloopError if n is below 3 (closed curve) or 2 (open).
    """
    least = 3 if curve.closed else 2
    if n < least:
        raise FinloopError(
            f"a curve is to be resampled to {n} points", f"at least {least}", "set more points"
        )
    points = np.concatenate([curve.points, curve.points[:1]]) if curve.closed else curve.points
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    marks = np.linspace(0.0, along[-1], n, endpoint=not curve.closed)
    x, y = (np.interp(marks, along, values) for values in points.T)
    return Curve(np.stack([x, y], axis=1), curve.closed)


def nearest_on_curve(points: Floats, curve: Curve) -> tuple[Floats, Floats]:
    """Return the nearest position (m,) on a curve for each point (m, 2), and the gap (m, 2).

    A position is the number of a point of the curve plus the share of the way to the next. A gap
    leads from there to the given point.
    """
    places = np.ascontiguousarray(points, np.float64)
    line = np.ascontiguousarray(curve.points, np.float64)
    return _nearest_places(places, line, curve.closed)


@kernel
def _nearest_places(points: Floats, line: Floats, closed: bool) -> tuple[Floats, Floats]:
    """Return places (m,) and gaps (m, 2) as `nearest_on_curve`, for a curve of points (n, 2)."""
    places, gaps = np.empty(len(points)), np.empty((len(points), 2))
    for k in range(len(points)):
        least = np.inf
        for i in range(len(line) if closed else len(line) - 1):
            j = (i + 1) % len(line)
            edge_x, edge_y = line[j, 0] - line[i, 0], line[j, 1] - line[i, 1]
            x, y = points[k, 0] - line[i, 0], points[k, 1] - line[i, 1]
            length = max(edge_x * edge_x + edge_y * edge_y, 1e-300)
            share = min(max((x * edge_x + y * edge_y) / length, 0.0), 1.0)
            x, y = x - share * edge_x, y - share * edge_y
            if x * x + y * y < least:
                least = x * x + y * y
                places[k], gaps[k, 0], gaps[k, 1] = i + share, x, y
    return places, gaps
