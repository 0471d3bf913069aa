"""What of the ways that were weighed is taken: a plan, and the runs of film that it shows."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.kinematics import wrap
from finloop.animate.memory import Repeat, remembered, repeated
from finloop.animate.state import Fish, Run
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import SPOT, WAITING
from finloop.edit.stretch import Stretch
from finloop.features.table import wrap_deg
from finloop.plan.graph import MotionGraph
from finloop.plan.search import Outcomes, Ways, verdicts
from finloop.plan.world import FilmWorld


@dataclass(frozen=True)
class Options:
    """Rows (k,) that could be shown next, and the verdict on each.

    rots: by how much they would be turned; seams: distances in median steps; terms (k, 3): seconds
    that showing them costs at once, for the seam, for the change of speed, for what was on screen
    just now; value: seconds to the goal that the best way from there takes, with these and its
    further jumps, infinite where there is none; ticks: how long it stays in the tank; verdict:
    number in `VERDICTS`; taken: which one was, −1 for none.
    """

    rows: Ints
    rots: Floats
    seams: Floats
    terms: Floats
    value: Floats
    ticks: Floats
    verdict: NDArray[np.int8]
    taken: int = -1


class Plan(NamedTuple):
    """The way that is taken of some (k,) that could be.

    value: what it costs, in ticks; terms (k, 3): what each costs at once, in ticks; rows, ticks
    (l,): with which its legs begin, and how long they are.
    """

    value: float
    ways: Ways
    taken: int
    terms: Floats
    found: Outcomes
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


def seam_to(film: MotionGraph, fish: Fish, row: int) -> tuple[float, float]:
    """The seam, in median steps, and the turn, degrees, of a row that a fish shows next."""
    own = fish.row + 1
    if row == own:
        return 0.0, fish.rot
    end = film.rows["end"][own]
    jumps = slice(film.start[end], film.start[end + 1])
    seam = float(film.seam[jumps][film.to[jumps] == row][0])
    turned = film.rows["heading"][own] + fish.rot - film.rows["heading"][row]
    return seam, float(wrap_deg(turned)) if film.body else fish.rot


def after(fish: Fish, stretch: Stretch, waters: FilmWorld) -> Fish:
    """The fish at the end of a stretch of film."""
    ticks, number = len(stretch.way), int(stretch.number[-1])
    x, y, heading = map(float, stretch.way[-1])
    film = waters.film
    assert stretch.rot is not None
    return Fish(
        x, y, float(wrap(heading)),
        speed=0.0 if stretch.decision.reason in (SPOT, WAITING) else float(film.speed[number]),
        state=stretch.state, sprite=-1, phase=fish.phase, area=float(film.area[number]),
        tick=fish.tick + ticks, row=number, rot=float(stretch.rot[-1]),
        since=ticks - 1 if stretch.new else fish.since + ticks,
        waits=fish.waits + ticks if stretch.waits else 0,
        recent=_remembered(fish, stretch, waters), repeat=_repeated(fish, stretch),
        past=None if stretch.past is None else np.ascontiguousarray(stretch.past[ticks:][::-1]),
        lag=waters.tempo.after(fish.lag, stretch.way, (fish.x, fish.y)),
    )  # fmt: skip


def _remembered(fish: Fish, stretch: Stretch, waters: FilmWorld) -> Ints:
    """The film that was on screen within the memory, with that of a stretch."""
    since = fish.tick - waters.settings.memory * waters.motion.delta
    first, last = stretch.number[[0, -1]].tolist()
    return remembered(fish.recent, first, last, fish.tick, since)


def _repeated(fish: Fish, stretch: Stretch) -> Repeat:
    """The repeat after a stretch."""
    first, last = stretch.number[[0, -1]].tolist()
    return repeated(fish.repeat, fish.recent, first, last)
