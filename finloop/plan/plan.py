"""The plan of a search: its chosen branch, the runs of film it shows, and all its candidates."""

import math
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
    """Rows (k,) that could be shown next, and the verdict of a search on each.

    rotations_deg: by which each would be turned; seams: discontinuities in natural steps; terms (k,
    t): seconds that the best branch from each costs, by `TERMS`, 0 where there is none; costs: the
    sum of a row's terms without the random part, infinite where there is no branch; ticks: how long
    its best branch, else its longest, stays in the tank; verdict: index in `VERDICTS`; taken: index
    of the chosen row, −1 for none.
    """

    rows: Ints
    rotations_deg: Floats
    seams: Floats
    terms: Floats
    costs: Floats
    ticks: Floats
    verdict: NDArray[np.int8]
    taken: int = -1

    def add_to_decision(self, decision: Decision, exit_code: str = "") -> Decision:
        """Return a decision with the costs and the number of the candidates added.

        Added are the costs of the chosen candidate and of the cheapest other one, the number of
        candidates, and how many fail each test. exit_code: of `EXITS`, why the fish leaves the
        film.
        """
        counts = np.bincount(self.verdict, minlength=len(VERDICTS)).tolist()
        _good, tank, quadrant, heading, _passed_over = counts  # in the order of VERDICTS
        others, value_s, taken_terms = self.costs.tolist(), math.nan, ()
        if self.taken >= 0:
            cost, others[self.taken] = others[self.taken], math.inf
            if math.isfinite(cost):
                value_s, taken_terms = cost, tuple(self.terms[self.taken].tolist())
        least_other = min(others)
        other_terms = ()
        if math.isfinite(least_other):
            other_terms = tuple(self.terms[others.index(least_other)].tolist())
        return decision._replace(
            exit=exit_code, value_s=value_s,
            candidates=len(self.rows), candidates_tank=tank, candidates_quadrant=quadrant,
            candidates_heading=heading, taken_terms=taken_terms, other_terms=other_terms,
        )  # fmt: skip


class Plan(NamedTuple):
    """The chosen branch of a search among the candidates (k,) of one motion source.

    state: of the source, FILM or FORECAST; outcomes: of the candidates; taken: number of the chosen
    candidate; rows, ticks (l,): first row and duration of each leg.
    """

    state: int
    candidates: Candidates
    outcomes: Outcomes
    taken: int
    rows: list[int]
    ticks: list[int]

    @property
    def cost(self) -> float:
        """Return the plan's cost, ticks, without its random part; infinite if it leads nowhere."""
        return float(self.outcomes.costs[self.taken] - self.outcomes.terms[self.taken, CHANCE])

    def verdicts(self, rate_hz: float) -> CandidateVerdicts:
        """Return the candidates, what each costs in seconds, and the verdict on each.

        rate_hz: ticks per second. The costs are without their random part (chance).
        """
        candidates, outcomes = self.candidates, self.outcomes
        costs = (outcomes.costs - outcomes.terms[:, CHANCE]) / rate_hz
        return CandidateVerdicts(
            candidates.rows, candidates.rotations_deg, candidates.seams, outcomes.terms / rate_hz,
            costs, outcomes.ticks, outcomes.verdicts, self.taken,
        )  # fmt: skip

    def first_runs(self, most_ticks: int) -> tuple[Run, ...]:
        """Return the runs of film of the plan's first legs: for `most_ticks`, but at least a leg.

        Successive legs between which the film plays on are one run. Of a plan that leads nowhere
        only the first leg counts.
        """
        runs: list[Run] = []
        ticks_left = most_ticks if math.isfinite(self.cost) else 0
        for row, ticks in zip(self.rows, self.ticks, strict=True):
            ticks_left -= ticks
            if runs and ticks_left < 0:
                break
            if runs and row == runs[-1].row + runs[-1].ticks:
                runs[-1] = Run(runs[-1].row, runs[-1].ticks + ticks)
            else:
                runs.append(Run(row, ticks))
        return tuple(runs)


def candidate_table(
    animation: Swim, ticks: int, film_rows: int, fish_number: int = 0
) -> pd.DataFrame:
    """Return the candidates of all searches in an animation, a row each, columns of `CONSIDERED`.

    animation: of one fish, of which the first `ticks` ticks count; film_rows: number of rows of the
    film, after which those of its mirror image are numbered; fish_number: for the table.
    """
    parts, tick = [], 0
    for stretch in animation.stretches:
        if tick < ticks and stretch.options is not None:
            parts.append(_candidate_rows(tick, stretch.options, film_rows))
        tick += len(stretch.trajectory)
    empty = pd.DataFrame({name: [] for name in CONSIDERED.names[1:]})
    table = pd.concat(parts, ignore_index=True) if parts else empty
    table.insert(0, "fish", fish_number)
    return table


def _candidate_rows(tick: int, candidates: CandidateVerdicts, film_rows: int) -> pd.DataFrame:
    """Return the candidates of the search at one tick as rows of a table.

    film_rows: number of rows of the film; a candidate beyond them is a mirror image. value_s: its
    cost, NaN where no branch leads on.
    """
    is_dead_end = np.isinf(candidates.costs)
    terms = {
        f"{name}_s": np.where(is_dead_end, np.nan, candidates.terms[:, k])
        for k, name in enumerate(TERMS)
    }
    return pd.DataFrame({
        "tick": tick, "row": candidates.rows % film_rows, "mirrored": candidates.rows >= film_rows,
        "seam": candidates.seams, "value_s": np.where(is_dead_end, np.nan, candidates.costs),
        **terms, "fails": [VERDICTS[verdict] for verdict in candidates.verdict],
        "taken": np.arange(len(candidates.rows)) == candidates.taken,
    })  # fmt: skip
