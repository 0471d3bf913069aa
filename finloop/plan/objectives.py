"""The objective of a fish: to a goal, along a path, by a rule; and the cost still to come."""

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
def is_objective_done(graph, way, objective):  # type: ignore[no-untyped-def]
    """Return whether a way of the search has reached its target and can go on, or its path's end.

    graph: `SearchGraph`; way: of dtype `WAY`; objective: `Objective`.
    """
    if objective.route.x.size:
        return is_at_path_end(objective.route, way.along)
    rows = graph.film.rows
    row, heading = rows[way.row], rows[way.row].heading + way.rot
    if objective.aim.free or not touches_target(way.x, way.y, heading, objective.aim):
        return False
    return row.has_next and rows[way.row + 1].recurrent


@leaf_kernel
def estimate_cost_to_come(lead, way, direction, objective, costs):  # type: ignore[no-untyped-def]
    """Estimate the cost to come, in ticks, of a way of the search that plays a film row on.

    lead (dtype `LEAD`): where the film leads from the row; way: of dtype `WAY`; direction: cosine
    and sine of the heading; objective: `Objective`; costs: `SearchCosts`.
    """
    if objective.route.x.size:
        soon = costs.due_points, objective.steering
        return estimate_path_cost(lead, way, direction, objective.route, soon)
    if objective.aim.free:
        return 0.0
    return estimate_ticks_to_target(way.x, way.y, direction, objective.aim, costs.weights)


@leaf_kernel
def estimate_ticks_to_target(x, y, direction, target, weights):  # type: ignore[no-untyped-def]
    """Estimate the ticks from x, y px to a target: distance / pace + turn / turning.

    direction: cosine and sine of the heading; weights: `CostWeights`.
    """
    dx, dy = target.x - x, y - target.y
    far = np.sqrt(dx * dx + dy * dy)
    ahead = (dx * direction[0] + dy * direction[1]) / max(far, 1e-9)
    return far / weights.pace + estimate_angle_deg(ahead) / weights.turning


@leaf_kernel
def estimate_angle_deg(cosine: float) -> float:
    """Estimate the angle, 0 … 180°, that has a cosine, to 0.004° (Abramowitz and Stegun, 4.4.45).

    cosine: slightly beyond −1 or 1 counts as that. With the exact angle, searches for goals of the
    zebrafish and the carp take 9 and 7 % longer.
    """
    size = min(abs(cosine), 1.0)
    series = 1.5707288 + size * (-0.2121144 + size * (0.0742610 - 0.0187293 * size))
    angle = np.degrees(np.sqrt(1.0 - size) * series)
    return angle if cosine >= 0.0 else 180.0 - angle


@leaf_kernel
def cost_of_time(way, start, objective, weights):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of the time that a way of the search (dtype `WAY`) takes.

    To a goal each tick costs one. On a path without times each tick that brings no progress costs
    `start.lag`; on a path with times 0, as the delay has a cost of its own. start: `SearchStart`;
    objective: `Objective`; weights: `CostWeights`.
    """
    if not objective.route.x.size:
        return float(way.ticks)
    if objective.route.when.size:
        return 0.0
    return start.lag * (way.ticks - (way.along - start.along) / weights.pace)


@finite_leaf
def is_at_path_end(route, along_px):  # type: ignore[no-untyped-def]
    """Return whether `along_px` along a route is its end; False if it is closed or has times.

    A closed route has no end, and one with times ends by its time.
    """
    if route.closed or route.when.size:
        return False
    return along_px >= route.step * (route.x.size - 1)


@kernel_part
def timed_targets(route, tick, most_ticks):  # type: ignore[no-untyped-def]
    """Return the points due on a route with times, x, y px (most_ticks + 1, 2), from a tick on.

    The result is (0, 2) for a route without times.
    """
    count = most_ticks + 1 if route.when.size else 0
    targets = np.empty((count, 2))
    for t in range(count):
        targets[t, 0], targets[t, 1] = point_along(route, due_along(route, tick + t))
    return targets


@finite_leaf
def heading_vector(lead, way):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the heading of a way of the search that shows a film row.

    way: of dtype `WAY`; lead: of the film row, of dtype `LEAD`.
    """
    return lead.cos * way.cos - lead.sin * way.sin, lead.sin * way.cos + lead.cos * way.sin


@finite_leaf
def estimate_path_cost(lead, way, direction, route, targets_and_steering):  # type: ignore[no-untyped-def]
    """Estimate the cost, in ticks, of leaving the path in the next ticks if the film plays on.

    The cost is integrated by Simpson's rule over the places to which the film leads (lead, dtype
    `LEAD`), less what steering can correct until then. way: of dtype `WAY`; direction: cosine and
    sine of its heading; route: `Route`; targets_and_steering: x, y px due at each tick, and
    `Steering`.
    """
    half, steering = lead.ticks // 2, targets_and_steering[1]
    half_step = lead.half_ahead, lead.half_left, lead.half_far, half
    middle = _path_deviation(way, half_step, direction, route, targets_and_steering)
    whole_step = lead.ahead, lead.left, lead.far, lead.ticks
    end = _path_deviation(way, whole_step, direction, route, targets_and_steering)
    deviation_cost = steering.late if route.when.size else steering.across
    return deviation_cost * lead.ticks * (4.0 * middle + end) / 6.0


@finite_leaf
def _path_deviation(way, film_step, direction, route, targets_and_steering):  # type: ignore[no-untyped-def]
    """Return the cost, in squared body lengths, of how far off the path the film leads.

    What steering can correct is taken off; beyond a body length the cost is linear. film_step: px
    ahead, px to the left, px as the crow flies, and ticks; way: of dtype `WAY`; direction: cosine
    and sine of its heading; targets_and_steering: x, y px due at each tick, and `Steering`.
    """
    (ahead, left, far, ticks), (cos, sin) = film_step, direction
    targets, steering = targets_and_steering
    x, y = way.x + ahead * cos - left * sin, way.y - ahead * sin - left * cos
    if route.when.size:
        to_x, to_y = targets[way.ticks + ticks, 0], targets[way.ticks + ticks, 1]
    else:
        to_x, to_y = point_along(route, way.along + far)
    off = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2) - far * np.radians(steering.turn) * ticks / 2
    return offset_cost(max(off, 0.0) ** 2, steering.length_px**2)


def place_by_rule(
    rule: Rule, fish: Fish, world: FilmWorld, rng: np.random.Generator
) -> tuple[Floats, int] | None:
    """Return the place (2,), px, that a rule sends a fish to, and for how many ticks it holds.

    With a leader it is a body length behind the leader, for this decision alone (0 ticks). None
    where the rule requests nothing.
    """
    length = world.motion.body_length_px
    if rule.leader is not None:
        angle = np.radians(rule.others.headings_deg[rule.leader])
        x, y = rule.others.places[rule.leader] - length * np.array([np.cos(angle), -np.sin(angle)])
        return np.array(world.tank.nearest_legal_point(float(x), float(y))), 0
    shoaling = rule.shoaling
    assert shoaling is not None
    last_step = fish.speed * shoaling.horizon / world.motion.rate_hz
    decider = DecidingFish(fish.x, fish.y, fish.heading, last_step)
    place = next_place_in_school(decider, rule.others, shoaling, world.walls, rng)
    if place is None:
        return None
    return np.array(world.tank.nearest_legal_point(*place)), shoaling.horizon
