"""The objective of a fish: to a goal, along a path, by a rule; and the cost still to come."""

from typing import NamedTuple

import numpy as np

from finloop.animate.kinematics import Target, touches
from finloop.animate.route import NO_ROUTE, Route, asked_at, place
from finloop.animate.rule import Rule
from finloop.animate.state import Fish
from finloop.base.arrays import Floats
from finloop.base.kernel import finite_leaf, kernel_part, leaf_kernel
from finloop.plan.cost import NO_STEERING, Steering, huber
from finloop.plan.world import FilmWorld
from finloop.social.rule import DecidingFish, next_place_in_school


class Objective(NamedTuple):
    """What a fish swims for: a place to touch (aim), or, if route has places, a path."""

    aim: Target
    route: Route
    steering: Steering


ANYWHERE = Target(0.0, 0.0, 0.0, 0.0, free=True)
"""The target of a fish without one: it goes where the film or its path goes."""


def to_goal(aim: Target) -> Objective:
    """Return the objective to touch a place (aim)."""
    return Objective(aim, NO_ROUTE, NO_STEERING)


def along_path(route: Route, steering: Steering) -> Objective:
    """Return the objective to follow a path (route), corrected by the steering."""
    return Objective(ANYWHERE, route, steering)


# --- for the search: is the objective done, and what is the cost to come?


@leaf_kernel
def is_done(graph, way, objective):  # type: ignore[no-untyped-def]
    """Return whether a way has reached its aim and can go on from there, or its path's end.

    graph: `SearchGraph`; way: of dtype `WAY`; objective: `Objective`.
    """
    if objective.route.x.size:
        return at_path_end(objective.route, way.along)
    rows = graph.film.rows
    at, heading = rows[way.row], rows[way.row].heading + way.rot
    if objective.aim.free or not touches(way.x, way.y, heading, objective.aim):
        return False
    return at.has_next and rows[way.row + 1].recurrent


@leaf_kernel
def estimate_cost_to_come(lead, way, turned, objective, by):  # type: ignore[no-untyped-def]
    """Estimate the cost to come, in ticks, of a way (dtype `WAY`) that plays on a row of the film.

    lead (dtype `LEAD`): where the film leads from the row; turned: cosine and sine of the heading;
    by: `CostWeights`, and the output of `timed_targets`.
    """
    if objective.route.x.size:
        soon = by[1], objective.steering
        return estimate_path_cost(lead, way, turned, objective.route, soon)
    if objective.aim.free:
        return 0.0
    return estimate_ticks_to(way.x, way.y, turned, objective.aim, by[0])


@leaf_kernel
def estimate_ticks_to(x, y, turned, aim, weights):  # type: ignore[no-untyped-def]
    """Estimate the ticks from x, y px to a target: distance / pace + turn / turning.

    turned: cosine and sine of the heading; weights: `CostWeights`.
    """
    dx, dy = aim.x - x, y - aim.y
    far = np.hypot(dx, dy)
    ahead = (dx * turned[0] + dy * turned[1]) / max(far, 1e-9)
    error = np.degrees(np.arccos(min(max(ahead, -1.0), 1.0)))
    return far / weights.pace + error / weights.turning


@leaf_kernel
def cost_of_time(way, start, objective, weights):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of the time that a way (dtype `WAY`) takes.

    To a goal each tick costs one. On a path without times each tick that brings no progress costs
    `start.lag`; on a path with times 0, as the delay has a cost of its own.
    """
    if not objective.route.x.size:
        return float(way.ticks)
    if objective.route.when.size:
        return 0.0
    return start.lag * (way.ticks - (way.along - start.along) / weights.pace)


@finite_leaf
def at_path_end(route, along):  # type: ignore[no-untyped-def]
    """Return whether `along` px along a path is its end; False on a closed or timed path."""
    if route.closed or route.when.size:
        return False
    return along >= route.step * (route.x.size - 1)


@kernel_part
def timed_targets(route, tick, ticks):  # type: ignore[no-untyped-def]
    """Return the places due on a path with times, x, y px (ticks + 1, 2), from a tick on.

    (0, 2) for a path without times.
    """
    count = ticks + 1 if route.when.size else 0
    asked = np.empty((count, 2))
    for t in range(count):
        asked[t, 0], asked[t, 1] = place(route, asked_at(route, tick + t))
    return asked


@finite_leaf
def heading_vector(at, way):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the heading of a way (dtype `WAY`) that shows row `at`."""
    angle = np.radians(at.heading + way.rot)
    return np.cos(angle), np.sin(angle)


@finite_leaf
def estimate_path_cost(lead, way, turned, route, by):  # type: ignore[no-untyped-def]
    """Estimate the cost, in ticks, of the next ticks on a path if a way plays on a row of the film.

    By Simpson's rule over the places that the film leads to (lead), less what steering can correct
    on the way there. turned: cosine and sine of the heading there; by: output of `timed_targets`,
    `Steering`.
    """
    half, steering = lead.ticks // 2, by[1]
    middle = _path_deviation(
        way, (lead.half_ahead, lead.half_left, lead.half_far, half), turned, route, by
    )
    end = _path_deviation(way, (lead.ahead, lead.left, lead.far, lead.ticks), turned, route, by)
    price = steering.late if route.when.size else steering.across
    return price * lead.ticks * (4.0 * middle + end) / 6.0


@finite_leaf
def _path_deviation(way, lead, turned, route, by):  # type: ignore[no-untyped-def]
    """Return how far off the path a lead comes, less what can be corrected, as `huber` does.

    lead: px ahead, to the left, as the crow flies, and ticks.
    """
    (ahead, left, far, ticks), (cos, sin), (asked, steering) = lead, turned, by
    x, y = way.x + ahead * cos - left * sin, way.y - ahead * sin - left * cos
    if route.when.size:
        to_x, to_y = asked[way.ticks + ticks, 0], asked[way.ticks + ticks, 1]
    else:
        to_x, to_y = place(route, way.along + far)
    off = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2) - far * np.radians(steering.turn) * ticks / 2
    return huber(max(off, 0.0) ** 2, steering.length_px**2)


def rule_target(
    rule: Rule, fish: Fish, world: FilmWorld, rng: np.random.Generator
) -> tuple[Floats, int] | None:
    """Return the place (2,), px, that a rule sends a fish to, and for how many ticks it holds.

    Behind a leader it is a body length behind the leader, for this decision alone (0 ticks). None
    where the rule requests nothing.
    """
    length = world.motion.body_length_px
    if rule.leader is not None:
        angle = np.radians(rule.others.headings_deg[rule.leader])
        x, y = rule.others.places[rule.leader] - length * np.array([np.cos(angle), -np.sin(angle)])
        return np.array(world.tank.into(float(x), float(y))), 0
    shoaling = rule.shoaling
    assert shoaling is not None
    last = fish.speed * shoaling.horizon / world.motion.rate_hz
    own = DecidingFish(fish.x, fish.y, fish.heading, last)
    place = next_place_in_school(own, rule.others, shoaling, world.walls, rng)
    return None if place is None else (np.array(world.tank.into(*place)), shoaling.horizon)
