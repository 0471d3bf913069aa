"""Film from any source: whatever FFmpeg opens, a folder of pictures, a stack of TIFF pages.

`open_footage` inspects the source once (rate, colour, orientation, depth) and reports its faults.
`Footage.frames` then streams its frames, upright, as uint8 grey or RGB, each with its time. Only a
few frames are in memory at a time.
"""

import math
from fractions import Fraction
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.footage.film import open_film
from finloop.io.footage.pictures import open_pictures
from finloop.io.footage.source import WANTED, Footage, Loss, NumberedFrames, limit_time
from finloop.io.footage.timing import Timing, nearest_in_time, segments_of

__all__ = [
    "Footage", "Loss", "NumberedFrames", "Timing", "nearest_in_time", "open_footage", "segments_of",
]  # fmt: skip

TIFF_SUFFIXES = {".tif", ".tiff"}


def open_footage(
    path: Path,
    *,
    frame_rate_hz: float | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
    colour: bool | None = None,
) -> Footage:
    """Inspect a source and choose how to read it; no frame is converted yet.

    FinloopError if there is nothing at `path`, it is no film, holds fewer than two frames, states
    no frame rate, or is shorter than the range of time.

    path: a film, a folder of pictures (in natural order: 2 before 10) or a TIFF with many pages.
    frame_rate_hz: replaces the file's rate: every frame is kept, frame k at the time k /
    `frame_rate_hz`. start_s, end_s: half-open range of time, at `frame_rate_hz` if given; `end_s`
    None = to the end. colour: True = RGB, False = grey, None = RGB where the film has colours.
    """
    rate = None if frame_rate_hz is None else Fraction(frame_rate_hz).limit_denominator(1001)
    if not path.exists():
        raise FinloopError(
            came=f"there is nothing at {path.absolute()}",
            wanted=WANTED,
            do="correct the path, or make it absolute: an experiment may run in another folder",
        )
    if path.is_dir() or path.suffix.lower() in TIFF_SUFFIXES:
        footage, times = open_pictures(path, rate, colour)
    else:
        footage, times = open_film(path, rate, colour)
    return limit_time(footage, times, start_s, math.inf if end_s is None else end_s)
