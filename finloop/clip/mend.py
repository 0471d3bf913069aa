"""Repair faults of a film: woven fields, doubled pictures, light, shake.

A film without faults stays unchanged: its clip keeps every byte.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

import numpy as np

from finloop.base.arrays import Mask, Picture
from finloop.clip.check import Quality, grey
from finloop.clip.doubled import Doubled
from finloop.clip.light import gain, undo_gain
from finloop.clip.settings import File
from finloop.clip.shake import (
    STILL,
    UNKNOWN,
    Landmarks,
    Shift,
    find_landmarks,
    measure_shift,
    undo_shift,
)
from finloop.clip.verdict import DOUBLED_PCT, DRIFT_PCT, FLICKER_PCT, INTERLACED, SHAKE_PX

# Share of the picture's smaller side. A camera that moves farther loses a strip of that width on
# both borders, and sees the tank from another place, so a single shift cannot repair it.
FARTHEST = 0.03
APART = 0.3  # share of the shake; parts of the picture that differ by more did not just shift
_EDGE = 2  # px; reach of a Lanczos kernel

REPAIRED_BY = {
    "deinterlace": "deinterlace",
    "undouble": "drop_repeated_frames",
    "even_light": "correct_light",
    "steady": "stabilize",
}
"""The parameter that says when a repair is made, by the repair's name among the metrics."""

Frames = Iterator[tuple[float, tuple[int, Picture]]]
"""Time, s, number in the film, and picture."""


def repairs(p: File, q: Quality, smaller_px: int) -> set[str]:
    """Return the names of the repairs, keys of `REPAIRED_BY`, that a film is to get.

    p: whether each repair is made always, never, or where the film is faulty (`auto`); q: the
    film's quality; smaller_px: the picture's smaller side, which limits the shake that can be
    repaired.
    """
    far = q.shake_most_px <= FARTHEST * smaller_px and q.shake_apart_px <= APART * q.shake_px
    converted = isfinite(q.doubled_rate) and q.doubled_rate < 1
    faults = {
        "deinterlace": abs(q.field_order) >= INTERLACED,
        "undouble": q.doubled_pct >= DOUBLED_PCT and converted,
        "even_light": q.light_flicker_pct >= FLICKER_PCT or q.light_drift_pct >= DRIFT_PCT,
        "steady": q.shake_px >= SHAKE_PX and far,
    }
    possible = {"undouble": converted, "steady": isfinite(q.shake_px)}
    modes = {name: getattr(p, REPAIRED_BY[name]) for name in faults}
    return {
        name
        for name, mode in modes.items()
        if (mode == "always" and possible.get(name, True)) or (mode == "auto" and faults[name])
    }


def field_of(q: Quality) -> Literal["auto", "tff", "bff"]:
    """Return FFmpeg's name of the earlier field: `tff` upper, `bff` lower, `auto` unknown."""
    if not isfinite(q.field_order):
        return "auto"
    return "tff" if q.field_order > 0 else "bff"


def new_pictures(take: Frames, twice: Doubled, rate_hz: float) -> Frames:
    """Yield the frames that do not repeat the frame before, at the times of their pictures.

    take: (time [s], (number, frame)) of every frame; twice: its repeats; rate_hz: different
    pictures per second. A frame's new time is the number of its picture / rate_hz.
    """
    for (_, frame), picture, repeats in zip(take, twice.pictures, twice.repeats, strict=False):
        if not repeats:
            yield float(picture) / rate_hz, frame


@dataclass
class FrameCorrector:
    """Brings frames to the light and the place of the still tank (h, w) or (h, w, 3).

    light, place: whether to correct the light, and the place. right_px … up_px: the largest shift
    of a frame to that side, so far.
    """

    tank: Picture
    light: bool
    place: bool
    right_px: float = 0.0
    left_px: float = 0.0
    down_px: float = 0.0
    up_px: float = 0.0
    _marks: Landmarks | None = None
    _last: Shift = field(default=STILL)

    def __call__(self, take: Frames) -> Frames:
        """Yield the frames of `take`, light and place corrected, times and numbers unchanged."""
        for time_s, (number, frame) in take:
            if self.light:
                frame = undo_gain(frame, gain(frame, self.tank))
            if self.place:
                frame = self._steady_frame(frame)
            yield time_s, (number, frame)

    def _steady_frame(self, frame: Picture) -> Picture:
        self._marks = self._marks or find_landmarks(self.tank)
        by = measure_shift(grey(frame), self._marks, self._last)
        by = self._last if by is UNKNOWN else by
        self._last = by
        self.right_px, self.left_px = max(self.right_px, by.x), max(self.left_px, -by.x)
        self.down_px, self.up_px = max(self.down_px, by.y), max(self.up_px, -by.y)
        return undo_shift(frame, by)

    def common_mask(self) -> Mask:
        """Return the mask (h, w) of the pixels that every frame so far shows after its shift."""
        mask = np.zeros((self.tank.shape[0], self.tank.shape[1]), bool)
        height, width = self.tank.shape[:2]
        sides = (self.up_px, self.down_px, self.left_px, self.right_px)
        top, bottom, left, right = (int(np.ceil(px)) + _EDGE if px else 0 for px in sides)
        mask[top : height - bottom, left : width - right] = True
        return mask
