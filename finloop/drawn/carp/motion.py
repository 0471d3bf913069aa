"""Simulate the motion of all drawn carp from a seed: C-turns, cruising, gliding, bursts.

Units are those of `drawn.carp.midline`, times in seconds. A fish is a point (its mass centre) with
an axis. The axis turns in C-turns (in, hold, out) and the point moves along it: thrust follows the
tail beat, drag the square of the speed, side-slip dies within a fraction of a second.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats

STEP_S = 0.01  # integration steps are at most this long

# Kinematics of a calm carp: tail amplitude about 0.1 L, one wave on the body, 0.65 L a beat.
STRIDE = 0.65  # body lengths per beat at full amplitude and steady speed
DRAG = 0.42  # per body length: glide speed is v0 / (1 + DRAG v0 t)
SLIP_S = 0.12  # side-slip dies with this time constant
REACH = 0.66  # no part of a fish is farther than this from its mass centre, however it bends
FISH_GAP = 0.10  # two fish keep at least this between their hulls

# Least bend and head turn rate that the eye distinguishes from straight swimming.
VISIBLE_BEND = math.radians(9.0)
VISIBLE_RATE = math.radians(28.0)

STRAIGHT = ("cruise", "glide", "burst")

Rectangle = tuple[float, float, float, float]
"""Where mass centres may be: x0, y0, x1, y1."""


@dataclass(frozen=True)
class CarpMotion:
    """The poses of all drawn carp in all frames; arrays are (frames, fish)."""

    # x, y: mass centre of the midline, body lengths from the picture's upper left pixel centre
    x: Floats
    y: Floats
    axis: Floats  # direction of the body's mean tangent, radians
    beat: Floats  # phase of the tail beat, cycles
    amplitude: Floats  # of the tail beat, 1 = cruising
    bend: Floats  # the C-bend, tangent at the head minus at the tail, radians
    ripple: Floats  # (frames, fish, 2) small random curvature
    fins: Floats  # opening of the left and right pectoral fin, (frames, fish, 2), 0-1
    swimming_type: NDArray[np.int8]  # 0 straight, 1 left, -1 right


def allowed_rectangle(width_px: int, height_px: int, body_length_px: float) -> Rectangle:
    """Return the rectangle of a tank in which mass centres may be: x0, y0, x1, y1, body lengths.

    x1 < x0 or y1 < y0 if the tank is too small.
    """
    edge = REACH + 5 / body_length_px
    return (
        edge,
        edge,
        (width_px - 1) / body_length_px - edge,
        (height_px - 1) / body_length_px - edge,
    )


def simulate_swimming(
    frames: int,
    fish: int,
    room: Rectangle,
    frame_rate_hz: float,
    fins: float,
    rng: np.random.Generator,
) -> CarpMotion:
    """Return simulated poses of all fish in all frames; a longer film begins like a shorter one.

    frames, fish: numbers of both; room: where mass centres may be; fins: share of the time in which
    the pectoral fins are open, 0-1; rng: source of chance.
    """
    # Steps of equal length in a frame, and a generator for each fish and for the starting places.
    steps = max(1, math.ceil(1 / (frame_rate_hz * STEP_S)))
    dt = 1 / (frame_rate_hz * steps)
    *fish_rngs, places_rng = rng.spawn(fish + 1)
    swimmers = []
    for place, fish_rng in zip(_starting_places(fish, room, places_rng), fish_rngs, strict=True):
        direction = float(fish_rng.uniform(-math.pi, math.pi))
        swimmers.append(Swimmer(*place, direction, room, fins, fish_rng))
    others = [[other for other in swimmers if other is not swimmer] for swimmer in swimmers]
    scalars = np.zeros((7, frames, fish))  # one layer for each scalar field of `CarpMotion`
    ripple, fin_opening = np.zeros((frames, fish, 2)), np.zeros((frames, fish, 2))
    for frame in range(frames):
        for i, swimmer in enumerate(swimmers):
            scalars[:, frame, i] = (
                swimmer.x, swimmer.y, swimmer.axis, swimmer.beat, swimmer.amplitude, swimmer.bend,
                swimmer.swimming_type,
            )  # fmt: skip
            ripple[frame, i], fin_opening[frame, i] = swimmer.ripple, swimmer.fins
        for _ in range(steps):
            for swimmer, its_others in zip(swimmers, others, strict=True):
                swimmer.advance(its_others, dt)
    x, y, axis, beat, amplitude, bend, kind = scalars
    swimming_type = kind.astype(np.int8)
    return CarpMotion(
        x, y, axis, beat, amplitude, bend,
        ripple=ripple, fins=fin_opening, swimming_type=swimming_type,
    )  # fmt: skip


def _starting_places(
    fish: int, room: Rectangle, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return a starting position (x, y) for each fish in a room, in body lengths.

    The first is random. Each other is, of 400 random places, the one whose nearest starting place
    is farthest away.
    """
    places: list[tuple[float, float]] = []
    for _ in range(fish):
        x, y = rng.uniform(room[0], room[2], 400), rng.uniform(room[1], room[3], 400)
        chosen = 0
        if places:
            gaps = np.hypot(*(np.stack([x, y], axis=1)[:, None] - places).transpose(2, 0, 1))
            chosen = int(gaps.min(axis=1).argmax())
        places.append((float(x[chosen]), float(y[chosen])))
    return places


def _smoothstep(x: float) -> float:
    """Return the cubic smooth step: 0 for x below 0, 1 for x above 1."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


def bend_in_turn(tau: float) -> float:
    """Return how bent the body is (0 to 1 to 0) after a share `tau` (0-1) of a C-turn's time."""
    # It bends up to 0.36, holds, and straightens from 0.50 to 0.96.
    return _smoothstep(tau / 0.36) - _smoothstep((tau - 0.50) / 0.46)


def angle_share_in_turn(tau: float) -> float:
    """Return the share (0-1) of a turn's angle reached after a share `tau` of its time."""
    return _smoothstep((tau - 0.06) / 0.94)


def _distance_to_edge(x: float, y: float, angle: float, room: Rectangle) -> float:
    """Return the distance from (x, y) along `angle` to the edge of a rectangle, in body lengths.

    angle: radians anticlockwise, y points down. It is 0 if the place is outside, beyond that edge.
    """
    x_ahead, y_ahead = math.cos(angle), -math.sin(angle)
    distance = math.inf
    for place, ahead, low, high in ((x, x_ahead, room[0], room[2]), (y, y_ahead, room[1], room[3])):
        if abs(ahead) > 1e-9:
            distance = min(distance, ((high if ahead > 0 else low) - place) / ahead)
    return max(distance, 0.0)


class Swimmer:
    """A simulated carp; `advance` moves it by one time step.

    x, y: mass centre; axis: direction, radians; room: where the mass centre may be; fins: share of
    the time in which the pectoral fins are open; rng: source of chance.
    """

    def __init__(
        self,
        x: float,
        y: float,
        axis: float,
        room: Rectangle,
        fins: float,
        rng: np.random.Generator,
    ) -> None:
        """Start to cruise or to glide at a position and in a direction."""
        self.x, self.y, self.axis = x, y, axis
        self.room, self.fins_share, self.rng = room, fins, rng
        self.speed, self.slip = 0.7, 0.0
        self.beat, self.rate, self.amplitude = float(rng.random()), 1.6, 0.8
        self.bend = 0.0
        self.ripple = [0.0, 0.0]
        self.drift = 0.0  # slow meander of straight swimming, radians a second
        self.fins = [0.0, 0.0]
        self.fins_open = bool(rng.random() < fins)
        self.fins_remaining_s = self._random_fin_time()
        self.mode, self.remaining_s, self.duration_s = "cruise", 0.0, 1.0
        self.target_rate, self.target_amplitude = 1.6, 0.8
        self.angle, self.peak = 0.0, 0.0
        self.back_s = 0.0  # remaining time of swimming backwards, out of a corner
        self.rest_s = 0.0  # time until the next turn may begin
        self.net_turn = 0.0  # decaying sum of recent turns: a fish does not circle one way
        self.swimming_type, self.turn_over = 0, False
        self._begin_straight(str(rng.choice(STRAIGHT[:2])))

    def _begin_straight(self, mode: str) -> None:
        """Begin to swim straight: "cruise", "glide" or "burst"."""
        # Ranges of the duration [s], and of the tail beat: rate [beats/s] and amplitude.
        seconds, rates, amplitudes = {
            "cruise": ((1.2, 3.2), (1.3, 2.1), (0.7, 1.0)),
            "glide": ((0.8, 2.0), (0.7, 1.0), (0.05, 0.16)),
            "burst": ((0.5, 1.0), (2.9, 3.7), (1.0, 1.2)),
        }[mode]
        self.mode = mode
        self.remaining_s = self.duration_s = float(self.rng.uniform(*seconds))
        self.target_rate = float(self.rng.uniform(*rates))
        self.target_amplitude = float(self.rng.uniform(*amplitudes))

    def _begin_turn(self, angle: float) -> None:
        """Begin a C-turn by `angle`, radians, + left; a wider turn is faster and more bent.

        The constants are chosen by eye: a turn by 180° takes about 1.1 s.
        """
        size = abs(angle)
        self.mode, self.angle = "turn", angle
        self.net_turn = 0.75 * self.net_turn + angle  # of recent turns: no fish circles one way
        self.duration_s = float((0.36 + 0.76 * size / math.pi) * self.rng.uniform(0.85, 1.25))
        self.remaining_s = self.duration_s
        self.peak = math.copysign(  # the greatest bend, radians
            (math.radians(17) + 0.66 * size) * float(self.rng.uniform(0.85, 1.15)), angle
        )
        self.target_rate, self.target_amplitude = 1.2, 0.15  # of the tail beat

    def _pick_turn(self, others: Sequence["Swimmer"], sharp: bool) -> float | None:
        """Return the angle of a good turn into open water, radians, + left; None if there is none.

        others: the other fish; sharp: whether wide angles are welcome, because something is near.
        Of 28 random angles the one with the best score is taken: room ahead, distance from other
        fish and chance count for it; its size, and turning the same way again, against it.
        """
        best, best_angle = -math.inf, None
        for size in self.rng.uniform(math.radians(30), math.radians(150), 14):
            for angle in (size, -size):
                # About the place at which the turn ends, and the free water [BL] from there on. The
                # time of the turn is the mean of that in `_begin_turn`.
                path = 0.5 * self.speed * (0.36 + 0.76 * size / math.pi)
                x = self.x + path * (math.cos(self.axis) + math.cos(self.axis + angle)) / 2
                y = self.y - path * (math.sin(self.axis) + math.sin(self.axis + angle)) / 2
                free = _distance_to_edge(x, y, self.axis + angle, self.room)
                gap = min((_closest_approach(self, other, angle) for other in others), default=9.0)
                score = min(free, 3.5) + 1.5 * min(gap, 2.5) + float(self.rng.uniform(0, 1.5))
                score -= 0.25 * size if sharp else 0.6 * size
                score -= 0.45 * max(self.net_turn * math.copysign(1.0, angle), 0.0)
                if not sharp and (free < 1.6 or gap < 1.6):
                    continue
                if score > best:
                    best, best_angle = score, angle
        return best_angle

    def _choose_motion(self, others: Sequence["Swimmer"], dt: float) -> None:
        """Begin another kind of motion if the present one ends, or a wall or a fish is near.

        others: the other fish; dt: seconds since the last call. Distances [body lengths], chances
        and times are chosen by eye, after a calm carp.
        """
        self.remaining_s -= dt
        self.rest_s -= dt
        # A turn is not interrupted; after it, the fish rests from turning.
        if self.mode == "turn":
            if self.remaining_s <= 0:
                self.rest_s = 0.35
                self._begin_straight("burst" if self.rng.random() < 0.25 else "cruise")
            return
        wall_distance = _distance_to_edge(self.x, self.y, self.axis, self.room)
        # A turn needs a circle of REACH: within it the fish touches no other, however it bends.
        may_turn = self.rest_s <= 0 and all(_spare_gap(self, other, REACH) > 0 for other in others)
        if self.rest_s <= 0:
            fish_distance = min(
                (_closest_approach(self, other, 0.0) for other in others), default=9.0
            )
            if wall_distance < 0.35 + 0.55 * self.speed or fish_distance < 0.95:
                angle = self._pick_turn(others, sharp=True) if may_turn else None
                if angle is not None:
                    self._begin_turn(angle)
                    return
                if self.speed < 0.35:
                    self.back_s = 0.5  # s in which it swims backwards
        if self.remaining_s <= 0:
            self._begin_at_random(others, may_turn, wall_distance)

    def _begin_at_random(
        self, others: Sequence["Swimmer"], may_turn: bool, wall_distance: float
    ) -> None:
        """Begin a kind of motion at random: glide, turn, burst or cruise.

        A fish that glides already turns instead of gliding again. It cruises in place of a turn
        that may not begin or finds no angle, and of a burst within 2.5 body lengths of the wall.
        others: the other fish; may_turn: whether a turn may begin; wall_distance: straight on, body
        lengths.
        """
        chance = float(self.rng.random())
        if self.mode != "glide" and chance < 0.35:
            self._begin_straight("glide")
        elif chance < 0.80:
            angle = self._pick_turn(others, sharp=False) if may_turn else None
            if angle is None:
                self._begin_straight("cruise")
            else:
                self._begin_turn(angle)
        elif chance < 0.92 and wall_distance > 2.5:
            self._begin_straight("burst")
        else:
            self._begin_straight("cruise")

    def _random_fin_time(self) -> float:
        """Return a random time [s] until the pectoral fins open or close; inf if they never do.

        If they never do, `fins_open` is set, for good. Open fins close after 1.3 s on average.
        """
        share = self.fins_share
        if share <= 0 or share >= 1:
            self.fins_open = share >= 1
            return math.inf
        # Closed fins wait for so long that fins are open for `share` of the time.
        mean = 1.3 if self.fins_open else 1.3 * (1 - share) / share
        return float(mean * self.rng.uniform(0.5, 1.5))

    def advance(self, others: Sequence["Swimmer"], dt: float) -> None:
        """Advance the fish by `dt` seconds: choose its motion, bend, turn, beat, move."""
        self._choose_motion(others, dt)
        axis_before = self.axis
        is_late = self.mode == "turn" and self.remaining_s < 0.3 * self.duration_s  # its last part
        self._turn(dt, is_late)
        self._beat_tail(dt, is_late)
        self._move(self.axis - axis_before, others, dt)
        self._move_fins(dt)

    def _turn(self, dt: float, is_late: bool) -> None:
        """Bend the body and turn its axis for `dt` s; set the visible swimming type.

        is_late: whether the fish is in the last part of a turn.
        """
        bend_before, axis_before = self.bend, self.axis
        if self.mode == "turn":
            tau = 1 - max(self.remaining_s, 0.0) / self.duration_s
            self.bend = self.peak * bend_in_turn(tau)
            share = angle_share_in_turn(tau) - angle_share_in_turn(tau - dt / self.duration_s)
            self.axis += self.angle * share
            self.drift = 0.0
        else:
            self.bend = 0.0
            # A slow meander: random turns of 6.5° per √s that fade within 1.2 s.
            noise = float(self.rng.standard_normal())
            self.drift += dt * -self.drift / 1.2 + math.radians(6.5) * math.sqrt(dt) * noise
            self.axis += self.drift * dt
        # The head turns with the axis, and by about a third of the bend.
        head_rate = (self.axis - axis_before + 0.35 * (self.bend - bend_before)) / dt
        visible = abs(self.bend) > VISIBLE_BEND or abs(head_rate) > VISIBLE_RATE
        if self.mode == "turn" and visible and not self.turn_over:
            self.swimming_type = int(math.copysign(1, self.angle))
        else:
            self.swimming_type = 0
            # Late in a turn the body only straightens: what is invisible then stays so.
            self.turn_over = is_late

    def _beat_tail(self, dt: float, is_late: bool) -> None:
        """Beat the tail for `dt` seconds; rate and amplitude approach their targets.

        is_late: whether the fish is in the last part of a turn, when it speeds up.
        """
        rate, amplitude = (2.2, 0.8) if is_late else (self.target_rate, self.target_amplitude)
        self.rate += (rate - self.rate) * dt / 0.18
        self.amplitude += (amplitude - self.amplitude) * dt / 0.20
        self.beat += self.rate * dt
        for i in range(2):  # small random bends that fade within 0.4 s
            noise = float(self.rng.standard_normal())
            self.ripple[i] += dt * -self.ripple[i] / 0.4 + 0.11 * math.sqrt(dt) * noise

    def _move(self, turn: float, others: Sequence["Swimmer"], dt: float) -> None:
        """Update speed and position after `dt` seconds, in which the axis turned by `turn` radians.

        Thrust pulses twice a beat; a bent body and open fins brake.
        """
        # Thrust and drag balance at a speed of STRIDE body lengths a beat at full amplitude.
        thrust = DRAG * (STRIDE * self.rate * self.amplitude) ** 2
        thrust *= 1 + 0.5 * math.sin(4 * math.pi * self.beat)
        brake = DRAG * (1 + 1.1 * abs(self.bend) + 0.5 * max(self.fins))
        self.speed += (thrust - brake * self.speed * abs(self.speed)) * dt
        self.back_s -= dt
        if self.back_s > 0:  # paddling with the pectoral fins
            self.speed += (-0.3 - self.speed) * dt / 0.35
        # The water does not turn with the fish.
        self.slip += -self.speed * math.sin(turn) - self.slip * dt / SLIP_S  # + = to the left
        vx = self.speed * math.cos(self.axis) - self.slip * math.sin(self.axis)
        vy = -self.speed * math.sin(self.axis) - self.slip * math.cos(self.axis)
        safe = self._limit_approach(vx, vy, others)
        if safe != (vx, vy):
            vx, vy = safe
            # What is left of the speed along the axis.
            self.speed = vx * math.cos(self.axis) - vy * math.sin(self.axis)
        self.x += vx * dt
        self.y += vy * dt

    def _move_fins(self, dt: float) -> None:
        """Open or close the pectoral fins gradually during `dt` seconds."""
        self.fins_remaining_s -= dt
        if self.fins_remaining_s <= 0:
            self.fins_open = not self.fins_open
            self.fins_remaining_s = self._random_fin_time()
        for i, delay_s in enumerate((0.09, 0.11)):
            target = 1.0 if self.fins_open or (self.back_s > 0 and self.fins_share > 0) else 0.0
            self.fins[i] += (target - self.fins[i]) * dt / delay_s

    def _limit_approach(
        self, vx: float, vy: float, others: Sequence["Swimmer"]
    ) -> tuple[float, float]:
        """Return the velocity (vx, vy) with a limit on its component towards a near wall or fish.

        vx, vy: body lengths/s, y down. In 0.25 s the approach may use up the gap, so it never
        closes in a shorter step. Turns usually avoid a collision before this limit is reached.
        """
        x0, y0, x1, y1 = self.room
        hold_s = 0.25
        vx = min(max(vx, (x0 - self.x) / hold_s), (x1 - self.x) / hold_s)
        vy = min(max(vy, (y0 - self.y) / hold_s), (y1 - self.y) / hold_s)
        for other in others:
            dx, dy = other.x - self.x, other.y - self.y
            distance = math.hypot(dx, dy)
            # Each of the two may use up half of the gap.
            allowed = _spare_gap(self, other) / (2 * hold_s)
            closing = (vx * dx + vy * dy) / distance
            if closing > allowed:
                vx -= (closing - allowed) * dx / distance
                vy -= (closing - allowed) * dy / distance
        return vx, vy


def _reach_in_direction(fish: Swimmer, ux: float, uy: float) -> float:
    """Return how far a fish extends from its mass centre in a direction, in body lengths.

    ux, uy: unit vector, y down. In a turn it is REACH in every direction. Else it is how far the
    head, the beating tail or the pectoral fins reach, whichever is farthest.
    """
    if fish.mode == "turn":
        return REACH
    along = ux * math.cos(fish.axis) - uy * math.sin(fish.axis)  # 1 = ahead, −1 = behind
    across = math.sqrt(max(1 - along * along, 0.0))
    return max(0.46 * along, -0.62 * along + 0.15 * across, 0.17 * along + 0.30 * across)


def _spare_gap(fish: Swimmer, other: Swimmer, reach: float | None = None) -> float:
    """Return the gap between two fish minus FISH_GAP, in body lengths; below 0 they are too near.

    reach: how far the first fish reaches towards the other, None = as far as in its present pose.
    """
    dx, dy = other.x - fish.x, other.y - fish.y
    distance = math.hypot(dx, dy)
    ux, uy = dx / distance, dy / distance
    if reach is None:
        reach = _reach_in_direction(fish, ux, uy)
    return distance - reach - _reach_in_direction(other, -ux, -uy) - FISH_GAP


def _closest_approach(fish: Swimmer, other: Swimmer, angle: float) -> float:
    """Return the least distance of two fish within 1.6 s if the first turns now, in body lengths.

    angle: of the turn, radians, + left; both then swim straight on. The unit is the body length.
    Without a turn, fish that already part count as far apart: 9.
    """
    # Place and velocity of the other fish as seen from the first, which counts as no slower than
    # 0.5 BL/s.
    dx, dy = other.x - fish.x, other.y - fish.y
    speed = max(fish.speed, 0.5)
    vx = other.speed * math.cos(other.axis) - speed * math.cos(fish.axis + angle)
    vy = -other.speed * math.sin(other.axis) + speed * math.sin(fish.axis + angle)
    squared_speed = vx * vx + vy * vy
    nearest_s = 0.0
    if squared_speed >= 1e-9:
        nearest_s = min(max(-(dx * vx + dy * vy) / squared_speed, 0.0), 1.6)
    if nearest_s == 0.0 and angle == 0.0:
        return 9.0
    return math.hypot(dx + vx * nearest_s, dy + vy * nearest_s)
