"""Mode `matching`: the animator that plans by one search, and what it takes from a film."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.paths import Path, lay_path
from finloop.animate.places import random_goals
from finloop.animate.shoal import SwimTask, deal_goals, make_tasks, refuse_shared_goals
from finloop.base.arrays import Ints
from finloop.base.errors import FinloopError
from finloop.base.line import Line
from finloop.distance.map import find_map_rows
from finloop.distance.picture import BODY
from finloop.edit.bodies import Bodies
from finloop.edit.joins import JoinRules, resolve_join_rules
from finloop.edit.schema import Goal
from finloop.forecast.sampling import Sampler
from finloop.modes.animator import Animator, FilmData, ModeAssets
from finloop.plan.cost import Rarity
from finloop.plan.graph import index_jumps, motion_graph, remove_dead_ends
from finloop.plan.matching_settings import AllSettings
from finloop.plan.planner import Planner
from finloop.plan.sources import FilmSource, PredictionSource
from finloop.plan.world import FilmWorld
from finloop.social.leader import leaders_by_follower
from finloop.social.rule import SchoolRule, require_rule

NO_SPRITES: Ints = np.zeros(0, np.intp)


class MatchingData(NamedTuple):
    """What mode `matching` takes from a film of n rows; None where something is unknown.

    assets: what the modes share; jumps: columns of `JUMPS`; forecast: the sampler of predictions,
    None where the film shows too little for one; lines: the path of each of the first fish, None
    for a fish without one; school_rule: how fish swim by zones; sprite_rows (s,): the film's row
    behind each sprite, from which a fish of another mode goes on.
    """

    assets: ModeAssets
    jumps: pd.DataFrame
    forecast: Sampler | None = None
    lines: Sequence[Line | None] = ()
    mm_per_px: float | None = None
    school_rule: SchoolRule | None = None
    sprite_rows: Ints = NO_SPRITES


@dataclass(frozen=True)
class MatchingAnimator(Animator):
    """Plans animations of one or more fish in mode `matching`.

    p: the groups `animate` and `matching` of the parameters; reach_px: how far the fish reaches
    from its centre; paths: of the first fish, None for a fish without one.
    """

    player: Planner
    p: AllSettings
    reach_px: float = 0.0
    paths: tuple[Path | None, ...] = ()

    @property
    def world(self) -> FilmWorld:
        """Return the tank, the film's motion graph, and statistics of its motion."""
        return self.player.world

    @property
    def fish_count(self) -> int:
        """Return the number of fish that swim together in an animation."""
        return self.p.fish

    def goals(self) -> list[Goal]:
        """Return the parameters' goals, px; none where all fish follow paths or a rule.

        FinloopError if a goal is out of reach, two fish that may not overlap are sent to one place
        at the same time, or fish are to swim by zones and no rule for it is known.
        """
        if self.p.rule == "zones" and self.fish_count > 1:
            require_rule(self.player.school_rule)
        if not self.goal_seekers:
            return []
        goals = super().goals()
        if not self.p.overlap:
            refuse_shared_goals(goals, self.goal_seekers)
        return goals

    @property
    def fish_without_rule(self) -> list[int]:
        """Return the numbers, from 0, of the fish that follow no leader and swim by no zones.

        FinloopError if the rules contradict each other.
        """
        no_draws = np.random.default_rng()  # tasks need a generator, from which nothing is drawn
        tasks = add_rules(make_tasks([], self.fish_count, no_draws), self.p)
        return [fish for fish, task in enumerate(tasks) if not task.zones and task.follows is None]

    @property
    def goal_seekers(self) -> list[int]:
        """Return the numbers, from 0, of the fish that swim to goals, without rule and path."""
        on_path = [fish for fish, path in enumerate(self.paths) if path is not None]
        return [fish for fish in self.fish_without_rule if fish not in on_path]

    def tasks(self, goals: Sequence[Goal]) -> list[SwimTask]:
        """Return the task of each fish: its path, its share of `goals`, or its rule."""
        rng = np.random.default_rng(self.p.seed)
        tasks = self._share_out_tasks(goals, self.goal_seekers, rng)
        for fish, path in enumerate(self.paths):
            if path is not None:
                tasks[fish] = tasks[fish]._replace(route=path.route)
        return tasks

    def trial_tasks(self, number: int) -> list[SwimTask]:
        """Return the task of each fish in a random animation without paths.

        number: of the trial; each number gives other random goals.
        """
        rng = np.random.default_rng([self.p.seed, number])
        goals = random_goals(self.world, self.p.trial_goals * len(self.fish_without_rule), rng)
        return self._share_out_tasks(goals, self.fish_without_rule, rng)

    def _share_out_tasks(
        self, goals: Sequence[Goal], goal_seekers: Sequence[int], rng: np.random.Generator
    ) -> list[SwimTask]:
        """Return the tasks of all fish by the parameters' rules; `goal_seekers` share the goals."""
        tasks = add_rules(make_tasks([], self.fish_count, rng), self.p)
        for fish, dealt in zip(goal_seekers, deal_goals(goals, len(goal_seekers)), strict=True):
            tasks[fish] = tasks[fish]._replace(goals=dealt)
        return tasks


def matching_animator(film_data: MatchingData, p: AllSettings) -> MatchingAnimator:
    """Return the animator of mode `matching` for a film.

    film_data: what is taken from the film; p: the groups `animate` and `matching` of the
    parameters. Size and tank are those for which `film_data.assets` was prepared. NothingToUse
    where the film shows too little for what `matching.uses` names.
    """
    film, scaled, common, pictures, silhouettes = film_data.assets
    features, motion, bodies = scaled.reel.features, common.motion, pictures.bodies
    join_rules = resolve_join_rules(p, p.join, bodies, motion.delta)
    rarity = _film_rarity(film, features, bodies, join_rules, p.rarity_weight)
    barred = scaled.barred.copy()
    for line in film_data.lines:
        if line is not None and line.rows is not None and not p.path_own_frames:
            barred[line.rows] = True  # the film does not show the path's own frames
    jumps = index_jumps(film_data.jumps, len(features))
    graph = motion_graph(features, jumps, motion, BODY, barred, rarity.cumulative_row_costs)
    world = FilmWorld(
        common.tank, motion, common.touch_px, common.head_px, film=graph,
        settings=p, discs=silhouettes.discs,
    )  # fmt: skip
    film_source, prediction_source = _motion_sources(world, film_data.forecast, rarity, join_rules)
    player = Planner(
        world, film_source, prediction_source, silhouettes, join_rules, film_data.school_rule,
        film_data.sprite_rows,
    )  # fmt: skip
    paths = tuple(
        None if line is None else lay_path(line, world.tank, motion, film_data.mm_per_px)
        for line in film_data.lines
    )
    return MatchingAnimator(player, pictures, film.natural_step, p, scaled.reach_px, paths)


def _film_rarity(
    film_data: FilmData, features: pd.DataFrame, bodies: Bodies, rules: JoinRules, weight: float
) -> Rarity:
    """Return the rarity of a film: what each step from picture to picture costs; rare ones more.

    features: of the film, scaled to the size at which the fish is drawn; weight: a step that the
    film shows once in n frames costs weight × n ticks.
    """
    # From each row's picture to the next (Eq. 5); `Rarity` estimates it where it is unknown, NaN.
    filmed_steps = np.full(len(features), np.nan)
    filmed_steps[find_map_rows(features, film_data.steps)] = film_data.steps["as_filmed"]
    offset_response, _velocity_response = rules.spring_response()
    return Rarity.from_movement(
        bodies.movement, film_data.poses.codes, bodies.goes_on, filmed_steps, offset_response,
        weight,
    )  # fmt: skip


def _motion_sources(
    world: FilmWorld, sampler: Sampler | None, rarity: Rarity, rules: JoinRules
) -> tuple[FilmSource | None, PredictionSource | None]:
    """Return the film and the forecast as motion sources, None for one that cannot be used.

    sampler: of the forecast, None where there is none. NothingToUse where neither can be used.
    """
    film, uses, prediction_source = world.film, world.settings.uses, None
    if sampler is not None:
        sampler = remove_dead_ends(sampler, film.has_next, rules.rests)
        if "forecast" in uses and sampler.usable.any():
            prediction_source = PredictionSource(world, sampler, rarity)
    can_play = "film" in uses and bool((film.recurrent & film.has_next).any())
    if not can_play and prediction_source is None:
        raise NothingToUse(
            f"the film is too short or too uneven for matching.uses={list(uses)}",
            "frames that can follow each other for ever, or a forecast of them",
            "take a longer film, or another mode; see reports/jumps and reports/forecast",
        )
    return FilmSource(world) if can_play else None, prediction_source


class NothingToUse(FinloopError):
    """The error that the film shows too little for a mode."""


def add_rules(tasks: Sequence[SwimTask], p: AllSettings) -> list[SwimTask]:
    """Return the tasks with each fish's rule of the parameters filled in: a leader, or zones.

    tasks: of all fish; the parameters number fish from 1. FinloopError if the rules contradict each
    other.
    """
    leaders = leaders_by_follower(p.follow_pairs, len(tasks))
    zones = p.rule == "zones"
    return [
        task._replace(follows=leaders[fish] - 1) if fish in leaders else task._replace(zones=zones)
        for fish, task in enumerate(tasks, 1)
    ]
