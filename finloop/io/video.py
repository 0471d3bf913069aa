"""The normalised clip: H.264 of constant frame rate, written whole, read back frame by frame.

Mono film is coded as 4:0:0, so that the decoded Y plane *is* the picture: at `crf` 0 the grey
levels come back bit for bit. Colour film is coded in full-range BT.601, 4:2:0 where both sides
are even and 4:4:4 where one is odd, so that no row or column is cut off. Every 12th frame can be
jumped to. Pixels are (row, column) = (y down, x right), uint8.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, fields
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import av.error
import cv2
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace
from av.video.stream import VideoStream

from finloop.errors import FinloopError
from finloop.io.atomic import whole_file

KEY_FRAME_EVERY = 12  # a jump decodes at most 11 frames for nothing, for about 5 % more bytes
# A fixed number: x264 gives the same bytes again only for the same number of threads, and the
# colour conversion would start as many as the machine has cores, whoever else may use them.
THREADS = 2

CLIP_NAME, FACTS_NAME, ARENA_NAME, TRUTH_NAME = (
    "clip.mp4",
    "facts.json",
    "arena.png",
    "truth.parquet",
)


@dataclass(frozen=True)
class VideoFacts:
    """What there is to know about the normalised clip, kept beside it as `facts.json`.

    Attributes
    ----------
    source
        "zebrafish", "carp" or "file".
    width_px, height_px, frames
        Size of the clip.
    frame_rate
        Frames per second, exact.
    colour
        Whether the clip carries colour; mono film has a Y plane alone.
    segments
        Half-open frame ranges [start, stop) filmed without a cut.
    frames_repeated, frames_dropped
        By re-timing a variable frame rate to a constant one.
    frames_missing
        Promised by the file but not there or not decodable.
    rotation_deg
        By which the coded picture was turned anticlockwise to stand upright.
    mirrored
        Whether it was also mirrored (left and right swapped, before turning).
    pixel_aspect
        Width : height of one pixel as the file states it; pixels are never resampled.
    level_low, level_high
        Grey levels of a deep (over 8 bits) source that became 0 and 255; 0 and 255 where
        nothing was stretched.
    crf
        Quality of the coding, 0 = lossless.
    notes
        Sentences about the source that a person should know.
    """

    source: str
    width_px: int
    height_px: int
    frames: int
    frame_rate: Fraction
    colour: bool
    segments: tuple[tuple[int, int], ...]
    frames_repeated: int = 0
    frames_dropped: int = 0
    frames_missing: int = 0
    rotation_deg: int = 0
    mirrored: bool = False
    pixel_aspect: Fraction = Fraction(1)
    level_low: float = 0.0
    level_high: float = 255.0
    crf: int = 0
    notes: tuple[str, ...] = ()

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second as a float."""
        return float(self.frame_rate)


def save_facts(path: Path, facts: VideoFacts) -> None:
    """Write `facts` as JSON (with `frame_rate_hz` as a plain number beside the exact fraction)."""
    record = asdict(facts) | {
        "frame_rate": str(facts.frame_rate),
        "frame_rate_hz": facts.frame_rate_hz,
        "pixel_aspect": str(facts.pixel_aspect),
    }
    with whole_file(path) as part:
        part.write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def load_facts(path: Path) -> VideoFacts:
    """Read back what `save_facts` wrote.

    Raises
    ------
    FinloopError
        If the file is missing, is no JSON, or lacks or has too many keys.
    """
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        record.pop("frame_rate_hz")
        record["frame_rate"] = Fraction(record["frame_rate"])
        record["pixel_aspect"] = Fraction(record["pixel_aspect"])
        record["segments"] = tuple((int(a), int(b)) for a, b in record["segments"])
        record["notes"] = tuple(record["notes"])
        facts = VideoFacts(**record)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        wanted = ", ".join(field.name for field in fields(VideoFacts))
        raise FinloopError(
            came=f"{path} cannot be read as the facts of a clip ({error})",
            wanted=f"JSON with {wanted}",
            do="make the clip again: `dvc repro --force clip`",
        ) from error
    return facts


class VideoWriter:
    """Write one normalised clip; the file appears at `path` only when it is whole.

    Parameters
    ----------
    path
        Where the .mp4 goes.
    width, height
        In pixels, any size from 1.
    frame_rate
        Frames per second.
    colour
        Frames are (height, width, 3) RGB instead of (height, width) grey; both uint8.
    crf
        0 = lossless (grey bit for bit; RGB up to the rounding of its YUV form), else the quality
        of libx264, 51 = worst.

    Raises
    ------
    FinloopError
        On leaving the block, if the disk was full. Nothing is left of the file then.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        frame_rate: Fraction,
        colour: bool = False,
        crf: int = 0,
    ) -> None:
        self._path, self._shape = path, (height, width, 3) if colour else (height, width)
        self._frame_rate, self._colour, self._crf = frame_rate, colour, crf
        self._stack = ExitStack()
        self.frames = 0

    @classmethod
    def of(cls, path: Path, facts: VideoFacts) -> "VideoWriter":
        """Make the writer of a clip of which size, rate, colour and quality are known."""
        size = facts.width_px, facts.height_px
        return cls(path, *size, facts.frame_rate, facts.colour, facts.crf)

    def __enter__(self) -> "VideoWriter":
        with ExitStack() as stack:
            part = stack.enter_context(whole_file(self._path))
            self._container = stack.enter_context(av.open(str(part), "w", format="mp4"))
            options = (
                {"qp": "0", "preset": "ultrafast"}
                if self._crf == 0
                else {"crf": str(self._crf), "preset": "veryfast", "bf": "0"}
            )
            stream = self._container.add_stream("libx264", rate=self._frame_rate, options=options)
            stream.height, stream.width = self._shape[:2]
            even = stream.height % 2 == 0 and stream.width % 2 == 0
            self._format = ("yuv420p" if even else "yuv444p") if self._colour else "gray"
            stream.pix_fmt = self._format
            coder = stream.codec_context
            coder.time_base = 1 / self._frame_rate
            coder.gop_size = KEY_FRAME_EVERY
            coder.color_range = ColorRange.JPEG
            coder.colorspace = Colorspace.ITU601
            coder.thread_count = THREADS
            self._stream = stream
            self._stack = stack.pop_all()
        return self

    def write(self, frame: np.ndarray) -> None:
        """Append one frame, uint8 of the clip's shape."""
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}, wanted {self._shape} uint8")
        if self._colour:
            picture = VideoFrame.from_ndarray(frame, format="rgb24").reformat(
                format=self._format,
                dst_colorspace=Colorspace.ITU601,
                dst_color_range=ColorRange.JPEG,
                threads=THREADS,
            )
        else:
            picture = VideoFrame.from_ndarray(frame, format="gray")
            picture.color_range = ColorRange.JPEG
        picture.pts, picture.time_base = self.frames, 1 / self._frame_rate
        self._container.mux(self._stream.encode(picture))
        self.frames += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool | None:
        with self._stack as stack:
            if kind is None:
                self._container.mux(self._stream.encode(None))
            stack_exit = stack.pop_all()
        return stack_exit.__exit__(kind, error, trace)


@contextmanager
def _opened(path: Path, threads: int) -> Iterator[tuple[InputContainer, VideoStream, Fraction]]:
    """Open a normalised clip; also give the time from one frame to the next, in ticks."""
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = threads
            yield container, stream, Fraction(stream.duration or 0, stream.frames)
    except (OSError, av.error.FFmpegError, IndexError, ZeroDivisionError) as error:
        raise _damaged(path, str(error)) from error


def _damaged(path: Path, why: str) -> FinloopError:
    return FinloopError(
        came=f"{path} cannot be read as a normalised clip ({why})",
        wanted="the clip as the stage `clip` wrote it",
        do="make the clip again: `dvc repro --force clip`",
    )


def _number(frame: VideoFrame, step: Fraction) -> int:
    """Give the number of a frame whose distance from the next one is `step` ticks."""
    return round(Fraction(frame.pts or 0) / step)


def luma(frame: VideoFrame) -> np.ndarray:
    """Show the Y plane, (h, w) uint8, without the padding at the end of its rows.

    A view of the decoder's own memory, which lives as long as the view does. It is read-only,
    because the decoder predicts later frames from it.
    """
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
    rows.flags.writeable = False
    return rows[: frame.height, : frame.width]


def _rgb(frame: VideoFrame) -> np.ndarray:
    """Convert to (h, w, 3) uint8 RGB; the range and matrix are those the frame carries."""
    return frame.to_ndarray(format="rgb24", threads=THREADS)


def read_frames(
    path: Path,
    *,
    colour: bool = False,
    start: int = 0,
    stop: int | None = None,
    threads: int = THREADS,
) -> Iterator[np.ndarray]:
    """Give the frames `start` … `stop` - 1 of a normalised clip, one after the other.

    Parameters
    ----------
    path
        The clip.
    colour
        (h, w, 3) RGB instead of the (h, w) Y plane. Both are uint8; the Y plane is a read-only
        view with padded rows (copying it would cost a seventh of the time).
    start, stop
        Half-open range of frames; `stop` None = to the end.
    threads
        For decoding.

    Raises
    ------
    FinloopError
        If the clip cannot be read, or ends early.
    """
    with _opened(path, threads) as (container, stream, step):
        convert = _rgb if colour else luma
        stop = stream.frames if stop is None else min(stop, stream.frames)
        if start >= stop:
            return
        if start > 0:
            container.seek(int(start * step), stream=stream)
        following = start
        for frame in container.decode(stream):
            index = _number(frame, step)
            if index < start:
                continue
            if index != following:
                raise _damaged(path, f"frame {following} is missing")
            yield convert(frame)
            following += 1
            if following == stop:
                return
        raise _damaged(path, f"it ends before frame {following}")


def read_spread(
    path: Path, frames: Sequence[int], *, colour: bool = False, threads: int = THREADS
) -> Iterator[np.ndarray]:
    """Give the frames with the numbers `frames` (ascending, repeats allowed), jumping between.

    Raises
    ------
    FinloopError
        If the clip cannot be read, or ends early.
    ValueError
        If `frames` does not ascend.
    """
    if any(b < a for a, b in pairwise(frames)):
        raise ValueError("frames must ascend")
    with _opened(path, threads) as (container, stream, step):
        convert = _rgb if colour else luma
        decoded: Iterator[VideoFrame] = iter(())
        at, current = -KEY_FRAME_EVERY, None
        for wanted in frames:
            if wanted - at >= KEY_FRAME_EVERY:  # else decoding on is as quick as jumping
                container.seek(int(wanted * step), stream=stream)
                decoded, current = container.decode(stream), None
            while current is None or at < wanted:
                current = next(decoded, None)
                if current is None:
                    raise _damaged(path, f"frame {wanted} is missing")
                at = _number(current, step)
            yield convert(current)


def save_mask(path: Path, mask: np.ndarray) -> None:
    """Write a boolean mask (h, w) as an 8-bit picture, 255 where True."""
    with whole_file(path) as part:
        coded = cv2.imencode(path.suffix, mask.astype(np.uint8) * 255)[1]
        part.write_bytes(coded.tobytes())


def load_mask(path: Path, width: int, height: int) -> np.ndarray:
    """Read a mask picture as boolean (height, width), True where it is at least half bright.

    Raises
    ------
    FinloopError
        If there is no such picture, it cannot be read, or it has another size.
    """
    wanted = f"a mask picture of {width}×{height} pixels, bright inside the arena, black outside"
    do = "give the path of such a picture (PNG is fine)"
    if not path.is_file():
        raise FinloopError(f"there is no mask picture at {path}", wanted, do)
    # From bytes, because cv2.imread prints a warning of its own where it fails.
    data = np.frombuffer(path.read_bytes(), np.uint8)
    mask = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if mask is None:
        raise FinloopError(f"{path} cannot be read as a picture", wanted, do)
    if mask.shape != (height, width):
        came = f"{path} is {mask.shape[1]}×{mask.shape[0]} pixels"
        raise FinloopError(came, wanted, do)
    return mask >= 128
