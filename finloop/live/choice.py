"""What a fish of the live tank is sent for, and what it decides."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.state import State
from finloop.edit.schema import AS_PREDICTED, JUMP, PATH, PLAY, Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import Shoaling


class PathTask(NamedTuple):
    """A path to follow (route). begun: whether the fish has reached the path's beginning."""

    route: Route
    begun: bool = False


class RuleTask(NamedTuple):
    """A rule to follow: in a group, by zones (shoaling), or behind a fish (leader: its name)."""

    shoaling: Shoaling | None = None
    leader: str | None = None


class Request(NamedTuple):
    """What a fish is sent for at a tick.

    mode: its name; path_task, order: a path or a rule to follow, or None; cut_after: ticks after
    which the present stretch is cut, 0 for never.
    """

    mode: str
    path_task: PathTask | None
    order: RuleTask | None
    cut_after: int


@dataclass(frozen=True)
class DecisionRecord:
    """A decision, and all that it was made from.

    tick: the first one of the stretch; state, draws: of the fish and of the random generator before
    the decision; goal: a goal, path or rule, None where the fish wandered; stretch: the result.
    """

    tick: int
    mode: str
    state: State
    draws: Mapping[str, Any]
    goal: Goal | Route | Rule | None
    stretch: Stretch

    @property
    def follows_plan(self) -> bool:
        """Return whether the stretch carries on the plan of an earlier decision."""
        moves = self.stretch.decision.reason in (PLAY, JUMP, AS_PREDICTED)
        return bool(self.state.path.runs) and self.stretch.options is None and moves

    @property
    def name(self) -> str:
        """Return the name of the goal, path or rule; "" for a fish that wanders."""
        if isinstance(self.goal, Route):
            return PATH
        return self.goal.name if self.goal else ""
