"""Films, read by FFmpeg: their facts, and their frames one after the other."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange
from av.video.stream import VideoStream
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.io.footage.coding import CHROMA_FRACTION, Turn, chroma_fraction, deep_levels, turn_of
from finloop.io.footage.fields import deinterlace
from finloop.io.footage.frame import display_matrix, grey, is_deep, is_yuv, rgb
from finloop.io.footage.source import (
    SAMPLES,
    WANTED,
    Footage,
    Loss,
    NumberedFrames,
    in_range,
    other_size,
    thin_frame,
    too_few,
)
from finloop.io.footage.timing import frame_rate_of

# A film that does not state its range of levels counts as limited (16 … 235), unless so many pixels
# lie so far outside that black or white would be lost. A coder's ringing stays within.
OUTSIDE_LEVELS, OUTSIDE_FRACTION = (10, 241), 0.01
SEEK_MARGIN_S = 1.0

# What PyAV raises where a container cannot be read on; the second if damage looks like the
# beginning of another stream.
_BROKEN_OFF = (av.error.FFmpegError, IndexError)


@contextmanager
def open_stream(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a film for a block; yield its container and its first stream of moving pictures.

    FinloopError if it is no film.
    """
    try:
        if path.stat().st_size == 0:
            raise FinloopError(f"{path} is empty: 0 bytes", WANTED, "copy or record it again")
        # Titles are often not in UTF-8.
        with av.open(str(path), metadata_errors="replace") as container:
            streams = _picture_streams(container)
            if not streams:
                kinds = " and ".join(sorted({stream.type for stream in container.streams}))
                holds = f"no pictures, only {kinds}" if kinds else "nothing that can be decoded"
                raise FinloopError(f"{path} holds {holds}", WANTED, "give a whole film")
            streams[0].thread_type = "AUTO"
            yield container, streams[0]
    except (av.error.FFmpegError, OSError) as error:
        raise FinloopError(
            came=f"{path} cannot be read as a film: {error.strerror or error}",
            wanted=WANTED,
            do="see whether a player shows it; an mp4 or mov that is still being recorded or "
            "copied lacks its index: wait; one that was cut off must be repaired first",
        ) from error


def _picture_streams(container: InputContainer) -> list[VideoStream]:
    """List the streams of moving pictures: not the cover of an audio file."""
    return [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]


def time_stamps(container: InputContainer, stream: VideoStream) -> tuple[np.ndarray, int]:
    """Return the frames' time stamps [s], ascending, and the number of frames the file promises.

    Nothing is decoded. A complete index suffices: its decoding times may be early by some frames,
    but have the same gaps. Without an index all packets are read.
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
            pass  # `film_frames` counts what is missing
        promised = max(len(ticks), stream.frames)
    return np.sort(np.array(ticks, np.float64)) * float(stream.time_base or 1), promised


class CodingSurvey(NamedTuple):
    """The coding of a film, from sample frames spread over it."""

    width: int
    height: int
    first_s: float  # time stamp of the first frame
    turn: Turn
    turn_exact: bool
    interlaced: bool
    chroma: float  # share of the pixels that have colour
    outside: float  # share of the pixels outside the limited range
    levels: tuple[float, float] | None


def survey(path: Path, stamps: np.ndarray) -> CodingSurvey:
    """Decode some frames spread over a film and measure how it is coded.

    stamps: time stamps [s] of its frames, ascending. FinloopError if no frame can be decoded.
    """
    chroma, outside, deep = [], [], []
    low, high = OUTSIDE_LEVELS
    first: VideoFrame | None = None
    for frame in _samples(path, stamps):
        first = first or frame
        if (frame.width, frame.height) != (first.width, first.height):
            continue  # `film_frames` reports it
        chroma.append(chroma_fraction([thin_frame(rgb(frame, full_range=False))]))
        raw = thin_frame(grey(frame, full_range=True, levels=None))
        outside.append(float(((raw < low) | (raw > high)).mean()))
        if is_deep(frame):
            deep.append(thin_frame(frame.to_ndarray(format="gray16le")))
    if first is None:
        raise too_few(path, 0)
    turn, exact = turn_of(display_matrix(first))
    stated = first.color_range in (ColorRange.MPEG, ColorRange.JPEG)
    return CodingSurvey(
        width=first.width,
        height=first.height,
        first_s=float(stamps[0] if first.time is None else first.time),
        turn=turn,
        turn_exact=exact,
        interlaced=first.interlaced_frame,
        chroma=float(np.mean(chroma)),
        outside=0.0 if stated or not is_yuv(first) else float(np.mean(outside)),
        levels=deep_levels(deep) if deep else None,
    )


def _samples(path: Path, stamps: np.ndarray) -> Iterator[VideoFrame]:
    """Decode some frames spread over a film; its first ones if it cannot be sought."""
    with open_stream(path) as (container, stream):
        yield from _good(decode_film(container, stream, Loss()), 1)
        for stamp in np.linspace(stamps[0], stamps[-1], SAMPLES)[1:]:
            try:
                container.seek(int(stamp / float(stream.time_base or 1)), stream=stream)
            except (av.error.FFmpegError, OSError):
                yield from _good(decode_film(container, stream, Loss()), SAMPLES)
                return
            yield from _good(decode_film(container, stream, Loss()), 1)


def _good(frames: Iterator[VideoFrame | None], count: int) -> Iterator[VideoFrame]:
    return islice((frame for frame in frames if frame is not None), count)


def open_film(path: Path, rate: Fraction | None, colour: bool | None) -> tuple[Footage, np.ndarray]:
    """Return a film's facts and its frames' times [s] from 0; rate, colour: None = as the film."""
    with open_stream(path) as (container, stream):
        stamps, promised = time_stamps(container, stream)
        stated = [r for r in (stream.average_rate, stream.guessed_rate, stream.base_rate) if r]
        aspect = stream.sample_aspect_ratio or Fraction(1)
        streams = len(_picture_streams(container))
    if stamps.size < 2:
        raise too_few(path, stamps.size)
    coding = survey(path, stamps)
    own_rate = frame_rate_of(stamps, stated)
    if rate is None:
        times, last_s = stamps - stamps[0], (promised - stamps.size) / float(own_rate)
        last_s += float(times[-1])
    else:
        times, last_s = np.arange(stamps.size) / float(rate), (promised - 1) / float(rate)
    full_range = coding.outside > OUTSIDE_FRACTION
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
            (coding.interlaced, "the film is interlaced: outlines are combed where a fish moves"),
            (
                not coding.turn_exact,
                "the film asks for a crooked turn; the nearest right angle is taken",
            ),
            (full_range, "the film does not state its range of levels, and uses them all: 0 … 255"),
        )
        if applies
    ]
    footage = Footage(
        path=path,
        width_px=coding.height if coding.turn.b else coding.width,
        height_px=coding.width if coding.turn.b else coding.height,
        frame_rate=rate or own_rate,
        colour=coding.chroma > CHROMA_FRACTION if colour is None else colour,
        frames_expected=stamps.size,
        reader=film_frames,
        frames_in_source=max(promised, stamps.size),
        turn=coding.turn,
        levels=coding.levels,
        pixel_aspect=aspect,
        notes=tuple(notes),
        full_range=full_range,
        renumbered=rate is not None,
        stamp_s=coding.first_s,
        last_s=last_s,
    )
    return footage, times


def decode_film(
    container: InputContainer, stream: VideoStream, loss: Loss
) -> Iterator[VideoFrame | None]:
    """Decode a film from its present position on; yield frames, None for each damaged one.

    loss: counts the damaged frames.
    """
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except _BROKEN_OFF:
            return  # `film_frames` counts what is missing
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


def film_frames(footage: Footage, loss: Loss) -> NumberedFrames:
    """Yield the frames of a film, upright, with times and numbers as `Footage.stream_numbered`."""
    step = 1 / float(footage.frame_rate)
    size = footage.height_px, footage.width_px
    size = size if footage.turn.b else size[::-1]  # width, height as coded
    convert = rgb if footage.colour else partial(grey, levels=footage.levels)
    with open_stream(footage.path) as (container, stream):
        stamps = _seek(container, stream, footage)
        time_s, damaged = -step, 0
        shot = decode_film(container, stream, loss)
        if footage.fields:
            shot = deinterlace(shot, stream, footage.fields)
        for number, frame in enumerate(shot):
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
                raise other_size(what, (frame.width, frame.height), size)
            if in_range(footage, time_s):
                if stamps.size and frame.pts is not None:
                    number = int(np.searchsorted(stamps, frame.pts))
                picture = footage.turn(convert(frame, full_range=footage.full_range))
                yield time_s, (number, picture)
            elif time_s >= footage.start_s:
                return
        promised_s = min(footage.last_s, footage.end_s - step)
        missing = round((promised_s - time_s) / step) - (loss.damaged - damaged)
        loss.missing_at_end = max(0, missing)


def _seek(container: InputContainer, stream: VideoStream, footage: Footage) -> NDArray[np.float64]:
    """Go to shortly before the start of the range, if the container can seek.

    Return the time stamps [ticks] of the film's frames, ascending, up to the end of the range: they
    number the frames. Return None if the film is decoded and counted from its first frame, as a
    renumbered film is.
    """
    target_s, none = footage.start_s - SEEK_MARGIN_S, np.empty(0)
    if footage.renumbered or target_s <= 0:
        return none
    tick_s = float(stream.time_base or 1)
    try:
        container.seek(int((target_s + footage.stamp_s) / tick_s), stream=stream)
    except (av.error.FFmpegError, OSError):  # then from the first frame as well
        return none
    return _picture_stamps(footage.path, (footage.end_s + footage.stamp_s) / tick_s)


def _picture_stamps(path: Path, last: float) -> NDArray[np.float64]:
    """Return the time stamps [ticks] of the frames that are shown before `last`, ascending.

    Packets are read, not decoded: an index only has decoding times.
    """
    stamps = []
    with open_stream(path) as (container, stream), suppress(*_BROKEN_OFF):
        for packet in container.demux(stream):
            if packet.dts is not None and packet.dts >= last:
                break
            if packet.size and packet.pts is not None and not packet.is_discard:
                stamps.append(packet.pts)
    return np.sort(np.array(stamps, np.float64))
