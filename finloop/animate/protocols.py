"""What the player of every mode can do, for planning, measuring and live display."""

from typing import Protocol

import numpy as np

from finloop.animate.cast import Cast
from finloop.animate.company import Company
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.state import State
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.edit.build import EditInputs
from finloop.edit.joins import Joins
from finloop.edit.schema import Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import Shoaling


class AnyPlayer(Protocol):
    """Moves a fish in a mode."""

    @property
    def world(self) -> World:
        """Return what the fish swim in."""

    @property
    def joins(self) -> Joins:
        """Return how pictures follow others."""

    @property
    def cast(self) -> Cast:
        """Return the sprites and the outlines of all pictures."""

    @property
    def sources(self) -> EditInputs:
        """Return what the edit lists can show."""

    @property
    def shoaling(self) -> Shoaling | None:
        """Return how fish swim by zones, None if unknown."""

    @property
    def most_fish(self) -> int | None:
        """Return the most fish that a tank may hold; None: any number."""

    def begin(
        self, rng: np.random.Generator, route: Route | None = ..., company: Company = ...
    ) -> State:
        """Return a fish at the beginning of a path, or somewhere in the tank."""

    def company(self, others: Floats, start: int) -> Company:
        """Return the other fish (n, m, 4), known from a tick on."""

    def with_others(self, state: State, others: Floats) -> State:
        """Return the state with the other fish (n, m, 4) that it can meet."""

    def is_clear(self, state: State, stretch: Stretch) -> bool:
        """Return whether a stretch from a state meets no other fish."""

    def plan(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """Return the next stretch, and the state after it."""

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """Return the first ticks of a stretch that began in a state, and the state then."""

    def hull(self, kind: str, source: int) -> Floats:
        """Return the outline of a frame or sprite, px ahead and left of its centre."""
