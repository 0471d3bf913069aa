"""What a fish does without a way on, or whose way is blocked: stay, turn, make way.

The ladder, from the first to the last: swim the free part of a stretch; stay and turn on the spot;
drift away from the fish in the way, or more and more aside; stay with the same picture.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from finloop.animate.company import lasting_ticks
from finloop.animate.kinematics import Target, bearing, towards_by, wrap
from finloop.animate.state import Fish
from finloop.base.arrays import Floats
from finloop.edit.schema import FILM, FORECAST, FRAME, SPOT, WAITING
from finloop.edit.stretch import Decision, Stretch
from finloop.plan.search import film_candidates
from finloop.plan.walls import kept_inside
from finloop.plan.world import FilmWorld

_AWAY = 3.0  # body lengths from the nearest fish to the place to make way to
_ASIDE_DEG = (0.0, 50.0, -50.0, 100.0, -100.0)  # drifts that are tried one after the other
_DRIFT = 0.05  # body lengths in a Δ, of a fish that has no way


class Fallback:
    """Finds what a fish without a way does. leave: plans how it would swim to a place."""

    def __init__(
        self, world: FilmWorld, leave: Callable[[Fish, Target, np.random.Generator], Stretch]
    ) -> None:
        self._world, self._leave = world, leave
        self._drift_px = _DRIFT * world.motion.body_length_px / world.motion.delta  # in a tick

    def stay(self, fish: Fish, aim: Target, turns: bool = True) -> Stretch:
        """Return a stride in place while film goes on; turns: whether to turn to the aim."""
        film, most_deg = self._world.film, self._world.brisk.turn_deg
        last, begin, rot = len(film.has_next) - 1, fish.row, fish.rot
        if film.has_next[fish.row] and len(rows := film_candidates(film, fish.row + 1, rot).rows):
            begin = int(rows[0])
        if film.body:
            rot = float(wrap(film.heading[min(fish.row + 1, last)] + rot - film.heading[begin]))
        rows = np.arange(begin, begin + self._world.cost_weights.stride)
        next_row = np.minimum(rows[:-1] + 1, last)
        goes_on = film.has_next[next_row] & film.recurrent[np.minimum(next_row + 1, last)]
        rows = rows[: 1 + int(np.argmin(np.append(goes_on, False)))]
        filmed = film.heading[rows] + rot
        way = np.empty((len(rows), 3))
        way[:, 0], way[:, 1] = fish.x, fish.y
        there = bearing(fish.x, fish.y, aim.x, aim.y)
        before = heading = fish.heading
        for k, own in enumerate(filmed):
            if turns:
                heading += towards_by(wrap(own - before), there - heading, most_deg)
            way[k, 2], before = heading, own
        rots = way[:, 2] - film.heading[rows]
        state = FORECAST if fish.state == FORECAST else FILM
        return Stretch(
            state, way, rows, begin != fish.row + 1, aim, False, Decision(SPOT), FRAME, rots
        )  # fmt: skip

    def keep_clear(self, fish: Fish, stretch: Stretch, rng: np.random.Generator) -> Stretch:
        """Return a stretch cut to its free ticks; without any, stay in place or make way.

        Free is inside the tank and clear of other fish. At a wall the fish stays. A fish that
        another blocks, or that turns on the spot beside it, makes way. Where nothing is free, the
        last resort is one tick in place.
        """
        if stretch.decision.reason == SPOT:  # all others stop at the walls
            stretch = self._inside(stretch) or self._at_wall(fish, Target(*stretch.aim))
        company, others = fish.company, fish.company.places[0]
        if not len(others):
            return stretch
        ticks = self.ticks(fish, stretch)
        far = np.hypot(others[:, 0] - fish.x, others[:, 1] - fish.y)
        stuck = stretch.decision.reason == SPOT and far.min() < 2 * company.discs.reach
        if ticks and not stuck:
            return stretch.cut(ticks)
        x, y = others[far.argmin(), :2].tolist()
        for way in self._making_way(fish, x, y, rng):
            other = self._inside(way)
            if other is not None and (ticks := self.ticks(fish, other)):
                return other.cut(ticks)
        return way.cut(1)

    def ticks(self, fish: Fish, stretch: Stretch) -> int:
        """Return for how many ticks a stretch is clear of others, even if the fish then stays."""
        return lasting_ticks(fish.company, stretch.pictures, stretch.way, fish.tick)

    def _inside(self, stretch: Stretch) -> Stretch | None:
        """Return the part of a stretch that stays inside, moved off the walls, or None."""
        most, numbers = self._world.cost_weights.pace, stretch.pictures.astype(np.int64)
        way = kept_inside(self._world.bounds, numbers, stretch.way, most)
        if np.array_equal(way, stretch.way):
            return stretch
        return replace(stretch.cut(len(way)), way=way, touched=False) if len(way) else None

    def _at_wall(self, fish: Fish, aim: Target) -> Stretch:
        """Drift towards open water, and turn if possible, where the next picture does not fit."""
        open_water = Target(*self._world.tank.into(fish.x, fish.y), 0.0, 0.0)
        for stays in self._staying(fish, aim):
            way = self._drifting(fish, stays, open_water)
            if (inside := self._inside(replace(stays, way=way))) is not None:
                return inside
        return stays

    def _making_way(
        self, fish: Fish, x: float, y: float, rng: np.random.Generator
    ) -> Iterator[Stretch]:
        """Yield what a fish can do that another one at x, y blocks, the best first.

        It swims away, if that is quicker than a drift; drifts away, or more and more aside: turning
        there, not turning, with the same picture; stays with the same picture.
        """
        away = self._beyond(fish, x, y, 0.0)
        leaves = self._leave(fish, away, rng)
        # A fish blocked all round may swim, too, and gain nothing: a drift is quicker.
        gains = np.hypot(*(leaves.way[:, :2] - (x, y)).T) - np.hypot(fish.x - x, fish.y - y)
        ticks = self.ticks(fish, leaves)
        if ticks and gains[ticks - 1] > ticks * self._drift_px:
            yield replace(leaves, touched=False)
        for aside_deg in _ASIDE_DEG:
            there = self._beyond(fish, x, y, aside_deg)
            for stays in self._staying(fish, there):
                way = self._drifting(fish, stays, there)
                yield replace(stays, way=way, decision=Decision(WAITING))
        yield replace(stays, decision=Decision(WAITING))

    def _beyond(self, fish: Fish, x: float, y: float, aside_deg: float) -> Target:
        """Return a place to make way to for a fish at x, y: away from it, or `aside_deg` aside."""
        far = _AWAY * self._world.motion.body_length_px
        angle = np.arctan2(fish.y - y, fish.x - x) + np.radians(aside_deg)
        to_x, to_y = fish.x + far * np.cos(angle), fish.y + far * np.sin(angle)
        return Target(*self._world.tank.into(float(to_x), float(to_y)), 0.0, 0.0)

    def _staying(self, fish: Fish, away: Target) -> Iterator[Stretch]:
        """Yield what a fish can show in its place: turning, not turning, the same picture."""
        yield self.stay(fish, away)
        stays = self.stay(fish, away, turns=False)
        yield stays
        rot = stays.way[:, 2] - self._world.film.heading[fish.row]
        same = np.full(len(rot), fish.row)
        frozen = replace(stays, number=same, rot=rot, new=False)
        yield self._turn_in_place(frozen, away)
        yield frozen

    def _turn_in_place(self, frozen: Stretch, aim: Target) -> Stretch:
        """Turn the same picture in its place towards an aim, tick by tick."""
        (x, y, heading), ticks = frozen.way[0], np.arange(1, len(frozen.way) + 1)
        error = float(wrap(bearing(x, y, aim.x, aim.y) - heading))
        # So slowly that its ends swim no faster than a brisk fish does.
        slowly = np.degrees(self._world.cost_weights.pace / self._world.motion.body_length_px)
        most = min(self._world.brisk.turn_deg, slowly) * ticks
        turn = np.sign(error) * np.minimum(most, abs(error))
        way = frozen.way + np.outer(turn, (0.0, 0.0, 1.0))
        rot = None if frozen.rot is None else frozen.rot + turn
        return replace(frozen, way=way, rot=rot)

    def _drifting(self, fish: Fish, stays: Stretch, there: Target) -> Floats:
        """Return the way (n, 3) of a fish that stays but drifts towards a place meanwhile."""
        far = np.arange(1, len(stays.way) + 1) * self._drift_px
        to = np.subtract(there[:2], (fish.x, fish.y))
        along = to / max(float(np.hypot(*to)), 1e-9)
        way = stays.way.copy()
        way[:, :2] = (fish.x, fish.y) + far[:, None] * along
        return np.asarray(way)
