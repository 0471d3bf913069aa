"""One fish of the live tank: planned by the players of `animate`, with a past to go back to.

A stretch is drawn as in its edit list. A new goal cuts the present stretch at the tick on screen.
What was drawn, and every decision with the state it was made in, is kept for `HISTORY` ticks; a
player is pure, so the fish can swim on from any of them.

The fish is first sent to the beginning of a path, as to a goal. A rule is evaluated at each
decision, with the other fish where they are then.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from copy import copy, deepcopy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from finloop.animate.obstacles import Obstacles, Plans
from finloop.animate.protocols import AnyPlayer
from finloop.animate.route import Route, point_along
from finloop.animate.rule import Rule
from finloop.animate.state import State
from finloop.base.arrays import Floats
from finloop.edit.build import EditInputs, edit_columns
from finloop.edit.schema import AS_PREDICTED, JUMP, PATH, PLAY, Goal
from finloop.edit.stretch import Stretch
from finloop.social.rule import SchoolRule

HISTORY = 6000
"""How many ticks back the tank can go."""
_DRAG_S = 0.08  # the shortest stretch while a goal is dragged


class Modes(NamedTuple):
    """The modes in which live fish can move, each with its player and inputs for edit lists.

    players: plan a fish's motion, by the mode's name.
    """

    players: Mapping[str, AnyPlayer]
    edit_inputs: Mapping[str, EditInputs]

    @classmethod
    def from_players(cls, players: Mapping[str, AnyPlayer]) -> "Modes":
        """Return the modes of some players, so that each can draw the sprites of all modes.

        A fish that changes its mode may still show a sprite of the mode before.
        """
        # The mode with the most sprites has those of the others.
        richest = max(
            (player.edit_inputs for player in players.values()),
            key=lambda inputs: len(inputs.sprite_scale),
        )
        return cls(players, {
            mode: replace(
                player.edit_inputs, sprite_scale=richest.sprite_scale,
                sprite_after=richest.sprite_after,
                orientations=richest.orientations,
                join_rules=replace(player.edit_inputs.join_rules, bodies=richest.join_rules.bodies),
            )
            for mode, player in players.items()
        })  # fmt: skip


class PathTask(NamedTuple):
    """The task to follow a path; first the fish swims to its beginning.

    route: the path. begun: whether the fish has reached the beginning.
    """

    route: Route
    begun: bool = False


class RuleTask(NamedTuple):
    """The task to swim by a rule: in a group, by zones, or behind a leader.

    school_rule: the zones of the group. leader: the name of the fish in front.
    """

    school_rule: SchoolRule | None = None
    leader: str | None = None


class Request(NamedTuple):
    """What the user asked of a fish: a mode, and perhaps a path or a rule to follow.

    cut_after: ticks after which the present stretch (motion from one decision) ends, 0 for never.
    """

    mode: str
    path_task: PathTask | None
    rule_task: RuleTask | None
    cut_after: int


@dataclass(frozen=True)
class DecisionRecord:
    """A decision of a fish, with all the data from which it was made.

    tick: the first one of the motion that was decided on, `stretch`; state, rng_state: of the fish
    and of the random generator before the decision; goal: a goal, path or rule, None where the fish
    wandered.
    """

    tick: int
    mode: str
    state: State
    rng_state: Mapping[str, Any]
    goal: Goal | Route | Rule | None
    stretch: Stretch

    @property
    def follows_plan(self) -> bool:
        """Return whether the motion continues the plan of an earlier decision.

        Then a part of that plan was left, no candidates were compared, and the fish swam on as
        planned.
        """
        had_plan, compared_none = bool(self.state.progress.runs), self.stretch.options is None
        swam_on = self.stretch.decision.reason in (PLAY, JUMP, AS_PREDICTED)
        return had_plan and compared_none and swam_on

    @property
    def target(self) -> Goal | int | str | None:
        """Return what tells the goal, path or kind of rule from others; None if it wanders."""
        if isinstance(self.goal, Route):
            return id(self.goal)
        return self.goal if isinstance(self.goal, Goal) else self.target_name or None

    @property
    def target_name(self) -> str:
        """Return the name of the goal, path or rule; "" for a fish that wanders."""
        if isinstance(self.goal, Route):
            return PATH
        return self.goal.name if self.goal else ""


class TankRow(NamedTuple):
    """How a fish of the live tank was drawn at one past tick, and its goal then.

    orientation: 0 for a frame; goal_x_px, goal_y_px: NaN where there is no goal; reached: whether
    the fish has reached its goal; decided: first tick of the decision's motion; pose: code of the
    drawn pose, None for the picture's own.
    """

    kind: str
    source: int
    orientation: int
    rotation_deg: float
    scale: float
    mirrored: bool
    x_px: float
    y_px: float
    partner_kind: str
    partner: int
    partner_orientation: int
    partner_rotation_deg: float
    partner_scale: float
    partner_mirrored: bool
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
    pose: Floats | None = None


_TYPES = {str: "U10", int: "i8", float: "f8", bool: "?"}
ROW = np.dtype([
    (name, _TYPES[kind]) for name, kind in get_type_hints(TankRow).items() if name != "pose"
])  # fmt: skip
"""Rows in an array, without their poses."""
_EDIT_COLUMNS = [name for name in TankRow._fields if name not in TankRow._field_defaults]

TooUnlike = Callable[[TankRow], bool]
"""Returns whether the two pictures of a cross-fade, as in a row, are too unlike to be mixed."""
OtherPaths = Callable[["LiveFish", int], dict[str, Floats]]
"""Returns the planned paths of the other fish of the tank, by name, from a tick on."""


class LiveFish:
    """One fish of the live tank; it remembers its past and can go back to an earlier tick.

    born: the tank's tick that is its first. name: of its goals.
    """

    def __init__(
        self, modes: Modes, mode: str, born: int, name: str,
        rng: np.random.Generator, too_unlike: TooUnlike, other_paths: OtherPaths,
    ) -> None:  # fmt: skip
        """Put a fish into the tank, where there is room; FinloopError without room."""
        self.mode, self.born, self.name = mode, born, name
        self.goal: Goal | None = None
        self.path_task: PathTask | None = None
        self.rule_task: RuleTask | None = None
        self.reached = False
        self._modes, self._rng = modes, rng
        self._too_unlike, self._find_other_paths = too_unlike, other_paths
        self._state = self._player.begin(
            rng, obstacles=self._player.others_to_avoid(self._other_paths(0), 0)
        )
        self._drag_ticks = max(1, int(_DRAG_S * self._player.world.motion.rate_hz))
        # The last `HISTORY` ticks, each at its number modulo `HISTORY`.
        self._rows = np.zeros(HISTORY, ROW)
        self._poses = np.full(HISTORY, None, object)
        self._requests = np.full(HISTORY, None, object)
        self._decisions: deque[DecisionRecord] = deque()
        # The last planned stretch, how many ticks of it were played, and when it is cut (0: never).
        self._planned_rows = np.zeros(0, ROW)
        self._planned_poses = np.zeros(0, object)
        self._played = self._cut_after = 0
        # Whether a picture of a cross-fade was hidden at the last tick, and at the one before.
        self._was_hidden = self._hidden_before = False

    @property
    def _player(self) -> AnyPlayer:
        """Return the player of the present mode; it plans the motion."""
        return self._modes.players[self.mode]

    @property
    def last_tick(self) -> int:
        """Return the last tick, as the tank counts, at which this fish was drawn."""
        # The fish's state is that after its last planned stretch, of which a part was played.
        return self.born + self._state.fish.tick - len(self._planned_rows) + self._played - 1

    def row_at(self, tick: int) -> TankRow | None:
        """Return how the fish was drawn at a tick of the tank; None if that is not remembered."""
        if not self._oldest_tick <= tick <= self.last_tick:
            return None
        return TankRow._make((*self._rows[tick % HISTORY].item(), self._poses[tick % HISTORY]))

    def planned_path_from(self, tick: int) -> Floats:
        """Return the planned path (n, 4) of the fish from a tick of the tank on, n ≥ 1.

        Its columns are x, y [px], heading [degrees] and number of the picture.
        """
        stretch = self._decisions[-1].stretch
        first_tick = self.born + self._state.fish.tick - len(stretch.trajectory)  # of the stretch
        return stretch.remaining_path(max(0, tick - first_tick))

    def _other_paths(self, tick: int) -> Floats:
        """Return the planned paths (n, m, 4) of the m other fish from a tick of this fish on.

        The columns are x, y [px], heading [degrees] and number of the picture.
        """
        paths = list(self._find_other_paths(self, self.born + tick).values())
        return Plans.from_paths(paths, tick).places_of_others(
            -1, tick
        )  # −1: this fish is none of them

    def request_at(self, tick: int) -> Request:
        """Return the request that held at a tick of the tank, one of the last `HISTORY` ticks."""
        request: Request = self._requests[tick % HISTORY]
        return request

    def past_places(self, ticks: range) -> Floats:
        """Return where the fish was (n, 2) [px] at those ticks of a range that it remembers."""
        wanted = np.arange(ticks.start, ticks.stop, ticks.step)
        slots = wanted[wanted >= self._oldest_tick] % HISTORY
        return np.column_stack([self._rows["x_px"][slots], self._rows["y_px"][slots]])

    @property
    def _oldest_tick(self) -> int:
        """Return the first tick of the tank that this fish remembers."""
        return max(self.born, self.last_tick - HISTORY + 1)

    def decision_at(self, tick: int) -> DecisionRecord | None:
        """Return the decision that moved the fish at a tick of the tank; None if not remembered."""
        row = self.row_at(tick)
        if row is None:
            return None
        latest_first = reversed(self._decisions)
        return next((past for past in latest_first if past.tick == row.decided), None)

    def events(self) -> list[tuple[int, str]]:
        """Return what happened in the remembered past: ticks of the tank, each with a word.

        The words: `jump`, where a decision left the film's order; `goal`, where the fish got a new
        goal, path or rule; and the name of a mode that began.
        """
        events: list[tuple[int, str]] = []
        target, mode = None, ""
        for decision in self._decisions:
            if decision.mode != mode:
                events.append((decision.tick, decision.mode))
            if decision.target not in (None, target):
                events.append((decision.tick, "goal"))
            if decision.stretch.decision.reason == JUMP:
                events.append((decision.tick, "jump"))
            target, mode = decision.target, decision.mode
        return events

    def planning_decision(self, decision: DecisionRecord) -> DecisionRecord:
        """Return the decision that made the plan which a given decision follows.

        It is the given decision itself if that made its own plan.
        """
        for earlier in reversed(self._decisions):
            if earlier.tick <= decision.tick and not earlier.follows_plan:
                return earlier
        return decision

    def send_to_goal(self, goal_px: tuple[float, float] | None, drag: bool = False) -> None:
        """Send the fish to a goal (x, y [px]) from the next tick on; None lets it wander.

        drag: whether the goal is being dragged; then the planned motion may go on for a moment.
        """
        self.goal = self._make_goal(*goal_px) if goal_px else None
        self.path_task, self.rule_task, self.reached = None, None, False
        # After how many played ticks the planned motion ends (0: never); 1 ends it at once. A drag
        # does not put off an end that an earlier request has set to 1.
        self._cut_after = self._drag_ticks if drag and self._cut_after != 1 else 1

    def follow_path(self, route: Route) -> None:
        """Send the fish to the beginning of a path from the next tick on, and then along it."""
        x, y = point_along(route, 0.0)
        self.send_to_goal((float(x), float(y)))
        self.path_task = PathTask(route)

    def follow_rule(self, rule_task: RuleTask) -> None:
        """Let the fish swim by a rule from the next tick on; do nothing if it already does."""
        if rule_task != self.rule_task:
            self.send_to_goal(None)
            self.rule_task = rule_task

    def _make_goal(self, x: float, y: float) -> Goal:
        """Return the goal at x, y [px]."""
        return Goal(self.name, x, y, self._player.world.touch_px)

    def switch_mode(self, mode: str) -> None:
        """Change the fish's mode from the next tick on."""
        if mode != self.mode:
            self.mode, self._cut_after = mode, 1  # end the planned motion at once

    def redo_last_tick(self) -> None:
        """Decide the last tick again, because the user's request has changed since then.

        Earlier ticks stay. The old decision stays, too, if every new motion would meet other fish.
        """
        # Go back by one tick: `_was_hidden` is about the picture that is cross-faded in.
        self._was_hidden = self._hidden_before
        self._cut_after, self._played = 0, self._played - 1
        self._replan_stretch()
        self._record_tick()

    def advance(self) -> None:
        """Advance the fish by one tick; plan first if its motion has ended or a request ends it."""
        self._hidden_before = self._was_hidden
        if self._played == len(self._planned_rows):
            self._cut_after = 0
            self._plan_stretch(self._next_target())
        elif self._cut_after and self._played >= self._cut_after:
            self._cut_after = 0
            self._replan_stretch()
        self._record_tick()

    def _record_tick(self) -> None:
        """Go to the next tick of the plan; remember how it is drawn and what the user asked for.

        A cross-fade of pictures that are too unlike is drawn without its second picture.
        """
        row = TankRow._make(
            (*self._planned_rows[self._played].item(), self._planned_poses[self._played])
        )
        self._played += 1
        # Two unlike fish on top of each other look like ghosts. A hidden picture stays hidden until
        # its cross-fade ends.
        self._was_hidden = row.weight > 0 and (self._was_hidden or self._too_unlike(row))
        last = self._decisions[-1]
        if self._played == len(self._planned_rows):
            self._note_arrival(last)
        goal, slot = self.goal, self.last_tick % HISTORY
        self._poses[slot] = row.pose
        self._requests[slot] = Request(self.mode, self.path_task, self.rule_task, self._cut_after)
        self._rows[slot] = row._replace(
            weight=0.0 if self._was_hidden else row.weight,
            reached=self.reached,
            decided=last.tick,
            goal_x_px=goal.x_px if goal else math.nan,
            goal_y_px=goal.y_px if goal else math.nan,
        )[:-1]  # without the pose

    def _next_target(self) -> Goal | Route | Rule | None:
        """Return the goal, path or rule of the next decision; None: the fish wanders.

        A fish swims to the beginning of a path as to a goal. It wanders if its goal is reached, its
        leader has left the tank, or it is alone in its group.
        """
        if self.path_task is not None and self.path_task.begun:
            return self.path_task.route
        if self.rule_task is None:
            return None if self.reached else self.goal
        others = self._find_other_paths(self, self.born + self._state.fish.tick)
        if self.rule_task.leader in others:
            return Rule.to_follow(others[self.rule_task.leader][0])
        if self.rule_task.school_rule is not None and others:
            present = np.stack([path[0, :3] for path in others.values()])  # x, y px, heading deg
            return Rule.by_zones(present, self.rule_task.school_rule)
        return None

    def _note_arrival(self, last: DecisionRecord) -> None:
        """Note whether the last decision's motion, now over, reached a goal or the end of a path.

        If the goal is the beginning of a path, the fish now begins the path.
        """
        path_task, fish = self.path_task, self._state.fish
        if path_task is not None and path_task.begun:
            self.reached = path_task.route.is_done(self._state.progress.along, fish.tick)
            self.path_task = None if self.reached else path_task
        # `touches_goal`: the motion ended where the fish touched the goal of its decision.
        elif last.stretch.touches_goal and isinstance(last.goal, Goal) and last.goal == self.goal:
            if path_task is None:
                self.reached = True
            else:
                self.goal, self.path_task = None, path_task._replace(begun=True)

    def copy(self, copies: dict[int, Any]) -> "LiveFish":
        """Return a fish with the same past and plan, which swims on by itself.

        copies: memory of `copy.deepcopy`, by which fish that share a random generator still do.
        """
        twin = copy(self)
        twin._rng = deepcopy(self._rng, copies)
        twin._rows, twin._poses = self._rows.copy(), self._poses.copy()
        twin._requests, twin._decisions = self._requests.copy(), self._decisions.copy()
        return twin

    def go_back_to(self, tick: int) -> None:
        """Set the fish back to a past tick of the tank; do nothing if it has forgotten that tick.

        It swims on exactly as it did after that tick, unless it is sent elsewhere.
        """
        row, decision = self.row_at(tick), self.decision_at(tick)
        if row is None or decision is None:
            return
        # Make the decision again that moved the fish at the tick; forget it and all later ones.
        while self._decisions.pop().tick > decision.tick:
            pass
        self.mode, self._state = decision.mode, decision.state
        self._rng.bit_generator.state = decision.rng_state
        self._plan_stretch(decision.goal, decision.state.fish.obstacles)
        # Its motion has been played up to this tick.
        self._played = tick - decision.tick + 1
        # The plan has a second picture at this tick; if it was drawn with weight 0, it was hidden.
        self._was_hidden = self._planned_rows["weight"][self._played - 1] > 0 and row.weight == 0
        # What the user asked for at the tick may be newer than the decision, its mode included.
        self.goal, self.reached = None, row.reached
        self.mode, self.path_task, self.rule_task, self._cut_after = self.request_at(tick)
        if not math.isnan(row.goal_x_px):
            self.goal = self._make_goal(row.goal_x_px, row.goal_y_px)

    def _replan_stretch(self) -> None:
        """Discard the rest of the planned motion, and plan again from the tick on screen.

        If none of the motion was played, plan again from its beginning. The old plan stays if the
        new one would meet other fish, which rely on the old one.
        """
        # Set the fish back to where the played part of the last motion ends.
        last = self._decisions.pop()
        old_plan = self._state, self._planned_rows, self._planned_poses, self._played
        rng_state = self._rng.bit_generator.state
        if self._played:
            player = self._modes.players[last.mode]
            stretch, self._state = player.cut(last.state, last.stretch, self._played)
            self._decisions.append(replace(last, stretch=stretch))
        else:
            self._state, self._rng.bit_generator.state = last.state, last.rng_state
        self._plan_stretch(self._next_target())
        new = self._decisions[-1]
        if not self._player.is_clear(new.state, new.stretch):  # return to the old plan
            while self._decisions and self._decisions[-1].tick >= last.tick:
                self._decisions.pop()
            self._decisions.append(last)
            self._state, self._planned_rows, self._planned_poses, self._played = old_plan
            self._rng.bit_generator.state = rng_state

    def _plan_stretch(
        self, goal: Goal | Route | Rule | None, obstacles: Obstacles | None = None
    ) -> None:
        """Plan the next motion towards a goal, along a path or by a rule, and remember it.

        goal: None: the fish wanders. obstacles: the other fish as an earlier decision knew them;
        None: as they are now.
        """
        if obstacles is None:
            state = self._player.with_obstacles(
                self._state, self._other_paths(self._state.fish.tick)
            )
        else:
            state = self._state._replace(fish=self._state.fish._replace(obstacles=obstacles))
        rng_state = self._rng.bit_generator.state
        stretch, self._state = self._player.plan(state, goal, self._rng)
        first_tick = self.born + state.fish.tick
        decision = DecisionRecord(first_tick, self.mode, state, rng_state, goal, stretch)
        self._decisions.append(decision)
        while len(self._decisions) > 1 and self._decisions[1].tick <= first_tick - HISTORY:
            self._decisions.popleft()
        self._planned_rows, self._planned_poses = self._last_stretch_rows()
        self._played = 0

    def _last_stretch_rows(self) -> tuple[NDArray[np.void], NDArray[Any]]:
        """Return how the last planned motion is drawn: rows (n,) of dtype `ROW`, and poses (n,).

        Earlier motions count as long as their inertialization (the soft end of a jump) has not died
        away; it goes on only at ticks at which the film moves.
        """
        # The decisions whose motions count, the last one included; how many ticks they all have,
        # and at how many of them, before the last motion, the film moves.
        ticks, moving_ticks, recent = 0, 0, deque[DecisionRecord]()
        join_rules, last = self._player.join_rules, self._decisions[-1]
        for decision in reversed(self._decisions):
            recent.appendleft(decision)
            ticks += len(decision.stretch.trajectory)
            if decision is not last:
                stretch = decision.stretch
                moving_ticks += join_rules.count_moving(stretch.kind, stretch.number)
            if moving_ticks > join_rules.most_ticks:
                break
        # How all these motions are drawn; the rows of the last one are wanted.
        stretches = [decision.stretch for decision in recent]
        names = [decision.target_name for decision in recent]
        columns = edit_columns(stretches, names, ticks, self._modes.edit_inputs[self.mode])
        first = ticks - len(last.stretch.trajectory)
        rows = np.zeros(ticks - first, ROW)
        for column in _EDIT_COLUMNS:
            rows[column] = columns[column][first:]
        return rows, columns["pose"][first:]
