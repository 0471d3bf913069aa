"""Sprites of the network mode: cycles to swim by, turns of any depth (Fig. 18)."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import ACCELERATE, DECELERATE, SLIDE, STRAIGHT
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.table import orientations_of
from finloop.modes.network_settings import NetworkSettings


@dataclass(frozen=True)
class TurnFrames:
    """The sprites (n,) of one turn, which bend more and more up to number `peak`.

    area: relative motion areas; degrees: change of heading to the next frame, towards the turn;
    hold_deg: the same while the strongest bends are held.
    """

    number: Ints
    area: Floats
    degrees: Floats
    peak: int
    hold_deg: float

    def back(self, depth: int) -> int:
        """Return the frame after the peak with which a turn of frames up to `depth` continues."""
        shallow = np.flatnonzero(self.area <= self.area[depth])
        after = shallow[shallow > self.peak]
        return int(after[0]) if after.size else len(self.number) - 1

    def undone(self, sprite: int) -> Ints:
        """Return the sprites that straighten a fish which `sprite` of the turn shows bent."""
        place = int(np.flatnonzero(self.number == sprite)[0])
        return self.number[place + 1 if place > self.peak else self.back(place) :]

    def steps(self, depth: int, held: int) -> tuple[Ints, Floats]:
        """Return the frames of a turn, and the filmed change of heading up to each.

        The change is that from the frame before; the first is entered from straight swimming.
        """
        back, degrees = self.back(depth), self.degrees
        frames = np.r_[0 : depth + 1, np.full(held, depth), back : len(self.number)]
        changes = np.r_[
            0.0, degrees[:depth], np.full(held, self.hold_deg), degrees[depth], degrees[back:-1]
        ]
        return self.number[frames], np.maximum(changes, 0.0)


@dataclass(frozen=True)
class Sprites:
    """All sequences of sprites, by row numbers of the table of sprites.

    cycles: frames of the cycle of each straight state; entry: by cycle and sprite, where to enter
    the cycle after it; following: the next sprite of each one's sequence, itself at the end of a
    turn; area: relative motion areas; cycle_speed: of the straight cycle in the film, body
    lengths/s; orientations: number that every sprite has.
    """

    cycles: dict[int, Ints]
    entry: dict[int, Ints]
    following: Ints
    area: Floats
    turns: dict[int, TurnFrames]
    cycle_speed: float
    orientations: int


@dataclass(frozen=True)
class TurnPlan:
    """A planned turn. frames (n,); share (n,): done after each tick, rising strictly to 1.

    area: of the strongest frame; film_deg: by how much the film turns over these frames; floor:
    the smallest share of the turn that a tick turns.
    """

    frames: Ints
    share: Floats
    area: float
    film_deg: float
    floor: float


def plan_turn(
    frames: TurnFrames, angle_deg: float, area: float, most: int, settings: NetworkSettings
) -> TurnPlan:
    """Return the turn by `angle_deg` > 0 whose strongest frame has the relative motion area `area`.

    The nearest area counts. The strongest bend is held for at most `most` ticks. Where the film's
    frames turn by far less or more than is wanted, a deeper or shallower bend is taken.
    """
    depth = max(1, int(np.abs(frames.area[: frames.peak + 1] - area).argmin()))
    depth = min(depth, frames.peak)
    while True:
        bare = frames.steps(depth, 0)[1].sum()
        held = min(max(round((angle_deg - bare) / max(frames.hold_deg, 1e-6)), 0), most)
        film = bare + held * frames.hold_deg
        if angle_deg > settings.turn_more * film and depth < frames.peak:
            depth += 1
        else:
            break
    while depth > 1 and angle_deg < settings.turn_less * frames.steps(depth, 0)[1].sum():
        depth, held = depth - 1, 0
    numbers, degrees = frames.steps(depth, held)
    film = float(degrees.sum())
    share = np.cumsum(degrees + settings.turn_floor * max(film, 1.0))
    area = float(frames.area[depth])
    return TurnPlan(numbers, share / share[-1], area, film, settings.turn_floor)


def start_from_bend(
    plan: TurnPlan, turns: dict[int, TurnFrames], side: int, sprite: int
) -> TurnPlan:
    """Return a turn to `side` that starts from the bend that a sprite of some turn shows already.

    A bend to the same side continues. A bend that is too deep is first undone; so is a bend to the
    other side, twice as fast as filmed.
    """
    bent = next((s for s, t in turns.items() if sprite in t.number), 0)
    if not bent:
        return plan
    step = np.diff(plan.share, prepend=0.0)
    here = np.flatnonzero(plan.frames == sprite)
    undone = turns[bent].undone(sprite)
    if bent != side:
        frames = np.concatenate([undone[::2], plan.frames])
        step = np.concatenate([np.full(len(frames) - len(step), plan.floor), step])
    elif here.size and here[0] + 1 < len(plan.frames):
        frames, step = plan.frames[here[0] + 1 :], step[here[0] + 1 :]
    elif undone.size:
        frames, step = undone, np.ones(len(undone))
    else:
        return plan
    share = np.cumsum(step)
    return replace(plan, frames=frames, share=share / share[-1])


def make_sprites(table: pd.DataFrame, pose: Floats, rate_hz: float) -> Sprites:
    """Split a table of sprites into cycles and turns, and find where each enters a cycle.

    pose (n, n): distance between what the film shows after sprite i, and sprite j of the same
    orientation.
    """
    parts = {
        name: table[table["sequence"] == name] for name in ("straight", "slide", "left", "right")
    }
    straight = parts["straight"].index.to_numpy()
    slide = parts["slide"].index.to_numpy()
    cycles = {STRAIGHT: straight, ACCELERATE: straight, DECELERATE: straight, SLIDE: slide}
    following = np.arange(len(table))
    for part in parts.values():
        following[part.index[:-1]] = part.index[1:]
    following[straight[-1]], following[slide[-1]] = straight[0], slide[0]
    entry = {state: pose[:, cycle].argmin(1) for state, cycle in cycles.items()}
    return Sprites(
        cycles,
        entry,
        following,
        table["motion_area_rel"].to_numpy(float),
        {LEFT: _turn_frames(parts["left"], LEFT), RIGHT: _turn_frames(parts["right"], RIGHT)},
        float(np.hypot(parts["straight"]["forward"], parts["straight"]["sideways"]).mean())
        * rate_hz,
        orientations_of(table),
    )


def _turn_frames(part: pd.DataFrame, side: int) -> TurnFrames:
    area = part["motion_area_rel"].to_numpy(float)
    degrees = side * part["turn_deg"].to_numpy(float)
    held = (part["phase"] != "out").to_numpy()
    peak = int(np.where(held, area, -1.0).argmax())
    hold_deg = float(np.maximum(degrees[held], 0.0).mean())
    return TurnFrames(part.index.to_numpy(), area, degrees, peak, hold_deg)
