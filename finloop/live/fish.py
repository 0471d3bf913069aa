"""One fish of the live tank: planned by the modes of `animate`, cut where a wish comes, remembered.

A stretch is drawn as its edit list says. A new goal cuts the stretch under way at the tick on
screen. What was drawn, and what was weighed for it, is kept for `HISTORY` ticks; the memory for
what was drawn is taken once.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from finloop.animate.edit_list import HYBRID, LOOPS, NETWORK, Goal
from finloop.animate.hybrid import HybridMode
from finloop.animate.loops import LoopMode
from finloop.animate.network import Stretch
from finloop.animate.swim import Player, Swim, Swimmer, edit_columns
from finloop.live.cut import cut, snapshot

Floats = NDArray[np.float64]

HISTORY = 6000
"""Ticks that one can go back."""
_DRAG_S = 0.08  # while a goal is moved, a stretch is swum at least so long


class Row(NamedTuple):
    """What is kept of a tick: of an edit list's row what is drawn and shown, and where the goal is.

    goal_x_px, goal_y_px: NaN where there is no goal; decided: the tick of the decision in force.
    """

    kind: str
    source: int
    rotation_deg: float
    scale: float
    x_px: float
    y_px: float
    partner_kind: str
    partner: int
    partner_rotation_deg: float
    partner_scale: float
    weight: float
    heading_deg: float
    speed: float
    mode: str
    state: str
    goal: str
    goal_x_px: float = math.nan
    goal_y_px: float = math.nan
    reached: bool = False
    decided: int = 0


_TYPES = {str: "U10", int: "i8", float: "f8", bool: "?"}
ROW = np.dtype([(name, _TYPES[kind]) for name, kind in get_type_hints(Row).items()])
"""Rows in an array."""
_EDIT = [name for name in Row._fields if name not in Row._field_defaults]

Ghost = Callable[[Row], bool]
"""Whether the two pictures of a cross-fade, as they are in a row, are too unlike to be mixed."""


@dataclass(frozen=True)
class Weighed:
    """A row of the film that could have been shown: see `CONSIDERED`. All costs in seconds.

    seam_s, speed_s, again_s: what showing it costs at once, for the seam, the change of speed, and
    what was on screen just now; value_s: all that the best way from there costs; rot: its turn.
    """

    row: int
    rot: float
    seam: float
    seam_s: float
    speed_s: float
    again_s: float
    value_s: float
    fails: str
    taken: bool


@dataclass(frozen=True)
class Decision:
    """Why a stretch is swum. x_px, y_px: where the fish was; aim: the point it headed for."""

    tick: int
    why: str
    x_px: float
    y_px: float
    aim: tuple[float, float]
    weighed: tuple[Weighed, ...]


class LiveFish:
    """One fish. `born`: the tick of the tank that is its first."""

    def __init__(
        self, players: Mapping[str, Player], mode: str, born: int, rng: np.random.Generator,
        ghost: Ghost,
    ) -> None:  # fmt: skip
        self.mode, self.born = mode, born
        self.goal: Goal | None = None
        self.reached = False
        self._players, self._player, self._ghost = players, players[mode], ghost
        self._swimmer = Swimmer(self._player.mode, [], rng)
        fish = self._swimmer.fish
        if fish.shown.size == 0:  # begun by sprites, but it may come into the film
            fish.shown = np.full(len(self._player.cast.film.more), -(10**9))
        self._before = snapshot(fish), 0, 0
        self._drag = max(1, int(_DRAG_S * self._player.mode.motion.rate_hz))
        self._ring = np.zeros(HISTORY, ROW)
        self._decisions: deque[Decision] = deque()
        self._recent: list[tuple[Stretch, str]] = []  # those that may still fade out, and the last
        self._plan = np.zeros(0, ROW)  # the last stretch, of which so much has been played:
        self._played = 0
        self._cut_after = 0  # ticks of it, 0 = not at all
        self._was_ghost = False

    @property
    def now(self) -> int:
        """The last tick played."""
        return self.born + self._swimmer.fish.tick - len(self._plan) + self._played - 1

    def at(self, tick: int) -> Row | None:
        """What was drawn at a tick; None where it is not known."""
        if not self._oldest <= tick <= self.now:
            return None
        return Row._make(self._ring[tick % HISTORY].item())

    def places(self, ticks: range) -> Floats:
        """Where it was, (n, 2) px, at those of the ticks that are known, all up to now."""
        known = np.arange(ticks.start, ticks.stop, ticks.step)
        known = known[known >= self._oldest] % HISTORY
        return np.column_stack([self._ring["x_px"][known], self._ring["y_px"][known]])

    @property
    def _oldest(self) -> int:
        return max(self.born, self.now - HISTORY + 1)

    def decision(self, tick: int) -> Decision | None:
        """The decision in force at a tick."""
        row = self.at(tick)
        if row is None:
            return None
        return next((d for d in reversed(self._decisions) if d.tick == row.decided), None)

    def send(self, goal: Goal | None, drag: bool = False) -> None:
        """To a goal from the next tick on, or to none; one that is being moved waits a moment."""
        self.goal, self.reached = goal, False
        self._cut_after = self._drag if drag and self._cut_after != 1 else 1

    def switch(self, mode: str) -> None:
        """On in another mode, from the next tick on."""
        if mode != self.mode:
            self.mode, self._player, self._cut_after = mode, self._players[mode], 1

    def on(self) -> None:
        """One tick."""
        if self._cut_after and self._played >= min(self._cut_after, len(self._plan)):
            self._cut()
        if self._played == len(self._plan):
            self._decide()
        self._played += 1
        row = Row._make(self._plan[self._played - 1].item())
        # What is gone does not come back: two unlike fish on one another look like ghosts.
        self._was_ghost = row.weight > 0 and (self._was_ghost or self._ghost(row))
        if self._played == len(self._plan) and self._recent[-1][0].touched and row.goal:
            self.reached = True
        goal = self.goal
        self._ring[self.now % HISTORY] = row._replace(
            weight=0.0 if self._was_ghost else row.weight,
            goal_x_px=goal.x_px if goal else math.nan,
            goal_y_px=goal.y_px if goal else math.nan,
            reached=self.reached,
            decided=self._decisions[-1].tick,
        )

    def _cut(self) -> None:
        """Forget what was planned beyond the tick on screen, and turn to what was asked for."""
        swimmer, self._cut_after = self._swimmer, 0
        if 0 < self._played < len(self._plan):
            before, number, left = self._before
            found, name = self._recent[-1]
            fish, kept = cut(before, swimmer.fish, found, self._played, self._player)
            vars(swimmer.fish).update(vars(fish))
            self._recent[-1], self._plan = (kept, name), self._plan[: self._played]
            swimmer.number, swimmer.left = number, left
        swimmer.mode = self._player.mode
        goals = [self.goal] if self.goal is not None and not self.reached else []
        if goals != swimmer.goals[swimmer.number :]:
            swimmer.goals, swimmer.number, swimmer.left = goals, 0, 0

    def _decide(self) -> None:
        """Plan the next stretch."""
        swimmer, fish = self._swimmer, self._swimmer.fish
        self._before = snapshot(fish), swimmer.number, swimmer.left
        hybrid, how = self._players[HYBRID].mode, None
        if isinstance(hybrid, HybridMode):  # from one mode to the other by the ways of the hybrid
            if self.mode == NETWORK and fish.row >= 0:
                how = hybrid.leave
            elif self.mode == LOOPS and fish.row < 0:
                how = hybrid.enter
        found, name = swimmer.swim_on(how)
        begins = self.born + fish.tick - len(found.way)
        self._decisions.append(self._explained(begins, found))
        while len(self._decisions) > 1 and self._decisions[1].tick <= begins - HISTORY:
            self._decisions.popleft()
        fade = self._player.fade
        while sum(len(s.way) for s, _ in self._recent[1:]) > fade:
            del self._recent[0]
        self._recent.append((found, name))
        stretches, names = zip(*self._recent, strict=True)
        ticks = sum(len(s.way) for s in stretches)
        swum = Swim(list(stretches), list(names), np.zeros(0, np.int64))
        columns = edit_columns(swum, ticks, self._player)
        self._plan, self._played = np.zeros(len(found.way), ROW), 0
        for column in _EDIT:
            self._plan[column] = columns[column][ticks - len(found.way) :]

    def _explained(self, tick: int, found: Stretch) -> Decision:
        before, weighed = self._before[0], []
        loops = self._players[LOOPS].mode if LOOPS in self._players else None
        for (row, seam, value, fails, taken), rot in zip(
            found.considered, found.considered_rot, strict=True
        ):
            terms = 0.0, 0.0, 0.0
            if isinstance(loops, LoopMode) and (before.row < 0 or row != before.row + 1):
                terms = loops.jump_terms(before, row, seam)
            weighed.append(Weighed(row, rot, seam, *terms, value, fails, taken))
        aim = float(found.target[0]), float(found.target[1])
        return Decision(tick, found.why, before.x, before.y, aim, tuple(weighed))
