"""A recorded track in place of a live animal: the messages of a tracker, and their times.

It is for rehearsals, and can have the faults of a network and a tracker.
"""

import asyncio
import json
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import MM, TANK, Line
from finloop.stimulus.animals import TankGeometry
from finloop.stimulus.tracker import PX, TrackerCalibration

NAME = "recorded"
"""The id of the animal, and the name of the sender."""


class ConnectionFaults(NamedTuple):
    """Faults of a tracker's connection that a rehearsal imitates.

    loss: share of the messages that never arrive, 0..1. jitter_s: the largest delay of the others,
    which may overtake each other. gap_s: silence of the tracker after every `every_s` seconds of
    the track. seed: of the random choices.
    """

    loss: float = 0.0
    jitter_s: float = 0.0
    gap_s: float = 0.0
    seed: int = 0
    every_s: float = 10.0


class TimedMessage(NamedTuple):
    """A tracker's message, JSON text, and when it arrives: s from the track's beginning."""

    due_s: float
    text: str


NO_FAULTS = ConnectionFaults()


def imitate_tracker(
    line: Line, rate_hz: float | None, tank: TankGeometry,
    faults: ConnectionFaults = NO_FAULTS, calibration: TrackerCalibration = PX,
    mm_per_px: float | None = None,
) -> Iterator[TimedMessage]:  # fmt: skip
    """Yield the messages that a tracker would send about a recorded track, in order of arrival.

    line: places with times. rate_hz: messages per second, None: one at each time of the line.
    faults: of the connection. calibration: from the imitated tracker's places to the tank.
    mm_per_px: for a line in mm. FinloopError if the line has no times, or is in mm and the film's
    scale is not known.
    """
    time_s, track = _sample_track(line, rate_hz, _line_unit_px(line, tank, mm_per_px))
    rng = np.random.default_rng(faults.seed)
    lost = rng.random(len(time_s)) < faults.loss
    lost |= time_s % (faults.every_s + faults.gap_s) >= faults.every_s  # the tracker's silences
    due_s = time_s + faults.jitter_s * rng.random(len(time_s))
    for number in np.argsort(due_s, kind="stable"):
        if lost[number]:
            continue
        x, y, heading = track[number].tolist()
        place = calibration.map_to_tracker(x, y, math.radians(heading))
        facts = {"t": float(time_s[number]), "id": NAME, **place._asdict()}
        if math.isnan(place.heading):
            del facts["heading"]
        yield TimedMessage(float(due_s[number]), json.dumps(facts))


def _line_unit_px(line: Line, tank: TankGeometry, mm_per_px: float | None) -> tuple[float, float]:
    """Return how many px a unit of a line's coordinates is, along x and along y.

    px are those of the tank's picture. FinloopError if the unit is mm and `mm_per_px` is None.
    """
    if line.unit == TANK:
        return tank.width - 1, tank.height - 1
    if line.unit != MM:
        return 1.0, 1.0
    if mm_per_px is None:
        raise FinloopError(
            f"{line.name} is in mm, and the film's scale is not known",
            "clip.mm_per_px, the size of a pixel",
            "measure a ruler in the picture, or give the track in px or in shares of the picture",
        )
    return 1 / mm_per_px, 1 / mm_per_px


def _sample_track(
    line: Line, rate_hz: float | None, unit_px: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Sample a line; return times (n,) [s] from 0, and x, y [px], heading [degrees] (n, 3).

    Headings go on beyond 360°; they are NaN if the line has none. rate_hz: samples per second,
    None: the line's own times. unit_px: size of the line's unit along x and y. FinloopError if the
    line has no times.
    """
    if line.time_s is None:
        raise FinloopError(
            f"{line.name} has no times",
            "a track as it was recorded: a column time_s, in seconds",
            "add the times, or take a track of the film, such as track:8",
        )
    time_s = line.time_s - line.time_s[0]
    heading = np.full(len(time_s), np.nan) if line.heading_deg is None else line.heading_deg
    track = np.column_stack(
        [line.x * unit_px[0], line.y * unit_px[1], np.unwrap(heading, period=360)]
    )
    if rate_hz is None:
        return time_s, track
    ticks = np.arange(int(time_s[-1] * rate_hz + 1e-6) + 1) / rate_hz
    return ticks, np.column_stack([np.interp(ticks, time_s, column) for column in track.T])


def repeat_messages(messages: list[TimedMessage]) -> Iterator[TimedMessage]:
    """Yield a track's messages again and again, with a pause of one second after the last."""
    begin_s = 0.0
    while messages:
        for due_s, text in messages:
            message = json.loads(text)
            later_text = json.dumps(message | {"t": begin_s + message["t"]})
            yield TimedMessage(begin_s + due_s, later_text)
        begin_s += messages[-1].due_s + 1.0


class DryClock:
    """The clock of a session without a display: a wait ends at once, and sets the clock to its end.

    receive: called with the text and the sender of each message, at its time.
    """

    def __init__(self, messages: Iterable[TimedMessage] = ()) -> None:
        """Set the clock to 0; messages: of trackers, in order of their session times."""
        self._now_s, self._messages = 0.0, iter(messages)
        self._next = next(self._messages, None)
        self.receive: Callable[[str, str], Any] = lambda text, source: None

    def read_time(self) -> float:
        """Return the present session time, s."""
        return self._now_s

    async def wait_until(self, time_s: float) -> None:
        """Set the clock to a session time [s], and pass on the messages that are due until then."""
        while self._next is not None and self._next.due_s <= time_s:
            message, self._next = self._next, next(self._messages, None)
            self._now_s = max(self._now_s, message.due_s)
            self.receive(message.text, NAME)
        self._now_s = max(self._now_s, time_s)
        await asyncio.sleep(0)  # lets other tasks run
