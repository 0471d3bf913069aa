"""The live animals: what trackers report of each, where it is and where it was.

All of it follows from the messages and their arrival times; no clock is read. So a session that is
planned again from its log is the same.

A tracker's clock has any zero. Its time and the session's differ by the delay of a message, which
is sometimes small, and sometimes 50 ms more. So the smallest of the last differences counts: it is
that of a message without extra delay. A tracker's times order and space its messages, and the
present difference places them in the session's time. Differences are forgotten after some seconds,
as a tracker's clock may run a little faster or slower than the session's.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from typing import Literal, NamedTuple

from finloop.stimulus.protocol import MOST_DELAY_S, AnimalSettings
from finloop.stimulus.tracker import MOST_AT_ONCE, Sighting, fit_calibration, parse_sightings

PlacePx = tuple[float, float]
"""A place in the tank's picture: x, y px, y down."""
Verdict = Literal[
    "taken", "outside", "clock", "malformed", "late", "rival", "crowd", "unwanted", "flood"
]
"""The verdict on a tracker's message.

taken; outside: taken, and moved into the tank; clock: taken, though the tracker's clock jumped;
malformed: no message; late: not later than the last; rival: of another tracker, while the first
one is active; crowd: of more animals than allowed; unwanted: the protocol has no animals; flood: of
a sender that sends too much (`finloop.stimulus.limits`)."""
TAKEN: tuple[Verdict, ...] = ("taken", "outside", "clock")
"""The verdicts on a sighting that counts, so that its animal is present."""

_JUMP_S = 1.0  # a message earlier or later than others by more is of another clock
_BINS, _BIN_S = 5, 1.0  # number and duration of the bins of the smallest difference
_SAMPLES = 8000  # samples of an animal's past
_SPACE_S = MOST_DELAY_S / _SAMPLES  # mean time between two samples: 133 a second
_ALIKE_S = 1e-6  # times that are nearer are the same
_TURN = 0.25  # body lengths that an animal goes before its heading is taken from its way
_SPEED_S = 0.2  # an animal's speed is that of the last so many seconds


class TankGeometry(NamedTuple):
    """The tank's size and the body length of a fish in px, and where in the tank a fish can be.

    nearest_place: returns the place nearest to x, y (px) where the centre of a fish can be.
    """

    width: float
    height: float
    length_px: float
    nearest_place: Callable[[float, float], PlacePx]


class Animal(NamedTuple):
    """Where a live animal was last seen, and how fast it moved.

    x, y: in px of the tank's picture, y down. heading_rad: anticlockwise as seen, from the tracker
    or from the motion; None: unknown. speed: px/s over the last 0.2 s. heard_s: session time of its
    last message.
    """

    id: str
    x: float
    y: float
    heading_rad: float | None
    speed: float
    heard_s: float


class LiveAnimals:
    """All live animals, as trackers report them in messages.

    settings: `animals` of the protocol, None where it has none. mm_per_px: mm of the real world per
    px of the tank's picture, if known. gap_s: time without messages after which an animal is lost.
    is_changed: whether the last message changed what is known, so that later ones may depend on it.
    """

    def __init__(
        self, settings: AnimalSettings | None, tank: TankGeometry, mm_per_px: float | None
    ) -> None:
        """Begin without any animal; FinloopError if the tracker's calibration is invalid."""
        self._tank = tank
        self.calibration = None if settings is None else fit_calibration(settings, mm_per_px)
        self.gap_s = 0.0 if settings is None else settings.gap_s
        self.is_changed = False
        self._tracks: dict[str, _AnimalTrack] = {}

    def receive_message(
        self, text: str | bytes | None, source: str, arrived_s: float
    ) -> list[Verdict]:
        """Store the sightings in a tracker's message; return a verdict on each of them.

        A message without a valid sighting gets a single verdict. source: the sender's name.
        arrived_s: session time, s.
        """
        self.is_changed = False
        if self.calibration is None:  # the protocol has no live animals
            return ["unwanted"]
        sightings = parse_sightings(text)
        if sightings is None:
            return ["malformed"]
        return [self._store_sighting(sighting, source, arrived_s) for sighting in sightings]

    def recent_animals(self, now_s: float) -> list[Animal]:
        """Return the animals heard of in the 60 s before a session time, also lost ones.

        They are sorted by id.
        """
        return [
            Animal(name, *track.place, track.heading_rad, track.speed, track.heard_s)
            for name, track in sorted(self._tracks.items())
            if now_s - track.heard_s <= MOST_DELAY_S
        ]

    def present_animals(self, now_s: float) -> list[Animal]:
        """Return the animals that are not lost at a session time, where last seen, sorted by id.

        An animal is lost if no message came about it in the last `gap_s` seconds before `now_s`.
        """
        recent = self.recent_animals(now_s)
        return [animal for animal in recent if now_s - animal.heard_s <= self.gap_s]

    def find_past_place(self, id: str, time_s: float) -> PlacePx | None:
        """Return where an animal was (x, y px) at a session time, interpolated between sightings.

        None before the first sighting, more than 60 s before the last one, and where the animal was
        lost. Until it is lost, an animal stays where it was last sighted.
        """
        track = self._tracks.get(id)
        return None if track is None else track.find_past_place(time_s, self.gap_s)

    def _store_sighting(self, sighting: Sighting, source: str, arrived_s: float) -> Verdict:
        """Store one sighting, unless it is refused; return the verdict on it (`Verdict`).

        source: the sender's name; arrived_s: session time of its message, s.
        """
        name = str(sighting.id)
        track = self._tracks.get(name)
        if track is None:
            if not self._make_room_for_animal(arrived_s):
                return "crowd"
            track = self._tracks[name] = _AnimalTrack(source, self._tank.length_px)
        silence = arrived_s - track.heard_s
        if track.source != source and silence <= self.gap_s:
            return "rival"
        refused_t = track.refused_t
        jumped = track.update_clock(sighting.t, arrived_s, source)
        if jumped is None:
            self.is_changed |= track.refused_t != refused_t
            return "late"
        self.is_changed = True
        place, heading, outside = self._place_in_tank(sighting)
        track.add_sighting(sighting.t, place, heading, arrived_s, silence > self.gap_s)
        return "clock" if jumped else "outside" if outside else "taken"

    def _make_room_for_animal(self, now_s: float) -> bool:
        """Forget the longest lost animal if there are 64; return whether a new one fits.

        If all 64 are present at the session time `now_s`, no animal is forgotten, and none fits.
        """
        if len(self._tracks) < MOST_AT_ONCE:
            return True
        oldest = min(self._tracks, key=lambda name: (self._tracks[name].heard_s, name))
        if now_s - self._tracks[oldest].heard_s <= self.gap_s:
            return False
        del self._tracks[oldest]
        return True

    def _place_in_tank(self, sighting: Sighting) -> tuple[PlacePx, float | None, bool]:
        """Return a sighting's place [px] and heading [rad], and whether it was moved into the tank.

        An animal may be nearer to a wall than the centre of a fish can be. So a place is moved only
        if it is outside the picture, or over a body length away from where a fish can be. The
        heading is None if the tracker did not send it.
        """
        assert self.calibration is not None
        x, y = self.calibration.map_place(sighting.x, sighting.y)
        heading_rad = None
        if sighting.heading is not None:
            heading_rad = self.calibration.map_heading_rad(sighting.x, sighting.y, sighting.heading)
        # Pixel centres are whole numbers, so the picture reaches from −0.5 to its size − 0.5.
        within = -0.5 <= x <= self._tank.width - 0.5 and -0.5 <= y <= self._tank.height - 0.5
        nearest = self._tank.nearest_place(x, y)
        outside = not within or math.dist(nearest, (x, y)) > self._tank.length_px
        return nearest if outside else (x, y), heading_rad, outside


class _AnimalTrack:
    """The sightings of one animal, and how its tracker's clock differs from the session's."""

    def __init__(self, source: str, length_px: float) -> None:
        """Begin without a sighting; source: the tracker, length_px: body length of a fish."""
        self.source, self.heard_s = source, -math.inf
        self.place, self.speed = (0.0, 0.0), 0.0
        self.heading_rad: float | None = None
        self._length_px = length_px
        self._past = _PastPlaces()
        # Number of each of the last seconds, and the least clock offset that was seen in it.
        self._least_offsets: deque[tuple[int, float]] = deque(maxlen=_BINS)
        self._clock_offset_s = 0.0  # the session's time less the tracker's
        self._last_t = -math.inf  # the last of the tracker's times
        self._unbroken_since = 0.0  # beginning of its unbroken track, the tracker's time
        self.refused_t: float | None = None  # a time of a clock that may have been put back
        self._heading_place = (0.0, 0.0)  # where its motion last gave the heading

    def update_clock(self, t: float, arrived_s: float, source: str) -> bool | None:
        """Update the offset between the clocks; return whether the tracker's clock jumped.

        t: the tracker's time of a new sighting, s; arrived_s: the session's. Return None if the
        sighting is late: t is not after the last one, and the clock is the same. Another source has
        another clock; earlier sightings are kept.

        A message can be held up but never be early, so the offset is the least of the last seconds.
        """
        offset = arrived_s - t
        is_first, is_other_source = not self._least_offsets, source != self.source
        jumped = not is_first and self._detect_clock_jump(t, offset - self._clock_offset_s)
        if jumped is None and not is_other_source:
            return None
        self.refused_t = None
        if is_first or is_other_source or jumped:
            # Stored times move to the new clock, which is ahead of the old one by this difference.
            self._past.change_clock(self._clock_offset_s - offset, t)
            self._least_offsets.clear()
            self.source, self._unbroken_since = source, t
        # Keep the least offset of each bin of time; the deque forgets the oldest bin.
        bin_number = math.floor(arrived_s / _BIN_S)
        if self._least_offsets and self._least_offsets[-1][0] == bin_number:
            offset = min(offset, self._least_offsets.pop()[1])
        self._least_offsets.append((bin_number, offset))
        self._clock_offset_s = min(least for _, least in self._least_offsets)
        return bool(jumped)

    def _detect_clock_jump(self, t: float, change_s: float) -> bool | None:
        """Return whether the tracker's clock jumped before its time t; None if t is only late.

        A late t is remembered: a later one that is late, too, shows a jump. change_s: how much
        larger the offset between the clocks has become.
        """
        if t > self._last_t:
            # A larger offset is no jump: the message was held up. If the clock was put back, the
            # least offset of the last bins shows it in a few seconds.
            return change_s < -_JUMP_S
        if t == self._last_t or change_s <= _JUMP_S:
            return None
        # One sighting may only be late; a second one, in order, shows that the clock was put back.
        if self.refused_t is not None and t > self.refused_t:
            return True
        self.refused_t = t
        return None

    def add_sighting(
        self, t: float, place: PlacePx, heading_rad: float | None, arrived_s: float, was_lost: bool
    ) -> None:
        """Add a sighting: time t [s] on the tracker's clock, place [px], heading [rad] if sent.

        Where none is sent, the animal's heading is that of its motion, renewed each time it has
        gone a quarter of a body length. arrived_s: session time. was_lost: whether it was lost
        before.
        """
        if was_lost:
            self.heading_rad, self._heading_place, self._unbroken_since = None, place, t
        x, y = place[0] - self._heading_place[0], place[1] - self._heading_place[1]
        if math.hypot(x, y) >= _TURN * self._length_px:
            self.heading_rad = math.atan2(-y, x)  # y down, angles anticlockwise
            self._heading_place = place
        if heading_rad is not None:
            self.heading_rad = heading_rad
        self.place, self.heard_s, self._last_t = place, arrived_s, t
        self._past.add_place(t, place)
        self.speed = self._past.mean_speed(t - _SPEED_S, self._unbroken_since)

    def find_past_place(self, time_s: float, gap_s: float) -> PlacePx | None:
        """Return where the animal was (x, y px) at a session time; None if unknown or lost then.

        gap_s: time without a message after which the animal is lost.
        """
        if time_s > self._clock_offset_s + self._last_t:  # after the last sighting
            return self.place if time_s - self.heard_s <= gap_s else None
        return self._past.interpolate_place(time_s - self._clock_offset_s, gap_s)


class _PastPlaces:
    """The last places of an animal by the tracker's clock, as many as the longest delay needs."""

    def __init__(self) -> None:
        """Begin without a place."""
        self._times: list[float] = []  # on the tracker's clock, s, ascending
        self._places: list[PlacePx] = []

    def add_place(self, t: float, place: PlacePx) -> None:
        """Add a place [px] that is later than all stored ones; the last one may be replaced.

        t: time on the tracker's clock, s. The oldest place is forgotten if there are too many.
        """
        # Replace the last place if the new one comes less than two mean spacings after the last but
        # one: so the samples of a fast tracker, too, reach back far enough.
        if len(self._times) > 1 and t - self._times[-2] < 2 * _SPACE_S:
            del self._times[-1], self._places[-1]
        self._times.append(t)
        self._places.append(place)
        del self._times[:-_SAMPLES], self._places[:-_SAMPLES]

    def change_clock(self, ahead_s: float, end_s: float) -> None:
        """Convert all stored times to a clock that is ahead; forget the places from a time on.

        ahead_s: by how much it is ahead. end_s: that time, on the new clock.
        """
        self._times = [t + ahead_s for t in self._times]
        end = bisect_left(self._times, end_s)
        del self._times[end:], self._places[end:]

    def interpolate_place(self, t: float, gap_s: float) -> PlacePx | None:
        """Return the place (x, y px) at a time t; None outside the stored times and in gaps.

        t: on the tracker's clock, s. gap_s: longest gap across which places are interpolated.
        """
        after = bisect_left(self._times, t - _ALIKE_S)
        if after == len(self._times):
            return None
        t1, (x1, y1) = self._times[after], self._places[after]
        if t1 - t <= _ALIKE_S:
            return x1, y1
        if after == 0 or t1 - self._times[after - 1] > gap_s:
            return None
        t0, (x0, y0) = self._times[after - 1], self._places[after - 1]
        share = (t - t0) / (t1 - t0)
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)

    def mean_speed(self, since: float, begin: float) -> float:
        """Return the mean speed [px/s] of the animal from a time up to its last place.

        since: that time; at least the last two places are used. begin: when the unbroken track
        began, at the last place or before; earlier places are not used. Both are times of the
        tracker's clock. The result is 0 if a single place is left.
        """
        last_but_one = len(self._times) - 2
        first = min(bisect_left(self._times, since - _ALIKE_S), last_but_one)
        first = max(first, bisect_left(self._times, begin))
        duration_s = self._times[-1] - self._times[first]
        if duration_s <= 0:
            return 0.0
        return math.dist(self._places[first], self._places[-1]) / duration_s
