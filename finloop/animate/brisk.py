"""How fast a brisk fish of the film swims and turns."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.motion import courses
from finloop.animate.plan_settings import Settings
from finloop.base.arrays import Floats

_QUICKEST = 0.99  # quantile of speeds and turn rates; beyond it are faults
_FASTEST = 0.998  # quantile of speeds


class Brisk(NamedTuple):
    """turn_deg: by how much a brisk fish turns in a tick, over Δ; fastest: the film's highest
    speed, body lengths/s.
    """

    turn_deg: float
    fastest: float


def learn_brisk(features: pd.DataFrame, rate_hz: float, delta: int, p: Settings) -> Brisk:
    """Return how fast the fish of a feature table swim and turn; delta: Δ in frames."""
    every = courses(features, rate_hz, delta)
    turned = [np.abs(c.heading_deg[delta:] - c.heading_deg[:-delta]) / delta for c in every]
    speeds = np.concatenate([c.speed for c in every])
    return Brisk(
        brisk_of(np.concatenate(turned), p),
        float(np.quantile(speeds, _FASTEST)),
    )


def brisk_of(sizes: Floats, settings: Settings) -> float:
    """The speed, or turn rate, of a brisk fish among those (n,) of a film.

    A quantile; of a fish that rests for most of the film a share of the quickest.
    """
    quantile, quickest = np.quantile(sizes, (settings.brisk, _QUICKEST))
    return float(max(quantile, settings.brisk_least * quickest, 1e-6))
