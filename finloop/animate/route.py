"""A path laid out evenly for the player: places along it, and when to be there.

Arc length, in px from its beginning, gives a place of the path. A fish on it is at the point of the
path nearest to it, sought only a little ahead of the nearest point before: where a path crosses
itself the other branch is as near, but much farther along. On a closed path the arc length goes on
from lap to lap.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.kernel import finite_leaf

_BEHIND = 2.0  # times `Route.ahead`: how far a fish may lag behind on a path with times


class Route(NamedTuple):
    """Points x, y (n,) of a path, px, `step` px apart along it; kernels take it whole.

    heading (n,): requested, degrees, without jumps of 360, or empty; closed: whether the path
    returns from the last point to the first; when (ticks,): px along the path due at each tick,
    empty if the fish swims at its own speed; begins: the tick of the first of `when`; ahead: among
    how many points ahead the place nearest to a fish is sought, a tick later.
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
        """Return whether a fish `along_px` along the route is at its end at a tick."""
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
def _points_around(route: Route, along_px: float) -> tuple[int, int, float]:
    """Return the indices of the two route points around `along_px`, and the fraction between them.

    The fraction rises from 0 at the point before to 1 at the one after. At the end of a path that
    is not closed both are its last point. A closed path goes on from lap to lap.
    """
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
def point_along(route: Route, along_px: float) -> tuple[float, float]:
    """Return the point x, y, px, that lies `along_px` along a route."""
    before, after, share = _points_around(route, along_px)
    x = route.x[before] + share * (route.x[after] - route.x[before])
    return x, route.y[before] + share * (route.y[after] - route.y[before])


@finite_leaf
def heading_at(route: Route, along_px: float) -> float:
    """Return the heading, degrees, requested at `along_px` along a route that has headings."""
    before, after, share = _points_around(route, along_px)
    return route.heading[before] + share * (route.heading[after] - route.heading[before])


@finite_leaf
def due_along(route: Route, tick: int) -> float:
    """Return how many px along a route with times a fish should be at a tick."""
    return route.when[min(max(tick - route.begins, 0), route.when.size - 1)]


@finite_leaf
def nearest_search_start(route: Route, along_px: float, tick: int) -> float:
    """Return where on a route, px along it, to begin the search for the point nearest to a fish.

    along_px: of the last nearest point. On a route with times the result is never far behind the
    place due: a late fish takes short cuts.
    """
    if route.when.size:
        return max(along_px, due_along(route, tick) - _BEHIND * route.ahead * route.step)
    return along_px


@finite_leaf
def find_nearest_on_route(
    route: Route, x: float, y: float, along_px: float
) -> tuple[float, float, float]:
    """Return the place on a route nearest to x, y px: px along the route, and its own x, y px.

    It is sought from `along_px` on, and not far ahead: the farther the given point is from the
    route, the farther ahead the nearest one may be, so that a fish that cannot follow a hairpin
    goes on beyond it.
    """
    # First the nearest of the route's points, then the nearest place on the pieces beside it.
    # `position` counts points from the beginning, on a closed path over all laps.
    first_position = int(max(along_px, 0.0) / route.step)
    points_on, index = _find_nearest_point(route, x, y, along_px)
    position, near_x, near_y = float(first_position + points_on), route.x[index], route.y[index]
    least_px2 = 1e300
    for before in range(2):  # the piece of the route after that point, and the one before it
        if before > points_on:
            break
        first = index - before
        first = first + route.x.size if first < 0 else first
        last = first + 1
        if last == route.x.size:
            if not route.closed:
                continue
            last = 0
        dx, dy = route.x[last] - route.x[first], route.y[last] - route.y[first]
        # The point x, y projected onto the piece, as a share of its length.
        share = ((x - route.x[first]) * dx + (y - route.y[first]) * dy) / max(
            dx * dx + dy * dy, 1e-300
        )
        share = min(max(share, 0.0), 1.0)
        on_x, on_y = route.x[first] + share * dx, route.y[first] + share * dy
        square_px2 = (on_x - x) ** 2 + (on_y - y) ** 2
        if square_px2 < least_px2:
            position = first_position + points_on - before + share
            near_x, near_y, least_px2 = on_x, on_y, square_px2
    if position * route.step < along_px:  # a fish never goes back
        near_x, near_y = point_along(route, along_px)
        return along_px, near_x, near_y
    return position * route.step, near_x, near_y


@finite_leaf
def _find_nearest_point(route: Route, x: float, y: float, along_px: float) -> tuple[int, int]:
    """Find the route point nearest to x, y px; return how many points ahead it is, and its index.

    It is sought from the last point before `along_px` on. At least `route.ahead` points are
    searched, more if x, y is far from the route.
    """
    start, _, _ = _points_around(route, along_px)
    points_on, nearest_index, least_px2, index = 0, start, 1e300, start
    on_path_px2 = route.step * route.step
    for i in range(route.x.size):
        beyond = route.step * (i - route.ahead - 1)
        if beyond > 0 and beyond * beyond > 4 * least_px2:
            break  # farther ahead than twice the distance from the route
        square_px2 = (route.x[index] - x) ** 2 + (route.y[index] - y) ** 2
        if square_px2 < least_px2:
            points_on, nearest_index, least_px2 = i, index, square_px2
        elif i > points_on + 1 and least_px2 < on_path_px2:
            break  # a fish on the path is not nearer to it farther ahead
        index += 1
        if index == route.x.size:
            if not route.closed:
                break
            index = 0
    return points_on, nearest_index
