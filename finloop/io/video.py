"""The normalised clip: its facts, and its frames read one by one or at random.

`io.movie.VideoWriter` writes it and documents its coding. Pixels are (row, column) = (y down, x
right), uint8.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import av.error
import cv2
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from finloop.base.errors import FinloopError, UndecodableError
from finloop.base.schema import Schema, columns
from finloop.io.checksums import check_file
from finloop.io.picture import decode_picture, save_picture
from finloop.io.record import load_json, save_json

KEY_FRAME_EVERY = 12  # a seek decodes at most 11 frames in vain, for about 5 % more bytes
# Fixed: x264 gives the same bytes only with the same number of threads, and the colour conversion
# would take every core of the machine.
THREADS = 2

CLIP_NAME, FACTS_NAME = "clip.mp4", "facts.json"
GRAIN_NAME = "grain.mp4"  # pictures of the empty tank, coded as the clip, without loss
ARENA_NAME, TRUTH_NAME, FRAMES_NAME = "arena.png", "truth.parquet", "frames.parquet"

FRAMES = Schema(*columns("int32", "1", "frame", "source_frame"))
"""Which frame of the film a frame of the clip shows, both from 0; of several films that follow one
another, frames are counted on."""


@dataclass(frozen=True)
class VideoFacts:
    """Facts about a normalised clip, stored beside it as `facts.json`."""

    source: str  # "zebrafish", "carp" or "file"
    width_px: int  # size of the clip
    height_px: int
    frames: int
    frame_rate: Fraction  # frames per second, exact
    colour: bool  # whether the clip carries colour; mono film has only a Y plane
    segments: tuple[tuple[int, int], ...]  # frame ranges [start, stop) filmed without a cut
    frames_repeated: int = 0  # by re-timing to a constant rate
    frames_dropped: int = 0  # by re-timing
    frames_missing: int = 0  # frames that the file promises and that could not be decoded
    source_frames: int = 0  # frames of the whole film, also beyond the range of the clip
    rotation_deg: int = 0  # how far the coded picture was turned anticlockwise to be upright
    mirrored: bool = False  # whether left and right were exchanged, before turning
    pixel_aspect: Fraction = Fraction(1)  # width : height of a pixel of the file; square here
    level_low: float = 0.0  # grey level of a source of more than 8 bits that became 0
    level_high: float = 255.0  # the one that became 255
    coding_quantiser: float | None = None  # of a film in H.264: 0 is without loss, 51 is worst
    mm_per_px: float | None = None  # mm, of a pixel of the clip; None: not known
    crf: int = 0  # quality of the coding, 0 = lossless
    notes: tuple[str, ...] = ()  # sentences about the source for the user

    @property
    def frame_rate_hz(self) -> float:
        """Return the frame rate, frames per second, as a float."""
        return float(self.frame_rate)


def save_facts(path: Path, facts: VideoFacts) -> None:
    """Write a clip's facts as JSON; add the frame rate as a plain number, `frame_rate_hz`."""
    fractions = {"frame_rate": str(facts.frame_rate), "pixel_aspect": str(facts.pixel_aspect)}
    save_json(path, asdict(facts) | fractions | {"frame_rate_hz": facts.frame_rate_hz})


def load_facts(path: Path) -> VideoFacts:
    """Read the facts of a clip that `save_facts` wrote; FinloopError if missing or damaged."""
    keys = ", ".join(field.name for field in fields(VideoFacts))
    do = "make the clip again: `dvc repro --force clip`"
    return load_json(path, _parse_facts, f"the facts of a clip: JSON with {keys}", do)


def _parse_facts(record: dict[str, Any]) -> VideoFacts:
    """Convert the content of facts.json to `VideoFacts`; any error if it is damaged."""
    facts = dict(record)
    del facts["frame_rate_hz"]  # it repeats `frame_rate`, for readers
    facts |= {name: Fraction(record[name]) for name in ("frame_rate", "pixel_aspect")}
    facts["segments"] = tuple((int(start), int(stop)) for start, stop in record["segments"])
    return VideoFacts(**facts | {"notes": tuple(record["notes"])})


@contextmanager
def _open_clip(path: Path, threads: int) -> Iterator[tuple[InputContainer, VideoStream, Fraction]]:
    """Open a clip; yield its container, its video stream and the time from frame to frame.

    That time is in the unit of the stream's time stamps. threads: of the decoder. FinloopError if
    the clip cannot be read.
    """
    try:
        with av.open(str(check_file(path))) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = threads
            yield container, stream, Fraction(stream.duration or 0, stream.frames)
    except (OSError, av.error.FFmpegError, IndexError, ZeroDivisionError) as error:
        raise _clip_error(path, str(error), FinloopError) from error


def _clip_error(path: Path, why: str, kind: type[FinloopError] = UndecodableError) -> FinloopError:
    """Return the error, of class `kind`, for a clip that cannot be read; why: the reason."""
    return kind(
        came=f"{path} cannot be read as a normalised clip ({why})",
        wanted="the clip as the stage `clip` wrote it",
        do="make the clip again: `dvc repro --force clip`",
    )


def _decode_clip(
    path: Path, container: InputContainer, stream: VideoStream
) -> Iterator[VideoFrame]:
    """Yield the frames of an open clip from its present position on.

    UndecodableError at a damaged frame; path: of the clip, for its message.
    """
    try:
        yield from container.decode(stream)
    except av.error.InvalidDataError as error:
        raise _clip_error(path, str(error)) from error


def _frame_number(frame: VideoFrame, step: Fraction) -> int:
    """Return the number of a decoded frame in its clip, from 0; step: ticks from frame to frame."""
    return round(Fraction(frame.pts or 0) / step)


def view_grey_levels(frame: VideoFrame) -> np.ndarray:
    """Return the grey levels (h, w) uint8 of a decoded frame, a view of its brightness (Y) plane.

    It is read-only, because the decoder predicts later frames from this memory.
    """
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
    rows.flags.writeable = False
    return rows[: frame.height, : frame.width]


def _convert_to_rgb(frame: VideoFrame) -> np.ndarray:
    """Convert a decoded frame to (h, w, 3) uint8 RGB, by the range and matrix that it states."""
    return frame.to_ndarray(format="rgb24", threads=THREADS)


def require_frame_count(path: Path, frames: int) -> None:
    """Raise FinloopError if a clip cannot be read, or has not exactly `frames` frames."""
    with _open_clip(path, 1) as (_, stream, _):
        if stream.frames != frames:
            raise _clip_error(path, f"it has {stream.frames} frames, not {frames}", FinloopError)


def read_frames(
    path: Path, *, colour: bool = False, start: int = 0, stop: int | None = None,
    threads: int = THREADS,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Yield the frames from `start` to before `stop` of a normalised clip, one after the other.

    They are (h, w, 3) RGB if `colour`, else (h, w) grey, uint8; `stop` None = to the end. threads:
    of the decoder. FinloopError if the clip cannot be read; UndecodableError if a frame cannot, or
    the clip ends early.
    """
    with _open_clip(path, threads) as (container, stream, step):
        convert = _convert_to_rgb if colour else view_grey_levels
        stop = stream.frames if stop is None else min(stop, stream.frames)
        if start >= stop:
            return
        if start > 0:
            container.seek(int(start * step), stream=stream)
        expected = start
        for frame in _decode_clip(path, container, stream):
            number = _frame_number(frame, step)
            if number < start:  # a seek goes to a key frame before it
                continue
            if number != expected:
                raise _clip_error(path, f"frame {expected} is missing")
            yield convert(frame)
            expected += 1
            if expected == stop:
                return
        raise _clip_error(path, f"it ends before frame {expected}")


def read_chosen_frames(
    path: Path, frames: Sequence[int], *, colour: bool = False, threads: int = THREADS
) -> Iterator[np.ndarray]:
    """Yield chosen frames of a normalised clip, (h, w, 3) RGB if `colour`, else (h, w) grey, uint8.

    frames: their numbers, ascending, also repeated; ValueError if not. threads: of the decoder.
    FinloopError if the clip cannot be read; UndecodableError if a frame cannot, or is missing.
    """
    if any(later < earlier for earlier, later in pairwise(frames)):
        raise ValueError("frames must ascend")
    with _open_clip(path, threads) as (container, stream, step):
        convert = _convert_to_rgb if colour else view_grey_levels
        decoded: Iterator[VideoFrame] = iter(())
        # Number of the last decoded frame, and itself; at first so that the film is sought.
        position, current = -KEY_FRAME_EVERY, None
        for number in frames:
            if number // KEY_FRAME_EVERY * KEY_FRAME_EVERY > position:  # its key frame is ahead
                container.seek(int(number * step), stream=stream)
                decoded, current = _decode_clip(path, container, stream), None
            while current is None or position < number:
                current = next(decoded, None)
                if current is None:
                    raise _clip_error(path, f"frame {number} is missing")
                position = _frame_number(current, step)
            yield convert(current)


def save_mask(path: Path, mask: np.ndarray) -> None:
    """Write a boolean mask (h, w) as an 8-bit picture, 255 where True."""
    save_picture(path, mask.astype(np.uint8) * 255)


def load_mask(path: Path, width: int, height: int) -> np.ndarray:
    """Read a mask picture as boolean (height, width), True where it is at least half bright.

    FinloopError if there is no such picture, it cannot be read, or it has another size.
    """
    wanted = f"a mask picture of {width}×{height} pixels, bright inside the arena, black outside"
    do = "give the path of such a picture (PNG is fine)"
    if not path.is_file():
        raise FinloopError(f"there is no mask picture at {path}", wanted, do)
    mask = decode_picture(path, cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise FinloopError(f"{path} cannot be read as a picture", wanted, do)
    if mask.shape != (height, width):
        came = f"{path} is {mask.shape[1]}×{mask.shape[0]} pixels"
        raise FinloopError(came, wanted, do)
    return mask >= 128
