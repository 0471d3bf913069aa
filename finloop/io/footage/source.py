"""A source of frames: its facts before they are read, and its faults."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from finloop.base.errors import FinloopError
from finloop.io.footage.coding import UPRIGHT, Turn
from finloop.io.footage.fields import Order
from finloop.io.video import VideoFacts

SAMPLES = 12  # frames from which colour, depth and range are measured
SAMPLE_PIXELS = 5e5  # pixels of a sample frame, at most
WANTED = "a film that FFmpeg can read (mp4, avi, mov, mkv, webm, gif) or a folder of pictures"
WANTED_TWO = "at least 2 frames: without motion there is nothing to follow"

Frames = Iterator[tuple[float, np.ndarray]]
"""Time (s, 0 = first frame of the source) and picture, uint8 grey or RGB."""
NumberedFrames = Iterator[tuple[float, tuple[int, np.ndarray]]]
"""Time, and the picture with its number in the source: 0 = first frame of the source."""


@dataclass
class Loss:
    """Counts of promised frames that cannot be read; they grow as frames are streamed."""

    damaged: int = 0
    missing_at_end: int = 0

    @property
    def frames(self) -> int:
        """Return the number of all lost frames."""
        return self.damaged + self.missing_at_end

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences for the user about the lost frames; empty if there are none."""
        rest = "the clip holds what could be read"
        notes = []
        if self.damaged:
            notes.append(f"{self.damaged} frames of the film are damaged and left out; {rest}")
        if self.missing_at_end:
            notes.append(f"the film breaks off {self.missing_at_end} frames early; {rest}")
        return tuple(notes)


@dataclass(frozen=True)
class Footage:
    """A film, folder of pictures or TIFF stack, and what is known before reading its frames."""

    path: Path  # the film, the folder or the stack
    # width_px, height_px: of the upright picture
    width_px: int
    height_px: int
    # the rate that the user sets, else the constant rate nearest to the film's time stamps
    frame_rate: Fraction
    colour: bool  # whether `frames` gives RGB
    frames_expected: int  # ticks of `frame_rate` in the range of time, by the file's head
    reader: Callable[["Footage", Loss], NumberedFrames]  # streams the frames of the range
    frames_in_source: int  # frames of the whole source, by the file's head
    turn: Turn = UPRIGHT  # turns the coded picture upright
    # levels of a source of more than 8 bits that become 0 and 255; None for 8 bits
    levels: tuple[float, float] | None = None
    # width : height of a pixel as the file states it; pictures are not resampled
    pixel_aspect: Fraction = Fraction(1)
    fields: Order = ""  # field order of a film that is to be deinterlaced
    notes: tuple[str, ...] = ()  # sentences for the user
    # start_s, end_s: half-open range of time that `frames` gives
    start_s: float = 0.0
    end_s: float = math.inf
    full_range: bool = False  # whether Y spans 0 … 255 although the film does not say so
    # whether frame k has the time k / `frame_rate`, whatever its time stamp
    renumbered: bool = False
    stamp_s: float = 0.0  # time stamp of the first frame
    last_s: float = 0.0  # time of the last frame that the file promises; 0 = the first frame

    def frames(self, loss: Loss) -> Frames:
        """Yield (time [s], picture) for each frame of the range, upright; see `stream_numbered`."""
        return ((time_s, picture) for time_s, (_, picture) in self.stream_numbered(loss))

    def stream_numbered(self, loss: Loss) -> NumberedFrames:
        """Yield (time [s], (number in the source, picture)) for each frame of the range, upright.

        Pictures are (h, w) grey or (h, w, 3) RGB uint8. `loss` counts the frames that cannot be
        read. FinloopError if frames change their size, or a picture of a folder cannot be read.
        """
        return self.reader(self, loss)

    def facts(self, source: str, crf: int) -> VideoFacts:
        """Return the facts of the clip to be made that are known before frames are read.

        source: "zebrafish", "carp" or "file". crf: quality of the coding, 0 = lossless.
        """
        return VideoFacts(
            source=source,
            width_px=self.width_px,
            height_px=self.height_px,
            frames=self.frames_expected,
            frame_rate=self.frame_rate,
            colour=self.colour,
            segments=(),
            source_frames=self.frames_in_source,
            rotation_deg=self.turn.rotation_deg,
            mirrored=self.turn.is_mirrored,
            pixel_aspect=self.pixel_aspect,
            level_low=self.levels[0] if self.levels else 0.0,
            level_high=self.levels[1] if self.levels else 255.0,
            crf=crf,
            notes=self.notes,
        )


def limit_time(footage: Footage, times: np.ndarray, start_s: float, end_s: float) -> Footage:
    """Return the source restricted to the times start_s … end_s, `end_s` excluded.

    times (frames,): of its frames, s from 0. FinloopError if the range is empty, reaches beyond the
    source, or holds fewer than two frames.
    """
    step = 1 / float(footage.frame_rate)
    length = float(times[-1]) + step
    span = f"{start_s:g} s to {'the end' if math.isinf(end_s) else f'{end_s:g} s'}"
    if start_s >= min(end_s, length) or length + step < end_s < math.inf:
        raise FinloopError(
            came=f"{footage.path} is {length:.3f} s long, and {span} was requested",
            wanted=f"0 ≤ start < end ≤ {length:.3f} s",
            do="correct clip.start_s and clip.end_s (null = to the end)",
        )
    footage = replace(footage, start_s=start_s, end_s=end_s)
    inside = times[[in_range(footage, time) for time in times]]
    if inside.size < 2:
        raise FinloopError(
            came=f"{footage.path} shows {inside.size} frame(s) from {span}",
            wanted=WANTED_TWO,
            do="widen clip.start_s … clip.end_s",
        )
    return replace(footage, frames_expected=round((inside[-1] - inside[0]) / step) + 1)


def in_range(footage: Footage, time_s: float | Fraction) -> bool:
    """Return whether a time, s from the first frame, lies in the range start_s … end_s."""
    slack = 0.01 / float(footage.frame_rate)  # makes up for rounded time stamps
    return footage.start_s - slack <= time_s < footage.end_s - slack


def too_few(path: Path, count: int) -> FinloopError:
    """Return the error for a source of `count` frames, fewer than two."""
    came = f"{path} holds {'a single frame' if count else 'no frame that can be decoded'}"
    folder = f", or the folder of pictures: {path.parent}"
    return FinloopError(came, WANTED_TWO, "give a whole film" + (folder if count else ""))


def other_size(what: str, size: tuple[int, int], first: tuple[int, int]) -> FinloopError:
    """Return the error for a frame whose size differs from that of the first frame.

    what: the frame, for the message. size, first: (width, height) in px of it and of the first.
    """
    return FinloopError(
        came=f"{what} is {size[0]}×{size[1]} pixels, those before it {first[0]}×{first[1]} pixels",
        wanted="frames of one size",
        do="film without changing the size, or scale all frames alike first (ffmpeg -vf scale=…)",
    )


def thin_frame(frame: np.ndarray) -> np.ndarray:
    """Keep every k-th row and column of a frame, so that at most `SAMPLE_PIXELS` remain."""
    k = math.ceil(math.sqrt(frame.shape[0] * frame.shape[1] / SAMPLE_PIXELS))
    return frame[::k, ::k]
