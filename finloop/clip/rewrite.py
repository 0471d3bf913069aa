"""Write the normalised clip of a film, check it, and write it again with its faults repaired.

First the pictures are repaired (fields, doubled ones), then their light and shake, which can only
be measured on whole pictures. A film without faults stays unchanged: its clip keeps every byte.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Mask, Picture
from finloop.clip.check import CHECK, CHECK_NAME, TANK_NAME, ClipTally, Quality, check_film
from finloop.clip.doubled import RepeatedFrames, find_repeats
from finloop.clip.light import measure_gain, undo_gain
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
from finloop.clip.write import ClipSource, open_clip_source, write_clip
from finloop.io.footage.source import NumberedFrames, Order
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
_EDGE = 2  # px; reach of a Lanczos kernel

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
        """Return metrics by name: the clip's quality; the unrepaired film's, if it was repaired.

        The latter begin with `filmed_`. For each repair there is `mended_…`, 0 or 1, and for each
        that was tried but made the film no better `refused_…`, 1.
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
    # Of all frames so far: the largest shift to the left and up, and that to the right and down.
    _left_up_px: tuple[float, float] = (0.0, 0.0)
    _right_down_px: tuple[float, float] = (0.0, 0.0)
    _marks: Landmarks | None = None
    _last: Shift = field(default=STILL)

    def correct_frames(self, frames: NumberedFrames) -> NumberedFrames:
        """Yield the frames with corrected brightness and place; times and numbers do not change."""
        for time_s, (number, frame) in frames:
            if self.light:
                frame = undo_gain(frame, measure_gain(frame, self.tank))
            if self.place:
                frame = self._steady_frame(frame)
            yield time_s, (number, frame)

    def _steady_frame(self, frame: Picture) -> Picture:
        """Return a frame moved back by its shift against the empty tank, and store the shift."""
        self._marks = self._marks or find_landmarks(self.tank)
        shift = measure_shift(to_grey(frame), self._marks, self._last)
        shift = self._last if shift is UNKNOWN else shift
        self._last = shift
        (left, up), (right, down) = self._left_up_px, self._right_down_px
        self._left_up_px = max(left, -shift.x), max(up, -shift.y)
        self._right_down_px = max(right, shift.x), max(down, shift.y)
        return undo_shift(frame, shift)

    def common_mask(self) -> Mask:
        """Return the mask (h, w) of the pixels that every corrected frame shows."""
        height, width = self.tank.shape[:2]
        mask = np.zeros((height, width), bool)
        sides = (*self._left_up_px, *self._right_down_px)
        left, top, right, bottom = (int(np.ceil(px)) + _EDGE if px else 0 for px in sides)
        mask[top : height - bottom, left : width - right] = True
        return mask


class _Reading(NamedTuple):
    """How a film is read for its clip: the repairs that are made meanwhile."""

    fields: Order = ""  # the earlier field; "": the film is not interlaced
    repeats: RepeatedFrames | None = None  # to be left out
    corrector: _FrameCorrector | None = None  # of light and place


def make_clip(
    p: ClipSettings, source: ClipSource, folder: Path,
    show_progress: Watch = lambda *_: nullcontext(lambda: None),
) -> ClipResult:  # fmt: skip
    """Write a film as a clip: upright, at a constant frame rate, with the footage's faults mended.

    A repair that is chosen automatically stays only if it makes the film better (`is_better`).
    The folder also receives a table of checks (`CHECK_NAME`) and a picture of the empty tank
    (`TANK_NAME`). show_progress(word, frames): a context that yields a function to call after each
    frame. FinloopError if the film has fewer than two readable or only plain frames, or the arena
    does not fit.
    """
    with show_progress("clip", source.facts.frames) as advance:
        facts, tally, arena = write_clip(source, p, folder, advance)
    filmed, tank = _check_clip(facts, tally, folder)
    result = ClipResult(facts, tally, arena, filmed, filmed, frozenset())
    if not isinstance(p, FootageSettings):
        return result
    reading = _Reading()
    for kind in (_PICTURE_REPAIRS, _VIEW_REPAIRS):
        todo = choose_repairs(p, result.quality, min(arena.shape)) & kind
        if _is_retimed(result.facts):
            todo.discard("undouble")
        if todo:
            result, tank, reading = _repair_clip(
                p, todo, result, tank, reading, folder, show_progress
            )
    return result


def _is_retimed(facts: VideoFacts) -> bool:
    """Return whether frame k of a clip may show another moment than frame k of the film."""
    retimed = facts.frames_repeated + facts.frames_dropped + facts.frames_missing
    return bool(retimed) or len(facts.segments) > 1


def _repair_clip(
    p: FootageSettings, todo: set[str], before: ClipResult, tank: Picture, reading: _Reading,
    folder: Path, show_progress: Watch,
) -> tuple[ClipResult, Picture, _Reading]:  # fmt: skip
    """Write a clip again with more repairs; return it, its empty tank, and how the film is read.

    Repairs that make the film no better are left out, and the clip is written once more, until all
    help. todo: the repairs, of `REPAIRED_BY`. before, tank, reading: the clip, its empty tank and
    how the film is read, so far.
    """
    refused = before.refused
    while True:
        trial = _add_repairs(reading, todo, before, tank)
        source = _reopen_film(p, trial)
        with show_progress("mend", source.facts.frames) as advance:
            facts, tally, arena = write_clip(source, p, folder, advance)
        if trial.corrector:
            arena = arena & trial.corrector.common_mask()
            save_mask(folder / ARENA_NAME, arena)
        quality, new_tank = _check_clip(facts, tally, folder)
        worse = {
            name for name in todo if getattr(p, REPAIRED_BY[name]) == "auto"
            and not is_better(name, before.quality, quality)
        }  # fmt: skip
        if not worse:
            mended = before.mended | todo
            result = ClipResult(facts, tally, arena, before.filmed, quality, mended, refused)
            return result, new_tank, trial
        todo, refused = todo - worse, refused | worse


def _add_repairs(reading: _Reading, todo: set[str], before: ClipResult, tank: Picture) -> _Reading:
    """Return how the film is read with more repairs, set to what was measured in its clip so far.

    todo: the repairs, of `REPAIRED_BY`; before, tank: the clip so far and its empty tank.
    """
    if "deinterlace" in todo:
        order = before.quality.field_order
        fields: Order = "tff" if order > 0 else "bff" if order <= 0 else "auto"  # auto: NaN
        reading = reading._replace(fields=fields)
    if "undouble" in todo:
        reading = reading._replace(repeats=find_repeats(np.array(before.tally.changes)))
    if todo & _VIEW_REPAIRS:
        corrector = _FrameCorrector(tank, light="even_light" in todo, place="steady" in todo)
        reading = reading._replace(corrector=corrector)
    return reading


def is_better(repair: str, before: Quality, after: Quality) -> bool:
    """Return whether a repair made its fault smaller, and the animals stand out nearly as before.

    repair: of `REPAIRED_BY`; before, after: quality of the clip without and with it.
    """

    def fault(quality: Quality) -> float:
        """Return the size of the fault that the repair is for, 0 where it is not seen."""
        sizes = {
            "deinterlace": abs(quality.field_order), "undouble": quality.doubled_pct,
            "even_light": max(quality.light_flicker_pct / FLICKER_PCT,
                              quality.light_drift_pct / DRIFT_PCT),
            "steady": quality.shake_px,
        }  # fmt: skip
        return float(np.nan_to_num(sizes[repair]))

    old, new = (film.contrast_grey / max(film.noise_grey, 1.0) for film in (before, after))
    # `not <`: an unknown contrast, NaN, does not refuse the repair
    return fault(after) < fault(before) and not new < KEPT_CONTRAST * old


def choose_repairs(p: FootageSettings, quality: Quality, smaller_side_px: int) -> set[str]:
    """Return the names of the repairs to make: those needed, and those that parameters ask for.

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
    """Yield time and frame of those frames that do not repeat the one before.

    The k-th picture of the film, from 0, is shown at k / rate_hz seconds. Frames beyond those of
    `repeated` are left out.
    """
    for (_, frame), picture_number, is_repeat in zip(
        frames, repeated.pictures, repeated.repeats, strict=False
    ):
        if not is_repeat:
            yield float(picture_number) / rate_hz, frame


def _reopen_film(p: FootageSettings, reading: _Reading) -> ClipSource:
    """Open a film again so that its frames are read without repeats and corrected."""
    source = open_clip_source(p, reading.fields)
    facts, streams, repeated = source.facts, source.streams, reading.repeats
    if repeated is not None:
        rate = facts.frame_rate * _simplest_fraction(repeated.rate, len(repeated.repeats))
        streams = [_drop_repeats(frames, repeated, float(rate)) for frames in streams]
        facts = replace(facts, frame_rate=rate, frames=int((~repeated.repeats).sum()))
    if reading.corrector is not None:
        streams = [reading.corrector.correct_frames(frames) for frames in streams]
    return replace(source, facts=facts, streams=streams)


def _simplest_fraction(rate: float, frames: int) -> Fraction:
    """Return the simplest fraction that differs from a rate by less than half a frame in a film.

    frames: length of the film. If none of a denominator up to 1001 does, the nearest of them.
    """
    for denominator in range(1, 1002):
        fraction = Fraction(rate).limit_denominator(denominator)
        if abs(float(fraction) - rate) * frames < 0.5:
            break
    return fraction


def _check_clip(facts: VideoFacts, tally: ClipTally, folder: Path) -> tuple[Quality, Picture]:
    """Measure a clip's light, camera and coding; write and return its quality and empty tank."""
    # More threads would decode frames that are not read.
    read = partial(read_chosen_frames, folder / CLIP_NAME, threads=1)
    quality, table, tank = check_film(read, facts.frame_rate_hz, tally, KEY_FRAME_EVERY)
    if facts.coding_quantiser is not None:
        quality = replace(quality, coding_quantiser=facts.coding_quantiser)
    save_table(folder / CHECK_NAME, table, CHECK)
    save_picture(folder / TANK_NAME, tank)
    return quality, tank
