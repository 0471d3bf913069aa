"""From sprites into the film and out of it, by gateways (§4.3, Fig. 14)."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pandas as pd

from finloop.animate import kinematics as step
from finloop.animate.decide import Ways
from finloop.animate.film import Film
from finloop.animate.kinematics import Spot
from finloop.animate.loops import FilmSwimmer, counted
from finloop.animate.network import SpriteSwimmer
from finloop.animate.state import Fish, Options
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import SLIDE, STRAIGHT
from finloop.edit.stretch import Stretch
from finloop.features.table import orientation, wrap_deg

_BEFORE = -0.6  # of a frame; from there one tick leads to the next sprite, whatever its pace


class Crossing:
    """Leads from sprites into the film and back.

    gateways: table with the columns of `GATEWAYS`; median_step: natural step of the film;
    followers (s,): the row of `Film` that follows each sprite: the film is entered there, or by a
    jump from there. None: by gateways alone.
    """

    def __init__(
        self, sprites: SpriteSwimmer, film: FilmSwimmer, gateways: pd.DataFrame, median_step: float,
        followers: Ints | None = None,
    ) -> None:  # fmt: skip
        self.sprites, self.film, self.waters = sprites, film, film.waters
        rows = film.waters.film
        table = gateways.assign(seam=gateways["distance"] / median_step)
        table = table.astype({"row": np.int64, "seam": float})
        enters = table[table["direction"] == "in"]
        if followers is None:
            playable = rows.plays(enters["row"].to_numpy())
            self._enter = {
                # Copies can be written to, as all that kernels are compiled for.
                key: tuple(part[name].to_numpy(copy=True) for name in ("row", "seam", "turn_deg"))
                for key, part in enters[playable].groupby(["sprite", "orientation"])
            }
        else:
            self._enter = {(k, 0): _neighbours(rows, row) for k, row in enumerate(followers)}
        leaves = table[table["direction"] == "out"].sort_values(["row", "rank"])
        self._leave: dict[int, dict[int, tuple[float, float]]] = defaultdict(dict)
        columns = (leaves[name].tolist() for name in ("row", "sprite", "seam", "turn_deg"))
        for row_on_screen, sprite, seam, turn in zip(*columns, strict=True):
            self._leave[row_on_screen][sprite] = seam, turn
        cycles = self.waters.sprites.cycles
        self._cycle = {
            int(sprite): (state, place)
            for state in (STRAIGHT, SLIDE)
            for place, sprite in enumerate(cycles[state])
        }
        self._glide = int(cycles[SLIDE][0])

    def ways_in(self, fish: Fish, aim: Spot) -> Options | None:
        """Rows of the film that gateways lead to from the sprite on screen; None: no gateway."""
        sector = int(orientation(np.array(fish.heading), self.waters.sprites.orientations))
        gates = self._enter.get((fish.sprite, 0 if self.waters.film.body else sector))
        if gates is None:
            return None
        rows, seams, turns = gates
        ways = Ways(rows, wrap_deg(fish.heading + turns), seams, np.ones(len(rows), bool))
        return self.film.weigh(fish, aim, ways)

    def leave(self, fish: Fish, goal: Spot, exit_code: str, rng: np.random.Generator) -> Stretch:
        """Out of the film, here and now; by a gateway if there is one to the first sprite.

        Of the cycles' sprites that gateways lead to, the best comes first; a turn begins as always.
        """
        ways = self._leave.get(fish.row, {})
        begin = next((sprite for sprite in ways if sprite in self._cycle), self._glide)
        state, place = self._cycle[begin]
        cycle = self.waters.sprites.cycles[state]
        heading = step.wrap(fish.rot - ways[begin][1]) if begin in ways else fish.heading
        left = replace(
            fish, state=state, sprite=int(cycle[place - 1]), heading=float(heading), row=-1,
            phase=(place + _BEFORE) % len(cycle),
        )  # fmt: skip
        stretch = self.sprites.figure18(left, goal, rng)
        seam, _ = ways.get(int(stretch.number[0]), (np.nan, 0.0))
        decision = stretch.decision._replace(exit=exit_code, seam=seam)
        return replace(stretch, new=True, decision=decision)


def _neighbours(film: Film, row: int) -> tuple[Ints, Floats, Floats]:
    """Rows (k,) that can be shown in place of a row, itself first, their seams, and turns."""
    end = film.end[row]
    jumps = slice(film.start[end], film.start[end + 1]) if end >= 0 else slice(0)
    rows = np.append([row], film.to[jumps])
    plays = film.plays(rows)
    return rows[plays], np.append([0.0], film.seam[jumps])[plays], -film.heading[rows[plays]]


def refused(stretch: Stretch, options: Options | None) -> Stretch:
    """A stretch that is swum although these ways of the film were weighed."""
    if options is None:
        return stretch
    decision = counted(stretch.decision, options)
    return replace(stretch, options=replace(options, taken=-1), decision=decision)
