"""What a fish of the live tank is asked for, and what it decides."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.state import State
from finloop.edit.schema import FORETOLD, JUMP, PATH, PLAY, Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import Shoaling


class PathTask(NamedTuple):
    """A path to be swum. begun: whether the fish has come to its beginning."""

    route: Route
    begun: bool = False


class RuleTask(NamedTuple):
    """A rule to swim by. shoaling: in company, by these zones; leader: after the fish so named."""

    shoaling: Shoaling | None = None
    leader: str | None = None


class Request(NamedTuple):
    """What a fish is asked for at a tick.

    Mode, path, rule, ticks till its plan is cut (0: it is not).
    """

    mode: str
    errand: PathTask | None
    order: RuleTask | None
    cut_after: int


@dataclass(frozen=True)
class DecisionRecord:
    """A decision, and all that it was made from.

    tick: the first one that the stretch is swum at; state, draws: of the fish and of the random
    generator when it was made; goal: or path, or rule; None where the fish wandered.
    """

    tick: int
    mode: str
    state: State
    draws: Mapping[str, Any]
    goal: Goal | Route | Rule | None
    stretch: Stretch

    @property
    def follows_plan(self) -> bool:
        """Whether the fish swims on what an earlier decision planned."""
        moves = self.stretch.decision.reason in (PLAY, JUMP, FORETOLD)
        return bool(self.state.path.runs) and self.stretch.options is None and moves

    @property
    def name(self) -> str:
        """Of the goal, of any path, of a rule."""
        if isinstance(self.goal, Route):
            return PATH
        return self.goal.name if self.goal else ""
