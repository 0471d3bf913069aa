"""Network mode by the forecast: every tick is foretold from the ones before (`finloop.forecast`).

At every decision the fish may go on with the row that it follows, or go over to a similar one of
the film or its mirror image. Where each leads is looked at along the film; one that stays in the
tank, and leads to the goal in less time, is more likely. The fish moves as is foretold for its own
past and that row's control. The frame of the row is drawn, its pose going on as joins do.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.animate.brisk import brisk_of
from finloop.animate.company import clear_ticks
from finloop.animate.film import foretold_film
from finloop.animate.kinematics import Spot, aim_in
from finloop.animate.objectives import footage_of, reach_of
from finloop.animate.outlook import Pace, Recall, course, held, look
from finloop.animate.rare import Rarity
from finloop.animate.space import Rules, Space, space_of
from finloop.animate.state import Fish, Waters
from finloop.base.arrays import Floats, Ints, Mask
from finloop.edit.schema import FORECAST, FORETOLD, FRAME, WALL
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import wrap_deg
from finloop.forecast.film import MOTION
from finloop.forecast.sampling import Sampler, follow, ways
from finloop.forecast.sampling import at_row as state_at

_TRIES = 8  # ways that are tried one after the other before the fish slides along a wall


class ForecastSwimmer:
    """Swims as is foretold.

    sampler: of `endless`; rarity: of the film's rows.
    """

    def __init__(self, waters: Waters, sampler: Sampler, rarity: Rarity) -> None:
        motion, p = waters.motion, waters.settings
        self.waters = waters
        self.sampler = sampler
        self._rarity = rarity
        usable = np.flatnonzero(sampler.usable)
        speed = sampler.states[usable][:, -MOTION:]
        px = motion.body_length_px / motion.rate_hz
        turn_deg = float(np.degrees(1 / motion.rate_hz))
        fastest = brisk_of(np.hypot(speed[:, 0], speed[:, 1]), p) * px
        turning = brisk_of(np.abs(speed[:, 2]), p) * turn_deg
        horizon = max(2, waters.ticks(p.ahead), waters.brisk.ahead)
        self.pace = Pace(
            px, turn_deg, horizon, fastest, turning, p.wall,
            waters.film.dear.copy(), wakes(sampler),
            fastest / np.radians(turning) + motion.body_length_px / 2, 180 / turning,
        )  # fmt: skip
        rows = np.arange(len(sampler.usable))
        leads = np.flatnonzero(sampler.usable | (np.diff(sampler.start) > 0))
        after = np.minimum(np.searchsorted(leads, rows), len(leads) - 1)
        near = leads[np.stack([np.maximum(after - 1, 0), after])]
        self._near = near[np.abs(near - rows).argmin(0), rows]

    @cached_property
    def footage(self) -> Space:
        """The film as paths are followed through it by a fish that swims as is foretold."""
        waters, p = self.waters, self.waters.settings
        film = foretold_film(waters.film, self.sampler)
        rules = Rules.of(waters, p.path_ahead, p.path_stride, p.path_beam, p.path_again)
        return footage_of(space_of(film, waters.bounds, rules), reach_of(waters), rules.stride)

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

    def _look(
        self,
        fish: Fish,
        rows: Ints,
        start: Floats,
        towards: tuple[Spot, Spot, Pace],
        recall: Recall,
    ) -> tuple[Floats, Mask]:
        """`look`, and what it costs to join on at each row."""
        codes = self.sampler.states[:, :-MOTION]
        far = np.linalg.norm(codes[rows] - codes[fish.row], axis=1)
        costs, free = look(self.sampler, self.waters.bounds, rows, start, towards, recall)
        return costs + self._rarity.of_joins(rows, far), free

    def course(self, states: Floats, fish: Fish, row: int) -> Floats:
        """The way (n + 1, 3) of states (n, d) that follow a row, the fish's own place first."""
        start = np.array([fish.x, fish.y, fish.heading])
        nowhere = Spot(fish.x, fish.y, 0.0, 0.0, True)
        way, _, _ = course(self.waters.bounds, states, row, start, nowhere, self.pace)
        return np.concatenate([start[None], way])

    def next(self, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
        """Swim on towards the goal: follow a row till the next decision."""
        fish, past = self.with_past(fish)
        swum, p = self.sampler, self.waters.settings
        near_px = p.arrived * self.waters.touch_px
        aim = aim_in(self.waters.tank, (fish.x, fish.y), goal, near_px)
        start = np.array([fish.x, fish.y, fish.heading])
        towards, soon = (goal, aim, self.pace), max(1, round(swum.follow))
        again, memory = (self.waters.ticks(time) for time in (p.again, p.memory))
        stay = max(1, self.waters.ticks(p.stay))
        recall = Recall(
            fish.tick, fish.recent, soon, again, memory, fish.repeat, stay, fish.company,
            self.waters.price_of_rest(fish, aim), self.waters.tempo.step_px,
        )  # fmt: skip
        rows, chance = ways(swum, fish.row)
        most = max(1, self.waters.ticks(p.follow_most))
        if fish.since + 1 >= most and len(rows) > 1:
            chance[-1] = 0.0
        costs, free = self._look(fish, rows, start, towards, recall)
        if not free.any():  # a wall is ahead: look farther round
            more, likely = farther(swum, rows)
            theirs, free = self._look(fish, more, start, towards, recall)
            if free.any():
                rows, chance, costs = more, likely, theirs
        with np.errstate(divide="ignore"):
            liked = np.log(chance) - costs / self.waters.ticks(p.chance)
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
            if good <= self.pace.wakes[other + 1] - other - 1 and not free.any():
                good = 0  # to rest is no way round the wall
            if good > best:
                row, states, (way, _, touched), best = other, foretold, whole, good
            if min(touched, len(way) - 1) < best:
                break
        at_wall = not free.any() and best < min(ticks, self.waters.motion.delta)
        reason = FORETOLD
        if best == 0 or at_wall:  # a wall holds it up: along it, and round to the aim
            most_deg = self.waters.brisk.turn_deg
            way, touched = held(self.waters.bounds, states, row, start, towards, most_deg)
            best, reason = len(way), WALL
        n = min(best, touched + 1)
        numbers = row + 1 + np.arange(n)
        decision = Decision(reason, value_s=float(costs.min()) / self.waters.motion.rate_hz)
        return Stretch(
            FORECAST, way[:n], numbers, row != fish.row, aim, touched < n,
            decision._replace(ways=len(rows)), FRAME,
            wrap_deg(way[:n, 2] - self.waters.film.heading[numbers]),
            past=np.concatenate([past[::-1], states[:n]]),
        )  # fmt: skip


def wakes(sampler: Sampler) -> Ints:
    """Of each row (n,) the row itself, or where its fish rests the next one where it swims.

    Rows that cannot be followed count as swum.
    """
    n = len(sampler.usable)
    rests = sampler.rests & sampler.usable
    later = np.where(rests, n - 1, np.arange(n))
    return np.minimum.accumulate(later[::-1])[::-1].copy()


def farther(sampler: Sampler, rows: Ints) -> tuple[Ints, Floats]:
    """Rows (k,) that are similar to similar rows, all equally likely."""
    lists: list[NDArray[Any]] = [rows]
    lists += [sampler.to[sampler.start[row] : sampler.start[row + 1]] for row in rows]
    every = np.unique(np.concatenate(lists))
    return every, np.full(len(every), 1 / len(every))
