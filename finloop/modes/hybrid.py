"""Mode `hybrid`: loops where they lead to the goal, the network between (fish paper §4.3, Fig. 19).

In network mode every sprite on screen may have gateways into the film. Of the rows behind them that
are legal (`finloop.modes.loops`), the mode takes the one that leads nearest to the goal. In loop
mode it searches for the next loop at loop ends with a gateway out of the film. Where no loop is
legal, the fish leaves by that gateway. Every switch goes through a gateway (Fig. 14).
"""

import numpy as np
import pandas as pd

from finloop.animate.arena import is_legal_point
from finloop.animate.kinematics import Target, touches_target, wrap
from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.state import Fish
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import ENTER, NO_WAY, PHASE, SLIDE, STRAIGHT
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import find_orientations, wrap_deg
from finloop.loops.settings import LoopsSettings
from finloop.modes.animator import Animator, ModeAssets, make_animator, video_loop_graph
from finloop.modes.hybrid_settings import HybridSettings
from finloop.modes.loops import Loops, RollOuts, add_verdict_counts, ticks_to_marked_row
from finloop.modes.network import Network
from finloop.modes.player import PaperMode
from finloop.plan.search import Candidates, make_candidates

_JUST_LEFT = 1  # ticks after the film at which the gateway's own sprite is shown
_WITHIN_FRAME = 0.4  # from here a tick leads to the next sprite at any playback rate


class Gateways:
    """The gateways between sprites and film (Fig. 14): a sprite and a frame that are alike.

    into: by (sprite, orientation), orientation 0 for any, the film rows that it leads to, their
    turns in degrees and their seams (discontinuities in natural steps), (k,) each; out_of: by row,
    a list of (sprite, turn in degrees, seam), the nearest first.
    """

    def __init__(self, table: pd.DataFrame, step: float, loop_mode: Loops) -> None:
        """Sort gateways by the sprite or row that they lead from.

        Of those into the film, only those to a row from which it can go on for ever are kept.

        table: columns of `GATEWAYS`; step: the film's natural step, the unit of seams; loop_mode:
        plays the film.
        """
        film = loop_mode.film
        table = table.assign(seam=table["distance"].astype(float) / step)
        entries = table[table["direction"] == "in"]
        entries = entries[film.can_play_on(entries["row"].to_numpy())]
        self.into: dict[tuple[int, int], tuple[Ints, Floats, Floats]] = {
            (int(sprite), int(orientation)): (
                group["row"].to_numpy(np.int64, copy=True),
                group["turn_deg"].to_numpy(float, copy=True),
                group["seam"].to_numpy(float, copy=True),
            )
            for (sprite, orientation), group in entries.groupby(["sprite", "orientation"])
        }
        exits = table[table["direction"] == "out"].sort_values(["row", "rank"])
        self.out_of: dict[int, list[tuple[int, float, float]]] = {}
        columns = (exits[name].tolist() for name in ("row", "sprite", "turn_deg", "seam"))
        for row, sprite, turn, seam in zip(*columns, strict=True):
            self.out_of.setdefault(row, []).append((sprite, turn, seam))


class Hybrid:
    """Plays mode `hybrid` (Fig. 19): loops where they lead to the goal, else sprites."""

    def __init__(self, network: Network, loops: Loops, gateways: Gateways) -> None:
        """Keep both flow charts, and mark the rows whose gateways lead to a straight sprite."""
        self.network, self.loops, self.gateways = network, loops, gateways
        cycles = network.sprites.cycles
        self._cycle_place = {
            int(sprite): (state, place)
            for state in (STRAIGHT, SLIDE)
            for place, sprite in enumerate(cycles[state])
        }
        has_exit = np.zeros(len(loops.film.rows), bool)
        for row, exits in gateways.out_of.items():
            has_exit[row] = any(sprite in self._cycle_place for sprite, _turn, _seam in exits)
        self._has_exit = has_exit
        self._ends = loops.ends & has_exit

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place of the tank, shown by a sprite (network mode)."""
        return self.network.begin(rng)

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode for this one: unchanged if it can go on, else as a sprite.

        A fish that a frame shows goes on in the film, if the film can play on or a gateway leads
        out. Otherwise a sprite shows it.
        """
        is_filmed = 0 <= fish.row < self.loops.film.filmed_count  # no sprite, no mirror image
        can_go_on = self.loops.can_go_on(fish) or (is_filmed and self._has_exit[fish.row])
        return fish if fish.row < 0 or can_go_on else self.network.take_over(fish)

    def next_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch: by loop mode in the film, else by network mode (Fig. 19)."""
        if fish.row < 0:
            return self.next_network_stretch(fish, goal, rng)
        return self.next_loop_stretch(fish, goal, rng)

    def next_network_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return a stretch of film if a gateway leads there now, else sprites up to a gateway.

        Right after the film a fish is shown by sprites for at least one tick.
        """
        if fish.since != _JUST_LEFT and (entered := self.enter_film(fish, goal)) is not None:
            return entered
        stretch = self.network.next_stretch(fish, goal, rng)
        for tick in range(1, len(stretch.trajectory)):
            at_tick = self.network.end_state(fish, stretch.cut(tick))
            if self.enter_film(at_tick, goal) is not None:
                return stretch.cut(tick)
        return stretch

    def enter_film(self, fish: Fish, goal: Target) -> Stretch | None:
        """Return a stretch of film behind a gateway of the sprite on screen; None if none leads on.

        Of the legal rows behind gateways, the one that leads nearest to the goal is taken.
        """
        candidates = self.rows_behind_gateways(fish)
        if candidates is None:
            return None
        place = self.loops.next_place(fish)
        roll_outs = self.loops.roll_out(place, candidates, goal, self._ends)
        legal = np.flatnonzero(roll_outs.ticks)
        if not legal.size:
            return None
        taken = int(legal[np.argmin(roll_outs.far[legal])])
        return self.loops.make_stretch(fish, candidates, roll_outs, taken, goal, reason=ENTER)

    def rows_behind_gateways(self, fish: Fish) -> Candidates | None:
        """Return the film rows that gateways lead to from the sprite on screen; None if none."""
        orientation = int(
            find_orientations(np.array(fish.heading), self.network.sprites.orientations)
        )
        gates = self.gateways.into.get(  # 0: of any orientation
            (fish.sprite, 0 if self.loops.film.jumps_keep_heading else orientation)
        )
        if gates is None:
            return None
        rows, turns, seams = gates
        return make_candidates(rows, np.asarray(wrap_deg(fish.heading + turns), float), seams)

    def next_loop_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch in loop mode: a legal candidate, else a gateway out of the film.

        Where no candidate is legal and the row shown has no gateway, the film plays on to a row
        that has one.
        """
        candidates = self.loops.next_candidates(fish)
        place = self.loops.next_place(fish)
        roll_outs = self.loops.roll_out(place, candidates, goal, self._ends)
        taken = self.loops.choose_candidate(candidates, roll_outs, rng)
        if taken is not None:
            return self.loops.make_stretch(fish, candidates, roll_outs, taken, goal)
        if self._has_exit[fish.row]:
            return self.leave_film(fish, roll_outs, goal)
        return self.play_to_gateway(fish, candidates, roll_outs, goal, rng)

    def leave_film(self, fish: Fish, roll_outs: RollOuts, goal: Target) -> Stretch:
        """Return a stretch of one tick that leaves the film by a gateway to a straight sprite.

        The row on screen has such a gateway. roll_outs: those of the candidates in the film; the
        decision says how many fail each test.
        """
        sprite, turn, seam = next(
            gateway for gateway in self.gateways.out_of[fish.row] if gateway[0] in self._cycle_place
        )
        state, place = self._cycle_place[sprite]
        heading = float(
            wrap(fish.rotation_deg - turn)
        )  # `turn` leads from the sprite to the film's frame
        x, y = self.loops.next_place(fish._replace(heading=heading, row=-1))  # straight on
        if not is_legal_point(self.network.world.tank.legal, x, y):
            x, y = fish.x, fish.y
        decision = Decision(PHASE, exit=NO_WAY, seam=seam, film_speed=fish.speed)
        return Stretch(
            state, np.array([[x, y, heading]]), np.array([sprite]), begins_with_transition=True,
            aim=goal, touches_goal=touches_target(x, y, heading, goal),
            decision=add_verdict_counts(roll_outs, decision),
            phase=np.array([place + _WITHIN_FRAME]),  # the next tick shows the next sprite
        )  # fmt: skip

    def play_to_gateway(
        self, fish: Fish, candidates: Candidates, roll_outs: RollOuts, goal: Target,
        rng: np.random.Generator,
    ) -> Stretch:  # fmt: skip
        """Return the shortest stretch of film to a row with a gateway out of the film.

        candidates: none of them is legal, as none leads to a loop end with a gateway that passes
        the tests; but one may lead to another row with a gateway, inside the tank. roll_outs: of
        the candidates. Where none reaches a gateway, the fish swims on the spot.
        """
        tank, place = self.loops.world.tank, self.loops.next_place(fish)
        ticks_to_gateway = ticks_to_marked_row(
            self.loops.film, tank.legal, self._has_exit, candidates, place
        )
        reaching = np.flatnonzero(ticks_to_gateway)  # 0: it reaches no gateway
        if not reaching.size:
            return self.loops.swim_on_spot(fish, candidates, roll_outs, goal, rng)
        nearest = int(reaching[np.argmin(ticks_to_gateway[reaching])])
        ticks = int(ticks_to_gateway[nearest])
        return self.loops.make_stretch(fish, candidates, roll_outs, nearest, goal, ticks=ticks)

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch that began with `fish`."""
        if stretch.rotation_deg is not None:
            return self.loops.end_state(fish, stretch)
        return self.network.end_state(fish, stretch)


def hybrid_animator(
    assets: ModeAssets, network: Network, loops: pd.DataFrame, gateways: pd.DataFrame,
    p: CommonSettings, loops_settings: LoopsSettings, hybrid_settings: HybridSettings,
) -> Animator:  # fmt: skip
    """Return the animator of mode `hybrid` (Fig. 19); without loops or gateways, of `network`.

    assets: what the modes share, with sprites; network: flow chart of mode `network`; loops: rows
    a, b and distance of each loop; gateways: columns of `GATEWAYS`; p: the group `animate`.
    """
    loop_mode = Loops(assets.world, video_loop_graph(assets, loops), loops_settings)
    sorted_gateways = Gateways(gateways, assets.film_data.map_facts.step_median, loop_mode)
    mode: PaperMode = Hybrid(network, loop_mode, sorted_gateways)
    if not (loop_mode.can_play and sorted_gateways.into and sorted_gateways.out_of):
        mode = network
    return make_animator(assets, mode, network.sprites, p, hybrid_settings.join)
