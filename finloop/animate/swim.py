"""Goals → edit list: the fish is sent from goal to goal, then wanders (Figs. 16-18)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.arena import Tank, goal_name, in_sight
from finloop.animate.edit_list import (
    CONSIDERED,
    EDIT,
    FRAME,
    LOOPS,
    NETWORK,
    SPRITE,
    VERDICTS,
    Goal,
)
from finloop.animate.kinematics import Spot
from finloop.animate.motion import STATES, TURN
from finloop.animate.policies import Policy
from finloop.animate.state import Decision, Fish, State, Stretch, Waters, after
from finloop.base.arrays import Floats, Ints, Mask
from finloop.features.table import direction_deg, orientation, wrap_deg

_TRIES = 8  # a place to wander to is drawn so often before any place will do


@dataclass(frozen=True)
class Cast:
    """What is drawn: the table of sprites (n rows), and the outlines of all pictures.

    sprite_hulls: the outline of every sprite, (k, 2) px ahead of and to the left of the mass
    centre, at the drawn size; frame_hulls (rows, k, 2): of every frame.
    """

    sprites: pd.DataFrame
    sprite_hulls: Sequence[Floats]
    frame_hulls: NDArray[np.float32]


@dataclass(frozen=True)
class Player:
    """Whoever swims. policy: what may be shown next; fade: ticks of a cross-fade."""

    policy: Policy
    waters: Waters
    cast: Cast
    fade: int

    def begin(self, rng: np.random.Generator) -> State:
        """A fish somewhere in the tank."""
        return State(self.policy.begin(rng), np.zeros(2))

    def step(
        self, state: State, goal: Goal | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """The next stretch on the way to the goal, or anywhere, and the state after it.

        Nothing but `rng` is changed: the same state, goal and draws give the same stretch, and
        whoever keeps a state and the generator's state can swim on from there again.
        """
        waters, fish, place, left = self.waters, state.fish, state.place, 0
        if goal is not None:
            x, y = goal.x_px, goal.y_px
        else:
            if state.left > 0:
                left = state.left
            else:
                place, left = somewhere(waters, fish, rng)
            x, y = place
        spot = Spot(float(x), float(y), waters.touch_px, waters.head_px)
        stretch = self.policy.next(fish, spot, rng)
        wanders = goal is None and not stretch.touched
        left = left - len(stretch.way) * (stretch.state != TURN) if wanders else 0
        return stretch, State(after(fish, stretch, waters), place, left)

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """A stretch that began in a state, stopped after some ticks, and the state then."""
        short = stretch.cut(ticks)
        return short, state._replace(fish=after(state.fish, short, self.waters))

    def play(self, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> pd.DataFrame:
        """An edit list of `ticks` ticks: to the goals one after the other, afterwards anywhere."""
        return edit_list(swim(self, goals, ticks, rng), ticks, self)

    def hull(self, kind: str, source: int) -> Floats:
        """The outline of a frame or sprite."""
        if kind == FRAME:
            return self.cast.frame_hulls[source].astype(float)
        return self.cast.sprite_hulls[source]

    def following(self, kind: str, number: int) -> int:
        """The picture after this one, itself where there is none."""
        if kind == SPRITE:
            return int(self.waters.sprites.following[number])
        return number + int(self.waters.film.more[number])


@dataclass(frozen=True)
class Swim:
    """An animation. `reached` (goals,): the tick at which each goal was touched, −1 where not."""

    stretches: list[Stretch]
    names: list[str]  # of the goal, for each stretch
    reached: Ints

    def considered(self, ticks: int) -> pd.DataFrame:
        """What was weighed in the first `ticks` ticks, with the columns of `CONSIDERED`."""
        begins = np.cumsum([0] + [len(s.way) for s in self.stretches])
        rows = [
            (tick, row, seam, value, VERDICTS[verdict], i == o.taken)
            for tick, o in zip(begins, (s.options for s in self.stretches), strict=False)
            if tick < ticks and o is not None
            for i, (row, seam, value, verdict) in enumerate(
                zip(o.rows, o.seams, o.value, o.verdict, strict=True)
            )
        ]
        table = pd.DataFrame(rows, columns=CONSIDERED.names)
        return table.assign(value_s=table["value_s"].astype(float).replace(np.inf, np.nan))


def swim(player: Player, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> Swim:
    """Swim at least `ticks` ticks: to the goals one after the other, afterwards anywhere."""
    state = player.begin(rng)
    reached = np.full(len(goals), -1)
    stretches, names, number = [], [], 0
    while state.fish.tick < ticks:
        goal = goals[number] if number < len(goals) else None
        stretch, state = player.step(state, goal, rng)
        stretches.append(stretch)
        names.append(goal.name if goal else "")
        if goal and stretch.touched:
            reached[number] = state.fish.tick - 1
            number += 1
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


def somewhere(waters: Waters, fish: Fish, rng: np.random.Generator) -> tuple[Floats, int]:
    """A place (2,) px to wander to, as far aside as the film's turns go, and for how many ticks."""
    motion, tank = waters.motion, waters.tank
    for _ in range(_TRIES):
        angle = one_of(motion.turns.angle_deg, rng) * (-1.0, 1.0)[rng.integers(2)]
        ticks = int(one_of(motion.straight_ticks, rng))
        way = max(2.0, fish.speed * ticks / motion.rate_hz) * motion.body_length_px
        direction = np.radians(fish.heading + angle)
        x, y = fish.x + way * np.cos(direction), fish.y - way * np.sin(direction)
        if in_sight(tank.legal, fish.x, fish.y, x, y):
            return np.array([x, y]), ticks
    return np.array(tank.random_point(rng)), int(one_of(motion.straight_ticks, rng))


def one_of(values: NDArray[Any], rng: np.random.Generator) -> Any:
    """One of some values, as `rng.choice`, which takes five times as long."""
    return values[rng.integers(len(values))]


def edit_list(swum: Swim, ticks: int, player: Player) -> pd.DataFrame:
    """The first `ticks` ticks as an edit list with the columns of `EDIT`."""
    table = pd.DataFrame(edit_columns(swum.stretches, swum.names, ticks, player))
    faded = table["weight"] > 0
    table = table.astype({"orientation": "Int8", "partner": "Int32", "partner_orientation": "Int8"})
    table.loc[~faded, ["partner_kind", "partner"]] = None
    table.loc[~faded, ["partner_rotation_deg", "partner_scale"]] = np.nan
    for side in ("", "partner_"):
        table.loc[table[f"{side}kind"] != SPRITE, f"{side}orientation"] = pd.NA
    table = table.assign(**decision_columns(swum.stretches, ticks))
    return table[EDIT.names]


def decision_columns(stretches: Sequence[Stretch], ticks: int) -> dict[str, Any]:
    """The columns (ticks,) that say why, filled on the first tick of each stretch."""
    start = np.cumsum([0] + [len(s.way) for s in stretches])[:-1]
    first = start[start < ticks]
    decisions = [s.decision for s in stretches[: len(first)]]
    columns: dict[str, Any] = {}
    for name, values in zip(Decision._fields, zip(*decisions, strict=True), strict=True):
        if isinstance(values[0], str):
            text = np.full(ticks, None, dtype=object)
            text[first] = [value or None for value in values]
            columns[name] = text
        elif isinstance(values[0], int):
            whole, missing = np.zeros(ticks, np.int16), np.ones(ticks, bool)
            whole[first], missing[first] = values, False
            columns[name] = pd.arrays.IntegerArray(whole, missing)
        else:
            columns[name] = np.full(ticks, np.nan)
            columns[name][first] = values
    return columns


def edit_columns(
    stretches: Sequence[Stretch], names: Sequence[str], ticks: int, player: Player
) -> dict[str, NDArray[np.generic]]:
    """What is drawn, (ticks,) each; of the partner only where `weight` > 0."""
    motion = player.waters.motion
    lengths = np.array([len(s.way) for s in stretches])
    owner = np.repeat(np.arange(len(stretches)), lengths)[:ticks]
    way = np.concatenate([s.way for s in stretches])[:ticks]
    rots = [np.zeros(len(s.way)) if s.rot is None else s.rot for s in stretches]
    shown = Shown(
        np.array([s.kind == FRAME for s in stretches])[owner],
        np.concatenate([s.number for s in stretches])[:ticks],
        np.concatenate(rots)[:ticks],
    )
    start = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    first = start[start < ticks]
    heading = wrap_deg(way[:, 2])
    step = np.hypot(*np.diff(way[:, :2], axis=0, prepend=way[:1, :2]).T)
    speed = step / motion.body_length_px * motion.rate_hz
    speed[:1] = speed[1:2]
    partner, weight = cross_fades(shown, [s.new for s in stretches], first, player)
    aims = np.array([s.aim for s in stretches])
    other = {f"partner_{name}": column for name, column in drawn(partner, heading, player).items()}
    return {
        "tick": np.arange(ticks),
        "time_s": np.arange(ticks) / motion.rate_hz,
        **drawn(shown, heading, player),
        "x_px": way[:, 0],
        "y_px": way[:, 1],
        "partner": other.pop("partner_source"),
        **other,
        "weight": weight,
        "heading_deg": heading,
        "speed": speed,
        "motion_area": np.array([s.area for s in stretches])[owner],
        "mode": np.where(shown.frame, LOOPS, NETWORK),
        "state": np.array(STATES)[np.array([s.state for s in stretches])][owner],
        "goal": np.array(names)[owner],
        "aim_x_px": aims[owner, 0],
        "aim_y_px": aims[owner, 1],
    }


@dataclass(frozen=True)
class Shown:
    """Pictures (ticks,): whether it is a frame, its number, by how much a frame is turned."""

    frame: Mask
    number: Ints
    rot: Floats


def drawn(shown: Shown, heading: Floats, player: Player) -> dict[str, NDArray[np.generic]]:
    """The columns kind, source, orientation (a frame's is 0), rotation_deg, scale."""
    waters, count = player.waters, player.waters.sprites.orientations
    sector = orientation(heading, count)
    residual = wrap_deg(heading - direction_deg(sector, count))
    sprite, frame = (np.where(which, shown.number, 0) for which in (~shown.frame, shown.frame))
    return {
        "kind": np.where(shown.frame, FRAME, SPRITE),
        "source": shown.number,
        "orientation": np.where(shown.frame, 0, sector),
        "rotation_deg": np.where(shown.frame, wrap_deg(shown.rot), residual).astype(np.float32),
        "scale": np.where(
            shown.frame, waters.film.scale[frame], player.cast.sprites["scale"].to_numpy()[sprite]
        ),
    }


def cross_fades(shown: Shown, new: list[bool], first: Ints, player: Player) -> tuple[Shown, Floats]:
    """The pictures (ticks,) that fade out, and their shares, 0 where none does.

    Where something else begins, the old plays on for `player.fade` ticks and loses its share.
    """
    ticks = len(shown.number)
    partner = Shown(np.zeros(ticks, bool), np.zeros(ticks, np.int64), np.zeros(ticks))
    weight = np.zeros(ticks)
    for begins, is_new in zip(first, new, strict=False):
        if begins == 0 or not is_new:
            continue
        frame, old = bool(shown.frame[begins - 1]), int(shown.number[begins - 1])
        for tick in range(begins, min(begins + player.fade, ticks)):
            old = player.following(FRAME if frame else SPRITE, old)
            partner.frame[tick], partner.number[tick] = frame, old
            partner.rot[tick] = shown.rot[begins - 1]
            weight[tick] = 1 - (tick - begins + 1) / (player.fade + 1)
    return partner, weight
