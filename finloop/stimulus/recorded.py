"""A recorded track in place of a live animal: the messages of a tracker, and their times.

It is for rehearsals, and can have the faults of a network and a tracker.
"""

import json
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import MM, TANK, Line
from finloop.stimulus.rules import TankGeometry
from finloop.stimulus.tracker import PX, Calibration

NAME = "recorded"
"""The id of the animal."""


class ConnectionFaults(NamedTuple):
    """The faults of a tracker's connection.

    loss: share of the messages that never arrive, 0..1; jitter_s: the largest delay of the others,
    which may overtake each other; gap_s: silence of the tracker after every `every_s` of the track;
    seed: of the random choices.
    """

    loss: float = 0.0
    jitter_s: float = 0.0
    gap_s: float = 0.0
    seed: int = 0
    every_s: float = 10.0


def messages(
    line: Line, rate_hz: float | None, tank: TankGeometry, spoiled: ConnectionFaults | None = None,
    calibration: Calibration = PX, mm_per_px: float | None = None,
) -> Iterator[tuple[float, str]]:  # fmt: skip
    """Yield a tracker's messages about a recorded track: arrival (s from its beginning), JSON text.

    They come in order of arrival. line: places with times; rate_hz: messages per second, None: one
    at each time of the line; spoiled: faults, None: none; calibration: of the imitated tracker.
    FinloopError if the line has no times, or is in mm and the film's scale is not known.
    """
    time_s, way = _sample_track(line, rate_hz, _px_of(line, tank, mm_per_px))
    spoiled = spoiled or ConnectionFaults()
    rng = np.random.default_rng(spoiled.seed)
    lost = rng.random(len(time_s)) < spoiled.loss
    since = time_s % (spoiled.every_s + spoiled.gap_s)
    lost |= since >= spoiled.every_s
    due_s = time_s + spoiled.jitter_s * rng.random(len(time_s))
    for number in np.argsort(due_s, kind="stable"):
        if not lost[number]:
            yield float(due_s[number]), _text(float(time_s[number]), way[number], calibration)


def _text(t: float, place: Floats, calibration: Calibration) -> str:
    """Return a message. place: x, y, heading_deg in the tank; the heading may be NaN."""
    x, y, heading = place.tolist()
    to_x, to_y, to_heading = calibration.back(x, y, math.radians(heading))
    facts = {"t": t, "id": NAME, "x": to_x, "y": to_y, "heading": to_heading}
    return json.dumps({name: fact for name, fact in facts.items() if fact == fact})


def _px_of(line: Line, tank: TankGeometry, mm_per_px: float | None) -> tuple[float, float]:
    if line.unit == TANK:
        return tank.width - 1, tank.height - 1
    if line.unit != MM:
        return 1.0, 1.0
    if mm_per_px is None:
        raise FinloopError(
            f"{line.name} is in mm, and the film's scale is not known",
            "clip.mm_per_px, the size of a pixel",
            "measure a ruler in the picture, or give the track in px or in shares of the tank",
        )
    return 1 / mm_per_px, 1 / mm_per_px


def _sample_track(
    line: Line, rate_hz: float | None, px: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Return times from 0 on, and at each x, y in px, heading_deg (n, 3)."""
    if line.time_s is None:
        raise FinloopError(
            f"{line.name} has no times",
            "a track as it was recorded: a column time_s, in seconds",
            "add the times, or take a track of the film, such as track:8",
        )
    time_s = line.time_s - line.time_s[0]
    heading = np.full(len(time_s), np.nan) if line.heading_deg is None else line.heading_deg
    way = np.column_stack([line.x * px[0], line.y * px[1], np.unwrap(heading, period=360)])
    if rate_hz is None:
        return time_s, way
    ticks = np.arange(int(time_s[-1] * rate_hz + 1e-6) + 1) / rate_hz
    return ticks, np.column_stack([np.interp(ticks, time_s, column) for column in way.T])
