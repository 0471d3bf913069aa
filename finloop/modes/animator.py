"""The animator of a mode, which plans animations, and what all modes share of a film."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.arena import make_tank, place_goals
from finloop.animate.motion import MotionStatistics
from finloop.animate.obstacles import Plans
from finloop.animate.places import random_goals
from finloop.animate.protocols import AnyPlayer
from finloop.animate.settings import AnimateSettings
from finloop.animate.shoal import SwimTask, animate_group, settle_fish
from finloop.animate.silhouettes import FilmOutlines, Silhouettes
from finloop.animate.size import ScaledFilm, head_ahead_px, scale_film
from finloop.animate.world import World
from finloop.base.arrays import Mask, Picture
from finloop.distance.map import MapFacts
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies
from finloop.edit.build import build_edit_lists
from finloop.edit.joins import resolve_join_rules
from finloop.edit.pictures import Pictures, remove_ghost_fades
from finloop.edit.schema import FADE, Goal
from finloop.edit.stretch import Swim
from finloop.loops.graph import build_loop_graph
from finloop.modes.player import FilmFrames, PaperMode, PaperPlayer
from finloop.modes.sprites import Sprites
from finloop.plan.graph import Jumps, MotionGraph, loop_jumps, motion_graph, rows_with_next
from finloop.pose.film import FilmPoses
from finloop.sprites.orient import sprite_outlines


class FilmData(NamedTuple):
    """What all modes take from a film of n rows.

    motion: statistics of its motion, as filmed; arena (h, w): true where fish can be; floor: the
    empty tank as filmed, None if unknown; reel: the film's pictures, with sprites for a mode that
    shows them; outlines, poses: of the rows; map_facts: size, pose and median step of the distance
    map; steps: Euclidean distances (Eq. 5) between successive pictures, columns of `STEPS`.
    """

    motion: MotionStatistics
    arena: Mask
    floor: Picture | None
    reel: Reel
    outlines: FilmOutlines
    poses: FilmPoses
    map_facts: MapFacts
    steps: pd.DataFrame

    @property
    def natural_step(self) -> float:
        """Return the median distance between successive pictures, both turned to head right."""
        return float(self.steps["headed"].median())


@dataclass(frozen=True)
class Animator:
    """Plans animations of one fish in one mode, as edit lists (columns of `EDIT`).

    player: of the mode, moves the fish stretch by stretch; pictures: that the edit lists show;
    step: the film's natural step, the median distance (Eq. 5) between successive pictures, both
    turned to head right; p: the group `animate` of the parameters.
    """

    player: AnyPlayer
    pictures: Pictures
    step: float
    p: AnimateSettings

    @property
    def fish_count(self) -> int:
        """Return the number of fish that swim together in an animation."""
        return 1

    def goals(self) -> list[Goal]:
        """Return the goals of the parameters, px of the clip, each with its radius.

        Those in shares of the tank are moved to where the fish can reach them; FinloopError if one
        in px is out of reach.
        """
        world = self.player.world
        touch_px = world.touch_px + world.head_px
        placed = place_goals(self.p.goals, self.p.goal_unit, world.tank, touch_px)
        return [goal._replace(radius_px=world.touch_px) for goal in placed]

    def tasks(self, goals: Sequence[Goal]) -> list[SwimTask]:
        """Return the tasks of an animation to `goals`: one fish, which swims to all of them."""
        return [SwimTask(goals, np.random.default_rng(self.p.seed))]

    def trial_tasks(self, number: int) -> list[SwimTask]:
        """Return the tasks of random animation number `number`: one fish, with random goals.

        Each number gives other goals.
        """
        rng = np.random.default_rng([self.p.seed, number])
        return [SwimTask(random_goals(self.player.world, self.p.trial_goals, rng), rng)]

    def goals_by_fish(self, goals: Sequence[Goal]) -> list[Sequence[Goal]]:
        """Share out an animation's goals; return the goals of each fish, in their order.

        A fish that follows a path or a rule has none. The other fish share the goals, which are
        dealt in turn: the first goal to the first fish (`deal_goals`).
        """
        return [task.goals for task in self.tasks(goals)]

    def check_room(self, goals: Sequence[Goal]) -> None:
        """Raise NoRoom if the tank lacks room for all fish, in the animation or a trial.

        goals: of the animation. Only the first stretch of each fish is planned.
        """
        if self.fish_count == 1:
            return
        for tasks in (self.tasks(goals), *map(self.trial_tasks, range(self.p.trials))):
            settle_fish(self.player, tasks, Plans(self.fish_count))

    def plan(self, goals: Sequence[Goal]) -> tuple[list[Swim], pd.DataFrame]:
        """Plan an animation to `goals`; return each fish's `Swim`, and the edit list (`EDIT`).

        In an animation joined by cross-fades, pictures too unlike to be mixed are not mixed.
        """
        animations, edit = self._animate(self.tasks(goals))
        if self.player.join_rules.kind == FADE:
            edit = remove_ghost_fades(edit, self.pictures, self.p.fade_steps * self.step)
        return animations, edit

    def sample(self, seed: int, seconds: float) -> pd.DataFrame:
        """Return the edit list of an animation of `seconds` s to random goals drawn by a seed."""
        world, count = self.player.world, self.p.trial_goals * self.fish_count
        goals = [
            goal._replace(radius_px=world.touch_px)
            for goal in random_goals(world, count, np.random.default_rng(seed))
        ]
        return replace(self, p=replace(self.p, seed=seed, seconds=seconds)).plan(goals)[1]

    def trial(self, number: int) -> tuple[pd.DataFrame, list[Sequence[Goal]]]:
        """Return the edit list of a random animation without paths, and each fish's goals.

        number: of the trial; each number gives other random goals.
        """
        tasks = self.trial_tasks(number)
        return self._animate(tasks)[1], [task.goals for task in tasks]

    def _animate(self, tasks: Sequence[SwimTask]) -> tuple[list[Swim], pd.DataFrame]:
        """Animate a fish for each task for `p.seconds`; return each `Swim`, and one edit list."""
        ticks = round(self.p.seconds * self.player.world.motion.rate_hz)
        animations = animate_group(self.player, tasks, ticks)
        return animations, build_edit_lists(animations, ticks, self.player.edit_inputs)


class ModeAssets(NamedTuple):
    """What all modes share: the film at its drawn size (scaled), its tank, pictures, outlines."""

    film_data: FilmData
    scaled: ScaledFilm
    world: World
    pictures: Pictures
    silhouettes: Silhouettes


def prepare_mode_assets(film_data: FilmData, p: AnimateSettings) -> ModeAssets:
    """Return what all modes share: the film at its drawn size, its tank, pictures and outlines.

    film_data: what is taken from the film; p: the group `animate` of the parameters.
    """
    scaled = scale_film(film_data.reel, film_data.outlines, film_data.arena, p, film_data.floor)
    reel = scaled.reel
    motion = film_data.motion.scale_to(reel.scale)
    world = World(
        make_tank(scaled.area, scaled.reach_px),
        motion,
        touch_px=p.goal_radius_bl * motion.body_length_px,
        head_px=head_ahead_px(reel.features, reel.scale),
    )
    bodies = Bodies(film_data.poses, reel.has_next_frame, reel.sprites)
    pictures = Pictures(reel, film_data.map_facts.size, bodies)
    of_sprites = sprite_outlines(reel) if len(reel.sprites) else []
    silhouettes = Silhouettes(reel.sprites, of_sprites, scaled.outlines)
    return ModeAssets(film_data, scaled, world, pictures, silhouettes)


def video_loop_graph(assets: ModeAssets, loops: pd.DataFrame) -> MotionGraph:
    """Return the motion graph of the film, whose only jumps are those of its video loops.

    assets: what the modes share; loops: rows a, b and distance of each loop.
    """
    features, map_facts = assets.scaled.reel.features, assets.film_data.map_facts
    n, track = len(features), features["track_id"].to_numpy()
    jumps = Jumps(  # none
        np.full(n, -1, np.int32), start=np.zeros(1, np.int32), to=np.zeros(0, np.int32),
        seam=np.zeros(0),
    )  # fmt: skip
    if len(loops):
        jumps = loop_jumps(build_loop_graph(loops, track), n, map_facts.step_median)
    return motion_graph(
        features, jumps, assets.world.motion, map_facts.frame_of_reference, assets.scaled.barred,
        rarity_sum=np.zeros(n),
    )  # fmt: skip


def make_animator(
    assets: ModeAssets, mode: PaperMode, sprites: Sprites | None, p: AnimateSettings, join: str
) -> Animator:
    """Return the animator of a mode of the paper, which plans animations by a flow chart.

    assets: what the modes share; mode: its flow chart; sprites: None in a mode without sprites; p:
    the group `animate`; join: how pictures are joined, "fade", "inertial" or "cut".
    """
    reel, motion = assets.scaled.reel, assets.world.motion
    frames = FilmFrames(
        reel.features["heading_deg"].to_numpy(float),
        scale=motion.body_length_px / reel.lengths_px.astype(float),
        goes_on=rows_with_next(reel.features["track_id"].to_numpy(), assets.scaled.barred),
    )
    join_rules = resolve_join_rules(p, join, assets.pictures.bodies, motion.delta)
    player = PaperPlayer(mode, assets.world, frames, sprites, assets.silhouettes, join_rules)
    return Animator(player, assets.pictures, assets.film_data.natural_step, p)
