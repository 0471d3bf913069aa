"""A source of frames: its facts before they are read, how its pictures are coded, its faults.

Frames are (h, w) grey or (h, w, 3) RGB; x runs right, y down.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np

from finloop.base.errors import FinloopError
from finloop.io.video import VideoFacts

STRETCHES = 8  # of a sample of a film
SAMPLES = 12  # frames from which colour, depth and range are measured
WANTED = "a film that FFmpeg can read (mp4, avi, mov, mkv, webm, gif) or a folder of pictures"
WANTED_TWO = "at least 2 frames: without motion there is nothing to follow"

CHROMA_LEVELS = 12.0  # a pixel this far from the film's own tint is coloured
CHROMA_FRACTION = 5e-4  # least share of coloured pixels of a colour film; a goldfish: 3e-3 of 1 MP
DEEP_PERCENTILES = (0.01, 99.99)  # black and white of a deep film: hot pixels lie outside
# Y of the limited ("studio") range: 16 is black and 235 white (BT.601).
FULL_FROM_LIMITED = np.clip(np.rint((np.arange(256) - 16) * (255 / 219)), 0, 255).astype(np.uint8)

Order = Literal["", "auto", "tff", "bff"]
"""Which field is earlier: upper (tff), lower (bff), as the film states (auto); "" = no fields."""
NumberedFrames = Iterator[tuple[float, tuple[int, np.ndarray]]]
"""Time (s), and the uint8 picture with its number; both are 0 for the source's first frame."""


class Turn(NamedTuple):
    """The mirroring and turn by right angles that makes a film's pictures upright."""

    quarter_turns: int = 0  # 0 … 3, anticlockwise, after the mirroring
    is_mirrored: bool = False  # whether left and right are swapped before the rotation

    @property
    def rotation_deg(self) -> int:
        """Return the anticlockwise rotation: 0, 90, 180 or 270 degrees."""
        return 90 * self.quarter_turns

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """Return a picture mirrored and turned upright; no pixel is lost or changed."""
        mirrored = frame[:, ::-1] if self.is_mirrored else frame
        return np.ascontiguousarray(np.rot90(mirrored, self.quarter_turns))


UPRIGHT = Turn()


@dataclass
class LostFrames:
    """Counts of frames that a film promises but that cannot be read; they grow while it is read."""

    damaged: int = 0
    missing_at_end: int = 0
    gaps: int = 0  # pictures that the numbers in a folder leave out

    @property
    def lost_frames(self) -> int:
        """Return how many frames are lost in all."""
        return self.damaged + self.missing_at_end + self.gaps

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
    """A film, folder of pictures or TIFF, with what is known before its frames are read."""

    path: Path  # the film, the folder or the stack
    width_px: int  # of the upright picture
    height_px: int
    frame_rate: Fraction  # set by the user, else the one nearest to the film's time stamps
    colour: bool  # whether frames are RGB
    frames_expected: int  # ticks of `frame_rate` in the range of time, by the file's head
    reader: Callable[["Footage", LostFrames], NumberedFrames]  # streams the frames of the range
    # Reads runs of so many frames each, spread over the range.
    sampler: Callable[["Footage", int], Iterator[list[np.ndarray]]]
    frames_in_source: int  # frames of the whole source, by the file's head
    turn: Turn = UPRIGHT  # turns the coded picture upright
    levels: tuple[float, float] | None = None  # that become 0 and 255; None for 8 bits
    pixel_aspect: Fraction = Fraction(1)  # width : height of a pixel of the file
    coded_size: tuple[int, int] = (0, 0)  # width and height of a film's pictures in the file
    fields: Order = ""  # field order of a film that is to be deinterlaced
    notes: tuple[str, ...] = ()  # sentences for the user
    start_s: float = 0.0  # half-open range of time that is streamed
    end_s: float = math.inf
    coding_quantiser: float | None = None  # of a film in H.264: 0 is without loss, 51 is worst
    full_range: bool = False  # whether Y spans 0 … 255 although the film does not say so
    renumbered: bool = False  # whether frame k has the time k / frame_rate, whatever its stamp
    stamp_s: float = 0.0  # time stamp of the first frame
    last_s: float = 0.0  # time of the last frame that the file promises; 0 = the first frame

    def stream_numbered(self, loss: LostFrames) -> NumberedFrames:
        """Yield (time [s], (number in the source, picture)) for each frame in the range of time.

        Pictures are upright, (h, w) grey or (h, w, 3) RGB uint8. loss: counts the frames that
        cannot be read. FinloopError if frames change their size, or a picture of a folder cannot be
        read.
        """
        return self.reader(self, loss)

    def sample_runs(self, most: int) -> list[list[np.ndarray]]:
        """Return runs of consecutive frames, spread over the range of time.

        most: frames in all. The frames are those of `stream_numbered`. A film of at most `most`
        frames gives a single run, the whole film.
        """
        if self.frames_expected <= most:
            return [[picture.copy() for _, (_, picture) in self.stream_numbered(LostFrames())]]
        return list(self.sampler(self, most // STRETCHES))

    def clip_facts(self, source: str, crf: int) -> VideoFacts:
        """Return the facts of the clip that will be made of this film, with `segments` still empty.

        source: name of the kind of film. crf: quality of the clip's coding, 0 = lossless.
        """
        low, high = self.levels or (0.0, 255.0)
        return VideoFacts(
            source=source, width_px=self.width_px, height_px=self.height_px,
            frames=self.frames_expected, frame_rate=self.frame_rate, colour=self.colour,
            segments=(), source_frames=self.frames_in_source, crf=crf, notes=self.notes,
            rotation_deg=self.turn.rotation_deg, mirrored=self.turn.is_mirrored,
            pixel_aspect=self.pixel_aspect, level_low=low, level_high=high,
            coding_quantiser=self.coding_quantiser,
        )  # fmt: skip


def restrict_time(footage: Footage, times: np.ndarray, start_s: float, end_s: float) -> Footage:
    """Return a film restricted to the times from `start_s` to before `end_s`.

    times: of all its frames [s], from 0. FinloopError if the range is empty, reaches beyond the
    film, or holds fewer than two frames.
    """
    step = 1 / float(footage.frame_rate)
    length = float(times[-1]) + step
    span = f"{start_s:g} s to {'the end' if math.isinf(end_s) else f'{end_s:g} s'}"
    # An end up to one frame behind the film's is accepted.
    if start_s >= min(end_s, length) or length + step < end_s < math.inf:
        raise FinloopError(
            came=f"{footage.path} is {length:.3f} s long, and {span} was requested",
            wanted=f"0 ≤ start < end ≤ {length:.3f} s",
            do="correct clip.start_s and clip.end_s (null = to the end)",
        )
    footage = replace(footage, start_s=start_s, end_s=end_s)
    inside = times[[is_in_range(footage, time) for time in times]]
    if inside.size < 2:
        raise FinloopError(
            came=f"{footage.path} shows {inside.size} frame(s) from {span}",
            wanted=WANTED_TWO,
            do="widen clip.start_s … clip.end_s",
        )
    return replace(footage, frames_expected=round((inside[-1] - inside[0]) / step) + 1)


def is_in_range(footage: Footage, time_s: float | Fraction) -> bool:
    """Return whether a time, in s from the first frame, lies in the film's range of time."""
    slack = 0.01 / float(footage.frame_rate)  # makes up for rounded time stamps
    return footage.start_s - slack <= time_s < footage.end_s - slack


def square_pixel_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """Return the width and height of a picture that is enlarged until its pixels are square.

    width, height: in the file; aspect: width : height of a pixel there.
    """
    if aspect >= 1:
        return round(width * aspect), height
    return width, round(height / aspect)


def no_rate_error(path: Path, what: str) -> FinloopError:
    """Return the error for footage that does not state its frame rate.

    what: a phrase on what it consists of, such as "40 pictures".
    """
    return FinloopError(
        came=f"{path}: {what}, which do not state how fast they were shot",
        wanted="their frame rate",
        do="give it: -S clip.frame_rate_hz=30.0",
    )


def too_few_frames_error(path: Path, count: int) -> FinloopError:
    """Return the error for a film of fewer than two frames; count: how many it has."""
    if path.suffix.lower() == ".webp":
        do = "save it as GIF, APNG or a folder of pictures: FFmpeg does not read WebP that moves"
        return FinloopError(f"{path} is a WebP, of which one frame is read", WANTED_TWO, do)
    came = f"{path} holds {'a single frame' if count else 'no frame that can be decoded'}"
    folder = f", or the folder of pictures: {path.parent}"
    return FinloopError(came, WANTED_TWO, "give a whole film" + (folder if count else ""))


def other_size_error(
    frame_name: str, size: tuple[int, int], first_size: tuple[int, int]
) -> FinloopError:
    """Return the error for a frame whose size is not that of the first frame.

    frame_name: for the message. size, first_size: width and height [px] of both frames.
    """
    return FinloopError(
        came=f"{frame_name} is {size[0]}×{size[1]} pixels, "
        f"those before it {first_size[0]}×{first_size[1]} pixels",
        wanted="frames of one size",
        do="film without changing the size, or scale all frames alike first (ffmpeg -vf scale=…)",
    )


def nearest_turn(matrix: Sequence[int] | np.ndarray) -> tuple[Turn, bool]:
    """Return the turn by right angles nearest to a film's display matrix, and whether it is exact.

    matrix: a, b, _, c, d, …; a pixel goes to x′ = a x + c y, y′ = b x + d y (y down), to be
    upright.
    """
    a, b, _, c, d = (float(value) for value in matrix[:5])
    if abs(a) + abs(d) >= abs(b) + abs(c):  # x stays horizontal: 0° or 180°
        return Turn(quarter_turns=2 if d < 0 else 0, is_mirrored=(a < 0) != (d < 0)), b == c == 0
    return Turn(quarter_turns=3 if c < 0 else 1, is_mirrored=(b < 0) == (c < 0)), a == d == 0


def measure_chroma_fraction(frames: Iterable[np.ndarray]) -> float:
    """Return the share of pixels, 0 … 1, that are coloured, over RGB frames (h, w, 3).

    A pixel is coloured if it differs clearly from its frame's tint. An even tint, as of an infrared
    camera, does not count.
    """
    shares = []
    for frame in frames:
        chroma = cv2.cvtColor(frame, cv2.COLOR_RGB2YCrCb)[..., 1:].astype(np.float32)
        chroma -= np.median(chroma, axis=(0, 1))
        shares.append(float((np.hypot(chroma[..., 0], chroma[..., 1]) > CHROMA_LEVELS).mean()))
    return float(np.mean(shares)) if shares else 0.0


def choose_deep_levels(frames: Iterable[np.ndarray]) -> tuple[float, float]:
    """Choose the two grey levels that become 0 and 255 in a film of more than 8 bits.

    They are percentiles over sampled frames: cameras rarely fill their 16 bits, and a few hot
    pixels must not decide. The second is above the first; of whole numbers, by 1 at least.
    """
    frames = list(frames)
    whole_numbers = all(frame.dtype.kind in "ui" for frame in frames)
    percentiles = np.array([np.percentile(frame, DEEP_PERCENTILES) for frame in frames])
    low, high = float(percentiles[:, 0].min()), float(percentiles[:, 1].max())
    least = 1.0 if whole_numbers or high <= low else high - low
    return low, max(high, low + least)


def stretch_levels(frame: np.ndarray, low: float, high: float) -> np.ndarray:
    """Map a frame's levels `low` … `high` to 0 … 255, clip others; return the frame as uint8."""
    scaled = (frame.astype(np.float32) - low) * (255 / (high - low))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
