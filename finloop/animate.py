"""Goals → edit list: the fish is sent from goal to goal, then wanders (Figs. 16, 18)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate_edit import EDIT, NETWORK, SPRITE, Goal
from finloop.animate_motion import SLIDE, STATES, TURN, learn
from finloop.animate_nn import Fish, NetworkMode, Stretch
from finloop.animate_sprites import arrange
from finloop.animate_tank import Tank, goal_name, tank
from finloop.bpn import MotionModel
from finloop.features import ORIENTATIONS, delta_frames, orientation, wrap_deg

FADE_S = 0.1
_TRIES = 8  # a place to wander to is drawn so often before any place will do


@dataclass(frozen=True)
class Player:
    """Whoever swims: a mode, and the sprites (n rows) it draws with.

    hulls: the outline of every sprite, (k, 2) px ahead of and to the left of the mass centre, at
    the drawn size.
    """

    mode: NetworkMode
    sprites: pd.DataFrame
    hulls: Sequence[NDArray[np.float64]]

    def play(self, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> pd.DataFrame:
        """An edit list of `ticks` ticks: to the goals one after the other, afterwards anywhere."""
        return edit_list(swim(self.mode, goals, ticks, rng), ticks, self)


def player(
    features: pd.DataFrame,
    model: MotionModel,
    sprites: pd.DataFrame,
    pose: NDArray[np.float64],
    alike: NDArray[np.bool_],
    hulls: Sequence[NDArray[np.float64]],
    arena: NDArray[np.bool_],
    rate_hz: float,
    goal_radius: float,
) -> Player:
    """A fish that has learnt from a feature table.

    pose (n, n): distance between what the film shows after sprite i, and sprite j; alike (n, n):
    which two sprites are like one another; goal_radius in body lengths.

    Raises
    ------
    FinloopError
        If the film shows too little, or the tank (`arena`) is smaller than the fish.
    """
    motion = learn(features, rate_hz, delta_frames(model.delta_s, rate_hz))
    reach = max(float(np.hypot(*hull.T).max()) for hull in hulls)
    head = np.hypot(
        features["head_x_px"] - features["x_px"], features["head_y_px"] - features["y_px"]
    ).median()
    touch = goal_radius * motion.body_length_px
    drawn = arrange(sprites, pose, alike, rate_hz)
    mode = NetworkMode(motion, drawn, model, tank(arena, reach), touch, float(head))
    return Player(mode, sprites, hulls)


@dataclass(frozen=True)
class Swim:
    """An animation. `reached` (goals,): the tick at which each goal was touched, −1 where not."""

    stretches: list[Stretch]
    names: list[str]  # of the goal, for each stretch
    reached: NDArray[np.int64]


def swim(mode: NetworkMode, goals: Sequence[Goal], ticks: int, rng: np.random.Generator) -> Swim:
    """Swim at least `ticks` ticks: to the goals one after the other, afterwards anywhere."""
    fish = begin(mode, rng)
    reached = np.full(len(goals), -1)
    stretches: list[Stretch] = []
    names = []
    tick, number = 0, 0
    wander, left = np.zeros(2), 0
    while tick < ticks:
        if number < len(goals):
            name, at = goals[number].name, np.array(goals[number][1:3])
        else:
            if left <= 0:
                wander, left = somewhere(mode, fish, rng)
            name, at = "", wander
        found = mode.stretch(fish, at, name, rng)
        stretches.append(found)
        names.append(name)
        tick += len(found.way)
        left = 0 if found.touched else left - len(found.way) * (found.state != TURN)
        if found.touched and number < len(goals):
            reached[number] = tick - 1
            number, left = number + 1, 0
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


def begin(mode: NetworkMode, rng: np.random.Generator) -> Fish:
    """A fish somewhere in the tank, gliding."""
    x, y = mode.tank.random_point(rng)
    speed = float(np.median(mode.motion.phases.first_speed))
    sprite = int(mode.sprites.cycles[SLIDE][0])
    return Fish(x, y, float(rng.uniform(-180, 180)), speed, SLIDE, sprite)


def somewhere(
    mode: NetworkMode, fish: Fish, rng: np.random.Generator
) -> tuple[NDArray[np.float64], int]:
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
    stretches, motion = found.stretches, player.mode.motion
    lengths = np.array([len(s.way) for s in stretches])
    of = np.repeat(np.arange(len(stretches)), lengths)[:ticks]
    way = np.concatenate([s.way for s in stretches])[:ticks]
    number = np.concatenate([s.sprite for s in stretches])[:ticks]
    start = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    first = start[start < ticks]
    heading = wrap_deg(way[:, 2])
    step = np.hypot(*np.diff(way[:, :2], axis=0, prepend=way[:1, :2]).T)
    speed = step / motion.body_length_px * motion.rate_hz
    speed[:1] = speed[1:2]
    partner, weight = cross_fades(number, [s.new for s in stretches], first, player.mode)
    sector = orientation(heading)
    turned = wrap_deg(heading - (sector - 1) * (360 / ORIENTATIONS)).astype(np.float32)
    scale = player.sprites["scale"].to_numpy()
    faded = partner >= 0
    row = np.where(faded, partner, 0) * ORIENTATIONS + sector - 1
    aims = np.array([s.target for s in stretches])
    decision = np.full(ticks, None, dtype=object)
    decision[first] = [stretches[i].why for i in range(len(first))]
    table = pd.DataFrame(
        {
            "tick": np.arange(ticks),
            "time_s": np.arange(ticks) / motion.rate_hz,
            "kind": SPRITE,
            "source": number * ORIENTATIONS + sector - 1,
            "rotation_deg": turned,
            "scale": scale[number],
            "x_px": way[:, 0],
            "y_px": way[:, 1],
            "partner_kind": [SPRITE if one else None for one in faded],
            "partner": pd.array(row, "Int32"),
            "partner_rotation_deg": np.where(faded, turned, np.nan),
            "partner_scale": np.where(faded, scale[np.where(faded, partner, 0)], np.nan),
            "weight": weight,
            "heading_deg": heading,
            "speed": speed,
            "motion_area": np.array([s.area for s in stretches])[of],
            "mode": NETWORK,
            "state": np.array(STATES)[np.array([s.state for s in stretches])][of],
            "goal": np.array(found.names)[of],
            "aim_x_px": aims[of, 0],
            "aim_y_px": aims[of, 1],
            "decision": decision,
        }
    )
    table.loc[~faded, "partner"] = pd.NA
    return table[[column.name for column in EDIT.columns]]


def cross_fades(
    number: NDArray[np.int64],
    new: list[bool],
    first: NDArray[np.int64],
    mode: NetworkMode,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The sprite (ticks,) that fades out at each tick, −1 for none, and its share.

    Where a new sequence begins, the old one plays on for `FADE_S` and loses its share, as long as
    the two are alike: two unlike fish on one another look like ghosts.
    """
    fade = max(1, round(FADE_S * mode.motion.rate_hz))
    partner = np.full(len(number), -1)
    weight = np.zeros(len(number))
    for begins, is_new in zip(first, new, strict=False):
        if begins == 0 or not is_new:
            continue
        old = number[begins - 1]
        for k in range(min(fade, len(number) - begins)):
            old = mode.sprites.following[old]
            if not mode.sprites.alike[old, number[begins + k]]:
                break
            partner[begins + k], weight[begins + k] = old, 1 - (k + 1) / (fade + 1)
    return partner, weight
