"""The state of a fish: its place, its motion, what it remembers, and its plan."""

from typing import Any, NamedTuple

import numpy as np

from finloop.animate.obstacles import NO_OBSTACLES, Obstacles
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FILM, TURN

_NOTHING = np.zeros((0, 3), np.int64)


class Fish(NamedTuple):
    """The state of one fish at a tick: place, motion, pictures on screen, and the other fish.

    x, y in px, heading in degrees, speed in body lengths/s; state: number in `STATES`; sprite: the
    last one shown, −1 in the film; phase: place in its cycle of sprites, in frames; area: relative
    motion area; tick: ticks since its beginning. In the film: row, the last one shown, −1 for none;
    rotation_deg, of its picture; since, ticks since the last jump, or since the film was left;
    recent (m, 3): stretches of film that were on screen (`finloop.animate.memory`). When predicted:
    past (L + 1, d), its last states, the present one first (`finloop.forecast.sampling`). lag:
    ticks that it lags behind the film (`Tempo`). obstacles: where the other fish will be, for the
    present decision alone.
    """

    x: float
    y: float
    heading: float
    speed: float
    state: int
    sprite: int
    phase: float = 0.0
    area: float = 0.0
    tick: int = 0
    row: int = -1
    rotation_deg: float = 0.0
    since: int = 0
    recent: Ints = _NOTHING
    past: Floats | None = None
    lag: float = 0.0
    obstacles: Obstacles = NO_OBSTACLES

    @property
    def is_bent(self) -> bool:
        """Return whether the sprite on screen shows a bent fish, as when a turn is cut short."""
        return self.row < 0 and self.state == TURN and self.area > 0

    @property
    def picture(self) -> int:
        """Return the number of the picture on screen: its film row, or −1 − its sprite."""
        return self.row if self.row >= 0 else -1 - self.sprite


class Run(NamedTuple):
    """A run of film to show: its first row, and how many ticks it lasts."""

    row: int
    ticks: int


class Progress(NamedTuple):
    """How far a fish is along its path, and what it has planned beyond the last stretch.

    along: px along the path; task: the path or target that `runs` are planned for; runs: of film to
    show next; motion: FILM or FORECAST, whether the fish moves as filmed or as predicted.
    """

    along: float = 0.0
    task: Any = None
    runs: tuple[Run, ...] = ()
    motion: int = FILM


class State(NamedTuple):
    """All that the next stretch depends on, except the goal and the random draws.

    place (2,): x, y px where the fish wanders to while it has no goal; place_ticks_left: for how
    many more ticks; by_rule: whether a rule requested the place; progress: along a path, and the
    plan.
    """

    fish: Fish
    place: Floats
    place_ticks_left: int = 0
    by_rule: bool = False
    progress: Progress = Progress()
