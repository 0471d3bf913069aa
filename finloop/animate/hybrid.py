"""Hybrid mode: the film where it leads to the goal, sprites between (§4.3, Figs. 17, 19).

It begins in network mode. Wherever a gateway leads from the sprite on screen into the film, the
film's ways are weighed as at a loop end; if one is legal and not too long, the film is played. In
the film every loop end is weighed anew; where no way is legal, or the network would be there much
sooner, the fish leaves by a gateway to a sprite, and goes on by the network.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate import kinematics as step
from finloop.animate import search as ahead
from finloop.animate.loops import LoopMode, Options, choose, considered
from finloop.animate.motion import SLIDE, STRAIGHT
from finloop.animate.network import Fish, NetworkMode, Stretch
from finloop.features.table import orientation, wrap_deg

_STAY_S = 0.5  # a fish stays in network mode at least so long
_BEFORE = -0.6  # of a frame; from there one tick leads to the next sprite, whatever its pace
_GAIN = 0.1  # a way of the film leads towards the goal at least at such a share of a brisk pace

Floats = NDArray[np.float64]


class HybridMode:
    """The player of both. `gateways`: table with the columns of `gateways.GATEWAYS`."""

    def __init__(
        self, network: NetworkMode, loops: LoopMode, gateways: pd.DataFrame, median_step: float
    ) -> None:
        self.network, self.loops = network, loops
        self.motion, self.tank = network.motion, network.tank
        self.touch_px, self.head_px = network.touch_px, network.head_px
        self._stay = round(_STAY_S * self.motion.rate_hz)
        film = loops.film
        table = gateways.assign(seam=gateways["distance"] / median_step)
        enters = table[table["direction"] == "in"]
        row = enters["row"].to_numpy()
        playable = film.more[row] & film.endless[np.minimum(row + 1, len(film.more) - 1)]
        self._enter = {
            key: tuple(part[name].to_numpy() for name in ("row", "seam", "turn_deg"))
            for key, part in enters[playable].groupby(["sprite", "orientation"])
        }
        leaves = table[table["direction"] == "out"].sort_values(["row", "rank"])
        self._leave: dict[int, dict[int, tuple[float, float]]] = defaultdict(dict)
        columns = (leaves[name].tolist() for name in ("row", "sprite", "seam", "turn_deg"))
        for row_on_screen, sprite, seam, turn in zip(*columns, strict=True):
            self._leave[row_on_screen][sprite] = seam, turn
        self._cycle = {
            int(sprite): (state, place)
            for state in (STRAIGHT, SLIDE)
            for place, sprite in enumerate(network.sprites.cycles[state])
        }
        self._glide = int(network.sprites.cycles[SLIDE][0])

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish in network mode."""
        fish = self.network.begin(rng)
        fish.shown = np.full(len(self.loops.film.more), -(10**9))
        return fish

    def stretch(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch:
        """Go on towards the point `at` (2,) px: by the film where it fits, else by the network."""
        if fish.row >= 0:
            return self._in_film(fish, at, name, rng)
        options = None
        if fish.since >= self._stay:
            found, options = self._into_film(fish, at, name, rng)
            if found is not None:
                return found
        return self._by_sprites(fish, at, name, rng, options)

    def enter(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch:
        """For who must go on by the film: into it by any gateway; where there is none, stretch."""
        found, options = self._into_film(fish, at, name, rng, any_way=True)
        return found or self._by_sprites(fish, at, name, rng, options)

    def leave(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch:
        """For who must go on by sprites: out of the film, here and now."""
        left, found, gate = self._out(fish, at, name, rng)
        vars(fish).update(vars(left))
        return replace(found, new=True, why=f"leave the film {_by(gate)}: as asked; {found.why}")

    def _by_sprites(
        self, fish: Fish, at: Floats, name: str, rng: np.random.Generator, options: Options | None
    ) -> Stretch:
        """On by the network; `options`: ways of the film that were refused."""
        found = self.network.stretch(fish, at, name, rng)
        fish.since += len(found.way)
        return found if options is None else _refused(found, options)

    def _into_film(
        self, fish: Fish, at: Floats, name: str, rng: np.random.Generator, any_way: bool = False
    ) -> tuple[Stretch | None, Options | None]:
        """By a gateway into the film, if a legal way leads on from one, and what was weighed.

        `any_way`: else by one that only stays in the tank.
        """
        film, target = self.loops.film, self.loops.aim(fish, at)
        sector = int(orientation(np.array(fish.heading), self.network.sprites.orientations))
        gates = self._enter.get((fish.sprite, 0 if film.body else sector))
        if gates is None:
            return None, None
        rows, seams, turns = gates
        forward = fish.speed * self.motion.body_length_px / self.motion.rate_hz
        place = step.ahead(fish.x, fish.y, fish.heading, forward, 0.0)
        costs = [self.loops.jump_cost(fish, *one) for one in zip(rows, seams, strict=True)]
        options = self.loops.weigh(
            place, fish, rows, wrap_deg(fish.heading + turns), seams, costs,
            np.zeros(len(rows)), target,
        )  # fmt: skip
        best = choose(options, self._worth(options, fish, target), self.motion.rate_hz, rng)
        if best is None and any_way:
            best = choose(options, np.isfinite(options.value), self.motion.rate_hz, rng)
        if best is None:
            return None, options
        fish.sprite = -1
        return self.loops.play(fish, place, options, best, target, at, name), options

    def _in_film(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch:
        """On by the best legal way, else out by a gateway; a gateway is waited for a moment."""
        target, here = self.loops.aim(fish, at), self.loops.arrival(fish)
        options = self.loops.options(fish, target)
        best = choose(options, self._worth(options, fish, target), self.motion.rate_hz, rng)
        if best is not None:
            fish.waits = 0
            return self.loops.play(fish, here, options, best, target, at, name)
        left, found, gate = self._out(fish, at, name, rng)
        if gate is None and fish.waits < self._stay:
            best = choose(options, np.isfinite(options.value), self.motion.rate_hz, rng)
            if best is not None:
                played = self.loops.play(fish, here, options, best, target, at, name)
                fish.waits += len(played.way)
                return played
        vars(fish).update(vars(left))
        why = f"leave the film {_by(gate)}: no legal way on ({options.counts()}); {found.why}"
        return _refused(replace(found, new=True, why=why), options)

    def _worth(self, options: Options, fish: Fish, target: Floats) -> NDArray[np.bool_]:
        """Which ways are legal and come nearer to the target by `_GAIN` seconds a second."""
        loops, rate = self.loops, self.motion.rate_hz
        ticks = ahead.remaining(fish.x, fish.y, fish.heading, target, loops.pace, loops.turning)
        return options.legal & (options.value <= (ticks + (1 - _GAIN) * options.ticks) / rate)

    def _out(
        self, fish: Fish, at: Floats, name: str, rng: np.random.Generator
    ) -> tuple[Fish, Stretch, float | None]:
        """How the network would go on, and the seam of the gateway to its first sprite, if any.

        Of the cycles' sprites that are gateways each may come first; a turn begins as it does.
        """
        ways = self._leave.get(fish.row, {})
        begin = next((sprite for sprite in ways if sprite in self._cycle), self._glide)
        state, place = self._cycle[begin]
        cycle = self.network.sprites.cycles[state]
        heading = step.wrap(fish.rot - ways[begin][1]) if begin in ways else fish.heading
        left = replace(
            fish, state=state, sprite=int(cycle[place - 1]), heading=float(heading), row=-1,
            phase=(place + _BEFORE) % len(cycle), waits=0,
        )  # fmt: skip
        found = self.network.stretch(left, at, name, rng)
        left.since = len(found.way)
        gate = ways.get(int(found.number[0]))
        return left, found, gate[0] if gate else None


def _by(gate: float | None) -> str:
    return f"by a gateway, {gate:.2f} steps" if gate is not None else "without a gateway"


def _refused(found: Stretch, options: Options) -> Stretch:
    """The stretch that was swum although these ways were weighed."""
    return replace(
        found, considered=considered(options, None), considered_rot=tuple(options.rots.tolist())
    )
