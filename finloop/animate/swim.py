"""Goals → edit list: the fish is sent from goal to goal, then wanders (Figs. 16-19)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.arena import Tank, goal_name
from finloop.animate.edit_list import CONSIDERED, EDIT, FRAME, LOOPS, NETWORK, SPRITE, Goal
from finloop.animate.motion import STATES, TURN, Motion
from finloop.animate.network import Fish, Stretch
from finloop.animate.search import Film
from finloop.animate.sprites import Sprites
from finloop.features.table import direction_deg, orientation, wrap_deg

_TRIES = 8  # a place to wander to is drawn so often before any place will do

Floats = NDArray[np.float64]
How = Callable[[Fish, Floats, str, np.random.Generator], Stretch]


class Mode(Protocol):
    """A way to swim: NetworkMode, LoopMode, HybridMode."""

    @property
    def motion(self) -> Motion: ...
    @property
    def tank(self) -> Tank: ...
    @property
    def touch_px(self) -> float: ...
    @property
    def head_px(self) -> float: ...

    def begin(self, rng: np.random.Generator) -> Fish: ...

    def stretch(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch: ...


@dataclass(frozen=True)
class Cast:
    """What is drawn: the sprites (n rows), the film's frames, and their outlines.

    sprite_hulls: the outline of every sprite, (k, 2) px ahead of and to the left of the mass
    centre, at the drawn size; frame_hulls (rows, k, 2): of every frame.
    """

    sprites: pd.DataFrame
    order: Sprites
    film: Film
    sprite_hulls: Sequence[Floats]
    frame_hulls: NDArray[np.float32]

    def hull(self, kind: str, source: int) -> Floats:
        """The outline of a picture as an edit list names it."""
        if kind == FRAME:
            return self.frame_hulls[source].astype(float)
        return self.sprite_hulls[source // self.order.orientations]

    def after(self, kind: str, number: int) -> int:
        """The picture after this one, itself where there is none."""
        if kind == SPRITE:
            return int(self.order.following[number])
        return number + int(self.film.more[number])


@dataclass(frozen=True)
class Player:
    """Whoever swims: a mode, what it is drawn with, how many ticks a cross-fade takes."""

    mode: Mode
    cast: Cast
    fade: int

    def play(self, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> pd.DataFrame:
        """An edit list of `ticks` ticks: to the goals one after the other, afterwards anywhere."""
        return edit_list(swim(self.mode, goals, ticks, rng), ticks, self)


@dataclass(frozen=True)
class Swim:
    """An animation. `reached` (goals,): the tick at which each goal was touched, −1 where not."""

    stretches: list[Stretch]
    names: list[str]  # of the goal, for each stretch
    reached: NDArray[np.int64]

    def considered(self, ticks: int) -> pd.DataFrame:
        """What was weighed in the first `ticks` ticks, with the columns of `CONSIDERED`."""
        begins = np.cumsum([0] + [len(s.way) for s in self.stretches])
        rows = [
            (tick, *one)
            for tick, stretch in zip(begins, self.stretches, strict=False)
            if tick < ticks
            for one in stretch.considered
        ]
        table = pd.DataFrame(rows, columns=[column.name for column in CONSIDERED.columns])
        value = table["value_s"].astype(float)
        return table.assign(value_s=value.where(np.isfinite(value)))


class Swimmer:
    """A fish on its way: to the goals one after the other, afterwards anywhere.

    `number` of them it has touched; `left`: ticks that it goes on wandering to the present place.
    """

    def __init__(self, mode: Mode, goals: Sequence[Goal], rng: np.random.Generator) -> None:
        self.mode, self.goals, self.rng = mode, list(goals), rng
        self.fish = mode.begin(rng)
        self.number, self.left = 0, 0
        self._wander = np.zeros(2)

    def swim_on(self, how: How | None = None) -> tuple[Stretch, str]:
        """The next stretch, and the name of the goal it leads to, "" for none.

        `how` it is swum: as the mode does, if nothing else is said.
        """
        fish, rng = self.fish, self.rng
        seeks = self.number < len(self.goals)
        if seeks:
            name, at = self.goals[self.number].name, np.array(self.goals[self.number][1:3])
        else:
            if self.left <= 0:
                self._wander, self.left = somewhere(self.mode, fish, rng)
            name, at = "", self._wander
        found = (how or self.mode.stretch)(fish, at, name, rng)
        fish.tick += len(found.way)
        self.left = 0 if found.touched else self.left - len(found.way) * (found.state != TURN)
        self.number += seeks and found.touched
        return found, name


def swim(mode: Mode, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> Swim:
    """Swim at least `ticks` ticks: to the goals one after the other, afterwards anywhere."""
    swimmer = Swimmer(mode, goals, rng)
    reached = np.full(len(goals), -1)
    stretches: list[Stretch] = []
    names = []
    while swimmer.fish.tick < ticks:
        number = swimmer.number
        found, name = swimmer.swim_on()
        stretches.append(found)
        names.append(name)
        if swimmer.number > number:
            reached[number] = swimmer.fish.tick - 1
    reached[reached >= ticks] = -1
    return Swim(stretches, names, reached)


def random_goals(tank: Tank, touch_px: float, count: int, rng: np.random.Generator) -> list[Goal]:
    """Places in the tank that a fish can touch, all equally likely."""
    goals: list[Goal] = []
    while len(goals) < count:
        y, x = (int(rng.integers(side)) for side in tank.arena.shape)
        near = tank.into(x, y)
        if tank.arena[y, x] and np.hypot(near[0] - x, near[1] - y) <= touch_px:
            goals.append(Goal(goal_name(len(goals)), float(x), float(y)))
    return goals


def somewhere(mode: Mode, fish: Fish, rng: np.random.Generator) -> tuple[NDArray[np.float64], int]:
    """A place (2,) px to wander to, as far aside as the film's turns go, and for how many ticks."""
    motion = mode.motion
    for _ in range(_TRIES):
        angle = rng.choice(motion.turns.angle_deg) * rng.choice((-1.0, 1.0))
        ticks = int(rng.choice(motion.straight_ticks))
        way = max(2.0, fish.speed * ticks / motion.rate_hz) * motion.body_length_px
        direction = np.radians(fish.heading + angle)
        x, y = fish.x + way * np.cos(direction), fish.y - way * np.sin(direction)
        if mode.tank.sees(fish.x, fish.y, x, y):
            return np.array([x, y]), ticks
    return np.array(mode.tank.random_point(rng)), int(rng.choice(motion.straight_ticks))


def edit_list(found: Swim, ticks: int, player: Player) -> pd.DataFrame:
    """The first `ticks` ticks as an edit list with the columns of `EDIT`."""
    table = pd.DataFrame(edit_columns(found, ticks, player))
    faded = table["weight"] > 0
    table["partner"] = pd.array(table["partner"], "Int32")
    table.loc[~faded, ["partner_kind", "partner"]] = None
    table.loc[~faded, ["partner_rotation_deg", "partner_scale"]] = np.nan
    return table[[column.name for column in EDIT.columns]]


def edit_columns(found: Swim, ticks: int, player: Player) -> dict[str, NDArray[np.generic]]:
    """The columns of an edit list, (ticks,) each; of the partner only where `weight` > 0."""
    stretches, motion, cast = found.stretches, player.mode.motion, player.cast
    lengths = np.array([len(s.way) for s in stretches])
    of = np.repeat(np.arange(len(stretches)), lengths)[:ticks]
    way = np.concatenate([s.way for s in stretches])[:ticks]
    rots = [np.zeros(len(s.way)) if s.rot is None else s.rot for s in stretches]
    shown = Shown(
        np.array([s.kind == FRAME for s in stretches])[of],
        np.concatenate([s.number for s in stretches])[:ticks],
        np.concatenate(rots)[:ticks],
    )
    start = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    first = start[start < ticks]
    heading = wrap_deg(way[:, 2])
    step = np.hypot(*np.diff(way[:, :2], axis=0, prepend=way[:1, :2]).T)
    speed = step / motion.body_length_px * motion.rate_hz
    speed[:1] = speed[1:2]
    partner, weight = cross_fades(shown, [s.new for s in stretches], first, cast, player.fade)
    decision = np.full(ticks, None, dtype=object)
    decision[first] = [stretches[i].why for i in range(len(first))]
    aims = np.array([s.target for s in stretches])
    other = {f"partner_{name}": column for name, column in drawn(partner, heading, cast).items()}
    return {
        "tick": np.arange(ticks),
        "time_s": np.arange(ticks) / motion.rate_hz,
        **drawn(shown, heading, cast),
        "x_px": way[:, 0],
        "y_px": way[:, 1],
        "partner": other.pop("partner_source"),
        **other,
        "weight": weight,
        "heading_deg": heading,
        "speed": speed,
        "motion_area": np.array([s.area for s in stretches])[of],
        "mode": np.where(shown.frame, LOOPS, NETWORK),
        "state": np.array(STATES)[np.array([s.state for s in stretches])][of],
        "goal": np.array(found.names)[of],
        "aim_x_px": aims[of, 0],
        "aim_y_px": aims[of, 1],
        "decision": decision,
    }


@dataclass(frozen=True)
class Shown:
    """Pictures (ticks,): whether it is a frame, its number, by how much a frame is turned."""

    frame: NDArray[np.bool_]
    number: NDArray[np.int64]
    rot: Floats


def drawn(shown: Shown, heading: Floats, cast: Cast) -> dict[str, NDArray[np.generic]]:
    """The columns kind, source, rotation_deg, scale of an edit list."""
    count = cast.order.orientations
    sector = orientation(heading, count)
    residual = wrap_deg(heading - direction_deg(sector, count))
    sprite, frame = (np.where(which, shown.number, 0) for which in (~shown.frame, shown.frame))
    oriented = sprite * count + sector - 1
    return {
        "kind": np.where(shown.frame, FRAME, SPRITE),
        "source": np.where(shown.frame, frame, oriented),
        "rotation_deg": np.where(shown.frame, wrap_deg(shown.rot), residual).astype(np.float32),
        "scale": np.where(
            shown.frame, cast.film.scale[frame], cast.sprites["scale"].to_numpy()[sprite]
        ),
    }


def cross_fades(
    shown: Shown, new: list[bool], first: NDArray[np.int64], cast: Cast, fade: int
) -> tuple[Shown, Floats]:
    """The pictures (ticks,) that fade out, and their shares, 0 where none does.

    Where something else begins, the old plays on for `fade` ticks and loses its share.
    """
    ticks = len(shown.number)
    partner = Shown(np.zeros(ticks, bool), np.zeros(ticks, np.int64), np.zeros(ticks))
    weight = np.zeros(ticks)
    for begins, is_new in zip(first, new, strict=False):
        if begins == 0 or not is_new:
            continue
        frame, old = bool(shown.frame[begins - 1]), int(shown.number[begins - 1])
        for tick in range(begins, min(begins + fade, ticks)):
            old = cast.after(FRAME if frame else SPRITE, old)
            partner.frame[tick], partner.number[tick] = frame, old
            partner.rot[tick] = shown.rot[begins - 1]
            weight[tick] = 1 - (tick - begins + 1) / (fade + 1)
    return partner, weight
