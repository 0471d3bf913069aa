"""The live tank: fish that swim for ever, are steered by hand, and whose past can be shown."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from finloop.animate.arena import goal_name
from finloop.animate.paths import lay_path
from finloop.animate.protocols import AnyPlayer
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import PX, Line
from finloop.live import fish as play_fish
from finloop.live.fish import LiveFish, Modes, RuleTask, TooUnlike
from finloop.social.leader import describe_contradiction
from finloop.social.rule import SchoolRule, require_rule

_MOST_FUTURES = 3  # kept; each holds the past of all fish, some MB


def warm_up_paths(player: AnyPlayer) -> None:
    """Plan once along a path in advance, so that functions are compiled before a user draws one.

    Do nothing if a fish has too little room: then every path counts as a goal.
    """
    rng, world = np.random.default_rng(0), player.world
    rows, columns = np.nonzero(world.tank.legal)  # where a fish can be
    # The path leads from the first to the last of these places.
    x, y = columns[[0, -1]].astype(float), rows[[0, -1]].astype(float)
    if np.hypot(x[1] - x[0], y[1] - y[0]) > world.touch_px:
        line = Line("a rehearsal", x, y, PX)
        route = lay_path(line, world.tank, world.motion, None).route
        player.plan(player.begin(rng), route, rng)


class Future(NamedTuple):
    """A live tank as it was left, to return to.

    since: the earliest tick from which it may differ from the present one; created: how many fish
    were ever put into it.
    """

    since: int
    tick: int
    mode: str
    school_rule: SchoolRule | None
    fish: list[LiveFish]
    rng: np.random.Generator
    created: int


class LiveTank:
    """All fish of a live tank, which are steered by hand and can be set back to a past tick.

    players: by name of the mode. tick: the last one. futures: those that were left, the last first.
    """

    def __init__(
        self, players: Mapping[str, AnyPlayer], mode: str, fish: int, seed: int,
        too_unlike: TooUnlike = lambda row: False,
    ) -> None:  # fmt: skip
        """Create a tank in a mode, with as many fish as asked, as far as there is room.

        seed: of all random choices. FinloopError if the film does not allow the mode, or so many
        fish.
        """
        if mode not in players:
            raise FinloopError(
                f"there is no mode {mode} for this film: the film shows too little for it",
                f"one of {', '.join(players)}",
                "take one of these",
            )
        self.players, self.mode, self.tick = players, mode, 0
        self._modes = Modes.from_players(players)
        # The rule for fish in a group, of the first mode that has one.
        rules = (player.school_rule for player in players.values())
        self.school_rule = next((rule for rule in rules if rule), None)
        self._too_unlike, self._rng, self._created = too_unlike, np.random.default_rng(seed), 0
        self.fish: list[LiveFish] = []
        self.futures: list[Future] = []
        self.set_fish_count(fish)

    @property
    def world(self) -> World:
        """Return the tank's geometry and the film's motion data for the present mode."""
        return self.players[self.mode].world

    @property
    def oldest_tick(self) -> int:
        """Return the first tick to which the tank can be set back."""
        return max(0, self.tick - play_fish.HISTORY + 1)

    @property
    def most_fish(self) -> int | None:
        """Return the largest number of fish that the present mode can move; None: any number."""
        return self.players[self.mode].most_fish

    def advance(self) -> None:
        """Advance the tank and its fish by one tick."""
        self.tick += 1
        for fish in self.fish:
            fish.advance()

    def redo_last_tick(self, fish_index: int) -> None:
        """Let one fish (index from 0) decide the last tick again, unless it is new in the tank."""
        fish = self.fish[fish_index]
        if self.tick > fish.born + 1:
            fish.redo_last_tick()

    def set_fish_count(self, count: int) -> None:
        """Set the number of fish, as far as there is room; new fish come, or the last ones go.

        FinloopError if the mode cannot move so many fish.
        """
        if self.most_fish is not None and count > self.most_fish:
            raise _paper_error(f"{count} fish", self.mode)
        del self.fish[count:]
        while len(self.fish) < count:
            # The first fish draws from the tank's generator, as a single fish would.
            rng = self._rng.spawn(1)[0] if self._created else self._rng
            self._created += 1
            name = goal_name(len(self.fish))
            try:
                new = LiveFish(
                    self._modes, self.mode, self.tick, name, rng, self._too_unlike,
                    self._other_paths,
                )  # fmt: skip
            except FinloopError:  # no room
                return
            new.advance()
            self.fish.append(new)

    def _other_paths(self, fish: LiveFish, tick: int) -> dict[str, Floats]:
        """Return the planned paths of all other fish from a tick on, each (n, 4), by their names.

        The columns are x, y [px], heading [degrees] and number of the picture.
        """
        return {
            other.name: other.planned_path_from(tick) for other in self.fish if other is not fish
        }

    def _select_fish(self, fish_index: int | None) -> list[LiveFish]:
        """Return a list of the fish with an index from 0, or of all fish for None.

        The list is empty if there is no such fish.
        """
        return self.fish if fish_index is None else self.fish[fish_index : fish_index + 1]

    def send_to_goal(self, fish_index: int | None, x: float, y: float, drag: bool = False) -> None:
        """Send a fish to x, y [px], or to the nearest place that it can reach.

        It goes to the latter if that is more than `touch_px` away from x, y.
        fish_index: from 0; None: all fish. drag: whether the user is dragging the goal.
        """
        nearest = self.world.tank.nearest_legal_point(x, y)
        if np.hypot(nearest[0] - x, nearest[1] - y) > self.world.touch_px:
            x, y = nearest
        for fish in self._select_fish(fish_index):
            fish.send_to_goal((float(x), float(y)), drag)

    def _refuse_in_paper_modes(self, request: str) -> None:
        """Raise FinloopError if the present mode is one of the paper's.

        request: what these modes cannot do, for the message, such as "a path".
        """
        if self.most_fish is not None:
            raise _paper_error(request, self.mode)

    def follow_path(self, fish_index: int | None, places: Sequence[tuple[float, float]]) -> None:
        """Send a fish along a path that a user has drawn.

        fish_index: from 0; None: all fish. places: points of the path, x, y px of the tank's
        picture; each is first moved to the nearest place where a fish can be. Then the distances
        from the first point decide what the drawing means:

        - no point is farther than `touch_px`: a goal, at the last point;
        - a point is farther than twice `touch_px`, and the last one is within `touch_px`: a closed
          path, which the fish swims again and again;
        - else: a path that the fish follows once, to its end.

        FinloopError in the paper's modes (network, loops, hybrid), where fish follow no paths.
        """
        self._refuse_in_paper_modes("a path")
        world = self.world
        x, y = np.array([world.tank.nearest_legal_point(*place) for place in places], float).T
        from_start_px = np.hypot(x - x[0], y - y[0])
        farthest_px = from_start_px.max()
        if farthest_px <= world.touch_px:
            self.send_to_goal(fish_index, float(x[-1]), float(y[-1]))
            return
        closed = from_start_px[-1] <= world.touch_px and farthest_px > 2 * world.touch_px
        line = Line("the drawn path", x, y, PX, closed=bool(closed))
        route = lay_path(line, world.tank, world.motion, None).route
        for fish in self._select_fish(fish_index):
            fish.follow_path(route)

    def let_wander(self, fish_index: int | None) -> None:
        """Let a fish (index from 0; None: all fish) forget its goal, path or rule, and wander."""
        for fish in self._select_fish(fish_index):
            fish.send_to_goal(None)

    def swim_in_group(self, fish_index: int | None) -> None:
        """Let a fish swim in a group with the others.

        fish_index: from 0; None: all fish. FinloopError if the film gives no rule for it, or in a
        mode of the paper.
        """
        self._refuse_in_paper_modes("company")
        rule = require_rule(self.school_rule)
        for fish in self._select_fish(fish_index):
            fish.follow_rule(RuleTask(rule))

    def follow_leader(self, fish_index: int | None, leader: int) -> None:
        """Let a fish follow another one; do nothing if there is no such leader.

        fish_index: of the follower, from 0; None: all others. leader: index of the fish in front.
        FinloopError if fish would follow each other, or in a mode of the paper.
        """
        self._refuse_in_paper_modes("a leader")
        if leader >= len(self.fish):
            return
        leading_fish = self.fish[leader]
        followers = self._select_fish(fish_index)
        if fish_index is None:
            followers = [fish for fish in followers if fish is not leading_fish]
        for follower in followers:
            number = self.fish.index(follower) + 1
            if problem := describe_contradiction(self.leaders, number, leader + 1):
                raise FinloopError(
                    problem,
                    "a leader that follows none of its followers",
                    "choose another leader, or first send this one to a goal or let it wander",
                )
        for follower in followers:
            follower.follow_rule(RuleTask(leader=leading_fish.name))

    @property
    def leaders(self) -> dict[int, int]:
        """Return each follower's leader, both as numbers of the fish from 1."""
        numbers = {fish.name: number for number, fish in enumerate(self.fish, 1)}
        return {
            number: numbers[fish.rule_task.leader]
            for number, fish in enumerate(self.fish, 1)
            if fish.rule_task is not None and fish.rule_task.leader in numbers
        }

    def set_zone_weights(self, weights: tuple[float, float, float]) -> None:
        """Set the weights of repulsion, alignment and attraction for all fish in a group.

        Nothing changes if the film gives no rule for a group.
        """
        if self.school_rule is None:
            return
        names = ("repulsion_weight", "alignment_weight", "attraction_weight")
        zones = replace(self.school_rule.zones, **dict(zip(names, weights, strict=True)))
        self.school_rule = replace(self.school_rule, zones=zones)
        for fish in self.fish:
            if fish.rule_task is not None and fish.rule_task.school_rule is not None:
                fish.rule_task = RuleTask(self.school_rule)

    def explain_unavailable_mode(self, mode: str) -> str:
        """Return why the tank cannot switch to a mode now; "" if it can."""
        if mode not in self.players:
            return "the film shows too little for it"
        if self._has_too_many_fish(mode):
            return "a mode of the paper moves one fish: take one, then switch"
        return ""

    def _has_too_many_fish(self, mode: str) -> bool:
        """Return whether the tank has more fish than a mode can move."""
        most = self.players[mode].most_fish
        return most is not None and len(self.fish) > most

    def switch_mode(self, mode: str) -> None:
        """Switch all fish to another mode; do nothing if the film shows too little for it.

        FinloopError if the mode cannot move so many fish. In a mode of the paper, paths and rules
        are dropped.
        """
        if mode not in self.players:
            return
        if self._has_too_many_fish(mode):
            raise _paper_error(f"{len(self.fish)} fish", mode)
        is_paper_mode = self.players[mode].most_fish is not None
        self.mode = mode
        for fish in self.fish:
            if is_paper_mode and (fish.path_task or fish.rule_task):
                fish.send_to_goal(None)
            fish.switch_mode(mode)

    def branch_from(self, tick: int) -> None:
        """Let the fish swim on from a past tick; what came after it is kept, to return to.

        Do nothing if the tick is not past. Only the last _MOST_FUTURES futures are kept.
        """
        if tick >= self.tick:  # nothing came after it
            return
        copies: dict[int, Any] = {}
        rng, fish = deepcopy(self._rng, copies), [fish.copy(copies) for fish in self.fish]
        future = self._make_future(max(tick, self.oldest_tick), fish, rng)
        others = (other._replace(since=min(other.since, future.since)) for other in self.futures)
        self.futures = [future, *others][:_MOST_FUTURES]
        self.go_back_to(tick)

    def return_to(self, number: int) -> None:
        """Go on in a kept future, by its index in `futures`; the present one takes its place.

        Do nothing if there is no such future.
        """
        if number >= len(self.futures):
            return
        future = self.futures[number]
        self.futures = [
            other._replace(since=min(other.since, future.since)) for other in self.futures
        ]
        self.futures[number] = self._make_future(future.since, self.fish, self._rng)
        _, self.tick, self.mode, self.school_rule, self.fish, self._rng, self._created = future

    def _make_future(self, since: int, fish: list[LiveFish], rng: np.random.Generator) -> Future:
        """Return the present as a future to return to, with these fish and generator."""
        return Future(since, self.tick, self.mode, self.school_rule, fish, rng, self._created)

    def go_back_to(self, tick: int) -> None:
        """Set the tank back to a past tick; fish swim on from there, later ticks are forgotten.

        Fish that entered after that tick are removed; mode and grouping become those of then. A
        tick that is too old is replaced by the oldest.
        """
        self.tick = min(max(tick, self.oldest_tick), self.tick)
        self.fish = [fish for fish in self.fish if fish.row_at(self.tick) is not None]
        for fish in self.fish:
            fish.go_back_to(self.tick)
        self.mode = self.fish[0].mode  # all fish have the same one
        rules = [fish.rule_task.school_rule for fish in self.fish if fish.rule_task is not None]
        self.school_rule = next((rule for rule in rules if rule is not None), self.school_rule)


def _paper_error(request: str, mode: str) -> FinloopError:
    """Return the error for a request that the paper's modes cannot do."""
    return FinloopError(
        f"mode {mode} cannot do {request}",
        "one fish that is sent to goals, or wanders, as in the paper",
        "switch to mode matching first",
    )
