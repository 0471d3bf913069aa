"""What of a path's ways is taken: a plan, the runs of film that it shows, and their seams."""

from typing import NamedTuple

import numpy as np

from finloop.animate.beam import Found
from finloop.animate.decide import Ways, verdicts
from finloop.animate.film import Film, runs
from finloop.animate.state import Fish, Options, Run
from finloop.base.arrays import Floats, Ints
from finloop.features.table import wrap_deg


class Spread(NamedTuple):
    """How much the film's fish differ: turn_deg: of the turn over Δ; speed: body lengths/s."""

    turn_deg: float
    speed: float


def spread(film: Film, delta: int) -> Spread:
    """The standard deviation of the film's turns over Δ, and its median speed."""
    rows = film.rows[: film.filmed]
    first = np.flatnonzero(runs(rows["more"]) >= delta)
    if not len(first):
        return Spread(0.0, 0.0)
    turned = wrap_deg(rows["heading"][first + delta] - rows["heading"][first])
    return Spread(float(turned.std()), float(np.median(rows["speed"][first])))


class Plan(NamedTuple):
    """The way that is taken of some (k,) that could be.

    value: what it costs, in ticks; terms (k, 3): what each costs at once, in ticks; rows, ticks
    (l,): with which its legs begin, and how long they are.
    """

    value: float
    ways: Ways
    taken: int
    terms: Floats
    found: Found
    rows: Ints
    ticks: Ints

    def options(self, rate_hz: float) -> Options:
        """What was weighed."""
        return Options(
            self.ways.rows, self.ways.rots, self.ways.seams, self.terms / rate_hz,
            self.found.value / rate_hz, self.found.ticks, verdicts(self.found),
            self.taken,
        )  # fmt: skip

    def runs(self, swum: int) -> tuple[Run, ...]:
        """The runs of its first ticks, about so many; of one that comes to an end the first leg's.

        Legs that go on by the film are one run.
        """
        whole = np.cumsum(self.ticks) <= swum if np.isfinite(self.value) else np.zeros(1, bool)
        count = max(1, np.count_nonzero(whole))
        rows, ticks = self.rows[:count], self.ticks[:count]
        new = np.append(True, rows[1:] != rows[:-1] + ticks[:-1])
        total = np.add.reduceat(ticks, np.flatnonzero(new))
        return tuple(map(Run, rows[new].tolist(), total.tolist()))


def seam_to(film: Film, fish: Fish, row: int) -> tuple[float, float]:
    """The seam, in median steps, and the turn, degrees, of a row that a fish shows next."""
    own = fish.row + 1
    if row == own:
        return 0.0, fish.rot
    end = film.rows["end"][own]
    jumps = slice(film.start[end], film.start[end + 1])
    seam = float(film.seam[jumps][film.to[jumps] == row][0])
    turned = film.rows["heading"][own] + fish.rot - film.rows["heading"][row]
    return seam, float(wrap_deg(turned)) if film.body else fish.rot
