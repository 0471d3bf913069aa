"""Controls made from a motion: backwards, slower or faster, still, fading in and out.

Motions are arrays (ticks, fish, F) of states as the display draws them (DRAWN). All functions are
pure. Between two ticks the rules are those of the display's page: places, sizes, alpha and posture
are interpolated linearly, headings the shorter way; pictures, their mixture and the look are the
nearer tick's.
"""

import math

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.stimulus.drawn import ALPHA, HEADING, LOOK, PICTURE, States
from finloop.stimulus.parts import Change

_STEPS = slice(PICTURE, LOOK + 1)
"""Pictures, their mixture, their sides and the look, which are not interpolated."""


def planned_ticks(change: Change | None, ticks: int) -> int:
    """Return how many ticks of a motion to plan so that it lasts `ticks` ticks after its change."""
    if change is None:
        return ticks
    return 1 if change.still else math.ceil((ticks - 1) * change.speed - 1e-9) + 1


def apply_change(states: States, change: Change | None, ticks: int | None = None) -> States:
    """Return a motion (n, fish, F) after a condition's change, at most `ticks` ticks; None: all.

    Only the first `planned_ticks` of the motion are used, also backwards. A still motion holds its
    first state for `ticks` ticks, or for as many as it had.
    """
    if ticks is not None:
        states = states[: planned_ticks(change, ticks)]
    if change is None:
        return states
    if change.still:
        return np.repeat(states[:1], len(states) if ticks is None else ticks, axis=0)
    if change.reversed:
        states = states[::-1]
    return states if change.speed == 1 else change_playback_rate(states, change.speed)[:ticks]


def change_playback_rate(states: States, speed: float) -> States:
    """Return the motion (ticks, fish, F) at `speed` times its playback rate; below 1, slower."""
    count = math.floor((len(states) - 1) / speed + 1e-9) + 1
    return interpolate_states(states, speed * np.arange(count, dtype=float))


def interpolate_states(states: States, at: Floats) -> States:
    """Return the states (n, fish, F) of a motion (ticks, fish, F) at n times within it.

    at (n,): times in ticks from the first one on.
    """
    last = len(states) - 1
    at = np.clip(at, 0, last)
    tick = at.astype(int)
    share = (at - tick)[:, None, None]
    before, after = states[tick], states[np.minimum(tick + 1, last)]
    nearer = np.where(share < 0.5, before, after)
    step = after.astype(float) - before
    step[..., HEADING] = (step[..., HEADING] + np.pi) % (2 * np.pi) - np.pi
    made = (before + share * step).astype(np.float32)
    made[..., _STEPS] = nearer[..., _STEPS]
    # A fish that is absent at one of the two ticks has no place to come from, or to go to.
    comes = (before[..., PICTURE] < 0) != (after[..., PICTURE] < 0)
    return np.where(comes[..., None], nearer, made)


def fade_shares(count: int, ticks: int) -> NDArray[np.float32]:
    """Return shares (count,) of alpha, tick by tick: 0 to 1 in `ticks` ticks, at the end to 0."""
    if ticks <= 0:
        return np.ones(count, np.float32)
    end = np.arange(count)
    return np.minimum(1.0, np.minimum(end, end[::-1]) / ticks).astype(np.float32)


def fade_states(states: States, ticks: int) -> States:
    """Return the states (n, fish, F), faded in over `ticks` ticks and out over the last ones."""
    made = states.copy()
    made[..., ALPHA] *= fade_shares(len(states), ticks)[:, None]
    return made


def with_look(states: States, look: int) -> States:
    """Return the states (…, fish, F) with look number `look`, an index of `Protocol.looks`."""
    made = states.copy()
    made[..., LOOK] = look
    return made
