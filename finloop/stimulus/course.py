"""The motion of one trial: planned beforehand, or tick by tick where fish react to live animals.

The same scene, condition, seed and messages, in the same order and with the same times, give the
same states: nothing here reads a clock.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from finloop.animate.paths import lay_path
from finloop.animate.protocols import AnyPlayer
from finloop.animate.route import Route
from finloop.animate.world import World
from finloop.base.errors import FinloopError
from finloop.base.line import TANK
from finloop.edit.bodies import Bodies
from finloop.io.line import load_line
from finloop.live.fish import LiveFish
from finloop.live.tank import LiveTank
from finloop.stimulus.animals import LiveAnimals
from finloop.stimulus.controls import (
    apply_change,
    fade_shares,
    fade_states,
    planned_ticks,
    with_look,
)
from finloop.stimulus.drawn import ALPHA, FIELDS, LOOK, PARTNER, PICTURE, drawn_of
from finloop.stimulus.order import Trial
from finloop.stimulus.protocol import Condition, Protocol
from finloop.stimulus.rules import Aim, TankGeometry, aim

States = NDArray[np.float32]

_REHEARSED = 200  # ticks of the rehearsal
MODE = "matching"


@dataclass(frozen=True)
class TrialContext:
    """What is the same in every trial of a session.

    player: animates the fish in mode `matching`; bodies: the film's postures; mm_per_px: mm of the
    display per px of the tank's picture, if known.
    """

    player: AnyPlayer
    bodies: Bodies
    mm_per_px: float | None = None

    @property
    def world(self) -> World:
        """Return the world that all fish swim in: its tank, and the film's motion."""
        return self.player.world

    @property
    def rate_hz(self) -> float:
        """Return the number of ticks per second."""
        return self.world.motion.rate_hz

    @property
    def length_px(self) -> float:
        """Return the body length of a fish, px of the tank's picture."""
        return self.world.motion.body_length_px

    @property
    def width(self) -> int:
        """Return F, the number of values of a fish's state: `FIELDS` and its posture."""
        return len(FIELDS) + self.posture

    @property
    def posture(self) -> int:
        """Return the number of values of a posture, the last part of a fish's state."""
        return int(self.bodies.poses.shapes.mean.size)

    @cached_property
    def tank(self) -> TankGeometry:
        """Return the tank as rules need it: its size, the body length, and where fish can be."""
        height, width = self.world.tank.arena.shape
        return TankGeometry(width, height, self.length_px, self.world.tank.into)

    def ticks(self, seconds: float) -> int:
        """Return a time of `seconds` as a number of ticks, at least one."""
        return max(1, round(seconds * self.rate_hz))


@dataclass(frozen=True)
class Cue:
    """How a trial is shown: its condition, the number of fish, their look and their fading.

    look: index of the look in `Protocol.looks`; fade_s: s, of fading in, and of fading out.
    """

    condition: Condition
    fish: int
    look: int = 0
    fade_s: float = 0.0

    def apply_look_and_fade(self, states: States, scene: TrialContext) -> States:
        """Return the states (ticks, fish, F) with the look of the cue, faded in and out."""
        return fade_states(with_look(states, self.look), round(self.fade_s * scene.rate_hz))


def tank_of(scene: TrialContext, cue: Cue, seed: int) -> LiveTank:
    """Return a live tank with the fish of a trial, at its first tick. seed: of the motion.

    FinloopError where there is no room for all fish.
    """
    tank = LiveTank({MODE: scene.player}, MODE, cue.fish, seed)
    if len(tank.fish) < cue.fish:
        raise FinloopError(
            f"the tank has room for {len(tank.fish)} fish, and the protocol shows {cue.fish}",
            "fish that can swim clear of each other",
            "take fewer (fish), or draw them smaller (animate.fish_scale)",
        )
    return tank


def rehearse(scene: TrialContext) -> None:
    """Let a fish swim unseen for 200 ticks, so that no trial waits for compiling or caching."""
    tank, rng = LiveTank({MODE: scene.player}, MODE, 1, 0), np.random.default_rng(0)
    for _ in range(_REHEARSED):
        tank.advance()
        x, y = rng.uniform(0, scene.tank.width), rng.uniform(0, scene.tank.height)
        tank.send(0, float(x), float(y))
        tank.renew(0)
        states_of(tank, scene)


def states_of(tank: LiveTank, scene: TrialContext) -> States:
    """Return the states (fish, F) of all fish of a live tank at its present tick."""
    rows = [row for fish in tank.fish if (row := fish.row_at(tank.tick)) is not None]
    return drawn_of(rows, scene.bodies)


def plan_motion(scene: TrialContext, cue: Cue, seed: int) -> States:
    """Return the states (ticks, fish, F) of a trial whose motion is known beforehand.

    seed: of the motion. It has the condition's change; look and fading come later. FinloopError if
    fish cannot follow a path.
    """
    condition, tank = cue.condition, tank_of(scene, cue, seed)
    motion, goals = condition.motion, Goals()
    if motion.path is not None:
        route = route_of(scene, motion.file)
        for fish in tank.fish:
            fish.follow(route)
    elif motion.company:
        tank.shoal(None)
    elif motion.goal is not None or motion.goals is not None:
        goals = Goals(motion.goals or (motion.goal or (0.5, 0.5),))
        goals.send(tank, range(len(tank.fish)))
    ticks, states = scene.ticks(condition.seconds), [states_of(tank, scene)]
    for _ in range(planned_ticks(condition.change, ticks) - 1):
        goals.next(tank)
        tank.advance()
        states.append(states_of(tank, scene))
    return apply_change(np.stack(states), condition.change, ticks)


def repeat_motion(scene: TrialContext, cue: Cue, motion: States) -> States:
    """Return the motion (ticks, fish, F) of another trial, with the change of the cue's condition.

    A motion that was cut short keeps its last state to the end.
    """
    ticks = scene.ticks(cue.condition.seconds)
    states = apply_change(motion, cue.condition.change, ticks)
    rest = np.repeat(states[-1:], max(0, ticks - len(states)), axis=0)
    return np.concatenate([states, rest])[:ticks]


def whole_motion(scene: TrialContext, plan: Protocol, order: Sequence[Trial]) -> States:
    """Return the states (ticks, fish, F) of all trials and pauses, for a page that plays by itself.

    FinloopError if a motion is not known beforehand.
    """
    motions: dict[str, States] = {}
    parts: list[States] = []
    for trial in order:
        cue = cue_of(plan, trial)
        motion = cue.condition.motion
        if motion.rule is not None:
            raise FinloopError(
                f"the condition {trial.condition} reacts to live animals",
                "motions that are known beforehand, for a page that plays by itself",
                'run it with `make stimulus S="show …"`, or leave this condition out',
            )
        if motion.again is not None:
            states = repeat_motion(scene, cue, motions[motion.again])
        else:
            states = plan_motion(scene, cue, trial.seed)
        motions[trial.condition] = states
        pause = np.zeros((round(plan.pause_s * scene.rate_hz), *states.shape[1:]), np.float32)
        pause[..., [PICTURE, PARTNER]] = -1
        parts += [cue.apply_look_and_fade(states, scene), pause]
    return np.concatenate(parts)


def cue_of(plan: Protocol, trial: Trial) -> Cue:
    """Return how a trial of a protocol is shown: condition, look, fading, number of fish."""
    condition = plan.conditions[trial.condition]
    return Cue(condition, plan.fish, plan.looks.index(condition.look), plan.fade_s)


def route_of(scene: TrialContext, path: Path) -> Route:
    """Return the route along the path in a file, laid out in the tank, without the file's times."""
    line, world = load_line(path, TANK), scene.world
    return lay_path(line._replace(time_s=None), world.tank, world.motion, scene.mm_per_px).route


class Goals:
    """The goals that each fish is sent to in turn.

    places: x, y of each goal, shares (0 … 1) of the tank's width and height from the upper left.
    """

    def __init__(self, places: tuple[tuple[float, ...], ...] = ()) -> None:
        self._places = places
        self._at: dict[int, int] = {}

    def send(self, tank: LiveTank, which: Iterable[int]) -> None:
        """Send the fish numbered `which` to their next goals; after its last one a fish wanders."""
        height, width = tank.world.tank.arena.shape
        for number in which:
            at = self._at.get(number, -1) + 1
            self._at[number] = at
            if at < len(self._places):
                x, y = self._places[at]
                tank.send(number, x * (width - 1), y * (height - 1))

    def next(self, tank: LiveTank) -> None:
        """Send each fish that has reached its goal to its next one."""
        if self._places:
            at = range(len(tank.fish))
            self.send(tank, [n for n in at if tank.fish[n].reached and n in self._at])


class Reaction:
    """A trial whose fish react to live animals, planned tick by tick. seed: of the motion.

    states: those (fish, F) of every tick so far, or of the last one where `keeps` is False.
    """

    def __init__(self, scene: TrialContext, cue: Cue, seed: int, animals: LiveAnimals) -> None:
        rule = cue.condition.motion.rule
        assert rule is not None
        self._scene, self._cue, self._animals, self._rule = scene, cue, animals, rule
        self._tank = tank_of(scene, cue, seed)
        self._aims: list[Aim | None] = [None] * len(self._tank.fish)
        fade = round(cue.fade_s * scene.rate_hz)
        self._ramp = fade_shares(scene.ticks(cue.condition.seconds), fade)
        self.states: list[States] = []
        self.keeps = True  # keeps all states, for a trial that repeats them; else the last ones

    def tick(self, now_s: float) -> States:
        """Plan the next tick at a session time, s; return the states (fish, F) of its fish."""
        if self.states:
            self._ask(now_s)
            self._tank.advance()
        if not self.keeps:
            self.states.clear()
        self.states.append(self._current_states())
        return self.states[-1]

    def react(self, now_s: float) -> States | None:
        """Plan the last tick again at a session time, s; return its states (fish, F), or None.

        None: no fish has a new target, so nothing changes.
        """
        if not self.states:
            return None
        numbers = self._ask(now_s)
        if not numbers:
            return None
        for number in numbers:
            self._tank.renew(number)
        self.states[-1] = self._current_states()
        return self.states[-1]

    def _ask(self, now_s: float) -> list[int]:
        """Send the fish where the rule wants them; return those with a new target."""
        sent = []
        for number, fish in enumerate(self._tank.fish):
            row = fish.row_at(self._tank.tick)
            assert row is not None
            own = row.x_px, row.y_px, float(np.radians(row.heading_deg))
            wish = aim(self._rule, own, self._animals, now_s, self._scene.tank)
            if self._is_new(number, fish, wish, own):
                self._aims[number] = wish
                if wish is None:
                    self._tank.drop(number)
                else:
                    self._tank.send(number, *wish)
                sent.append(number)
        return sent

    def _is_new(
        self, number: int, fish: LiveFish, wish: Aim | None, own: tuple[float, ...]
    ) -> bool:
        """Return whether to send a fish: its aim has moved, or it has left its place."""
        old = self._aims[number]
        if wish is None or old is None:
            return wish is not old
        renew_px = self._rule.renew * self._scene.length_px
        moved = np.hypot(wish[0] - old[0], wish[1] - old[1]) > renew_px
        away = np.hypot(wish[0] - own[0], wish[1] - own[1]) > renew_px + self._scene.length_px
        return bool(moved or (fish.reached and away))

    def _current_states(self) -> States:
        """Return the present states with the look of the condition, fading in and out."""
        states = states_of(self._tank, self._scene)
        states[:, LOOK] = self._cue.look
        states[:, ALPHA] *= self._ramp[self._tank.tick]
        return states


def collect_motion(states: Iterable[States]) -> States:
    """Return the states (fish, F) of all ticks as one motion (ticks, fish, F), without fading."""
    whole = np.stack(list(states))
    whole[:, :, ALPHA] = 1.0
    return whole
