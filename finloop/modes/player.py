"""The player of the paper's modes: one fish in its tank, to a goal or wandering."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from finloop.animate.kinematics import Target
from finloop.animate.obstacles import NO_OBSTACLES, Obstacles
from finloop.animate.places import random_wander_place
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.silhouettes import Silhouettes
from finloop.animate.state import Fish, State
from finloop.animate.world import World
from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.edit.build import EditInputs
from finloop.edit.joins import JoinRules
from finloop.edit.schema import TURN, Goal
from finloop.edit.stretch import Stretch
from finloop.modes.sprites import Sprites


class PaperMode(Protocol):
    """The flow chart of a mode of the paper: returns the next stretch of a fish."""

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place of the tank."""

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode for this one, at the same place."""

    def next_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Choose and return the next stretch of a fish towards a goal."""

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch that began with `fish`."""


class FilmFrames(NamedTuple):
    """The film's frames (n,) as an edit list needs them.

    heading_deg: as filmed; scale: drawn size / filmed size; goes_on: whether the next row may be
    shown after it.
    """

    heading_deg: Floats
    scale: Floats
    goes_on: Mask


@dataclass(frozen=True)
class PaperPlayer:
    """Plays a mode of the paper with one fish, which swims to goals or wanders.

    frames: of the film; sprites: in cycles and turns, None in a mode without them; silhouettes:
    outlines of frames and sprites; join_rules: how pictures are joined.
    """

    mode: PaperMode
    world: World
    frames: FilmFrames
    sprites: Sprites | None
    silhouettes: Silhouettes
    join_rules: JoinRules

    school_rule = None
    most_fish = 1

    @cached_property
    def edit_inputs(self) -> EditInputs:
        """Return the inputs of an edit list: ticks per second, headings, sizes, joins."""
        motion, sprites = self.world.motion, self.sprites
        scale, next_sprites, orientations = np.ones(1), np.zeros(1, np.int64), 1  # never shown
        if sprites is not None:
            scale, next_sprites = self.silhouettes.sprite_scale, sprites.following
            orientations = sprites.orientations
        return EditInputs(
            motion.rate_hz, motion.body_length_px, **self.frames._asdict(), sprite_scale=scale,
            sprite_after=next_sprites, orientations=orientations, join_rules=self.join_rules,
            frame_mode="loops", sprite_mode="network",
        )  # fmt: skip

    def begin(
        self, rng: np.random.Generator, route: Route | None = None,
        obstacles: Obstacles = NO_OBSTACLES,
    ) -> State:  # fmt: skip
        """Return the state of a fish at a random place; FinloopError if given a route."""
        if route is not None:
            raise FinloopError(
                "a path, in a mode of one fish",
                "goals, or none: in these modes the fish swims to goals, or wanders",
                "switch to mode matching, the only one that follows paths",
            )
        return State(self.mode.begin(rng), np.zeros(2))

    def others_to_avoid(self, other_plans: Floats, tick: int) -> Obstacles:
        """Return no other fish: in the paper's modes a fish is alone."""
        return NO_OBSTACLES

    def with_obstacles(self, state: State, other_plans: Floats) -> State:
        """Return the state unchanged: the paper's modes ignore other fish."""
        return state

    def is_clear(self, state: State, stretch: Stretch) -> bool:
        """Return True: in the paper's modes there is no other fish to meet."""
        return True

    def plan(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """Return the next stretch to a goal, or to a random place, and the state after it.

        A fish that another mode moved before goes on in this one.
        """
        world, place, ticks_left = self.world, state.place, state.place_ticks_left
        fish = self.mode.take_over(state.fish)
        if isinstance(goal, Goal):
            x, y, ticks_left = goal.x_px, goal.y_px, 0
        else:
            if ticks_left <= 0:
                place, ticks_left = random_wander_place(world, fish, rng)
            x, y = place
        wanders = not isinstance(goal, Goal)
        target = Target(float(x), float(y), world.touch_px, world.head_px, wanders)
        stretch = self.mode.next_stretch(fish, target, rng)
        if fish is not state.fish:
            stretch = replace(stretch, begins_with_transition=True)
        if wanders:
            ticks = len(stretch.trajectory) * (stretch.state != TURN)  # turns do not count
            ticks_left = 0 if stretch.touches_goal else max(0, ticks_left - ticks)
        return stretch, State(self.mode.end_state(fish, stretch), place, ticks_left)

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """Cut a stretch that began in `state` after some ticks; return it and the state then."""
        short = stretch.cut(ticks)
        # Without the rest of a plan of `matching`, which began elsewhere.
        fish = self.mode.end_state(state.fish, short)
        return short, State(fish, state.place, state.place_ticks_left)
