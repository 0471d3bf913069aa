"""Steering: what brings a fish onto a path that the film does not quite lead along, compiled.

From tick to tick a fish moves as the film's fish moved, and is *steered*: turned a little, and
shifted a little, by no more than a share of what the film's fish turn and move. The film says where
it leads in the next ticks; the turn is the one that brings that place onto the path.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.bounds import fits
from finloop.animate.kinematics import rotate
from finloop.animate.route import Route, asked_at, done, foot, heading_at, least_along, place
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import finite_leaf, kernel

_ONWARD = 0.1  # body lengths; a place ahead that is nearer is steered to as if it were so far


class Steering(NamedTuple):
    """How a fish is steered, and what leaving the path costs.

    turn [°/tick, of a brisk fish], shift [px/tick at a body length/s]: the most that is corrected,
    less of a slower fish, of one that rests nothing; brisk: speed of a brisk fish, body lengths/s;
    reach: ticks of film that are looked ahead of; length_px: a body length. In ticks that a tick
    costs: across, late: a body length beside the path, and from the place that is asked for now;
    heading: at right angles to the heading that is asked for; effort: the most correction.
    """

    turn: float
    shift: float
    brisk: float
    reach: int
    length_px: float
    across: float
    late: float
    heading: float
    effort: float


NO_STEERING = Steering(0.0, 0.0, 1.0, 0, 1.0, 0.0, 0.0, 0.0, 0.0)


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


@finite_leaf
def tick_cost(route: Route, at, foot_at, used, tick: int, steering: Steering) -> float:  # type: ignore[no-untyped-def]
    """What a tick costs, in ticks: beside the path, late, headed otherwise, and by its effort.

    at: x, y, heading; foot_at: along, x, y; used: corrections, as shares of the most:
    of the turn of a brisk fish, of the shift of its own speed.
    """
    square = steering.length_px * steering.length_px
    x, y, heading = at
    cost = steering.across * near((foot_at[1] - x) ** 2 + (foot_at[2] - y) ** 2, square)
    if route.when.size:
        tx, ty = place(route, asked_at(route, tick))
        cost += steering.late * near((tx - x) ** 2 + (ty - y) ** 2, square)
    if route.heading.size:
        off = np.radians(heading_at(route, foot_at[0]) - heading)
        cost += steering.heading * (1.0 - np.cos(off))
    return cost + steering.effort * (used[0] * used[0] + used[1] * used[1])


@finite_leaf
def near(far2: float, unit2: float) -> float:
    """The square of a distance in units; beyond one unit it grows as the distance does."""
    share = far2 / unit2
    return share if share < 1.0 else 2.0 * np.sqrt(share) - 1.0


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
