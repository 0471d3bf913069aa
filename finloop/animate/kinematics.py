"""Steps of a fish through the tank, compiled: straight ahead and round a turn.

Angles are degrees, anticlockwise as seen (y is down), lengths pixels.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.arena import Tank, is_legal_point
from finloop.base.arrays import Floats, Mask
from finloop.base.kernel import kernel, leaf_kernel


class Target(NamedTuple):
    """A place x, y px that a fish touches if its centre or head is within `touch_px` of it.

    head_px: distance of the head from the centre. free: whether the fish only wanders: by sprites
    it swims to the place, in the film it goes where the film goes.
    """

    x: float
    y: float
    touch_px: float
    head_px: float
    free: bool = False


def next_aim(tank: Tank, place_px: tuple[float, float], goal: Target, near_px: float) -> Target:
    """Return where to head now: a waypoint, the legal place nearest to a goal, or the goal itself.

    place_px: x, y of the fish. It heads for the goal itself where that legal place is less than
    `near_px` away.
    """
    legal = tank.nearest_legal_point(goal.x, goal.y)
    if np.hypot(legal[0] - place_px[0], legal[1] - place_px[1]) < near_px:
        return goal
    x, y = tank.waypoint(*place_px, *legal)
    return goal._replace(x=float(x), y=float(y))


class StraightSwim(NamedTuple):
    """Straight swimming, tick by tick (n,): speed, drift of the heading, and stopping distance.

    forward: px per tick; drift: change of the heading since the start, degrees; brake: px that the
    fish needs to stop.
    """

    forward: Floats
    drift: Floats
    brake: Floats


class Turning(NamedTuple):
    """A turn, tick by tick (n,).

    share: part of the turn that is done, rising to 1; forward, sideways: px per tick, along the
    heading and towards the inside of the turn.
    """

    share: Floats
    forward: Floats
    sideways: Floats


@leaf_kernel
def rotate_by_cos_sin(dx: float, dy: float, cos: float, sin: float) -> tuple[float, float]:
    """Return a displacement dx, dy on screen (y down), turned anticlockwise by an angle.

    cos, sin: of the angle.
    """
    return dx * cos + dy * sin, dy * cos - dx * sin


@leaf_kernel
def rotate(dx: float, dy: float, angle_deg: float) -> tuple[float, float]:
    """Return a displacement dx, dy on screen (y down), turned anticlockwise by `angle_deg`."""
    angle = np.radians(angle_deg)
    return rotate_by_cos_sin(dx, dy, np.cos(angle), np.sin(angle))


@leaf_kernel
def wrap(angle: float) -> float:
    """Return an angle, in degrees, moved by whole turns into (−180, 180]."""
    return 180.0 - (180.0 - angle) % 360.0


@leaf_kernel
def bearing(x: float, y: float, to_x: float, to_y: float) -> float:
    """Return the direction, degrees, in which (to_x, to_y) px lies as seen from (x, y) px."""
    return np.degrees(np.arctan2(y - to_y, to_x - x))


@leaf_kernel
def turn_towards_aim(picture_turn: float, aim_error: float, most_correction: float) -> float:
    """Return by how many degrees a fish turns in a tick to head for its aim.

    picture_turn: degrees by which its pictures turn; aim_error: bearing of the aim minus heading,
    degrees; most_correction: the largest turn in addition, degrees. The whole turn is at most the
    larger of |picture_turn| and most_correction.
    """
    missing = wrap(aim_error - picture_turn)
    turn = picture_turn + min(max(missing, -most_correction), most_correction)
    fastest = max(abs(picture_turn), most_correction)
    return min(max(turn, -fastest), fastest)


@leaf_kernel
def offset_point(
    x: float, y: float, heading: float, forward: float, sideways: float
) -> tuple[float, float]:
    """Return the point `forward` px ahead of x, y px along a heading, and `sideways` px left."""
    angle = np.radians(heading)
    cos, sin = np.cos(angle), np.sin(angle)
    return x + forward * cos - sideways * sin, y - forward * sin - sideways * cos


@leaf_kernel
def touches_target(x: float, y: float, heading: float, target: Target) -> bool:
    """Return whether a fish at x, y px and a heading [°] touches a target with its centre or head.

    It touches what is within `target.touch_px`; its head is `target.head_px` ahead of its centre.
    """
    dx, dy = x - target.x, y - target.y
    reach = 1.001 * (target.touch_px + target.head_px)  # a little more than needed, for rounding
    if dx * dx + dy * dy > reach * reach:
        return False  # too far for the head, too; most calls end here, without sines
    head_x, head_y = offset_point(dx, dy, heading, target.head_px, 0.0)
    square_px2 = min(dx * dx + dy * dy, head_x * head_x + head_y * head_y)
    return square_px2 <= target.touch_px * target.touch_px


@kernel
def swim_ahead(
    legal: Mask, start: Floats, swim: StraightSwim, goal: Target
) -> tuple[Floats, int, int]:
    """Swim straight on; return the trajectory, the number of safe ticks, and the tick of touch.

    legal (h, w): where the fish's centre may be; start (3,): x, y px, heading in degrees; swim:
    what the fish does at each of n ticks. The trajectory (n, 3) has the columns of `start`, and
    goes on after the touch. Its first ticks are safe as long as both the place and the one at which
    the fish could stop from there are legal. The tick of touch is the first at which the goal is
    touched, n if it never is.
    """
    n = swim.forward.size
    trajectory = np.empty((n, 3))
    x, y = start[0], start[1]
    safe_ticks, touch_tick = n, n
    for k in range(n):
        heading = start[2] + swim.drift[k]
        x, y = offset_point(x, y, heading, swim.forward[k], 0.0)
        trajectory[k, 0], trajectory[k, 1], trajectory[k, 2] = x, y, heading
        stop_x, stop_y = offset_point(x, y, heading, swim.brake[k], 0.0)
        if safe_ticks == n and not (
            is_legal_point(legal, x, y) and is_legal_point(legal, stop_x, stop_y)
        ):
            safe_ticks = k
        if touch_tick == n and touches_target(x, y, heading, goal):
            touch_tick = k
    return trajectory, safe_ticks, touch_tick


@kernel
def swim_turn(
    legal: Mask, start: Floats, swim: Turning, goal: Target, aim: Target, fastest: float
) -> tuple[Floats, bool, int]:
    """Swim a turn to an aim; return the trajectory, whether it is possible, and the tick of touch.

    legal (h, w): where the fish's centre may be; start (3,): x, y px, heading in degrees; aim: the
    point to head for, on the way to the goal; goal: its touch ends the turn; fastest: largest turn
    in a tick, degrees. The heading is off the aim's present bearing by a part of its error at the
    start; the part falls to 0 as `swim.share`, how much of the turn is done, rises to 1. The
    trajectory (n, 3) has the columns of `start` and is filled up to the touch. The turn is possible
    if all its places are legal and no tick turns back or by more than `fastest`. The tick of touch
    is n where the goal is not touched.
    """
    n = swim.share.size
    trajectory = np.empty((n, 3))
    x, y, heading = start[0], start[1], start[2]
    error = wrap(bearing(x, y, aim.x, aim.y) - heading)
    side = 1.0 if error > 0 else -1.0  # to the left, or right
    for k in range(n):
        x, y = offset_point(x, y, heading, swim.forward[k], side * swim.sideways[k])
        wanted = bearing(x, y, aim.x, aim.y) - error * (1.0 - swim.share[k])
        step = wrap(wanted - heading)
        heading += step
        trajectory[k, 0], trajectory[k, 1], trajectory[k, 2] = x, y, heading
        if not (0.0 <= side * step <= fastest and is_legal_point(legal, x, y)):
            return trajectory, False, n
        if touches_target(x, y, heading, goal):
            return trajectory, True, k
    return trajectory, True, n
