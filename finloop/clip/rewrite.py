"""Write the normalised clip of a film, with the repairs that a sample of the film needs.

First the pictures are repaired (fields, doubled ones), then their light and shake, which can only
be measured on whole pictures. A film without faults stays unchanged: its clip keeps every byte.
"""

from collections.abc import Callable, Set
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import accumulate, chain
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Mask, Picture
from finloop.base.light import undo_gain
from finloop.base.thin import thin_frame
from finloop.clip.check import (
    CHECK,
    CHECK_NAME,
    PLAIN_LEVELS,
    TANK_NAME,
    ClipTally,
    Quality,
    check_film,
    measure_shake,
)
from finloop.clip.doubled import RepeatedFrames, find_repeats, picture_change
from finloop.clip.light import measure_gain, measure_light
from finloop.clip.settings import ClipSettings, FootageSettings
from finloop.clip.shake import (
    STILL,
    UNKNOWN,
    Landmarks,
    Shift,
    find_landmarks,
    measure_shift,
    to_grey,
    undo_shift,
)
from finloop.clip.verdict import DOUBLED_PCT, DRIFT_PCT, FLICKER_PCT, INTERLACED, SHAKE_PX
from finloop.clip.write import ClipSource, open_footage_source, write_clip
from finloop.io.footage.source import STRETCHES, Footage, NumberedFrames, Order
from finloop.io.footage.timing import FrameCounts, resample_nearest
from finloop.io.picture import save_picture
from finloop.io.table import save_table
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    KEY_FRAME_EVERY,
    VideoFacts,
    read_chosen_frames,
    save_mask,
)

Watch = Callable[[str, int], AbstractContextManager[Callable[[], None]]]
"""Reports progress: (word, number of frames) → a block that yields `advance()`."""

# Share of the picture's smaller side. A camera that moves farther loses a strip of that width on
# both borders, and sees the tank from another place, so a single shift cannot repair it.
FARTHEST = 0.03
APART = 0.3  # share of the shake; parts of the picture that differ by more did not just shift
KEPT_CONTRAST = 0.7  # share of the contrast over the noise that a repair must leave
_MOST, _SAMPLE_BYTES = 64, 2**28  # most frames of a sample, and most bytes
_EDGE = 2  # px; farther in, repeated pixels weigh less than 5 % in a shifted picture

REPAIRED_BY = {
    "deinterlace": "deinterlace",
    "undouble": "drop_repeated_frames",
    "even_light": "correct_light",
    "steady": "stabilize",
}
"""The parameter that says when a repair is made, by the repair's name among the metrics."""

# First the repairs of single pictures, then those of light and camera, which are measured on them.
_PICTURE_REPAIRS, _VIEW_REPAIRS = {"deinterlace", "undouble"}, {"even_light", "steady"}


@dataclass(frozen=True)
class ClipResult:
    """A written clip: facts, the tally of its frames, its arena (h, w), and its quality."""

    facts: VideoFacts
    tally: ClipTally
    arena: Mask
    filmed: Quality  # of the film before any repair
    quality: Quality
    mended: frozenset[str]  # the repairs that were made, of `REPAIRED_BY`
    refused: frozenset[str] = frozenset()  # those that were tried, and made the film no better

    @property
    def metrics(self) -> dict[str, float]:
        """Return metrics by name: quality of the clip and, after a repair, of the film before it.

        Names of measures before a repair begin with `filmed_`. For each repair there is `mended_…`,
        0 or 1, and for each that was tried but made the film no better `refused_…`, 1.
        """
        metrics = dict(vars(self.quality))
        if self.mended:
            metrics |= {f"filmed_{name}": value for name, value in vars(self.filmed).items()}
        repairs = sorted(_PICTURE_REPAIRS | _VIEW_REPAIRS)
        metrics |= {f"refused_{name}": 1 for name in sorted(self.refused)}
        return metrics | {f"mended_{name}": int(name in self.mended) for name in repairs}


@dataclass
class _FrameCorrector:
    """Corrects the brightness and the shift of frames by comparing them with the empty tank."""

    tank: Picture
    light: bool  # whether to correct the light
    place: bool  # whether to correct the place
    # Of all frames so far: their mean gain, and their shift.
    gains: list[float] = field(default_factory=list)
    shifts: list[Shift] = field(default_factory=list)
    _marks: Landmarks | None = None
    _last: Shift = field(default=STILL)

    def correct_frame(self, frame: Picture) -> Picture:
        """Return a frame with corrected brightness and shift; store what was corrected."""
        gains = measure_gain(frame, self.tank) if self.light else None
        if gains is not None:
            self.gains.append(float(gains.mean()))
        if not self.place:
            return frame if gains is None else undo_gain(frame, gains)
        self._marks = self._marks or find_landmarks(self.tank)
        shift = measure_shift(frame, self._marks, self._last)
        self.shifts.append(shift)
        self._last = self._last if shift is UNKNOWN else shift
        return undo_shift(frame, self._last, gains)

    def correct_frames(self, frames: NumberedFrames) -> NumberedFrames:
        """Yield frames with corrected brightness and shift, and store what was corrected.

        Times and numbers of the frames do not change.
        """
        for time_s, (number, frame) in frames:
            yield time_s, (number, self.correct_frame(frame))

    def common_mask(self) -> Mask:
        """Return the mask (h, w) of the pixels that every corrected frame shows."""
        height, width = self.tank.shape[:2]
        shifts = np.nan_to_num([STILL, *self.shifts])[:, :2]
        sides = (*-shifts.min(axis=0), *shifts.max(axis=0))
        left, top, right, bottom = (int(np.ceil(px)) + _EDGE if px else 0 for px in sides)
        mask = np.zeros((height, width), bool)
        mask[top : height - bottom, left : width - right] = True
        return mask

    def measure_film(self, sample: Quality, rate_hz: float) -> Quality:
        """Return a sample's quality with the light and shake of the whole film filled in.

        rate_hz: frames per second of the film.
        """
        measures: dict[str, float] = {}
        if self.light:
            light = measure_light(np.array(self.gains), rate_hz)._asdict()
            measures |= {f"light_{name}": value for name, value in light.items()}
        if self.place:
            shake = measure_shake(np.array(self.shifts), len(self.shifts))
            names = "shake_px", "shake_most_px", "shake_apart_px"
            measures |= dict(zip(names, shake, strict=True))
        return replace(sample, **measures)


class _Reading(NamedTuple):
    """The repairs with which a film is read."""

    fields: Order = ""  # the earlier field; "": the film is not interlaced
    repeats: RepeatedFrames | None = None  # to be left out
    corrector: _FrameCorrector | None = None  # of light and place


@dataclass(frozen=True)
class _Version:
    """A film, or a sample of it, read with some repairs, and its measured quality."""

    reading: _Reading
    facts: VideoFacts
    tally: ClipTally
    arena: Mask
    quality: Quality
    tank: Picture
    mended: frozenset[str] = frozenset()  # the repairs, of `REPAIRED_BY`
    refused: frozenset[str] = frozenset()  # those that were tried, and made the film no better


_Make = Callable[[_Reading], _Version]
"""Reads a film, or its sample, with the repairs of a reading, and measures it."""


def make_clip(
    p: ClipSettings, source: ClipSource, folder: Path,
    show_progress: Watch = lambda *_: nullcontext(lambda: None),
) -> ClipResult:  # fmt: skip
    """Write a film as a clip: upright, at a constant frame rate, with faults repaired.

    Repairs are tried on a sample of the film. Those that make it better (`is_better`) are made
    while the clip is written; one that was refused on the sample is not tried again. Then all of
    the clip is checked: a repair that does not help there is left out, one that the sample did not
    ask for is added, and the clip is written again. Where the sample has repeated frames the film
    is read once before it is written, as only the whole shows their rhythm. The folder also
    receives a table of checks (`CHECK_NAME`) and a
    picture of the empty tank (`TANK_NAME`). show_progress(word, frames): a context that yields a
    function to call after each frame. FinloopError if the film has fewer than two readable or only
    plain frames, or the arena does not fit.
    """
    write = partial(_write_version, p, source, folder, show_progress)
    if not isinstance(p, FootageSettings) or source.footage is None:
        version = write(_Reading())
        return _make_result(version, version.quality)
    version, filmed = _write_planned_version(p, source.footage, write, show_progress)
    for kind in (_PICTURE_REPAIRS, _VIEW_REPAIRS):
        version = _add_repairs(p, version, kind, write)
    return _make_result(version, filmed)


def _make_result(version: _Version, filmed: Quality) -> ClipResult:
    """Return the result for a written version; filmed: the quality of the film before repair."""
    v = version
    return ClipResult(v.facts, v.tally, v.arena, filmed, v.quality, v.mended, v.refused)


def _write_planned_version(
    p: FootageSettings, footage: Footage, write: _Make, show_progress: Watch
) -> tuple[_Version, Quality]:
    """Write a clip with the repairs that help its sample; return it and the film's quality.

    The film's quality is that before any repair. show_progress: see `make_clip`.
    """
    sample = _FilmSample(footage)
    is_asked = any(getattr(p, mode) != "never" for mode in REPAIRED_BY.values())
    if not is_asked or not sample.shows_something():
        version = write(_Reading())
        return version, version.quality
    planned = as_filmed = sample.make_version(_Reading())
    for kind in ({"deinterlace"}, _VIEW_REPAIRS):
        planned = _add_repairs(p, planned, kind, sample.make_version)
    mended = planned.mended
    mode = p.drop_repeated_frames
    if mode == "always" or (mode == "auto" and planned.quality.doubled_pct >= DOUBLED_PCT):
        with show_progress("check", footage.frames_expected) as advance:
            source = _read_footage(p, footage, planned.reading)
            as_filmed = _count_repeats(as_filmed, source, advance)
        mended |= choose_repairs(p, as_filmed.quality, 1) & {"undouble"}
    version = _make_repairs(p, as_filmed, mended, write, has_smaller_fault)
    version = replace(version, refused=version.refused | planned.refused)
    if not version.mended:
        return version, version.quality
    filmed, corrector = as_filmed.quality, version.reading.corrector
    if corrector:
        filmed = corrector.measure_film(filmed, version.facts.frame_rate_hz)
    return version, replace(filmed, coding_quantiser=version.quality.coding_quantiser)


def _count_repeats(sample: _Version, source: ClipSource, advance: Callable[[], None]) -> _Version:
    """Measure the repeated frames of a whole film; return its sample's version with these numbers.

    Repeats have no rate, so that none are dropped, if the film's own rate is not constant, or
    frames are lost. `advance()` is called after each frame.
    """
    timing, changes, last = FrameCounts(), list[float](), None
    for frames in source.streams:
        for _, frame in resample_nearest(frames, source.facts.frame_rate, timing):
            grey = to_grey(thin_frame(frame))
            changes.append(float("nan") if last is None else picture_change(last, grey))
            last = grey
            advance()
    repeats = find_repeats(np.array(changes))
    rate = repeats.rate
    if timing.repeated or timing.dropped or source.loss.lost_frames or len(timing.cuts) > 1:
        rate = float("nan")
    quality = replace(sample.quality, doubled_pct=100 * repeats.share, doubled_rate=rate)
    return replace(sample, tally=ClipTally(changes=changes), quality=quality)


@dataclass
class _FilmSample:
    """Stretches of a film, kept in memory while repairs are tried on them."""

    footage: Footage
    _stretches: list[list[Picture]] = field(default_factory=list)
    _fields: Order = ""  # with which they were read

    def read_stretches(self, fields: Order) -> list[list[Picture]]:
        """Return the stretches as lists of frames; read them again if the field order changes."""
        if not self._stretches or self._fields != fields:
            channels = 3 if self.footage.colour else 1
            frame_bytes = channels * self.footage.width_px * self.footage.height_px
            most = max(2 * STRETCHES, min(_MOST, _SAMPLE_BYTES // frame_bytes))
            self._fields = fields
            self._stretches = replace(self.footage, fields=fields).sample_runs(most)
        return self._stretches

    def shows_something(self) -> bool:
        """Return whether at least two frames can be read and the frames are not plain."""
        frames = [thin_frame(frame) for frame in chain(*self.read_stretches(""))]
        return len(frames) > 1 and np.ptp(frames) >= PLAIN_LEVELS

    def make_version(self, reading: _Reading) -> _Version:
        """Read the sample with some repairs, check it, and return its version."""
        stretches = self.read_stretches(reading.fields)
        tally, greys = ClipTally(), []
        for frame in chain(*stretches):
            shown = reading.corrector.correct_frame(frame) if reading.corrector else frame
            tally.add_frame(shown)
            greys.append(to_grey(shown))
        starts = [*accumulate(map(len, stretches[:-1]), initial=0)]
        rate_hz = float(self.footage.frame_rate)
        quality, _, tank = check_film(
            lambda numbers: (greys[k] for k in numbers), rate_hz, tally, starts=starts
        )
        facts = self.footage.clip_facts("file", 0)
        return _Version(reading, facts, tally, np.ones_like(greys[0], bool), quality, tank)


def _write_version(
    p: ClipSettings, source: ClipSource, folder: Path, show_progress: Watch, reading: _Reading
) -> _Version:
    """Write the clip of a film with some repairs, check it, and return its version."""
    film = source
    if isinstance(p, FootageSettings) and source.footage is not None:
        film = _read_footage(p, source.footage, reading)
    word = "mend" if (folder / CLIP_NAME).exists() else "clip"
    with show_progress(word, film.facts.frames) as advance:
        facts, tally, arena = write_clip(film, p, folder, advance)
    if reading.corrector:
        arena = arena & reading.corrector.common_mask()
        save_mask(folder / ARENA_NAME, arena)
    quality, tank = _measure_and_save_quality(facts, tally, folder)
    return _Version(reading, facts, tally, arena, quality, tank)


def _add_repairs(p: FootageSettings, version: _Version, kind: set[str], make: _Make) -> _Version:
    """Return a version with all further repairs of one kind that it needs and that help."""
    todo = choose_repairs(p, version.quality, min(version.arena.shape)) & kind
    todo -= version.mended | version.refused
    if _is_retimed(version.facts):
        todo.discard("undouble")
    return _make_repairs(p, version, todo, make) if todo else version


def _make_repairs(
    p: FootageSettings, before: _Version, todo: Set[str], make: _Make,
    helps: Callable[[str, Quality, Quality], bool] | None = None,
) -> _Version:  # fmt: skip
    """Return a version with some more repairs (of `REPAIRED_BY`), except those that do not help.

    helps(repair, quality before, quality after): None: `is_better`.
    """
    refused = set[str]()
    while True:
        after = make(_plan_reading(before, todo - refused))
        worse = {
            name for name in todo - refused if getattr(p, REPAIRED_BY[name]) == "auto"
            and not (helps or is_better)(name, before.quality, after.quality)
        }  # fmt: skip
        if not worse:
            mended = before.mended | todo - refused
            return replace(after, mended=mended, refused=before.refused | refused)
        refused |= worse


def _is_retimed(facts: VideoFacts) -> bool:
    """Return whether frame k of the clip may show another moment than frame k of the film."""
    retimed = facts.frames_repeated + facts.frames_dropped + facts.frames_missing
    return bool(retimed) or len(facts.segments) > 1


def _plan_reading(before: _Version, todo: Set[str]) -> _Reading:
    """Return how to read a film with more repairs, from what was measured before.

    todo: the repairs, of `REPAIRED_BY`.
    """
    reading, mended = before.reading, before.mended | todo
    if "deinterlace" in todo:
        order = before.quality.field_order
        fields: Order = "tff" if order > 0 else "bff" if order <= 0 else "auto"  # auto: NaN
        reading = reading._replace(fields=fields)
    if "undouble" in todo:
        reading = reading._replace(repeats=find_repeats(np.array(before.tally.changes)))
    if mended & _VIEW_REPAIRS:
        corrector = _FrameCorrector(
            before.tank, light="even_light" in mended, place="steady" in mended
        )
        reading = reading._replace(corrector=corrector)
    return reading


def has_smaller_fault(repair: str, before: Quality, after: Quality) -> bool:
    """Return whether a repair, one of `REPAIRED_BY`, made its fault smaller."""

    def fault(quality: Quality) -> float:
        """Return the size of the fault that the repair is for; 0 if there is none."""
        sizes = {
            "deinterlace": abs(quality.field_order), "undouble": quality.doubled_pct,
            "even_light": max(quality.light_flicker_pct / FLICKER_PCT,
                              quality.light_drift_pct / DRIFT_PCT),
            "steady": quality.shake_px,
        }  # fmt: skip
        return float(np.nan_to_num(sizes[repair]))

    return fault(after) < fault(before)


def is_better(repair: str, before: Quality, after: Quality) -> bool:
    """Return whether a repair made its fault smaller and kept the animals' contrast.

    repair: of `REPAIRED_BY`; before, after: quality of the same frames without and with it.
    """
    old, new = (film.contrast_grey / max(film.noise_grey, 1.0) for film in (before, after))
    # `not <`: an unknown contrast, NaN, does not refuse the repair
    return has_smaller_fault(repair, before, after) and not new < KEPT_CONTRAST * old


def choose_repairs(p: FootageSettings, quality: Quality, smaller_side_px: int) -> set[str]:
    """Return the names of the repairs that a film needs or that parameters demand.

    They are keys of `REPAIRED_BY`. smaller_side_px: of the picture; it limits the shake that can be
    repaired.
    """
    is_small_shift = (
        quality.shake_most_px <= FARTHEST * smaller_side_px
        and quality.shake_apart_px <= APART * quality.shake_px
    )
    converted = isfinite(quality.doubled_rate) and quality.doubled_rate < 1
    faults = {
        "deinterlace": abs(quality.field_order) >= INTERLACED,
        "undouble": quality.doubled_pct >= DOUBLED_PCT and converted,
        "even_light": quality.light_flicker_pct >= FLICKER_PCT
        or quality.light_drift_pct >= DRIFT_PCT,
        "steady": quality.shake_px >= SHAKE_PX and is_small_shift,
    }
    possible = {
        "undouble": converted, "steady": isfinite(quality.shake_px),
        "even_light": isfinite(quality.light_flicker_pct),
    }  # fmt: skip
    modes = {name: getattr(p, REPAIRED_BY[name]) for name in faults}
    asked = {name for name, mode in modes.items() if mode == "always" and possible.get(name, True)}
    return asked | {name for name, mode in modes.items() if mode == "auto" and faults[name]}


def _drop_repeats(
    frames: NumberedFrames, repeated: RepeatedFrames, rate_hz: float
) -> NumberedFrames:
    """Yield time and frame of the frames that show a new picture.

    The k-th picture of the film, from 0, is shown at k / rate_hz seconds. Frames beyond those of
    `repeated` are left out.
    """
    for (_, frame), picture_number, is_repeat in zip(
        frames, repeated.pictures, repeated.repeats, strict=False
    ):
        if not is_repeat:
            yield float(picture_number) / rate_hz, frame


def _read_footage(p: FootageSettings, footage: Footage, reading: _Reading) -> ClipSource:
    """Return a film whose frames are read with repairs: without repeats, and corrected."""
    source = open_footage_source(p, replace(footage, fields=reading.fields))
    facts, streams, repeated = source.facts, source.streams, reading.repeats
    if repeated is not None:
        rate = facts.frame_rate * _simplest_fraction(repeated.rate, len(repeated.repeats))
        streams = [_drop_repeats(frames, repeated, float(rate)) for frames in streams]
        facts = replace(facts, frame_rate=rate, frames=int((~repeated.repeats).sum()))
    if reading.corrector is not None:
        streams = [reading.corrector.correct_frames(frames) for frames in streams]
    return replace(source, facts=facts, streams=streams)


def _simplest_fraction(rate: float, frames: int) -> Fraction:
    """Return the simplest fraction that is close enough to a frame rate for a film's length.

    Close enough is less than half a frame at the film's end. frames: length of the film. If no
    fraction of a denominator up to 1001 is, the nearest of them is returned.
    """
    for denominator in range(1, 1002):
        fraction = Fraction(rate).limit_denominator(denominator)
        if abs(float(fraction) - rate) * frames < 0.5:
            break
    return fraction


def _measure_and_save_quality(
    facts: VideoFacts, tally: ClipTally, folder: Path
) -> tuple[Quality, Picture]:
    """Return a clip's quality and empty tank; save the table of checks and the tank's picture.

    tally: of the clip's frames. folder: receives both files.
    """
    # More threads would decode frames that are not read.
    read = partial(read_chosen_frames, folder / CLIP_NAME, threads=1)
    quality, table, tank = check_film(read, facts.frame_rate_hz, tally, KEY_FRAME_EVERY)
    if facts.coding_quantiser is not None:
        quality = replace(quality, coding_quantiser=facts.coding_quantiser)
    save_table(folder / CHECK_NAME, table, CHECK)
    save_picture(folder / TANK_NAME, tank)
    return quality, tank
