"""Steps of a fish through the tank, compiled: straight ahead and round a turn.

Angles are degrees, anticlockwise as seen (y is down), lengths pixels.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from finloop.animate.arena import inside

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def wrap(angle: float) -> float:
    """The same angle in (−180, 180]."""
    return 180.0 - (180.0 - angle) % 360.0


@njit(cache=True, nogil=True)
def bearing(x: float, y: float, to_x: float, to_y: float) -> float:
    """Direction of one point seen from another."""
    return np.degrees(np.arctan2(y - to_y, to_x - x))


@njit(cache=True, nogil=True)
def ahead(x: float, y: float, heading: float, forward: float, sideways: float):  # type: ignore[no-untyped-def]
    """Where one comes to, `forward` along the heading and `sideways` to its left."""
    angle = np.radians(heading)
    cos, sin = np.cos(angle), np.sin(angle)
    return x + forward * cos - sideways * sin, y - forward * sin - sideways * cos


@njit(cache=True, nogil=True)
def touches(x: float, y: float, heading: float, head: float, at: Floats, radius: float) -> bool:
    """Whether the centre, or the head `head` before it, is within `radius` of the point `at`."""
    head_x, head_y = ahead(x, y, heading, head, 0.0)
    return (
        np.hypot(x - at[0], y - at[1]) <= radius
        or np.hypot(head_x - at[0], head_y - at[1]) <= radius
    )


@njit(cache=True, nogil=True)
def straight(  # type: ignore[no-untyped-def]
    legal: NDArray[np.bool_],
    start: Floats,
    forward: Floats,
    drift: Floats,
    brake: Floats,
    head: float,
    at: Floats,
    radius: float,
):
    """Swim ahead from `start` (x, y, heading), tick by tick.

    `forward` (n,) per tick; `drift` (n,) of the heading since the start; `brake` (n,) how far the
    fish goes on before it can have stopped.

    Returns
    -------
    way (n, 3) : x, y, heading; ticks that stay legal, and could stop within the legal; the tick at
    which `at` is touched, n where it is not.
    """
    n = forward.size
    way = np.empty((n, 3))
    x, y = start[0], start[1]
    good, reached = n, n
    for k in range(n):
        heading = start[2] + drift[k]
        x, y = ahead(x, y, heading, forward[k], 0.0)
        way[k] = x, y, heading
        stop_x, stop_y = ahead(x, y, heading, brake[k], 0.0)
        if good == n and not (inside(legal, x, y) and inside(legal, stop_x, stop_y)):
            good = k
        if reached == n and touches(x, y, heading, head, at, radius):
            reached = k
    return way, good, reached


@njit(cache=True, nogil=True)
def turn(  # type: ignore[no-untyped-def]
    legal: NDArray[np.bool_],
    start: Floats,
    share: Floats,
    forward: Floats,
    sideways: Floats,
    head: float,
    at: Floats,
    radius: float,
    target: Floats,
    fastest: float,
):
    """Turn from `start` (x, y, heading) towards the point `target`, tick by tick.

    The error of the heading against the bearing of the target, which changes as the fish moves,
    falls as `share` (n,) rises: strictly, to 0 where it is 1. `sideways` is towards the inside of
    the turn. No tick may turn by more than `fastest`, or back: the target would be too near.

    Returns
    -------
    way (n, 3) : x, y, heading, up to the touch; whether it is legal and no tick turns too fast or
    back; the tick at which `at` is touched, n where it is not.
    """
    n = share.size
    way = np.empty((n, 3))
    x, y, heading = start[0], start[1], start[2]
    error = wrap(bearing(x, y, target[0], target[1]) - heading)
    side = 1.0 if error > 0 else -1.0
    for k in range(n):
        x, y = ahead(x, y, heading, forward[k], side * sideways[k])
        aim = bearing(x, y, target[0], target[1]) - error * (1.0 - share[k])
        step = wrap(aim - heading)
        heading += step
        way[k] = x, y, heading
        if not (0.0 <= side * step <= fastest and inside(legal, x, y)):
            return way, False, n
        if touches(x, y, heading, head, at, radius):
            return way, True, k
    return way, True, n
