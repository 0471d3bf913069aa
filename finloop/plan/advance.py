"""How a fish moves along rows of the film: as a search looks, and as it is shown."""

from typing import NamedTuple

import numpy as np

from finloop.animate.company import clear_ahead
from finloop.animate.kinematics import ahead, bearing, rotate, touches, towards_by
from finloop.animate.route import (
    Route,
    asked_at,
    done,
    foot,
    least_along,
    place,
)
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import finite_leaf, kernel, leaf_kernel
from finloop.loops.positions import next_end
from finloop.plan.cost import (
    CostWeights,
    Steering,
    tick_cost,
)
from finloop.plan.graph import MotionGraph
from finloop.plan.space import SearchGraph
from finloop.plan.walls import fits, moved_off

_ONWARD = 0.1  # body lengths; a place ahead that is nearer is steered to as if it were so far


@finite_leaf
def most_turn(speed: float, steering: Steering) -> float:
    """By how much a fish of some speed, body lengths/s, is turned in a tick at most, degrees."""
    return steering.turn * min(speed / steering.brisk, 1.0)


@finite_leaf
def turn_to(route: Route, at, leads, ticks: int, most: float, steering: Steering) -> float:  # type: ignore[no-untyped-def]
    """By how much to turn now, degrees, + = left; at most by `most`.

    at: x, y, along; leads: px on the screen (dx, dy) to where the fish will be in so many ticks.
    """
    dx, dy = leads
    far = np.sqrt(dx * dx + dy * dy)
    if ticks < 1 or far < 1e-6 * steering.length_px:
        return 0.0
    x, y = place(route, at[2] + far)
    vx, vy = x - at[0], y - at[1]
    aside = (dy * vx - dx * vy) / far
    onward = max((dx * vx + dy * vy) / far, _ONWARD * steering.length_px)
    # Turning evenly, the place ahead moves as if half of the turn had been made at once.
    want = 2.0 * np.degrees(aside / onward) / ticks
    return min(max(want, -most), most)


@finite_leaf
def shifted(route: Route, at, speed: float, when, steering: Steering):  # type: ignore[no-untyped-def]
    """Shift a fish towards the path, and along it where it is too early or too late.

    at: x, y, along; speed: body lengths/s that the film's fish swims; when: the tick of that place,
    ticks since the last shift. Returns its x, y, along, the x and y of its foot, and px of the
    shift.
    """
    (x, y, along), (tick, ticks) = at, when
    along, fx, fy = foot(route, x, y, least_along(route, along, tick))
    tx, ty, most = fx, fy, steering.shift * speed * ticks
    share = min(ticks / steering.reach, 1.0)
    if route.when.size:
        late = min(max((asked_at(route, tick) - along) * share, -most), most)
        tx, ty = place(route, along + late / share)
    cx, cy = (tx - x) * share, (ty - y) * share
    far = np.sqrt(cx * cx + cy * cy)
    if far > most:
        cx, cy, far = cx * most / far, cy * most / far, most
    return x + cx, y + cy, along, fx, fy, far


@kernel
def steered(way: Floats, speed: Floats, numbers: Ints, begins, route: Route, by):  # type: ignore[no-untyped-def]
    """Steer a way (m + 1, 3), x, y, heading, the fish's own place first, for t ≤ m ticks.

    It ends with the path, on the tick that comes to its end.

    speed (m,): body lengths/s; numbers (t,): of the pictures; begins: how far along the path, and
    at which tick; by: `Bounds`, `Steering`.

    Returns
    -------
    The way as it is swum (n, 3), up to where the path ends, or it leaves the tank; its corrections
    (n, 2): degrees, px; how far along the path it ends.
    """
    ticks = numbers.size
    out, used = np.empty((ticks, 3)), np.empty((ticks, 2))
    (along, tick), (bounds, steering) = begins, by
    x, y, rot, good = way[0, 0], way[0, 1], 0.0, ticks
    for t in range(ticks):
        reach = min(steering.reach, len(way) - 1 - t)
        leads = rotate(way[t + reach, 0] - way[t, 0], way[t + reach, 1] - way[t, 1], rot)
        most = most_turn(speed[t], steering)
        turn = turn_to(route, (x, y, along), leads, reach, most, steering)
        dx, dy = rotate(way[t + 1, 0] - way[t, 0], way[t + 1, 1] - way[t, 1], rot + turn)
        new_x, new_y, on, _, _, shift = shifted(
            route, (x + dx, y + dy, along), speed[t], (tick + t + 1, 1), steering
        )
        heading = way[t + 1, 2] + rot + turn
        if not fits(bounds, numbers[t], new_x, new_y, heading):
            good = t
            break
        x, y, along, rot = new_x, new_y, on, rot + turn
        out[t, 0], out[t, 1], out[t, 2] = x, y, heading
        used[t, 0], used[t, 1] = turn, shift
        if done(route, along, tick + t + 1):
            good = t + 1
            break
    return out[:good], used[:good], along


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


@kernel
def onward(space: SearchGraph, begins: Floats, row: int, rot: float, ticks: int) -> Floats:
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


@leaf_kernel
def arrival(film: MotionGraph, x: float, y: float, row: int, rot: float) -> tuple[float, float]:
    """Where a fish at x, y that shows a row is at the next tick."""
    dx, dy = rotate(film.rows[row].dx, film.rows[row].dy, rot)
    return x + dx, y + dy


@kernel
def play(  # type: ignore[no-untyped-def]
    film: MotionGraph, start: tuple[float, float, float], row: int, towards, rules: CostWeights
):
    """Play from a row to the next loop end after a stride, or to a touch.

    start: x, y, and by how much the row is turned; towards: the goal, and the aim on the way there.

    Returns
    -------
    way (n, 3) : x, y, heading of each row that is shown; whether the last one touches the goal; px
    on the screen (dx, dy) that the film leads to by its next loop end (Fig. 11).
    """
    (x, y, rot), (goal, aim) = start, towards
    stop = next_end(film.rows["more"], film.rows["end"], row, rules.stride)
    leads = rotate(film.rows[stop].x - film.rows[row].x, film.rows[stop].y - film.rows[row].y, rot)
    out = np.empty((rules.horizon, 3))
    n = 0
    while True:
        at, next_row = film.rows[row], film.rows[row + 1]
        heading = at.heading + rot
        out[n, 0], out[n, 1], out[n, 2] = x, y, heading
        n += 1
        goes_on = at.more and next_row.endless and not goal.free
        touched = goes_on and touches(x, y, heading, goal)
        # The way was looked at no farther than the aim, and the horizon.
        stops = touched or (goes_on and touches(x, y, heading, aim)) or n >= rules.horizon
        stops = stops or (n >= rules.stride and next_row.end >= 0) or not next_row.more
        if stops:
            return out[:n], touched, leads
        dx, dy = rotate(at.dx, at.dy, rot)
        x, y, row = x + dx, y + dy, row + 1


class Pace(NamedTuple):
    """How far a state moves a fish.

    px: per tick at one body length/s; turn_deg: per tick at one rad/s.
    """

    px: float
    turn_deg: float


@leaf_kernel
def moved(place, state, pace):  # type: ignore[no-untyped-def]
    """The next place (x, y, heading) of a fish whose next state is this one."""
    x, y = ahead(place[0], place[1], place[2], state[-3] * pace.px, state[-2] * pace.px)
    return x, y, place[2] + state[-1] * pace.turn_deg


@kernel
def held(bounds, states, row, start, towards, most_deg):  # type: ignore[no-untyped-def]
    """The way (n, 3) of states (n, d) after a row, along a wall; the tick of the touch, n for none.

    Every tick turns towards the aim, by `most_deg` at most; no tick turns faster for it than that,
    or than the state itself. start: x, y, heading; towards: goal, aim, `Pace`.
    """
    goal, aim, pace = towards
    n = len(states)
    way = np.empty((n, 3))
    x, y, heading, reached = start[0], start[1], start[2], n
    for t in range(n):
        to_x, to_y, turned = moved((x, y, heading), states[t], pace)
        error = bearing(x, y, aim.x, aim.y) - heading
        heading += towards_by(turned - heading, error, most_deg)
        x, y, _ = moved_off(bounds, row + 1 + t, to_x, to_y, heading)
        way[t, 0], way[t, 1], way[t, 2] = x, y, heading
        if reached == n and not goal.free and touches(x, y, heading, goal):
            reached = t
    return way, reached


@kernel
def course(bounds, states, row, start, goal, pace):  # type: ignore[no-untyped-def]
    """The way (n, 3) of states (n, d) from `start`; how many ticks of it fit; the touch, n.

    Angles in degrees; row: the one that is followed.
    """
    n = len(states)
    way = np.empty((n, 3))
    place, good, reached = (start[0], start[1], start[2]), n, n
    for t in range(n):
        place = moved(place, states[t], pace)
        way[t, 0], way[t, 1], way[t, 2] = place
        fit = fits(bounds, row + 1 + t, place[0], place[1], place[2])
        if good == n and not fit:
            good = t
        if reached == n and not goal.free and touches(place[0], place[1], place[2], goal):
            reached = t
    return way, good, reached
