"""The motion of all drawn carp in a film, from a seed: poses at every frame.

Units are those of `drawn.carp.midline`, times in seconds.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.drawn.carp.swimmer import REACH, Room, Swimmer

STEP_S = 0.01  # integration steps are at most this long


@dataclass(frozen=True)
class CarpMotion:
    """Poses of all fish in all frames; arrays are (frames, fish)."""

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


def room_of(width_px: int, height_px: int, body_length_px: float) -> Room:
    """Return where mass centres may be: x0, y0, x1, y1 in body lengths.

    x1 < x0 or y1 < y0 if the tank is too small.
    """
    edge = REACH + 5 / body_length_px
    return (
        edge,
        edge,
        (width_px - 1) / body_length_px - edge,
        (height_px - 1) / body_length_px - edge,
    )


def _places(fish: int, room: Room, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return starting places, each the farthest from the others of 400 random places."""
    places: list[tuple[float, float]] = []
    for _ in range(fish):
        candidates = np.column_stack(
            [rng.uniform(room[0], room[2], 400), rng.uniform(room[1], room[3], 400)]
        )
        if places:
            gaps = np.hypot(*(candidates[:, None] - np.array(places)[None]).transpose(2, 0, 1))
            pick = int(gaps.min(axis=1).argmax())
        else:
            pick = 0
        places.append((float(candidates[pick, 0]), float(candidates[pick, 1])))
    return places


def is_crowded(fish: int, room: Room) -> bool:
    """Return whether the room is too small for the fish: each needs 2.2 × 2.2 body lengths."""
    wide, high = room[2] - room[0], room[3] - room[1]
    if wide < 1.2 or high < 1.2:
        return True
    return fish > 1 and fish > (wide + 1.4) * (high + 1.4) / 2.2**2


def simulate(
    frames: int, fish: int, room: Room, frame_rate_hz: float, fins: float, rng: np.random.Generator
) -> CarpMotion:
    """Return the poses of all fish in all frames; a longer film begins with the same frames.

    fins: share of the time in which the pectoral fins are open, 0-1.
    """
    steps = max(1, math.ceil(1 / (frame_rate_hz * STEP_S)))
    dt = 1 / (frame_rate_hz * steps)
    streams = rng.spawn(fish + 1)
    swimmers = [
        Swimmer(x, y, float(own.uniform(-math.pi, math.pi)), room, fins, own)
        for (x, y), own in zip(_places(fish, room, streams[-1]), streams[:-1], strict=True)
    ]
    others = [[other for other in swimmers if other is not swimmer] for swimmer in swimmers]
    scalar = np.zeros((7, frames, fish))
    ripple, open_ = np.zeros((frames, fish, 2)), np.zeros((frames, fish, 2))
    for frame in range(frames):
        for i, swimmer in enumerate(swimmers):
            scalar[:, frame, i] = (
                swimmer.x, swimmer.y, swimmer.axis, swimmer.beat, swimmer.amplitude, swimmer.bend,
                swimmer.swimming_type,
            )  # fmt: skip
            ripple[frame, i], open_[frame, i] = swimmer.ripple, swimmer.fins
        for _ in range(steps):
            for swimmer, rest in zip(swimmers, others, strict=True):
                swimmer.advance(rest, dt)
    x, y, axis, beat, amplitude, bend, kind = scalar
    return CarpMotion(x, y, axis, beat, amplitude, bend, ripple, open_, kind.astype(np.int8))
