"""The live tank: fish that swim for ever, are sent by hand, and whose past can be looked at."""

from collections.abc import Mapping

import numpy as np

from finloop.animate.arena import goal_name
from finloop.animate.edit_list import Goal
from finloop.animate.swim import Player
from finloop.errors import FinloopError
from finloop.live import fish as play_fish
from finloop.live.fish import Ghost, LiveFish


class LiveTank:
    """All fish. players: one a mode, as `animate` has them; `tick`: the last one played."""

    def __init__(
        self, players: Mapping[str, Player], mode: str, fish: int, seed: int,
        ghost: Ghost = lambda row: False,
    ) -> None:  # fmt: skip
        if mode not in players:
            raise FinloopError(
                f"there is no mode {mode}: the film has no loops to go on by",
                f"one of {', '.join(players)}",
                "take another mode, or let more frames join (loops.threshold)",
            )
        self.players, self.mode, self.tick = players, mode, 0
        self._seed, self._ghost, self._born = seed, ghost, 0
        self.fish: list[LiveFish] = []
        self.count(fish)

    @property
    def rate_hz(self) -> float:
        """Ticks of a second of film."""
        return self.players[self.mode].mode.motion.rate_hz

    @property
    def oldest(self) -> int:
        """The first tick that one can go back to."""
        return max(0, self.tick - play_fish.HISTORY + 1)

    def on(self) -> None:
        """One tick."""
        self.tick += 1
        for fish in self.fish:
            fish.on()

    def count(self, fish: int) -> None:
        """So many fish: further ones come anywhere, the last ones go."""
        del self.fish[fish:]
        while len(self.fish) < fish:
            rng = np.random.default_rng([self._seed, self._born])
            self._born += 1
            one = LiveFish(self.players, self.mode, self.tick, rng, self._ghost)
            one.on()
            self.fish.append(one)

    def send(self, which: int | None, x: float, y: float, drag: bool = False) -> None:
        """A fish, or all of them, to the place nearest to (x, y) px that a fish can touch."""
        mode = self.players[self.mode].mode
        near = mode.tank.into(x, y)
        if np.hypot(near[0] - x, near[1] - y) > mode.touch_px:
            x, y = near
        for number in self._of(which):
            goal = Goal(goal_name(number), float(x), float(y), mode.touch_px)
            self.fish[number].send(goal, drag)

    def drop(self, which: int | None) -> None:
        """A fish, or all of them, wander."""
        for number in self._of(which):
            self.fish[number].send(None)

    def switch(self, mode: str) -> None:
        """All go on in a mode, if the film allows it."""
        if mode in self.players:
            self.mode = mode
            for fish in self.fish:
                fish.switch(mode)

    def _of(self, which: int | None) -> range:
        if which is None:
            return range(len(self.fish))
        return range(which, which + 1) if which < len(self.fish) else range(0)
