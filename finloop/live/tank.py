"""The live tank: fish that swim for ever, are steered by hand, and whose past can be shown."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from finloop.animate.arena import goal_name
from finloop.animate.paths import lay_path
from finloop.animate.protocols import AnyPlayer
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import PX, Line
from finloop.live import fish as play_fish
from finloop.live.fish import Ghost, LiveFish, Modes, RuleTask
from finloop.social.leader import describe_contradiction
from finloop.social.rule import require_rule


def rehearse_paths(player: AnyPlayer) -> None:
    """Plan once along a path, so that the first drawn path need not wait for compilation.

    Does nothing where a fish has too little room: there every path counts as a goal.
    """
    rng, world = np.random.default_rng(0), player.world
    y, x = (side[[0, -1]].astype(float) for side in np.nonzero(world.tank.legal))
    if np.hypot(x[1] - x[0], y[1] - y[0]) > world.touch_px:
        line = Line("a rehearsal", x, y, PX)
        route = lay_path(line, world.tank, world.motion, None).route
        player.plan(player.begin(rng), route, rng)


class LiveTank:
    """All fish of a live tank. players: by name of the mode; `tick`: the last one played."""

    def __init__(
        self, players: Mapping[str, AnyPlayer], mode: str, fish: int, seed: int,
        ghost: Ghost = lambda row: False,
    ) -> None:  # fmt: skip
        if mode not in players:
            raise FinloopError(
                f"there is no mode {mode} for this film: the film shows too little for it",
                f"one of {', '.join(players)}",
                "take one of these",
            )
        self.players, self.mode, self.tick = players, mode, 0
        self._modes = Modes.from_players(players)
        self.shoaling = next((one.shoaling for one in players.values() if one.shoaling), None)
        self._ghost, self._draws, self._born = ghost, np.random.default_rng(seed), 0
        self.fish: list[LiveFish] = []
        self.set_fish_count(fish)

    @property
    def world(self) -> World:
        """Return the tank and the film's motion data for the present mode."""
        return self.players[self.mode].world

    @property
    def oldest(self) -> int:
        """Return the first tick that the tank can go back to."""
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

    def renew(self, which: int) -> None:
        """Let fish number `which`, from 0, decide the last tick again, unless it is new."""
        fish = self.fish[which]
        if self.tick > fish.born + 1:
            fish.renew()

    def set_fish_count(self, fish: int) -> None:
        """Set the number of fish, as far as there is room: new ones come, or the last ones go.

        FinloopError where the mode moves fewer fish.
        """
        if self.most_fish is not None and fish > self.most_fish:
            raise _paper_error(f"{fish} fish", self.mode)
        del self.fish[fish:]
        while len(self.fish) < fish:
            rng = self._draws.spawn(1)[0] if self._born else self._draws
            self._born += 1
            name = goal_name(len(self.fish))
            try:
                new = LiveFish(
                    self._modes, self.mode, self.tick, name, rng, self._ghost, self._other_paths
                )
            except FinloopError:
                return
            new.advance()
            self.fish.append(new)

    def _other_paths(self, fish: LiveFish, tick: int) -> dict[str, Floats]:
        return {other.name: other.path_from(tick) for other in self.fish if other is not fish}

    def _select(self, which: int | None) -> list[LiveFish]:
        """Return fish number `which`, from 0, if there is one; None: all fish."""
        return self.fish if which is None else self.fish[which : which + 1]

    def send(self, which: int | None, x: float, y: float, drag: bool = False) -> None:
        """Send fish number `which`, or None for all, to the place nearest to x, y px it can touch.

        drag: whether the user is dragging the goal.
        """
        near = self.world.tank.into(x, y)
        if np.hypot(near[0] - x, near[1] - y) > self.world.touch_px:
            x, y = near
        for fish in self._select(which):
            fish.send((float(x), float(y)), drag)

    def _refuse_in_paper(self, what: str) -> None:
        if self.most_fish is not None:
            raise _paper_error(what, self.mode)

    def follow(self, which: int | None, places: Sequence[tuple[float, float]]) -> None:
        """Send fish number `which`, or None for all, along a drawn path.

        places: x, y px of the tank's picture. The path is moved to where a fish can be. If its end
        touches its beginning, it is closed and repeats. If it is hardly longer than a point, it is
        a goal. FinloopError in a mode of the paper.
        """
        self._refuse_in_paper("a path")
        world = self.world
        x, y = np.array([world.tank.into(*place) for place in places], float).T
        gap, reach = np.hypot(x[-1] - x[0], y[-1] - y[0]), np.hypot(x - x[0], y - y[0]).max()
        if reach <= world.touch_px:
            self.send(which, float(x[-1]), float(y[-1]))
            return
        closed = bool(gap <= world.touch_px and reach > 2 * world.touch_px)
        line = Line("the drawn path", x, y, PX, closed=closed)
        route = lay_path(line, world.tank, world.motion, None).route
        for fish in self._select(which):
            fish.follow(route)

    def drop(self, which: int | None) -> None:
        """Let fish number `which`, or None for all, forget its goal, path or rule, and wander."""
        for fish in self._select(which):
            fish.send(None)

    def shoal(self, which: int | None) -> None:
        """Let fish number `which`, or None for all, swim in a group.

        FinloopError where the film gives no rule for it, or in a mode of the paper.
        """
        self._refuse_in_paper("company")
        rule = require_rule(self.shoaling)
        for fish in self._select(which):
            fish.follow_rule(RuleTask(rule))

    def lead(self, which: int | None, leader: int) -> None:
        """Let fish number `which`, or None for all others, follow fish number `leader`, from 0.

        FinloopError if fish would follow each other, or in a mode of the paper.
        """
        self._refuse_in_paper("a leader")
        if leader >= len(self.fish):
            return
        ahead = self.fish[leader]
        followers = [one for one in self._select(which) if which is not None or one is not ahead]
        for follower in followers:
            number = self.fish.index(follower) + 1
            if problem := describe_contradiction(self.leaders, number, leader + 1):
                raise FinloopError(
                    problem,
                    "a leader that follows none of its followers",
                    "choose another leader, or first send this one to a goal or let it wander",
                )
        for follower in followers:
            follower.follow_rule(RuleTask(leader=ahead.name))

    @property
    def leaders(self) -> dict[int, int]:
        """Return the number of each follower's leader, by number of the follower, both from 1."""
        numbers = {fish.name: number for number, fish in enumerate(self.fish, 1)}
        return {
            number: numbers[fish.rule_task.leader]
            for number, fish in enumerate(self.fish, 1)
            if fish.rule_task is not None and fish.rule_task.leader in numbers
        }

    def set_zone_weights(self, weights: tuple[float, float, float]) -> None:
        """Set the weights of repulsion, alignment and attraction, for all fish in a group."""
        if self.shoaling is None:
            return
        names = ("repulsion_weight", "alignment_weight", "attraction_weight")
        zones = replace(self.shoaling.zones, **dict(zip(names, weights, strict=True)))
        self.shoaling = replace(self.shoaling, zones=zones)
        for fish in self.fish:
            if fish.rule_task is not None and fish.rule_task.shoaling is not None:
                fish.rule_task = RuleTask(self.shoaling)

    def describe_lack(self, mode: str) -> str:
        """Return why the tank cannot switch to a mode now, as a sentence; "" if it can."""
        if mode not in self.players:
            return "the film shows too little for it"
        most = self.players[mode].most_fish
        if most is not None and len(self.fish) > most:
            return "a mode of the paper moves one fish: take one, then switch"
        return ""

    def switch(self, mode: str) -> None:
        """Switch all fish to a mode; nothing happens where the film shows too little for it.

        FinloopError if the mode moves fewer fish. In a mode of the paper, paths and rules are
        dropped.
        """
        if mode not in self.players:
            return
        if self.describe_lack(mode):
            raise _paper_error(f"{len(self.fish)} fish", mode)
        self.mode = mode
        for fish in self.fish:
            if self.most_fish is not None and (fish.path_task or fish.rule_task):
                fish.send(None)
            fish.switch(mode)

    def back_to(self, tick: int) -> None:
        """Set the tank back to a past tick, to swim on from there; forget what came after."""
        self.tick = min(max(tick, self.oldest), self.tick)
        self.fish = [fish for fish in self.fish if fish.row_at(self.tick) is not None]
        for fish in self.fish:
            fish.back_to(self.tick)
        self.mode = self.fish[0].mode
        rules = [fish.rule_task.shoaling for fish in self.fish if fish.rule_task is not None]
        self.shoaling = next((one for one in rules if one is not None), self.shoaling)


def _paper_error(request: str, mode: str) -> FinloopError:
    """Return the error that a mode of the paper cannot do a request."""
    return FinloopError(
        f"mode {mode} cannot do {request}",
        "one fish that is sent to goals, or wanders, as in the paper",
        "switch to mode matching first",
    )
