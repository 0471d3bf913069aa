"""Film that others made: whatever FFmpeg opens, a folder of pictures, or a stack of TIFF pages.

`open_footage` looks at the source once (rate, colour, which way is up, depth) and says what is
wrong with it; `Footage.frames` then streams its frames, upright, as uint8 grey or RGB, with the
time each is shown. Nothing is held but a few frames.
"""

import math
import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import av
import av.error
import cv2
import numpy as np
from av.container import InputContainer
from av.sidedata.sidedata import Type as SideDataType
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace
from av.video.stream import VideoStream
from tifffile import TiffFile, TiffFileError

from finloop.clip.normalise import (
    CHROMA_FRACTION,
    FULL_FROM_LIMITED,
    UPRIGHT,
    Tally,
    Timing,
    Turn,
    chroma_fraction,
    deep_levels,
    frame_rate_of,
    nearest_in_time,
    stretched,
    turn_of,
)
from finloop.errors import FinloopError
from finloop.io.video import THREADS, VideoFacts, VideoWriter, luma

S = TypeVar("S")
T = TypeVar("T")

PICTURE_SUFFIXES = {".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".jp2"}
PICTURE_SUFFIXES |= {".pgm", ".ppm", ".pnm"}
TIFF_SUFFIXES = {".tif", ".tiff"}
SAMPLES = 12  # frames looked at to tell colour, depth and range
SAMPLE_PIXELS = 5e5  # at most so many of each
# A film that does not state its range of levels counts as limited (16 … 235), unless so many pixels
# lie so far outside that black or white would be lost; a coder's ringing stays within.
OUTSIDE_LEVELS, OUTSIDE_FRACTION = (10, 241), 0.01
HD_HEIGHT = 720  # from here on, a film that does not state its colour matrix has BT.709
SEEK_MARGIN_S = 1.0

_LUMA_FIRST = ("yuv4", "yuvj4", "yuva4", "nv1", "nv2", "gray")  # formats whose plane 0 is Y
# What PyAV raises where a container cannot be followed further; the second if damage looks like the
# beginning of another stream.
_BROKEN_OFF = (av.error.FFmpegError, IndexError)

_WANTED = "a film that FFmpeg can read (mp4, avi, mov, mkv, webm, gif) or a folder of pictures"
_WANTED_TWO = "at least 2 frames: without motion there is nothing to follow"


@dataclass
class Loss:
    """Frames that a source promises but does not give; grows while the film runs."""

    damaged: int = 0
    missing_at_end: int = 0

    @property
    def frames(self) -> int:
        """All that are not there."""
        return self.damaged + self.missing_at_end

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about it for a person."""
        kept = "the clip holds what could be read"
        found = (
            (self.damaged, f"{self.damaged} frames of the film are damaged and left out; {kept}"),
            (
                self.missing_at_end,
                f"the film breaks off {self.missing_at_end} frames early; {kept}",
            ),
        )
        return tuple(note for count, note in found if count)


@dataclass(frozen=True)
class Footage:
    """A source that has been looked at.

    Attributes
    ----------
    path
        The film, the folder or the stack.
    width_px, height_px
        Of the upright picture.
    frame_rate
        The constant rate that the film has or comes nearest to, or the one that was asked for.
    colour
        Whether `frames` gives RGB.
    frames_expected
        Ticks of `frame_rate` in the asked range, as far as the file says.
    turn
        How the coded picture is laid upright.
    levels
        Levels of a deep source that become 0 and 255; None where there are 8 bits.
    pixel_aspect
        Width : height of a pixel as stated; nothing is resampled.
    notes
        Sentences that a person should read.
    start_s, end_s
        Half-open range of time that `frames` gives.
    """

    path: Path
    width_px: int
    height_px: int
    frame_rate: Fraction
    colour: bool
    frames_expected: int
    turn: Turn = UPRIGHT
    levels: tuple[float, float] | None = None
    pixel_aspect: Fraction = Fraction(1)
    notes: tuple[str, ...] = ()
    start_s: float = 0.0
    end_s: float = math.inf
    full_range: bool = False  # Y 0 … 255 although the film does not say so
    renumbered: bool = False  # frame k is shown at k / frame_rate, whatever its stamp
    stamp_s: float = 0.0  # stamp of the first frame
    last_s: float = 0.0  # time of the last frame the file promises, 0 = its first
    pictures: bool = False  # a folder or a stack, no film

    def frames(self, loss: Loss) -> Iterator[tuple[float, np.ndarray]]:
        """Give time (s, 0 = first frame of the film) and picture of each frame of the range.

        Parameters
        ----------
        loss
            Counts what could not be read.

        Raises
        ------
        FinloopError
            If frames change their size, or a picture of a folder cannot be read.
        """
        return _picture_frames(self) if self.pictures else _film_frames(self, loss)

    def facts(self, source: str, crf: int) -> VideoFacts:
        """Say what is known before the frames are read; `frames` is what is expected."""
        return VideoFacts(
            source=source,
            width_px=self.width_px,
            height_px=self.height_px,
            frames=self.frames_expected,
            frame_rate=self.frame_rate,
            colour=self.colour,
            segments=(),
            rotation_deg=self.turn.rotation_deg,
            mirrored=self.turn.mirrored,
            pixel_aspect=self.pixel_aspect,
            level_low=self.levels[0] if self.levels else 0.0,
            level_high=self.levels[1] if self.levels else 255.0,
            crf=crf,
            notes=self.notes,
        )


def open_footage(
    path: Path,
    *,
    frame_rate_hz: float | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
    colour: bool | None = None,
) -> Footage:
    """Look at a source and say how it will be read.

    Parameters
    ----------
    path
        A film, a folder of pictures (in natural order: 2 before 10) or a TIFF with many pages.
    frame_rate_hz
        Overrides the file's: every frame is kept, and shown at its number / `frame_rate_hz`.
    start_s, end_s
        Half-open range of time, counted at `frame_rate_hz` where that is given; `end_s` None = to
        the end.
    colour
        True = RGB, False = grey, None = RGB where the film has colours.

    Raises
    ------
    FinloopError
        If there is nothing at `path`, it is no film, holds fewer than two frames, gives no frame
        rate, or is shorter than the asked range.
    """
    rate = None if frame_rate_hz is None else Fraction(frame_rate_hz).limit_denominator(1001)
    if not path.exists():
        raise FinloopError(
            came=f"there is nothing at {path.absolute()}",
            wanted=_WANTED,
            do="correct the path, or give it whole: a temporary experiment starts elsewhere",
        )
    if path.is_dir() or path.suffix.lower() in TIFF_SUFFIXES:
        footage, times = _open_pictures(path, rate, colour)
    else:
        footage, times = _open_film(path, rate, colour)
    return _limited(footage, times, start_s, math.inf if end_s is None else end_s)


def record(
    writer: VideoWriter,
    takes: Iterable[Iterator[tuple[float, np.ndarray]]],
    frame_rate: Fraction,
    advance: Callable[[], object],
) -> tuple[Timing, Tally]:
    """Write takes one after the other, re-timed to a constant rate, each from its own first frame.

    Parameters
    ----------
    writer
        Open, and of the frames' size.
    takes
        As `Footage.frames` gives them.
    frame_rate
        Of the clip.
    advance
        Called after each frame written.

    Raises
    ------
    FinloopError
        What reading raises; or if nothing is to be seen in what was written.
    """
    timing, tally = Timing(), Tally()
    for take in takes:
        for frame in nearest_in_time(take, frame_rate, timing):
            writer.write(frame)
            tally.add(frame)
            advance()
    if tally.frames < 2:
        raise FinloopError(
            came=f"only {tally.frames} frame(s) could be decoded",
            wanted=_WANTED_TWO,
            do="copy or record the film again",
        )
    if tally.plain:
        raise FinloopError(
            came=f"all {tally.frames} frames show an even grey of {tally.brightness_mean:.0f} "
            "(0 = black, 255 = white)",
            wanted="a film in which something is to be seen",
            do="check the camera's cap, exposure and file; or choose another range of time",
        )
    return timing, tally


def _limited(footage: Footage, times: np.ndarray, start_s: float, end_s: float) -> Footage:
    """Cut a source whose frames are shown at `times` down to a range of time."""
    step = 1 / float(footage.frame_rate)
    length = float(times[-1]) + step
    asked = f"{start_s:g} s to {'the end' if math.isinf(end_s) else f'{end_s:g} s'}"
    if start_s >= min(end_s, length) or length + step < end_s < math.inf:
        raise FinloopError(
            came=f"{footage.path} is {length:.3f} s long, and {asked} was asked for",
            wanted=f"0 ≤ start < end ≤ {length:.3f} s",
            do="correct clip.start_s and clip.end_s (null = to the end)",
        )
    footage = replace(footage, start_s=start_s, end_s=end_s)
    shown = times[[_in_range(footage, time) for time in times]]
    if shown.size < 2:
        raise FinloopError(
            came=f"{footage.path} shows {shown.size} frame(s) from {asked}",
            wanted=_WANTED_TWO,
            do="widen clip.start_s … clip.end_s",
        )
    return replace(footage, frames_expected=round((shown[-1] - shown[0]) / step) + 1)


def _in_range(footage: Footage, time_s: float | Fraction) -> bool:
    slack = 0.01 / float(footage.frame_rate)  # makes up for rounded time stamps
    return footage.start_s - slack <= time_s < footage.end_s - slack


def _too_few(path: Path, count: int) -> FinloopError:
    came = f"{path} holds {'a single frame' if count else 'no frame that can be decoded'}"
    folder = f", or the folder of pictures: {path.parent}"
    return FinloopError(came, _WANTED_TWO, "give a whole film" + (folder if count else ""))


def _other_size(what: str, size: tuple[int, int], wanted: tuple[int, int]) -> FinloopError:
    return FinloopError(
        came=f"{what} is {size[0]}×{size[1]} pixels, those before it {wanted[0]}×{wanted[1]}",
        wanted="frames of one size",
        do="film without changing the size, or scale all frames alike first (ffmpeg -vf scale=…)",
    )


def _thinned(frame: np.ndarray) -> np.ndarray:
    """Take every k-th pixel of a sample so that it stays below `SAMPLE_PIXELS`."""
    k = math.ceil(math.sqrt(frame.shape[0] * frame.shape[1] / SAMPLE_PIXELS))
    return frame[::k, ::k]


# --- films ----------------------------------------------------------------------------------


@contextmanager
def _film(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a film and choose its picture stream."""
    try:
        if path.stat().st_size == 0:
            raise FinloopError(f"{path} is empty: 0 bytes", _WANTED, "copy or record it again")
        # Titles are often not in UTF-8.
        with av.open(str(path), metadata_errors="replace") as container:
            streams = _picture_streams(container)
            if not streams:
                kinds = " and ".join(sorted({stream.type for stream in container.streams}))
                holds = f"no pictures, only {kinds}" if kinds else "nothing that can be decoded"
                raise FinloopError(f"{path} holds {holds}", _WANTED, "give a whole film")
            streams[0].thread_type = "AUTO"
            yield container, streams[0]
    except (av.error.FFmpegError, OSError) as error:
        raise FinloopError(
            came=f"{path} cannot be read as a film: {error.strerror or error}",
            wanted=_WANTED,
            do="see whether a player shows it; an mp4 or mov whose recording was cut off lacks its "
            "index and must be repaired first",
        ) from error


def _picture_streams(container: InputContainer) -> list[VideoStream]:
    """List the streams of moving pictures: not the cover of an audio file."""
    return [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]


def _stamps(container: InputContainer, stream: VideoStream) -> tuple[np.ndarray, int]:
    """List when the frames are shown, in seconds, ascending; and how many the file promises.

    Nothing is decoded. A complete index is enough: its decoding times may be early by some
    frames, but have the same gaps. Without one, all packets are run through.
    """
    ticks: list[int] = []
    if 0 < stream.frames == len(stream.index_entries):
        ticks = [entry.timestamp for entry in stream.index_entries if not entry.is_discard]
        promised = len(ticks)
    if not ticks:
        try:
            for packet in container.demux(stream):
                stamp = packet.dts if packet.pts is None else packet.pts
                if packet.size and stamp is not None and not packet.is_discard:
                    ticks.append(stamp)
        except _BROKEN_OFF:
            pass  # `Loss` tells how much is missing
        promised = max(len(ticks), stream.frames)
    return np.sort(np.array(ticks, np.float64)) * float(stream.time_base or 1), promised


class _Look(NamedTuple):
    """What a few frames spread over a film tell."""

    width: int
    height: int
    first_s: float  # stamp of the first frame
    turn: Turn
    turn_exact: bool
    interlaced: bool
    chroma: float  # part of the pixels that have colour
    outside: float  # part of the pixels that are outside the limited range
    levels: tuple[float, float] | None


def _look_at(path: Path, stamps: np.ndarray) -> _Look:
    chroma, outside, deep = [], [], []
    low, high = OUTSIDE_LEVELS
    first: VideoFrame | None = None
    for frame in _samples(path, stamps):
        first = first or frame
        if (frame.width, frame.height) != (first.width, first.height):
            continue  # `_film_frames` will tell the number of the frame
        chroma.append(chroma_fraction([_thinned(_rgb(frame, full_range=False))]))
        raw = _thinned(_grey(frame, full_range=True, levels=None))
        outside.append(float(((raw < low) | (raw > high)).mean()))
        if _is_deep(frame):
            deep.append(_thinned(frame.to_ndarray(format="gray16le")))
    if first is None:
        raise _too_few(path, 0)
    turn, exact = turn_of(_display_matrix(first))
    stated = first.color_range in (ColorRange.MPEG, ColorRange.JPEG)
    return _Look(
        width=first.width,
        height=first.height,
        first_s=float(stamps[0] if first.time is None else first.time),
        turn=turn,
        turn_exact=exact,
        interlaced=first.interlaced_frame,
        chroma=float(np.mean(chroma)),
        outside=0.0 if stated or not _is_yuv(first) else float(np.mean(outside)),
        levels=deep_levels(deep) if deep else None,
    )


def _samples(path: Path, stamps: np.ndarray) -> Iterator[VideoFrame]:
    """Decode some frames spread over a film; the first ones where it cannot be jumped in."""
    with _film(path) as (container, stream):
        yield from _good(_decoded(container, stream, Loss()), 1)
        for stamp in np.linspace(stamps[0], stamps[-1], SAMPLES)[1:]:
            try:
                container.seek(int(stamp / float(stream.time_base or 1)), stream=stream)
            except (av.error.FFmpegError, OSError):
                yield from _good(_decoded(container, stream, Loss()), SAMPLES)
                return
            yield from _good(_decoded(container, stream, Loss()), 1)


def _good(frames: Iterator[VideoFrame | None], count: int) -> Iterator[VideoFrame]:
    """Give the first `count` frames that are not damaged."""
    return islice((frame for frame in frames if frame is not None), count)


def _display_matrix(frame: VideoFrame) -> np.ndarray:
    side: Any
    for side in frame.side_data:
        if side.type == SideDataType.DISPLAYMATRIX:
            return np.frombuffer(bytes(side), np.int32)
    return np.eye(3).ravel()


def _is_yuv(frame: VideoFrame) -> bool:
    return frame.format.name.startswith(("yuv", "nv", "uyvy", "yvyu", "p0"))


def _is_deep(frame: VideoFrame) -> bool:
    """Whether a grey frame has more than 8 bits, of which nobody says how many are used."""
    return len(frame.format.components) == 1 and frame.format.components[0].bits > 8


def _grey(frame: VideoFrame, full_range: bool, levels: tuple[float, float] | None) -> np.ndarray:
    """Convert to (h, w) uint8, 0 = black, 255 = white; limited range is expanded."""
    if levels:
        return stretched(frame.to_ndarray(format="gray16le"), *levels)
    name, bits = frame.format.name, frame.format.components[0].bits
    if bits == 8 and name.startswith(_LUMA_FIRST):  # the general way takes twenty times as long
        full = full_range or name == "gray" or frame.color_range == ColorRange.JPEG
        return luma(frame) if full else cv2.LUT(luma(frame), FULL_FROM_LIMITED)
    return frame.to_ndarray(
        format="gray",
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def _rgb(frame: VideoFrame, full_range: bool) -> np.ndarray:
    """Convert to (h, w, 3) uint8 RGB by the range and matrix that the frame states."""
    matrix = frame.colorspace
    if matrix not in list(Colorspace):
        matrix = Colorspace.ITU709 if frame.height >= HD_HEIGHT else Colorspace.ITU601
    return frame.to_ndarray(
        format="rgb24",
        src_colorspace=matrix,
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def _open_film(
    path: Path, rate: Fraction | None, colour: bool | None
) -> tuple[Footage, np.ndarray]:
    """Look at a film; also give the times of its frames, 0 = the first."""
    with _film(path) as (container, stream):
        stamps, promised = _stamps(container, stream)
        stated = [r for r in (stream.average_rate, stream.guessed_rate, stream.base_rate) if r]
        aspect = stream.sample_aspect_ratio or Fraction(1)
        streams = len(_picture_streams(container))
    if stamps.size < 2:
        raise _too_few(path, stamps.size)
    look = _look_at(path, stamps)
    own_rate = frame_rate_of(stamps, stated)
    if rate is None:
        times, last_s = stamps - stamps[0], (promised - stamps.size) / float(own_rate)
        last_s += float(times[-1])
    else:
        times, last_s = np.arange(stamps.size) / float(rate), (promised - 1) / float(rate)
    full_range = look.outside > OUTSIDE_FRACTION
    notes = [
        note
        for applies, note in (
            (
                rate not in (None, own_rate),
                f"the file says {float(own_rate):g} frames/s; "
                f"its frames are taken as shot at {float(rate or 0):g}",
            ),
            (
                aspect != 1,
                f"the file says that pixels are {aspect} times as wide as high; they are taken as "
                "square, so lengths and angles are off unless the file is wrong",
            ),
            (streams > 1, f"of {streams} picture streams the first is taken"),
            (look.interlaced, "the film is interlaced: outlines are combed where a fish moves"),
            (
                not look.turn_exact,
                "the film asks for a crooked turn; the nearest right angle is taken",
            ),
            (full_range, "the film does not state its range of levels, and uses them all: 0 … 255"),
        )
        if applies
    ]
    footage = Footage(
        path=path,
        width_px=look.height if look.turn.b else look.width,
        height_px=look.width if look.turn.b else look.height,
        frame_rate=rate or own_rate,
        colour=look.chroma > CHROMA_FRACTION if colour is None else colour,
        frames_expected=stamps.size,
        turn=look.turn,
        levels=look.levels,
        pixel_aspect=aspect,
        notes=tuple(notes),
        full_range=full_range,
        renumbered=rate is not None,
        stamp_s=look.first_s,
        last_s=last_s,
    )
    return footage, times


def _decoded(
    container: InputContainer, stream: VideoStream, loss: Loss
) -> Iterator[VideoFrame | None]:
    """Give the frames from here on; None for one that is damaged."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except _BROKEN_OFF:
            return  # `_film_frames` counts what is missing
        if packet is None:
            return
        try:
            frames = [] if packet.is_corrupt else packet.decode()
        except av.error.FFmpegError:
            frames = []
            broken = True
        else:
            broken = packet.is_corrupt
        for frame in [*frames, *[None] * broken]:
            good = frame is not None and not frame.is_corrupt
            loss.damaged += not good
            yield frame if good else None


def _film_frames(footage: Footage, loss: Loss) -> Iterator[tuple[float, np.ndarray]]:
    """Stream a film; see `Footage.frames`."""
    step = 1 / float(footage.frame_rate)
    size = footage.height_px, footage.width_px
    size = size if footage.turn.b else size[::-1]  # width, height as coded
    convert = _rgb if footage.colour else partial(_grey, levels=footage.levels)
    with _film(footage.path) as (container, stream):
        _jump(container, stream, footage)
        time_s, damaged = -step, 0
        for number, frame in enumerate(_decoded(container, stream, loss)):
            if frame is None:
                continue
            damaged = loss.damaged  # up to the last good frame
            if footage.renumbered:
                time_s = number * step
            elif frame.pts is None:
                time_s += step
            else:
                time_s = float(frame.pts * (stream.time_base or 1)) - footage.stamp_s
            if (frame.width, frame.height) != size:
                what = f"{footage.path}: the frame at {time_s:.3f} s"
                raise _other_size(what, (frame.width, frame.height), size)
            if _in_range(footage, time_s):
                yield time_s, footage.turn(convert(frame, full_range=footage.full_range))
            elif time_s >= footage.start_s:
                return
        promised_s = min(footage.last_s, footage.end_s - step)
        missing = round((promised_s - time_s) / step) - (loss.damaged - damaged)
        loss.missing_at_end = max(0, missing)


def _jump(container: InputContainer, stream: VideoStream, footage: Footage) -> None:
    """Go to shortly before the start of the range, where the container can be jumped in.

    A renumbered film is decoded from its first frame: only so are its frames counted.
    """
    target_s = footage.start_s - SEEK_MARGIN_S
    if footage.renumbered or target_s <= 0:
        return
    ticks = int((target_s + footage.stamp_s) / float(stream.time_base or 1))
    with suppress(av.error.FFmpegError, OSError):  # then from the first frame as well
        container.seek(ticks, stream=stream)


# --- pictures ---------------------------------------------------------------------------------


class _Album(NamedTuple):
    """The pictures of a folder or the pages of a stack, by number."""

    length: int
    name: Callable[[int], str]
    load: Callable[[int], np.ndarray]  # (h, w) grey or (h, w, 3) RGB, as stored
    threads: int


@contextmanager
def _album(path: Path) -> Iterator[_Album]:
    """Open a folder or a stack."""
    if path.is_dir():
        files = _listed(path)

        def load(k: int) -> np.ndarray:
            return _load_picture(files[k])

        yield _Album(len(files), lambda k: str(files[k]), load, THREADS)
        return
    try:
        with TiffFile(path) as stack:

            def load_page(k: int) -> np.ndarray:
                return _page(stack, k)

            name = f"{path}, page {{}},"
            yield _Album(len(stack.pages), lambda k: name.format(k + 1), load_page, 1)
    except (TiffFileError, OSError) as error:
        raise FinloopError(
            came=f"{path} cannot be read as a TIFF: {error}",
            wanted="a TIFF with a page for each frame",
            do="save it as a folder of pictures",
        ) from error


def _open_pictures(
    path: Path, rate: Fraction | None, colour: bool | None
) -> tuple[Footage, np.ndarray]:
    """Look at a folder of pictures or a stack; also give the times of its frames."""
    with _album(path) as album:
        if album.length < 2:
            raise _too_few(path, album.length)
        if rate is None:
            raise FinloopError(
                came=f"{path}: {album.length} pictures, which do not say how fast they were taken",
                wanted="their frame rate",
                do="give it: -S clip.frame_rate_hz=30.0",
            )
        first = album.load(0)
        chosen = np.unique(np.linspace(0, album.length - 1, SAMPLES).astype(int))
        samples = [_thinned(album.load(int(k))) for k in chosen]
        times = np.arange(album.length) / float(rate)
    levels = None if first.dtype == np.uint8 else deep_levels(samples)
    if colour is None:
        shown = [_fitted(sample, True, levels) for sample in samples]
        colour = chroma_fraction(shown) > CHROMA_FRACTION
    footage = Footage(
        path=path,
        width_px=first.shape[1],
        height_px=first.shape[0],
        frame_rate=rate,
        colour=colour,
        frames_expected=len(times),
        levels=levels,
        renumbered=True,
        last_s=float(times[-1]),
        pictures=True,
    )
    return footage, times


def _listed(folder: Path) -> list[Path]:
    """List the pictures of a folder in natural order."""
    files = [
        file
        for file in folder.iterdir()
        if file.suffix.lower() in PICTURE_SUFFIXES and not file.name.startswith(".")
    ]
    kinds = Counter(file.suffix.lower() for file in files)
    if not files:
        raise FinloopError(
            came=f"the folder {folder} holds no pictures",
            wanted=f"the frames of one film, all of one kind: {' '.join(sorted(PICTURE_SUFFIXES))}",
            do="give that folder, or the film itself",
        )
    if len(kinds) > 1:
        raise FinloopError(
            came=f"{folder} holds pictures of several kinds: "
            + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())),
            wanted="the frames of one film and no other picture",
            do="move the others away (a mask, a background, a preview)",
        )
    return sorted(files, key=_natural)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key in which frame2 comes before frame10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts] + [
        (0, path.name)
    ]


def _load_picture(path: Path) -> np.ndarray:
    """Read one picture as it is stored: (h, w) grey or (h, w, 3) RGB, upright by its EXIF."""
    data = np.fromfile(path, np.uint8)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    picture = cv2.imdecode(data, flags) if data.size else None
    if picture is None:
        raise FinloopError(
            came=f"{path} cannot be read as a picture",
            wanted="every file of the folder whole",
            do="copy it again, or move it away",
        )
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def _page(stack: TiffFile, number: int) -> np.ndarray:
    """Read one page of a stack: (h, w) grey or (h, w, 3) RGB."""
    try:
        picture = stack.pages[number].asarray()
    except ValueError as error:  # a compression that is not supported
        raise FinloopError(
            came=f"{stack.filehandle.path}, page {number + 1}, cannot be read: {error}",
            wanted="a stack that is not compressed, or by deflate",
            do="save it so, or as a folder of pictures",
        ) from error
    if picture.ndim == 3 and picture.shape[2] in (3, 4):
        return picture[..., :3]
    if picture.ndim == 2:
        return picture
    raise FinloopError(
        came=f"{stack.filehandle.path}, page {number + 1}, has the shape {picture.shape}",
        wanted="pages of height × width, grey or RGB",
        do="split its channels, or save it as a folder of pictures",
    )


def _fitted(picture: np.ndarray, colour: bool, levels: tuple[float, float] | None) -> np.ndarray:
    """Bring a picture as stored to uint8 grey or RGB."""
    if levels:
        picture = stretched(picture, *levels)
    if colour and picture.ndim == 2:
        return cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)
    if not colour and picture.ndim == 3:
        return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    return picture


def _picture_frames(footage: Footage) -> Iterator[tuple[float, np.ndarray]]:
    """Stream a folder or stack; see `Footage.frames`."""
    size = footage.width_px, footage.height_px
    with _album(footage.path) as album:

        def load(number: int) -> tuple[float, np.ndarray]:
            picture = album.load(number)
            if picture.shape[1::-1] != size:
                raise _other_size(album.name(number), picture.shape[1::-1], size)
            if (picture.dtype == np.uint8) == (footage.levels is not None):
                raise FinloopError(
                    came=f"{album.name(number)} has {picture.dtype} levels, those before it others",
                    wanted="pictures of one depth",
                    do="move it away, or convert all alike",
                )
            shown = _fitted(picture, footage.colour, footage.levels)
            return number / float(footage.frame_rate), shown

        wanted = [k for k in range(album.length) if _in_range(footage, k / footage.frame_rate)]
        yield from _ahead(load, wanted, album.threads)


def _ahead(work: Callable[[S], T], items: Iterable[S], threads: int) -> Iterator[T]:
    """Do `work` in threads, a few items ahead of the one that is wanted, in order."""
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[T]] = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > 2 * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
