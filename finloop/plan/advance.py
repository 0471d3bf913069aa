"""How a fish moves along rows of the film, in the search and on screen."""

from typing import NamedTuple

import numpy as np

from finloop.animate.company import is_clear_in_search
from finloop.animate.kinematics import offset_point, rotate, rotate_by_cos_sin, touches_target, wrap
from finloop.animate.memory import mark_rows
from finloop.animate.route import (
    Route,
    due_along,
    find_foot,
    foot_search_start,
    is_route_done,
    point_along,
)
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import finite_leaf, kernel, leaf_kernel
from finloop.plan.cost import LAG, PATH, RARITY, Steering, path_tick_cost
from finloop.plan.graph import jump_range
from finloop.plan.objectives import heading_vector, is_objective_done
from finloop.plan.search_graph import SearchGraph
from finloop.plan.walls import fits_in_tank

_ONWARD = 0.1  # body lengths; the least distance at which a place ahead is steered to


@finite_leaf
def largest_steering_turn(speed_bl_s: float, steering: Steering) -> float:
    """Return the largest steering correction, degrees in a tick, at a speed in body lengths/s."""
    return steering.turn * min(speed_bl_s / steering.brisk, 1.0)


@finite_leaf
def steering_turn(  # type: ignore[no-untyped-def]
    route: Route, position, film_offset, ticks_ahead: int, most_deg: float, steering: Steering
) -> float:
    """Return the steering turn of a tick, degrees, + = left, between −`most_deg` and `most_deg`.

    position: x, y px, and px along the route; film_offset (dx, dy): px on the screen by which the
    film moves the fish in `ticks_ahead` ticks. The fish turns towards the point of the route that
    is as far ahead.
    """
    dx, dy = film_offset
    far = np.sqrt(dx * dx + dy * dy)
    if ticks_ahead < 1 or far < 1e-6 * steering.length_px:
        return 0.0
    x, y = point_along(route, position[2] + far)
    vx, vy = x - position[0], y - position[1]
    aside = (dy * vx - dx * vy) / far
    onward = max((dx * vx + dy * vy) / far, _ONWARD * steering.length_px)
    # Turning evenly, the place ahead moves as if half of the turn had been made at once.
    want = 2.0 * np.degrees(aside / onward) / ticks_ahead
    return min(max(want, -most_deg), most_deg)


@finite_leaf
def shift_to_route(route: Route, position, speed_bl_s: float, timing, steering: Steering):  # type: ignore[no-untyped-def]
    """Shift a fish towards its route, and along it where it is too early or too late.

    position: x, y px, and px along the route; timing: the tick, and the ticks since the last shift.
    Returns the shifted x, y px; px along the route and x, y px of the nearest point of the route
    before the shift; and the length of the shift, px.
    """
    (x, y, along), (tick, ticks) = position, timing
    along, fx, fy = find_foot(route, x, y, foot_search_start(route, along, tick))
    tx, ty, most = fx, fy, steering.shift * speed_bl_s * ticks
    share = min(ticks / steering.reach, 1.0)
    if route.when.size:
        late = min(max((due_along(route, tick) - along) * share, -most), most)
        tx, ty = point_along(route, along + late / share)
    cx, cy = (tx - x) * share, (ty - y) * share
    far = np.sqrt(cx * cx + cy * cy)
    if far > most:
        cx, cy, far = cx * most / far, cy * most / far, most
    return x + cx, y + cy, along, fx, fy, far


@kernel
def swim_trajectory(  # type: ignore[no-untyped-def]
    planned: Floats, speeds_bl_s: Floats, rows: Ints, progress, purpose, graph: SearchGraph
):
    """Swim a planned trajectory, steered to the route, up to the goal, route's end or a wall.

    planned (m + 1, 3): x, y px, heading in degrees, from the fish's present place on, of which t ≤
    m ticks count; speeds_bl_s (m,): body lengths/s; rows (t,): rows that are shown; progress: px
    along the route, and the tick; purpose: the `Objective`, and the goal. Without a route the fish
    also stops at a waypoint.

    Returns the trajectory (n, 3), n ≤ t; its steering corrections (n, 2): degrees, px; px along the
    route at its end; whether its last place touches the goal.
    """
    objective, goal = purpose
    ticks, route, steering = rows.size, objective.route, objective.steering
    out, used, film = np.empty((ticks, 3)), np.zeros((ticks, 2)), graph.film.rows
    along, tick = progress
    x, y, rot, good, touched = planned[0, 0], planned[0, 1], 0.0, ticks, False
    for t in range(ticks):
        turn, shift, row = 0.0, 0.0, rows[t]
        if route.x.size:
            reach = min(steering.reach, len(planned) - 1 - t)
            leads = rotate(
                planned[t + reach, 0] - planned[t, 0], planned[t + reach, 1] - planned[t, 1], rot
            )
            most = largest_steering_turn(speeds_bl_s[t], steering)
            turn = steering_turn(route, (x, y, along), leads, reach, most, steering)
        dx, dy = rotate(
            planned[t + 1, 0] - planned[t, 0], planned[t + 1, 1] - planned[t, 1], rot + turn
        )
        new_x, new_y, on, heading = x + dx, y + dy, along, planned[t + 1, 2] + rot + turn
        if route.x.size:
            new_x, new_y, on, _, _, shift = shift_to_route(
                route, (new_x, new_y, along), speeds_bl_s[t], (tick + t + 1, 1), steering
            )
        if not fits_in_tank(graph.bounds, row, new_x, new_y, heading):
            good = t
            break
        x, y, along, rot = new_x, new_y, on, rot + turn
        out[t, 0], out[t, 1], out[t, 2] = x, y, heading
        used[t, 0], used[t, 1] = turn, shift
        if route.x.size:
            ends = is_route_done(route, along, tick + t + 1)
        else:
            goes_on = film[row].has_next and film[row + 1].recurrent
            touched = not goal.free and goes_on and touches_target(x, y, heading, goal)
            ends = touched or (not goal.free and touches_target(x, y, heading, objective.aim))
        if ends:
            good = t + 1
            break
    return out[:good], used[:good], along, touched


@kernel
def swim_film_run(graph: SearchGraph, pose: Floats, shown_row: int, run, progress, purpose):  # type: ignore[no-untyped-def]
    """Move a fish along a run of film from its next tick on, steered as by `swim_trajectory`.

    pose (4,): x, y px, heading, and degrees by which the row on screen, `shown_row`, is turned;
    run: first row and number of ticks; progress, purpose: as in `swim_trajectory`. Returns what
    that returns, and the discontinuity of the run's first row in natural steps, NaN where the film
    plays on.
    """
    (row, ticks), film, rot, seam = run, graph.film, pose[3], np.nan
    at, own = film.rows[row], film.rows[shown_row + 1]
    if row != shown_row + 1:
        first, last = jump_range(film, shown_row + 1)
        seam = film.seam[first:last][film.to[first:last] == row][0]
        if film.body:
            rot = wrap(own.heading + pose[3] - at.heading)
    dx, dy = rotate(film.rows[shown_row].dx, film.rows[shown_row].dy, pose[3])
    begin = np.empty((2, 3))
    begin[0, 0], begin[0, 1], begin[0, 2] = pose[0], pose[1], pose[2]
    begin[1, 0], begin[1, 1], begin[1, 2] = pose[0] + dx, pose[1] + dy, at.heading + rot
    way = extend_trajectory_by_film(graph, begin, row, rot, ticks - 1 + purpose[0].steering.reach)
    m = len(way) - 1
    speed = np.empty(m)
    speed[0] = film.rows[shown_row].speed
    for t in range(1, m):
        speed[t] = film.rows[row + t - 1].speed
    rows = np.arange(row, row + min(ticks, m))
    out, used, along, touched = swim_trajectory(way, speed, rows, progress, purpose, graph)
    return out, used, along, touched, seam


@leaf_kernel
def set_way_rotation(way, rotation_deg):  # type: ignore[no-untyped-def]
    """Set the rotation, with its cosine and sine, of a way of the search (dtype `WAY`)."""
    angle = np.radians(rotation_deg)
    way.rot, way.cos, way.sin = rotation_deg, np.cos(angle), np.sin(angle)


@leaf_kernel
def turn_way_to_row(graph, way, row):  # type: ignore[no-untyped-def]
    """Turn a way of the search (dtype `WAY`) so that it keeps its heading when it shows `row`."""
    rows, to = graph.film.rows, graph.leads[row]
    cos, sin = heading_vector(graph.leads[way.row], way)
    way.rot += rows[way.row].heading - rows[row].heading
    way.cos, way.sin = cos * to.cos + sin * to.sin, sin * to.cos - cos * to.sin


@finite_leaf
def _advance_way(graph, way, ticks, start, objective, weights):  # type: ignore[no-untyped-def]
    """Advance a way of the search by some ticks; return whether its end is free.

    way: of dtype `WAY`, changed in place. Free is inside the tank and clear of other fish. On a
    route the way is steered. ticks: how many; start: `SearchStart`.
    """
    rows, row, route, steering = graph.film.rows, way.row, objective.route, objective.steering
    at, after, tick = rows[row], rows[row + ticks], start.tick + way.ticks + ticks
    turn, cost, along = 0.0, 0.0, way.along
    speed = (at.speed + after.speed) / 2
    if route.x.size:
        lead = graph.leads[row]
        leads = rotate_by_cos_sin(lead.dx, lead.dy, way.cos, way.sin)
        most = largest_steering_turn(speed, steering)
        turn = steering_turn(route, (way.x, way.y, along), leads, lead.ticks, most, steering)
        dx, dy = rotate(after.x - at.x, after.y - at.y, way.rot + turn * ticks / 2)
    else:
        dx, dy = rotate_by_cos_sin(after.x - at.x, after.y - at.y, way.cos, way.sin)
    x, y, rot = way.x + dx, way.y + dy, way.rot + turn * ticks
    heading = after.heading + rot
    if route.x.size:
        x, y, along, fx, fy, shift = shift_to_route(
            route, (x, y, along), speed, (tick, ticks), steering
        )
        used = turn / steering.turn, shift / max(steering.shift * speed * ticks, 1e-9)
        cost = path_tick_cost(route, (x, y, heading), (along, fx, fy), used, tick, steering) * ticks
    if not fits_in_tank(graph.bounds, row + ticks, x, y, heading):
        return False
    if not is_clear_in_search(start.company, row + ticks, x, y, heading, tick):
        return False
    way.x, way.y, way.along = x, y, along
    if route.x.size:
        set_way_rotation(way, rot)
    way.terms[PATH] += cost
    way.row, way.ticks = row + ticks, way.ticks + ticks
    return True


@leaf_kernel
def advance_way_by_leg(graph, way, most_ticks, start, objective, weights):  # type: ignore[no-untyped-def]
    """Advance a way of the search by a leg: to the first row with jumps after a stride.

    way: of dtype `WAY`; its place, rows, ticks, and terms rarity, lag and path are changed.
    most_ticks: longest leg; start: `SearchStart`. Returns whether the way can go on (not where a
    wall or a fish blocks it, or the film ends), and whether its objective is done.
    """
    rows, begun, left, ends = graph.film.rows, way.row, min(graph.leg[way.row], most_ticks), False
    if left == 0:
        return False, False
    while left > 0 and not ends:
        ticks = min(weights.stride, left)
        if not _advance_way(graph, way, ticks, start, objective, weights):
            return False, False
        left -= ticks
        ends = is_objective_done(graph, way, objective)
    way.shown = mark_rows(way.shown, begun, way.row)
    way.terms[RARITY] += rows[way.row].rarity_sum - rows[begun].rarity_sum
    if not objective.route.x.size:
        way.terms[LAG] += start.lag * (rows[way.row].lag_sum - rows[begun].lag_sum)
    return rows[way.row].recurrent, ends


@kernel
def extend_trajectory_by_film(
    graph: SearchGraph, trajectory: Floats, row: int, rotation_deg: float, ticks: int
) -> Floats:
    """Return a trajectory that ends at a film row, extended by the next places of the film.

    trajectory (k, 3): x, y px, heading in degrees; row: the row shown at its end, turned by
    `rotation_deg`; ticks: how many places to add, fewer where the film ends.
    """
    k, more = len(trajectory), min(ticks, graph.run[row])
    way = np.empty((k + more, 3))
    for i in range(k):  # `way[:k] = begins` takes six seconds to compile
        for c in range(3):
            way[i, c] = trajectory[i, c]
    rows = graph.film.rows
    for t in range(1, more + 1):
        dx, dy = rotate(rows[row + t].x - rows[row].x, rows[row + t].y - rows[row].y, rotation_deg)
        way[k + t - 1, 0], way[k + t - 1, 1] = trajectory[k - 1, 0] + dx, trajectory[k - 1, 1] + dy
        way[k + t - 1, 2] = rows[row + t].heading + rotation_deg
    return way


class Pace(NamedTuple):
    """How far one unit of a predicted state moves a fish in a tick.

    px: at a speed of one body length/s; turn_deg: degrees at a turn rate of one rad/s.
    """

    px: float
    turn_deg: float


@leaf_kernel
def move_by_state(place, state, pace):  # type: ignore[no-untyped-def]
    """Return the next x, y px and heading, degrees, of a fish that moves as a predicted state says.

    place: x, y px, heading; state (d,): its last three numbers are the speeds ahead and to the
    left, body lengths/s, and the turn rate, rad/s; pace: `Pace`.
    """
    x, y = offset_point(place[0], place[1], place[2], state[-3] * pace.px, state[-2] * pace.px)
    return x, y, place[2] + state[-1] * pace.turn_deg


@kernel
def predicted_trajectory(states, start, pace):  # type: ignore[no-untyped-def]
    """Return the trajectory along which predicted states move a fish: (n + 1, 3), x, y px, heading.

    states (n, d): tick by tick; start (3,): x, y px, heading, the first place of the result; pace:
    `Pace`.
    """
    way = np.empty((len(states) + 1, 3))
    place = start[0], start[1], start[2]
    way[0, 0], way[0, 1], way[0, 2] = place
    for t in range(len(states)):
        place = move_by_state(place, states[t], pace)
        way[t + 1, 0], way[t + 1, 1], way[t + 1, 2] = place
    return way
