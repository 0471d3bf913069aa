"""The objective of a search: a target to touch or a route to follow; and the cost to come."""

from typing import NamedTuple

import numpy as np

from finloop.animate.kinematics import Target, touches_target
from finloop.animate.route import NO_ROUTE, Route, due_along, point_along
from finloop.animate.rule import Rule
from finloop.animate.state import Fish
from finloop.base.arrays import Floats
from finloop.base.kernel import finite_leaf, kernel_part, leaf_kernel
from finloop.plan.cost import NO_STEERING, Steering, offset_cost
from finloop.plan.world import FilmWorld
from finloop.social.rule import DecidingFish, next_place_in_school


class Objective(NamedTuple):
    """What a fish swims for: a target to touch (aim), or a route to follow if it has places.

    steering: how far the fish may be corrected onto the route, and what leaving it costs.
    """

    aim: Target
    route: Route
    steering: Steering


class FilmStep(NamedTuple):
    """How far the film moves a fish in `ticks`: px ahead, to its left, and in a straight line."""

    ahead: float
    left: float
    far: float
    ticks: int


ANYWHERE = Target(x=0.0, y=0.0, touch_px=0.0, head_px=0.0, free=True)
"""The target of a fish without one: it goes where the film or its path goes."""


def target_objective(aim: Target) -> Objective:
    """Return the objective to touch a target."""
    return Objective(aim, NO_ROUTE, NO_STEERING)


def path_objective(route: Route, steering: Steering) -> Objective:
    """Return the objective to follow a route, with steering corrections onto it."""
    return Objective(ANYWHERE, route, steering)


# --- for the search: is the objective done, and what is the cost to come?


@leaf_kernel
def is_objective_done(search, branch):  # type: ignore[no-untyped-def]
    """Return whether a branch of the search is at its path's end, or has reached its target.

    A target is reached where the fish touches it, at a row after which the film can play on for
    ever. search: `Search`; branch: of dtype `BRANCH`.
    """
    objective, node = search.objective, search.graph.nodes[branch.row]
    if objective.route.x.size:
        return is_at_path_end(objective.route, branch.along_px)
    heading = node.heading + branch.rotation_deg
    if objective.aim.free or not touches_target(branch.x, branch.y, heading, objective.aim):
        return False
    return node.plays_on


@leaf_kernel
def estimate_cost_to_come(search, branch, row, direction):  # type: ignore[no-untyped-def]
    """Estimate the cost, in ticks, that a branch of the search will have beyond its end.

    search: `Search`; branch: of dtype `BRANCH`; row: that it plays on from; direction: cosine and
    sine of its heading.
    """
    aim = search.objective.aim
    if search.objective.route.x.size:
        return estimate_path_cost(search, branch, search.graph.previews[row], direction)
    if aim.free:
        return 0.0
    return estimate_ticks_to_target(branch.x, branch.y, direction, aim, search.weights)


@leaf_kernel
def estimate_ticks_to_target(x, y, direction, target, weights):  # type: ignore[no-untyped-def]
    """Estimate the ticks from x, y px to a target: distance / top speed + turn / turn rate.

    direction: cosine and sine of the heading; weights: `CostWeights`, with both rates.
    """
    dx, dy = target.x - x, y - target.y  # to the right and upwards
    far_px = np.sqrt(dx * dx + dy * dy)
    cos_turn = (dx * direction[0] + dy * direction[1]) / max(far_px, 1e-9)
    return far_px / weights.fast_px + estimate_angle_deg(cos_turn) / weights.turn_deg


@leaf_kernel
def estimate_angle_deg(cosine: float) -> float:
    """Estimate the arc cosine, 0 … 180°, to 0.004° (Abramowitz and Stegun, 4.4.45).

    cosine: slightly beyond −1 or 1 counts as that. With the exact angle, searches for goals of the
    zebrafish and the carp take 9 and 7 % longer.
    """
    size = min(abs(cosine), 1.0)
    series = 1.5707288 + size * (-0.2121144 + size * (0.0742610 - 0.0187293 * size))
    angle = np.degrees(np.sqrt(1.0 - size) * series)
    return angle if cosine >= 0.0 else 180.0 - angle


@leaf_kernel
def cost_of_time(search, branch):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of the time that a branch of the search takes.

    - No path: each tick costs one.
    - A path whose points have no times: each tick beyond those that a fast fish needs for the same
      progress costs `SearchStart.rest_cost`.
    - A path whose points have times: 0, because being late has its own cost.

    search: `Search`; branch: of dtype `BRANCH`.
    """
    route, start = search.objective.route, search.start
    if not route.x.size:
        return float(branch.ticks)
    if route.when.size:
        return 0.0
    progress_ticks = (branch.along_px - start.along_px) / search.weights.fast_px
    return start.rest_cost * (branch.ticks - progress_ticks)


@finite_leaf
def is_at_path_end(route, along_px):  # type: ignore[no-untyped-def]
    """Return whether a fish `along_px` along an open route without times is at its end.

    False for other routes: a closed one has no end, and one with times ends by its time.
    """
    if route.closed or route.when.size:
        return False
    return along_px >= route.step * (route.x.size - 1)


@kernel_part
def points_due(route, tick, tick_count):  # type: ignore[no-untyped-def]
    """Return where a route with times wants the fish at each tick: x, y px (tick_count, 2).

    The first is for `tick`. The result is (0, 2) for a route without times.
    """
    count = tick_count if route.when.size else 0
    points = np.empty((count, 2))
    for t in range(count):
        points[t, 0], points[t, 1] = point_along(route, due_along(route, tick + t))
    return points


@finite_leaf
def heading_vector(node, branch):  # type: ignore[no-untyped-def]
    """Return the cosine and sine of the heading of a film row, turned as a branch turns its rows.

    node: of the film row, of dtype `NODE`; branch: of dtype `BRANCH`.
    """
    cos = node.cos * branch.cos - node.sin * branch.sin
    sin = node.sin * branch.cos + node.cos * branch.sin
    return cos, sin


@finite_leaf
def estimate_path_cost(search, branch, preview, direction):  # type: ignore[no-untyped-def]
    """Estimate the cost, in ticks, of being off the path next, if the film plays on.

    Simpson's rule, (start + 4 middle + end) / 6, integrates the cost, 0 at the start, over the
    places to which the film leads, less what steering can correct until then. search: `Search`;
    branch: of dtype `BRANCH`; preview (dtype `PREVIEW`): of the row that it plays on from;
    direction: cosine and sine of its heading.
    """
    steering, half = search.objective.steering, preview.ticks // 2
    middle_step = FilmStep(preview.half_ahead, preview.half_left, preview.half_far, half)
    end_step = FilmStep(preview.ahead, preview.left, preview.far, preview.ticks)
    middle = _path_deviation(search, branch, middle_step, direction)
    end = _path_deviation(search, branch, end_step, direction)
    deviation_cost = steering.late if search.objective.route.when.size else steering.across
    return deviation_cost * preview.ticks * (4.0 * middle + end) / 6.0


@finite_leaf
def _path_deviation(search, branch, step, direction):  # type: ignore[no-untyped-def]
    """Return how far off the path the film leads a branch, in squared body lengths.

    What steering can correct is taken off; beyond a body length the result grows linearly. search:
    `Search`; branch: of dtype `BRANCH`; step: `FilmStep`; direction: cosine and sine of its
    heading.
    """
    route, steering, (cos, sin) = search.objective.route, search.objective.steering, direction
    x = branch.x + step.ahead * cos - step.left * sin
    y = branch.y - step.ahead * sin - step.left * cos
    if route.when.size:
        due = branch.ticks + step.ticks
        to_x, to_y = search.due_points[due, 0], search.due_points[due, 1]
    else:
        to_x, to_y = point_along(route, branch.along_px + step.far)
    offset_px = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2)
    # An even turn moves a place ahead aside by half of its angle × the distance.
    corrected_px = step.far * np.radians(steering.turn) * step.ticks / 2
    return offset_cost(max(offset_px - corrected_px, 0.0) ** 2, steering.length_px**2)


def place_by_rule(
    rule: Rule, fish: Fish, world: FilmWorld, rng: np.random.Generator
) -> tuple[Floats, int] | None:
    """Return where a rule sends a fish, x, y px (2,), and how many ticks it keeps that target.

    With a leader it is a body length behind the leader, for this decision alone (0 ticks); else the
    zones give the place. None where they request nothing.
    """
    length = world.motion.body_length_px
    if rule.leader is not None:
        angle = np.radians(rule.others.headings_deg[rule.leader])
        x, y = rule.others.places[rule.leader] - length * np.array([np.cos(angle), -np.sin(angle)])
        return np.array(world.tank.nearest_legal_point(float(x), float(y))), 0
    school_rule = rule.school_rule
    assert school_rule is not None
    last_step_bl = fish.speed * school_rule.horizon / world.motion.rate_hz  # in `horizon` ticks
    decider = DecidingFish(fish.x, fish.y, fish.heading, last_step_bl)
    place = next_place_in_school(decider, rule.others, school_rule, world.walls, rng)
    if place is None:
        return None
    return np.array(world.tank.nearest_legal_point(*place)), school_rule.horizon
