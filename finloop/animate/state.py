"""The state of a fish, frozen, and the stretches that lead from one state to the next.

A stretch is some ticks of swimming that one decision gives. `after` is the state at its end; of a
stretch that is cut short it is the state at the cut.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import Tank
from finloop.animate.bounds import Bounds, bounds_of
from finloop.animate.brisk import Brisk
from finloop.animate.company import ALONE, NO_DISCS, Company, Discs
from finloop.animate.film import Film, farthest
from finloop.animate.kinematics import Spot, wrap
from finloop.animate.motion import Motion
from finloop.animate.plan_settings import Settings
from finloop.animate.recent import NO_REPEAT, Repeat, remembered, repeated
from finloop.animate.route import Route
from finloop.animate.tempo import Tempo
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import SPOT, TURN, WAITING
from finloop.edit.stretch import Stretch
from finloop.social.walls import Walls


@dataclass(frozen=True)
class Waters:
    """What a fish of `matching` swims in and by: the tank, the film, what the film teaches.

    touch_px: radius of a goal; head_px: the head is so far before the centre; discs: by which it is
    told whether a picture is inside the tank; none where the fish must be where all are.
    """

    tank: Tank
    film: Film
    motion: Motion
    brisk: Brisk
    touch_px: float
    head_px: float
    settings: Settings
    discs: Discs = NO_DISCS

    def ticks(self, time: float) -> int:
        """A time of the settings, in Δ, in ticks."""
        return round(time * self.motion.delta)

    @cached_property
    def walls(self) -> Walls:
        """The wall of the tank, as rules between fish have it."""
        return Walls(self.tank.arena, self.motion.body_length_px)

    @cached_property
    def bounds(self) -> Bounds:
        """What keeps a fish inside the tank."""
        return bounds_of(self.tank, self.discs)

    @cached_property
    def farthest(self) -> Floats:
        """How far (t,) the film's fish come from where they are in 0, 1, 2 … ticks, at most, px."""
        return farthest(self.film, self.ticks(2 * self.settings.give_way) + 2)

    @cached_property
    def tempo(self) -> Tempo:
        """How fast the film's fish swim."""
        return Tempo.of(self.film, self.ticks(self.settings.memory), self.motion.delta)

    def price_of_rest(self, fish: "Fish", aim: Spot) -> float:
        """Ticks that every tick on the spot costs a fish; < 0 only where it wanders."""
        price = self.tempo.price(fish.lag, self.settings.tempo)
        return price if aim.free else max(price, 0.0)

    @property
    def duration(self) -> int:
        """Ticks of the animation."""
        return round(self.settings.seconds * self.motion.rate_hz)


@dataclass(frozen=True, slots=True)
class Fish:
    """Where a fish is, what it does, and what it remembers.

    x, y in px, heading in degrees, speed in body lengths/s; state: of `STATES`; sprite: the last
    one shown, −1 in the film; phase: place in its cycle, in frames; area: relative motion area;
    tick: how long it has swum. In the film: row, the last one shown, −1 for none; rot, by how much
    it is turned; since, ticks since the last jump, or since the film was left; waits, ticks without
    a legal way on; recent (m, 3): stretches of film that were on screen (`finloop.animate.recent`);
    repeat: whether what is shown repeats them.
    As is foretold: past (L + 1, d), its last states, the present one first
    (`finloop.forecast.sampling`). lag: ticks that it lags behind the film (`Tempo`).
    company: where the other fish will be, for the decision that is made now alone.
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
    rot: float = 0.0
    since: int = 0
    waits: int = 0
    recent: Ints = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    repeat: Repeat = NO_REPEAT
    past: Floats | None = None
    lag: float = 0.0
    company: Company = ALONE

    @property
    def bent(self) -> bool:
        """Whether it was stopped in a turn; at the end of a turn a fish is straight."""
        return self.row < 0 and self.state == TURN and self.area > 0

    @property
    def picture(self) -> int:
        """The number of the picture that it shows, by which discs are looked up."""
        return self.row if self.row >= 0 else -1 - self.sprite


class Effort(NamedTuple):
    """How a fish gets on with a goal.

    goal: x, y of it, px; far: px, how far from there it was at most since it last came nearer;
    since: at which tick that was; detour: x, y of where it swims instead, until that tick.
    """

    goal: tuple[float, float] = (np.nan, np.nan)
    far: float = np.inf
    since: int = 0
    detour: tuple[float, float] = (np.nan, np.nan)
    until: int = 0


class Run(NamedTuple):
    """A run of film that is to be shown: its first row, and how many ticks of it."""

    row: int
    ticks: int


class Progress(NamedTuple):
    """How far a fish has come along a path, px, and what it has planned beyond the last stretch.

    route: the path that `runs` are planned along; foretold: whether they are followed as is
    foretold, not shown as filmed.
    """

    along: float = 0.0
    route: Route | None = None
    runs: tuple[Run, ...] = ()
    foretold: bool = False


class State(NamedTuple):
    """All that the next stretch depends on, beside the goal and the random draws.

    place (2,): where the fish wanders to while it has no goal, for `left` ticks more; wished:
    whether a rule has wished the place; effort: how it gets on with its goal; path: how it gets on
    with its path, where it swims one.
    """

    fish: Fish
    place: Floats
    left: int = 0
    wished: bool = False
    effort: Effort = Effort()
    path: Progress = Progress()


@dataclass(frozen=True)
class Options:
    """Rows (k,) that could be shown next, and the verdict on each.

    rots: by how much they would be turned; seams: distances in median steps; terms (k, 3): seconds
    that showing them costs at once, for the seam, for the change of speed, for what was on screen
    just now; value: seconds to the goal that the best way from there takes, with these and its
    further jumps, infinite where there is none; ticks: how long it stays in the tank; verdict:
    number in `VERDICTS`; taken: which one was, −1 for none.
    """

    rows: Ints
    rots: Floats
    seams: Floats
    terms: Floats
    value: Floats
    ticks: Floats
    verdict: NDArray[np.int8]
    taken: int = -1


def after(fish: Fish, stretch: Stretch, waters: Waters) -> Fish:
    """The fish at the end of a stretch of film."""
    ticks, number = len(stretch.way), int(stretch.number[-1])
    x, y, heading = map(float, stretch.way[-1])
    film = waters.film
    assert stretch.rot is not None
    return Fish(
        x, y, float(wrap(heading)),
        speed=0.0 if stretch.decision.reason in (SPOT, WAITING) else float(film.speed[number]),
        state=stretch.state, sprite=-1, phase=fish.phase, area=float(film.area[number]),
        tick=fish.tick + ticks, row=number, rot=float(stretch.rot[-1]),
        since=ticks - 1 if stretch.new else fish.since + ticks,
        waits=fish.waits + ticks if stretch.waits else 0,
        recent=_remembered(fish, stretch, waters), repeat=_repeated(fish, stretch),
        past=None if stretch.past is None else np.ascontiguousarray(stretch.past[ticks:][::-1]),
        lag=waters.tempo.after(fish.lag, stretch.way, (fish.x, fish.y)),
    )  # fmt: skip


def _remembered(fish: Fish, stretch: Stretch, waters: Waters) -> Ints:
    """The film that was on screen within the memory, with that of a stretch."""
    since = fish.tick - waters.settings.memory * waters.motion.delta
    first, last = stretch.number[[0, -1]].tolist()
    return remembered(fish.recent, first, last, fish.tick, since)


def _repeated(fish: Fish, stretch: Stretch) -> Repeat:
    """The repeat after a stretch."""
    first, last = stretch.number[[0, -1]].tolist()
    return repeated(fish.repeat, fish.recent, first, last)
