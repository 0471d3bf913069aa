"""How fast a brisk fish of the film swims and turns."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.motion import courses
from finloop.animate.plan_settings import Settings
from finloop.base.arrays import Floats

_QUICKEST = 0.99  # quantile of speeds and turn rates; beyond it are faults
_FASTEST = 0.998  # quantile of speeds


class Brisk(NamedTuple):
    """turn_deg: by how much a brisk fish turns in a tick, over Δ; ahead: ticks in which it turns by
    `matching.ahead_turn`; fastest: the film's highest speed, body lengths/s.
    """

    turn_deg: float
    ahead: int
    fastest: float


def learn_brisk(features: pd.DataFrame, rate_hz: float, delta: int, p: Settings) -> Brisk:
    """Return how fast the fish of a feature table swim and turn; delta: Δ in frames."""
    every = courses(features, rate_hz, delta)
    turned = [np.abs(c.heading_deg[delta:] - c.heading_deg[:-delta]) / delta for c in every]
    speeds = np.concatenate([c.speed for c in every])
    return Brisk(
        brisk_of(np.concatenate(turned), p),
        _ticks_to_turn([c.heading_deg for c in every], delta, p),
        float(np.quantile(speeds, _FASTEST)),
    )


def _ticks_to_turn(headings: Sequence[Floats], delta: int, settings: Settings) -> int:
    """Ticks, whole Δ, in which a brisk fish turns by `ahead_turn`; as many as `look_ahead` at most.

    headings: of each track, unwrapped. In a shorter time its head sways with the tail.
    """
    most = max(1, round(settings.look_ahead))
    for times in range(1, most):
        lag = times * delta
        turned = [np.abs(one[lag:] - one[:-lag]) for one in headings]
        every = np.concatenate(turned)
        if len(every) and np.quantile(every, settings.brisk) >= settings.ahead_turn:
            return lag
    return most * delta


def brisk_of(sizes: Floats, settings: Settings) -> float:
    """The speed, or turn rate, of a brisk fish among those (n,) of a film.

    A quantile; of a fish that rests for most of the film a share of the quickest.
    """
    quantile, quickest = np.quantile(sizes, (settings.brisk, _QUICKEST))
    return float(max(quantile, settings.brisk_least * quickest, 1e-6))
