"""Tempo: how far a fish lags behind the film's fish, and what it costs to lag farther.

To rest is always possible, where a way that moves may leave the tank. So a fish that only wanders
would rest longer, and swim more slowly, than the film's. It *lags* by as many ticks as a fish of
the film's mean speed needs for what it has swum less; who is ahead lags by less than nothing. The
price of a slow way is the greater, the farther the fish lags beside what is usual in the film.
"""

from itertools import accumulate, chain
from typing import NamedTuple

import numpy as np

from finloop.animate.film import Film, lags, mean_step_px
from finloop.base.arrays import Floats

_MOST = 3.0  # times the usual lag; beyond it nothing gets dearer
_BASE = 0.25  # of the price at the usual lag, along a path for who does not lag


class Tempo(NamedTuple):
    """How the film's fish swim.

    step_px: their mean way in a tick; keeps: share of a lag that is left after a tick; usual: root
    mean square of their lags, ticks.
    """

    step_px: float
    keeps: float
    usual: float

    @classmethod
    def of(cls, film: Film, memory: float, least: float) -> "Tempo":
        """The tempo of a film.

        memory: ticks after which a third of a lag is left; least: ticks, the smallest usual lag.
        """
        rows, keeps = film.rows[: film.filmed], float(np.exp(-1 / memory))
        tracks = np.split(lags(rows), np.flatnonzero(~rows["more"]) + 1)
        summed = [accumulate(one.tolist(), lambda left, lag: keeps * left + lag) for one in tracks]
        usual = float(np.sqrt(np.mean(np.fromiter(chain(*summed), float) ** 2)))
        return cls(mean_step_px(rows), keeps, max(usual, least))

    def after(self, lag: float, way: Floats, begin: tuple[float, float]) -> float:
        """The lag at the end of a way (n, 3) x, y px, heading, that begins at x, y."""
        path = np.hypot(*np.diff(way[:, :2], axis=0, prepend=[begin]).T)
        n = len(path)
        return float(
            self.keeps**n * lag + self.keeps ** np.arange(n)[::-1] @ (1 - path / self.step_px)
        )

    def price(self, lag: float, share: float) -> float:
        """Ticks that a tick on the spot costs whoever lags so far; < 0: that it is worth.

        share: the price at the usual lag.
        """
        return share * min(max(lag / self.usual, -_MOST), _MOST)

    def price_along(self, lag: float, share: float) -> float:
        """The same on a path, on which who is slow keeps nearer to it; never < 0."""
        return share * max(_BASE + min(lag / self.usual, _MOST), 0.0)
