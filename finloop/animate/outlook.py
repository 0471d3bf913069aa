"""What comes of following a row of the film, compiled: where it leads, and what it costs.

Where the film leads from a row is looked at without the forecast's chance: along the film's own
states. `look` weighs rows so; `course` and `held` are the ways that are swum.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.bounds import beyond, fits, moved_off
from finloop.animate.company import Company, clear_ahead
from finloop.animate.kinematics import ahead, bearing, touches, towards_by, wrap
from finloop.animate.recent import Repeat, again_cost, last_on_screen, times
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import kernel, leaf_kernel


class Pace(NamedTuple):
    """How ways are followed and compared.

    px: per tick at one body length/s; turn_deg: per tick at one rad/s; horizon: ticks looked ahead;
    speed [px/tick], turning [°/tick]: of a brisk fish; wall: ticks that every tick at a wall costs;
    dear (n,): ticks that showing the rows up to each costs, summed up; wakes (n,): of `wakes`;
    room, aside: of `search.Rules`.
    """

    px: float
    turn_deg: float
    horizon: int
    speed: float
    turning: float
    wall: float
    dear: Floats
    wakes: Ints
    room: float
    aside: float


class Recall(NamedTuple):
    """What a fish remembers, and what it costs to show it again.

    tick: now; recent (m, 3): of `Fish`; soon: so many ticks of what follows are looked up; again:
    ticks that a row just seen costs; memory: ticks until a row is forgotten; repeat: of `Fish`;
    stay: ticks of a repeat after which going on with it costs twice as much; company: of `Fish`;
    slow: ticks that every tick on the spot costs; step_px: of `Tempo`.
    """

    tick: int
    recent: Ints
    soon: int
    again: int
    memory: int
    repeat: Repeat
    stay: int
    company: Company
    slow: float
    step_px: float


@leaf_kernel
def moved(place, state, pace):  # type: ignore[no-untyped-def]
    """The next place (x, y, heading) of a fish whose next state is this one."""
    x, y = ahead(place[0], place[1], place[2], state[-3] * pace.px, state[-2] * pace.px)
    return x, y, place[2] + state[-1] * pace.turn_deg


@kernel
def look(sampler, bounds, rows, start, towards, recall):  # type: ignore[no-untyped-def]
    """The cost (k,), in ticks, of following each row: to the touch, or to the horizon and on.

    Of a fish that only wanders, of leaving the tank, and of lagging behind the film (`Tempo`). More
    where what is shown then was on screen just now (`Recall`). And whether (k,) a row stays in the
    tank. To rest before a wall is no way out: what the wall holds up after the rest costs as much.
    start: x, y, heading; towards: goal, aim, `Pace`.
    """
    costs, free = np.empty(rows.size), np.empty(rows.size, np.bool_)
    for k in range(rows.size):
        costs[k], free[k] = _cost(sampler, bounds, rows[k], start, towards, recall)
    return costs, free


@leaf_kernel
def _held_later(sampler, bounds, row, place, swims):  # type: ignore[no-untyped-def]
    """The ticks that a wall holds up a fish that follows a row from a place, rests left out.

    swims: `Pace`, and so many ticks are swum.
    """
    pace, ticks = swims
    walls = 0
    for _ in range(ticks):
        if not sampler.usable[row]:
            break
        row = pace.wakes[row + 1] - 1
        x, y, heading = moved(place, sampler.states[row + 1], pace)
        if not fits(bounds, row + 1, x, y, heading):
            x, y, _ = moved_off(bounds, row + 1, x, y, heading)
            walls += 1
        place, row = (x, y, heading), row + 1
    return walls


@leaf_kernel
def _cost(sampler, bounds, begin, start, towards, recall):  # type: ignore[no-untyped-def]
    """The cost of following the row `begin`, and whether it stays in the tank; see `look`."""
    goal, aim, pace = towards
    cost, free, touched = 0.0, True, False
    row, place, t, swum = begin, (start[0], start[1], start[2]), 0, 0
    while t < pace.horizon and sampler.usable[row] and not touched:
        later = moved(place, sampler.states[row + 1], pace)
        company, tick = recall.company, recall.tick + t
        met = not clear_ahead(company, row + 1, later[0], later[1], later[2], tick)
        fit = fits(bounds, row + 1, later[0], later[1], later[2])
        if not fit:  # it slides along the wall, and turns on
            x, y, _ = moved_off(bounds, row + 1, later[0], later[1], later[2])
            later = x, y, later[2]
        elif met:
            later = place[0], place[1], later[2]
        if met or not fit:
            cost, free = cost + pace.wall, False
        cost += recall.slow * (
            1.0 - np.hypot(later[0] - place[0], later[1] - place[1]) / recall.step_px
        )
        place, row, t = later, row + 1, t + 1
        swum += int(pace.wakes[row] == row)
        touched = not goal.free and touches(place[0], place[1], place[2], goal)
    if swum < t and not touched:
        walls = _held_later(sampler, bounds, row, place, (pace, pace.horizon - swum))
        cost, free = cost + walls * pace.wall, free and walls == 0
    cost += pace.dear[row] - pace.dear[begin]
    if not touched:
        cost += pace.aside * beyond(bounds, place[0], place[1], place[2], pace.room)
    if not goal.free:
        cost += t
        if not touched:
            off = abs(wrap(bearing(place[0], place[1], aim.x, aim.y) - place[2]))
            far = np.hypot(aim.x - place[0], aim.y - place[1])
            cost += far / pace.speed + off / pace.turning
    last = last_on_screen(recall.recent, begin + 1, begin + recall.soon)
    longer = times(recall.repeat, recall.recent, begin + 1, recall.stay)
    return cost + longer * again_cost(recall.tick - last, recall.again, recall.memory), free


@kernel
def held(bounds, states, row, start, towards, most_deg):  # type: ignore[no-untyped-def]
    """The way (n, 3) of states (n, d) after a row, along a wall; the tick of the touch, n for none.

    Every tick turns towards the aim, by `most_deg` at most; no tick turns faster for it than that,
    or than the state itself. start, towards: as for `look`.
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
