"""What is wrong with a film is mended, and what is not is left to the byte."""

from collections.abc import Sequence
from contextlib import nullcontext
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from scratch import carp_frames, write_frames

from finloop.base.settings import settings
from finloop.clip.check import Quality
from finloop.clip.rewrite import ClipResult, Watch, choose_repairs, is_better, make_clip
from finloop.clip.shake import Shift, undo_shift
from finloop.clip.verdict import list_findings
from finloop.clip.write import open_clip_source, write_clip
from finloop.io.movie import VideoWriter
from finloop.io.table import load_table
from finloop.io.video import ARENA_NAME, CLIP_NAME, FRAMES, FRAMES_NAME, load_mask, read_frames

RNG = np.random.default_rng(3)
REPAIRS = "deinterlace", "drop_repeated_frames", "correct_light", "stabilize"
Frames = Sequence[np.ndarray]


@pytest.fixture(scope="module")
def carp() -> Frames:
    return carp_frames(30)


def clip_of(
    folder: Path, frames: Frames, rate: int = 25,
    show_progress: Watch = lambda *_: nullcontext(lambda: None), **values,
) -> tuple[ClipResult, list[np.ndarray]]:  # fmt: skip
    """What becomes of a film of these frames."""
    shot, home = folder / "film.mp4", folder / "clip"
    height, width = frames[0].shape[:2]
    write_frames(VideoWriter(shot, width, height, Fraction(rate), frames[0].ndim == 3), frames)
    home.mkdir(exist_ok=True)
    p = settings("clip", source="file", path=str(shot), **values)
    one = make_clip(p, open_clip_source(p), home, show_progress)
    return one, [x.copy() for x in read_frames(home / CLIP_NAME, colour=frames[0].ndim == 3)]


def off(a: Frames, b: Frames) -> float:
    """Mean difference of two films, grey levels."""
    return float(np.mean([cv2.absdiff(x, y).mean() for x, y in zip(a, b, strict=True)]))


def test_a_film_in_which_nothing_is_wrong_is_the_same_to_the_byte(tmp_path, carp):
    one, _ = clip_of(tmp_path, carp)
    clip = (tmp_path / "clip" / CLIP_NAME).read_bytes()
    clip_of(tmp_path, carp, **dict.fromkeys(REPAIRS, "never"))
    assert (tmp_path / "clip" / CLIP_NAME).read_bytes() == clip
    assert one.mended == frozenset() and one.arena.all()
    assert one.metrics["mended_steady"] == 0


def test_flicker_is_taken_out_of_every_channel(tmp_path):
    grey = carp_frames(20)
    tank = [np.dstack([frame, frame * 0.9, frame * 0.7]).astype(np.uint8) for frame in grey]
    lamp = RNG.uniform(0.9, 1.1, (20, 1)) * RNG.uniform(0.97, 1.03, (20, 3))
    shot = [np.clip(f * g, 0, 255).astype(np.uint8) for f, g in zip(tank, lamp, strict=True)]
    one, clip = clip_of(tmp_path, shot)
    assert one.mended == {"even_light"}
    assert one.filmed.light_flicker_pct > 4 > 0.3 > one.quality.light_flicker_pct
    means = np.array([frame.mean(axis=(0, 1)) for frame in clip])
    assert (means.std(axis=0) / means.mean(axis=0)).max() < 0.006
    kept, _ = clip_of(tmp_path, shot, correct_light="never")
    assert kept.mended == frozenset() and kept.quality == kept.filmed


def test_a_shaking_camera_is_steadied_and_the_border_is_no_arena(tmp_path, carp):
    jitter = RNG.uniform(-2, 2, (30, 2))
    shot = [undo_shift(f, Shift(x, y, 0)) for f, (x, y) in zip(carp, jitter, strict=True)]
    one, clip = clip_of(tmp_path, shot)
    assert one.mended == {"steady"}
    assert one.filmed.shake_px == pytest.approx(np.mean(jitter**2 * 2) ** 0.5, rel=0.15)
    assert one.quality.shake_px < 0.06
    still, shaken, calm = (np.median(np.std(one, axis=0)[8:-8, 8:-8]) for one in (carp, shot, clip))
    assert calm < 1.02 * still < 1.1 * still < shaken  # as a pixel of the tank changes over time
    assert not one.arena[0].any() and not one.arena[:, -1].any() and one.arena[8:-8, 8:-8].all()
    np.testing.assert_array_equal(load_mask(tmp_path / "clip" / ARENA_NAME, 224, 168), one.arena)


def test_pictures_shown_twice_are_shown_once_at_their_time(tmp_path, carp):
    shot = [carp[k * 2 // 3] for k in range(45)]  # 20 pictures/s as 30
    one, clip = clip_of(tmp_path, shot, rate=30)
    assert one.mended == {"undouble"} and one.facts.frame_rate == 20
    assert len(clip) == 30 and off(clip, carp) == 0
    frames = load_table(tmp_path / "clip" / FRAMES_NAME, FRAMES)["source_frame"].to_numpy()
    assert [k * 2 // 3 for k in frames] == list(range(30))  # each shows its own frame of the film


def test_a_long_film_with_doubled_pictures_is_written_once(tmp_path, carp):
    film = [*carp, *carp[-2:0:-1]] * 2
    shot = [film[k * 4 // 5] for k in range(140)]  # more frames than a sample has
    words = []

    def watch(word, frames):
        words.append((word, frames))
        return nullcontext(lambda: None)

    one, clip = clip_of(tmp_path, shot, rate=30, show_progress=watch)
    assert one.mended == {"undouble"} and one.facts.frame_rate == 24
    assert off(clip, film[:112]) == 0
    assert words == [("check", 140), ("clip", 112)]
    assert one.filmed.doubled_pct == pytest.approx(20, abs=1) and one.quality.doubled_pct == 0


@pytest.mark.parametrize("upper", [True, False])
def test_woven_fields_become_whole_pictures(tmp_path, upper):
    quick = carp_frames(32, frame_rate_hz=50.0)
    woven, early = [], quick[0::2]
    for a, b in zip(early, quick[1::2], strict=True):
        both = b.copy()
        both[0 if upper else 1 :: 2] = a[0 if upper else 1 :: 2]
        woven.append(both)
    one, clip = clip_of(tmp_path, woven)
    assert one.mended == {"deinterlace"}
    assert (one.filmed.field_order > 0) == upper
    assert abs(one.quality.field_order) < 0.1
    assert len(clip) == 16
    # The rows of the earlier field stay; where the carp is, the others come nearer to its moment.
    moved = [cv2.absdiff(a, w) > 40 for a, w in zip(early, woven, strict=True)]
    errors = [
        np.mean([cv2.absdiff(a, x)[m].mean() for a, x, m in zip(early, of, moved, strict=True)])
        for of in (clip, woven)
    ]
    assert errors[0] < 0.6 * errors[1]


def test_sixteen_bits_are_mended_as_eight(tmp_path, carp):
    folder = tmp_path / "film"
    folder.mkdir()
    lamp = RNG.uniform(0.9, 1.1, 20)
    for k in range(20):
        deep = np.clip(carp[k].astype(np.float64) * lamp[k] * 90, 0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / f"{k}.png"), deep)
    p = settings("clip", source="file", path=str(folder), frame_rate_hz=25.0)
    (tmp_path / "clip").mkdir()
    one = make_clip(p, open_clip_source(p), tmp_path / "clip")
    assert one.mended == {"even_light"} and one.quality.light_flicker_pct < 0.4


# --- what is mended


def parameters(**values):
    return settings("clip", source="file", path="film.mp4", **values)


def quality(**values) -> Quality:
    good = dict.fromkeys(Quality.__dataclass_fields__, 0.0) | {"doubled_rate": 1.0}
    return Quality(**good | {"contrast_grey": 80.0, "noise_grey": 1.0} | values)


def test_what_cannot_be_mended_is_left():
    far = quality(shake_px=9.0, shake_most_px=30.0)
    assert choose_repairs(parameters(), far, 480) == set()
    assert choose_repairs(parameters(), quality(shake_px=2.0, shake_most_px=4.0), 480) == {"steady"}
    turned = quality(shake_px=2.0, shake_most_px=4.0, shake_apart_px=1.5)
    assert choose_repairs(parameters(), turned, 480) == set()
    assert choose_repairs(parameters(stabilize="always"), far, 480) == {"steady"}
    unknown = quality(shake_px=np.nan, shake_most_px=np.nan, shake_apart_px=np.nan)
    assert choose_repairs(parameters(stabilize="always"), unknown, 480) == set()
    stutter = quality(doubled_pct=40.0, doubled_rate=np.nan)
    assert choose_repairs(parameters(drop_repeated_frames="always"), stutter, 480) == set()


def test_findings_say_what_was_and_what_is():
    filmed, now = quality(light_flicker_pct=5.0), quality(light_flicker_pct=0.1)
    words = {one.word: one for one in list_findings(now, filmed, {"even_light"})}
    assert words["flicker"].good and "5" in words["flicker"].text
    assert words["drift"] == {one.word: one for one in list_findings(now)}["drift"]


def worm_frames(count: int) -> list[np.ndarray]:
    """A bright worm that moves over a black floor, brighter in some frames than in others."""
    frames = []
    for k in range(count):
        frame = np.full((120, 160), 3, np.uint8)
        centre = 80 + 40 * np.cos(k / 9), 60 + 30 * np.sin(k / 9)
        cv2.ellipse(frame, (centre, (44, 9), 10.0 * k), 90 + 40 * (k % 7 == 0), -1)
        frames.append(frame)
    return frames


@pytest.mark.parametrize("count", [60, 61])
def test_a_bright_animal_on_a_black_floor_is_not_the_light(tmp_path, count):
    frames = worm_frames(count)
    result, shown = clip_of(tmp_path, frames)
    assert not result.mended and off(shown, frames) == 0
    words = {one.word: one for one in list_findings(result.quality)}
    assert words["flicker"].good and "cannot be told" in words["flicker"].text
    p = parameters(correct_light="always")
    assert choose_repairs(p, result.quality, 120) == set()


@pytest.mark.parametrize(
    ("repair", "fault"),
    [
        ("even_light", {"light_flicker_pct": 5.0}), ("even_light", {"light_drift_pct": 40.0}),
        ("steady", {"shake_px": 2.0}), ("deinterlace", {"field_order": -0.5}),
        ("undouble", {"doubled_pct": 30.0}),
    ],
)  # fmt: skip
def test_a_repair_is_better_if_its_fault_shrinks_and_animals_stand_out(repair, fault):
    before, after = quality(**fault), quality()
    assert is_better(repair, before, after)
    assert not is_better(repair, before, before)
    assert not is_better(repair, after, before)
    assert not is_better(repair, before, quality(contrast_grey=20.0))
    assert not is_better(repair, before, quality(noise_grey=4.0))


def test_a_repair_that_is_no_better_is_left_out_and_reported(tmp_path, monkeypatch, carp):
    flickering = [cv2.convertScaleAbs(f, alpha=1 + 0.05 * (k % 2)) for k, f in enumerate(carp[:20])]
    monkeypatch.setattr("finloop.clip.rewrite.undo_gain", lambda frame, gain: frame)
    result, shown = clip_of(tmp_path, flickering)
    assert result.refused == {"even_light"} and not result.mended
    assert off(shown, flickering) == 0 and result.metrics["refused_even_light"] == 1
    found = list_findings(result.quality, result.filmed, result.mended, result.refused)
    words = {one.word: one for one in found}
    assert "was left out" in words["flicker"].text and "was left out" not in words["drift"].text


# --- on a sample of the film


def tank_frames(count: int) -> list[np.ndarray]:
    """A dark fish that swims through a tank with stains."""
    grain = np.random.default_rng(2).normal(0, 1, (160, 220)).astype(np.float32)
    tank = 130 + 60 * cv2.GaussianBlur(grain, (0, 0), 2)
    frames = []
    for k in range(count):
        frame = np.clip(tank, 60, 220).astype(np.uint8)
        cv2.ellipse(frame, (30 + 160 * k // count, 80), (18, 6), 12.0 * np.sin(k), 0, 360, 20, -1)
        frames.append(frame)
    return frames


@pytest.fixture
def clip_lengths(monkeypatch) -> list[int]:
    """How many frames each clip has that is clip_lengths."""
    lengths = []

    def count_frames(*args):
        facts, tally, arena = write_clip(*args)
        lengths.append(facts.frames)
        return facts, tally, arena

    monkeypatch.setattr("finloop.clip.rewrite.write_clip", count_frames)
    return lengths


@pytest.mark.parametrize("count", [64, 65])
def test_a_film_is_written_once_with_the_repairs_that_a_sample_of_it_needs(
    tmp_path, clip_lengths, count
):
    light = 1 + 0.06 * np.cos(2.1 * np.arange(count))
    shift = np.random.default_rng(4).uniform(-1.5, 1.5, (count, 2))
    shot = [
        undo_shift(cv2.convertScaleAbs(frame, alpha=gain), Shift(x, y, 0))
        for frame, gain, (x, y) in zip(tank_frames(count), light, shift, strict=True)
    ]
    result, _ = clip_of(tmp_path, shot)
    assert clip_lengths == [count] and result.mended == {"even_light", "steady"}
    assert result.filmed.light_flicker_pct == pytest.approx(6 / 2**0.5, rel=0.1)
    assert result.filmed.shake_px == pytest.approx((2 * 1.5**2 / 3) ** 0.5, rel=0.15)
    assert result.quality.light_flicker_pct < 0.3 and result.quality.shake_px < 0.1


def test_a_fault_outside_the_sample_is_found_in_the_clip_and_mended(tmp_path, clip_lengths):
    frames = tank_frames(100)
    for k in range(100):
        if k % 12 > 7:  # stretches of a sample begin at key frames, one in 12, and have 8 frames
            frames[k] = undo_shift(frames[k], Shift(2.0 * (-1) ** k, 1.0, 0))
    result, _ = clip_of(tmp_path, frames)
    assert clip_lengths == [100, 100] and result.mended == {"steady"}
    assert result.filmed.shake_px > 0.5 > 0.1 > result.quality.shake_px
