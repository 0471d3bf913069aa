"""How the drawn carp swims: a seeded behaviour script, integrated to poses and midlines.

Lengths are in body lengths, times in seconds, angles in radians, anticlockwise as seen on screen
(the screen's y points down, so a unit vector at angle a is ``(cos a, -sin a)``). ``+`` is left.

A fish is a point (its mass centre) with an axis. The axis turns in C-turns (in, hold, out) and the
point moves along it: thrust follows the tail beat, drag the square of the speed, side-slip dies
within a fraction of a second. The body is an inextensible midline whose curvature is

    travelling wave (grows towards the tail) + C-bend (strongest in mid-body) + small noise

with the front third nearly stiff, as in the fish paper §2.2 ("head ... cannot deform").
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from finloop.drawn.carp.skin import half_width
from finloop.drawn.truth import POINTS

Float = NDArray[np.float64]

SEGMENTS = POINTS - 1

# Kinematics of a calm carp: tail amplitude about 0.1 L, one wave on the body, 0.65 L a beat.
WAVELENGTH = 1.05
STRIDE = 0.65  # body lengths per beat at full amplitude and steady speed
DRAG = 0.42  # per body length: glide speed is v0 / (1 + DRAG v0 t)
SLIP_S = 0.12  # side-slip dies with this time constant
REACH = 0.66  # no part of a fish is farther than this from its mass centre, however it bends
FISH_GAP = 0.10  # two fish keep at least this between their hulls
STEP_S = 0.01  # integration steps are at most this long

# What an eye can tell from straight swimming: bend, and turn rate of the head.
VISIBLE_BEND = math.radians(9.0)
VISIBLE_RATE = math.radians(28.0)

STRAIGHT = ("cruise", "glide", "burst")


@dataclass(frozen=True)
class Motion:
    """Poses of all fish in all frames; arrays are (frames, fish).

    Attributes
    ----------
    x, y : mass centre of the midline, body lengths from the picture's upper left pixel centre
    axis : direction of the body's mean tangent, radians
    beat : phase of the tail beat, cycles
    amplitude : of the tail beat, 1 = cruising
    bend : the C-bend, tangent at the head minus at the tail, radians
    ripple : (frames, fish, 2) small random curvature
    fins : opening of the left and right pectoral fin, (frames, fish, 2), 0-1
    swimming_type : 0 straight, 1 left, -1 right
    """

    x: Float
    y: Float
    axis: Float
    beat: Float
    amplitude: Float
    bend: Float
    ripple: Float
    fins: Float
    swimming_type: NDArray[np.int8]


def _smooth(x: float) -> float:
    """Smoothstep: 0 below 0, 1 above 1, flat at both ends."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


def turn_bend(tau: float) -> float:
    """C-bend at the share `tau` of a turn's duration, of its largest: in, hold, out."""
    return _smooth(tau / 0.36) - _smooth((tau - 0.50) / 0.46)


def turn_progress(tau: float) -> float:
    """Share of a turn's angle that the body's axis has gone through at `tau` of its duration."""
    return _smooth((tau - 0.06) / 0.94)


@cache
def mass_weights() -> Float:
    """Share of the body's mass at each midline point, head to tail (from the top-view width)."""
    width = half_width(np.linspace(0, 1, POINTS))
    return width / width.sum()


@cache
def bend_shape() -> Float:
    """C-bend curvature at the 63 inner midline points; sums to 1; strongest in mid-body."""
    s = np.arange(1, SEGMENTS) / SEGMENTS
    t = np.clip((s - 0.16) / 0.80, 0, 1)
    shape = np.sin(np.pi * t**0.95) ** 2
    return shape / shape.sum()


@cache
def wave_shape() -> Float:
    """Angle (radians) that the tail-beat wave bends at each inner point at amplitude 1."""
    s = np.arange(1, SEGMENTS) / SEGMENTS
    growth = 0.18 + 3.1 * np.clip((s - 0.2) / 0.8, 0, None) ** 1.35
    return growth * np.clip(s / 0.3, 0, 1) ** 2 / SEGMENTS


def midline(
    x: float,
    y: float,
    axis: float,
    beat: float,
    amplitude: float,
    bend: float,
    ripple: Sequence[float] | Float = (0.0, 0.0),
) -> Float:
    """Midline of a pose, (65, 2) in body lengths, head to tail; its arc length is exactly 1.

    Tangents are integrated from curvature, so the line cannot stretch; then it is placed with its
    mass centre at (x, y) and its mean tangent along `axis`, which makes the head recoil against the
    tail as it does in a fish.
    """
    s = np.arange(1, SEGMENTS) / SEGMENTS
    joint = (
        amplitude * wave_shape() * np.sin(2 * np.pi * (s / WAVELENGTH - beat))
        + bend * bend_shape()
        + (ripple[0] * np.sin(np.pi * s) + ripple[1] * np.sin(2 * np.pi * s)) / SEGMENTS
    )
    angle = -np.concatenate([[0.0], np.cumsum(joint)])  # of each segment, pointing to the head
    weight = mass_weights()
    of_segment = (weight[1:] + weight[:-1]) / (weight[1:] + weight[:-1]).sum()
    angle += axis - of_segment @ angle
    step = np.column_stack([-np.cos(angle), np.sin(angle)]) / SEGMENTS  # towards the tail, y down
    line = np.vstack([np.zeros(2), np.cumsum(step, axis=0)])
    return line - weight @ line + (x, y)


def _free_run(x: float, y: float, angle: float, room: tuple[float, float, float, float]) -> float:
    """Distance from (x, y) along `angle` to the edge of the rectangle `room` (x0, y0, x1, y1)."""
    dx, dy = math.cos(angle), -math.sin(angle)
    run = math.inf
    for at, step, low, high in ((x, dx, room[0], room[2]), (y, dy, room[1], room[3])):
        if abs(step) > 1e-9:
            run = min(run, ((high if step > 0 else low) - at) / step)
    return max(run, 0.0)


class _Swimmer:
    """One fish between two integration steps; `advance` is the only thing that changes it."""

    def __init__(
        self,
        x: float,
        y: float,
        axis: float,
        room: tuple[float, float, float, float],
        fins: float,
        rng: np.random.Generator,
    ) -> None:
        self.x, self.y, self.axis = x, y, axis
        self.room, self.fins_share, self.rng = room, fins, rng
        self.speed, self.slip = 0.7, 0.0
        self.beat, self.rate, self.amplitude = float(rng.random()), 1.6, 0.8
        self.bend, self.head_lead = 0.0, 0.0
        self.ripple = [0.0, 0.0]
        self.drift = 0.0  # slow meander of straight swimming, radians a second
        self.fins = [0.0, 0.0]
        self.fins_wanted = bool(rng.random() < fins)
        self.fins_left_s = self._fin_spell()
        self.mode, self.left_s, self.length_s = "cruise", 0.0, 1.0
        self.wanted_rate, self.wanted_amplitude = 1.6, 0.8
        self.angle, self.peak = 0.0, 0.0
        self.back_s = 0.0  # time for which it still swims backwards, out of a jam
        self.rest_s = 0.0  # time until the next turn may begin
        self.turned = 0.0  # angle turned through, net, fading: a fish does not circle one way
        self.swimming_type, self.turn_over = 0, False
        self._begin(str(rng.choice(STRAIGHT[:2])))

    # -- behaviour ---------------------------------------------------------------------------

    def _begin(self, mode: str) -> None:
        low, high, rates, amplitudes = {
            "cruise": (1.2, 3.2, (1.3, 2.1), (0.7, 1.0)),
            "glide": (0.8, 2.0, (0.7, 1.0), (0.05, 0.16)),
            "burst": (0.5, 1.0, (2.9, 3.7), (1.0, 1.2)),
        }[mode]
        self.mode = mode
        self.left_s = self.length_s = float(self.rng.uniform(low, high))
        self.wanted_rate = float(self.rng.uniform(*rates))
        self.wanted_amplitude = float(self.rng.uniform(*amplitudes))

    def _begin_turn(self, angle: float) -> None:
        """A C-turn by `angle`. Wide turns are quicker and bend the body more, as in real carp."""
        wide = abs(angle)
        self.mode, self.angle = "turn", angle
        self.turned = 0.75 * self.turned + angle
        self.length_s = float((0.36 + 0.76 * wide / math.pi) * self.rng.uniform(0.85, 1.25))
        self.left_s = self.length_s
        self.peak = math.copysign(
            (math.radians(17) + 0.66 * wide) * float(self.rng.uniform(0.85, 1.15)), angle
        )
        self.wanted_rate, self.wanted_amplitude = 1.2, 0.15

    def _pick_turn(self, others: Sequence["_Swimmer"], sharp: bool) -> float | None:
        """Angle of a turn into open water, or None where none is better than going on."""
        best, choice = -math.inf, None
        for size in self.rng.uniform(math.radians(30), math.radians(150), 14):
            for angle in (size, -size):
                wide = abs(angle)
                way = 0.5 * self.speed * (0.36 + 0.76 * wide / math.pi)
                x = self.x + way * (math.cos(self.axis) + math.cos(self.axis + angle)) / 2
                y = self.y - way * (math.sin(self.axis) + math.sin(self.axis + angle)) / 2
                run = _free_run(x, y, self.axis + angle, self.room)
                near = min((_passing(self, other, angle) for other in others), default=9.0)
                score = min(run, 3.5) + 1.5 * min(near, 2.5) + float(self.rng.uniform(0, 1.5))
                score -= 0.25 * wide if sharp else 0.6 * wide
                score -= 0.45 * max(self.turned * math.copysign(1.0, angle), 0.0)
                if not sharp and (run < 1.6 or near < 1.6):
                    continue
                if score > best:
                    best, choice = score, angle
        return choice

    def _decide(self, others: Sequence["_Swimmer"], dt: float) -> None:
        self.left_s -= dt
        self.rest_s -= dt
        if self.mode == "turn":
            if self.left_s <= 0:
                self.rest_s = 0.35
                self._begin("burst" if self.rng.random() < 0.25 else "cruise")
            return
        ahead = _free_run(self.x, self.y, self.axis, self.room)
        roomy = all(_gap(self, other, REACH) > 0 for other in others)
        if self.rest_s <= 0:
            threat = min((_passing(self, other, 0.0) for other in others), default=9.0)
            if ahead < 0.35 + 0.55 * self.speed or threat < 0.95:
                angle = self._pick_turn(others, sharp=True) if roomy else None
                if angle is not None:
                    self._begin_turn(angle)
                    return
                if self.speed < 0.35:
                    self.back_s = 0.5
        if self.left_s <= 0:
            kind = float(self.rng.random())
            if self.mode != "glide" and kind < 0.35:
                self._begin("glide")
            elif kind < 0.80:
                angle = self._pick_turn(others, sharp=False) if roomy and self.rest_s <= 0 else None
                if angle is None:
                    self._begin("cruise")
                else:
                    self._begin_turn(angle)
            elif kind < 0.92 and ahead > 2.5:
                self._begin("burst")
            else:
                self._begin("cruise")

    def _fin_spell(self) -> float:
        """How long the pectoral fins stay as they are: open about a second at a time."""
        share = self.fins_share
        if share <= 0 or share >= 1:
            self.fins_wanted = share >= 1
            return math.inf
        mean = 1.3 if self.fins_wanted else 1.3 * (1 - share) / share
        return float(mean * self.rng.uniform(0.5, 1.5))

    # -- physics -----------------------------------------------------------------------------

    def advance(self, others: Sequence["_Swimmer"], dt: float) -> None:
        """One step of `dt` seconds: decide, bend, turn, beat, move."""
        rng = self.rng
        self._decide(others, dt)

        # Bend and turn.
        lead_before, axis_before = self.bend, self.axis
        if self.mode == "turn":
            tau = 1 - max(self.left_s, 0.0) / self.length_s
            self.bend = self.peak * turn_bend(tau)
            done = turn_progress(tau) - turn_progress(tau - dt / self.length_s)
            self.axis += self.angle * done
            self.drift = 0.0
        else:
            self.bend = 0.0
            noise = float(rng.standard_normal())
            self.drift += dt * -self.drift / 1.2 + math.radians(6.5) * math.sqrt(dt) * noise
            self.axis += self.drift * dt
        swing = (self.axis - axis_before + 0.35 * (self.bend - lead_before)) / dt
        seen = abs(self.bend) > VISIBLE_BEND or abs(swing) > VISIBLE_RATE
        late = self.mode == "turn" and self.left_s < 0.3 * self.length_s
        if self.mode == "turn" and seen and not self.turn_over:
            self.swimming_type = int(math.copysign(1, self.angle))
        else:
            self.swimming_type = 0
            self.turn_over = late  # what the body still does then is straightening

        # Tail beat; the muscles need a moment to follow the will.
        wanted_rate, wanted_amplitude = (
            (2.2, 0.8)
            if late
            else (
                self.wanted_rate,
                self.wanted_amplitude,
            )
        )
        self.rate += (wanted_rate - self.rate) * dt / 0.18
        self.amplitude += (wanted_amplitude - self.amplitude) * dt / 0.20
        self.beat += self.rate * dt
        for i in range(2):
            noise = float(rng.standard_normal())
            self.ripple[i] += dt * -self.ripple[i] / 0.4 + 0.11 * math.sqrt(dt) * noise

        # Speed: thrust pulses twice a beat; a bent body and open fins brake.
        thrust = DRAG * (STRIDE * self.rate * self.amplitude) ** 2
        thrust *= 1 + 0.5 * math.sin(4 * math.pi * self.beat)
        brake = DRAG * (1 + 1.1 * abs(self.bend) + 0.5 * max(self.fins))
        self.speed += (thrust - brake * self.speed * abs(self.speed)) * dt
        self.back_s -= dt
        if self.back_s > 0:  # paddling with the pectoral fins
            self.speed += (-0.3 - self.speed) * dt / 0.35
        turned = self.axis - axis_before  # the water does not turn with the fish
        self.slip += -self.speed * math.sin(turned) - self.slip * dt / SLIP_S
        vx = self.speed * math.cos(self.axis) - self.slip * math.sin(self.axis)
        vy = -self.speed * math.sin(self.axis) - self.slip * math.cos(self.axis)
        kept = self._kept_off(vx, vy, others)
        if kept != (vx, vy):
            vx, vy = kept
            self.speed = vx * math.cos(self.axis) - vy * math.sin(self.axis)
        self.x += vx * dt
        self.y += vy * dt

        # Pectoral fins.
        self.fins_left_s -= dt
        if self.fins_left_s <= 0:
            self.fins_wanted = not self.fins_wanted
            self.fins_left_s = self._fin_spell()
        for i, late_s in enumerate((0.09, 0.11)):
            wanted = 1.0 if self.fins_wanted or (self.back_s > 0 and self.fins_share > 0) else 0.0
            self.fins[i] += (wanted - self.fins[i]) * dt / late_s

    def _kept_off(self, vx: float, vy: float, others: Sequence["_Swimmer"]) -> tuple[float, float]:
        """Velocity with what would end in a wall or in another fish taken out.

        The nearer, the slower it may approach (gap per 0.25 s), so the gap never closes; the turns
        that avoid come first and this is seldom felt.
        """
        x0, y0, x1, y1 = self.room
        hold = 0.25
        vx = min(max(vx, (x0 - self.x) / hold), (x1 - self.x) / hold)
        vy = min(max(vy, (y0 - self.y) / hold), (y1 - self.y) / hold)
        for other in others:
            dx, dy = other.x - self.x, other.y - self.y
            far = math.hypot(dx, dy)
            # Each of the two may use up half of the gap.
            allowed = _gap(self, other) / (2 * hold)
            closing = (vx * dx + vy * dy) / far
            if closing > allowed:
                vx -= (closing - allowed) * dx / far
                vy -= (closing - allowed) * dy / far
        return vx, vy


def _extent(one: _Swimmer, ux: float, uy: float) -> float:
    """How far a fish reaches from its mass centre in the direction (ux, uy).

    A fish that turns may reach anywhere; one that does not stays within a slender hull: head, tail
    with its beat, pectoral fins.
    """
    if one.mode == "turn":
        return REACH
    along = ux * math.cos(one.axis) - uy * math.sin(one.axis)
    across = math.sqrt(max(1 - along * along, 0.0))
    return max(0.46 * along, -0.62 * along + 0.15 * across, 0.17 * along + 0.30 * across)


def _gap(one: _Swimmer, other: _Swimmer, own: float | None = None) -> float:
    """Free water between two fish, less FISH_GAP; `own` replaces the reach of `one`."""
    dx, dy = other.x - one.x, other.y - one.y
    far = math.hypot(dx, dy)
    ux, uy = dx / far, dy / far
    mine = _extent(one, ux, uy) if own is None else own
    return far - mine - _extent(other, -ux, -uy) - FISH_GAP


def _passing(one: _Swimmer, other: _Swimmer, angle: float) -> float:
    """Least distance of two fish within the next 1.6 s if `one` turns by `angle` now."""
    dx, dy = other.x - one.x, other.y - one.y
    speed = max(one.speed, 0.5)
    vx = other.speed * math.cos(other.axis) - speed * math.cos(one.axis + angle)
    vy = -other.speed * math.sin(other.axis) + speed * math.sin(one.axis + angle)
    v2 = vx * vx + vy * vy
    when = 0.0 if v2 < 1e-9 else min(max(-(dx * vx + dy * vy) / v2, 0.0), 1.6)
    if when == 0.0 and angle == 0.0:
        return 9.0  # already parting
    return math.hypot(dx + vx * when, dy + vy * when)


def room_of(
    width_px: int, height_px: int, body_length_px: float
) -> tuple[float, float, float, float]:
    """Where a mass centre may be, in body lengths: x0, y0, x1, y1; empty if the tank is small."""
    edge = REACH + 5 / body_length_px
    return (
        edge,
        edge,
        (width_px - 1) / body_length_px - edge,
        (height_px - 1) / body_length_px - edge,
    )


def _places(
    fish: int, room: tuple[float, float, float, float], rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Starting places, as far apart as some hundred throws allow."""
    places: list[tuple[float, float]] = []
    for _ in range(fish):
        throws = np.column_stack(
            [rng.uniform(room[0], room[2], 400), rng.uniform(room[1], room[3], 400)]
        )
        if places:
            gaps = np.hypot(*(throws[:, None] - np.array(places)[None]).transpose(2, 0, 1))
            pick = int(gaps.min(axis=1).argmax())
        else:
            pick = 0
        places.append((float(throws[pick, 0]), float(throws[pick, 1])))
    return places


def crowded(fish: int, room: tuple[float, float, float, float]) -> bool:
    """Whether so many fish have no room to swim: each needs a square of 2.2 body lengths."""
    wide, high = room[2] - room[0], room[3] - room[1]
    if wide < 1.2 or high < 1.2:
        return True
    return fish > 1 and fish > (wide + 1.4) * (high + 1.4) / 2.2**2


def simulate(
    frames: int,
    fish: int,
    room: tuple[float, float, float, float],
    frame_rate_hz: float,
    fins: float,
    rng: np.random.Generator,
) -> Motion:
    """Let `fish` fish swim for `frames` frames in `room`; a longer film begins like a shorter."""
    steps = max(1, math.ceil(1 / (frame_rate_hz * STEP_S)))
    dt = 1 / (frame_rate_hz * steps)
    streams = rng.spawn(fish + 1)
    swimmers = [
        _Swimmer(x, y, float(own.uniform(-math.pi, math.pi)), room, fins, own)
        for (x, y), own in zip(_places(fish, room, streams[-1]), streams[:-1], strict=True)
    ]
    others = [[o for o in swimmers if o is not one] for one in swimmers]
    scalar = np.zeros((7, frames, fish))
    ripple, open_ = np.zeros((frames, fish, 2)), np.zeros((frames, fish, 2))
    for frame in range(frames):
        for i, one in enumerate(swimmers):
            scalar[:, frame, i] = (
                one.x, one.y, one.axis, one.beat, one.amplitude, one.bend, one.swimming_type,
            )  # fmt: skip
            ripple[frame, i], open_[frame, i] = one.ripple, one.fins
        for _ in range(steps):
            for one, rest in zip(swimmers, others, strict=True):
                one.advance(rest, dt)
    x, y, axis, beat, amplitude, bend, kind = scalar
    return Motion(x, y, axis, beat, amplitude, bend, ripple, open_, kind.astype(np.int8))
