"""Network mode: a state machine that swims as the film does (fish paper §3, Fig. 18, Eqs. 2-4).

Turn or straight? A turn asks the trained network for the ideal motion area of the turn that is
wanted, plays the turning sprites up to that bend and back, and moves by what the film's turns of
that angle moved. Otherwise the fish slides, accelerates, decelerates or swims straight, each as
long, as fast and drifting as much as a stretch of the film that began at the same speed.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from finloop.animate import kinematics as step
from finloop.animate.arena import Tank
from finloop.animate.edit_list import SPRITE
from finloop.animate.motion import DECELERATE, SLIDE, STATES, TURN, Motion
from finloop.animate.sprites import Sprites, from_bend, plan_turn
from finloop.bpn.model import MotionModel
from finloop.features.swimming_type import LEFT, RIGHT

_ALIKE = 8  # a phase or turn is drawn from so many of the film's that are most alike
_LEAST_TURN = 0.05  # quantile of the film's turns below which an error is left to the drift
_MOST_LEFT_DEG = 20.0  # but an error above this is never left
_NEAR = 3.0  # body lengths; nearer than this the way must lead into the goal
_MISS = 0.8  # of the goal's radius; a way that passes farther from it misses
_ARRIVED = 0.3  # of the goal's radius; so near to the place before it, the goal itself is sought
_EASE = (1.0, 0.5, 0.25, 0.0)  # a turn is tried with such shares of its displacement
_HOLD = 3  # a bend is held for at most so many Δ
_SLOWER = 0.85  # per tick, where a wall is ahead
_UNBEND_DEG = 5.0  # who was stopped amid a turn goes on turning where the error is larger
_PACE = (0.7, 1.4)  # tail beats are played at least and at most so much faster than filmed


@dataclass
class Fish:
    """Where the fish is, and what it is doing. heading in degrees, speed in body lengths/s.

    sprite: the one drawn last, −1 in the film; phase: place in its cycle, in frames; area: relative
    motion area; tick: how long it has swum. In the film: row, the one drawn last, −1 for none; rot,
    by how much it is turned; since, ticks since the last jump; waits, ticks without a legal way on;
    shown, the tick of every row at
    which it was drawn last.
    """

    x: float
    y: float
    heading: float
    speed: float
    state: int
    sprite: int
    phase: float = 0.0
    area: float = 0.0
    tick: int = 0
    row: int = -1
    rot: float = 0.0
    since: int = 0
    waits: int = 0
    shown: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def bent(self) -> bool:
        """Whether it was stopped amid a turn; who has ended one is straight."""
        return self.row < 0 and self.state == TURN and self.area > 0


@dataclass(frozen=True)
class Stretch:
    """Some ticks (n,) of one state. way (n, 3): x, y px, heading deg; number (n,): of the pictures.

    target: x, y of the point it heads for; new: whether the first picture does not follow on the
    one before; area: asked of the network, NaN where it was not asked; touched: whether the last
    tick touches the goal; why: in words; kind: SPRITE or FRAME; rot (n,): by how much frames are
    turned; considered: what was weighed, as `CONSIDERED` without the tick; considered_rot: by how
    much each of it would have been turned; phase (n,): place in the cycle, in frames, where sprites
    of one are played.
    """

    state: int
    target: NDArray[np.float64]
    way: NDArray[np.float64]
    number: NDArray[np.int64]
    new: bool
    area: float
    touched: bool
    why: str
    kind: str = SPRITE
    rot: NDArray[np.float64] | None = None
    considered: tuple[tuple[int, float, float, str, bool], ...] = ()
    considered_rot: tuple[float, ...] = ()
    phase: NDArray[np.float64] | None = None


class NetworkMode:
    """The player. `touch_px`: radius of a goal; `head_px`: the head is so far before the centre."""

    def __init__(
        self, motion: Motion, sprites: Sprites, model: MotionModel, tank: Tank,
        touch_px: float, head_px: float,
    ) -> None:  # fmt: skip
        self.motion, self.sprites, self.model, self.tank = motion, sprites, model, tank
        self.touch_px, self.head_px = touch_px, head_px
        self._px = motion.body_length_px
        self._stop = motion.delta / 2  # ticks in which a fish has stopped
        phases, turns = motion.phases, motion.turns
        self._least_turn = min(np.quantile(turns.angle_deg, _LEAST_TURN), _MOST_LEFT_DEG)
        order = np.argsort(phases.first_speed, kind="stable")
        self._after = {
            before: order[phases.before[order] == before] for before in range(len(STATES))
        }
        self._after = {b: found if len(found) else order for b, found in self._after.items()}
        self._first_speeds = {b: phases.first_speed[found] for b, found in self._after.items()}
        self._by_angle = np.argsort(turns.angle_deg, kind="stable")
        self._angles = turns.angle_deg[self._by_angle]
        self._plan = lru_cache(10_000)(
            lambda side, angle, area: plan_turn(
                sprites.turns[side], angle, area / 100, _HOLD * motion.delta
            )
        )

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, gliding."""
        x, y = self.tank.random_point(rng)
        speed = float(np.median(self.motion.phases.first_speed))
        sprite = int(self.sprites.cycles[SLIDE][0])
        return Fish(x, y, float(rng.uniform(-180, 180)), speed, SLIDE, sprite)

    def stretch(
        self, fish: Fish, at: NDArray[np.float64], name: str, rng: np.random.Generator
    ) -> Stretch:
        """Swim on towards the point `at` (2,) px, and move `fish` to the end of it."""
        target = self._target(fish, at)
        start = np.array([fish.x, fish.y, fish.heading])
        error = step.wrap(step.bearing(fish.x, fish.y, *target) - fish.heading)
        far = float(np.hypot(target[0] - fish.x, target[1] - fish.y))
        missed = abs(error) > 90 or far * abs(np.sin(np.radians(error))) > _MISS * self.touch_px
        bent = fish.bent and abs(error) > _UNBEND_DEG
        if bent or abs(error) > self._least_turn or (missed and far < _NEAR * self._px):
            found = self._turn(fish, start, error, target, at, name, rng)
        else:
            found = (
                self._straight(fish, start, error, far > _NEAR * self._px, target, at, rng)
                or (abs(error) > 1 and self._turn(fish, start, error, target, at, name, rng))
                or self._brake(fish, start, target, at)
            )
        last = found.way[-1]
        before = np.vstack([start, found.way])[-2]
        fish.x, fish.y, fish.heading = last[0], last[1], step.wrap(last[2])
        moved = np.hypot(last[0] - before[0], last[1] - before[1])
        fish.speed = max(moved / self._px * self.motion.rate_hz, self.motion.low)
        fish.state, fish.sprite = found.state, int(found.number[-1])
        return found

    def _target(self, fish: Fish, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """The point to head for: the goal, or where it is nearest, or what is in sight of that."""
        legal = self.tank.into(*at)
        near = np.hypot(legal[0] - fish.x, legal[1] - fish.y) < _ARRIVED * self.touch_px
        return at if near else np.array(self.tank.waypoint(fish.x, fish.y, *legal))

    def _straight(
        self, fish: Fish, start: NDArray[np.float64], error: float, far: bool,
        target: NDArray[np.float64], at: NDArray[np.float64], rng: np.random.Generator,
    ) -> Stretch | None:  # fmt: skip
        """A phase of the film's straight swimming; None where a wall is ahead.

        It drifts towards the target; `far` from it beyond, too, as a fish does.
        """
        motion, phases = self.motion, self.motion.phases
        place = int(np.searchsorted(self._first_speeds[fish.state], fish.speed))
        chosen = self._after[fish.state][_window(place, len(self._after[fish.state]), rng)]
        ticks = slice(phases.start[chosen], phases.start[chosen] + phases.ticks[chosen])
        first = phases.first_speed[chosen]
        ease = np.maximum(0.0, 1 - np.arange(1, phases.ticks[chosen] + 1) / motion.delta)
        speed = first + phases.speed_change[ticks] + (fish.speed - first) * ease
        speed = np.clip(speed, motion.low, motion.high)
        forward = speed * (self._px / motion.rate_hz)
        drift = phases.drift_deg[ticks]
        most = 1.0 if far else min(1.0, abs(error) / max(np.abs(drift).max(), 1e-9))
        drift = drift * np.copysign(most, error * drift[-1])
        way, good, touched = step.straight(
            self.tank.legal, start, forward, drift, forward * self._stop, self.head_px, at,
            self.touch_px,
        )  # fmt: skip
        if good < min(2, len(way)) and touched >= good:
            return None
        n = min(touched + 1, good)
        state = int(phases.state[chosen])
        sprite, phase, new = self._cycle(fish, state, speed[:n])
        why = f"like a stretch of the film from {phases.first_speed[chosen]:.1f} body lengths/s on"
        return Stretch(state, target, way[:n], sprite, new, np.nan, touched < n, why, phase=phase)

    def _cycle(
        self, fish: Fish, state: int, speed: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], bool]:
        """Frames of a state's cycle for ticks at such speeds, places in it, whether it is new."""
        cycle = self.sprites.cycles[state]
        new = fish.state == TURN or self.sprites.cycles[fish.state] is not cycle
        if new:
            fish.phase = float(self.sprites.entry[state][fish.sprite]) - 1.0
        pace = np.ones(len(speed))
        if state != SLIDE:
            pace = np.clip(np.sqrt(speed / self.sprites.cycle_speed), *_PACE)
        phase = fish.phase + np.cumsum(pace)
        if new:
            phase += 1.0 - (phase[0] - fish.phase)  # the first frame is the one chosen
        fish.phase, fish.area = float(phase[-1]) % len(cycle), 0.0
        return cycle[(phase + 1e-9).astype(np.int64) % len(cycle)], phase, new

    def _turn(
        self, fish: Fish, start: NDArray[np.float64], error: float, target: NDArray[np.float64],
        at: NDArray[np.float64], name: str, rng: np.random.Generator,
    ) -> Stretch:  # fmt: skip
        """In, hold, out; less far where there is no room, on the spot where there is none."""
        motion, turns = self.motion, self.motion.turns
        side, angle = (LEFT if error > 0 else RIGHT), abs(error)
        place = int(np.searchsorted(self._angles, angle))
        chosen = self._by_angle[_window(place, len(self._angles), rng)]
        included = turns.included_angle_deg[chosen] * min(angle / turns.angle_deg[chosen], 1.0)
        asked = [[fish.area, 0.0, turns.displacement[chosen], side * included]]
        area = float(np.clip(self.model.predict(np.array(asked))[0, 0], 0.0, 1.0))
        plan, new = self._plan(side, round(angle), round(100 * area)), True
        if fish.bent:
            plan = from_bend(plan, self.sprites.turns, side, fish.sprite)
            new = plan.frames[0] not in (fish.sprite, self.sprites.following[fish.sprite])
        n = len(plan.frames)
        film = slice(turns.start[chosen], turns.start[chosen] + turns.ticks[chosen])
        at_tick = np.linspace(0, turns.ticks[chosen] - 1, n)
        ticks = np.arange(turns.ticks[chosen])
        forward = np.interp(at_tick, ticks, turns.forward[film])
        sideways = np.interp(at_tick, ticks, turns.sideways[film])
        fastest = 1.5 * angle * float(np.diff(plan.share, prepend=0.0).max())
        since = np.arange(1, n + 1)
        for stop in (motion.delta, 2, 0):
            fade = np.maximum(0.0, 1 - since / stop) if stop else np.zeros(n)
            for ease in _EASE if stop == motion.delta else _EASE[-1:]:
                ahead = ease * forward + (fish.speed / motion.rate_hz - ease * forward[0]) * fade
                way, good, touched = step.turn(
                    self.tank.legal, start, plan.share,
                    np.clip(ahead, 0.0, motion.high / motion.rate_hz) * self._px,
                    ease * sideways * (1 - fade) * self._px,
                    self.head_px, at, self.touch_px, target, fastest,
                )  # fmt: skip
                if good:
                    break
            if good:
                break
        n = min(touched + 1, n)
        fish.area = 0.0
        why = (
            f"turn {'left' if side == LEFT else 'right'} {angle:.0f}° towards {name or 'a place'}: "
            f"the network asks for motion area {area:.2f}, the sprites have {plan.area:.2f}"
            + ("" if ease == 1 else ", little room" if ease else ", on the spot")
        )
        return Stretch(TURN, target, way[:n], plan.frames[:n], new, area, touched < n, why)

    def _brake(
        self, fish: Fish, start: NDArray[np.float64], target: NDArray[np.float64],
        at: NDArray[np.float64],
    ) -> Stretch:  # fmt: skip
        """Slow down before a wall."""
        ticks = self.motion.delta
        speed = np.maximum(fish.speed * _SLOWER ** np.arange(1, ticks + 1), self.motion.low)
        forward = speed * (self._px / self.motion.rate_hz)
        way, good, touched = step.straight(
            self.tank.legal, start, forward, np.zeros(ticks), np.zeros(ticks), self.head_px, at,
            self.touch_px,
        )  # fmt: skip
        n = min(touched + 1, good)
        if n == 0:  # at the wall: stay, and wait
            way, n, touched = np.tile(start, (ticks, 1)), ticks, ticks
        sprite, phase, new = self._cycle(fish, DECELERATE, speed[:n])
        why = "a wall is ahead"
        return Stretch(
            DECELERATE, target, way[:n], sprite, new, np.nan, touched < n, why, phase=phase
        )


def _window(place: int, count: int, rng: np.random.Generator) -> int:
    """One of the `_ALIKE` numbers below `count` nearest to a place, all equally likely."""
    first = max(0, min(place - _ALIKE // 2, count - _ALIKE))
    return first + int(rng.integers(min(_ALIKE, count)))
