"""Everything that plans an animation, from what has been made of a film."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.arena import place_goals, size_for, tank, where
from finloop.animate.company import NO_DISCS, Plans
from finloop.animate.crossing import Crossing
from finloop.animate.endless import endless
from finloop.animate.film import Film, Jumps, film, loop_jumps, neighbour_jumps
from finloop.animate.forecast import ForecastSwimmer
from finloop.animate.loops import FilmSwimmer
from finloop.animate.motion import learn
from finloop.animate.network import SpriteSwimmer
from finloop.animate.paths import Path, lay
from finloop.animate.policies import Policy
from finloop.animate.rare import Rarity
from finloop.animate.settings import Settings
from finloop.animate.shoal import (
    Task,
    by_rule,
    deal,
    refuse_meetings,
    settle,
    shoal,
    tasks,
)
from finloop.animate.sprites import arrange
from finloop.animate.state import Waters
from finloop.animate.swim import Cast, FrameHulls, Player, random_goals
from finloop.base.arrays import Floats, Ints, Mask, Picture, Reals
from finloop.base.line import Line
from finloop.bpn.model import MotionModel
from finloop.distance.map import MapFacts, mapped
from finloop.distance.picture import BODY, distance
from finloop.edit.bodies import Bodies
from finloop.edit.build import edit_lists
from finloop.edit.joins import Joins, joins
from finloop.edit.pictures import Pictures, without_ghosts
from finloop.edit.schema import FADE, HYBRID, MODES, NETWORK, Goal
from finloop.edit.stretch import Swim
from finloop.features.table import delta_frames
from finloop.forecast.sampling import Sampler
from finloop.loops.graph import loop_graph
from finloop.pose.film import FilmPoses
from finloop.reel import Reel
from finloop.social.rule import Shoaling, rule_of
from finloop.sprites.pictures import outlines


class Material(NamedTuple):
    """What has been made of a film.

    arena (h, w): where the fish can be; reel: its pictures and sprites; outline_px (n, k, 2): x, y
    as filmed of its n rows; steps, loops, jumps, gateways: columns of `STEPS`, `LOOPS`,
    `JUMPS`, `GATEWAYS`; poses: of the rows of the reel; forecast: None where the film shows too
    little for one; lines: to be swum in place of goals, by the first fish, None for one that has
    none; mm_per_px: None: not known; shoaling:
    how fish swim by zones, None: not known; floor: the empty tank as filmed, None: not known.
    """

    rate_hz: float
    arena: Mask
    reel: Reel
    outline_px: Reals
    model: MotionModel
    map_facts: MapFacts
    steps: pd.DataFrame
    loops: pd.DataFrame
    jumps: pd.DataFrame
    gateways: pd.DataFrame
    poses: FilmPoses
    forecast: Sampler | None = None
    lines: Sequence[Line | None] = ()
    mm_per_px: float | None = None
    shoaling: Shoaling | None = None
    floor: Picture | None = None


@dataclass(frozen=True)
class Planner:
    """A player a mode. step: the film's median natural step, the unit of every seam.

    reach_px: how far the fish reaches from its centre; paths: of the first fish, None for one that
    has none.
    """

    waters: Waters
    players: dict[str, Player]
    pictures: Pictures
    step: float
    reach_px: float
    paths: tuple[Path | None, ...] = ()

    def goals(self) -> list[Goal]:
        """The goals of the parameters, none where all fish swim paths, or by a rule.

        FinloopError if one is out of reach, two fish are sent to one place, or fish are to swim by
        zones and there is no rule for it.
        """
        p = self.waters.settings
        if p.rule == "zones" and p.fish > 1:
            for player in self.players.values():
                rule_of(player.shoaling)
        if not self.seekers:
            return []
        waters = self.waters
        touch_px = waters.touch_px + waters.head_px
        placed = place_goals(p.goals, p.goals_in, waters.tank, touch_px)
        goals = [goal._replace(radius_px=waters.touch_px) for goal in placed]
        if not p.overlap:
            refuse_meetings(goals, self.seekers)
        return goals

    @property
    def unruled(self) -> list[int]:
        """The fish that swim by no rule. FinloopError if the rules are contradictory."""
        p = self.waters.settings
        every = by_rule(tasks([], p.fish, np.random.default_rng()), p)
        return [fish for fish, task in enumerate(every) if not task.zones and task.follows is None]

    @property
    def seekers(self) -> list[int]:
        """The fish that swim to goals, neither by a rule nor along a path."""
        swum = [fish for fish, path in enumerate(self.paths) if path is not None]
        return [fish for fish in self.unruled if fish not in swum]

    def tasks(self, goals: Sequence[Goal]) -> list[Task]:
        """What each fish does: swim its path, or to goals, or by a rule."""
        rng = np.random.default_rng(self.waters.settings.seed)
        todo = self._tasks(goals, self.seekers, rng)
        for fish, path in enumerate(self.paths):
            if path is not None:
                todo[fish] = todo[fish]._replace(route=path.route)
        return todo

    def _tasks(
        self, goals: Sequence[Goal], seekers: Sequence[int], rng: np.random.Generator
    ) -> list[Task]:
        """The tasks of all fish by the rules, of those that seek to goals, which are dealt."""
        p = self.waters.settings
        todo = by_rule(tasks([], p.fish, rng), p)
        if seekers:
            for fish, lot in zip(seekers, deal(goals, len(seekers)), strict=True):
                todo[fish] = todo[fish]._replace(goals=lot)
        return todo

    def trial(self, player: Player, number: int) -> tuple[pd.DataFrame, list[Sequence[Goal]]]:
        """A further animation, to random goals of each fish: its edit list, and their goals."""
        todo, ticks = self._trial(number), self.waters.duration
        goals = [task.goals for task in todo]
        return edit_lists(shoal(player, todo, ticks), ticks, player.sources), goals

    def _trial(self, number: int) -> list[Task]:
        p = self.waters.settings
        rng = np.random.default_rng([p.seed, number])
        goals = random_goals(self.waters, p.trial_goals * len(self.unruled), rng)
        return self._tasks(goals, self.unruled, rng)

    def check_room(self, goals: Sequence[Goal]) -> None:
        """NoRoom, before anything is planned, if there is none for all fish."""
        p = self.waters.settings
        if p.fish > 1:
            for player in self.players.values():
                settle(player, self.tasks(goals), Plans(p.fish))
                for number in range(p.trials):
                    settle(player, self._trial(number), Plans(p.fish))

    def plan(self, mode: str, goals: Sequence[Goal]) -> tuple[list[Swim], pd.DataFrame]:
        """An animation in a mode, fish by fish, and its edit list (columns of `EDIT`)."""
        player, p = self.players[mode], self.waters.settings
        ticks = self.waters.duration
        swum = shoal(player, self.tasks(goals), ticks)
        edit = edit_lists(swum, ticks, player.sources)
        if p.join == FADE:
            edit = without_ghosts(edit, self.pictures, p.fade_steps * self.step)
        return swum, edit


def planner(made: Material, p: Settings) -> Planner:
    """Bring together everything that swims."""
    reel, hulls, area, reach_px, barred = sized(made, p)
    facts, rate_hz = made.map_facts, made.rate_hz
    features, sprites = reel.features, reel.sprites
    motion = learn(features, rate_hz, delta_frames(made.model.delta_s, rate_hz), p)
    motion = motion.sized(reel.size)
    bodies = Bodies(made.poses, reel.goes_on, sprites)
    pictures = Pictures(reel, facts.size, bodies)
    cast = Cast(sprites, outlines(reel), hulls)
    for line in made.lines:
        if line is not None and line.rows is not None and not p.path_film:
            barred[line.rows] = True
    pose = facts.pose if p.jumps == "loops" else BODY
    how = joins(p, bodies, motion.delta, pictures.helps)
    seen = np.full(len(features), np.nan)
    seen[mapped(features, made.steps)] = made.steps["as_filmed"]
    rarity = Rarity.of(
        bodies.movement, made.poses.codes, reel.goes_on, seen, how.spring()[0], p.rare
    )
    way = film(features, _jumps(made, p), motion, pose, barred, rarity.dear, how.rests)
    head = (
        np.hypot(
            features["head_x_px"] - features["x_px"], features["head_y_px"] - features["y_px"]
        ).median()
        * reel.size
    )
    order = arrange(sprites, distance(pictures.after, pictures.headed), motion.rate_hz)
    touch_px = p.goal_radius * motion.body_length_px
    water = tank(area, reach_px)
    swum = None if made.forecast is None else endless(made.forecast, way.more, how.rests)
    learned = swum is not None and swum.usable.any() and p.sprites == "learned"
    # Sprites are shown where every picture fits alone.
    discs = cast.discs if learned else NO_DISCS
    waters = Waters(water, way, order, motion, touch_px, float(head), p, discs)
    followers = _followers(sprites, way) if p.jumps == "neighbours" else None
    gates = Gates(made.gateways, facts.step_median, followers)
    by_mode = players(waters, cast, made.model, gates, how)
    if swum is not None and learned:
        swimmer = ForecastSwimmer(waters, swum, sprites["row"].to_numpy(), rarity)
        for mode in (NETWORK, HYBRID):
            policy = replace(by_mode[mode].policy, forecast=swimmer)
            by_mode[mode] = replace(by_mode[mode], policy=policy)
    by_mode = {mode: replace(one, shoaling=made.shoaling) for mode, one in by_mode.items()}
    paths = tuple(
        None if line is None else lay(line, water, motion, made.mm_per_px) for line in made.lines
    )
    return Planner(waters, by_mode, pictures, facts.step_median, reach_px, paths)


class Sized(NamedTuple):
    """A film at the size at which it is drawn.

    hulls: of its frames; area (h, w): where its fish may be; reach_px, barred: of `reach`.
    """

    reel: Reel
    hulls: FrameHulls
    area: Mask
    reach_px: float
    barred: Mask


def sized(made: Material, p: Settings) -> Sized:
    """The film at the size that is asked for; by `auto` it fits in where the fish may be."""
    reel, outline_px = made.reel, made.outline_px
    scale = (reel.length_px / reel.lengths_px).astype(float)
    filmed = frame_hulls(outline_px, reel.features, scale)
    reach_px, barred = reach(outlines(reel), filmed, p.reach_quantile)
    size = 1.0 if p.size == "auto" else p.size
    area = where(made.arena, outline_px, size * reach_px, p.tank, made.floor)
    size = size_for(area, reach_px) if p.size == "auto" else size
    hulls = replace(filmed, scale=size * scale)
    return Sized(reel.sized(size), hulls, area, size * reach_px, barred)


def _jumps(made: Material, p: Settings) -> Jumps:
    """Where the film can go on, by its loops or by nearest neighbours."""
    rows = made.reel.features["track_id"].to_numpy()
    if p.jumps == "loops":
        return loop_jumps(loop_graph(made.loops, rows), len(rows), made.map_facts.step_median)
    return neighbour_jumps(made.jumps, len(rows))


def frame_hulls(outline_px: Reals, places: pd.DataFrame, scale: Floats) -> FrameHulls:
    """The outlines of the film's frames about their mass centre.

    outline_px (n, k, 2): x, y as filmed; places: x_px, y_px, heading_deg of each; scale (n,):
    drawn size / filmed size.
    """
    centre = places[["x_px", "y_px"]].to_numpy(float)
    heading = np.radians(places["heading_deg"].to_numpy(float))
    return FrameHulls(outline_px, centre, heading, scale)


def reach(sprite_hulls: Sequence[Floats], hulls: FrameHulls, quantile: float) -> tuple[float, Mask]:
    """How far from its centre a fish reaches [px], and the frames (n,) that reach farther.

    quantile: of the frames' reach; wider ones are mostly faults.
    """
    frames = hulls.reach_px
    sprites = max(float(np.hypot(*hull.T).max()) for hull in sprite_hulls)
    most = max(sprites, float(np.quantile(frames, quantile)))
    return most, frames > most


class Gates(NamedTuple):
    """How sprites and film are joined, as `Crossing` takes it."""

    gateways: pd.DataFrame
    median_step: float
    followers: Ints | None = None


def _followers(sprites: pd.DataFrame, way: Film) -> Ints:
    """The row of the film (s,) that follows each sprite."""
    other = sprites["mirrored"].to_numpy() & (len(way.rows) > way.filmed)
    rows = sprites["row"].to_numpy() + way.filmed * other
    return rows + way.more[rows]


def players(
    waters: Waters, cast: Cast, model: MotionModel, gates: Gates, how: Joins
) -> dict[str, Player]:
    """A player for every mode; without loops there is no such mode, the hybrid is the network."""
    sprites = SpriteSwimmer(waters, model)
    policies = dict.fromkeys((NETWORK, HYBRID), Policy(NETWORK, sprites))
    if (waters.film.endless & waters.film.more).any():
        crossing = Crossing(sprites, FilmSwimmer(waters), *gates)
        policies = {mode: Policy(mode, sprites, crossing) for mode in MODES}
    return {mode: Player(policy, waters, cast, how) for mode, policy in policies.items()}
