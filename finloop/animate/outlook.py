"""The way of a fish that swims as the forecast predicts, compiled: free, or along a wall."""

from typing import NamedTuple

import numpy as np

from finloop.animate.bounds import fits, moved_off
from finloop.animate.kinematics import ahead, bearing, touches, towards_by
from finloop.base.kernel import kernel, leaf_kernel


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
