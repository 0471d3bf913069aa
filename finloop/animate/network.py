"""Network mode: a state machine that swims as the film does (fish paper §3, Fig. 18, Eqs. 2-4).

Turn or straight? A turn asks the trained network for the ideal motion area of the turn that is
wanted, plays the turning sprites up to that bend and back, and moves by what the film's turns of
that angle moved. Otherwise the fish slides, accelerates, decelerates or swims straight, each as
long, as fast and drifting as much as a stretch of the film that began at the same speed.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from finloop.animate import kinematics as step
from finloop.animate.company import clear_ticks, round_others
from finloop.animate.kinematics import Ahead, Spot, Turning
from finloop.animate.sprites import TurnPlan, from_bend, plan_turn
from finloop.animate.state import Fish, Waters
from finloop.base.arrays import Floats, Ints
from finloop.bpn.model import MotionModel
from finloop.edit.schema import DECELERATE, PHASE, SLIDE, STATES, TURN, TURNING, WAITING, WALL
from finloop.edit.stretch import Decision, Stretch
from finloop.features.swimming_type import LEFT, RIGHT


class Course(NamedTuple):
    """A fish, its goal, and the point that it heads for now.

    start: x, y, heading; error: of the heading against the aim, degrees, + = the aim is to the
    left; far: whether the aim is so far away that the course need not lead into it yet.
    """

    fish: Fish
    goal: Spot
    aim: Spot
    start: Floats
    error: float
    far: bool


class SpriteSwimmer:
    """Swims by sprites."""

    def __init__(self, waters: Waters, model: MotionModel) -> None:
        self.waters, self.model = waters, model
        motion, settings = waters.motion, waters.settings
        self._px = motion.body_length_px
        self._stop = motion.delta / 2  # ticks in which a fish has stopped
        phases, turns = motion.phases, motion.turns
        least = np.quantile(turns.angle_deg, settings.turn_quantile)
        self._least_turn = min(least, settings.turn_least_deg)
        order = np.argsort(phases.first_speed, kind="stable")
        after = {before: order[phases.before[order] == before] for before in range(len(STATES))}
        self._after = {before: rows if len(rows) else order for before, rows in after.items()}
        self._first_speeds = {b: phases.first_speed[rows] for b, rows in self._after.items()}
        self._by_angle = np.argsort(turns.angle_deg, kind="stable")
        self._angles = turns.angle_deg[self._by_angle]
        self.plan = lru_cache(10_000)(self._plan)

    def _plan(self, side: int, angle_deg: int, area_pct: int) -> TurnPlan:
        settings = self.waters.settings
        most = settings.hold * self.waters.motion.delta
        turn = self.waters.sprites.turns[side]
        return plan_turn(turn, angle_deg, area_pct / 100, most, settings)

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, gliding."""
        x, y = self.waters.tank.random_point(rng)
        speed = float(np.median(self.waters.motion.phases.first_speed))
        sprite = int(self.waters.sprites.cycles[SLIDE][0])
        return Fish(x, y, float(rng.uniform(-180, 180)), speed, SLIDE, sprite)

    def figure18(self, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
        """Fig. 18, playing in network mode: turn, or swim straight, towards the goal."""
        settings = self.waters.settings
        aim = self.waters.aim(fish, goal, settings.arrived * self.waters.touch_px)
        beside = round_others(fish.company, (fish.x, fish.y), aim[:2], self._px)
        if beside != aim[:2]:
            x, y = self.waters.tank.into(*beside)
            aim = aim._replace(x=x, y=y)
        error = step.wrap(step.bearing(fish.x, fish.y, aim.x, aim.y) - fish.heading)
        distance = float(np.hypot(aim.x - fish.x, aim.y - fish.y))
        far = distance > settings.near * self._px
        start = np.array([fish.x, fish.y, fish.heading])
        course = Course(fish, goal, aim, start, error, far)
        beside = distance * abs(np.sin(np.radians(error)))
        misses = abs(error) > 90 or beside > settings.miss * self.waters.touch_px
        bent = fish.bent and abs(error) > settings.unbend_deg
        near = distance < settings.near * self._px
        if bent or abs(error) > self._least_turn or (misses and near):
            return self._turn(course, rng)
        return (
            self._straight(course, rng)
            or (self._turn(course, rng) if abs(error) > 1 else None)
            or self._brake(course)
        )

    def _straight(self, course: Course, rng: np.random.Generator) -> Stretch | None:
        """A phase of the film's straight swimming; None where a wall is ahead.

        It drifts towards the aim; far from it beyond, too, as a fish does.
        """
        motion, phases, fish = self.waters.motion, self.waters.motion.phases, course.fish
        place = int(np.searchsorted(self._first_speeds[fish.state], fish.speed))
        rows = self._after[fish.state]
        chosen = rows[self._alike(place, len(rows), rng)]
        ticks = slice(phases.start[chosen], phases.start[chosen] + phases.ticks[chosen])
        first = phases.first_speed[chosen]
        ease = np.maximum(0.0, 1 - np.arange(1, phases.ticks[chosen] + 1) / motion.delta)
        speed = first + phases.speed_change[ticks] + (fish.speed - first) * ease
        speed = np.minimum(np.maximum(speed, motion.low), motion.high)
        forward = speed * (self._px / motion.rate_hz)
        drift = phases.drift_deg[ticks]
        most = 1.0
        if not course.far:
            most = min(1.0, abs(course.error) / max(np.abs(drift).max(), 1e-9))
        drift = drift * np.copysign(most, course.error * drift[-1])
        way, good, touched = step.straight(
            self.waters.tank.legal, course.start, Ahead(forward, drift, forward * self._stop),
            course.goal,
        )  # fmt: skip
        good = min(good, self._clear_ticks(fish, way))
        if good < min(2, len(way)) and touched >= good:
            return None
        n = min(touched + 1, good)
        state = int(phases.state[chosen])
        sprite, phase, new = self._cycle(fish, state, speed[:n])
        decision = Decision(PHASE, film_speed=float(first))
        return Stretch(state, way[:n], sprite, new, course.aim, touched < n, decision, phase=phase)

    def _cycle(self, fish: Fish, state: int, speed: Floats) -> tuple[Ints, Floats, bool]:
        """Frames of a state's cycle for ticks at such speeds, places in it, whether it is new."""
        sprites, settings = self.waters.sprites, self.waters.settings
        cycle, begins = sprites.cycles[state], fish.phase
        new = fish.state == TURN or sprites.cycles[fish.state] is not cycle
        if new:
            begins = float(sprites.entry[state][fish.sprite]) - 1.0
        pace = np.ones(len(speed))
        if state != SLIDE:
            faster = np.sqrt(speed / sprites.cycle_speed)
            pace = np.minimum(np.maximum(faster, settings.pace_low), settings.pace_high)
        phase = begins + np.cumsum(pace)
        if new:
            phase += 1.0 - (phase[0] - begins)  # the first frame is the one chosen
        return cycle[(phase + 1e-9).astype(np.int64) % len(cycle)], phase, new

    def _turn(self, course: Course, rng: np.random.Generator) -> Stretch:
        """In, hold, out; less far where there is no room, on the spot where there is none."""
        fish, sprites = course.fish, self.waters.sprites
        side, angle = (LEFT if course.error > 0 else RIGHT), abs(course.error)
        turns = self.waters.motion.turns
        place = int(np.searchsorted(self._angles, angle))
        chosen = int(self._by_angle[self._alike(place, len(self._angles), rng)])
        included = turns.included_angle_deg[chosen] * min(angle / turns.angle_deg[chosen], 1.0)
        inputs = np.array([[fish.area, 0.0, turns.displacement[chosen], side * included]])
        area = min(max(float(self.model.predict(inputs)[0, 0]), 0.0), 1.0)
        plan, new = self.plan(side, round(angle), round(100 * area)), True
        if fish.bent:
            plan = from_bend(plan, sprites.turns, side, fish.sprite)
            new = plan.frames[0] not in (fish.sprite, sprites.following[fish.sprite])
        way, touched, room = self._room(course, plan, chosen)
        n = min(touched + 1, len(plan.frames))
        decision = Decision(TURNING, turn_deg=course.error, sprite_area=plan.area, room=room)
        return Stretch(
            TURN, way[:n], plan.frames[:n], new, course.aim, touched < n, decision, area=area
        )

    def _room(self, course: Course, plan: TurnPlan, chosen: int) -> tuple[Floats, int, float]:
        """The way of a turn with as much of a film's turn's displacement as there is room for.

        The way, the tick at which the goal is touched, and the share of the displacement. A turn
        that begins fast is tried to stop sooner and sooner.
        """
        motion, turns = self.waters.motion, self.waters.motion.turns
        ease, n = self.waters.settings.ease, len(plan.frames)
        film = slice(turns.start[chosen], turns.start[chosen] + turns.ticks[chosen])
        at_tick = np.linspace(0, turns.ticks[chosen] - 1, n)
        ticks = np.arange(turns.ticks[chosen])
        forward = np.interp(at_tick, ticks, turns.forward[film])
        sideways = np.interp(at_tick, ticks, turns.sideways[film])
        most = float(np.ediff1d(plan.share, to_begin=plan.share[:1]).max())
        fastest = 1.5 * abs(course.error) * most
        since, speed = np.arange(1, n + 1), course.fish.speed / motion.rate_hz
        tries = [(motion.delta, share) for share in ease] + [(2, ease[-1]), (0, ease[-1])]
        for stop, share in tries:
            fade = np.maximum(0.0, 1 - since / stop) if stop else np.zeros(n)
            ahead = share * forward + (speed - share * forward[0]) * fade
            swim = Turning(
                plan.share,
                np.minimum(np.maximum(ahead, 0.0), motion.high / motion.rate_hz) * self._px,
                share * sideways * (1 - fade) * self._px,
            )
            way, good, touched = step.turn(
                self.waters.tank.legal, course.start, swim, course.goal, course.aim, fastest
            )
            done = way[: touched + 1]
            if good and self._clear_ticks(course.fish, done) == len(done):
                break
        return way, touched, share

    def _brake(self, course: Course) -> Stretch:
        """Slow down before a wall."""
        motion, fish = self.waters.motion, course.fish
        ticks = motion.delta
        speed = fish.speed * self.waters.settings.brake ** (np.arange(1, ticks + 1) / ticks)
        speed = np.maximum(speed, motion.low)
        none = np.zeros(ticks)
        way, good, touched = step.straight(
            self.waters.tank.legal, course.start,
            Ahead(speed * (self._px / motion.rate_hz), none, none), course.goal,
        )  # fmt: skip
        clear = self._clear_ticks(fish, way)
        decision = Decision(WAITING if clear < good else WALL)
        n = min(touched + 1, good, clear)
        if n == 0:
            return replace(self.stay(fish, course.aim), decision=decision)
        sprite, phase, new = self._cycle(fish, DECELERATE, speed[:n])
        return Stretch(
            DECELERATE, way[:n], sprite, new, course.aim, touched < n, decision, phase=phase
        )

    def stay(self, fish: Fish, aim: Spot) -> Stretch:
        """At a wall, or before other fish: stay, and wait."""
        ticks = self.waters.motion.delta
        way = np.tile([fish.x, fish.y, fish.heading], (ticks, 1))
        slower = self.waters.settings.brake ** (np.arange(1, ticks + 1) / ticks)
        speed = np.maximum(fish.speed * slower, self.waters.motion.low)
        sprite, phase, new = self._cycle(fish, DECELERATE, speed)
        return Stretch(DECELERATE, way, sprite, new, aim, False, Decision(WALL), phase=phase)

    def _clear_ticks(self, fish: Fish, way: Floats) -> int:
        """Ticks of a way (n, 3) that meet no other fish, about: as the picture on screen would."""
        numbers = np.full(len(way), fish.picture)
        return clear_ticks(fish.company, numbers, way, fish.tick)

    def _alike(self, place: int, count: int, rng: np.random.Generator) -> int:
        """One of the `alike` numbers below `count` nearest to a place, all equally likely."""
        alike = self.waters.settings.alike
        first = max(0, min(place - alike // 2, count - alike))
        return first + int(rng.integers(min(alike, count)))
