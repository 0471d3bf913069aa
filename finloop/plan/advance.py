"""How a fish moves along rows of the film, in the search and on screen."""

from typing import NamedTuple

import numpy as np

from finloop.animate.company import clear_ahead
from finloop.animate.kinematics import offset_point, rotate, touches, turn_by, wrap
from finloop.animate.route import Route, asked_at, done, foot, least_along, place
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import finite_leaf, kernel, leaf_kernel
from finloop.plan.cost import LAG, PATH, RARITY, Steering, tick_cost
from finloop.plan.graph import jumps_of
from finloop.plan.objectives import is_done
from finloop.plan.search_graph import SearchGraph
from finloop.plan.walls import fits

_ONWARD = 0.1  # body lengths; the least distance at which a place ahead is steered to


@finite_leaf
def most_turn(speed: float, steering: Steering) -> float:
    """Return the largest steering correction of a tick, degrees, at a speed in body lengths/s."""
    return steering.turn * min(speed / steering.brisk, 1.0)


@finite_leaf
def turn_to(route: Route, at, leads, ticks: int, most: float, steering: Steering) -> float:  # type: ignore[no-untyped-def]
    """Return the steering turn of this tick, degrees, + = left, between −`most` and `most`.

    at: x, y px and px along the path; leads (dx, dy): px on the screen to where the film leads the
    fish in `ticks` ticks. The fish turns towards the place of the path equally far ahead.
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
def shift_to_path(route: Route, at, speed: float, when, steering: Steering):  # type: ignore[no-untyped-def]
    """Shift a fish towards the path, and along it where it is too early or too late.

    at: x, y px and px along the path; speed: of the film's fish, body lengths/s; when: the tick of
    that place, and the ticks since the last shift. Returns its new x, y px; px along the path, x
    and y of its foot, the place of the path nearest to it before the shift; and px of the shift.
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
def advance(way: Floats, speed: Floats, rows: Ints, begins, towards, graph: SearchGraph):  # type: ignore[no-untyped-def]
    """Move along a planned way: steer to the path, and stop at the goal, the path's end or a wall.

    Without a path the way ends when it touches the goal, or the waypoint that the fish heads for.
    way (m + 1, 3): x, y px, heading, the fish's own place first, of which t ≤ m ticks count; speed
    (m,): body lengths/s; rows (t,): that are shown; begins: px along the path, and the tick;
    towards: the `Objective`, and the goal.

    Returns the final way (n, 3), up to where it is done or leaves the tank; its steering
    corrections (n, 2): degrees, px; px along the path at its end; whether the last place touches
    the goal.
    """
    objective, goal = towards
    ticks, route, steering = rows.size, objective.route, objective.steering
    out, used, film = np.empty((ticks, 3)), np.zeros((ticks, 2)), graph.film.rows
    along, tick = begins
    x, y, rot, good, touched = way[0, 0], way[0, 1], 0.0, ticks, False
    for t in range(ticks):
        turn, shift, row = 0.0, 0.0, rows[t]
        if route.x.size:
            reach = min(steering.reach, len(way) - 1 - t)
            leads = rotate(way[t + reach, 0] - way[t, 0], way[t + reach, 1] - way[t, 1], rot)
            most = most_turn(speed[t], steering)
            turn = turn_to(route, (x, y, along), leads, reach, most, steering)
        dx, dy = rotate(way[t + 1, 0] - way[t, 0], way[t + 1, 1] - way[t, 1], rot + turn)
        new_x, new_y, on, heading = x + dx, y + dy, along, way[t + 1, 2] + rot + turn
        if route.x.size:
            new_x, new_y, on, _, _, shift = shift_to_path(
                route, (new_x, new_y, along), speed[t], (tick + t + 1, 1), steering
            )
        if not fits(graph.bounds, row, new_x, new_y, heading):
            good = t
            break
        x, y, along, rot = new_x, new_y, on, rot + turn
        out[t, 0], out[t, 1], out[t, 2] = x, y, heading
        used[t, 0], used[t, 1] = turn, shift
        if route.x.size:
            ends = done(route, along, tick + t + 1)
        else:
            goes_on = film[row].has_next and film[row + 1].recurrent
            touched = not goal.free and goes_on and touches(x, y, heading, goal)
            ends = touched or (not goal.free and touches(x, y, heading, objective.aim))
        if ends:
            good = t + 1
            break
    return out[:good], used[:good], along, touched


@kernel
def advance_film(graph: SearchGraph, fish: Floats, shown: int, run, begins, towards):  # type: ignore[no-untyped-def]
    """Move a fish along a run of film from its next tick on, as `advance` does.

    fish (4,): x, y px, heading, and degrees by which row `shown`, now on screen, is turned; run:
    first row and ticks. Returns what `advance` returns, and the discontinuity of the run's first
    row in natural steps, NaN where the film plays on.
    """
    (row, ticks), film, rot, seam = run, graph.film, fish[3], np.nan
    at, own = film.rows[row], film.rows[shown + 1]
    if row != shown + 1:
        first, last = jumps_of(film, shown + 1)
        seam = film.seam[first:last][film.to[first:last] == row][0]
        if film.body:
            rot = wrap(own.heading + fish[3] - at.heading)
    dx, dy = rotate(film.rows[shown].dx, film.rows[shown].dy, fish[3])
    begin = np.empty((2, 3))
    begin[0, 0], begin[0, 1], begin[0, 2] = fish[0], fish[1], fish[2]
    begin[1, 0], begin[1, 1], begin[1, 2] = fish[0] + dx, fish[1] + dy, at.heading + rot
    way = extend_by_film(graph, begin, row, rot, ticks - 1 + towards[0].steering.reach)
    m = len(way) - 1
    speed = np.empty(m)
    speed[0] = film.rows[shown].speed
    for t in range(1, m):
        speed[t] = film.rows[row + t - 1].speed
    rows = np.arange(row, row + min(ticks, m))
    out, used, along, touched = advance(way, speed, rows, begins, towards, graph)
    return out, used, along, touched, seam


@leaf_kernel
def turn_way(way, rot):  # type: ignore[no-untyped-def]
    """Turn a way (dtype `WAY`) to a rotation of its rows, degrees."""
    angle = np.radians(rot)
    way.rot, way.cos, way.sin = rot, np.cos(angle), np.sin(angle)


@finite_leaf
def _stride(graph, way, ticks, start, objective, weights):  # type: ignore[no-untyped-def]
    """Add `ticks` ticks to a candidate route, steered to its goal; return whether all stay inside.

    `way` is changed in place.
    """
    rows, row, route, steering = graph.film.rows, way.row, objective.route, objective.steering
    at, after, tick = rows[row], rows[row + ticks], start.tick + way.ticks + ticks
    turn, cost, along = 0.0, 0.0, way.along
    speed = (at.speed + after.speed) / 2
    if route.x.size:
        lead = graph.leads[row]
        leads = rotate(lead.dx, lead.dy, way.rot)
        most = most_turn(speed, steering)
        turn = turn_to(route, (way.x, way.y, along), leads, lead.ticks, most, steering)
    dx, dy = turn_by(after.x - at.x, after.y - at.y, way.cos, way.sin)
    if route.x.size:
        dx, dy = rotate(after.x - at.x, after.y - at.y, way.rot + turn * ticks / 2)
    x, y, rot = way.x + dx, way.y + dy, way.rot + turn * ticks
    heading = after.heading + rot
    if route.x.size:
        x, y, along, fx, fy, shift = shift_to_path(
            route, (x, y, along), speed, (tick, ticks), steering
        )
        used = turn / steering.turn, shift / max(steering.shift * speed * ticks, 1e-9)
        cost = tick_cost(route, (x, y, heading), (along, fx, fy), used, tick, steering) * ticks
    if not fits(graph.bounds, row + ticks, x, y, heading):
        return False
    if not clear_ahead(start.company, row + ticks, x, y, heading, tick):
        return False
    way.x, way.y, way.along, way.rot = x, y, along, rot
    way.terms[PATH] += cost
    way.row, way.ticks = row + ticks, way.ticks + ticks
    return True


@leaf_kernel
def swim_leg(graph, way, most, start, objective, weights):  # type: ignore[no-untyped-def]
    """Swim a leg: to the first row that can jump after a stride, at most `most` ticks.

    `way` (dtype `WAY`) is changed in place: place, row, ticks, and the terms rarity, lag and path.
    start: `SearchStart`. Returns whether it leads on (not where a wall or a fish is in the way, or
    the film ends), and whether the objective is done.
    """
    rows, begun, left, ends = graph.film.rows, way.row, min(graph.leg[way.row], most), False
    if left == 0:
        return False, False
    while left > 0 and not ends:
        ticks = min(weights.stride, left)
        if not _stride(graph, way, ticks, start, objective, weights):
            return False, False
        left -= ticks
        ends = is_done(graph, way, objective)
    way.terms[RARITY] += rows[way.row].rarity_sum - rows[begun].rarity_sum
    if not objective.route.x.size:
        way.terms[LAG] += start.lag * (rows[way.row].lag_sum - rows[begun].lag_sum)
    return rows[way.row].recurrent, ends


@kernel
def extend_by_film(graph: SearchGraph, begins: Floats, row: int, rot: float, ticks: int) -> Floats:
    """Return a way that ends with `row`, extended by up to `ticks` next places of the film.

    begins (k, 3): x, y px, heading; rot: degrees by which the row is turned.
    """
    k, more = len(begins), min(ticks, graph.run[row])
    way = np.empty((k + more, 3))
    for i in range(k):  # `way[:k] = begins` takes six seconds to compile
        for c in range(3):
            way[i, c] = begins[i, c]
    rows = graph.film.rows
    for t in range(1, more + 1):
        dx, dy = rotate(rows[row + t].x - rows[row].x, rows[row + t].y - rows[row].y, rot)
        way[k + t - 1, 0], way[k + t - 1, 1] = begins[k - 1, 0] + dx, begins[k - 1, 1] + dy
        way[k + t - 1, 2] = rows[row + t].heading + rot
    return way


class Pace(NamedTuple):
    """How far a predicted state moves a fish in a tick.

    px: at a speed of one body length/s; turn_deg: degrees at a turn rate of one rad/s.
    """

    px: float
    turn_deg: float


@leaf_kernel
def integrate_state(place, state, pace):  # type: ignore[no-untyped-def]
    """Return the next place (x, y px, heading) of a fish that moves as `state` (d,) says.

    The last three numbers of the state are the speeds ahead and to the left, body lengths/s, and
    the turn rate, rad/s.
    """
    x, y = offset_point(place[0], place[1], place[2], state[-3] * pace.px, state[-2] * pace.px)
    return x, y, place[2] + state[-1] * pace.turn_deg


@kernel
def predicted_way(states, start, pace):  # type: ignore[no-untyped-def]
    """Return the way (n + 1, 3), x, y px, heading, along which predicted states move a fish.

    states (n, d): tick by tick; start (3,): x, y px, heading, the first place of the way.
    """
    way = np.empty((len(states) + 1, 3))
    place = start[0], start[1], start[2]
    way[0, 0], way[0, 1], way[0, 2] = place
    for t in range(len(states)):
        place = integrate_state(place, states[t], pace)
        way[t + 1, 0], way[t + 1, 1], way[t + 1, 2] = place
    return way
