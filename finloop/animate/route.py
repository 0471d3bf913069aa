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
NO_ROUTE = Route(
    x=_NONE, y=_NONE, heading=_NONE, step=1.0, closed=False, when=_NONE, begins=0, ahead=0
)


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
    position = max(along_px, 0.0) / route.step
    before = int(position)
    share = position - before
    if route.closed:
        before %= n
        return before, (before + 1 if before + 1 < n else 0), share
    if before >= n - 1:
        return n - 1, n - 1, 0.0
    return before, before + 1, share


@finite_leaf
def point_along(route: Route, along_px: float):  # type: ignore[no-untyped-def]
    """Return the point x, y, px, that lies `along_px` along a route."""
    before, after, share = _places_around(route, along_px)
    x = route.x[before] + share * (route.x[after] - route.x[before])
    return x, route.y[before] + share * (route.y[after] - route.y[before])


@finite_leaf
def heading_at(route: Route, along_px: float) -> float:
    """Return the heading, degrees, requested at `along_px` along a route that has headings."""
    before, after, share = _places_around(route, along_px)
    return route.heading[before] + share * (route.heading[after] - route.heading[before])


@finite_leaf
def due_along(route: Route, tick: int) -> float:
    """Return how many px along a route with times a fish should be at a tick."""
    return route.when[min(max(tick - route.begins, 0), route.when.size - 1)]


@finite_leaf
def foot_search_start(route: Route, along_px: float, tick: int) -> float:
    """Return from how many px along a route to search for the foot of a fish at a tick.

    A foot is the place of the route nearest to the fish. along_px: of its last foot. On a route
    with times the result is never far behind the place due: a late fish takes short cuts.
    """
    if route.when.size:
        return max(along_px, due_along(route, tick) - _BEHIND * route.ahead * route.step)
    return along_px


@finite_leaf
def find_foot(route: Route, x: float, y: float, along_px: float):  # type: ignore[no-untyped-def]
    """Return the foot of a point x, y px: the nearest place of a route, from `along_px` on.

    First the nearest given place is sought, then the nearest point on the pieces beside it. The
    foot is not far ahead of `along_px`: the farther the point is from the route, the farther ahead
    it may be, so that a fish that cannot follow a hairpin goes on beyond it. Returns px along the
    route, and x and y px of the foot.
    """
    n = route.x.size
    lap = int(max(along_px, 0.0) / route.step)
    start, _, _ = _places_around(route, along_px)
    # The nearest place: number `best_k`, `best` places ahead of `along_px`.
    best, best_k, least_px2, place = 0, start, 1e300, start
    on_path_px2 = route.step * route.step
    for i in range(n):
        beyond = route.step * (i - route.ahead - 1)
        if beyond > 0 and beyond * beyond > 4 * least_px2:
            break  # farther ahead than twice the distance from the route
        square_px2 = (route.x[place] - x) ** 2 + (route.y[place] - y) ** 2
        if square_px2 < least_px2:
            best, best_k, least_px2 = i, place, square_px2
        elif i > best + 1 and least_px2 < on_path_px2:
            break  # a fish on the path is not nearer to it farther ahead
        place += 1
        if place == n:
            if not route.closed:
                break
            place = 0
    position, foot_x, foot_y, least_px2 = float(lap + best), route.x[best_k], route.y[best_k], 1e300
    for before in range(2):  # the piece after that place, and the one before
        if before > best:
            break
        place = best_k - before
        place = place + n if place < 0 else place
        next_place = place + 1
        if next_place == n:
            if not route.closed:
                continue
            next_place = 0
        dx, dy = route.x[next_place] - route.x[place], route.y[next_place] - route.y[place]
        share = ((x - route.x[place]) * dx + (y - route.y[place]) * dy) / max(
            dx * dx + dy * dy, 1e-300
        )
        share = min(max(share, 0.0), 1.0)
        near_x, near_y = route.x[place] + share * dx, route.y[place] + share * dy
        square_px2 = (near_x - x) ** 2 + (near_y - y) ** 2
        if square_px2 < least_px2:
            position = lap + best - before + share
            foot_x, foot_y, least_px2 = near_x, near_y, square_px2
    if position * route.step < along_px:
        foot_x, foot_y = point_along(route, along_px)
        return along_px, foot_x, foot_y
    return position * route.step, foot_x, foot_y
