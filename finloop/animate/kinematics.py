"""Steps of a fish through the tank, compiled: straight ahead and round a turn.

Angles are degrees, anticlockwise as seen (y is down), lengths pixels.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.arena import Tank, inside
from finloop.base.arrays import Floats, Mask
from finloop.base.kernel import kernel, leaf_kernel


class Target(NamedTuple):
    """A place to touch, px: the centre or the head, `head_px` ahead, comes within `touch_px`.

    free: whether the fish only wanders: by sprites it swims there, in the film it goes where the
    film does.
    """

    x: float
    y: float
    touch_px: float
    head_px: float
    free: bool = False


def aim_in(tank: Tank, place: tuple[float, float], goal: Target, near_px: float) -> Target:
    """Return the point to head for: the legal place nearest to a goal, or one on the way there.

    place: of the fish, x, y px. The goal itself where that place is less than `near_px` away.
    """
    legal = tank.into(goal.x, goal.y)
    if np.hypot(legal[0] - place[0], legal[1] - place[1]) < near_px:
        return goal
    x, y = tank.waypoint(*place, *legal)
    return goal._replace(x=float(x), y=float(y))


class Ahead(NamedTuple):
    """A swim straight ahead, tick by tick (n,).

    forward: px per tick; drift: of the heading since the start, degrees; brake: px that the fish
    needs to stop.
    """

    forward: Floats
    drift: Floats
    brake: Floats


class Turning(NamedTuple):
    """A turn, tick by tick (n,).

    share: of the turn that is done, rising to 1; forward, sideways: px per tick, along the heading
    and towards the inside of the turn.
    """

    share: Floats
    forward: Floats
    sideways: Floats


@leaf_kernel
def rotate(dx: float, dy: float, rot: float):  # type: ignore[no-untyped-def]
    """Return a displacement on the screen (y down), turned anticlockwise as seen."""
    angle = np.radians(rot)
    cos, sin = np.cos(angle), np.sin(angle)
    return dx * cos + dy * sin, dy * cos - dx * sin


@leaf_kernel
def wrap(angle: float) -> float:
    """Return the same angle in (−180, 180]."""
    return 180.0 - (180.0 - angle) % 360.0


@leaf_kernel
def bearing(x: float, y: float, to_x: float, to_y: float) -> float:
    """Return the direction of one point seen from another."""
    return np.degrees(np.arctan2(y - to_y, to_x - x))


@leaf_kernel
def towards_by(own: float, error: float, most: float) -> float:
    """Return the steering turn of a fish whose pictures turn by `own`; `error`: of its heading.

    Beside its own turn it turns by `most` at most, and by both not faster than by either.
    """
    rest = wrap(error - own)
    both = own + min(max(rest, -most), most)
    fastest = max(abs(own), most)
    return min(max(both, -fastest), fastest)


@leaf_kernel
def offset_point(x: float, y: float, heading: float, forward: float, sideways: float):  # type: ignore[no-untyped-def]
    """Return the point `forward` along the heading and `sideways` to its left."""
    angle = np.radians(heading)
    cos, sin = np.cos(angle), np.sin(angle)
    return x + forward * cos - sideways * sin, y - forward * sin - sideways * cos


@leaf_kernel
def touches(x: float, y: float, heading: float, spot: Target) -> bool:
    """Return whether a fish touches a target."""
    dx, dy = x - spot.x, y - spot.y
    reach = 1.001 * (spot.touch_px + spot.head_px)
    if dx * dx + dy * dy > reach * reach:
        return False  # too far for the head, too; most calls end here, without sines
    head_x, head_y = offset_point(x, y, heading, spot.head_px, 0.0)
    return (
        np.hypot(dx, dy) <= spot.touch_px
        or np.hypot(head_x - spot.x, head_y - spot.y) <= spot.touch_px
    )


@kernel
def straight(legal: Mask, start: Floats, swim: Ahead, goal: Target):  # type: ignore[no-untyped-def]
    """Swim ahead from `start` (x, y, heading), tick by tick.

    Returns
    -------
    way (n, 3) : x, y, heading; ticks that stay legal, and could stop within the legal; the tick at
    which the goal is touched, n where it is not.
    """
    n = swim.forward.size
    way = np.empty((n, 3))
    x, y = start[0], start[1]
    good, reached = n, n
    for k in range(n):
        heading = start[2] + swim.drift[k]
        x, y = offset_point(x, y, heading, swim.forward[k], 0.0)
        way[k, 0], way[k, 1], way[k, 2] = x, y, heading
        stop_x, stop_y = offset_point(x, y, heading, swim.brake[k], 0.0)
        if good == n and not (inside(legal, x, y) and inside(legal, stop_x, stop_y)):
            good = k
        if reached == n and touches(x, y, heading, goal):
            reached = k
    return way, good, reached


@kernel
def turn(  # type: ignore[no-untyped-def]
    legal: Mask, start: Floats, swim: Turning, goal: Target, aim: Target, fastest: float
):  # fmt: skip
    """Turn from `start` (x, y, heading) towards the point `aim`, tick by tick.

    The error of the heading against the bearing of the aim, which changes as the fish moves, falls
    as the share of the turn rises: strictly, to 0 where it is 1. No tick may turn by more than
    `fastest` degrees, or back: the aim would be too near.

    Returns
    -------
    way (n, 3) : x, y, heading, up to the touch; whether it is legal and no tick turns too fast or
    back; the tick at which the goal is touched, n where it is not.
    """
    n = swim.share.size
    way = np.empty((n, 3))
    x, y, heading = start[0], start[1], start[2]
    error = wrap(bearing(x, y, aim.x, aim.y) - heading)
    side = 1.0 if error > 0 else -1.0
    for k in range(n):
        x, y = offset_point(x, y, heading, swim.forward[k], side * swim.sideways[k])
        towards = bearing(x, y, aim.x, aim.y) - error * (1.0 - swim.share[k])
        step = wrap(towards - heading)
        heading += step
        way[k, 0], way[k, 1], way[k, 2] = x, y, heading
        if not (0.0 <= side * step <= fastest and inside(legal, x, y)):
            return way, False, n
        if touches(x, y, heading, goal):
            return way, True, k
    return way, True, n
