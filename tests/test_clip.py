"""The clip stage: any film becomes frames of constant rate, upright; or a message says why not.

Films are drawn here, a few frames small. A white square in the upper left corner says which way is
up; the grey of its background says which frame it is.
"""

import hashlib
import io
import math
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd
import pytest
import tifffile
import yaml
from av.stream import Disposition
from hypothesis import given
from hypothesis import strategies as st
from PIL import ExifTags, Image
from scipy.io import savemat
from scratch import carp_frames

from finloop.base.errors import FinloopError
from finloop.base.settings import check_values, settings, variants
from finloop.base.thin import thin_frame
from finloop.clip.check import SAMPLES, ClipTally, psnr_db
from finloop.clip.write import circle_arena, rectangle_arena
from finloop.drawn.carp import film as carp
from finloop.drawn.truth import TRUTH
from finloop.io import wheel
from finloop.io.footage import arrays as film_arrays
from finloop.io.footage import open_footage
from finloop.io.footage.source import (
    CHROMA_FRACTION,
    Footage,
    LostFrames,
    choose_deep_levels,
    measure_chroma_fraction,
    nearest_turn,
    stretch_levels,
)
from finloop.io.footage.timing import (
    FrameCounts,
    estimate_frame_rate,
    resample_nearest,
    split_at_cuts,
)
from finloop.io.numbers import load_numbers
from finloop.io.table import load_table
from finloop.io.video import FRAMES, load_facts, load_mask, read_frames
from stages import clip as stage

ROOT = Path(__file__).parents[1]
WIDTH, HEIGHT = 64, 48

# --- time


@pytest.mark.parametrize("rate", [Fraction(25), Fraction(30000, 1001), Fraction(1, 10)])
def test_constant_rate_is_found_through_rounded_stamps(rate):
    times = np.round(np.arange(300) / float(rate), 3)  # milliseconds, as in webm
    assert estimate_frame_rate(times, [rate]) == rate
    assert abs(float(estimate_frame_rate(times, []) / rate) - 1) < 1e-4


def test_dropped_frames_and_pauses_do_not_slow_the_rate_down():
    times = np.delete(np.arange(200) / 30, [5, 6, 50, 90])
    times[100:] += 60
    assert estimate_frame_rate(times, [Fraction(99, 7), Fraction(30)]) == 30
    assert estimate_frame_rate(times, []) == 30
    rounded = np.round(times, 3)  # at the median gap of 33 ms the pause would count 18 frames more
    assert abs(float(estimate_frame_rate(rounded, [])) / 30 - 1) < 1e-3


def retime(times, rate) -> tuple[list[int], FrameCounts]:
    timing = FrameCounts()
    return list(resample_nearest(zip(times, range(len(times)), strict=True), rate, timing)), timing


@given(st.lists(st.floats(-0.45, 0.45), min_size=2, max_size=40))
def test_jitter_below_half_a_frame_changes_nothing(jitter):
    """The first frame sets the clock, so it is where the others are measured from."""
    times = (np.arange(len(jitter)) + np.array([0, *jitter[1:]])) / 30
    shown, timing = retime(times, Fraction(30))
    assert shown == list(range(len(times)))
    assert timing == FrameCounts(frames=len(times), cuts=[0])


@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=40), st.sampled_from([5, 24, 60]))
def test_every_tick_shows_the_nearest_frame(gaps, rate):
    times = 7 + np.cumsum([0, *gaps])
    shown, timing = retime(times, Fraction(rate))
    ticks = times[0] + np.arange(len(shown)) / rate
    nearest = np.abs(times[:, None] - ticks).min(axis=0)
    np.testing.assert_allclose(np.abs(times[shown] - ticks), nearest, atol=1e-9)
    assert abs(ticks[-1] - times[-1]) <= 0.5 / rate + 1e-9
    assert timing.frames == len(shown) == len(set(shown)) + timing.repeated
    assert timing.dropped == len(times) - len(set(shown))


def test_a_pause_or_a_clock_that_runs_back_is_a_cut():
    times = [0, 0.1, 0.2, 9.0, 9.1, 0.0, 0.1, 0.2]
    shown, timing = retime(times, Fraction(10))
    assert shown == list(range(8))
    assert timing == FrameCounts(frames=8, cuts=[0, 3, 5])
    assert split_at_cuts(timing.cuts, timing.frames) == ((0, 3), (3, 5), (5, 8))


# --- which way is up

MATRICES = {  # of the display, by FFmpeg's convention: x′ = a x + c y, y′ = b x + d y
    "as it is": ((1, 0, 0, 1), lambda picture: picture),
    "turned left": ((0, -1, 1, 0), np.rot90),
    "upside down": ((-1, 0, 0, -1), lambda picture: np.rot90(picture, 2)),
    "turned right": ((0, 1, -1, 0), lambda picture: np.rot90(picture, 3)),
    "mirrored": ((-1, 0, 0, 1), np.fliplr),
    "mirrored, upside down": ((1, 0, 0, -1), np.flipud),
    "mirrored, turned left": ((0, 1, 1, 0), lambda picture: np.rot90(np.fliplr(picture))),
    "mirrored, turned right": ((0, -1, -1, 0), lambda picture: np.rot90(np.fliplr(picture), 3)),
}


def test_a_crooked_turn_is_told():
    angle = np.radians(80)
    cos, sin = np.cos(angle), np.sin(angle)
    turn, exact = nearest_turn([cos, -sin, 0, sin, cos, 0, 0, 0, 1])
    assert (turn.rotation_deg, exact) == (90, False)


# --- arena


def test_an_arena_is_the_pixels_whose_centres_lie_in_the_shape():
    mask = rectangle_arena(6, 4, 1, 1, 3, 2)
    assert mask.shape == (4, 6) and mask[1:3, 1:4].all() and mask.sum() == 6
    assert rectangle_arena(6, 4, -9, -9, 99, 99).all()
    mask = circle_arena(50, 40, 20, 19, 15)
    x, y = np.argwhere(mask)[:, ::-1].T
    assert np.hypot(x - 20, y - 19).max() <= 15
    assert abs(mask.sum() / (np.pi * 15**2) - 1) < 0.02
    np.testing.assert_array_equal(circle_arena(5, 5, 2, 2, 1).sum(axis=0), [0, 1, 3, 1, 0])


@pytest.mark.parametrize(
    ("shape", "numbers"),
    [
        (rectangle_arena, (6, 0, 3, 3)),
        (rectangle_arena, (1.2, 1.2, 0.5, 0.5)),
        (circle_arena, (30, 2, 5)),
        (circle_arena, (0.5, 0.5, 0.1)),
    ],
)
def test_an_arena_outside_the_picture_is_refused(shape, numbers):
    with pytest.raises(FinloopError, match="outside the picture"):
        shape(6, 4, *numbers)


# --- light and colour


def test_colour_is_what_differs_from_the_tint():
    grey = np.random.default_rng(0).integers(0, 256, (50, 50, 1), dtype=np.uint8)
    film = np.repeat(grey, 3, axis=2)
    assert measure_chroma_fraction([film]) == 0
    tinted = (film // 2 + [80, 20, 110]).astype(np.uint8)
    assert measure_chroma_fraction([tinted]) < CHROMA_FRACTION
    film[10:15, 10:12] = [220, 90, 20]  # a goldfish
    assert measure_chroma_fraction([film]) > CHROMA_FRACTION


def test_deep_levels_ignore_hot_pixels_and_are_stretched():
    frame = np.linspace(1000, 3000, 10**5).astype(np.uint16).reshape(100, 1000)
    frame[0, :3] = 65535
    assert choose_deep_levels([frame, frame]) == pytest.approx((1000, 3000), abs=3)
    flat = np.full((4, 4), 7, np.uint16)
    assert not stretch_levels(flat, *choose_deep_levels([flat])).any()
    frame = np.array([[0, 1000, 1500, 2000, 65535]], np.uint16)
    np.testing.assert_array_equal(stretch_levels(frame, 1000, 2000), [[0, 0, 128, 255, 255]])


def test_tally_is_bounded_and_spread():
    tally = ClipTally()
    for level in range(200):
        tally.add_frame(np.full((2, 2), level, np.uint8))
    assert (tally.darkest, tally.brightest, tally.brightness_mean) == (0, 199, 99.5)
    assert SAMPLES / 2 < len(tally.samples) <= SAMPLES
    assert len(set(np.diff(list(tally.samples)))) == 1
    assert all(frame[0, 0] == number for number, frame in tally.samples.items())
    assert max(tally.samples) > 150
    tally = ClipTally()
    tally.add_frame(np.full((2, 2, 3), [10, 12, 17], np.uint8))
    assert tally.brightness_mean == pytest.approx(13)
    assert tally.is_plain
    tally.add_frame(np.full((2, 2, 3), 90, np.uint8))
    assert not tally.is_plain


@pytest.mark.parametrize("shape", [(901, 1203, 3), (720, 1280, 3), (900, 701), (20, 30, 3)])
def test_a_thinned_frame_is_every_kth_row_and_column(shape):
    frame = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    thinned = thin_frame(frame)
    step = math.ceil(shape[0] / thinned.shape[0])
    np.testing.assert_array_equal(thinned, frame[::step, ::step])
    assert not np.shares_memory(thinned, frame)
    np.testing.assert_array_equal(thin_frame(frame.astype(np.uint16)), thinned)


def test_psnr():
    frame = np.full((4, 4), 100, np.uint8)
    assert psnr_db([(frame, frame)]) == math.inf
    other = frame.copy()
    other[0, 0] += 8  # a mean square of 4
    assert psnr_db([(frame, other)]) == pytest.approx(10 * math.log10(255**2 / 4))


# --- films drawn for the tests


def picture(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """RGB of frame `number`: a grey of 40 + 4 · number with a white square at the upper left."""
    made = np.full((height, width, 3), 40 + 4 * number, np.uint8)
    made[: height // 3, : width // 3] = 255
    return made


def numbers(frames) -> list[int]:
    """The numbers of the frames, from the grey of their lower right corner."""
    return [round((float(np.median(frame[-8:, -8:])) - 40) / 4) for frame in frames]


def make_film(
    path: Path,
    pictures,
    *,
    codec: str = "mpeg4",
    rate: int = 25,
    pts: list[int] | None = None,
    pix_fmt: str = "yuv420p",
    options: dict[str, str] | None = None,
    matrix: tuple[int, ...] | None = None,
    gop: int = 12,
    source: str = "rgb24",
    title: str = "",
    aspect: Fraction = Fraction(1),
) -> Path:
    """Write a film; `pts` in milliseconds make its rate variable."""
    frames = [av.VideoFrame.from_ndarray(one, format=source) for one in pictures]
    with av.open(str(path), "w") as container:
        container.metadata["title"] = title
        stream = container.add_stream(codec, rate=rate, options=options)
        stream.height, stream.width = frames[0].height, frames[0].width
        stream.pix_fmt = pix_fmt
        stream.codec_context.sample_aspect_ratio = aspect
        stream.codec_context.gop_size = gop
        base = Fraction(1, 1000) if pts else Fraction(1, rate)
        stream.codec_context.time_base = base
        stream.bit_rate = 10_000_000  # so that greys stay what they are
        if matrix:
            stream.set_display_matrix(matrix)
        for number, frame in enumerate(frames):
            frame.pts, frame.time_base = pts[number] if pts else number, base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def goldfish(count: int) -> list[np.ndarray]:
    """Pictures with something red."""
    coloured = [picture(k) for k in range(count)]
    for one in coloured:
        one[30:40, 30:40] = [200, 40, 40]
    return coloured


def add_stream(container, codec: str, width: int, height: int, pix_fmt: str = "yuv420p"):
    """A stream of pictures, 25 a second."""
    stream = container.add_stream(codec, rate=25)
    stream.width, stream.height, stream.pix_fmt = width, height, pix_fmt
    return stream


def mux_pictures(container, count: int, *streams) -> None:
    """Write the same pictures to each stream, picture by picture."""
    for k in range(count):
        for stream in streams:
            one = picture(k, stream.width, stream.height)
            frame = av.VideoFrame.from_ndarray(one, format="rgb24")
            frame.pts, frame.time_base = k, Fraction(1, 25)
            container.mux(stream.encode(frame))
    for stream in streams:
        container.mux(stream.encode(None))


def read(footage: Footage, loss: LostFrames | None = None) -> tuple[list[float], list[np.ndarray]]:
    stamped = list(footage.stream_numbered(loss or LostFrames()))
    return [time for time, _ in stamped], [frame for _, (_, frame) in stamped]


def shown_at(footage: Footage, rate: int, loss: LostFrames, timing: FrameCounts) -> list[int]:
    """Return the numbers that the pictures of a film show which is re-timed to a constant rate."""
    frames = footage.stream_numbered(loss)
    return numbers(frame for _, frame in resample_nearest(frames, Fraction(rate), timing))


@pytest.fixture(scope="module")
def avi(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fifty frames, 25 a second: two seconds."""
    return make_film(tmp_path_factory.mktemp("film") / "film.avi", map(picture, range(50)))


@pytest.fixture(scope="module")
def broken_off(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two thirds of an AVI of fifty frames: its header promises more than it holds."""
    noise = np.random.default_rng(0).integers(0, 30, (50, HEIGHT, WIDTH, 3), dtype=np.uint8)
    pictures = (picture(k) // 30 * 30 + noise[k] for k in range(50))
    path = make_film(
        tmp_path_factory.mktemp("film") / "film.avi", pictures, codec="mjpeg", pix_fmt="yuvj420p"
    )
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    return path


CONTAINERS = {
    "avi": ("mpeg4", "yuv420p"),
    "mp4": ("libx264", "yuv420p"),
    "mov": ("mjpeg", "yuvj420p"),
    "mkv": ("ffv1", "yuv420p"),
    "webm": ("libvpx", "yuv420p"),
    "gif": ("gif", "rgb8"),
}


@pytest.mark.parametrize("kind", CONTAINERS)
def test_every_container_comes_through_whole(tmp_path, kind):
    codec, pix_fmt = CONTAINERS[kind]
    shown = map(picture, range(20))
    path = make_film(tmp_path / f"film.{kind}", shown, codec=codec, pix_fmt=pix_fmt)
    footage = open_footage(path, colour=False)
    times, frames = read(footage)
    assert (footage.width_px, footage.height_px) == (WIDTH, HEIGHT)
    assert (footage.frame_rate, footage.frames_expected, len(frames)) == (25, 20, 20)
    np.testing.assert_allclose(times, np.arange(20) / 25, atol=0.002)
    assert kind == "gif" or numbers(frames) == list(range(20))  # it has eight levels of grey
    assert all(frame.shape == (HEIGHT, WIDTH) and frame.dtype == np.uint8 for frame in frames)
    assert frames[0][2, 2] > 245


def test_frames_that_an_edit_list_leaves_out_are_no_part_of_the_film(tmp_path):
    """A copy that begins between two key frames is cut by an edit list alone."""
    whole = make_film(
        tmp_path / "whole.mp4",
        map(picture, range(40)),
        codec="libx264",
        options={"bf": "3"},
        gop=40,
    )
    cut, first = tmp_path / "cut.mp4", 10
    times = {"avoid_negative_ts": "disabled"}
    with av.open(str(whole)) as source, av.open(str(cut), "w", container_options=times) as copy:
        stream = source.streams.video[0]
        copied = copy.add_stream_from_template(stream)
        for packet in source.demux(stream):
            if packet.dts is not None:
                packet.pts -= int(first / 25 / stream.time_base)
                packet.dts -= int(first / 25 / stream.time_base)
                packet.stream = copied
                copy.mux(packet)
    footage = open_footage(cut)
    times, frames = read(footage, loss := LostFrames())
    assert numbers(frames) == list(range(first, 40)) and not loss.lost_frames
    np.testing.assert_allclose(times, np.arange(30) / 25, atol=1e-6)
    assert footage.frames_expected == footage.frames_in_source == 30
    late = open_footage(cut, start_s=0.4, end_s=0.8)
    assert numbers(read(late)[1]) == list(range(20, 30))


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_a_cover_picture_is_no_film(tmp_path, ending):
    """In Matroska nothing but its single frame tells it from a film."""
    path = tmp_path / f"film.{ending}"
    with av.open(str(path), "w") as container:
        cover = add_stream(container, "mjpeg", 200, 100, "yuvj420p")
        cover.disposition = Disposition.attached_pic
        film = add_stream(container, "libx264", WIDTH, HEIGHT)
        mux_pictures(container, 1, cover)
        mux_pictures(container, 20, film)
    footage = open_footage(path)
    assert (footage.width_px, footage.height_px) == (WIDTH, HEIGHT)
    assert numbers(read(footage)[1]) == list(range(20))


def test_of_several_picture_streams_one_is_taken_and_named(tmp_path):
    path = tmp_path / "film.mkv"
    with av.open(str(path), "w") as container:
        streams = [add_stream(container, "libx264", WIDTH, HEIGHT) for _ in range(2)]
        mux_pictures(container, 20, *streams)
    footage = open_footage(path)
    assert numbers(read(footage)[1]) == list(range(20))
    said = f"of 2 picture streams that of {WIDTH}×{HEIGHT} px is taken, as players do"
    assert footage.notes == (said,)


@pytest.mark.parametrize(("ending", "codec"), [("h264", "libx264"), ("hevc", "libx265")])
def test_a_raw_stream_has_the_rate_that_is_given(tmp_path, ending, codec):
    options = {"x265-params": "log-level=none"} if codec == "libx265" else {"bf": "2"}
    path = make_film(
        tmp_path / f"film.{ending}", map(picture, range(30)), codec=codec, options=options
    )
    with pytest.raises(FinloopError, match=r"raw stream of 30 frames.*do not state how fast"):
        open_footage(path)
    footage = open_footage(path, frame_rate_hz=50, start_s=0.2)
    times, frames = read(footage, loss := LostFrames())
    assert numbers(frames) == list(range(10, 30)) and loss.lost_frames == 0
    np.testing.assert_allclose(times, np.arange(10, 30) / 50)
    assert footage.frames_in_source == 30 and footage.frame_rate == 50


@pytest.mark.parametrize("aspect", [Fraction(2), Fraction(1, 2), Fraction(16, 15)])
@pytest.mark.parametrize("turned", [False, True])
def test_pixels_become_square(tmp_path, aspect, turned):
    path = make_film(
        tmp_path / "film.mp4", map(picture, range(3)), aspect=aspect,
        matrix=(0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30) if turned else None,
    )  # fmt: skip
    footage = open_footage(path)
    width = round(WIDTH * max(aspect, 1))
    height = round(HEIGHT / min(aspect, Fraction(1)))
    shape = (width, height) if turned else (height, width)
    assert (footage.height_px, footage.width_px) == shape and footage.pixel_aspect == aspect
    assert [frame.shape[:2] for frame in read(footage)[1]] == [shape] * 3
    assert numbers(read(footage)[1]) == [0, 1, 2] or turned
    assert "are made square" in footage.notes[0]


def test_colour_is_found_kept_or_left(tmp_path):
    coloured = goldfish(5)
    path = make_film(tmp_path / "a.mkv", coloured, codec="ffv1", pix_fmt="bgr0")
    for source in (path, write_pictures(tmp_path / "film", coloured)):
        footage = open_footage(source, frame_rate_hz=25)
        assert footage.colour
        np.testing.assert_array_equal(read(footage)[1], coloured)
        assert read(open_footage(source, frame_rate_hz=25, colour=False))[1][0].ndim == 2
    grey = make_film(tmp_path / "b.mkv", map(picture, range(5)), codec="ffv1", pix_fmt="bgr0")
    assert not open_footage(grey).colour
    assert open_footage(grey, colour=True).colour


def luma_film(path: Path, low: int, high: int) -> Path:
    """A film that does not state its range, with a ramp of Y from `low` to `high`."""
    ramp = np.tile(np.linspace(low, high, WIDTH).astype(np.uint8), (HEIGHT, 1))
    planes = np.vstack([ramp, np.full((HEIGHT // 2, WIDTH), 128, np.uint8)])
    return make_film(path, [planes] * 3, codec="ffv1", source="yuv420p")


def test_limited_range_becomes_full(tmp_path):
    """16 is black and 235 white, unless the film plainly uses more."""
    footage = open_footage(luma_film(tmp_path / "a.mkv", 16, 235), colour=False)
    frame = read(footage)[1][0]
    y = np.linspace(16, 235, WIDTH).astype(np.uint8).astype(float)
    np.testing.assert_allclose(frame[0], (y - 16) * 255 / 219, atol=0.5)
    footage = open_footage(luma_film(tmp_path / "b.mkv", 0, 255), colour=False)
    frame = read(footage)[1][0]
    np.testing.assert_array_equal(frame[0], np.linspace(0, 255, WIDTH).astype(np.uint8))
    assert "range of levels" in footage.notes[0]
    rgb = read(open_footage(tmp_path / "b.mkv", colour=True))[1][0]
    assert np.abs(rgb[..., 1].astype(int) - frame).max() <= 1


@pytest.mark.parametrize(("width", "height"), [(63, 47), (17, 33), (500, 263)])
def test_odd_sizes_keep_every_pixel(tmp_path, width, height):
    """4:2:0 within an odd size: the last row and column are there, and where they were."""
    frames = [picture(k, width, height) for k in range(3)]
    for one in frames:
        one[-1], one[:, -1] = 255, 255
    path = make_film(tmp_path / "a.avi", frames, codec="mjpeg", pix_fmt="yuvj420p")
    back = read(open_footage(path, colour=False))[1]
    assert back[0].shape == (height, width)
    assert np.abs(back[0].astype(int) - frames[0][..., 0]).mean() < 6
    assert back[0][-1].mean() > 200 > 120 > back[0][-4, : -width // 2].mean()


@pytest.mark.parametrize("way", MATRICES)
def test_the_display_matrix_is_honoured(tmp_path, way):
    (a, b, c, d), reference = MATRICES[way]
    matrix = (a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    path = make_film(
        tmp_path / "a.mp4", map(picture, range(3)), matrix=None if way == "as it is" else matrix
    )
    footage = open_footage(path, colour=False)
    frame = read(footage)[1][0]
    expected = reference(picture(0)[..., 0])
    assert frame.shape == expected.shape == (footage.height_px, footage.width_px)
    assert np.abs(frame.astype(int) - expected).mean() < 8
    facts, turned = footage.clip_facts("file", 0), {"left": 90, "upside": 180, "right": 270}
    assert facts.mirrored == ("mirrored" in way)
    assert facts.rotation_deg == next((turned[word] for word in way.split() if word in turned), 0)


VARIABLE_MS = [0, 33, 67, 100, 233, 267, 300, 310, 333, 367]  # 3 dropped at 133, one more at 310


@pytest.mark.parametrize("kind", ["mkv", "mp4"])
def test_variable_rate_becomes_constant(tmp_path, kind):
    path = make_film(tmp_path / f"a.{kind}", map(picture, range(10)), rate=30, pts=VARIABLE_MS)
    footage = open_footage(path, colour=False)
    assert abs(footage.frame_rate - 30) < 1
    timing = FrameCounts()
    shown = shown_at(footage, 30, LostFrames(), timing)
    assert shown == [0, 1, 2, 3, 3, 4, 4, 4, 5, 6, 8, 9]
    assert (timing.repeated, timing.dropped) == (3, 1)
    assert footage.frames_expected == pytest.approx(12, abs=1)
    counted = resample_nearest(footage.stream_numbered(LostFrames()), Fraction(30), FrameCounts())
    assert [number for number, _ in counted] == shown
    assert footage.frames_in_source == 10


@pytest.mark.parametrize("kind", [".mkv", ".avi", ".png", "no key frames"])
@pytest.mark.parametrize("rate", [None, 250])
def test_a_sample_is_of_successive_frames_spread_over_the_range(tmp_path, kind, rate):
    levels = [np.full((HEIGHT, WIDTH), 40 + k, np.uint8) for k in range(160)]
    if kind == ".png":
        path, rate = write_pictures(tmp_path / "film", levels, kind), rate or 25
    else:
        every = 1000 if kind == "no key frames" else 10
        path = tmp_path / f"film{kind if kind[0] == '.' else '.mkv'}"
        colours = [np.dstack([level] * 3) for level in levels]
        make_film(
            path, colours, codec="libx264", options={"crf": "1", "sc_threshold": "0"}, gop=every
        )
    first, last = 10, 150
    footage = open_footage(
        path, frame_rate_hz=rate, start_s=first / (rate or 25), end_s=last / (rate or 25)
    )
    shown = [float(picture.mean()) for picture in read(footage)[1]]
    stretches = [[float(p.mean()) for p in part] for part in footage.sample_runs(40)]
    assert {len(stretch) for stretch in stretches} == {5} and 5 <= len(stretches) <= 8
    starts = [
        next(k for k in range(len(shown)) if shown[k : k + 5] == stretch) for stretch in stretches
    ]
    assert min(np.diff(starts)) >= 5 and starts[0] < 20 and starts[-1] > 100
    assert sum(map(len, footage.sample_runs(140))) == 140


def test_a_given_rate_keeps_every_frame_and_changes_its_time(tmp_path):
    path = make_film(tmp_path / "a.mkv", map(picture, range(10)), rate=30, pts=VARIABLE_MS)
    footage = open_footage(path, frame_rate_hz=100, colour=False, start_s=0.02, end_s=0.07)
    times, frames = read(footage)
    np.testing.assert_allclose(times, np.arange(2, 7) / 100)
    assert numbers(frames) == [2, 3, 4, 5, 6]
    assert footage.frame_rate == 100
    assert "taken as shot at 100" in footage.notes[0]


@pytest.mark.parametrize(
    ("start_s", "end_s", "expected"),
    [
        (0, None, range(50)), (0.4, None, range(10, 50)), (0, 0.4, range(10)),
        (1.5, 1.6, range(38, 40)), (1.88, 2.0, range(47, 50)), (0.401, 0.5, range(11, 13)),
    ],
)  # fmt: skip
def test_a_range_of_time_has_its_frames_with_their_numbers(avi, start_s, end_s, expected):
    footage = open_footage(avi, start_s=start_s, end_s=end_s, colour=False)
    numbered = [frame for _, frame in footage.stream_numbered(LostFrames())]
    assert [number for number, _ in numbered] == list(expected)
    assert numbers(frame for _, frame in numbered) == list(expected)
    assert footage.frames_expected == len(expected)


def test_frames_after_a_late_start_keep_their_numbers(tmp_path):
    """The film is sought, not decoded from its first frame."""
    path = make_film(tmp_path / "a.mp4", (picture(k % 50) for k in range(250)), codec="libx264")
    footage = open_footage(path, start_s=9.6, colour=False)
    numbered = [frame for _, frame in footage.stream_numbered(LostFrames())]
    assert [number for number, _ in numbered] == list(range(240, 250))
    assert numbers(frame for _, frame in numbered) == list(range(40, 50))


def test_a_title_in_another_encoding_is_no_obstacle(tmp_path):
    path = make_film(tmp_path / "a.avi", map(picture, range(3)), title="Tuempel")
    path.write_bytes(path.read_bytes().replace(b"Tuempel", "Tümpel ".encode("latin-1")))
    assert len(read(open_footage(path))[1]) == 3


# --- pictures


def write_pictures(folder: Path, pictures, suffix: str = ".png", names=()) -> Path:
    """Write pictures into a new folder, as img0, img1, … unless they have names."""
    folder.mkdir()
    for number, one in enumerate(pictures):
        stored = cv2.cvtColor(one, cv2.COLOR_RGB2BGR) if one.ndim == 3 else one
        name = names[number] if names else f"img{number}{suffix}"
        (folder / name).write_bytes(cv2.imencode(suffix, stored)[1].tobytes())
    return folder


def test_a_folder_of_pictures_in_natural_order(tmp_path):
    folder = write_pictures(tmp_path / "film", (picture(k)[..., 0] for k in range(12)))
    (folder / "notes.txt").write_text("about the film")
    (folder / ".hidden.png").write_text("")
    footage = open_footage(folder, frame_rate_hz=50)
    times, frames = read(footage)
    np.testing.assert_allclose(times, np.arange(12) / 50)
    assert numbers(frames) == list(range(12))
    np.testing.assert_array_equal(frames[3], picture(3)[..., 0])
    assert not footage.colour
    part = open_footage(folder, frame_rate_hz=50, start_s=0.1, end_s=0.2)
    assert numbers(read(part)[1]) == [5, 6, 7, 8, 9]
    assert [number for _, (number, _) in part.stream_numbered(LostFrames())] == [5, 6, 7, 8, 9]


def test_missing_numbers_are_missing_frames_with_their_time(tmp_path):
    names = [f"f{2 * k + 8}.png" for k in range(40)]  # numbered by twos, not padded
    folder = write_pictures(tmp_path / "film", map(picture, range(40)), names=names)
    missing = (5, 6, *range(20, 24))
    for k in missing:
        (folder / names[k]).unlink()
    (folder / "background.png").write_bytes(b"no picture")
    footage = open_footage(folder, frame_rate_hz=10)
    times, frames = read(footage, loss := LostFrames())
    there = [k for k in range(40) if k not in missing]
    assert numbers(frames) == there and loss.lost_frames == 6
    np.testing.assert_allclose(times, np.array(there) / 10)
    assert footage.frames_expected == 40
    left_out, gaps = footage.notes
    assert "background.png" in left_out
    assert "6 pictures are missing" in gaps and "f46.png" in gaps
    later = open_footage(folder, frame_rate_hz=10, start_s=2.4)
    assert numbers(read(later, loss)[1]) == list(range(24, 40)) and loss.gaps == 0


@pytest.mark.parametrize(
    ("names", "rate", "said"),
    [
        (["a.png", "b2.png", "c10_3.png", "d.png"], 10, "alphabetical order"),
        ([f"s{k // 6}_{k % 6}.png" for k in range(18)], 6, "each of 3 parts"),
        ([f"12_30_{k // 5:02}_{k % 5 * 200:03}.png" for k in range(18)], 5, ""),
        ([f"f{k}{['.tif', '.TIFF'][k % 2]}" for k in range(9)], 10, None),
    ],
)
def test_pictures_come_in_the_order_of_their_names(tmp_path, names, rate, said):
    folder = write_pictures(tmp_path / "film", map(picture, range(len(names))), names=names)
    footage = open_footage(folder, frame_rate_hz=rate)
    assert numbers(read(footage)[1]) == list(range(len(names)))
    assert footage.notes == () if said is None else said in " ".join(footage.notes)


@pytest.mark.parametrize(
    "name_of",
    [
        "frame_{:04x}.png".format,
        "{:02X}.png".format,
        lambda k: f"20240503123001{123456 + 2000 * k}.png",  # more digits than a float has
    ],
)
def test_hexadecimal_and_long_numbers_are_numbers(tmp_path, name_of):
    there = [k for k in range(20) if k not in (11, 12)]
    folder = write_pictures(tmp_path / "film", map(picture, there), names=[*map(name_of, there)])
    times, frames = read(open_footage(folder, frame_rate_hz=10), loss := LostFrames())
    assert numbers(frames) == there and loss.gaps == 2
    np.testing.assert_allclose(times, np.array(there) / 10)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["face"], "a single frame"),
        ([f"{side}{k}" for side in ("left", "right") for k in range(9)], "several kinds: 9 .*, 9 "),
        ([f"cam{c}_{k}" for c in (1, 2) for k in range(9)], "several kinds: 9 .*, 9 "),
        ([f"f{k}_cam{c}" for k in range(9) for c in (1, 2)], "several kinds: 9 .*, 9 "),
        ([10, 11, 12, "a1b", "c1", "2d", "e", "f5g6"], "3 #.*5 with other"),
        ([*(f"f{k}" for k in range(7)), "f03"], r"f03.png and f3.png have the same number"),
    ],
)
def test_pictures_that_are_not_one_film_are_refused(tmp_path, names, said):
    named, shots = [f"{name}.png" for name in names], (picture(k % 9) for k in range(len(names)))
    folder = write_pictures(tmp_path / "film", shots, names=named)
    with pytest.raises(FinloopError, match=said):
        open_footage(folder, frame_rate_hz=10)


NAMES_WITH_TIMES = {  # of the time of a picture, in ms after a date
    "day_and_ms": lambda ms: f"2024-05-03_12-30-{1 + ms // 1000:02}.{ms % 1000:03}",
    "compact": lambda ms: f"cam2 20240503T1230{1 + ms // 1000:02}_{ms % 1000:03}",
    "iso": lambda ms: f"2024-05-03T12:30:{1 + ms // 1000:02}.{1000 * (ms % 1000)}Z",
    "not padded": lambda ms: f"frame 2024.05.03 12.30.{1 + ms // 1000:02}.{ms % 1000}",
    "ms since 1970": lambda ms: f"{1714735801000 + ms}",
    "ns since 1970": lambda ms: f"img_{1714735801000 + ms}000000_a",
    "s since 1970": lambda ms: f"{(1714735801000 + ms) / 1000:.3f}",
}


@pytest.mark.parametrize("name_of", NAMES_WITH_TIMES.values(), ids=NAMES_WITH_TIMES)
def test_times_in_names_are_those_of_the_frames(tmp_path, name_of):
    time_ms = 90 * np.arange(30) + np.where(np.arange(30) > 19, 1000, 0)
    names = [f"{name_of(int(ms))}.png" for ms in time_ms]
    shown = (picture(k)[..., 0] for k in range(30))
    folder = write_pictures(tmp_path / "film", shown, names=names)
    footage = open_footage(folder)
    assert float(footage.frame_rate) == pytest.approx(1 / 0.09, rel=0.01)
    times, frames = read(footage)
    np.testing.assert_allclose(times, time_ms / 1000, atol=1e-6)
    assert numbers(frames) == list(range(30))
    assert any("11.11 frames/s" in note for note in footage.notes)
    assert float(open_footage(folder, frame_rate_hz=5).frame_rate) == 5


@pytest.mark.parametrize("name", ["20240503_123001_{:03}", "2024-05-03 {}", "1234567890_{:04}"])
def test_a_counter_beside_a_date_is_no_time(tmp_path, name):
    names = [f"{name.format(k)}.png" for k in range(12)]
    folder = write_pictures(tmp_path / "film", map(picture, range(12)), names=names)
    with pytest.raises(FinloopError, match=r"how fast they were shot.*\n.*\n.*frame_rate_hz"):
        open_footage(folder)


def test_tags_of_tiffs_say_when_they_were_shot(tmp_path):
    pages = np.array([picture(k)[..., 0] for k in range(12)])
    ome = {"axes": "TYX", "Plane": {"DeltaT": [40.0 * k for k in range(12)],
                                    "DeltaTUnit": ["ms"] * 12}}  # fmt: skip
    tifffile.imwrite(tmp_path / "delta.ome.tif", pages, metadata=ome)
    ome = {"axes": "TYX", "TimeIncrement": 0.04, "TimeIncrementUnit": "s"}
    tifffile.imwrite(tmp_path / "step.ome.TIF", pages, metadata=ome)
    imagej = {"axes": "TYX", "finterval": 0.04}
    tifffile.imwrite(tmp_path / "imagej.tif", pages, imagej=True, metadata=imagej)
    both = np.stack([pages, pages], axis=1)
    tifffile.imwrite(tmp_path / "two.ome.tif", both, metadata={"axes": "TCYX"})
    tifffile.imwrite(tmp_path / "two.tif", both, imagej=True, metadata={"axes": "TCYX"})
    for name in ("two.ome.tif", "two.tif"):
        with pytest.raises(FinloopError, match="24 pages for 12 times"):
            open_footage(tmp_path / name, frame_rate_hz=25)
    folder = tmp_path / "folder"
    folder.mkdir()
    for k, page in enumerate(pages):
        day = f"2024:05:03 12:30:{k // 2:02}"
        tifffile.imwrite(folder / f"{k}.tif", page, datetime=f"{day}.{k % 2 * 5}"[:19])
    for name in ("delta.ome.tif", "step.ome.TIF", "imagej.tif"):
        footage = open_footage(tmp_path / name)
        assert float(footage.frame_rate) == pytest.approx(25), name
        np.testing.assert_allclose(read(footage)[0], np.arange(12) / 25, atol=1e-6)
    with pytest.raises(FinloopError, match="how fast"):
        open_footage(folder)  # two pictures have the same second
    for file in folder.iterdir():
        if int(file.stem) % 2:
            file.unlink()
    assert float(open_footage(folder).frame_rate) == 1


def test_exif_of_jpegs_says_when_they_were_shot(tmp_path):
    for k in range(12):  # four pictures a second, from the highest number to the lowest
        exif = Image.Exif()
        exif.get_ifd(ExifTags.IFD.Exif).update({
            ExifTags.Base.DateTimeOriginal: f"2024:05:03 12:30:{10 - k // 4:02}",
            ExifTags.Base.SubsecTimeOriginal: f"{75 - k % 4 * 25:02}",
        })  # fmt: skip
        Image.fromarray(picture(k)).save(tmp_path / f"{k}.jpg", exif=exif)
    footage = open_footage(tmp_path)
    assert float(footage.frame_rate) == pytest.approx(4)
    np.testing.assert_allclose(read(footage)[0], np.arange(12) / 4, atol=1e-6)


@pytest.mark.parametrize(
    ("ending", "said"), [(".npz", "archive of NumPy arrays"), (".mat", "MATLAB older than 7.3")]
)
def test_a_file_of_several_arrays_is_refused_by_its_kind(tmp_path, ending, said):
    path, film = tmp_path / f"film{ending}", np.zeros((3, 20, 20), np.uint8)
    if ending == ".npz":
        np.savez(path, film=film)
    else:
        savemat(path, {"film": film})
    with pytest.raises(FinloopError, match=said):
        open_footage(path, frame_rate_hz=25.0)


@pytest.mark.parametrize("order", ["grey", "one channel", "RGB", "RGB first"])
@pytest.mark.parametrize("ending", [".npy", ".NPY", ".h5", ".nwb-like", ".mat"])
def test_an_array_is_a_film(tmp_path, order, ending):
    pages = np.array([picture(k) for k in range(12)])
    stored = {
        "grey": pages[..., 0], "one channel": pages[..., :1], "RGB": pages,
        "RGB first": np.moveaxis(pages, -1, 1),
    }[order]  # fmt: skip
    path = tmp_path / f"käfer film{ending}"
    if ending.lower() == ".npy":
        with path.open("wb") as file:
            np.save(file, stored)
    else:
        h5py = pytest.importorskip("h5py")
        matlab = ending == ".mat"
        with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
            axes = (2, 3) if order == "RGB first" else (1, 2)  # it lists them the other way round
            file["a/film"] = stored.swapaxes(*axes) if matlab else stored
            if matlab:
                file["a/film"].attrs["MATLAB_class"] = np.bytes_("uint8")
            file["a/places"] = np.zeros((12, 2))
            file["times"] = np.arange(12.0)
            file["a"].attrs["Frame_Rate"] = 50.0
        assert open_footage(path).frame_rate == 50
    footage = open_footage(path, frame_rate_hz=10, colour=order.startswith("RGB"))
    frames = read(footage)[1]
    shown = pages if order.startswith("RGB") else pages[..., 0]
    np.testing.assert_array_equal(frames, shown)


@pytest.fixture(scope="module")
def carp_film():
    return np.array(carp_frames(40))  # two blocks of an array


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("ending", [".npy", ".h5", "RGB"])
def test_the_axis_of_an_array_s_frames_is_found_by_its_levels(tmp_path, carp_film, ending, axis):
    frames = carp_film
    if ending == "RGB":
        frames = np.stack([frames, frames // 2, frames], axis=-1)
    path, stored = tmp_path / f"film{ending.replace('RGB', '.npy')}", np.moveaxis(frames, 0, axis)
    if ending == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["film"] = stored
    else:
        np.save(path, stored)
    footage = open_footage(path, frame_rate_hz=10)
    np.testing.assert_array_equal(read(footage)[1], frames)
    assert "40 frames of 224×168 px" in footage.notes[0]


def plain_tank(size: float, grain: float, flicker: float) -> np.ndarray:
    """A film (60, 120, 160) of a dark animal on a plain tank, darker at the left."""
    rng, (y, x) = np.random.default_rng(0), np.mgrid[:120, :160]
    frames = []
    for k in range(60):
        place = 80 + 60 * np.cos(0.2 * k), 60 + 45 * np.sin(0.26 * k)
        picture = np.where(np.hypot(x - place[0], y - place[1]) < size, 60, 100 + 100 * x / 160)
        frames.append(picture * (1 + flicker * rng.normal()) + rng.normal(0, grain, x.shape))
    return np.clip(frames, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("size", "grain", "flicker"), [(45, 2, 0), (12, 5, 0.1), (12, 2, 0.3), (5, 1, 0.3)]
)
def test_frames_stay_the_first_axis_of_a_plain_tank(tmp_path, size, grain, flicker):
    """Of a large animal, and of light that flickers: columns of a plain tank are all alike."""
    np.save(path := tmp_path / "film.npy", plain_tank(size, grain, flicker))
    assert "60 frames of 160×120 px" in open_footage(path, frame_rate_hz=10).notes[0]


@pytest.mark.parametrize("axes", [(1, 2, 0), (1, 0, 2), (2, 1, 0)])
def test_frames_of_a_plain_tank_are_found_along_another_axis(tmp_path, axes):
    stored = plain_tank(12, 2, 0).transpose(axes)
    np.save(path := tmp_path / "film.npy", np.ascontiguousarray(stored))
    assert "is read as 60 frames" in open_footage(path, frame_rate_hz=10).notes[0]


class ReadLog:
    """An array, and the number of levels of each part that was read from it."""

    def __init__(self, array):
        self.array, self.sizes = array, []

    def __getattr__(self, name):
        return getattr(self.array, name)

    def __getitem__(self, key):
        part = self.array[key]
        self.sizes.append(part.size)
        return part


@pytest.mark.parametrize(
    ("chunks", "at_once"),
    [((20, 30, 1), 1), ((20, 30, 5), 5), ((4, 5, 60), 16), (None, 16), ((20, 30, 60), 16)],
)
def test_frames_of_a_hdf5_file_are_read_by_its_chunks_and_fit_in_memory(
    tmp_path, monkeypatch, chunks, at_once
):
    h5py = pytest.importorskip("h5py")
    monkeypatch.setattr(film_arrays, "_MOST_BYTES", 16 * 20 * 30)  # of 16 frames
    levels = np.random.default_rng(0).integers(0, 256, (20, 30, 60), np.uint8)
    with h5py.File(tmp_path / "film.h5", "w") as file:
        log = ReadLog(file.create_dataset("film", data=levels, chunks=chunks))
        film = film_arrays.FilmArray(tmp_path / "film.h5", log, frames_axis=2)
        frames = [film.load_frame(k) for k in range(60)]
    np.testing.assert_array_equal(frames, np.moveaxis(levels, 2, 0))
    assert max(log.sizes) == at_once * 20 * 30 and sum(log.sizes) == levels.size


def test_an_array_whose_axis_of_frames_is_unsure(tmp_path):
    noise = np.random.default_rng(0).integers(-3, 4, (40, 40, 40))
    np.save(path := tmp_path / "film.npy", noise)  # the first axis is as good as any
    assert open_footage(path, frame_rate_hz=10).frames_expected == 40
    np.save(path, (128 + np.arange(40)[:, None, None] * noise).astype(np.uint8))
    with pytest.raises(
        FinloopError, match=r"\(40, 40, 40\) in .*film.npy are the frames is unsure"
    ):
        open_footage(path, frame_rate_hz=10)


def test_an_array_that_is_no_film_is_refused_by_name(tmp_path):
    np.save(tmp_path / "table.npy", np.zeros((50, 4)))
    np.save(tmp_path / "film.npy", np.zeros((9, 20, 30), np.uint8))
    (tmp_path / "empty.npy").write_bytes(b"")
    (tmp_path / "film.seq").write_bytes(b"\xed\xfe\0\0" + "Norpix seq".encode("utf-16-le"))
    for name, said in {
        "table.npy": r"1 arrays: its array \(50, 4\) float64",
        "film.npy": r"9 pictures, which do not state how fast",
        "empty.npy": "cannot be read",
        "film.seq": r"Norpix(.|\n)*pims",
    }.items():
        with pytest.raises(FinloopError, match=said) as error:
            open_footage(tmp_path / name)
        assert "index" not in error.value.do


def test_a_hdf5_file_of_two_films_or_none_is_refused_by_their_names(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "two.hdf5", "w") as file:
        file["left"] = np.zeros((9, 20, 30), np.uint8)
        file["right"] = np.zeros((9, 20, 30), np.uint8)
    with h5py.File(tmp_path / "tracks.h5", "w") as file:
        file["tracks"] = np.zeros((9, 2, 3))
    (tmp_path / "cut.h5").write_bytes((tmp_path / "two.hdf5").read_bytes()[:3000])
    for name, said in {
        "two.hdf5": r"2 arrays: left \(9, 20, 30\) uint8, right",
        "tracks.h5": r"1 arrays: tracks \(9, 2, 3\)",
        "cut.h5": "cannot be read",
    }.items():
        with pytest.raises(FinloopError, match=said) as error:
            open_footage(tmp_path / name, frame_rate_hz=10)
        assert "index" not in error.value.do


@pytest.mark.parametrize(
    ("source", "colour"),
    [(".mkv", False), (".mkv", True), (".png", False), (".png", True), (".tif", False), (".tif", True),
     ("uint16 pages", False), ("float32 pages", False)],
)  # fmt: skip
def test_levels_of_sixteen_bits_are_stretched(tmp_path, source, colour):
    grey = np.linspace(500, 4500, WIDTH * HEIGHT).astype(np.uint16).reshape(HEIGHT, WIDTH)
    levels = np.dstack([grey, grey[::-1], grey]) if colour else grey
    if source == ".mkv":
        kind, coded = ("rgb48le", "gbrp16le") if colour else ("gray16le", "gray16le")
        path = make_film(tmp_path / "a.mkv", [levels] * 3, codec="ffv1", pix_fmt=coded, source=kind)
    elif source.endswith("pages"):
        path = tmp_path / "stack.tif"
        pages = np.array([levels] * 3, source.split()[0])
        tifffile.imwrite(path, pages, photometric="minisblack", compression="deflate")
    else:
        path = write_pictures(tmp_path / "film", [levels] * 3, source)
    footage = open_footage(path, frame_rate_hz=10)
    assert footage.colour == colour
    assert footage.levels == pytest.approx((500, 4500), abs=3)
    np.testing.assert_allclose(read(footage)[1][0], (levels - 500.0) * 255 / 4000, atol=0.8)


@pytest.mark.parametrize("scale", [1 / 255, 1 / 2550])
def test_fractions_are_stretched_to_their_levels(tmp_path, scale):
    frames = np.array([picture(k)[..., 0] for k in range(3)])
    np.save(path := tmp_path / "film.npy", frames * scale)
    shown = read(footage := open_footage(path, frame_rate_hz=10))[1]
    wanted = (frames - 40.0) * 255 / 215
    np.testing.assert_allclose(shown, wanted, atol=0.6)
    assert f"3 frames of {WIDTH}×{HEIGHT}" in footage.notes[0]


@pytest.mark.parametrize("ending", [".npy", ".tif"])
def test_a_picture_with_nan_is_refused(tmp_path, ending):  # else the whole film would be black
    frames = np.random.default_rng(0).random((5, 20, 30), np.float32)
    frames[2, 4, 4] = np.nan
    path = tmp_path / f"film{ending}"
    (np.save if ending == ".npy" else tifffile.imwrite)(path, frames)
    with pytest.raises(FinloopError, match=r"film.*3, holds NaN"):
        read(open_footage(path, frame_rate_hz=10))


def test_masks_are_black_and_white(tmp_path):
    masks = np.array([picture(k)[..., 0] > 100 for k in range(3)])
    np.save(path := tmp_path / "film.npy", masks)
    np.testing.assert_array_equal(read(open_footage(path, frame_rate_hz=10))[1], masks * 255)


def test_webp_that_moves_is_refused_by_name(tmp_path):
    pictures = [Image.fromarray(picture(k)) for k in range(3)]
    path = tmp_path / "film.webp"
    pictures[0].save(path, save_all=True, append_images=pictures[1:])
    with pytest.raises(FinloopError, match="WebP that moves"):
        open_footage(path)


@pytest.mark.parametrize("bits", [12, 16])
def test_yuv_of_sixteen_bits_is_stretched_only_if_it_does_not_fill_them(tmp_path, bits):
    grey = np.linspace(0.1, 0.9, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)
    levels = (np.dstack([grey, grey[::-1], grey]) * 2**bits).astype(np.uint16)
    path = make_film(
        tmp_path / "a.mkv", [levels] * 3, codec="ffv1", pix_fmt="yuv444p16le", source="rgb48le"
    )
    footage = open_footage(path)
    low, high = (0.1, 0.9) if bits == 12 else (0.0, 1.0)
    assert footage.colour and (footage.levels is not None) == (bits == 12)
    wanted = np.clip((levels / 2**bits - low) / (high - low), 0, 1) * 255
    np.testing.assert_allclose(read(footage)[1][0], wanted, atol=4)


@pytest.mark.parametrize("colour", [False, True])
def test_a_stack_of_pages_is_as_it_was_and_of_one_shape(tmp_path, colour):
    path = tmp_path / "stack.tif"
    shape = (11, 20, 30, 3) if colour else (11, 20, 30)
    pages = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    kind = "rgb" if colour else "minisblack"
    tifffile.imwrite(path, pages, photometric=kind, compression="deflate")
    np.testing.assert_array_equal(read(open_footage(path, frame_rate_hz=10))[1], pages)
    with tifffile.TiffWriter(path) as stack:
        for one in (pages[0], pages[1], pages[2, :10]):
            stack.write(one, photometric=kind, contiguous=False)
    with pytest.raises(FinloopError, match="page 3, is 30×10 pixels"):
        read(open_footage(path, frame_rate_hz=10))


# --- bad input: one clear message each


def write_sound(path: Path, cover: bool) -> Path:
    """Sound, perhaps with a cover: a picture, but no film."""
    codec, kind, rate = ("aac", "fltp", 2048) if cover else ("pcm_s16le", "s16", 800)
    with av.open(str(path), "w") as container:
        sound = container.add_stream(codec, rate=8000, layout="mono")
        silence = np.zeros((1, rate), np.float32 if cover else np.int16)
        frame = av.AudioFrame.from_ndarray(silence, format=kind, layout="mono")
        frame.rate = 8000
        if cover:
            stream = add_stream(container, "mjpeg", WIDTH, HEIGHT, "yuvj420p")
            stream.disposition = Disposition.attached_pic
            mux_pictures(container, 1, stream)
        container.mux(sound.encode(frame))
        container.mux(sound.encode(None))
    return path


def make_bad(what: str, folder: Path) -> Path:
    """Make something that is no film; return its path."""
    film, stack = folder / "film.mp4", folder / "stack.tif"
    match what:
        case "empty":
            film.touch()
        case "text":
            film.write_text("This is no film.\n" * 100)
        case "archive":
            film.write_bytes(b"PK\3\4" + bytes(100))
        case "noise":
            film.write_bytes(bytes(range(255, 0, -1)))
        case "sound":
            return write_sound(folder / "sound.wav", cover=False)
        case "sound with a cover":
            return write_sound(folder / "song.mp4", cover=True)
        case "without index":
            make_film(film, map(picture, range(20)), codec="libx264")
            film.write_bytes(film.read_bytes()[:-1000])
        case "single frame":
            return make_film(folder / "film.avi", [picture(0)])
        case "empty folder":
            return write_pictures(folder / "film", [])
        case "one picture":
            return write_pictures(folder / "film", [picture(0)])
        case "one picture's file":
            return write_pictures(folder / "film", [picture(0)]) / "img0.png"
        case "several kinds":
            made = write_pictures(folder / "film", [picture(0)] * 3)
            for k in range(3):
                (made / f"mask{k}.bmp").touch()
            return made
        case "compressed stack":
            cv2.imwritemulti(str(stack), [picture(k)[..., 0] for k in range(3)])
            return stack
        case "text as stack":
            stack.write_text("This is no film.\n" * 100)
            return stack
    return film


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("nothing", "there is nothing at"),
        ("empty", "is empty: 0 bytes"),
        ("text", "is text, not a film: it begins with 'This is no film"),
        ("archive", "is an archive, not a film"),
        ("noise", "cannot be read as a film: Invalid data"),
        ("sound", "holds no pictures, only audio"),
        ("sound with a cover", "holds no pictures, only audio"),
        ("without index", "holds nothing that can be decoded"),
        ("single frame", "a single frame"),
        ("empty folder", "holds no pictures"),
        ("one picture", "a single frame"),
        ("one picture's file", "a single frame"),
        ("compressed stack", "page 1, cannot be read: .*LZW"),
        ("text as stack", "cannot be read as a TIFF"),
        ("several kinds", "several kinds: 3 img#.png, 3 mask#.bmp"),
    ],
)
def test_bad_input_is_said(tmp_path, what, said):
    path = make_bad(what, tmp_path)
    with pytest.raises(FinloopError, match=said) as caught:
        open_footage(path, frame_rate_hz=25.0)
    assert str(path.name) in str(caught.value)


@pytest.mark.parametrize(
    ("start_s", "end_s", "said"),
    [
        (2.0, None, "is 2.000 s long, and 2 s to the end"),
        (1.0, 1.0, "1 s to 1 s was requested"),
        (1.0, 0.5, "1 s to 0.5 s was requested"),
        (0.0, 3.0, "0 s to 3 s was requested"),
        (1.0, 1.02, r"shows 1 frame\(s\) from"),
    ],
)
def test_a_range_that_is_not_there_is_said(avi, start_s, end_s, said):
    with pytest.raises(FinloopError, match=said):
        open_footage(avi, start_s=start_s, end_s=end_s)


def test_a_film_that_must_not_be_read_is_not_called_text(avi, monkeypatch):
    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(av, "open", refuse)
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FinloopError, match="cannot be read as a film: Permission denied"):
        open_footage(avi)


def make_damaged_film(folder: Path, *damaged: int) -> Path:
    """Write 20 frames that are all key frames, with zeros in place of some of them."""
    path = make_film(folder / "a.mov", map(picture, range(20)), codec="mjpeg", pix_fmt="yuvj420p")
    data = bytearray(path.read_bytes())
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
        for k in damaged:
            data[packets[k].pos : packets[k].pos + packets[k].size] = bytes(packets[k].size)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("damaged", [0, 7, 19])
def test_a_deinterlaced_film_keeps_the_numbers_of_its_frames(tmp_path, damaged):
    path, loss = make_damaged_film(tmp_path, damaged), LostFrames()
    footage = open_footage(path, frame_rate_hz=25.0, colour=False)  # time: number / 25
    stamped = replace(footage, fields="tff").stream_numbered(loss)
    found = [(round(time_s * 25), number) for time_s, (number, _) in stamped]
    assert found == [(number, number) for number in range(20) if number != damaged]
    assert loss == LostFrames(damaged=1)


def test_a_damaged_frame_is_left_out(tmp_path):
    """Zeros over one frame of a film; its neighbour is shown instead."""
    loss, timing = LostFrames(), FrameCounts()
    footage = open_footage(make_damaged_film(tmp_path, 7), colour=False)
    shown = shown_at(footage, 25, loss, timing)
    assert loss == LostFrames(damaged=1)
    assert [number for number in shown if number != 7] == shown
    assert (timing.frames, timing.repeated) == (20, 1)
    assert "1 frames of the film are damaged" in loss.notes[0]


def test_frames_that_change_their_size_are_said(tmp_path):
    """Two streams of JPEGs muxed as one."""
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream = add_stream(container, "mjpeg", WIDTH, HEIGHT, "yuvj420p")
        for number in range(20):
            coder = av.CodecContext.create("mjpeg", "w")
            coder.width, coder.height = (32, 32) if number >= 15 else (WIDTH, HEIGHT)
            coder.pix_fmt, coder.time_base = "yuvj420p", Fraction(1, 25)
            one = picture(number, coder.width, coder.height)
            frame = av.VideoFrame.from_ndarray(one, format="rgb24").reformat(format="yuvj420p")
            frame.pts, frame.time_base = 0, Fraction(1, 25)
            for packet in [*coder.encode(frame), *coder.encode(None)]:
                packet.pts = packet.dts = number
                packet.time_base, packet.stream = Fraction(1, 25), stream
                container.mux(packet)
    with pytest.raises(FinloopError, match=r"at 0\.600 s is 32×32 pixels, those before it 64×48"):
        read(open_footage(path, colour=False))


def test_pictures_that_change_are_said(tmp_path):
    pictures = [picture(k) for k in range(4)]
    for last, said in (
        (picture(4, 32, 32), r"img4\.png is 32×32 pixels"),
        (picture(4).astype(np.uint16), r"img4\.png has uint16 levels"),
    ):
        folder = write_pictures(tmp_path / str(last.dtype), [*pictures, last])
        with pytest.raises(FinloopError, match=said):
            read(open_footage(folder, frame_rate_hz=10))
    (folder / "img4.png").write_bytes(b"no picture")
    with pytest.raises(FinloopError, match=r"img4\.png cannot be read"):
        open_footage(folder, frame_rate_hz=10)


# --- the wheel


def wheel_bytes(**clips: bytes) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for part, content in clips.items():
            archive.writestr(f"idtrackerai/data/test_{part}.avi", content)
    return data.getvalue()


class Index:
    """A package index without a network: answers the package client's command."""

    def __init__(self, content: bytes | None) -> None:
        self.content, self.asked = content, 0

    def __call__(self, command, **_) -> subprocess.CompletedProcess:
        self.asked += 1
        assert command[:4] == [sys.executable, "-m", "pip", "download"]
        assert {"--no-deps", wheel.PACKAGE} <= set(command)
        if self.content is None:
            said = "WARNING: Retrying\nERROR: Could not find a version that satisfies it\nERROR: no"
            return subprocess.CompletedProcess(command, 1, "", said)
        (Path(command[command.index("--dest") + 1]) / "package.whl").write_bytes(self.content)
        return subprocess.CompletedProcess(command, 0, "", "")


@pytest.fixture
def index(monkeypatch) -> Index:
    clips = {"A": b"film A", "B": b"film B"}
    made = Index(wheel_bytes(**clips))
    digests = {part: hashlib.sha256(content).hexdigest() for part, content in clips.items()}
    monkeypatch.setattr(wheel, "SHA256", digests)
    monkeypatch.setattr(subprocess, "run", made)
    return made


def test_the_footage_is_fetched_once_and_again_if_it_is_corrupt(tmp_path, index):
    def fetch() -> list[bytes]:
        return [path.read_bytes() for path in wheel.fetch_zebrafish_clips("AB", tmp_path / "cache")]

    assert fetch() == fetch() == [b"film A", b"film B"]
    assert index.asked == 1
    first, _ = (tmp_path / "cache").iterdir()
    first.write_bytes(b"film")
    assert fetch() == [b"film A", b"film B"]
    assert index.asked == 2


def test_without_a_network_the_carp_is_offered(tmp_path, index):
    index.content = None
    with pytest.raises(FinloopError, match=r"dvc exp run -S clip=carp") as caught:
        wheel.fetch_zebrafish_clips("A", tmp_path)
    assert "Could not find a version" in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "content", [b"no wheel", wheel_bytes(B=b"film B"), wheel_bytes(A=b"another film")]
)
def test_an_unknown_wheel_is_refused(tmp_path, index, content):
    index.content = content
    with pytest.raises(FinloopError, match="is not the known footage"):
        wheel.fetch_zebrafish_clips("A", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_cache_that_cannot_be_written_is_said(tmp_path, index):
    (tmp_path / "cache").write_text("a file in the way")
    with pytest.raises(FinloopError, match="cannot be kept"):
        wheel.fetch_zebrafish_clips("A", tmp_path / "cache")


def test_the_cache_lies_outside_the_project(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert wheel.find_cache_folder() == tmp_path / "finloop"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, by the specification
    monkeypatch.setenv("HOME", str(tmp_path))
    assert wheel.find_cache_folder() == tmp_path / ".cache/finloop"


# --- the stage


def parameters(source: str, **changes):
    values = yaml.safe_load((ROOT / f"conf/clip/{source}.yaml").read_text())
    values = {key: value for key, value in values.items() if key != "defaults"}
    return check_values("clip", variants("clip"), values | changes)


@pytest.fixture
def run_stage(tmp_path, monkeypatch):
    """Run the stage in an empty folder; gives its numbers."""
    monkeypatch.chdir(tmp_path)

    def run(source: str, **changes) -> dict[str, float]:
        given, problems = parameters(source, **changes)
        assert not problems
        monkeypatch.setattr(stage, "load_settings", lambda *_: given)
        stage.main()
        return load_numbers(stage.METRICS.parent)

    return run


def artifact(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.exists() else set()


def test_own_film_runs_through(run_stage, avi, capsys):
    metrics = run_stage(
        "file", path=str(avi), start_s=0.4, correct_light="never", arena=(30, 20, 15)
    )
    facts = load_facts(stage.CLIP / "facts.json")
    tables, pictures = (
        {"frames.parquet", "check.parquet", "findings.csv"},
        {"arena.png", "tank.png"},
    )
    assert artifact(stage.CLIP) == {"clip.mp4", "facts.json"} | tables | pictures
    shown = load_table(stage.CLIP / "frames.parquet", FRAMES)
    assert shown["source_frame"].tolist() == list(range(10, 50))
    assert facts.source_frames == 50
    assert (facts.source, facts.frames, facts.frame_rate) == ("file", 40, 25)
    assert (facts.segments, facts.colour, facts.crf) == (((0, 40),), False, 0)
    assert numbers(read_frames(stage.CLIP / "clip.mp4")) == list(range(10, 50))
    arena = load_mask(stage.CLIP / "arena.png", WIDTH, HEIGHT)
    np.testing.assert_array_equal(arena, circle_arena(WIDTH, HEIGHT, 30, 20, 15))
    assert metrics["frames"] == 40
    assert metrics["duration_s"] == 1.6
    assert metrics["frames_repeated"] == metrics["frames_dropped"] == metrics["frames_missing"] == 0
    assert metrics["arena_fraction"] == pytest.approx(arena.mean(), rel=5e-4)
    assert "coding_psnr_db" not in metrics  # lossless: infinite
    assert "note" not in capsys.readouterr().err


def test_a_lossy_clip_tells_its_quality(run_stage, avi):
    metrics = run_stage("file", path=str(avi), crf=30)
    assert 30 < metrics["coding_psnr_db"] < 60


def test_mask_arena_and_odd_colour(run_stage, tmp_path):
    pictures = [one[:47, :63] for one in goldfish(5)]
    folder = write_pictures(tmp_path / "film", pictures)
    mask = np.zeros((47, 63), np.uint8)
    mask[5:, 9:] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    metrics = run_stage(
        "file", path=str(folder), frame_rate_hz=12.5, correct_light="never",
        arena=str(tmp_path / "mask.png"),
    )  # fmt: skip
    assert (metrics["frame_rate_hz"], metrics["width_px"]) == (12.5, 63)
    back = next(read_frames(stage.CLIP / "clip.mp4", colour=True))
    assert np.abs(back.astype(int) - pictures[0]).max() <= 3
    np.testing.assert_array_equal(load_mask(stage.CLIP / "arena.png", 63, 47), mask > 0)
    with pytest.raises(FinloopError, match="is 63×47 pixels"):
        run_stage("file", path=str(make_film(tmp_path / "a.avi", map(picture, range(5)))),
                  arena=str(tmp_path / "mask.png"))  # fmt: skip


def test_drawn_carp_with_truth(run_stage):
    size = {"frames": 6, "width_px": 320, "height_px": 240, "body_length_px": 60.0}
    metrics = run_stage("carp", crf=0, colour=False, **size)
    facts = load_facts(stage.CLIP / "facts.json")
    truth = load_table(stage.CLIP / "truth.parquet", TRUTH)
    assert (facts.source, facts.frames, facts.colour) == ("carp", 6, False)
    assert metrics["frames"] == len(truth) == 6
    drawn = list(carp.film_frames(settings("clip", source="carp", colour=False, **size)))
    back = list(read_frames(stage.CLIP / "clip.mp4"))
    np.testing.assert_array_equal(back, [frame for frame, _ in drawn])
    rows = pd.DataFrame([row for _, rows in drawn for row in rows])
    np.testing.assert_allclose(truth["x_px"], rows["x_px"])


def test_the_truth_of_two_carp_is_sorted_by_frame(run_stage, monkeypatch):
    """It is written by a few rows at a time."""
    monkeypatch.setattr("finloop.clip.write._ROWS", 3)
    run_stage("carp", frames=5, fish=2, width_px=400, height_px=240, body_length_px=60.0)
    truth = load_table(stage.CLIP / "truth.parquet", TRUTH)
    assert truth["fish_id"].tolist() == [0, 1] * 5
    assert truth["frame"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_too_many_carp_are_refused(run_stage):
    with pytest.raises(FinloopError, match=r"40 carp .* have no room"):
        run_stage("carp", fish=40)
    assert not artifact(stage.CLIP)


def test_zebrafish_follow_one_another(run_stage, tmp_path, monkeypatch, avi):
    other = make_film(tmp_path / "b.avi", map(picture, range(5)))
    clips = {"A": avi, "B": other}
    monkeypatch.setattr(
        "finloop.clip.write.fetch_zebrafish_clips", lambda parts, _: [clips[part] for part in parts]
    )
    metrics = run_stage("zebrafish", parts="AB")
    facts = load_facts(stage.CLIP / "facts.json")
    assert facts.segments == ((0, 50), (50, 55))
    assert metrics["segments"] == 2
    assert numbers(read_frames(stage.CLIP / "clip.mp4")) == [*range(50), *range(5)]


def test_a_film_that_breaks_off_is_used_up_to_there_and_what_is_missing_is_said_and_counted(
    run_stage, broken_off, capsys
):
    metrics = run_stage("file", path=str(broken_off))
    assert 10 < metrics["frames"] < 45
    assert metrics["frames_missing"] + metrics["frames"] == 50
    assert "WARNING: the film breaks off" in capsys.readouterr().err
    assert "breaks off" in load_facts(stage.CLIP / "facts.json").notes[-1]


@pytest.mark.parametrize(("ending", "codec"), [(".mkv", "mjpeg"), (".ts", "libx264")])
def test_a_film_that_was_cut_off_lacks_frames_and_the_report_says_so(
    run_stage, tmp_path, ending, codec
):
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    path = make_film(tmp_path / f"film{ending}", goldfish(30), codec=codec, pix_fmt=pix_fmt)
    assert run_stage("file", path=str(path))["frames_missing"] == 0
    findings = pd.read_csv(stage.CLIP / "findings.csv").set_index("what")
    assert findings.loc["missing", "verdict"] == "good"
    path.write_bytes(path.read_bytes()[:-1000])
    metrics = run_stage("file", path=str(path))
    assert 1 <= metrics["frames_missing"] <= 30 - metrics["frames"]
    findings = pd.read_csv(stage.CLIP / "findings.csv").set_index("what")
    assert "missing or damaged" in findings.loc["missing", "measured"]


def losses(path: Path, rate: float | None = None) -> tuple[int, int, tuple[str, ...]]:
    """How many frames of a film are read, how many are lost, and its notes."""
    footage, lost = open_footage(path, frame_rate_hz=rate), LostFrames()
    return len(list(footage.stream_numbered(lost))), lost.lost_frames, footage.notes


@pytest.mark.parametrize(
    ("ending", "codec"), [(".mpg", "mpeg2video"), (".mjpeg", "mjpeg"), (".ts", "mpeg2video")]
)
def test_wherever_a_film_is_cut_off_frames_are_lost_and_no_more_than_lack(tmp_path, ending, codec):
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    path = make_film(tmp_path / f"film{ending}", goldfish(20), codec=codec, pix_fmt=pix_fmt)
    whole, rate = path.read_bytes(), 25.0 if ending == ".mjpeg" else None
    assert losses(path, rate)[:2] == (20, 0)
    for share in (0.5, 0.55, 0.62, 0.68):  # later, an .mpg of few frames only has padding
        path.write_bytes(whole[: int(share * len(whole))])
        count, lost, _ = losses(path, rate)
        assert 1 <= lost <= 20 - count


def test_a_transport_stream_may_begin_anywhere(tmp_path):
    path = make_film(tmp_path / "film.ts", goldfish(30), codec="mpeg2video", gop=10)
    whole = path.read_bytes()
    path.write_bytes(whole[100:])  # within the table of contents
    assert losses(path)[:2] == (30, 0)
    path.write_bytes(whole[len(whole) // 5 :])  # behind the first key frame
    count, lost, notes = losses(path)
    assert count == 20 and lost == 0
    assert re.search(r"first \d frames cannot be decoded, as no key frame", notes[0])


@pytest.mark.parametrize("rate", [25, 1000, 2000, 4000])
def test_a_whole_film_lacks_no_frames_at_any_rate(tmp_path, rate):  # Matroska counts in ms
    path = make_film(tmp_path / "film.mkv", map(picture, range(30)), rate=rate)
    assert open_footage(path).frames_in_source == 30


@pytest.mark.parametrize("level", [0, 255])
def test_an_even_film_is_refused(run_stage, tmp_path, level):
    even = np.full((HEIGHT, WIDTH, 3), level, np.uint8)
    path = make_film(tmp_path / "film.avi", [even] * 5)
    with pytest.raises(FinloopError, match=f"all 5 frames show an even grey of {level}"):
        run_stage("file", path=str(path))
    assert not artifact(Path("data"))


def test_a_film_of_broken_frames_is_refused(run_stage, tmp_path):
    path = make_damaged_film(tmp_path, *range(1, 20))
    with pytest.raises(FinloopError, match=r"only 1 frame\(s\) could be decoded"):
        run_stage("file", path=str(path))
    assert not artifact(Path("data"))


def test_a_full_disk_leaves_the_last_clip(run_stage, avi, monkeypatch):
    run_stage("file", path=str(avi))
    before = (stage.CLIP / "clip.mp4").read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("finloop.clip.write.save_mask", full)
    with pytest.raises(FinloopError, match="disk is full"):
        run_stage("file", path=str(avi), end_s=1.0)
    assert (stage.CLIP / "clip.mp4").read_bytes() == before
    assert artifact(Path("data")) == {"clip"}


# --- parameters


@pytest.mark.parametrize(
    ("source", "changes", "said"),
    [
        ("zebrafish", {"parts": "C"}, "clip.parts: should be 'A', 'B' or 'AB'"),
        ("file", {"path": " "}, "path is empty"),
        ("file", {"path": "a", "start_s": 2, "end_s": 1}, "end_s 1 is not after start_s 2"),
        ("file", {"path": "a", "arena": [3, 4]}, "[x, y, radius] or [left, top, width, height]"),
        ("file", {"path": "a", "arena": [3, 4, 0]}, "radius, width and height above 0, got [3.0"),
        ("file", {"path": "a", "arena": []}, "got []"),
        ("file", {"path": "a", "arena": [3, 4, math.inf]}, "should be a finite number"),
        ("file", {"path": "a", "arena_x_px": 3}, "clip.arena_x_px: unknown; it is clip.arena now"),
        ("file", {"path": "a", "colour": "red"}, "should be 'auto', 'always' or 'never'"),
    ],
)
def test_bad_parameters_are_refused_by_name(source, changes, said):
    given, problems = parameters(source, **changes)
    assert given is None
    assert said in "\n".join(problems)
