"""What a fish is sent for, to a goal or along a path: how a leg is swum and what is still to come.

A way to a goal is played tick by tick, till it touches. A way along a path is swum in strides:
where the film leads in a stride, turned and shifted as its ticks would be, one by one.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.bounds import beyond, fits
from finloop.animate.company import clear_ahead
from finloop.animate.film import runs
from finloop.animate.kinematics import Spot, bearing, rotate, touches, wrap
from finloop.animate.route import NO_ROUTE, Route, asked_at, place
from finloop.animate.space import LEAD, Rules, Space
from finloop.animate.state import Waters
from finloop.animate.steering import (
    NO_STEERING,
    Steering,
    most_turn,
    near,
    shifted,
    tick_cost,
    turn_to,
)
from finloop.base.arrays import Floats
from finloop.base.axes import ahead_left
from finloop.base.kernel import finite_leaf, kernel, kernel_part, leaf_kernel


class Objective(NamedTuple):
    """What a fish is sent for: a place to touch (aim), or a path to follow, if it has places."""

    aim: Spot
    route: Route
    steering: Steering


def to_goal(aim: Spot) -> Objective:
    """Return the objective to touch a place."""
    return Objective(aim, NO_ROUTE, NO_STEERING)


def along_path(route: Route, steering: Steering) -> Objective:
    """Return the objective to follow a path."""
    return Objective(Spot(0.0, 0.0, 0.0, 0.0, True), route, steering)


# --- to a goal


@leaf_kernel
def remaining(x: float, y: float, heading: float, aim: Spot, rules: Rules):  # type: ignore[no-untyped-def]
    """About how many ticks it is to a point: way / pace + turn / turning; 0 for who wanders."""
    if aim.free:
        return 0.0
    far = np.hypot(aim.x - x, aim.y - y)
    error = abs(wrap(bearing(x, y, aim.x, aim.y) - heading))
    return far / rules.pace + error / rules.turning


@leaf_kernel
def play_leg(space, way, most, here, aim, rules):  # type: ignore[no-untyped-def]
    """Play forward to the first loop end after a stride, or to the aim, for `most` ticks at most.

    `way` is moved on. Returns whether it leads on, and whether it touches the aim. It leads on
    nowhere where the film ends, leaves the tank or meets another fish.
    """
    rows, tick, begun = space.film.rows, here.tick + way.ticks, way.row
    x, y, row = way.x, way.y, way.row
    cos, sin = np.cos(np.radians(way.rot)), np.sin(np.radians(way.rot))
    t, touched = np.int64(0), False
    while t < most:
        at = rows[row]
        if not at.more:
            # The last picture of a track may still be exchanged for another.
            row = row if at.end >= 0 and t > 0 else np.int64(-1)
            break
        x, y = x + at.dx * cos + at.dy * sin, y + at.dy * cos - at.dx * sin
        t, row = t + 1, row + 1
        at = rows[row]
        heading = at.heading + way.rot
        free = fits(space.bounds, row, x, y, heading)
        if not (free and clear_ahead(here.company, row, x, y, heading, tick + t)):
            row = np.int64(-1)
            break
        # A fish that has reached its goal must be able to swim on.
        touched = not aim.free and touches(x, y, heading, aim)
        touched = touched and at.more and rows[row + 1].endless
        if touched or (t >= rules.stride and at.end >= 0):
            break
    first = way.ticks == 0
    way.x, way.y, way.row, way.ticks, way.since = x, y, row, way.ticks + t, way.since + t
    if row < 0 or not rows[row].endless:
        return False, False
    way.cost += here.slow * (rows[row].slow - rows[begun].slow)
    if first:  # the next legs are decided anew
        way.cost += rows[row].dear - rows[begun].dear
    return True, touched


@leaf_kernel
def estimate_ticks_to_aim(space, way, aim, rules):  # type: ignore[no-untyped-def]
    """Return about how many ticks a way still takes to the aim, and to turn from a wall ahead."""
    heading = space.film.rows[way.row].heading + way.rot
    aside = rules.aside * beyond(space.bounds, way.x, way.y, heading, rules.room)
    return remaining(way.x, way.y, heading, aim, rules) + aside


# --- along a path


@finite_leaf
def at_path_end(route, along):  # type: ignore[no-untyped-def]
    """Return whether a way that has come so far along a path, px, is at its end.

    Closed paths have none; those with times end with these.
    """
    if route.closed or route.when.size:
        return False
    return along >= route.step * (route.x.size - 1)


def reach_of(waters: Waters) -> int:
    """Ticks that a fish which follows a path looks ahead, to steer."""
    return max(2, waters.ticks(waters.settings.path_reach))


def footage_of(space: Space, reach: int, stride: int) -> Space:
    """Return the space of a search along paths, `reach` ticks ahead, with jumps after a stride."""
    rows = space.film.rows
    here, run = np.arange(len(rows)), runs(rows["more"])
    ends = np.append(np.flatnonzero(rows["end"] >= 0), 2 * len(rows))
    leg = np.minimum(run, ends[np.searchsorted(ends, here + stride)] - here)
    leads = np.zeros(len(rows), LEAD)
    leads["ticks"] = np.minimum(run, reach)
    for part, ticks in (("", leads["ticks"]), ("half_", leads["ticks"] // 2)):
        offset = np.column_stack([rows[axis][here + ticks] - rows[axis] for axis in "xy"])
        leads[part + "ahead"], leads[part + "left"] = ahead_left(
            offset, np.radians(rows["heading"])
        ).T
        leads[part + "far"] = np.hypot(*offset.T)
        if not part:
            leads["dx"], leads["dy"] = offset.T
    return space._replace(run=run, leg=leg, leads=leads)


@kernel_part
def timed_targets(route, tick, ticks):  # type: ignore[no-untyped-def]
    """Return where a path with times asks the fish to be, x, y (ticks + 1, 2) px, from a tick on.

    (0, 2) of a path without times.
    """
    count = ticks + 1 if route.when.size else 0
    asked = np.empty((count, 2))
    for t in range(count):
        asked[t, 0], asked[t, 1] = place(route, asked_at(route, tick + t))
    return asked


@finite_leaf
def _stride(space, route, way, ticks, here, by):  # type: ignore[no-untyped-def]
    """Swim so many ticks in one step: whether they can be swum. by: rules, steering.

    `way` is moved on.
    """
    rows, row, steering = space.film.rows, way.row, by[1]
    at, after, lead = rows[row], rows[row + ticks], space.leads[row]
    angle = np.radians(way.rot)
    cos, sin = np.cos(angle), np.sin(angle)
    leads = lead.dx * cos + lead.dy * sin, lead.dy * cos - lead.dx * sin
    speed, tick = (at.speed + after.speed) / 2, here.tick + way.ticks + ticks
    most = most_turn(speed, steering)
    turn = turn_to(route, (way.x, way.y, way.along), leads, lead.ticks, most, steering)
    dx, dy = rotate(after.x - at.x, after.y - at.y, way.rot + turn * ticks / 2)
    begun = way.x + dx, way.y + dy, way.along
    x, y, along, fx, fy, shift = shifted(route, begun, speed, (tick, ticks), steering)
    rot = way.rot + turn * ticks
    heading = after.heading + rot
    if not fits(space.bounds, row + ticks, x, y, heading):
        return False
    if not clear_ahead(here.company, row + ticks, x, y, heading, tick):
        return False
    used = turn / steering.turn, shift / max(steering.shift * speed * ticks, 1e-9)
    cost = tick_cost(route, (x, y, heading), (along, fx, fy), used, tick, steering)
    way.x, way.y, way.along, way.rot, way.cost = x, y, along, rot, way.cost + cost * ticks
    way.row, way.since, way.ticks = row + ticks, way.since + ticks, way.ticks + ticks
    return True


@leaf_kernel
def swim_leg(space, route, way, most, here, by):  # type: ignore[no-untyped-def]
    """Swim a leg along a path, so many ticks at most: whether it leads on. by: rules, steering.

    `way` is moved on.
    """
    rows, left = space.film.rows, min(space.leg[way.row], most)
    if left == 0:
        return False
    while left > 0:
        ticks = min(by[0].stride, left)
        if not _stride(space, route, way, ticks, here, by):
            return False
        left -= ticks
    return rows[way.row].endless


@finite_leaf
def direction(at, way):  # type: ignore[no-untyped-def]
    """The cosine and sine of the heading of a way that shows a row."""
    angle = np.radians(at.heading + way.rot)
    return np.cos(angle), np.sin(angle)


@finite_leaf
def estimate_next_cost(lead, way, turned, route, by):  # type: ignore[no-untyped-def]
    """About what the next ticks cost, in ticks, if a row is played on from where a way has come to.

    By the places that it leads to, less what can be corrected on the way there: by Simpson's rule.
    turned: of the heading there; by: where the fish is asked to be, steering.
    """
    half, steering = lead.ticks // 2, by[1]
    middle = _off(way, (lead.half_ahead, lead.half_left, lead.half_far, half), turned, route, by)
    end = _off(way, (lead.ahead, lead.left, lead.far, lead.ticks), turned, route, by)
    price = steering.late if route.when.size else steering.across
    return price * lead.ticks * (4.0 * middle + end) / 6.0


@finite_leaf
def _off(way, lead, turned, route, by):  # type: ignore[no-untyped-def]
    """How far off the path a lead comes, less what can be corrected, as `near` counts it.

    lead: px ahead, to the left, as the crow flies, and ticks.
    """
    (ahead, left, far, ticks), (cos, sin), (asked, steering) = lead, turned, by
    x, y = way.x + ahead * cos - left * sin, way.y - ahead * sin - left * cos
    if route.when.size:
        to_x, to_y = asked[way.ticks + ticks, 0], asked[way.ticks + ticks, 1]
    else:
        to_x, to_y = place(route, way.along + far)
    off = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2) - far * np.radians(steering.turn) * ticks / 2
    return near(max(off, 0.0) ** 2, steering.length_px**2)


@kernel
def onward(space: Space, begins: Floats, row: int, rot: float, ticks: int) -> Floats:
    """A way (k, 3) whose last place shows a row, and on by the film: (k + m, 3), m ≤ ticks."""
    k, more = len(begins), min(ticks, space.run[row])
    way = np.empty((k + more, 3))
    for i in range(k):  # `way[:k] = begins` takes six seconds to compile
        for c in range(3):
            way[i, c] = begins[i, c]
    rows = space.film.rows
    for t in range(1, more + 1):
        dx, dy = rotate(rows[row + t].x - rows[row].x, rows[row + t].y - rows[row].y, rot)
        way[k + t - 1, 0], way[k + t - 1, 1] = begins[k - 1, 0] + dx, begins[k - 1, 1] + dy
        way[k + t - 1, 2] = rows[row + t].heading + rot
    return way
