"""Stretches: what a planner hands over to be drawn, and why.

A stretch is some ticks of swimming that one decision gives. `finloop.edit.build` turns stretches of
any planner into an edit list.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import (
    AS_PREDICTED,
    ENTER,
    FRAME,
    JUMP,
    NO_WAY,
    PHASE,
    PLAY,
    SPOT,
    SPRITE,
    TERMS,
    TURNING,
    WAITING,
    WALL,
)  # fmt: skip

_CHANCE = "chance"  # the random part of a cost is left out: it explains nothing
_LEAST_S = 0.05  # a term that costs less would be shown as 0.0


class Decision(NamedTuple):
    """Why a stretch of ticks was chosen, as codes and numbers of `EDIT`; see `describe_decision`.

    reason: a code of `REASONS`; exit: of `EXITS`, "" where the fish does not leave the film.
    Numbers that a reason does not have are NaN, counts and quadrant 0. taken_terms: seconds that
    the chosen candidate costs, by `TERMS`, or a turn on the spot and what follows it; other_terms:
    the cheapest other candidate; () where there is none.
    """

    reason: str
    exit: str = ""
    seam: float = np.nan
    value_s: float = np.nan
    quadrant: int = 0
    candidates: int = 0
    candidates_tank: int = 0
    candidates_quadrant: int = 0
    candidates_heading: int = 0
    turn_deg: float = np.nan
    sprite_area: float = np.nan
    room: float = np.nan
    film_speed: float = np.nan
    taken_terms: tuple[float, ...] = ()
    other_terms: tuple[float, ...] = ()


@dataclass(frozen=True)
class Stretch:
    """What one decision makes a fish do for n ticks: trajectory, pictures, and the reason.

    state: index in `STATES`; trajectory (n, 3): x, y px, heading in degrees; kind: SPRITE or FRAME;
    number (n,): the sprites or film rows shown; rotation_deg (n,): by how much frames are turned;
    phase (n,): place in the cycle, in frames, where a cycle of sprites is played;
    begins_with_transition: whether the first picture does not follow the one before; aim: the point
    that the fish heads for, which begins with its x, y px; area: motion area requested of the
    network, else NaN; touches_goal: whether the last tick does; whole: whether the stretch is
    uncut; options: the candidates that were compared, None where the stretch was planned before;
    past (k + n, d): states of the forecast before and in the stretch, oldest first; steer (n, 2):
    corrections in degrees and px, on a path alone.
    """

    state: int
    trajectory: Floats
    number: Ints
    begins_with_transition: bool
    aim: tuple[Any, ...]
    touches_goal: bool
    decision: Decision
    kind: str = SPRITE
    rotation_deg: Floats | None = None
    phase: Floats | None = None
    area: float = np.nan
    whole: bool = True
    options: Any = None
    past: Floats | None = None
    steer: Floats | None = None

    @property
    def pictures(self) -> Ints:
        """Return the picture shown at each tick (n,): a film row, or −1 − a sprite's number."""
        return self.number if self.kind == FRAME else -1 - self.number

    @cached_property
    def path_and_pictures(self) -> Floats:
        """Return x, y px, heading in degrees and picture number of each tick, (n, 4)."""
        ticks = np.empty((len(self.trajectory), 4))
        ticks[:, :3], ticks[:, 3] = self.trajectory, self.pictures
        return ticks

    def remaining_path(self, gone: int) -> Floats:
        """Return x, y px, heading and picture number (k, 4) of the ticks after the first `gone`.

        At least the last tick remains.
        """
        return self.path_and_pictures[min(gone, len(self.trajectory) - 1) :]

    def cut(self, ticks: int) -> "Stretch":
        """Cut the stretch after its first `ticks` ticks, at least 1; return it.

        A shortened stretch touches no goal, as only the last tick can; one that is not longer is
        returned as it is.
        """
        if ticks >= len(self.trajectory):
            return self
        removed = len(self.trajectory) - ticks
        # `past` has more ticks than the others, so all lose as many at the end.
        shortened = {
            name: values[: len(values) - removed]
            for name in ("trajectory", "number", "rotation_deg", "phase", "past", "steer")
            if (values := getattr(self, name)) is not None
        }
        return replace(self, **shortened, touches_goal=False, whole=False)


@dataclass(frozen=True)
class Swim:
    """The animation of one fish: its stretches one after the other, and the goals it reaches.

    names: of the goal of each stretch, "" for none; reached (goals,): the tick at which each goal
    was touched, or −1.
    """

    stretches: list[Stretch]
    names: list[str]
    reached: Ints


def describe_decision(decision: Decision, goal: str, motion_area: float) -> str:
    """Return a sentence that says why a stretch of ticks was chosen.

    goal: its name or ""; motion_area: the relative one that the network asked for.
    """
    why = _describe_reason(decision, goal or "a place", motion_area)
    if not decision.exit:
        return why
    gate = "without a gateway"
    if not math.isnan(decision.seam):
        gate = f"by a gateway, {decision.seam:.2f} steps"
    cause = "the mode shows sprites"
    if decision.exit == NO_WAY:
        cause = f"no legal candidate ({_describe_candidates(decision)})"
    return f"leave the film {gate}: {cause}; {why}"


def _describe_reason(decision: Decision, goal: str, motion_area: float) -> str:
    """Return in words what the fish does next and why, but not why it leaves the film.

    goal, motion_area: as in `describe_decision`.
    """
    if decision.reason == TURNING:
        side, room = "left" if decision.turn_deg > 0 else "right", ""
        if decision.room < 1:
            room = ", little room" if decision.room > 0 else ", on the spot"
        return (
            f"turn {side} {abs(decision.turn_deg):.0f}° towards {goal}: the network asks for "
            f"motion area {motion_area:.2f}, the sprites have {decision.sprite_area:.2f}{room}"
        )
    cause = f"no candidate stays in the tank ({_describe_candidates(decision)})"
    if decision.taken_terms:
        cause = f"turn first{_describe_costs(decision)}"
    texts = {
        PHASE: f"like a stretch of the film from {decision.film_speed:.1f} body lengths/s on",
        WALL: "a wall is ahead",
        SPOT: f"on the spot: {cause}",
        WAITING: "other fish are in the way: wait",
        AS_PREDICTED: f"as predicted{_describe_costs(decision)}",
    }
    if decision.reason in texts:
        return texts[decision.reason]
    actions = {
        PLAY: "play on",
        JUMP: f"jump, {decision.seam:.2f} steps",
        ENTER: f"enter the film by a gateway, {decision.seam:.2f} steps",
    }
    quadrant = decision.quadrant
    direction = f"quadrant {quadrant} towards {goal}" if quadrant else f"along a {goal}"
    return f"{actions[decision.reason]}: {direction}{_describe_costs(decision)}"


def _describe_costs(decision: Decision) -> str:
    """Return, as text after "; ", the number of candidates, and the costs of the best two, s."""
    if not decision.candidates:
        return "; as planned before"
    if math.isnan(decision.value_s):
        return f"; {_describe_candidates(decision)}"
    terms = dict(zip(TERMS, decision.taken_terms, strict=False))
    parts = [
        f"{name.replace('_', ' ')} {cost:.1f}".replace("-", "−")
        for name, cost in terms.items()
        if name != _CHANCE and abs(cost) >= _LEAST_S
    ]
    text = f"; {_describe_candidates(decision)}; {decision.value_s:.1f} s"
    if parts:
        text += f" ({', '.join(parts)})"
    if decision.other_terms:
        others = dict(zip(TERMS, decision.other_terms, strict=True))
        text += f", the next best {sum(others.values()) - others[_CHANCE]:.1f} s"
    return text


def _describe_candidates(decision: Decision) -> str:
    """Return in words how many candidates were compared, and how many fail each test of Fig. 19."""
    failed = {
        "leave the tank or end": decision.candidates_tank,
        "lead away": decision.candidates_quadrant,
        "head away": decision.candidates_heading,
    }
    failures = [f"{count} {failure}" for failure, count in failed.items() if count]
    return ", ".join(
        [f"{decision.candidates} candidate{'s' * (decision.candidates != 1)}", *failures]
    )
