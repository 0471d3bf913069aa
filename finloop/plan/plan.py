"""The plan that is taken of the ways that were weighed, and the runs of film that it shows."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.state import Run
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import CONSIDERED, TERMS, VERDICTS
from finloop.edit.stretch import Decision, Swim
from finloop.plan.cost import CHANCE
from finloop.plan.search import Candidates, Outcomes


@dataclass(frozen=True)
class CandidateVerdicts:
    """Rows (k,) that could be shown next, and the verdict on each.

    rots: degrees by which each would be turned; seams: discontinuities in natural steps; terms (k,
    t): seconds that the best way from each costs, by `TERMS`, 0 where there is none; value: their
    sum without the random part, infinite where there is none; ticks: how long it stays in the tank;
    verdict: index in `VERDICTS`; taken: the chosen one, −1 for none.
    """

    rows: Ints
    rots: Floats
    seams: Floats
    terms: Floats
    value: Floats
    ticks: Floats
    verdict: NDArray[np.int8]
    taken: int = -1

    def add_to(self, decision: Decision) -> Decision:
        """Return a decision with costs and counts of the ways that were weighed added.

        They are the costs of the chosen way and of the cheapest other one, how many ways there
        were, and how many fail each test.
        """
        counts = np.bincount(self.verdict, minlength=len(VERDICTS)).tolist()
        _, tank, quadrant, heading, _ = counts  # in the order of VERDICTS
        others = self.value.copy()
        if self.taken >= 0:
            others[self.taken] = np.inf
        return decision._replace(
            ways=len(self.rows), ways_tank=tank, ways_quadrant=quadrant, ways_heading=heading,
            taken_terms=self._costs(self.value, self.taken),
            other_terms=self._costs(others, int(others.argmin())),
        )  # fmt: skip

    def _costs(self, values: Floats, way: int) -> tuple[float, ...]:
        """Return what a way costs, term by term; () where there is none, or it ends."""
        ends = way < 0 or not np.isfinite(values[way])
        return () if ends else tuple(self.terms[way].tolist())


class Plan(NamedTuple):
    """The way that is taken of the (k,) candidates of one motion source.

    state: of the source, FILM or FORECAST; found: what becomes of each candidate; taken: number of
    the candidate; rows, ticks (l,): first row and length of each leg.
    """

    state: int
    candidates: Candidates
    found: Outcomes
    taken: int
    rows: Ints
    ticks: Ints

    @property
    def value(self) -> float:
        """Return the plan's cost in ticks, without chance; infinite where it leads nowhere."""
        return float(self.found.value[self.taken] - self.found.terms[self.taken, CHANCE])

    def options(self, rate_hz: float) -> CandidateVerdicts:
        """Return the candidates that were weighed, their costs in seconds and verdicts."""
        made, found = self.candidates, self.found
        value = (found.value - found.terms[:, CHANCE]) / rate_hz
        return CandidateVerdicts(
            made.rows, made.rots, made.seams, found.terms / rate_hz, value, found.ticks,
            found.verdicts, self.taken,
        )  # fmt: skip

    def runs(self, most: int) -> tuple[Run, ...]:
        """Return the runs of film of the plan's first ticks: about `most`, at least a leg.

        Legs that play the film on are one run. A plan that leads nowhere has only its first leg.
        """
        runs: list[Run] = []
        left = most if np.isfinite(self.value) else 0
        for row, ticks in zip(self.rows.tolist(), self.ticks.tolist(), strict=True):
            left -= ticks
            if runs and left < 0:
                break
            if runs and row == runs[-1].row + runs[-1].ticks:
                runs[-1] = Run(runs[-1].row, runs[-1].ticks + ticks)
            else:
                runs.append(Run(row, ticks))
        return tuple(runs)


def option_table(found: Swim, ticks: int, filmed: int, fish: int = 0) -> pd.DataFrame:
    """Return the candidates that were weighed in the first `ticks` ticks, columns of `CONSIDERED`.

    found: the animation of the fish; filmed: number of rows of the film, after which its mirror
    images are counted; fish: its number.
    """
    begins = np.cumsum([0] + [len(s.way) for s in found.stretches])
    parts = [_option_rows(tick, o, filmed) for tick, o in zip(
        begins, (s.options for s in found.stretches), strict=False
    ) if tick < ticks and o is not None]  # fmt: skip
    none = pd.DataFrame({name: [] for name in CONSIDERED.names[1:]})
    table = pd.concat(parts, ignore_index=True) if parts else none
    table.insert(0, "fish", fish)
    return table


def _option_rows(tick: int, options: CandidateVerdicts, filmed: int) -> pd.DataFrame:
    ends = np.isinf(options.value)
    terms = {
        f"{name}_s": np.where(ends, np.nan, options.terms[:, k]) for k, name in enumerate(TERMS)
    }
    return pd.DataFrame({
        "tick": tick, "row": options.rows % filmed, "mirrored": options.rows >= filmed,
        "seam": options.seams, "value_s": np.where(ends, np.nan, options.value),
        **terms, "fails": [VERDICTS[verdict] for verdict in options.verdict],
        "taken": np.arange(len(options.rows)) == options.taken,
    })  # fmt: skip
