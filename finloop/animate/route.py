"""A path laid out evenly for the player: places along it, and when to be there.

Arc length, in px from its beginning, gives a place of the path. A fish on it is at a *foot*, the
place of the path nearest to it a little ahead of the foot before: where a path crosses itself the
other branch is as near, but much farther along. On a closed path the arc length goes on from lap to
lap.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.kernel import finite_leaf

_BEHIND = 2.0  # times `Route.ahead`: how far behind a foot may be on a path with times


class Route(NamedTuple):
    """Places x, y (n,) of a path, px, `step` px apart along it; kernels take it whole.

    heading (n,): requested, degrees, without jumps of 360, or empty; closed: whether the path
    returns from the last place to the first; when (ticks,): px along the path due at each tick,
    empty if the fish swims at its own speed; begins: the tick of the first of `when`; ahead: places
    within which a foot moves on in a tick.
    """

    x: Floats
    y: Floats
    heading: Floats
    step: float
    closed: bool
    when: Floats
    begins: int
    ahead: int

    @property
    def length(self) -> float:
        """Return the length of the path, or of one lap, in px."""
        return self.step * (len(self.x) - (not self.closed))

    @property
    def is_timed(self) -> bool:
        """Return whether the route says at which tick the fish should be where."""
        return len(self.when) > 0

    def is_done(self, along_px: float, tick: int) -> bool:
        """Return whether a fish `along_px` along the route is at its end at a tick.

        On a route with times only the time counts; a closed route without times has no end.
        """
        return bool(is_route_done(self, along_px, tick))


_NONE = np.zeros(0)
NO_ROUTE = Route(_NONE, _NONE, _NONE, 1.0, False, _NONE, 0, 0)


@finite_leaf
def is_route_done(route: Route, along_px: float, tick: int) -> bool:
    """Return whether a fish `along_px` along a route is at its end at a tick.

    On a route with times only the time counts; a closed route without times has no end.
    """
    if route.when.size:
        return tick >= route.begins + route.when.size - 1
    return not route.closed and along_px >= route.step * (route.x.size - 1 - 1e-6)


@finite_leaf
def _places_around(route: Route, along_px: float):  # type: ignore[no-untyped-def]
    """Return the numbers of the places before and after `along_px`, and the share between them."""
    n = route.x.size
    u = max(along_px, 0.0) / route.step
    k = int(u)
    share = u - k
    if route.closed:
        k %= n
        return k, (k + 1 if k + 1 < n else 0), share
    if k >= n - 1:
        return n - 1, n - 1, 0.0
    return k, k + 1, share


@finite_leaf
def point_along(route: Route, along_px: float):  # type: ignore[no-untyped-def]
    """Return the point x, y, px, that lies `along_px` along a route."""
    a, b, share = _places_around(route, along_px)
    x = route.x[a] + share * (route.x[b] - route.x[a])
    return x, route.y[a] + share * (route.y[b] - route.y[a])


@finite_leaf
def heading_at(route: Route, along_px: float) -> float:
    """Return the heading, degrees, requested at `along_px` along a route that has headings."""
    a, b, share = _places_around(route, along_px)
    return route.heading[a] + share * (route.heading[b] - route.heading[a])


@finite_leaf
def due_along(route: Route, tick: int) -> float:
    """Return how many px along a route with times a fish should be at a tick."""
    return route.when[min(max(tick - route.begins, 0), route.when.size - 1)]


@finite_leaf
def foot_search_start(route: Route, along_px: float, tick: int) -> float:
    """Return from how many px along a route to search for the foot of a fish at a tick.

    along_px: of its last foot. On a route with times the result is never far behind the place due:
    a late fish takes short cuts.
    """
    if route.when.size:
        return max(along_px, due_along(route, tick) - _BEHIND * route.ahead * route.step)
    return along_px


@finite_leaf
def find_foot(route: Route, x: float, y: float, along_px: float):  # type: ignore[no-untyped-def]
    """Return the foot of a point x, y px: the nearest place of a route, from `along_px` on.

    The foot is not far ahead of `along_px`. The farther the point is from the route, the farther
    ahead it may be, so that a fish that cannot follow a hairpin goes on beyond it. Returns px along
    the route, and x and y px of the foot.
    """
    n = route.x.size
    lap = int(max(along_px, 0.0) / route.step)
    k, _, _ = _places_around(route, along_px)
    best, best_k, least, a = 0, k, 1e300, k
    beside = route.step * route.step
    for i in range(n):
        beyond = route.step * (i - route.ahead - 1)
        if beyond > 0 and beyond * beyond > 4 * least:
            break
        far = (route.x[a] - x) ** 2 + (route.y[a] - y) ** 2
        if far < least:
            best, best_k, least = i, a, far
        elif i > best + 1 and least < beside:
            break  # a fish on the path is not nearer to it farther ahead
        a += 1
        if a == n:
            if not route.closed:
                break
            a = 0
    found, fx, fy, least = float(lap + best), route.x[best_k], route.y[best_k], 1e300
    for back in range(2):
        if back > best:
            break
        a = best_k - back
        a = a + n if a < 0 else a
        b = a + 1
        if b == n:
            if not route.closed:
                continue
            b = 0
        dx, dy = route.x[b] - route.x[a], route.y[b] - route.y[a]
        share = ((x - route.x[a]) * dx + (y - route.y[a]) * dy) / max(dx * dx + dy * dy, 1e-300)
        share = min(max(share, 0.0), 1.0)
        px, py = route.x[a] + share * dx, route.y[a] + share * dy
        far = (px - x) ** 2 + (py - y) ** 2
        if far < least:
            found, fx, fy, least = lap + best - back + share, px, py, far
    if found * route.step < along_px:
        fx, fy = point_along(route, along_px)
        return along_px, fx, fy
    return found * route.step, fx, fy
