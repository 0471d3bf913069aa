"""Two motion sources: the film, and the forecast's predictions.

Each lists the rows that could be shown next, and moves the fish along a run from one of them.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from finloop.animate.kinematics import Target, rotate
from finloop.animate.state import Fish, Run
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FILM, FORECAST
from finloop.forecast.film import MOTION
from finloop.forecast.sampling import Sampler, follow_row, start_at_row
from finloop.plan.advance import (
    StepScale,
    extend_trajectory_by_film,
    predicted_trajectory,
    swim_film_run,
    swim_trajectory,
)
from finloop.plan.cost import RARITY, Rarity
from finloop.plan.graph import prediction_graph
from finloop.plan.objectives import Objective
from finloop.plan.search import Candidates, SearchStart, weigh_film_candidates
from finloop.plan.search_graph import SearchGraph, search_graph
from finloop.plan.world import FilmWorld


class Passage(NamedTuple):
    """How a fish swims along a run of film or predictions: trajectory, corrections, rows shown.

    It ends where the fish is done or would leave the tank.

    trajectory (n, 3): x, y px, heading; corrections (n, 2): of steering, degrees and px; along_px:
    px along the path at the end; touches_target: whether the last place does; rows (n,): rows that
    are shown; jumps: whether the first does not follow the row on screen; seam: the discontinuity
    of such a jump, natural steps, else NaN; past: states of a fish that swims as predicted, the
    oldest first, those of the run last.
    """

    trajectory: Floats
    corrections: Floats
    along_px: float
    touches_target: bool
    rows: Ints
    jumps: bool
    seam: float = np.nan
    past: Floats | None = None


class FilmSource:
    """Moves a fish as the film's fish moves, by playing the film on or jumping to a similar row."""

    state = FILM

    def __init__(self, world: FilmWorld) -> None:
        """Keep the world: the tank, the film's motion graph, and statistics of its motion."""
        self._world = world

    @cached_property
    def graph(self) -> SearchGraph:
        """Return the graph of the film's own rows, their mirror images, and their jumps."""
        world = self._world
        return search_graph(world.film, world.bounds, world.cost_weights, world.steering_ticks)

    def candidates(
        self, fish: Fish, rest_cost: float, along_px: float
    ) -> tuple[Candidates, SearchStart] | None:
        """Return the candidates of a fish in the film, with costs, and the start of their search.

        They are the film's next row and its jumps. rest_cost: ticks that a tick on the spot costs;
        along_px: px along the path. None where no row can be shown next.
        """
        film = self.graph.film
        film_row = film.rows[fish.row]
        if fish.row < 0 or not film_row["has_next"]:
            return None
        dx, dy = rotate(film_row["dx"], film_row["dy"], fish.rotation_deg)
        x, y = fish.x + dx, fish.y + dy
        start = _search_start(fish, x, y, fish.tick + 1, rest_cost, along_px)
        weights = self._world.cost_weights
        candidates = weigh_film_candidates(
            film, fish.row + 1, fish.rotation_deg, start.recent, start.tick, weights
        )
        return (candidates, start) if len(candidates.rows) else None

    def swim_run(
        self, fish: Fish, run: Run, along_px: float, objective: Objective, target: Target
    ) -> Passage:
        """Return how a fish swims a run of film from its next tick on, steered to its objective.

        along_px: px along the path at the start; target: ends the run when the fish touches it.
        """
        pose = np.array([fish.x, fish.y, fish.heading, fish.rotation_deg])
        trajectory, corrections, along_px, touches, seam = swim_film_run(
            self.graph, pose, fish.row, run, along_px, fish.tick, objective, target
        )
        rows = np.arange(run.row, run.row + len(trajectory))
        return Passage(
            trajectory, corrections, along_px, touches, rows, run.row != fish.row + 1, seam
        )


class PredictionSource:
    """Moves a fish as the forecast predicts, row by row."""

    state = FORECAST

    def __init__(self, world: FilmWorld, sampler: Sampler, rarity: Rarity) -> None:
        """Keep the sampler; find for each row the nearest one from which a fish can go on."""
        self._world, self.sampler, self._rarity = world, sampler, rarity
        rate, length = world.motion.rate_hz, world.motion.body_length_px
        self._step_scale = StepScale(length / rate, float(np.degrees(1 / rate)))
        self._pose_codes = sampler.states[:, :-MOTION]  # a state is these, and then its motion
        # A fish goes on from a row that it can follow, or that has similar ones. For each row: the
        # last such row before it and the first from it on, of which the nearer is taken.
        rows = np.arange(len(sampler.usable))
        leads_on = np.flatnonzero(sampler.usable | (np.diff(sampler.start) > 0))
        later = np.minimum(np.searchsorted(leads_on, rows), len(leads_on) - 1)
        before_and_after = leads_on[np.stack([np.maximum(later - 1, 0), later])]
        self._nearest = before_and_after[np.abs(before_and_after - rows).argmin(0), rows]

    @cached_property
    def graph(self) -> SearchGraph:
        """Return the graph of the film's rows, with jumps to those that the forecast suggests."""
        world = self._world
        film = prediction_graph(world.film, self.sampler)
        return search_graph(film, world.bounds, world.cost_weights, world.steering_ticks)

    def candidates(
        self, fish: Fish, rest_cost: float, along_px: float
    ) -> tuple[Candidates, SearchStart] | None:
        """Return the candidates of a predicted fish, with costs, and the start of their search.

        They are the rows that the forecast finds similar to the fish's row. rest_cost: ticks that a
        tick on the spot costs; along_px: px along the path. None where no row can be shown next.
        """
        film, row = self.graph.film, self._row_that_leads_on(fish)
        start = _search_start(fish, fish.x, fish.y, fish.tick, rest_cost, along_px)
        candidates = weigh_film_candidates(
            film, row, fish.heading - float(film.rows[row]["heading"]), start.recent, start.tick,
            self._world.cost_weights,
        )  # fmt: skip
        if not len(candidates.rows):
            return None
        candidates.terms[:, RARITY] = self._rarity.transition_costs(
            candidates.rows, self._pose_codes, row
        )
        return candidates, start

    def swim_run(
        self, fish: Fish, run: Run, along_px: float, objective: Objective, target: Target
    ) -> Passage:
        """Return how a fish swims a run of predictions, steered to its objective.

        The predicted trajectory is extended by film, for steering to look ahead. along_px: px along
        the path at the start; target: ends the run when the fish touches it.
        """
        film, row, shown_row = self.graph.film, run.row, self._row_that_leads_on(fish)
        past = fish.past
        if past is None:
            past = start_at_row(self.sampler, shown_row).past
        newest_first = follow_row(self.sampler, past, row, run.ticks, self.sampler.control[row])
        states = np.ascontiguousarray(newest_first[::-1])
        pose = np.array([fish.x, fish.y, fish.heading])
        predicted = predicted_trajectory(states, pose, self._step_scale)
        last_row = row + len(states)
        rotation_deg = float(predicted[-1, 2] - film.rows[last_row]["heading"])
        planned = extend_trajectory_by_film(
            self.graph, predicted, last_row, rotation_deg, self._world.steering_ticks
        )
        speeds = film.speed[row : row + len(planned) - 1].copy()
        rows = row + 1 + np.arange(len(states))  # a fish that follows a row shows the next one
        trajectory, corrections, along_px, touches = swim_trajectory(
            planned, speeds, rows, along_px, fish.tick, objective, target, self.graph
        )
        ticks = len(trajectory)
        return Passage(
            trajectory, corrections, along_px, touches, rows[:ticks], jumps=row != shown_row,
            past=np.concatenate([past[::-1], states[:ticks]]),
        )  # fmt: skip

    def _row_that_leads_on(self, fish: Fish) -> int:
        """Return the row on screen of a predicted fish, else the nearest one that leads on."""
        return int(self._nearest[fish.row]) if fish.past is None else fish.row


MotionSource = FilmSource | PredictionSource
"""Lists rows to show next, and moves a fish by them."""


def _search_start(
    fish: Fish, x: float, y: float, tick: int, rest_cost: float, along_px: float
) -> SearchStart:
    """Return the start of a fish's search, whose candidates are shown at x, y px and a tick.

    rest_cost: ticks that a tick on the spot costs; along_px: px along the path. The other fish are
    known from `fish.tick` + 1 on, the first tick of the next stretch.
    """
    obstacles = fish.obstacles
    if obstacles.near_count:
        obstacles = obstacles._replace(start=obstacles.start + 1, until=obstacles.until + 1)
    return SearchStart(x, y, tick, fish.recent, obstacles, rest_cost, along_px)
