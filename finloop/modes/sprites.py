"""Sprites of the network mode: cycles of straight swimming, turns of any depth (Fig. 18).

The depth of a turn is the place of its most bent sprite.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import ACCELERATE, DECELERATE, SLIDE, STRAIGHT
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.table import count_orientations
from finloop.modes.network_settings import NetworkSettings


@dataclass(frozen=True)
class TurnFrames:
    """The sprites (n,) of one turn, in order; they bend more and more up to place `peak`.

    number: of each sprite; area: relative motion area; degrees: change of heading to the next
    sprite, + = towards the turn; hold_deg: mean change of heading a tick while a bend is held.
    """

    number: Ints
    area: Floats
    degrees: Floats
    peak: int
    hold_deg: float

    def place_after_peak(self, deepest: int) -> int:
        """Return the first place after the peak whose sprite bends no more than that at `deepest`.

        deepest: the most bent place that is shown, at the peak or before it; the places between
        the two are skipped. The result is the last place if all after the peak bend more.
        """
        shallow = np.flatnonzero(self.area <= self.area[deepest])
        after = shallow[shallow > self.peak]
        return int(after[0]) if after.size else len(self.number) - 1

    def straightening_sprites(self, sprite: int) -> Ints:
        """Return the numbers (k,) of the sprites that undo the bend that `sprite` shows."""
        place = int(np.flatnonzero(self.number == sprite)[0])
        first = place + 1 if place > self.peak else self.place_after_peak(place)
        return self.number[first:]

    def film_turn_deg(self, deepest: int) -> float:
        """Return by how many degrees the filmed fish turns over a turn's sprites, none held.

        deepest: place of the sprite that bends most.
        """
        return float(self.bend_and_straighten(deepest, held_ticks=0)[1].sum())

    def bend_and_straighten(self, deepest: int, held_ticks: int) -> tuple[Ints, Floats]:
        """Return the sprites of a turn up to a bend and back, (k,), and the turn (k,) before each.

        deepest: place of the sprite that bends most; held_ticks: ticks for which it is held. A
        turn, degrees ≥ 0 as filmed, is from the sprite before; the first is 0, as straight swimming
        comes before it.
        """
        back, degrees = self.place_after_peak(deepest), self.degrees
        frames = np.r_[0 : deepest + 1, np.full(held_ticks, deepest), back : len(self.number)]
        held = np.full(held_ticks, self.hold_deg)
        changes = np.r_[0.0, degrees[:deepest], held, degrees[deepest], degrees[back:-1]]
        return self.number[frames], np.maximum(changes, 0.0)


@dataclass(frozen=True)
class Sprites:
    """All sequences of sprites, by row numbers of the table of sprites (n rows).

    cycles: by straight state, the sprites of its cycle; entry: by straight state, for each sprite
    (n,) the place of the cycle at which to go on after it; following (n,): the next sprite of each
    one's sequence, itself at the end of a turn; area (n,): relative motion areas; turns: by side,
    LEFT or RIGHT; cycle_speed: of the straight cycle as filmed, body lengths/s; orientations:
    number of orientations in which every sprite is drawn.
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
    """A planned turn of n ticks.

    frames (n,): numbers of the sprites; share (n,): part of the turn that is done after each tick,
    rising strictly to 1; area: relative motion area of the most bent sprite; film_deg: degrees by
    which the film turns over these sprites; floor: the smallest share of the turn that a tick
    turns.
    """

    frames: Ints
    share: Floats
    area: float
    film_deg: float
    floor: float


def plan_turn(
    frames: TurnFrames, angle_deg: float, area: float, most_held_ticks: int,
    settings: NetworkSettings,
) -> TurnPlan:  # fmt: skip
    """Return a turn by `angle_deg` > 0 that bends about to the relative motion area `area`.

    frames: sprites of the turn's side; shown are those up to the strongest bend of the planned
    turn, which is held for at most `most_held_ticks`, and those that straighten from it. Where the
    film turns by far less or more than `angle_deg` over these sprites, the bend is deeper or
    shallower.
    """
    # depth: place of the strongest bend in the sequence of sprites.
    depth = max(1, int(np.abs(frames.area[: frames.peak + 1] - area).argmin()))
    depth = min(depth, frames.peak)
    # Deeper, while even with the bend held the film turns by far less than the angle.
    while True:
        unheld_deg = frames.film_turn_deg(depth)
        missing_ticks = round((angle_deg - unheld_deg) / max(frames.hold_deg, 1e-6))
        held_ticks = min(max(missing_ticks, 0), most_held_ticks)
        held_deg = unheld_deg + held_ticks * frames.hold_deg
        if angle_deg <= settings.turn_more * held_deg or depth >= frames.peak:
            break
        depth += 1
    # Shallower, while even without holding the film turns by far more.
    while depth > 1 and angle_deg < settings.turn_less * frames.film_turn_deg(depth):
        depth, held_ticks = depth - 1, 0
    numbers, degrees = frames.bend_and_straighten(depth, held_ticks)
    film_deg = float(degrees.sum())
    # In every tick the turn goes on a little, even where the film does not turn.
    progress = np.cumsum(degrees + settings.turn_floor * max(film_deg, 1.0))
    return TurnPlan(
        numbers, share=progress / progress[-1], area=float(frames.area[depth]),
        film_deg=film_deg, floor=settings.turn_floor,
    )  # fmt: skip


def start_from_bend(
    plan: TurnPlan, turns_by_side: dict[int, TurnFrames], side: int, sprite: int
) -> TurnPlan:
    """Return a planned turn, changed to start from the bend that the sprite on screen shows.

    side: of the planned turn; sprite: number of the one on screen; a sprite that is in no turn
    changes nothing. A bend to the same side continues. A bend that is too deep is first undone; so
    is a bend to the other side, twice as fast as filmed.
    """
    bent_to = next((s for s, turn in turns_by_side.items() if sprite in turn.number), None)
    if bent_to is None:
        return plan
    undoing = turns_by_side[bent_to].straightening_sprites(sprite)
    turned = np.diff(plan.share, prepend=0.0)  # part of the turn in each tick
    rest = np.flatnonzero(plan.frames == sprite)[:1] + 1  # where the plan goes on after the sprite
    if bent_to != side:
        fast_undoing = undoing[::2]  # every second sprite
        frames = np.concatenate([fast_undoing, plan.frames])
        turned = np.concatenate([np.full(len(fast_undoing), plan.floor), turned])
    elif rest.size and rest[0] < len(plan.frames):
        frames, turned = plan.frames[rest[0] :], turned[rest[0] :]
    elif undoing.size:  # deeper than the planned turn ever bends: the turn is made meanwhile
        frames, turned = undoing, np.ones(len(undoing))
    else:
        return plan
    share = np.cumsum(turned)
    return replace(plan, frames=frames, share=share / share[-1])


def make_sprites(table: pd.DataFrame, pose_distances: Floats, rate_hz: float) -> Sprites:
    """Return the sprites of a table, split into cycles and turns, with the places to enter a cycle.

    pose_distances (n, n): Euclidean distances between the film's frame after sprite i, and sprite
    j, both turned to head right; rate_hz: frames per second.
    """
    sequences = dict(iter(table.groupby("sequence")))
    straight, slide = (sequences[name].index.to_numpy() for name in ("straight", "slide"))
    cycles = {STRAIGHT: straight, ACCELERATE: straight, DECELERATE: straight, SLIDE: slide}
    following = np.arange(len(table))
    for sequence in sequences.values():
        following[sequence.index[:-1]] = sequence.index[1:]
    following[straight[-1]], following[slide[-1]] = straight[0], slide[0]
    entry = {state: pose_distances[:, cycle].argmin(1) for state, cycle in cycles.items()}
    steps = np.hypot(sequences["straight"]["forward"], sequences["straight"]["sideways"])
    turns = {
        side: _turn_frames(sequences[name], side)
        for side, name in ((LEFT, "left"), (RIGHT, "right"))
    }
    return Sprites(
        cycles, entry, following, area=table["motion_area_rel"].to_numpy(float), turns=turns,
        cycle_speed=float(steps.mean()) * rate_hz, orientations=count_orientations(table),
    )  # fmt: skip


def _turn_frames(turn_rows: pd.DataFrame, side: int) -> TurnFrames:
    """Return the sprites of one turn to a side, LEFT or RIGHT, from rows of the sprite table."""
    area = turn_rows["motion_area_rel"].to_numpy(float)
    degrees = side * turn_rows["turn_deg"].to_numpy(float)
    before_out = (turn_rows["phase"] != "out").to_numpy()  # into the bend, or at its deepest
    peak = int(np.where(before_out, area, -1.0).argmax())
    hold_deg = float(np.maximum(degrees[before_out], 0.0).mean())
    return TurnFrames(turn_rows.index.to_numpy(), area, degrees, peak, hold_deg)
