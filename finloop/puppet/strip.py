"""Strips of picture along a backbone: cross-sections, and how bends squeeze them.

A place of the strip is (i, t): i counts steps of the backbone from head to tail, t [px] lies beside
it. A pose puts it at B(i) + o N(i), where o is t, squeezed on the inner side of a bend. There a
cross-section ends on the medial axis (Blum 1967), where another part of the backbone is as near: so
no two cross-sections meet, and no place is drawn twice.
"""

import math
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.kernel import finite_kernel

BEYOND = 10
"""Straight steps of a strip beyond either end of its backbone, where pale fins are."""

HIDDEN = 1e9
"""The distance [px] of a place that a pose does not show."""

LEAST = 1e-6
"""The length [px] of a cross-section that shows nothing."""

_FREE = 0.5  # inner share of a cross-section that is not squeezed


class PlacedBackbone(NamedTuple):
    """The backbone of one animal in a picture; its fields are those of `puppet.pose.Pose`."""

    x_px: float
    y_px: float
    heading_rad: float
    size_px: float
    posture: Floats


class Strip(NamedTuple):
    """The m cross-sections of a body along its backbone of n steps, and beyond its ends.

    points: (m, 2) px on the backbone or beyond its ends, head first; normals: (m, 2) unit vectors
    to the animal's left; limits: (m, 2) px, how long a section is on its left and right.
    """

    points: Floats
    normals: Floats
    limits: Floats


@finite_kernel
def cross_sections(line: PlacedBackbone) -> Strip:
    """Return the cross-sections of a body, along its backbone and straight on beyond its ends."""
    # A posture holds how far ahead and to the left of the mass centre the head is, and for each of
    # n steps of the backbone its direction (radians from the heading) and length.
    n = len(line.posture) // 2 - 1
    ahead, left = line.posture[0] * line.size_px, line.posture[1] * line.size_px
    bends, steps = line.posture[2 : 2 + n], line.posture[2 + n :]
    m = n + 1 + 2 * BEYOND
    points, normals = np.empty((m, 2)), np.empty((m, 2))
    cos, sin = math.cos(line.heading_rad), math.sin(line.heading_rad)
    # The head, from the mass centre; y is down.
    x, y = line.x_px + cos * ahead - sin * left, line.y_px - sin * ahead - cos * left
    for i in range(BEYOND + 1):  # straight on before the head, and the head itself
        cos, sin = math.cos(line.heading_rad + bends[0]), math.sin(line.heading_rad + bends[0])
        away = (BEYOND - i) * steps[0] * line.size_px
        points[i, 0], points[i, 1] = x + away * cos, y - away * sin
        normals[i, 0], normals[i, 1] = -sin, -cos
    for i in range(BEYOND + 1, m):  # step by step to the tail, and straight on behind it
        before, after = min(i - BEYOND - 1, n - 1), min(i - BEYOND, n - 1)
        angle, step = line.heading_rad + bends[before], steps[before] * line.size_px
        points[i, 0] = points[i - 1, 0] - step * math.cos(angle)
        points[i, 1] = points[i - 1, 1] + step * math.sin(angle)
        angle += (bends[after] - bends[before]) / 2  # midway between the steps before and after
        normals[i, 0], normals[i, 1] = -math.sin(angle), -math.cos(angle)
    return Strip(points, normals, _section_limits(points, normals))


@finite_kernel
def _section_limits(points: Floats, normals: Floats) -> Floats:
    """Return how far (m, 2) [px], left and right, cross-sections extend before two of them meet.

    points, normals (m, 2): of the sections; normals point to the animal's left. A limit is the
    radius of the largest circle that touches the backbone at one point. The circle that touches
    B(i) with its normal N(i) and passes through B(j), d = B(j) − B(i), has the radius
    |d|² / (2 d·N(i)): the least one over all j counts, and at most HIDDEN. The first and last
    BEYOND sections lie beyond the ends of the body. Those that are nearer to another part of the
    backbone get the length LEAST, so that nothing is drawn there.
    """
    m = len(points)
    head = np.int64(BEYOND)  # a literal would compile `_is_nearest_to_end` again
    tail = m - 1 - BEYOND
    first, last = head, tail
    while first > 0 and _is_nearest_to_end(points, first - 1, head):
        first -= 1
    while last < m - 1 and _is_nearest_to_end(points, last + 1, tail):
        last += 1
    curvatures = np.full((m, 2), 1 / LEAST)  # 1 / radius
    for i in range(first, last + 1):
        curvatures[i, :] = 1 / HIDDEN
        for j in range(first, last + 1):
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            distance_square = dx * dx + dy * dy + LEAST**2  # not 0 at j = i
            curvature = 2 * (dx * normals[i, 0] + dy * normals[i, 1]) / distance_square
            curvatures[i, 0], curvatures[i, 1] = (
                max(curvatures[i, 0], curvature),
                max(curvatures[i, 1], -curvature),
            )
    return 1 / curvatures


@finite_kernel
def _is_nearest_to_end(points: Floats, i: int | np.int64, end: int | np.int64) -> bool:
    """Return whether the nearest backbone point of point i, beyond an end, is that end.

    end: row of the head or tail end. 1 % is tolerated.
    """
    to_end = (points[end, 0] - points[i, 0]) ** 2 + (points[end, 1] - points[i, 1]) ** 2
    for j in range(BEYOND, len(points) - BEYOND):
        to_other = (points[j, 0] - points[i, 0]) ** 2 + (points[j, 1] - points[i, 1]) ** 2
        if to_other < 0.99 * to_end:
            return False
    return True


@finite_kernel
def squeeze_offset(t: float, limit: float) -> float:
    """Return the offset [px] from a bent backbone at which a point t ≥ 0 [px] beside it is drawn.

    On the inner side of a bend there is less room: limit [px] is the length of the cross-section.
    With f = r = limit / 2 the result is t up to f; beyond it f + r (q − q²/4), q = (t − f) / r,
    which leaves f with slope 1 and reaches the limit, with slope 0, at q = 2. What lies farther out
    is hidden.
    """
    unsqueezed = _FREE * limit
    if t <= unsqueezed:
        return t
    free_room = limit - unsqueezed
    share = (t - unsqueezed) / free_room
    return unsqueezed + free_room * (share - share * share / 4) if share < 2 else HIDDEN


@finite_kernel
def unsqueeze_offset(o: float, limit: float) -> float:
    """Return the offset t [px] that `squeeze_offset` turns into o: beside a straight backbone.

    limit: length [px] of the cross-section; from there on the result is HIDDEN. With f = r = limit
    / 2 the result is o up to f; beyond it f + 2 r (1 − √(1 − (o − f) / r)).
    """
    unsqueezed = _FREE * limit
    if o <= unsqueezed:
        return o
    free_room = limit - unsqueezed
    share = (o - unsqueezed) / free_room
    return unsqueezed + free_room * 2 * (1 - math.sqrt(1 - share)) if share < 1 else HIDDEN
