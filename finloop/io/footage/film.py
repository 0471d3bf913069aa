"""Films, read by FFmpeg: their facts, and their frames one after the other."""

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from itertools import islice, repeat
from os import SEEK_END
from pathlib import Path
from typing import Any, NamedTuple

import av
import av.error
import cv2
import numpy as np
from av.container import InputContainer
from av.filter import Graph
from av.sidedata.encparams import VideoEncParams, VideoEncParamsType
from av.sidedata.sidedata import Type as SideDataType
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace
from av.video.stream import VideoStream
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.base.thin import thin_frame
from finloop.io.footage.source import (
    CHROMA_FRACTION,
    FULL_FROM_LIMITED,
    SAMPLES,
    STRETCHES,
    WANTED,
    Footage,
    LostFrames,
    NumberedFrames,
    Order,
    Turn,
    choose_deep_levels,
    is_in_range,
    measure_chroma_fraction,
    nearest_turn,
    no_rate_error,
    other_size_error,
    square_pixel_size,
    stretch_levels,
    too_few_frames_error,
)
from finloop.io.footage.timing import estimate_frame_rate
from finloop.io.video import THREADS, view_grey_levels

# A film that does not state its range of levels counts as limited (16 … 235), unless so many pixels
# lie so far outside that black or white would be lost. A coder's ringing stays within.
OUTSIDE_LEVELS, OUTSIDE_FRACTION = (10, 241), 0.01
SEEK_MARGIN_S = 1.0
HD_HEIGHT = 720  # from here on, a film that does not state its colour matrix has BT.709
_FIRST_BYTES, _ARCHIVES = 60, (b"PK\3\4", b"\x1f\x8b", b"7z\xbc\xaf", b"Rar!")  # zip, gz, 7z, rar
_LUMA_FIRST = ("yuv4", "yuvj4", "yuva4", "nv1", "nv2", "gray")  # formats whose plane 0 is Y
_TRANSPORT_PACKETS = 188, 192, 204  # bytes: of MPEG-TS, of camcorders, with error correction
_SYNC, _SYNCS = 0x47, 5  # first byte of each packet; how many packets at the end are looked at
_HALF = 2**15  # of 16 bits; YUV that stays below does not fill its bits
_JPEG_END, _JPEG_PADDING = b"\xff\xd9", 64  # marker; bytes in which it must be, zeros may follow
_YUV = ("yuv", "nv", "uyvy", "yvyu", "p0")  # formats of brightness and two colour differences

# What PyAV raises where a container cannot be read on; the second if damage looks like the
# beginning of another stream.
_BROKEN_OFF = (av.error.FFmpegError, IndexError)


@contextmanager
def open_stream(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a film for a block; yield its container and the stream that a player shows.

    FinloopError if the file cannot be read or holds no moving pictures.
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
            best = container.streams.best("video")
            stream = best if isinstance(best, VideoStream) and best in streams else streams[0]
            stream.thread_type = "AUTO"
            yield container, stream
    except (av.error.FFmpegError, OSError) as error:
        raise _unreadable_film_error(path, error.strerror or str(error)) from error


def _unreadable_film_error(path: Path, why: str) -> FinloopError:
    """Return the error for a file that FFmpeg cannot read; its first bytes decide what it says.

    why: the reason, as FFmpeg states it.
    """
    beginning = b""
    with suppress(OSError), path.open("rb") as file:
        beginning = file.read(_FIRST_BYTES)
    text = beginning.decode("latin1")
    if text and text.isascii() and all(letter.isprintable() or letter.isspace() for letter in text):
        return FinloopError(
            came=f"{path} is text, not a film: it begins with {' '.join(text.split())!r}",
            wanted=WANTED,
            do="download the film itself; in a git repository with large files: git lfs pull",
        )
    if beginning.startswith(_ARCHIVES):
        return FinloopError(f"{path} is an archive, not a film", WANTED, "unpack it first")
    return FinloopError(
        came=f"{path} cannot be read as a film: {why}",
        wanted=WANTED,
        do="see whether a player shows it; an mp4 or mov that is still being recorded or "
        "copied lacks its index: wait; one that was cut off must be repaired first",
    )


def _picture_streams(container: InputContainer) -> list[VideoStream]:
    """Return a film's streams of moving pictures that can be decoded.

    The cover picture of an audio file is none.
    """
    return [
        stream
        for stream in container.streams.video
        if not stream.disposition & Disposition.attached_pic and stream.codec_context
    ]


def _read_time_stamps(
    container: InputContainer, stream: VideoStream
) -> tuple[np.ndarray, int, bool]:
    """Return the frames' time stamps [s], ascending, and how many frames the film says it has.

    The third value says whether the stamps are the times at which frames are shown. Nothing is
    decoded. A complete index of the file suffices: it holds the times at which frames are decoded,
    perhaps some frames early, but with the same gaps. Without an index, or if the file marks frames
    that a player shall not show, all packets are read.
    """
    index = stream.index_entries
    if 0 < stream.frames == len(index) and not any(entry.is_discard for entry in index):
        stamps, promised, are_shown = [entry.timestamp for entry in index], len(index), False
    else:
        stamps, promised, are_shown = _read_packet_stamps(container, stream)
    seconds = np.sort(np.array(stamps, np.float64)) * float(stream.time_base or 1)
    return seconds, promised, are_shown


def _read_packet_stamps(
    container: InputContainer, stream: VideoStream
) -> tuple[list[int], int, bool]:
    """Return the time stamps of all packets of a film, and how many frames the film says it has.

    The third value says whether every stamp is a time at which a frame is shown. A stamp counts in
    the stream's time base. Frames that a player shall not show are left out. A raw stream (.h264,
    .hevc) has no stamps: then each packet counts as a frame.
    """
    stamps: list[int] = []
    packets = discarded = end = 0
    are_shown = True
    with suppress(*_BROKEN_OFF):  # `_read_film_frames` counts what is missing
        for packet in container.demux(stream):
            stamp = packet.dts if packet.pts is None else packet.pts
            packets += packet.size > 0
            discarded += packet.is_discard
            if packet.size and stamp is not None and not packet.is_discard:
                stamps.append(stamp)
                are_shown &= packet.pts is not None
                end = max(end, stamp + (packet.duration or 0))
    if not stamps:
        return [], packets, False
    cut_off = _count_cut_off_frames(container, stream, np.sort(stamps), end)
    return stamps, max(len(stamps) + cut_off, stream.frames - discarded), are_shown


def _count_cut_off_frames(
    container: InputContainer, stream: VideoStream, stamps: np.ndarray, end: int
) -> int:
    """Return how many frames a film lacks at its end, by what its file says without an index.

    Matroska states how long a stream is, in a tag. Streams of MPEG consist of packets; if the file
    ends within one, at least a frame is lost. stamps (n,), ascending, and end, of
    the last frame that is there: in the stream's time base.
    """
    if container.format.name == "mpegts":
        return int(not _ends_with_whole_packets(Path(container.name)))
    if container.format.name == "mpeg":
        return int(_ends_within_picture_packet(Path(container.name)))
    stated = re.fullmatch(r"(\d+):(\d\d):(\d\d\.\d+)", stream.metadata.get("DURATION", ""))
    if stated is None or stamps[0] == stamps[-1]:
        return 0
    hours, minutes, seconds = map(float, stated.groups())
    stated_end = (3600 * hours + 60 * minutes + seconds) / float(stream.time_base or 1)
    step = (stamps[-1] - stamps[0]) / (len(stamps) - 1)  # not the median: it may be rounded to 0
    return max(0, round((stated_end - end - 1) / step))  # 1: stamps are rounded, too


def _ends_with_whole_packets(path: Path) -> bool:
    """Return whether the last packet of a transport stream is whole, by the sync bytes before it.

    The first packet may be cut: a recorder may begin anywhere.
    """
    end = _read_end(path, _SYNCS * _TRANSPORT_PACKETS[-1])
    # Packets of 192 bytes begin with 4 bytes of time.
    syncs = [end[4 * (size == 192) - size :: -size][:_SYNCS] for size in _TRANSPORT_PACKETS]
    return any(set(found) == {_SYNC} for found in syncs)


def _ends_within_picture_packet(path: Path) -> bool:
    """Return whether the last packet of pictures in a program stream (.mpg) is cut off.

    Such a packet begins with 0, 0, 1, 224 … 239, and its length in two bytes; 0 is unknown.
    """
    end = _read_end(path, 2**17)  # a packet has 2**16 bytes at most
    starts = [match.start() for match in re.finditer(rb"\0\0\x01[\xe0-\xef]..", end, re.DOTALL)]
    length = int.from_bytes(end[starts[-1] + 4 :][:2]) if starts else 0
    return length > 0 and starts[-1] + 6 + length > len(end)


def _read_end(path: Path, count: int) -> bytes:
    """Return the last bytes of a file, `count` at most."""
    with path.open("rb") as file:
        file.seek(-min(path.stat().st_size, count), SEEK_END)
        return file.read()


def _list_picture_notes(
    coding: "_FilmCoding", aspect: Fraction, streams: int, full_range: bool
) -> list[str]:
    """Return notes on what is unusual in a film's pictures, and how they are read.

    aspect: width : height of a pixel; streams: how many picture streams the file has; full_range:
    whether a film of unstated range is taken as one of full range.
    """
    coded_size = coding.width, coding.height
    size, square = (f"{w}×{h} px" for w, h in (coded_size, square_pixel_size(*coded_size, aspect)))
    applies_by_note = {
        f"the file says that pixels are {aspect} times as wide as high: pictures of {size} are "
        f"made square, {square}": square != size,
        f"of {streams} picture streams that of {size} is taken, as players do": streams > 1,
        "the film is interlaced: outlines are combed where a fish moves": coding.interlaced,
        "the film asks for a crooked turn; the nearest right angle is taken": not coding.turn_exact,
        "the film does not state its range of levels, and uses them all: 0 … 255": full_range,
    }
    return [note for note, applies in applies_by_note.items() if applies]


class _FilmCoding(NamedTuple):
    """How a film is coded, measured in sample frames spread over it."""

    width: int
    height: int
    first_s: float  # time stamp of the first frame
    turn: Turn
    turn_exact: bool
    interlaced: bool
    chroma: float  # share of the pixels that have colour
    outside: float  # share of the pixels outside the limited range
    levels: tuple[float, float] | None
    quantiser: float | None = None  # of H.264, mean of the samples; None for other codes


def _measure_coding(path: Path, stamps: np.ndarray) -> _FilmCoding:
    """Decode sample frames spread over a film and return how it is coded.

    stamps: of its frames [s], ascending. FinloopError if no frame can be decoded.
    """
    chroma, outside, deep, quantisers = [], [], [], []
    first: VideoFrame | None = None
    for frame in _sample_frames(path, stamps):
        first = first or frame
        if (frame.width, frame.height) != (first.width, first.height):
            continue  # `_read_film_frames` reports it
        quantisers += _measure_quantisers(frame)
        if frame.format.components[0].bits > 8:
            deep.append(thin_frame(_convert_to_rgb48(frame)))
        if _has_deep_levels(frame):
            continue
        rgb = thin_frame(_convert_to_rgb(frame, full_range=False, levels=None))
        chroma.append(measure_chroma_fraction([rgb]))
        outside.append(_measure_outside_fraction(frame))
    if first is None:
        raise too_few_frames_error(path, 0)
    levels = choose_deep_levels(deep) if deep else None
    if levels and levels[1] >= _HALF and not _has_deep_levels(first):
        levels = None
    if levels:
        chroma = [measure_chroma_fraction([stretch_levels(rgb, *levels)]) for rgb in deep]
    turn, exact = nearest_turn(_read_display_matrix(first))
    states_range = first.color_range in (ColorRange.MPEG, ColorRange.JPEG)
    may_be_limited = first.format.name.startswith(_YUV) and not states_range
    return _FilmCoding(
        width=first.width,
        height=first.height,
        first_s=float(stamps[0] if first.time is None else first.time),
        turn=turn,
        turn_exact=exact,
        interlaced=first.interlaced_frame,
        chroma=float(np.mean(chroma)),
        outside=float(np.mean(outside)) if may_be_limited and not levels else 0.0,
        levels=levels,
        quantiser=float(np.mean(quantisers)) if quantisers else None,
    )


def _has_deep_levels(frame: VideoFrame) -> bool:
    """Return whether a frame is grey or RGB with more than 8 bits for each value.

    Its file does not state how many of them the camera fills, unlike one of YUV.
    """
    is_grey = len(frame.format.components) <= 2  # the second is alpha
    return frame.format.components[0].bits > 8 and (is_grey or frame.format.is_rgb)


def _measure_outside_fraction(frame: VideoFrame) -> float:
    """Return the share of a frame's pixels whose grey levels lie outside `OUTSIDE_LEVELS`."""
    low, high = OUTSIDE_LEVELS
    grey = thin_frame(_convert_to_grey(frame, full_range=True, levels=None))
    return float(((grey < low) | (grey > high)).mean())


def _measure_quantisers(frame: VideoFrame) -> list[float]:
    """Return an H.264 frame's mean quantiser in a list of one item; [] for other codecs.

    The quantiser says how coarsely the frame is coded: 0 is without loss, 51 is worst.
    """
    return [
        float(np.mean(side.qp_map()))
        for side in frame.side_data
        if isinstance(side, VideoEncParams) and side.codec_type == VideoEncParamsType.H264
    ]


def _sample_frames(path: Path, stamps: np.ndarray) -> Iterator[VideoFrame]:
    """Yield decoded frames spread over a film; its first frames if the film is not seekable.

    stamps: times of all frames [s], ascending.
    """
    with open_stream(path) as (container, stream):
        stream.codec_context.options = {"export_side_data": "venc_params"}  # with the quantisers
        yield from _next_good_frames(container, stream, 1)
        for stamp in np.linspace(stamps[0], stamps[-1], SAMPLES)[1:]:
            try:
                container.seek(int(stamp / float(stream.time_base or 1)), stream=stream)
            except (av.error.FFmpegError, OSError):
                yield from _next_good_frames(container, stream, SAMPLES)
                return
            yield from _next_good_frames(container, stream, 1)


def _next_good_frames(
    container: InputContainer, stream: VideoStream, count: int
) -> Iterator[VideoFrame]:
    """Return the next undamaged frames from a film's present position on, at most `count`."""
    frames = _decode_film(container, stream)
    return islice((frame for frame in frames if frame is not None), count)


def open_film(path: Path, rate: Fraction | None, colour: bool | None) -> tuple[Footage, np.ndarray]:
    """Inspect a film; return its facts and the times of its frames [s], from 0.

    rate: frames per second that replace the film's; None = those of the film. colour: whether
    frames will be RGB; None = where the film has colours. FinloopError if it cannot be read, has
    fewer than two frames, or states no rate and is given none.
    """
    with open_stream(path) as (container, stream):
        stamps, promised, are_shown = _read_time_stamps(container, stream)
        rates = stream.average_rate, stream.guessed_rate, stream.base_rate
        stated = [stated_rate for stated_rate in rates if stated_rate]
        aspect = stream.sample_aspect_ratio or Fraction(1)
        streams = len(_picture_streams(container))
    # A raw stream has no stamps: its frames follow one another at the given rate.
    has_stamps = stamps.size > 0
    if not has_stamps and promised > 1:
        if rate is None:
            raise no_rate_error(path, f"a raw stream of {promised} frames")
        stamps, stated = np.arange(promised) / float(rate), [rate]
    if stamps.size < 2:
        raise too_few_frames_error(path, stamps.size)
    coding = _measure_coding(path, stamps if has_stamps else stamps[:1])
    film_rate = estimate_frame_rate(stamps, stated)
    frame_rate = rate or film_rate
    full_range = coding.outside > OUTSIDE_FRACTION  # too many pixels far outside 16 … 235
    notes = _list_picture_notes(coding, aspect, streams, full_range)
    if are_shown and (early := int(np.searchsorted(stamps, coding.first_s - 0.5 / film_rate))):
        says = f"the first {early} frames cannot be decoded, as no key frame comes before them"
        notes = [says, *notes]
        stamps, promised = stamps[early:], promised - early
    times = stamps - stamps[0] if rate is None else np.arange(stamps.size) / float(rate)
    if rate is not None and rate != film_rate:
        says = f"the file says {float(film_rate):g} frames/s"
        notes = [f"{says}; its frames are taken as shot at {float(rate):g}", *notes]
    square = square_pixel_size(coding.width, coding.height, aspect)
    footage = Footage(
        path=path,
        width_px=square[coding.turn.quarter_turns % 2],  # a quarter turn swaps the sides
        height_px=square[1 - coding.turn.quarter_turns % 2],
        frame_rate=frame_rate,
        colour=coding.chroma > CHROMA_FRACTION if colour is None else colour,
        frames_expected=stamps.size,
        reader=_read_film_frames,
        sampler=_sample_film,
        frames_in_source=max(promised, stamps.size),
        turn=coding.turn,
        levels=coding.levels,
        pixel_aspect=aspect,
        coded_size=(coding.width, coding.height),
        notes=tuple(notes),
        coding_quantiser=coding.quantiser,
        full_range=full_range,
        renumbered=rate is not None,
        stamp_s=coding.first_s,
        # Promised frames without a stamp follow the others.
        last_s=float(times[-1]) + (promised - stamps.size) / float(frame_rate),
    )
    return footage, times


def _decode_film(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame | None]:
    """Yield a film's frames from its present position on, with None for each damaged one.

    A JPEG that is cut off is shown grey below; it counts as damaged if earlier ones end as a whole
    one does.
    """
    packets, is_jpeg, ended = container.demux(stream), stream.codec.name == "mjpeg", False
    while True:
        try:
            packet = next(packets, None)
        except _BROKEN_OFF:
            return  # `_read_film_frames` counts what is missing
        if packet is None:
            return
        is_cut_off = False
        if is_jpeg and packet.size:
            has_end = _JPEG_END in bytes(packet)[-_JPEG_PADDING:]
            is_cut_off, ended = ended and not has_end, ended or has_end
        try:
            frames = [None] if packet.is_corrupt or is_cut_off else packet.decode()
        except av.error.FFmpegError:
            frames = [None]
        for frame in frames:
            yield None if frame is None or frame.is_corrupt else frame


def _read_film_frames(footage: Footage, loss: LostFrames) -> NumberedFrames:
    """Yield (time [s], (number, picture)) for each frame of a film in its range of time, upright.

    It is the `reader` of a film's `Footage`; see `Footage.stream_numbered`. loss: counts the frames
    that cannot be read; it changes.
    """
    step_s = 1 / float(footage.frame_rate)
    with open_stream(footage.path) as (container, stream):
        stamps = _seek_range(container, stream, footage)
        frames = _decode_film(container, stream)
        if footage.fields:
            frames = _deinterlace(frames, stream, footage.fields)
        # Time of the last good frame, and how many frames before it are damaged.
        good, last_good_s, damaged_before = 0, -step_s, 0
        for time_s, number, frame in _time_good_frames(frames, stream, footage, loss):
            last_good_s, damaged_before = time_s, loss.damaged
            if (frame.width, frame.height) != footage.coded_size:
                name = f"{footage.path}: the frame at {time_s:.3f} s"
                raise other_size_error(name, (frame.width, frame.height), footage.coded_size)
            if is_in_range(footage, time_s):
                # After a seek, frames are not counted from the film's first one.
                if stamps.size and frame.pts is not None:
                    number = int(np.searchsorted(stamps, frame.pts))
                good += 1
                yield time_s, (number, _upright_picture(footage, frame))
            elif time_s >= footage.start_s:  # the end of the range of time is passed
                return
        # The film has ended before its range of time. Some of the frames that lack after the last
        # good one may be damaged: those are counted already, even before it, as a decoder is late.
        promised_s = min(footage.last_s, footage.end_s - step_s)
        lacking = round((promised_s - last_good_s) / step_s) - (loss.damaged - damaged_before)
        unread = round((promised_s - footage.start_s) / step_s) + 1 - good - loss.damaged
        loss.missing_at_end = max(0, min(lacking, unread))


def _sample_film(footage: Footage, length: int) -> Iterator[list[np.ndarray]]:
    """Yield runs of `length` consecutive frames, spread over a film's range of time.

    It is the `sampler` of a film's `Footage`. Each run begins at another key frame, which decodes
    at once. A film with few key frames, or that is not seekable, is decoded to its end.
    """
    with open_stream(footage.path) as (container, stream):
        if (runs := _read_from_key_frames(container, stream, footage, length)) is not None:
            yield from runs
            return
    starts = np.linspace(0, footage.frames_expected - length, STRETCHES).astype(int)
    run: list[np.ndarray] = []
    for number, (_, (_, picture)) in enumerate(footage.stream_numbered(LostFrames())):
        if (starts <= number).any() and number < starts[starts <= number][-1] + length:
            run.append(picture.copy())
        if len(run) == length:
            yield run
            run = []


def _read_from_key_frames(
    container: InputContainer, stream: VideoStream, footage: Footage, length: int
) -> list[list[np.ndarray]] | None:
    """Return runs of consecutive frames that begin at key frames; None if the film has too few.

    length: of each run, in frames.
    """
    time_base_s = float(stream.time_base or 1)
    # Shares of the film hold for its stamps, too, if the user has given another rate.
    whole_s = footage.last_s + 1 / float(footage.frame_rate)
    first, last = footage.start_s / whole_s, min(1.0, footage.end_s / whole_s)
    length_s = (container.duration or 0) / av.time_base  # not every stream states its own
    start, ticks = footage.stamp_s / time_base_s, length_s / time_base_s
    runs: list[list[np.ndarray]] = []
    passed = -math.inf
    for share in np.linspace(first, last, STRETCHES, endpoint=False):
        try:
            container.seek(int(start + share * ticks), stream=stream)
        except (av.error.FFmpegError, OSError):
            return None
        frames = _decode_film(container, stream)
        if footage.fields:
            frames = _deinterlace(frames, stream, footage.fields)
        run: list[np.ndarray] = []
        for frame in frames:
            if frame is None or (frame.width, frame.height) != footage.coded_size:
                continue
            stamp = passed if frame.pts is None and run else frame.pts
            if stamp is None:
                continue
            if (stamp <= passed and not run) or stamp >= start + last * ticks:
                break  # the key frame of the run before, again; or the end
            if stamp >= start + first * ticks:
                passed = stamp
                run.append(_upright_picture(footage, frame).copy())
                if len(run) == length:
                    break
        if run:
            runs.append(run)
    return runs if 2 * len(runs) > STRETCHES else None


def _upright_picture(footage: Footage, frame: VideoFrame) -> np.ndarray:
    """Return a decoded frame upright and with square pixels, uint8.

    It is (h, w, 3) RGB if `footage.colour`, else (h, w) grey.
    """
    if footage.colour:
        picture = _convert_to_rgb(frame, footage.full_range, footage.levels)
    else:
        picture = _convert_to_grey(frame, footage.full_range, footage.levels)
    square = square_pixel_size(*footage.coded_size, footage.pixel_aspect)
    if square != footage.coded_size:
        picture = cv2.resize(picture, square, interpolation=cv2.INTER_LINEAR)
    return footage.turn(picture)


def _time_good_frames(
    frames: Iterable[VideoFrame | None], stream: VideoStream, footage: Footage, loss: LostFrames
) -> Iterator[tuple[float, int, VideoFrame]]:
    """Yield (time [s], number, frame) for each undamaged frame among decoded ones.

    The number counts all frames from the first one given, damaged ones included. The time is that
    of the stamp, unless the film is renumbered; without a stamp, that of the frame before plus a
    step. loss: its count of damaged frames grows.
    """
    step_s = 1 / float(footage.frame_rate)
    time_s = -step_s
    for number, frame in enumerate(frames):
        if frame is None:
            loss.damaged += 1
            continue
        if footage.renumbered:
            time_s = number * step_s
        elif frame.pts is None:
            time_s += step_s
        else:
            time_s = float(frame.pts * (stream.time_base or 1)) - footage.stamp_s
        yield time_s, number, frame


def _seek_range(
    container: InputContainer, stream: VideoStream, footage: Footage
) -> NDArray[np.float64]:
    """Seek a film to shortly before its range of time; return the time stamps of its frames.

    The stamps, in the stream's time base, are those up to the end of the range, ascending: a
    frame's place among them is its number. The result is empty if the range begins near the film's
    start, or the film is not seekable, or is renumbered: then it is decoded and counted from its
    first frame.
    """
    target_s = footage.start_s - SEEK_MARGIN_S
    if footage.renumbered or target_s <= 0:
        return np.empty(0)
    time_base_s = float(stream.time_base or 1)
    try:
        container.seek(int((target_s + footage.stamp_s) / time_base_s), stream=stream)
    except (av.error.FFmpegError, OSError):
        return np.empty(0)
    return _read_picture_stamps(footage.path, (footage.end_s + footage.stamp_s) / time_base_s)


def _read_picture_stamps(path: Path, end: float) -> NDArray[np.float64]:
    """Return the time stamps of a film's frames up to `end`, ascending; all in its time base.

    A few later ones may be among them. Packets are read, not decoded: an index only has decoding
    times.
    """
    stamps = []
    with open_stream(path) as (container, stream), suppress(*_BROKEN_OFF):
        for packet in container.demux(stream):
            if packet.dts is not None and packet.dts >= end:
                break  # no frame is shown before it is decoded, so all others come later
            if packet.size and packet.pts is not None and not packet.is_discard:
                stamps.append(packet.pts)
    return np.sort(np.array(stamps, np.float64))


# --- frames


def _read_display_matrix(frame: VideoFrame) -> np.ndarray:
    """Return the matrix (9 numbers) by which a player turns a frame upright.

    See `nearest_turn`. Without one in the file it is the identity.
    """
    side: Any
    for side in frame.side_data:
        if side.type == SideDataType.DISPLAYMATRIX:
            return np.frombuffer(bytes(side), np.int32)
    return np.eye(3).ravel()


def _convert_to_grey(
    frame: VideoFrame, full_range: bool, levels: tuple[float, float] | None
) -> np.ndarray:
    """Convert a decoded frame to grey (h, w) uint8, 0 = black, 255 = white.

    full_range: take the file's levels as they are, 0 … 255, even if the frame states none; else
    the limited range, 16 … 235, is expanded unless the frame says that it is full. levels: those of
    16 bits that become 0 and 255 in a film that does not fill its bits; None for others.
    """
    if levels:
        if len(frame.format.components) > 2:
            return cv2.cvtColor(_convert_to_rgb(frame, full_range, levels), cv2.COLOR_RGB2GRAY)
        return stretch_levels(frame.to_ndarray(format="gray16le"), *levels)
    name, bits = frame.format.name, frame.format.components[0].bits
    if bits == 8 and name.startswith(_LUMA_FIRST):  # the general conversion is 20 times slower
        full = full_range or name == "gray" or frame.color_range == ColorRange.JPEG
        grey = view_grey_levels(frame)
        return grey if full else cv2.LUT(grey, FULL_FROM_LIMITED)
    return frame.to_ndarray(
        format="gray",
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def _convert_to_rgb(
    frame: VideoFrame, full_range: bool, levels: tuple[float, float] | None
) -> np.ndarray:
    """Convert a decoded frame to RGB (h, w, 3) uint8, by the range and matrix that it states.

    Without a matrix it is that of players (`_colour_matrix`). full_range: take its
    levels as 0 … 255 even if it does not say so. levels: see `_convert_to_grey`.
    """
    if levels:
        return stretch_levels(_convert_to_rgb48(frame), *levels)
    return frame.to_ndarray(
        format="rgb24",
        src_colorspace=_colour_matrix(frame),
        src_color_range=ColorRange.JPEG if full_range else frame.color_range,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def _convert_to_rgb48(frame: VideoFrame) -> np.ndarray:
    """Convert a decoded frame to RGB (h, w, 3) uint16; brightness keeps its levels, as full range.

    A limited range would cut off what a camera of fewer bits stores below it.
    """
    if not frame.format.name.startswith(_YUV):
        return frame.to_ndarray(format="rgb48le")
    return frame.to_ndarray(
        format="rgb48le",
        src_colorspace=_colour_matrix(frame),
        src_color_range=ColorRange.JPEG,
        dst_color_range=ColorRange.JPEG,
        threads=THREADS,
    )


def _colour_matrix(frame: VideoFrame) -> Colorspace | int:
    """Return the matrix that a frame states; without one BT.709 from 720 rows on, else BT.601."""
    if frame.colorspace in list(Colorspace):
        return frame.colorspace
    return Colorspace.ITU709 if frame.height >= HD_HEIGHT else Colorspace.ITU601


def _deinterlace(
    frames: Iterator[VideoFrame | None], stream: VideoStream, order: Order
) -> Iterator[VideoFrame | None]:
    """Yield frames deinterlaced: the rows of each frame's later field are interpolated.

    stream: from which the frames come. order: which of the two fields is earlier. FFmpeg's filter
    bwdif does it. A damaged frame, None, stays None at its place; the filter does not see it.
    """
    graph = Graph()
    deinterlacer = graph.add("bwdif", f"mode=send_frame:parity={order}:deint=all")
    graph.link_nodes(graph.add_buffer(template=stream), deinterlacer, graph.add("buffersink"))
    graph.configure()
    damaged = 0  # since the last good frame, which the filter holds until it gets the next one
    for frame in frames:
        if frame is None:
            damaged += 1
            continue
        graph.push(frame)
        yield from _filtered_frames(graph, stream)
        yield from repeat(None, damaged)
        damaged = 0
    graph.push(None)
    yield from _filtered_frames(graph, stream)
    yield from repeat(None, damaged)


def _filtered_frames(graph: Graph, stream: VideoStream) -> Iterator[VideoFrame]:
    """Yield the frames that an FFmpeg filter has finished, with time stamps in ticks of the stream.

    graph: the filter; it may be a frame behind its input.
    """
    while True:
        try:
            frame = graph.pull()
        except (BlockingIOError, EOFError):
            return
        assert isinstance(frame, VideoFrame)
        if frame.pts is not None and stream.time_base and frame.time_base:
            frame.pts = round(frame.pts * frame.time_base / stream.time_base)
            frame.time_base = stream.time_base
        yield frame
