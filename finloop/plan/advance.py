"""How a fish moves along rows of the film, in the search and on screen."""

from typing import NamedTuple

import numpy as np

from finloop.animate.kinematics import (
    Target,
    offset_point,
    rotate,
    rotate_by_cos_sin,
    touches_target,
    wrap,
)
from finloop.animate.memory import mark_rows
from finloop.animate.obstacles import is_clear_in_search
from finloop.animate.route import (
    Route,
    due_along,
    find_nearest_on_route,
    is_route_done,
    nearest_search_start,
    point_along,
)
from finloop.animate.state import Run
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import finite_leaf, kernel, leaf_kernel
from finloop.plan.cost import LAG, PATH, RARITY, Steering, path_tick_cost
from finloop.plan.graph import jump_range, row_can_play_on
from finloop.plan.objectives import Objective, heading_vector, is_objective_done
from finloop.plan.search_graph import SearchGraph
from finloop.plan.walls import fits_in_tank

_LEAST_AHEAD = 0.1  # body lengths; the least distance ahead of a point to steer to


@finite_leaf
def largest_steering_turn(speed_bl_s: float, steering: Steering) -> float:
    """Return the largest steering correction, degrees in a tick, at a speed in body lengths/s.

    It is proportional to the speed, up to that of a fast fish (`steering.fast_bl_s`).
    """
    return steering.turn * min(speed_bl_s / steering.fast_bl_s, 1.0)


class RoutePlace(NamedTuple):
    """The place x, y px of a fish, and how far along its route it last was, in px."""

    x: float
    y: float
    along_px: float


class RouteShift(NamedTuple):
    """A place shifted towards a route, and the point of the route nearest to it before the shift.

    x, y: px after the shift; along_px: of the nearest point, px along the route; near_x, near_y: of
    the nearest point; length_px: of the shift.
    """

    x: float
    y: float
    along_px: float
    near_x: float
    near_y: float
    length_px: float


@finite_leaf
def steering_turn(  # type: ignore[no-untyped-def]
    route: Route, place: RoutePlace, film_offset, ticks_ahead: int, most_deg: float,
    steering: Steering,
) -> float:  # fmt: skip
    """Return the steering turn of a tick, degrees, + = left, between −`most_deg` and `most_deg`.

    film_offset (dx, dy): px on the screen by which the film moves the fish in `ticks_ahead` ticks.
    The fish turns towards the point of the route that is as far ahead as this offset is long; it
    does not turn where the film hardly moves it.
    """
    dx, dy = film_offset
    far_px = np.sqrt(dx * dx + dy * dy)
    if ticks_ahead < 1 or far_px < 1e-6 * steering.length_px:
        return 0.0
    x, y = point_along(route, place.along_px + far_px)
    to_x, to_y = x - place.x, y - place.y
    # The point in px to the left of the film's direction and along it; one at the fish's side or
    # behind it counts as a little ahead.
    left = (dy * to_x - dx * to_y) / far_px
    ahead = max((dx * to_x + dy * to_y) / far_px, _LEAST_AHEAD * steering.length_px)
    # Turning evenly, the place ahead moves as if half of the turn had been made at once.
    wanted_deg = 2.0 * np.degrees(left / ahead) / ticks_ahead
    return min(max(wanted_deg, -most_deg), most_deg)


@finite_leaf
def shift_to_route(  # type: ignore[no-untyped-def]
    route: Route, place: RoutePlace, speed_bl_s: float, tick: int, ticks: int, steering: Steering
):
    """Return a `RouteShift`: a place moved towards the route, and along it if early or late.

    place: before the shift; ticks: since the last shift. The shift is at most `steering.shift`
    times the speed, body lengths/s, for each of these ticks.
    """
    x, y = place.x, place.y
    search_start = nearest_search_start(route, place.along_px, tick)
    along, near_x, near_y = find_nearest_on_route(route, x, y, search_start)
    to_x, to_y, most_px = near_x, near_y, steering.shift * speed_bl_s * ticks
    share = min(ticks / steering.reach, 1.0)  # of the offset, removed now
    # The fish moves towards the nearest point; with times, to one before or after it, so far that
    # the removed share of the delay is at most `most_px`.
    if route.when.size:
        catch_up_px = min(max((due_along(route, tick) - along) * share, -most_px), most_px)
        to_x, to_y = point_along(route, along + catch_up_px / share)
    shift_x, shift_y = (to_x - x) * share, (to_y - y) * share
    shift_px = np.sqrt(shift_x * shift_x + shift_y * shift_y)
    if shift_px > most_px:
        shift_x, shift_y = shift_x * most_px / shift_px, shift_y * most_px / shift_px
        shift_px = most_px
    return RouteShift(x + shift_x, y + shift_y, along, near_x, near_y, shift_px)


@kernel
def swim_trajectory(  # type: ignore[no-untyped-def]
    planned: Floats, speeds_bl_s: Floats, rows: Ints, along_px: float, tick: int,
    objective: Objective, target: Target, graph: SearchGraph,
):  # fmt: skip
    """Return a planned trajectory, steered to the route, up to target, route's end or a wall.

    planned (m + 1, 3): x, y px, heading in degrees, as filmed, from the fish's present place on;
    the fish swims its first k ≤ m steps, the others only tell where the film leads; speeds_bl_s
    (m,): body lengths/s; rows (k,): film rows shown; along_px: px along the route; tick: of the
    present place.

    With a route the fish stops at its end. Without one it stops where it touches the target, at a
    row after which the film can play on, or where it touches the waypoint `objective.aim`; a fish
    whose target is free wanders, and stops at neither.

    Returns the trajectory (n, 3), n ≤ k; its steering corrections (n, 2): degrees, px; px along the
    route at its end; whether it stopped at the target.
    """
    ticks, route, steering = rows.size, objective.route, objective.steering
    trajectory, corrections, film_rows = np.empty((ticks, 3)), np.zeros((ticks, 2)), graph.film.rows
    along, rotation_deg, end, touches = (
        along_px,
        0.0,
        ticks,
        False,
    )  # rotation_deg: steered so far, degrees
    x, y = planned[0, 0], planned[0, 1]
    for t in range(ticks):
        turn, shift_px, row = 0.0, 0.0, rows[t]
        # The planned step, turned towards the route, and then shifted towards it. How far to turn
        # depends on where the next `reach` steps would lead.
        if route.x.size:
            reach = min(steering.reach, len(planned) - 1 - t)
            film_offset = rotate(
                planned[t + reach, 0] - planned[t, 0],
                planned[t + reach, 1] - planned[t, 1],
                rotation_deg,
            )
            most_deg = largest_steering_turn(speeds_bl_s[t], steering)
            place = RoutePlace(x, y, along)
            turn = steering_turn(route, place, film_offset, reach, most_deg, steering)
        dx, dy = rotate(
            planned[t + 1, 0] - planned[t, 0],
            planned[t + 1, 1] - planned[t, 1],
            rotation_deg + turn,
        )
        new_x, new_y, new_along = x + dx, y + dy, along
        heading = planned[t + 1, 2] + rotation_deg + turn
        if route.x.size:
            place = RoutePlace(new_x, new_y, along)
            shift = shift_to_route(route, place, speeds_bl_s[t], tick + t + 1, 1, steering)
            new_x, new_y, new_along, shift_px = shift.x, shift.y, shift.along_px, shift.length_px
        if not fits_in_tank(graph.bounds, row, new_x, new_y, heading):
            end = t
            break
        x, y, along, rotation_deg = new_x, new_y, new_along, rotation_deg + turn
        trajectory[t, 0], trajectory[t, 1], trajectory[t, 2] = x, y, heading
        corrections[t, 0], corrections[t, 1] = turn, shift_px
        if route.x.size:
            is_done = is_route_done(route, along, tick + t + 1)
        else:
            plays_on = row_can_play_on(film_rows, row)
            touches = not target.free and plays_on and touches_target(x, y, heading, target)
            is_done = touches or (not target.free and touches_target(x, y, heading, objective.aim))
        if is_done:
            end = t + 1
            break
    return trajectory[:end], corrections[:end], along, touches


@kernel
def swim_film_run(  # type: ignore[no-untyped-def]
    graph: SearchGraph, pose: Floats, shown_row: int, run: Run, along_px: float, tick: int,
    objective: Objective, target: Target,
):  # fmt: skip
    """Return how a fish swims a run of film from its next tick on, steered to its route.

    pose (4,): x, y px, heading, and degrees by which the row on screen, `shown_row`, is turned;
    along_px: px along the route; tick: the present one. Returns the output of `swim_trajectory`,
    and the discontinuity of the run's first row in natural steps, NaN where the film plays on.
    """
    row, film, rotation_deg, seam = run.row, graph.film, pose[3], np.nan
    first_row, next_row = film.rows[row], film.rows[shown_row + 1]
    if row != shown_row + 1:  # a jump, perhaps turned so that the heading goes on
        first, last = jump_range(film, shown_row + 1)
        seam = film.seam[first:last][film.to[first:last] == row][0]
        if film.jumps_keep_heading:
            rotation_deg = wrap(next_row.heading + pose[3] - first_row.heading)
    # The step to the run's first row is that of the row on screen; then the film plays on.
    dx, dy = rotate(film.rows[shown_row].dx, film.rows[shown_row].dy, pose[3])
    first_step = np.empty((2, 3))
    first_step[0, 0], first_step[0, 1], first_step[0, 2] = pose[0], pose[1], pose[2]
    first_step[1, 0], first_step[1, 1] = pose[0] + dx, pose[1] + dy
    first_step[1, 2] = first_row.heading + rotation_deg
    ticks_after = run.ticks - 1 + objective.steering.reach
    planned = extend_trajectory_by_film(graph, first_step, row, rotation_deg, ticks_after)
    steps = len(planned) - 1
    speeds = np.empty(steps)
    speeds[0] = film.rows[shown_row].speed
    for t in range(1, steps):
        speeds[t] = film.rows[row + t - 1].speed
    rows = np.arange(row, row + min(run.ticks, steps))
    trajectory, corrections, along_px, touches = swim_trajectory(
        planned, speeds, rows, along_px, tick, objective, target, graph
    )
    return trajectory, corrections, along_px, touches, seam


@leaf_kernel
def set_branch_rotation(branch, rotation_deg):  # type: ignore[no-untyped-def]
    """Set the rotation of a branch (dtype `BRANCH`) in degrees, with its cosine and sine."""
    angle = np.radians(rotation_deg)
    branch.rotation_deg, branch.cos, branch.sin = rotation_deg, np.cos(angle), np.sin(angle)


@leaf_kernel
def turn_branch_to_row(graph, branch, row):  # type: ignore[no-untyped-def]
    """Turn a branch (dtype `BRANCH`) so that it keeps its heading when it shows `row` instead.

    Its rotation_deg, and cos and sin of it, are changed, its row is not. graph: `SearchGraph`.
    """
    old, new = graph.nodes[branch.row], graph.nodes[row]
    heading_cos, heading_sin = heading_vector(old, branch)
    # The new rotation is the heading on screen less the filmed heading of the new row.
    branch.rotation_deg += old.heading - new.heading
    branch.cos = heading_cos * new.cos + heading_sin * new.sin
    branch.sin = heading_sin * new.cos - heading_cos * new.sin


@finite_leaf
def _advance_branch(search, branch, ticks):  # type: ignore[no-untyped-def]
    """Extend a branch by `ticks` of film if its new end is free; return whether it is.

    Free is inside the tank and clear of other fish; the ticks before the end are not tested. Only
    then the branch (dtype `BRANCH`) is changed in place. search: `Search`; its route, if that has
    points, steers the branch: it turns evenly by `turn_deg` a tick, and at the end is shifted
    towards the route.
    """
    graph, start = search.graph, search.start
    row, route, steering = branch.row, search.objective.route, search.objective.steering
    end_row, end_tick = row + ticks, start.tick + branch.ticks + ticks
    begin, end = graph.nodes[row], graph.nodes[end_row]
    turn_deg, cost, along_px = 0.0, 0.0, branch.along_px
    speed = (begin.speed + end.speed) / 2
    if route.x.size:
        preview, place = graph.previews[row], RoutePlace(branch.x, branch.y, along_px)
        film_offset = rotate_by_cos_sin(preview.dx, preview.dy, branch.cos, branch.sin)
        most_deg = largest_steering_turn(speed, steering)
        turn_deg = steering_turn(route, place, film_offset, preview.ticks, most_deg, steering)
        # Turning evenly, the place at the end moves as if half of the turn had been made at once.
        dx, dy = rotate(
            end.x - begin.x, end.y - begin.y, branch.rotation_deg + turn_deg * ticks / 2
        )
    else:
        dx, dy = rotate_by_cos_sin(end.x - begin.x, end.y - begin.y, branch.cos, branch.sin)
    x, y, rotation_deg = branch.x + dx, branch.y + dy, branch.rotation_deg + turn_deg * ticks
    heading = end.heading + rotation_deg
    if route.x.size:
        place = RoutePlace(x, y, along_px)
        shift = shift_to_route(route, place, speed, end_tick, ticks, steering)
        x, y, along_px = shift.x, shift.y, shift.along_px
        most_px = max(steering.shift * speed * ticks, 1e-9)  # not 0, as it would be at rest
        corrections = (turn_deg / steering.turn, shift.length_px / most_px)
        nearest = (along_px, shift.near_x, shift.near_y)
        pose = (x, y, heading)
        cost = path_tick_cost(route, pose, nearest, corrections, end_tick, steering) * ticks
    if not fits_in_tank(graph.bounds, end_row, x, y, heading):
        return False
    if not is_clear_in_search(start.obstacles, end_row, x, y, heading, end_tick):
        return False
    branch.x, branch.y, branch.along_px = x, y, along_px
    if route.x.size:
        set_branch_rotation(branch, rotation_deg)
    branch.terms[PATH] += cost
    branch.row, branch.ticks = end_row, branch.ticks + ticks
    return True


@leaf_kernel
def advance_branch_by_leg(search, branch):  # type: ignore[no-untyped-def]
    """Extend a branch by a leg; return whether it can go on, and whether its objective is met.

    A leg ends at the first row with jumps after at least a stride (`CostWeights.stride` ticks), or
    where the film or the search's horizon ends. After every stride the branch is checked: its leg
    also ends if the objective is met. If a wall or a fish is in its way, or no film is left, both
    results are False. Else it can go on if its last row is recurrent: if film can be played from
    there for ever. search: `Search`; branch (dtype `BRANCH`): its place, row, ticks, marks, and the
    terms rarity, lag and path are changed in place.
    """
    nodes, first_row = search.graph.nodes, branch.row
    ticks_left = min(np.int64(nodes[first_row].leg), search.horizon - branch.ticks)
    is_done = False
    if ticks_left == 0:
        return False, False
    while ticks_left > 0 and not is_done:
        ticks = min(search.weights.stride, ticks_left)
        if not _advance_branch(search, branch, ticks):
            return False, False
        ticks_left -= ticks
        is_done = is_objective_done(search, branch)
    branch.marks = mark_rows(branch.marks, first_row, branch.row)
    branch.terms[RARITY] += nodes[branch.row].rarity_sum - nodes[first_row].rarity_sum
    if not search.objective.route.x.size:
        lag_ticks = nodes[branch.row].lag_sum - nodes[first_row].lag_sum
        branch.terms[LAG] += search.start.rest_cost * lag_ticks
    can_go_on = nodes[branch.row].recurrent
    return can_go_on, is_done


@kernel
def extend_trajectory_by_film(
    graph: SearchGraph, trajectory: Floats, row: int, rotation_deg: float, ticks: int
) -> Floats:
    """Return a trajectory extended by the places to which the film leads if it plays on.

    trajectory (k, 3): x, y px, heading in degrees; row: the film row shown at its end, turned by
    `rotation_deg`; ticks: how many places to add, fewer where the film ends.
    """
    given, added = len(trajectory), min(ticks, graph.run[row])
    extended = np.empty((given + added, 3))
    for i in range(given):  # a slice takes six seconds to compile
        for c in range(3):
            extended[i, c] = trajectory[i, c]
    rows = graph.film.rows
    for t in range(1, added + 1):
        dx, dy = rotate(rows[row + t].x - rows[row].x, rows[row + t].y - rows[row].y, rotation_deg)
        extended[given + t - 1, 0] = trajectory[given - 1, 0] + dx
        extended[given + t - 1, 1] = trajectory[given - 1, 1] + dy
        extended[given + t - 1, 2] = rows[row + t].heading + rotation_deg
    return extended


class StepScale(NamedTuple):
    """How far one unit of a predicted speed or turn rate moves a fish in a tick.

    px: at a speed of one body length/s; turn_deg: degrees at a turn rate of one rad/s.
    """

    px: float
    turn_deg: float


@kernel
def predicted_trajectory(states: Floats, start: Floats, scale: StepScale) -> Floats:
    """Return the trajectory (n + 1, 3) of a fish that swims at predicted speeds and turn rates.

    states (n, d): predicted states, tick by tick, whose last three numbers are the speeds ahead and
    to the left, body lengths/s, and the turn rate, rad/s; start (3,): the first place of the
    result, x, y px, heading in degrees; scale: px and degrees in a tick for 1 of these units.
    """
    trajectory = np.empty((len(states) + 1, 3))
    x, y, heading = start[0], start[1], start[2]
    trajectory[0, 0], trajectory[0, 1], trajectory[0, 2] = x, y, heading
    for t in range(len(states)):
        ahead_px, left_px = states[t, -3] * scale.px, states[t, -2] * scale.px
        x, y = offset_point(x, y, heading, ahead_px, left_px)
        heading += states[t, -1] * scale.turn_deg
        trajectory[t + 1, 0], trajectory[t + 1, 1], trajectory[t + 1, 2] = x, y, heading
    return trajectory
