"""Two motion sources: the film, and the forecast's predictions.

Each lists the rows that could be shown next, and how a run from one moves the fish.
"""

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from finloop.animate.state import Fish, Run
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FILM, FORECAST, TERMS
from finloop.features.table import wrap_deg
from finloop.forecast.film import MOTION
from finloop.forecast.sampling import Sampler, follow_row, next_row_weights, start_at_row
from finloop.plan.advance import Pace, arrival, extend_by_film, predicted_way
from finloop.plan.cost import RARITY, Rarity
from finloop.plan.graph import MotionGraph, prediction_graph
from finloop.plan.search import Candidates, SearchStart, add_costs, film_candidates
from finloop.plan.search_graph import SearchGraph, search_graph
from finloop.plan.world import FilmWorld


class Passage(NamedTuple):
    """How a run moves a fish, before steering.

    way (m + 1, 3): x, y px, heading, the fish's own place first, beyond the run as far as steering
    looks ahead; speed (m,): body lengths/s; numbers (n,): rows that are shown; seam: discontinuity
    of the first of them, natural steps; jumps: whether the first does not follow the row on screen;
    past: states of a fish that swims as predicted, the oldest first, those of the run last.
    """

    way: Floats
    speed: Floats
    numbers: Ints
    seam: float
    jumps: bool
    past: Floats | None = None


class MotionSource(Protocol):
    """Lists rows to show next, and moves a fish by them. state: FILM or FORECAST."""

    state: int

    @property
    def graph(self) -> SearchGraph:
        """Return the graph that the search follows."""

    def candidates(
        self, fish: Fish, lag: float, along: float
    ) -> tuple[Candidates, SearchStart] | None:
        """Return the rows that could be shown next, with costs, and the start; None without any.

        lag: ticks that a tick on the spot costs; along: px along the path.
        """

    def passage(self, fish: Fish, run: Run) -> Passage:
        """Return how a run of film, begun at the fish's next tick, moves it."""


class FilmSource:
    """Moves a fish as the film's fish moves, by playing the film on or jumping to a similar row."""

    state = FILM

    def __init__(self, world: FilmWorld) -> None:
        self._world = world

    @cached_property
    def graph(self) -> SearchGraph:
        """Return the graph of the film's own rows, their mirror images, and their jumps."""
        world = self._world
        return search_graph(world.film, world.bounds, world.cost_weights, world.reach)

    def candidates(
        self, fish: Fish, lag: float, along: float
    ) -> tuple[Candidates, SearchStart] | None:
        """Return the film's next row and its jumps, with costs, and the start; None without any.

        lag: ticks that a tick on the spot costs; along: px along the path.
        """
        film = self.graph.film
        if fish.row < 0 or not film.has_next[fish.row]:
            return None
        made = film_candidates(film, fish.row + 1, fish.rot)
        if not len(made.rows):
            return None
        x, y = arrival(film, fish.x, fish.y, fish.row, fish.rot)
        start = _start(fish, (x, y, fish.tick + 1), lag, along)
        add_costs(film, made, start, self._world.cost_weights)
        return made, start

    def passage(self, fish: Fish, run: Run) -> Passage:
        """Return how a run of film, begun at the fish's next tick, moves it."""
        film, row = self.graph.film, run.row
        seam, rot = _seam_to(film, fish, row)
        begins = np.array([
            [fish.x, fish.y, fish.heading],
            [*arrival(film, fish.x, fish.y, fish.row, fish.rot), film.rows["heading"][row] + rot],
        ])  # fmt: skip
        way = extend_by_film(self.graph, begins, row, rot, run.ticks - 1 + self._world.reach)
        ticks = min(run.ticks, len(way) - 1)
        speed = np.append(film.speed[fish.row], film.speed[row : row + len(way) - 2])
        return Passage(way, speed, np.arange(row, row + ticks), seam, row != fish.row + 1)


class PredictionSource:
    """Moves a fish as the forecast predicts. sampler: from `without_dead_ends`."""

    state = FORECAST

    def __init__(self, world: FilmWorld, sampler: Sampler, rarity: Rarity) -> None:
        self._world, self.sampler, self._rarity = world, sampler, rarity
        rate, length = world.motion.rate_hz, world.motion.body_length_px
        self._pace = Pace(length / rate, float(np.degrees(1 / rate)))
        rows = np.arange(len(sampler.usable))
        leads = np.flatnonzero(sampler.usable | (np.diff(sampler.start) > 0))
        after = np.minimum(np.searchsorted(leads, rows), len(leads) - 1)
        near = leads[np.stack([np.maximum(after - 1, 0), after])]
        self._near = near[np.abs(near - rows).argmin(0), rows]

    @cached_property
    def graph(self) -> SearchGraph:
        """Return the graph of the film's rows, with jumps to rows like them by the forecast."""
        world = self._world
        film = prediction_graph(world.film, self.sampler)
        return search_graph(film, world.bounds, world.cost_weights, world.reach)

    def candidates(
        self, fish: Fish, lag: float, along: float
    ) -> tuple[Candidates, SearchStart] | None:
        """Return the rows similar to the fish's, with costs, and the start; None without any.

        lag: ticks that a tick on the spot costs; along: px along the path.
        """
        film = self.graph.film
        fish, _ = self._with_past(fish)
        rows = next_row_weights(self.sampler, fish.row)[0].astype(np.int64)
        rows = rows[film.recurrent[rows]]
        if not len(rows):
            return None
        rots = np.asarray(wrap_deg(fish.heading - film.heading[rows]), float)
        terms = np.zeros((len(rows), len(TERMS)))
        codes = self.sampler.states[:, :-MOTION]
        far = np.linalg.norm(codes[rows] - codes[fish.row], axis=1)
        terms[:, RARITY] = self._rarity.transition_costs(rows, far)
        made = Candidates(rows, rots, np.zeros(len(rows)), rows != fish.row, terms)
        start = _start(fish, (fish.x, fish.y, fish.tick), lag, along)
        add_costs(film, made, start, self._world.cost_weights)
        return made, start

    def passage(self, fish: Fish, run: Run) -> Passage:
        """Return how the predictions of a run, begun at the fish's next tick, move it."""
        film, row = self.graph.film, run.row
        fish, past = self._with_past(fish)
        states = follow_row(self.sampler, past, row, run.ticks, self.sampler.control[row])
        states = np.ascontiguousarray(states[::-1])
        begins = predicted_way(states, np.array([fish.x, fish.y, fish.heading]), self._pace)
        last = row + len(states)
        rot = float(begins[-1, 2] - film.rows["heading"][last])
        way = extend_by_film(self.graph, begins, last, rot, self._world.reach)
        speed = film.speed[row : row + len(way) - 1]
        numbers = row + 1 + np.arange(len(states))
        shown = np.concatenate([past[::-1], states])
        return Passage(way, speed, numbers, np.nan, row != fish.row, shown)

    def _with_past(self, fish: Fish) -> tuple[Fish, Floats]:
        """Return the fish and its past; without one it takes that of the row on screen."""
        if fish.past is not None:
            return fish, fish.past
        row = int(self._near[fish.row])
        return replace(fish, row=row), start_at_row(self.sampler, row).past


def _start(fish: Fish, place: tuple[float, float, int], lag: float, along: float) -> SearchStart:
    """Return the start of a search whose candidates are shown at a place (x, y, tick).

    The first tick of the next stretch counts as `fish.tick` + 1.
    """
    company = fish.company
    later = company._replace(start=company.start + 1, until=company.until + 1)
    return SearchStart(*place, fish.recent, later, lag, along)


def _seam_to(film: MotionGraph, fish: Fish, row: int) -> tuple[float, float]:
    """Return the seam, in median steps, and the turn, degrees, of a row that is shown next."""
    own = fish.row + 1
    if row == own:
        return np.nan, fish.rot
    end = film.rows["jump_slot"][own]
    jumps = slice(film.start[end], film.start[end + 1])
    seam = float(film.seam[jumps][film.to[jumps] == row][0])
    turned = film.rows["heading"][own] + fish.rot - film.rows["heading"][row]
    return seam, float(wrap_deg(turned)) if film.body else fish.rot
