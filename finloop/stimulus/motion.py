"""The motion of one trial: planned beforehand, or tick by tick where fish react to live animals.

Motions are arrays (ticks, fish, fields) of states as the display draws them (DRAWN). The same
context, condition, seed and messages, in the same order and with the same times, give the same
states: nothing here reads a clock.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from finloop.animate.paths import lay_path
from finloop.animate.protocols import AnyPlayer
from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import TANK
from finloop.edit.bodies import Bodies
from finloop.io.line import load_line
from finloop.live.tank import LiveTank
from finloop.show.drawn import (
    ALPHA,
    HEADING,
    LOOK,
    PARTNER,
    PICTURE,
    POSTURE,
    States,
    drawn_states,
)
from finloop.stimulus.animals import LiveAnimals, PlacePx, TankGeometry
from finloop.stimulus.order import Trial
from finloop.stimulus.protocol import Condition, MotionChange, Protocol
from finloop.stimulus.rules import find_rule_target

_WARM_UP_TICKS = 200
_NOT_INTERPOLATED = slice(PICTURE, LOOK + 1)
"""Pictures, their mixture, their sides and the look."""
MODE = "matching"


class TrialContext:
    """What all trials of a session share: the tank, the film's fish, and the tick rate.

    player: animates the fish in mode `matching`; bodies: the film's postures; mm_per_px: mm of the
    display per px of the tank's picture, if known. world: what all fish swim in; rate_hz: ticks per
    second; length_px: body length of a fish; posture: how many values a posture has; width: how
    many fields a fish's state has, the posture included; tank: its size, and where fish can be.
    """

    def __init__(self, player: AnyPlayer, bodies: Bodies, mm_per_px: float | None = None) -> None:
        """Derive what all trials share from the player and the postures."""
        self.player, self.bodies, self.mm_per_px = player, bodies, mm_per_px
        self.world = player.world
        self.rate_hz = self.world.motion.rate_hz
        self.length_px = self.world.motion.body_length_px
        self.posture = int(bodies.poses.shapes.mean.size)
        self.width = POSTURE + self.posture
        height, width = self.world.tank.arena.shape
        self.tank = TankGeometry(width, height, self.length_px, self.world.tank.nearest_legal_point)

    def count_ticks(self, seconds: float) -> int:
        """Return how many ticks a duration [s] has, at least one."""
        return max(1, round(seconds * self.rate_hz))


@dataclass(frozen=True)
class TrialSetup:
    """How one trial is shown: its condition, the number of fish, their look and their fading.

    seed: of the motion; look: index of the look in `Protocol.looks`; fade_s: fading in or out, s.
    """

    condition: Condition
    fish: int
    seed: int
    look: int = 0
    fade_s: float = 0.0

    @classmethod
    def from_protocol(cls, protocol: Protocol, trial: Trial) -> "TrialSetup":
        """Return how a trial is shown, according to its protocol."""
        condition = protocol.conditions[trial.condition]
        look = protocol.looks.index(condition.look)
        return cls(condition, protocol.fish, trial.seed, look, protocol.fade_s)

    def apply_look_and_fade(self, states: States, rate_hz: float) -> States:
        """Return a motion (ticks, fish, fields) with the trial's look, faded in and out."""
        shown = states.copy()
        shown[..., LOOK] = self.look
        shown[..., ALPHA] *= fade_opacities(len(states), round(self.fade_s * rate_hz))[:, None]
        return shown


# --- changes of a motion


def count_ticks_to_plan(change: MotionChange | None, ticks: int) -> int:
    """Return how many ticks of a motion to plan, so that after its change it fills a trial.

    A still motion needs one tick, a motion twice as fast about twice as many.
    """
    if change is None:
        return ticks
    if change.still:
        return 1
    return math.ceil((ticks - 1) * change.speed - 1e-9) + 1  # 1e-9: against rounding errors


def apply_change(states: States, change: MotionChange | None, ticks: int) -> States:
    """Return a motion (n, fish, fields) played faster, backwards or still, for at most `ticks`.

    Only the first `count_ticks_to_plan` ticks of the motion are used, also backwards. A still
    motion holds its first state.
    """
    states = states[: count_ticks_to_plan(change, ticks)]
    if change is None:
        return states
    if change.still:
        return np.repeat(states[:1], ticks, axis=0)
    if change.reversed:
        states = states[::-1]
    if change.speed == 1:
        return states
    count = math.floor((len(states) - 1) / change.speed + 1e-9) + 1  # against rounding errors
    return interpolate_states(states, change.speed * np.arange(count, dtype=float))[:ticks]


def interpolate_states(states: States, times: Floats) -> States:
    """Return the states (n, fish, fields) of a motion at n times between its ticks.

    times (n,): in ticks from the first. As on the display's page, places, sizes, alpha and posture
    are interpolated linearly, headings the shorter way; pictures, their mixture and the look are
    the nearer tick's.
    """
    last = len(states) - 1
    times = np.clip(times, 0, last)
    tick = times.astype(int)
    share = (times - tick)[:, None, None]
    before, after = states[tick], states[np.minimum(tick + 1, last)]
    nearer = np.where(share < 0.5, before, after)
    step = after.astype(float) - before
    step[..., HEADING] = (step[..., HEADING] + np.pi) % (2 * np.pi) - np.pi
    mixed = (before + share * step).astype(np.float32)
    mixed[..., _NOT_INTERPOLATED] = nearer[..., _NOT_INTERPOLATED]
    # A fish that is absent at one of the two ticks has no place to come from, or to go to.
    comes_or_goes = (before[..., PICTURE] < 0) != (after[..., PICTURE] < 0)
    return np.where(comes_or_goes[..., None], nearer, mixed)


def fade_opacities(count: int, fade_ticks: int) -> NDArray[np.float32]:
    """Return the opacity (count,) of each tick, which rises from 0 to 1 and falls again at the end.

    fade_ticks: how long the rise and the fall each take; 0: all are 1.
    """
    if fade_ticks <= 0:
        return np.ones(count, np.float32)
    ticks = np.arange(count)
    ticks_to_nearer_end = np.minimum(ticks, ticks[::-1])
    return np.minimum(1.0, ticks_to_nearer_end / fade_ticks).astype(np.float32)


# --- motions that are known beforehand


def plan_motion(
    context: TrialContext, setup: TrialSetup, motions: Mapping[str, States] | None = None
) -> States:
    """Return the planned motion (ticks, fish, fields) of a trial that ignores live animals.

    The condition's change is applied, look and fading are not. motions: the motion of each
    condition's latest trial, for a condition that repeats another's; if that is too short, its last
    state is held. FinloopError if fish cannot follow a path, or the tank has no room for them.
    """
    condition = setup.condition
    motion, ticks = condition.motion, context.count_ticks(condition.seconds)
    if motion.again is not None:
        states = apply_change((motions or {})[motion.again], condition.change, ticks)
        held = np.repeat(states[-1:], max(0, ticks - len(states)), axis=0)
        return np.concatenate([states, held])[:ticks]
    tank, world = _create_trial_tank(context, setup), context.world
    if motion.path is not None:
        line = load_line(motion.file, TANK)._replace(time_s=None)  # at the fish's own speed
        route = lay_path(line, world.tank, world.motion, context.mm_per_px).route
        for fish in tank.fish:
            fish.follow_path(route)
    elif motion.company:
        tank.swim_in_group(fish_index=None)  # all fish
    goals = motion.goals or (() if motion.goal is None else (motion.goal,))
    planned = _swim_to_goals(tank, context, goals, count_ticks_to_plan(condition.change, ticks))
    return apply_change(planned, condition.change, ticks)


def _swim_to_goals(
    tank: LiveTank, context: TrialContext, goals: Sequence[Sequence[float]], ticks: int
) -> States:
    """Let the fish of a tank swim for `ticks` ticks; return their states (ticks, fish, fields).

    Each fish swims to one goal after the other, and then wanders. goals: x, y in shares of the
    picture.
    """
    goals_given = [0] * len(tank.fish)  # how many each fish has got
    states = [_current_states(tank, context)]
    for _ in range(ticks - 1):
        for number, fish in enumerate(tank.fish):
            given = goals_given[number]
            if given < len(goals) and (fish.reached or given == 0):
                x, y = goals[given]
                tank.send_to_goal(
                    number, x * (context.tank.width - 1), y * (context.tank.height - 1)
                )
                goals_given[number] += 1
        tank.advance()
        states.append(_current_states(tank, context))
    return np.stack(states)


def plan_all_trials(context: TrialContext, protocol: Protocol, trials: Sequence[Trial]) -> States:
    """Return the planned states (ticks, fish, fields) of all trials and pauses, in order.

    They are for a page that plays by itself. FinloopError if fish react to live animals in a trial.
    """
    motions: dict[str, States] = {}
    parts: list[States] = []
    for trial in trials:
        setup = TrialSetup.from_protocol(protocol, trial)
        if setup.condition.motion.rule is not None:
            raise FinloopError(
                f"the condition {trial.condition} reacts to live animals",
                "motions that are known beforehand, for a page that plays by itself",
                'run it with `make stimulus S="show …"`, or leave this condition out',
            )
        states = motions[trial.condition] = plan_motion(context, setup, motions)
        pause = np.zeros((round(protocol.pause_s * context.rate_hz), *states.shape[1:]), np.float32)
        pause[..., [PICTURE, PARTNER]] = -1  # no fish is shown
        parts += [setup.apply_look_and_fade(states, context.rate_hz), pause]
    return np.concatenate(parts)


def warm_up_stimulus(context: TrialContext) -> None:
    """Let a fish swim unseen for 200 ticks, so that no trial waits for functions to be compiled."""
    tank, rng = LiveTank({MODE: context.player}, MODE, fish=1, seed=0), np.random.default_rng(0)
    for _ in range(_WARM_UP_TICKS):
        tank.advance()
        x, y = rng.uniform(0, context.tank.width), rng.uniform(0, context.tank.height)
        tank.send_to_goal(0, float(x), float(y))
        tank.redo_last_tick(0)
        _current_states(tank, context)


def _create_trial_tank(context: TrialContext, setup: TrialSetup) -> LiveTank:
    """Return a live tank with the fish of a trial at its first tick; FinloopError without room."""
    tank = LiveTank({MODE: context.player}, MODE, setup.fish, setup.seed)
    if len(tank.fish) < setup.fish:
        raise FinloopError(
            f"the tank has room for {len(tank.fish)} fish, and the protocol shows {setup.fish}",
            "fish that can swim clear of each other",
            "take fewer (fish), or draw them smaller (animate.fish_scale)",
        )
    return tank


def _current_states(tank: LiveTank, context: TrialContext) -> States:
    """Return the states (fish, fields) from which a page draws a tank's fish at its last tick."""
    rows = [row for fish in tank.fish if (row := fish.row_at(tank.tick)) is not None]
    return drawn_states(rows, context.bodies)


# --- motions that react


class ReactiveMotion:
    """The motion of a trial in which fish react to live animals, planned tick by tick."""

    def __init__(
        self, context: TrialContext, setup: TrialSetup, animals: LiveAnimals, keep_all: bool = True
    ) -> None:
        """Put the fish of a trial into a tank; the first tick is not planned yet.

        keep_all: whether to keep the states of all ticks, for a trial that repeats them, or only
        those of the last tick.
        """
        rule = setup.condition.motion.rule
        assert rule is not None
        self._context, self._setup, self._animals, self._rule = context, setup, animals, rule
        self._tank = _create_trial_tank(context, setup)
        self._targets: list[PlacePx | None] = [None] * len(self._tank.fish)
        fade = round(setup.fade_s * context.rate_hz)
        self._opacities = fade_opacities(context.count_ticks(setup.condition.seconds), fade)
        self._states: list[States] = []
        self._keep_all = keep_all

    @property
    def planned_states(self) -> States | None:
        """Return all planned states (ticks, fish, fields) without fading; None before the first."""
        if not self._states:
            return None
        states = np.stack(self._states)
        states[:, :, ALPHA] = 1.0
        return states

    def plan_tick(self, now_s: float) -> States:
        """Plan the next tick at a session time; return the states (fish, fields) of the fish."""
        if self._states:
            self._update_targets(now_s)
            self._tank.advance()
        if not self._keep_all:  # no later trial repeats this motion: the last tick is enough
            self._states.clear()
        self._states.append(self._states_with_look())
        return self._states[-1]

    def replan_tick(self, now_s: float) -> States | None:
        """Plan the last tick again after an animal has moved; return its states (fish, fields).

        now_s: session time. None if no fish has a new target, so nothing changes.
        """
        renewed = self._update_targets(now_s) if self._states else []
        if not renewed:
            return None
        for number in renewed:
            self._tank.redo_last_tick(number)
        self._states[-1] = self._states_with_look()
        return self._states[-1]

    def _update_targets(self, now_s: float) -> list[int]:
        """Update each fish's target by the rule; return the numbers of the fish with a new one.

        A target is new if it has moved by more than `rule.renew` body lengths, or if the fish has
        reached it and is now over `rule.renew` + 1 body lengths away. A fish without a target
        wanders. now_s: session time.
        """
        renewed, length_px = [], self._context.length_px
        renew_px = self._rule.renew * length_px
        for number, fish in enumerate(self._tank.fish):
            row = fish.row_at(self._tank.tick)
            assert row is not None
            pose = row.x_px, row.y_px, float(np.radians(row.heading_deg))
            target = find_rule_target(self._rule, pose, self._animals, now_s, self._context.tank)
            old = self._targets[number]
            if target is None or old is None:
                is_new = target is not old  # unless both are None
            else:
                has_moved = math.dist(target, old) > renew_px
                has_left = fish.reached and math.dist(target, pose[:2]) > renew_px + length_px
                is_new = has_moved or has_left
            if not is_new:
                continue
            self._targets[number] = target
            if target is None:
                self._tank.let_wander(number)
            else:
                self._tank.send_to_goal(number, *target)
            renewed.append(number)
        return renewed

    def _states_with_look(self) -> States:
        """Return the last tick's states (fish, fields) with the trial's look and its opacity."""
        states = _current_states(self._tank, self._context)
        states[:, LOOK] = self._setup.look
        states[:, ALPHA] *= self._opacities[self._tank.tick]
        return states
