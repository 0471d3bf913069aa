"""What the player of any mode can do, by which fish are planned, measured and shown live."""

from typing import Protocol

import numpy as np

from finloop.animate.arena import Tank
from finloop.animate.cast import Cast
from finloop.animate.company import Company
from finloop.animate.motion import Motion
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.state import State
from finloop.base.arrays import Floats
from finloop.edit.build import Sources
from finloop.edit.joins import Joins
from finloop.edit.schema import Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import Shoaling


class AnyWorld(Protocol):
    """Where a fish swims: the tank, what the film teaches, px to a goal, px to its head."""

    @property
    def tank(self) -> Tank: ...
    @property
    def motion(self) -> Motion: ...
    @property
    def touch_px(self) -> float: ...
    @property
    def head_px(self) -> float: ...


class AnyPlayer(Protocol):
    """Moves a fish in a mode. most_fish: that a tank may hold; None: any number."""

    @property
    def waters(self) -> AnyWorld: ...
    @property
    def joins(self) -> Joins: ...
    @property
    def cast(self) -> Cast: ...
    @property
    def sources(self) -> Sources: ...
    @property
    def shoaling(self) -> Shoaling | None: ...
    @property
    def most_fish(self) -> int | None: ...
    def begin(
        self, rng: np.random.Generator, route: Route | None = ..., company: Company = ...
    ) -> State: ...
    def company(self, others: Floats, start: int) -> Company: ...
    def among(self, state: State, others: Floats) -> State: ...
    def is_clear(self, state: State, stretch: Stretch) -> bool: ...
    def step(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]: ...
    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]: ...
    def hull(self, kind: str, source: int) -> Floats: ...
