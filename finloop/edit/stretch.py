"""Stretches: what a planner hands over to be drawn, and why.

A stretch is some ticks of swimming that one decision gives. `finloop.edit.build` turns stretches of
any planner into an edit list.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FRAME, SPRITE


class Decision(NamedTuple):
    """Why a stretch was chosen, as codes and numbers of `EDIT`; `in_words` turns them into text.

    reason: a code of `REASONS`; exit: of `EXITS`, "" where the fish does not leave the film.
    Numbers that a reason does not have are NaN, counts and quadrant 0. taken_terms: seconds that
    the chosen way costs, by `TERMS`; other_terms: the cheapest other way; () where there is none.
    """

    reason: str
    exit: str = ""
    seam: float = np.nan
    value_s: float = np.nan
    quadrant: int = 0
    ways: int = 0
    ways_tank: int = 0
    ways_quadrant: int = 0
    ways_heading: int = 0
    turn_deg: float = np.nan
    sprite_area: float = np.nan
    room: float = np.nan
    film_speed: float = np.nan
    taken_terms: tuple[float, ...] = ()
    other_terms: tuple[float, ...] = ()


@dataclass(frozen=True)
class Stretch:
    """Some ticks (n,) in one state. way (n, 3): x, y px, heading deg; number (n,): of the pictures.

    state: index in `STATES`; kind: SPRITE or FRAME; rot (n,): by how much frames are turned,
    degrees; phase (n,): place in the cycle, in frames, where sprites of one are played; new:
    whether the first picture does not follow the one before; aim: x, y px of the point that the
    fish heads for, first; area: motion area requested of the network, else NaN; touched: whether
    the last tick touches the goal; waits: whether the fish waits for a gateway; whole: whether the
    stretch is uncut; options: what was weighed; past (k + n, d): states of the forecast before and
    in the stretch, oldest first; steer (n, 2): corrections in degrees and px, on a path alone.
    """

    state: int
    way: Floats
    number: Ints
    new: bool
    aim: tuple[Any, ...]
    touched: bool
    decision: Decision
    kind: str = SPRITE
    rot: Floats | None = None
    phase: Floats | None = None
    area: float = np.nan
    waits: bool = False
    whole: bool = True
    options: Any = None
    past: Floats | None = None
    steer: Floats | None = None

    @property
    def pictures(self) -> Ints:
        """Return the picture numbers (n,) as `Discs` counts: a frame's row, or −1 − a sprite."""
        return self.number if self.kind == FRAME else -1 - self.number

    @cached_property
    def path_and_pictures(self) -> Floats:
        """Return x, y px, heading in degrees and picture number of each tick, as (n, 4)."""
        return np.column_stack([self.way, self.pictures])

    def remaining_path(self, gone: int) -> Floats:
        """Return x, y px, heading and picture number (k, 4) after the first `gone` ticks.

        At least the last tick remains.
        """
        return self.path_and_pictures[min(gone, len(self.way) - 1) :]

    def cut(self, ticks: int) -> "Stretch":
        """Return the stretch with only its first `ticks` ≥ 1 ticks."""
        if ticks >= len(self.way):
            return self
        return replace(
            self,
            way=self.way[:ticks],
            number=self.number[:ticks],
            rot=None if self.rot is None else self.rot[:ticks],
            phase=None if self.phase is None else self.phase[:ticks],
            past=None if self.past is None else self.past[: len(self.past) - len(self.way) + ticks],
            steer=None if self.steer is None else self.steer[:ticks],
            touched=False,
            whole=False,
        )


@dataclass(frozen=True)
class Swim:
    """An animation of one fish: its stretches, one after the other, and the goals it reaches.

    names: of the goal that each stretch heads for; reached (goals,): the tick at which each goal
    was touched, or −1.
    """

    stretches: list[Stretch]
    names: list[str]
    reached: Ints
