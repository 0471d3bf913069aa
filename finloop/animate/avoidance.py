"""Keeping clear of the other fish of a tank: what a fish does whose way is not free."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from finloop.animate.company import lasting_ticks
from finloop.animate.edit_list import SPOT, WAITING
from finloop.animate.kinematics import Spot
from finloop.animate.loops import FilmSwimmer
from finloop.animate.motion import FORECAST, TURN
from finloop.animate.policies import Policy
from finloop.animate.state import Decision, Fish, Stretch, Waters
from finloop.base.arrays import Floats

_AWAY = 3.0  # body lengths; so far away from the nearest fish is the place to make way to
_ASIDE_DEG = (0.0, 50.0, -50.0, 100.0, -100.0)  # drifts that are tried one after the other
_DRIFT = 0.05  # body lengths in a Δ, of a fish that has no way


class Avoidance:
    """Keeps fish clear of each other. policy: of the mode."""

    def __init__(self, policy: Policy, waters: Waters) -> None:
        self._policy, self._waters = policy, waters
        self._film = FilmSwimmer(waters)
        motion = waters.motion
        self._drift_px = _DRIFT * motion.body_length_px / motion.delta  # in a tick

    def kept_clear(self, fish: Fish, stretch: Stretch, rng: np.random.Generator) -> Stretch:
        """What of a stretch meets no other fish, now or where it ends; else what can be done.

        A fish that is blocked, or turns on the spot beside another, makes way for the other.
        """
        company, others = fish.company, fish.company.places[0]
        if not len(others):
            return stretch
        ticks = self.ticks(fish, stretch)
        far = np.hypot(others[:, 0] - fish.x, others[:, 1] - fish.y)
        stuck = stretch.decision.reason == SPOT and far.min() < 2 * company.discs.reach
        if ticks and not stuck:
            return stretch.cut(ticks)
        x, y = others[far.argmin(), :2].tolist()
        for other in self._making_way(fish, x, y, rng):
            if ticks := self.ticks(fish, other):
                return other.cut(ticks)
        return other.cut(1)

    def ticks(self, fish: Fish, stretch: Stretch) -> int:
        """How many ticks of a stretch can be swum, clear of all, so that the fish can stay then."""
        return lasting_ticks(fish.company, stretch.pictures, stretch.way, fish.tick)

    def _making_way(
        self, fish: Fish, x: float, y: float, rng: np.random.Generator
    ) -> Iterator[Stretch]:
        """What a fish can do that is blocked by another at x, y, the best first.

        It swims away, if that is quicker than a drift; drifts away, or more and more aside: turning
        there, not turning, with the same picture; stays with the same picture.
        """
        away = self._beyond(fish, x, y, 0.0)
        leaves = self._policy.next(fish, away, rng)
        # Who is blocked all round may swim, too, and gain nothing: a drift is quicker.
        gains = np.hypot(*(leaves.way[:, :2] - (x, y)).T) - np.hypot(fish.x - x, fish.y - y)
        ticks = self.ticks(fish, leaves)
        if ticks and gains[ticks - 1] > ticks * self._drift_px:
            yield replace(leaves, touched=False)
        for aside_deg in _ASIDE_DEG:
            there = self._beyond(fish, x, y, aside_deg)
            drift, ways = self._drift(fish, there), self._staying(fish, there)
            for one in ways:
                moved = one.way.copy()
                moved[:, :2] = drift[: len(moved)]
                yield replace(one, way=moved, decision=Decision(WAITING))
        yield replace(self._staying(fish, away)[-1], decision=Decision(WAITING))

    def _beyond(self, fish: Fish, x: float, y: float, aside_deg: float) -> Spot:
        """A place to make way to for a fish at x, y: away from it, or so much aside of that."""
        far = _AWAY * self._waters.motion.body_length_px
        angle = np.arctan2(fish.y - y, fish.x - x) + np.radians(aside_deg)
        to_x, to_y = fish.x + far * np.cos(angle), fish.y + far * np.sin(angle)
        return Spot(*self._waters.tank.into(float(to_x), float(to_y)), 0.0, 0.0)

    def _staying(self, fish: Fish, away: Spot) -> list[Stretch]:
        """What a fish can show in its place: turning, not turning, the same picture."""
        if fish.row < 0:
            stays = self._policy.sprites.stay(fish, away)
            same, phase = (np.full(len(stays.way), one) for one in (fish.sprite, fish.phase))
            turns = fish.state == TURN  # it goes on with the turn then
            frozen = replace(
                stays, state=fish.state, number=same, phase=None if turns else phase, new=False,
                whole=not turns,
            )  # fmt: skip
            return [stays, frozen]
        stays = self._film.stay(fish, away, turns=False)
        rot = stays.way[:, 2] - self._waters.film.heading[fish.row]
        same = np.full(len(rot), fish.row)
        frozen = replace(stays, number=same, rot=rot, new=False)
        ways = [self._film.stay(fish, away), stays, frozen]
        if fish.state == FORECAST:
            return [replace(one, state=FORECAST) for one in ways]
        return ways

    def _drift(self, fish: Fish, away: Spot) -> Floats:
        """Places (n, 2) of a fish that drifts away while it waits; at a wall, along it."""
        ticks = max(self._waters.motion.delta, self._film.rules.stride)
        far = np.arange(1, ticks + 1) * self._drift_px
        way = np.subtract(away[:2], (fish.x, fish.y))
        places = (fish.x, fish.y) + far[:, None] * way / max(float(np.hypot(*way)), 1e-9)
        return np.array([self._waters.tank.into(x, y) for x, y in places.tolist()])
