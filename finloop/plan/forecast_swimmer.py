"""Network mode by the forecast: every tick is foretold from the ones before (`finloop.forecast`).

At every decision the fish may go on with the row that it follows, or go over to a similar one of
the film or its mirror image. The search that weighs the film's ways weighs each (`search`); a row
that leads to the goal in less time is more likely. The fish moves as is foretold for its own
past and that row's control. The frame of the row is drawn, its pose going on as joins do.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.animate.company import clear_ticks
from finloop.animate.kinematics import Target, aim_in
from finloop.animate.state import Fish
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FORECAST, FORETOLD, FRAME, WALL
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import wrap_deg
from finloop.forecast.film import MOTION
from finloop.forecast.sampling import Sampler, follow, ways
from finloop.forecast.sampling import at_row as state_at
from finloop.plan.advance import Pace, course, held
from finloop.plan.cost import Rarity
from finloop.plan.graph import foretold_film
from finloop.plan.objectives import to_goal
from finloop.plan.search import SearchStart, Ways, weigh
from finloop.plan.space import SearchGraph, footage_of, reach_of, search_graph
from finloop.plan.walls import beyond
from finloop.plan.world import FilmWorld

_TRIES = 8  # ways that are tried one after the other before the fish slides along a wall


class ForecastSwimmer:
    """Swims as is foretold.

    sampler: of `endless`; rarity: of the film's rows.
    """

    def __init__(self, waters: FilmWorld, sampler: Sampler, rarity: Rarity) -> None:
        motion, p = waters.motion, waters.settings
        self.waters = waters
        self.sampler = sampler
        self._rarity = rarity
        self.rules = waters.cost_weights(p.look_ahead, p.stride, p.beam, p.again)
        px = motion.body_length_px / motion.rate_hz
        self.pace = Pace(px, float(np.degrees(1 / motion.rate_hz)))
        rows = np.arange(len(sampler.usable))
        leads = np.flatnonzero(sampler.usable | (np.diff(sampler.start) > 0))
        after = np.minimum(np.searchsorted(leads, rows), len(leads) - 1)
        near = leads[np.stack([np.maximum(after - 1, 0), after])]
        self._near = near[np.abs(near - rows).argmin(0), rows]

    @cached_property
    def footage(self) -> SearchGraph:
        """The film, with jumps to similar rows, as it is searched for goals and along paths."""
        waters, p = self.waters, self.waters.settings
        film = foretold_film(waters.film, self.sampler)
        rules = waters.cost_weights(p.path_ahead, p.path_stride, p.path_beam, p.path_again)
        return footage_of(search_graph(film, waters.bounds, rules), reach_of(waters), rules.stride)

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, in a state of the film."""
        x, y = self.waters.tank.random_point(rng)
        row = int(rng.choice(np.flatnonzero(self.sampler.usable)))
        return Fish(x, y, float(rng.uniform(-180, 180)), 0.0, FORECAST, -1, row=row)

    def with_past(self, fish: Fish) -> tuple[Fish, Floats]:
        """The fish and its past; one that has none takes that of the row on screen."""
        if fish.past is not None:
            return fish, fish.past
        row = int(self._near[fish.row])
        return replace(fish, row=row), state_at(self.sampler, row).past

    def _weigh(self, fish: Fish, rows: Ints, aim: Target) -> Floats:
        """Return what following rows (k,) costs, in ticks; infinite where they leave the tank."""
        film = self.footage.film
        rots = np.asarray(wrap_deg(fish.heading - film.heading[rows]), float)
        every = Ways(rows.astype(np.int64), rots, np.zeros(len(rows)), rows != fish.row)
        here = SearchStart(
            fish.x, fish.y, fish.tick, fish.speed, fish.since, fish.recent, fish.repeat,
            fish.company, int(film.rest[fish.row]), self.waters.price_of_rest(fish, aim),
        )  # fmt: skip
        codes = self.sampler.states[:, :-MOTION]
        far = np.linalg.norm(codes[rows] - codes[fish.row], axis=1)
        joins = self._rarity.of_joins(rows, far)
        return weigh(self.footage, every, here, to_goal(aim), self.rules)[1].value + joins

    def course(self, states: Floats, fish: Fish, row: int) -> Floats:
        """The way (n + 1, 3) of states (n, d) that follow a row, the fish's own place first."""
        start = np.array([fish.x, fish.y, fish.heading])
        nowhere = Target(fish.x, fish.y, 0.0, 0.0, True)
        way, _, _ = course(self.waters.bounds, states, row, start, nowhere, self.pace)
        return np.concatenate([start[None], way])

    def next(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Swim on towards the goal: follow a row till the next decision."""
        fish, past = self.with_past(fish)
        swum, p = self.sampler, self.waters.settings
        near_px = p.arrived * self.waters.touch_px
        aim = aim_in(self.waters.tank, (fish.x, fish.y), goal, near_px)
        start = np.array([fish.x, fish.y, fish.heading])
        towards = (goal, aim, self.pace)
        rows, chance = ways(swum, fish.row)
        most = max(1, self.waters.ticks(p.follow_most))
        if fish.since + 1 >= most and len(rows) > 1:
            chance[-1] = 0.0
        costs = self._weigh(fish, rows, aim)
        if not np.isfinite(costs).any():  # a wall is ahead: look farther round
            more, likely = farther(swum, rows)
            theirs = self._weigh(fish, more, aim)
            if np.isfinite(theirs).any():
                rows, chance, costs = more, likely, theirs
        free = np.isfinite(costs)
        with np.errstate(divide="ignore"):
            liked = np.log(chance) - np.minimum(costs, 1e6) / self.waters.ticks(p.chance)
        order = np.argsort(-(liked + rng.gumbel(size=len(rows))))
        ticks = int(rng.geometric(1 / swum.follow))
        best = -1
        for other in rows[order[:_TRIES]].tolist():
            left = max(1, most - fish.since - 1) if other == fish.row else most
            foretold = follow(swum, past, other, min(ticks, left), swum.control[other])
            foretold = np.ascontiguousarray(foretold[::-1])  # kernels are compiled for it alone
            whole = course(self.waters.bounds, foretold, other, start, goal, self.pace)
            numbers = other + 1 + np.arange(len(foretold))
            good = min(whole[1], clear_ticks(fish.company, numbers, whole[0], fish.tick))
            if good > best:
                row, states, (way, _, touched), best = other, foretold, whole, good
            if min(touched, len(way) - 1) < best:
                break
        at_wall = not free.any() and best < min(ticks, self.waters.motion.delta)
        at_wall |= not goal.free and self._rests_before_wall(fish, row, best)
        reason = FORETOLD
        if best == 0 or at_wall:  # a wall holds it up: along it, and round to the aim
            most_deg = self.waters.brisk.turn_deg
            way, touched = held(self.waters.bounds, states, row, start, towards, most_deg)
            best, reason = len(way), WALL
        n = min(best, touched + 1)
        numbers = row + 1 + np.arange(n)
        value = float(costs.min()) if free.any() else np.nan
        decision = Decision(reason, value_s=value / self.waters.motion.rate_hz)
        return Stretch(
            FORECAST, way[:n], numbers, row != fish.row, aim, touched < n,
            decision._replace(ways=len(rows)), FRAME,
            wrap_deg(way[:n, 2] - self.waters.film.heading[numbers]),
            past=np.concatenate([past[::-1], states[:n]]),
        )  # fmt: skip

    def _rests_before_wall(self, fish: Fish, row: int, ticks: int) -> bool:
        """Whether a fish rests for some ticks that it follows a row, with a wall ahead."""
        bounds, room = self.waters.bounds, self.rules.room
        rests = self.sampler.rests[row + 1 : row + 1 + ticks].all()
        return bool(rests and beyond(bounds, fish.x, fish.y, fish.heading, room) > 0.0)


def farther(sampler: Sampler, rows: Ints) -> tuple[Ints, Floats]:
    """Rows (k,) that are similar to similar rows, all equally likely."""
    lists: list[NDArray[Any]] = [rows]
    lists += [sampler.to[sampler.start[row] : sampler.start[row + 1]] for row in rows]
    every = np.unique(np.concatenate(lists))
    return every, np.full(len(every), 1 / len(every))
