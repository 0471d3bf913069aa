"""Network mode by the forecast: every tick is foretold from the ones before (`finloop.forecast`).

At every decision the fish may go on with the row that it follows, or go over to a similar one of
the film or its mirror image. Where each leads is looked at along the film; one that stays in the
tank, and leads to the goal in less time, is more likely. The fish moves as is foretold for its own
past and that row's control. The frame of the row is drawn, its pose going on as joins do.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.bounds import beyond, fits, moved_off
from finloop.animate.company import Company, clear_ahead, clear_ticks
from finloop.animate.edit_list import FORETOLD, FRAME, WALL
from finloop.animate.film import foretold_film
from finloop.animate.follow import Footage, footage_of, reach_of
from finloop.animate.kinematics import Spot, ahead, bearing, touches, towards_by, wrap
from finloop.animate.motion import FORECAST, brisk_of
from finloop.animate.rare import Rarity
from finloop.animate.recent import Repeat, again_cost, last_on_screen, times
from finloop.animate.search import Rules, space_of
from finloop.animate.state import Decision, Fish, Stretch, Waters
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, leaf_kernel
from finloop.features.table import wrap_deg
from finloop.forecast.film import MOTION
from finloop.forecast.sampling import Sampler, follow, ways
from finloop.forecast.sampling import at_row as state_at

_TRIES = 8  # ways that are tried one after the other before the fish slides along a wall


class Pace(NamedTuple):
    """How ways are followed and compared.

    px: per tick at one body length/s; turn_deg: per tick at one rad/s; horizon: ticks looked ahead;
    speed [px/tick], turning [°/tick]: of a brisk fish; wall: ticks that every tick at a wall costs;
    dear (n,): ticks that showing the rows up to each costs, summed up; wakes (n,): of `wakes`;
    room, aside: of `search.Rules`.
    """

    px: float
    turn_deg: float
    horizon: int
    speed: float
    turning: float
    wall: float
    dear: Floats
    wakes: Ints
    room: float
    aside: float


class Recall(NamedTuple):
    """What a fish remembers, and what it costs to show it again.

    tick: now; recent (m, 3): of `Fish`; soon: so many ticks of what follows are looked up; again:
    ticks that a row just seen costs; memory: ticks until a row is forgotten; repeat: of `Fish`;
    stay: ticks of a repeat after which going on with it costs twice as much; company: of `Fish`.
    """

    tick: int
    recent: Ints
    soon: int
    again: int
    memory: int
    repeat: Repeat
    stay: int
    company: Company


class ForecastSwimmer:
    """Swims as is foretold.

    sampler: of `endless`; sprite_rows (s,): behind sprites; rarity: of the film's rows.
    """

    def __init__(self, waters: Waters, sampler: Sampler, sprite_rows: Ints, rarity: Rarity) -> None:
        motion, p = waters.motion, waters.settings
        self.waters = waters
        self.sampler = sampler
        self._rarity = rarity
        self._sprite_rows = sprite_rows
        usable = np.flatnonzero(sampler.usable)
        speed = sampler.states[usable][:, -MOTION:]
        px = motion.body_length_px / motion.rate_hz
        turn_deg = float(np.degrees(1 / motion.rate_hz))
        fastest = brisk_of(np.hypot(speed[:, 0], speed[:, 1]), p) * px
        turning = brisk_of(np.abs(speed[:, 2]), p) * turn_deg
        self.pace = Pace(
            px, turn_deg, max(2, waters.ticks(p.ahead)), fastest, turning, p.wall,
            waters.film.dear.copy(), wakes(sampler),
            fastest / np.radians(turning) + motion.body_length_px / 2, 180 / turning,
        )  # fmt: skip
        rows = np.arange(len(sampler.usable))
        leads = np.flatnonzero(sampler.usable | (np.diff(sampler.start) > 0))
        after = np.minimum(np.searchsorted(leads, rows), len(leads) - 1)
        near = leads[np.stack([np.maximum(after - 1, 0), after])]
        self._near = near[np.abs(near - rows).argmin(0), rows]

    @cached_property
    def footage(self) -> Footage:
        """The film as paths are followed through it by a fish that swims as is foretold."""
        waters, p = self.waters, self.waters.settings
        film = foretold_film(waters.film, self.sampler)
        rules = Rules.of(waters, p.path_ahead, p.path_stride, p.path_beam, p.path_again)
        return footage_of(space_of(film, waters.bounds, rules), reach_of(waters))

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, in a state of the film."""
        x, y = self.waters.tank.random_point(rng)
        row = int(rng.choice(np.flatnonzero(self.sampler.usable)))
        return Fish(x, y, float(rng.uniform(-180, 180)), 0.0, FORECAST, -1, row=row)

    def with_past(self, fish: Fish) -> tuple[Fish, Floats]:
        """The fish and its past; one that has none takes that of the row on screen."""
        if fish.past is not None:
            return fish, fish.past
        row = fish.row if fish.row >= 0 else int(self._sprite_rows[fish.sprite])
        row = int(self._near[row])
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
        aim = self.waters.aim(fish, goal, p.arrived * self.waters.touch_px)
        start = np.array([fish.x, fish.y, fish.heading])
        towards, soon = (goal, aim, self.pace), max(1, round(swum.follow))
        again, memory = (self.waters.ticks(time) for time in (p.again, p.memory))
        stay = max(1, self.waters.ticks(p.stay))
        recall = Recall(
            fish.tick, fish.recent, soon, again, memory, fish.repeat, stay, fish.company
        )
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
            most_deg = self.waters.motion.brisk_deg
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


@leaf_kernel
def moved(place, state, pace):  # type: ignore[no-untyped-def]
    """The next place (x, y, heading) of a fish whose next state is this one."""
    x, y = ahead(place[0], place[1], place[2], state[-3] * pace.px, state[-2] * pace.px)
    return x, y, place[2] + state[-1] * pace.turn_deg


@kernel
def look(sampler, bounds, rows, start, towards, recall):  # type: ignore[no-untyped-def]
    """The cost (k,), in ticks, of following each row: to the touch, or to the horizon and on.

    Of a fish that only wanders, of leaving the tank alone. More where what is shown then was on
    screen just now (`Recall`). And whether (k,) a row stays in the tank. To rest before a wall is
    no way out: what the wall holds up after the rest costs as much.
    start: x, y, heading; towards: goal, aim, `Pace`.
    """
    costs, free = np.empty(rows.size), np.empty(rows.size, np.bool_)
    for k in range(rows.size):
        costs[k], free[k] = _cost(sampler, bounds, rows[k], start, towards, recall)
    return costs, free


@leaf_kernel
def _held_later(sampler, bounds, row, place, swims):  # type: ignore[no-untyped-def]
    """The ticks that a wall holds up a fish that follows a row from a place, rests left out.

    swims: `Pace`, and so many ticks are swum.
    """
    pace, ticks = swims
    walls = 0
    for _ in range(ticks):
        if not sampler.usable[row]:
            break
        row = pace.wakes[row + 1] - 1
        x, y, heading = moved(place, sampler.states[row + 1], pace)
        if not fits(bounds, row + 1, x, y, heading):
            x, y, _ = moved_off(bounds, row + 1, x, y, heading)
            walls += 1
        place, row = (x, y, heading), row + 1
    return walls


@leaf_kernel
def _cost(sampler, bounds, begin, start, towards, recall):  # type: ignore[no-untyped-def]
    """The cost of following the row `begin`, and whether it stays in the tank; see `look`."""
    goal, aim, pace = towards
    cost, free, touched = 0.0, True, False
    row, place, t, swum = begin, (start[0], start[1], start[2]), 0, 0
    while t < pace.horizon and sampler.usable[row] and not touched:
        later = moved(place, sampler.states[row + 1], pace)
        company, tick = recall.company, recall.tick + t
        met = not clear_ahead(company, row + 1, later[0], later[1], later[2], tick)
        fit = fits(bounds, row + 1, later[0], later[1], later[2])
        if not fit:  # it slides along the wall, and turns on
            x, y, _ = moved_off(bounds, row + 1, later[0], later[1], later[2])
            later = x, y, later[2]
        elif met:
            later = place[0], place[1], later[2]
        if met or not fit:
            cost, free = cost + pace.wall, False
        place, row, t = later, row + 1, t + 1
        swum += int(pace.wakes[row] == row)
        touched = not goal.free and touches(place[0], place[1], place[2], goal)
    if swum < t and not touched:
        walls = _held_later(sampler, bounds, row, place, (pace, pace.horizon - swum))
        cost, free = cost + walls * pace.wall, free and walls == 0
    cost += pace.dear[row] - pace.dear[begin]
    if not touched:
        cost += pace.aside * beyond(bounds, place[0], place[1], place[2], pace.room)
    if not goal.free:
        cost += t
        if not touched:
            off = abs(wrap(bearing(place[0], place[1], aim.x, aim.y) - place[2]))
            far = np.hypot(aim.x - place[0], aim.y - place[1])
            cost += far / pace.speed + off / pace.turning
    last = last_on_screen(recall.recent, begin + 1, begin + recall.soon)
    longer = times(recall.repeat, recall.recent, begin + 1, recall.stay)
    return cost + longer * again_cost(recall.tick - last, recall.again, recall.memory), free


@kernel
def held(bounds, states, row, start, towards, most_deg):  # type: ignore[no-untyped-def]
    """The way (n, 3) of states (n, d) after a row, along a wall; the tick of the touch, n for none.

    Every tick turns towards the aim, by `most_deg` at most; no tick turns faster for it than that,
    or than the state itself. start, towards: as for `look`.
    """
    goal, aim, pace = towards
    n = len(states)
    way = np.empty((n, 3))
    x, y, heading, reached = start[0], start[1], start[2], n
    for t in range(n):
        to_x, to_y, turned = moved((x, y, heading), states[t], pace)
        error = bearing(x, y, aim.x, aim.y) - heading
        heading += towards_by(turned - heading, error, most_deg)
        x, y, _ = moved_off(bounds, row + 1 + t, to_x, to_y, heading)
        way[t, 0], way[t, 1], way[t, 2] = x, y, heading
        if reached == n and not goal.free and touches(x, y, heading, goal):
            reached = t
    return way, reached


@kernel
def course(bounds, states, row, start, goal, pace):  # type: ignore[no-untyped-def]
    """The way (n, 3) of states (n, d) from `start`; how many ticks of it fit; the touch, n.

    Angles in degrees; row: the one that is followed.
    """
    n = len(states)
    way = np.empty((n, 3))
    place, good, reached = (start[0], start[1], start[2]), n, n
    for t in range(n):
        place = moved(place, states[t], pace)
        way[t, 0], way[t, 1], way[t, 2] = place
        fit = fits(bounds, row + 1 + t, place[0], place[1], place[2])
        if good == n and not fit:
            good = t
        if reached == n and not goal.free and touches(place[0], place[1], place[2], goal):
            reached = t
    return way, good, reached
