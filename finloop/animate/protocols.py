"""What the player of every mode can do, for planning, measuring and live display."""

from typing import Protocol

import numpy as np

from finloop.animate.obstacles import Obstacles
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.silhouettes import Silhouettes
from finloop.animate.state import State
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.edit.build import EditInputs
from finloop.edit.joins import JoinRules
from finloop.edit.schema import Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import SchoolRule


class AnyPlayer(Protocol):
    """Moves a fish in a mode, stretch by stretch."""

    @property
    def world(self) -> World:
        """Return the tank, the motion statistics of the film, and sizes."""

    @property
    def join_rules(self) -> JoinRules:
        """Return how a picture after a jump is fitted to the one before: faded, cut or inertial."""

    @property
    def silhouettes(self) -> Silhouettes:
        """Return the table of sprites, and the outlines of all pictures."""

    @property
    def edit_inputs(self) -> EditInputs:
        """Return the inputs of an edit list: ticks per second, headings, sizes, joins."""

    @property
    def school_rule(self) -> SchoolRule | None:
        """Return the zones by which fish swim in a group; None if the film gives none."""

    @property
    def most_fish(self) -> int | None:
        """Return the most fish that a tank may hold; None: any number."""

    def begin(
        self, rng: np.random.Generator, route: Route | None = ..., obstacles: Obstacles = ...
    ) -> State:
        """Return a fish at the beginning of a route, else at a random clear place.

        On a route the place counts even if another fish is there.
        """

    def others_to_avoid(self, other_plans: Floats, tick: int) -> Obstacles:
        """Return the other fish as obstacles for a fish that decides at `tick`.

        other_plans (n, m, 4): x, y px, heading, picture of m others in n ticks, from `tick` on.
        """

    def with_obstacles(self, state: State, other_plans: Floats) -> State:
        """Replace the other fish that a state knows by their present plans; return the new state.

        other_plans (n, m, 4): x, y px, heading, picture of m others at n ticks.
        """

    def is_clear(self, state: State, stretch: Stretch) -> bool:
        """Return whether a stretch that begins in `state` meets no other fish."""

    def plan(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """Return the next stretch to a goal, along a path or by a rule, and the state after it."""

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """Cut a stretch that began in `state` after some ticks; return it and the state then."""
