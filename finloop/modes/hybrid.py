"""Mode `hybrid`: loops where they lead to the goal, the network between (fish paper §4.3, Fig. 19).

In network mode every sprite on screen may have gateways into the film. Of those from which a legal
way leads on, the mode takes the one whose way ends nearest to the goal. In loop mode it searches
for the next loop at loop ends with a gateway out of the film. Where no loop is legal, the fish
leaves by that gateway. Every switch goes through a gateway (Fig. 14).
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from finloop.animate.arena import is_legal_point
from finloop.animate.kinematics import Target, touches_target, wrap
from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.state import Fish
from finloop.base.arrays import Floats, Ints
from finloop.bpn.model import MotionModel
from finloop.edit.schema import ENTER, NO_WAY, PHASE, SLIDE, STRAIGHT
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import find_orientations, wrap_deg
from finloop.loops.settings import LoopsSettings
from finloop.modes.animator import FilmData, PaperAnimator, make_animator, prepare_mode_assets
from finloop.modes.hybrid_settings import HybridSettings
from finloop.modes.loops import (
    Loops,
    Starts,
    Ways,
    add_verdict_counts,
    make_loops,
    ticks_to_first_end,
)
from finloop.modes.network import Network, make_network
from finloop.modes.network_settings import NetworkSettings
from finloop.modes.player import PaperMode

_LEFT = 1  # tick after the film: the gateway's sprite is shown
_SHOWN = 0.4  # of a frame; from there one tick leads to the next sprite at any playback rate


class Gateways:
    """The gateways between sprites and film (Fig. 14). table: columns of `GATEWAYS`.

    step: the film's natural step, the unit of seams. into: by (sprite, orientation), orientation 0
    for any, the rows that it leads to, their turns in degrees and seams, (k,) each; out_of: by row,
    a list of (sprite, turn in degrees, seam), the nearest first.
    """

    def __init__(self, table: pd.DataFrame, step: float, loop_mode: Loops) -> None:
        """Sort the gateways by what they lead from, without those into film that cannot go on."""
        film = loop_mode.film
        table = table.assign(seam=table["distance"].astype(float) / step)
        enters = table[table["direction"] == "in"]
        enters = enters[film.can_play_on(enters["row"].to_numpy())]
        self.into: dict[tuple[int, int], tuple[Ints, Floats, Floats]] = {
            (int(sprite), int(number)): (
                part["row"].to_numpy(np.int64, copy=True),
                part["turn_deg"].to_numpy(float, copy=True),
                part["seam"].to_numpy(float, copy=True),
            )
            for (sprite, number), part in enters.groupby(["sprite", "orientation"])
        }
        leaves = table[table["direction"] == "out"].sort_values(["row", "rank"])
        self.out_of: dict[int, list[tuple[int, float, float]]] = {}
        columns = (leaves[name].tolist() for name in ("row", "sprite", "turn_deg", "seam"))
        for row, sprite, turn, seam in zip(*columns, strict=True):
            self.out_of.setdefault(row, []).append((sprite, turn, seam))


class Hybrid:
    """Plays mode `hybrid` (Fig. 19): loops where they lead to the goal, else sprites."""

    def __init__(self, network: Network, loops: Loops, gateways: Gateways) -> None:
        """Keep both flow charts, and mark the rows whose gateways lead to a straight sprite."""
        self.network, self.loops, self.gateways = network, loops, gateways
        cycles = network.sprites.cycles
        self._cycle = {
            int(sprite): (state, place)
            for state in (STRAIGHT, SLIDE)
            for place, sprite in enumerate(cycles[state])
        }
        leaves = np.zeros(len(loops.film.rows), bool)
        for row, ways in gateways.out_of.items():
            leaves[row] = any(sprite in self._cycle for sprite, _, _ in ways)
        self._leaves = leaves
        self._ends = loops.ends & leaves

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place of the tank, shown by a sprite (network mode)."""
        return self.network.begin(rng)

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode as a fish of this mode, unchanged where it can go on.

        A fish that a frame shows goes on in the film, if the film can play on or a gateway leads
        out. Otherwise it is shown by a sprite.
        """
        filmed = self.loops.film.filmed
        if (
            fish.row < 0
            or self.loops.can_go_on(fish)
            or (fish.row < filmed and self._leaves[fish.row])
        ):
            return fish
        return self.network.take_over(fish)

    def play(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch: by loop mode in the film, else by network mode (Fig. 19)."""
        if fish.row < 0:
            return self.play_network(fish, goal, rng)
        return self.play_loops(fish, goal, rng)

    def play_network(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return sprites up to where a gateway leads into the film, or film if one does now.

        Right after the film a fish is shown by sprites for at least one tick.
        """
        if fish.since != _LEFT and (entered := self.enter_film(fish, goal)) is not None:
            return entered
        stretch = self.network.play(fish, goal, rng)
        for tick in range(1, len(stretch.way)):
            there = self.network.end_state(fish, stretch.cut(tick))
            if self.enter_film(there, goal) is not None:
                return stretch.cut(tick)
        return stretch

    def enter_film(self, fish: Fish, goal: Target) -> Stretch | None:
        """Return the film entered by a gateway from the sprite on screen; None where none leads in.

        Of the gateways from which a way is legal, the one whose way ends nearest to the goal is
        taken.
        """
        starts = self.rows_behind_gateways(fish)
        if starts is None:
            return None
        place = self.loops.next_place(fish)
        ways = self.loops.follow_starts_from(place, starts, goal, self._ends)
        legal = np.flatnonzero(ways.ticks)
        if not legal.size:
            return None
        taken = int(legal[np.argmin(ways.far[legal])])
        return self.loops.make_stretch(fish, starts, ways, taken, goal, ENTER)

    def rows_behind_gateways(self, fish: Fish) -> Starts | None:
        """Return the film rows that gateways lead to from the sprite on screen; None if none."""
        number = int(find_orientations(np.array(fish.heading), self.network.sprites.orientations))
        gates = self.gateways.into.get((fish.sprite, 0 if self.loops.film.body else number))
        if gates is None:
            return None
        rows, turns, seams = gates
        return Starts(rows, np.asarray(wrap_deg(fish.heading + turns), float), seams)

    def play_loops(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch in loop mode: a legal way, else a gateway out of the film.

        Where no way is legal and the row shown has no gateway, the film plays on to a row that has
        one.
        """
        starts = self.loops.next_rows(fish)
        ways = self.loops.follow_starts(fish, starts, goal, self._ends)
        taken = self.loops.choose_start(starts, ways, rng)
        if taken is not None:
            return self.loops.make_stretch(fish, starts, ways, taken, goal)
        if self._leaves[fish.row]:
            return self.leave_film(fish, ways, goal)
        return self.play_to_gateway(fish, starts, ways, goal, rng)

    def leave_film(self, fish: Fish, ways: Ways, goal: Target) -> Stretch:
        """Return a stretch of one tick that leaves the film by a gateway to a straight sprite.

        ways: those that were weighed, for the counts of the decision.
        """
        sprite, turn, seam = next(
            way for way in self.gateways.out_of[fish.row] if way[0] in self._cycle
        )
        state, place = self._cycle[sprite]
        heading = float(wrap(fish.rot - turn))
        x, y = self.loops.next_place(fish._replace(heading=heading, row=-1))
        if not is_legal_point(self.network.world.tank.legal, x, y):
            x, y = fish.x, fish.y
        decision = Decision(PHASE, exit=NO_WAY, seam=seam, film_speed=fish.speed)
        return Stretch(
            state, np.array([[x, y, heading]]), np.array([sprite]), True, goal,
            touches_target(x, y, heading, goal), add_verdict_counts(ways, decision),
            phase=np.array([place + _SHOWN]),
        )  # fmt: skip

    def play_to_gateway(
        self, fish: Fish, starts: Starts, ways: Ways, goal: Target, rng: np.random.Generator
    ) -> Stretch:
        """Return the shortest stretch of film to a row with a gateway out of the film.

        starts, ways: the rows that can be shown next, and the ways from them. Where none reaches a
        gateway inside the tank, the fish swims on the spot.
        """
        place, legal = self.loops.next_place(fish), self.loops.world.tank.legal
        ticks = ticks_to_first_end(self.loops.film, legal, self._leaves, starts, place)
        some = np.flatnonzero(ticks)
        if not some.size:
            return self.loops.swim_on_spot(fish, starts, ways, goal, rng)
        waits = ways._replace(ticks=0 * ticks, inside=ticks)
        taken = int(some[np.argmin(ticks[some])])
        return replace(self.loops.make_stretch(fish, starts, waits, taken, goal), waits=True)

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch that began with `fish`."""
        if stretch.rot is not None:
            return self.loops.end_state(fish, stretch)
        return self.network.end_state(fish, stretch)


def hybrid_animator(
    film_data: FilmData, model: MotionModel, loops: pd.DataFrame, gateways: pd.DataFrame,
    p: CommonSettings, q: tuple[NetworkSettings, LoopsSettings, HybridSettings],
) -> PaperAnimator:  # fmt: skip
    """Return the animator of mode `hybrid` (Fig. 19); without loops or gateways, of `network`.

    film_data: what is taken from the film; model: the trained network; loops, gateways: tables of
    both, the latter with columns of `GATEWAYS`; p: the group `animate`; q: the groups of the three
    modes.
    """
    basis = prepare_mode_assets(film_data, p)
    network, sprites = make_network(film_data, basis, model, q[0])
    play = make_loops(film_data, basis, loops, q[1])
    gates = Gateways(gateways, film_data.map_facts.step_median, play)
    mode: PaperMode = Hybrid(network, play, gates)
    if not (play.can_play and gates.into and gates.out_of):
        mode = network
    return make_animator(film_data, basis, mode, play.film, sprites, p, q[2].join)
