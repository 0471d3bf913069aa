"""Mode `network`: neural network mode (fish paper §3, Fig. 18, Eqs. 2-4).

The flow chart asks first: will the fish turn or swim straight? For a turn, the trained network
gives the ideal motion area. The turning sprites play up to the bend nearest to it and back, and the
fish moves as in the film's turns of that angle. Otherwise the fish slides, accelerates, decelerates
or swims straight, like a phase of the film that began at the same speed, with its duration, speed
and drift. Before a wall it brakes.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from finloop.animate.kinematics import (
    StraightSwim,
    Target,
    Turning,
    bearing,
    next_aim,
    swim_ahead,
    swim_turn,
    wrap,
)
from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.state import Fish
from finloop.animate.world import World
from finloop.base.arrays import Floats, Ints
from finloop.bpn.model import MotionModel
from finloop.distance.picture import all_distances
from finloop.edit.schema import DECELERATE, PHASE, SLIDE, STATES, TURN, TURNING, WALL
from finloop.edit.stretch import Decision, Stretch
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.modes.animator import Animator, ModeAssets, make_animator
from finloop.modes.network_settings import NetworkSettings
from finloop.modes.phases import Phases, learn_phases
from finloop.modes.sprites import Sprites, TurnPlan, make_sprites, plan_turn, start_from_bend

_FASTEST_TURN = 1.5  # times the planned turn of a tick: beyond it the aim is too near to turn to


class GoalApproach(NamedTuple):
    """A fish, its goal, and the point that it heads for now (aim).

    start (3,): x, y px and heading, degrees, of the fish; error: bearing of the aim minus the
    heading, degrees, + = the aim is to the left; distance: px to the aim; far: whether the aim is
    so far away that the fish need not head exactly for it yet.
    """

    fish: Fish
    goal: Target
    aim: Target
    start: Floats
    error: float
    distance: float
    far: bool


class Network:
    """Moves sprites by the flow chart of Fig. 18: turns, straight swimming, braking.

    sprites: in cycles and turns; phases: straight swimming of the film; model: the trained network.
    """

    def __init__(
        self, world: World, sprites: Sprites, phases: Phases, model: MotionModel, p: NetworkSettings
    ) -> None:
        """Keep the arguments; sort turns by angle, and the phases after each state by speed."""
        self.world, self.sprites, self.phases, self.model, self.p = world, sprites, phases, model, p
        motion = world.motion
        self._length_px = motion.body_length_px
        self._stop_ticks = motion.delta / 2  # in which a fish stops
        turns = motion.turns
        smallest_turn = np.quantile(turns.angle_deg, p.turn_quantile)
        self._least_turn = min(smallest_turn, p.max_heading_error_deg)
        order = np.argsort(phases.first_speed, kind="stable")
        self._phases_after, self._first_speeds = {}, {}
        for state in range(len(STATES)):
            rows = order[phases.before[order] == state]
            self._phases_after[state] = rows if len(rows) else order
            self._first_speeds[state] = phases.first_speed[self._phases_after[state]]
        self._by_angle = np.argsort(turns.angle_deg, kind="stable")
        self._angles = turns.angle_deg[self._by_angle]
        self.cached_turn = lru_cache(10_000)(self._plan_rounded_turn)

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place and heading of the tank, sliding with a still tail."""
        x, y = self.world.tank.random_point(rng)
        speed = float(np.median(self.phases.first_speed))
        sprite = int(self.sprites.cycles[SLIDE][0])
        return Fish(x, y, float(rng.uniform(-180, 180)), speed, state=SLIDE, sprite=sprite)

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode for this one: it slides on, shown by a sprite."""
        if fish.row < 0:
            return fish
        sprite = int(self.sprites.cycles[SLIDE][0])
        speed = min(max(fish.speed, self.phases.low), self.phases.high)
        return Fish(fish.x, fish.y, fish.heading, speed, SLIDE, sprite, tick=fish.tick)

    def next_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch of sprites (Fig. 18): a turn, straight swimming, or braking."""
        approach = self._approach(fish, goal)
        if self.will_turn(approach):
            return self.turn_to_aim(approach, rng)
        if (straight := self.swim_straight(approach, rng)) is not None:
            return straight
        # A wall is ahead. Only a fish that does not head for its aim yet, to 1°, can turn to it.
        return self.turn_to_aim(approach, rng) if abs(approach.error) > 1 else self.brake(approach)

    def _approach(self, fish: Fish, goal: Target) -> GoalApproach:
        """Return how a fish approaches its goal: point to head for, distance, heading error."""
        near_px = self.p.arrived * self.world.touch_px
        aim = next_aim(self.world.tank, (fish.x, fish.y), goal, near_px)
        error = wrap(bearing(fish.x, fish.y, aim.x, aim.y) - fish.heading)
        distance = float(np.hypot(aim.x - fish.x, aim.y - fish.y))
        far = distance > self.p.near_goal_bl * self._length_px
        start = np.array([fish.x, fish.y, fish.heading])
        return GoalApproach(fish, goal, aim, start, error=error, distance=distance, far=far)

    def will_turn(self, approach: GoalApproach) -> bool:
        """Return whether the heading is too far off to swim straight (Fig. 18, first box).

        The fish also turns where it would pass a near goal.
        """
        error, p = approach.error, self.p
        passes_px = approach.distance * abs(np.sin(np.radians(error)))
        misses = abs(error) > 90 or passes_px > p.miss * self.world.touch_px
        return abs(error) > self._least_turn or (misses and not approach.far)

    def ideal_motion_area(self, fish: Fish, displacement: float, included_deg: float) -> float:
        """Return the relative motion area, 0-1, that the trained network gives for a turn (Eq. 4).

        fish: at the beginning of the turn; displacement: body lengths in Δ; included_deg: degrees
        by which the head turns in Δ, + = left.
        """
        # State 0: the fish swims straight before the turn.
        inputs = np.array([[fish.area, 0.0, displacement, included_deg]])
        return min(max(float(self.model.predict(inputs)[0, 0]), 0.0), 1.0)

    def _plan_rounded_turn(self, side: int, angle_deg: int, area_pct: int) -> TurnPlan:
        """Return a turn of sprites to a side, LEFT or RIGHT, by `angle_deg`.

        area_pct: relative motion area of its strongest bend, per cent. Angle and area are whole
        numbers, so that turns can be cached.
        """
        most_ticks = self.p.max_bend_hold_deltas * self.world.motion.delta
        return plan_turn(self.sprites.turns[side], angle_deg, area_pct / 100, most_ticks, self.p)

    def swim_straight(self, approach: GoalApproach, rng: np.random.Generator) -> Stretch | None:
        """Return a stretch of straight swimming, such as a slide; None if a wall is ahead.

        It is a slide, an acceleration, a deceleration or plain. It has the duration, speeds and
        drift of a random phase (straight swimming in the film) that begins at about the fish's
        speed. The heading drifts towards the aim, and beyond it while the aim is far.
        """
        motion, phases, fish = self.world.motion, self.phases, approach.fish
        # The phases, by rising first speed, that in the film, too, follow the fish's present
        # state; all phases if none does.
        following = self._phases_after[fish.state]
        nearest = int(np.searchsorted(self._first_speeds[fish.state], fish.speed))
        chosen = following[self._random_near(nearest, len(following), rng)]
        phase_ticks = slice(phases.start[chosen], phases.start[chosen] + phases.ticks[chosen])
        first_speed = phases.first_speed[chosen]
        speed = self._change_into_phase(fish.speed, first_speed, phases.speed_change[phase_ticks])
        forward = speed * (self._length_px / motion.rate_hz)
        drift = _drift_towards_aim(phases.drift_deg[phase_ticks], approach)
        swim = StraightSwim(forward, drift, brake=forward * self._stop_ticks)
        trajectory, safe_ticks, touch_tick = swim_ahead(
            self.world.tank.legal, approach.start, swim, approach.goal
        )
        if safe_ticks < min(2, len(trajectory)) and touch_tick >= safe_ticks:
            return None  # a wall is ahead, and the goal is not before it
        ticks = min(touch_tick + 1, safe_ticks)
        state = int(phases.state[chosen])
        sprites, places, is_new = self._cycle_sprites(fish, state, speed[:ticks])
        return Stretch(
            state, trajectory[:ticks], sprites, is_new, approach.aim,
            touches_goal=touch_tick < ticks,
            decision=Decision(PHASE, film_speed=float(first_speed)), phase=places,
        )  # fmt: skip

    def _change_into_phase(self, own: float, first: float, change: Floats) -> Floats:
        """Return the speeds (n,), body lengths/s, of a fish that changes into a filmed phase.

        own: its speed before; first: that of the phase; change (n,): of the phase's speed since
        then. Within Δ the fish's own speed changes into that of the phase.
        """
        own_share = np.maximum(0.0, 1 - np.arange(1, len(change) + 1) / self.world.motion.delta)
        speed = first + change + (own - first) * own_share
        return np.minimum(np.maximum(speed, self.phases.low), self.phases.high)

    def _cycle_sprites(self, fish: Fish, state: int, speeds: Floats) -> tuple[Ints, Floats, bool]:
        """Play a cycle of sprites; return their numbers (n,), places in it (n,), whether it is new.

        speeds (n,): body lengths/s; the faster the fish, the faster the cycle is played. Places are
        sprites counted from the first one, with fractions, on from round to round. A new cycle
        begins at the sprite that fits best to the one on screen.
        """
        sprites, p = self.sprites, self.p
        cycle, place_before = sprites.cycles[state], fish.phase
        is_new = fish.state == TURN or sprites.cycles[fish.state] is not cycle
        if is_new:
            place_before = float(sprites.entry[state][fish.sprite]) - 1.0
        rate = np.ones(len(speeds))
        if state != SLIDE:
            by_speed = np.sqrt(speeds / sprites.cycle_speed)
            rate = np.minimum(np.maximum(by_speed, p.min_playback_rate), p.max_playback_rate)
        places = place_before + np.cumsum(rate)
        if is_new:
            places += 1.0 - (places[0] - place_before)  # the first sprite is the one chosen
        numbers = (places + 1e-9).astype(np.int64) % len(cycle)  # a rate of 1 does not round down
        return cycle[numbers], places, is_new

    def turn_to_aim(self, approach: GoalApproach, rng: np.random.Generator) -> Stretch:
        """Return a stretch of sprites that turns towards the aim: bends, holds, straightens.

        Where there is no room, the displacement is smaller, down to a turn on the spot.
        """
        fish, sprites, turns = approach.fish, self.sprites, self.world.motion.turns
        side, angle = (LEFT if approach.error > 0 else RIGHT), abs(approach.error)
        # A filmed turn by about the angle, and the bend that the network requests for it.
        nearest = int(np.searchsorted(self._angles, angle))
        chosen = int(self._by_angle[self._random_near(nearest, len(self._angles), rng)])
        included = turns.included_angle_deg[chosen] * min(angle / turns.angle_deg[chosen], 1.0)
        area = self.ideal_motion_area(fish, turns.displacement[chosen], side * included)
        plan, new = self.cached_turn(side, round(angle), round(100 * area)), True
        if fish.is_bent:  # an earlier turn was cut short
            plan = start_from_bend(plan, sprites.turns, side, fish.sprite)
            new = plan.frames[0] not in (fish.sprite, sprites.following[fish.sprite])
        trajectory, touch_tick, room = self._fit_turn(approach, plan, chosen)
        ticks = min(touch_tick + 1, len(plan.frames))
        decision = Decision(TURNING, turn_deg=approach.error, sprite_area=plan.area, room=room)
        return Stretch(
            TURN, trajectory[:ticks], plan.frames[:ticks], new, approach.aim,
            touches_goal=touch_tick < ticks, decision=decision, area=area,
        )  # fmt: skip

    def _fit_turn(
        self, approach: GoalApproach, plan: TurnPlan, turn_number: int
    ) -> tuple[Floats, int, float]:
        """Fit a filmed turn into the tank; return trajectory, tick of touch, displacement factor.

        turn_number: of the film's turns. The trajectory (n, 3) is x, y px and heading. The tick of
        touch is the one at which the goal is touched, n if it is not. The factor is the first of
        `p.ease` with which the turn fits in. The last of them is tried again with less and less
        time in which the fish's first speed changes; the last try is taken even if it does not fit.
        """
        ease = self.p.ease
        filmed = self._stretch_filmed_turn(turn_number, len(plan.frames))
        largest_share = float(np.ediff1d(plan.share, to_begin=plan.share[:1]).max())
        fastest = _FASTEST_TURN * abs(approach.error) * largest_share  # degrees in a tick
        # Each try: ticks in which the fish's first speed changes into that of the turn, and the
        # factor of the turn's displacement, of which the smallest is 0.
        delta = self.world.motion.delta
        tries = [(delta, factor) for factor in ease] + [(2, ease[-1]), (0, ease[-1])]
        for fade_ticks, factor in tries:
            swim = self._scale_turn(filmed, plan.share, approach.fish.speed, fade_ticks, factor)
            trajectory, possible, touch_tick = swim_turn(
                self.world.tank.legal, approach.start, swim, approach.goal, approach.aim, fastest
            )
            if possible:
                break
        return trajectory, touch_tick, factor

    def _scale_turn(
        self, filmed: tuple[Floats, Floats], share: Floats, first_speed: float, fade_ticks: int,
        factor: float,
    ) -> Turning:  # fmt: skip
        """Return a filmed turn whose displacement is multiplied by `factor`.

        filmed: body lengths ahead and to the inside in each tick, (n,) each; share (n,): part of
        the turn that is done. Within `fade_ticks` the fish's first speed, body lengths/s, changes
        into that of the turn; at once if they are 0.
        """
        (forward, sideways), rate_hz = filmed, self.world.motion.rate_hz
        first_share = np.zeros(len(share))  # how much of the first speed is left
        if fade_ticks:
            first_share = np.maximum(0.0, 1 - np.arange(1, len(share) + 1) / fade_ticks)
        ahead = factor * forward + (first_speed / rate_hz - factor * forward[0]) * first_share
        forward_bl = np.minimum(np.maximum(ahead, 0.0), self.phases.high / rate_hz)
        sideways_bl = factor * sideways * (1 - first_share)
        return Turning(share, forward_bl * self._length_px, sideways_bl * self._length_px)

    def _stretch_filmed_turn(self, turn_number: int, count: int) -> tuple[Floats, Floats]:
        """Return the displacement of a filmed turn, stretched in time to `count` ticks.

        Both parts (count,) are body lengths in a tick: ahead, and to the inside of the turn.
        """
        turns = self.world.motion.turns
        start, ticks = turns.start[turn_number], turns.ticks[turn_number]
        film_tick, film_time = np.arange(ticks), np.linspace(0, ticks - 1, count)
        forward, sideways = (
            np.interp(film_time, film_tick, part[start : start + ticks])
            for part in (turns.forward, turns.sideways)
        )
        return forward, sideways

    def brake(self, approach: GoalApproach) -> Stretch:
        """Return a stretch of up to Δ that slows down before a wall, or stays in place."""
        motion, phases, fish = self.world.motion, self.phases, approach.fish
        ticks = motion.delta
        speed_factor = self.p.brake_speed_ratio ** (np.arange(1, ticks + 1) / ticks)
        speed, zeros = np.maximum(fish.speed * speed_factor, phases.low), np.zeros(ticks)
        swim = StraightSwim(speed * (self._length_px / motion.rate_hz), drift=zeros, brake=zeros)
        trajectory, safe_ticks, touch_tick = swim_ahead(
            self.world.tank.legal, approach.start, swim, approach.goal
        )
        shown = min(touch_tick + 1, safe_ticks)
        if shown == 0:  # no room for a tick: the fish stays in place
            trajectory, shown, touch_tick = np.tile(approach.start, (ticks, 1)), ticks, ticks
        sprites, places, is_new = self._cycle_sprites(fish, DECELERATE, speed[:shown])
        return Stretch(
            DECELERATE, trajectory[:shown], sprites, is_new, approach.aim,
            touches_goal=touch_tick < shown, decision=Decision(WALL), phase=places,
        )  # fmt: skip

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch of sprites that began with `fish`."""
        ticks, sprite = len(stretch.trajectory), int(stretch.number[-1])
        x, y, heading = map(float, stretch.trajectory[-1])
        before_x, before_y = stretch.trajectory[-2, :2] if ticks > 1 else (fish.x, fish.y)
        forward = np.hypot(x - before_x, y - before_y) / self._length_px
        speed = max(float(forward * self.world.motion.rate_hz), self.phases.low)
        phase = fish.phase
        if stretch.phase is not None:
            phase = float(stretch.phase[-1]) % len(self.sprites.cycles[stretch.state])
        is_bent = stretch.state == TURN and not stretch.whole
        area = float(self.sprites.area[sprite]) if is_bent else 0.0
        since = ticks if fish.row >= 0 else fish.since + ticks  # the film was left
        return Fish(
            x, y, float(wrap(heading)), speed, stretch.state, sprite, phase=phase, area=area,
            tick=fish.tick + ticks, since=since,
        )  # fmt: skip

    def _random_near(self, middle: int, count: int, rng: np.random.Generator) -> int:
        """Return a random number near `middle`, of 0 … count − 1: one of the `p.alike` nearest."""
        alike = self.p.alike
        first = max(0, min(middle - alike // 2, count - alike))
        return first + int(rng.integers(min(alike, count)))


def _drift_towards_aim(drift_deg: Floats, approach: GoalApproach) -> Floats:
    """Return the drift (n,) [°] of the heading in a phase, mirrored if it ends away from the aim.

    drift_deg (n,): as filmed, from the first tick on, + = to the left. Unless the aim is far, it is
    reduced so that it does not go beyond the aim.
    """
    factor = 1.0
    if not approach.far:
        factor = min(1.0, abs(approach.error) / max(np.abs(drift_deg).max(), 1e-9))
    return drift_deg * np.copysign(factor, approach.error * drift_deg[-1])


def network_animator(assets: ModeAssets, network: Network, p: CommonSettings) -> Animator:
    """Return the animator of mode `network`: a flow chart with a neural network (Fig. 18).

    assets: what the modes share, with sprites; network: the mode's flow chart; p: the group
    `animate` of the parameters.
    """
    return make_animator(assets, network, network.sprites, p, network.p.join)


def make_network(assets: ModeAssets, model: MotionModel, q: NetworkSettings) -> Network:
    """Return the flow chart of mode `network`, with the sprites and phases of a film.

    assets: what the modes share, with sprites; model: the trained network.
    """
    pictures, motion = assets.pictures, assets.world.motion
    pose_distances = all_distances(pictures.sprite_successors, pictures.right_facing_sprites)
    sprites = make_sprites(assets.silhouettes.sprites, pose_distances, motion.rate_hz)
    phases = learn_phases(motion, q)
    return Network(assets.world, sprites, phases, model, q)
