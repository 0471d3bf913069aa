"""The check of the film: what was done to a drawn film is what is measured."""

import cv2
import numpy as np
import pytest
from scratch import carp_frames

from finloop.base.light import undo_gain
from finloop.clip.check import (
    CHECK,
    EXAMINED,
    ClipTally,
    check_film,
    choose_examined_frames,
    measure_field_order,
)
from finloop.clip.doubled import find_repeats
from finloop.clip.light import measure_gain, measure_light
from finloop.clip.shake import UNKNOWN, Shift, find_landmarks, measure_shift, undo_shift
from finloop.clip.verdict import list_findings

RNG = np.random.default_rng(5)


@pytest.fixture(autouse=True)
def same_draws():
    """Every test draws the same numbers, whichever ran before it."""
    RNG.bit_generator.state = np.random.default_rng(5).bit_generator.state


@pytest.fixture(scope="module")
def carp() -> list[np.ndarray]:
    """64 frames of a carp, 25 a second."""
    return carp_frames(64)


def floor(height: int = 200, width: int = 260) -> np.ndarray:
    """A tank with marks and stains, the same however far it is moved: (h + 40, w + 40)."""
    grain = RNG.normal(0, 1, (height + 40, width + 40)).astype(np.float32)
    marked, stained = (size * cv2.GaussianBlur(grain, (0, 0), size) for size in (2.5, 10.0))
    return 130 + 30 * marked + 40 * stained


def tank_picture(
    tank: np.ndarray, x: float = 0.0, y: float = 0.0, fish: int | None = None
) -> np.ndarray:
    """The tank moved by x, y, with noise, and a black fish `fish` px from the left."""
    by = np.float32([[1, 0, x], [0, 1, y]])
    moved = cv2.warpAffine(tank, by, tank.shape[::-1], flags=cv2.INTER_CUBIC)[20:-20, 20:-20]
    moved = moved + RNG.normal(0, 1.5, moved.shape)
    if fish is not None:
        moved[90:115, fish : fish + 70] = 10
    return np.clip(np.rint(moved), 0, 255).astype(np.uint8)


# --- light


@pytest.mark.parametrize("bright", [0.8, 1.0, 1.13])
def test_a_gain_is_that_of_the_lamp_whatever_swims(bright):
    tank = floor()
    frame = np.clip(np.rint(tank_picture(tank, fish=40) * bright), 0, 255).astype(np.uint8)
    assert measure_gain(frame, tank_picture(tank)) == pytest.approx(bright, abs=4e-3)
    back = undo_gain(frame, measure_gain(frame, tank_picture(tank)))
    assert measure_gain(back, tank_picture(tank)) == pytest.approx(1, abs=4e-3)


def test_every_channel_has_its_gain_and_a_black_frame_none():
    tank = np.dstack([tank_picture(floor())] * 3)
    frame = (tank * [0.9, 1.0, 0.8]).round().astype(np.uint8)
    np.testing.assert_allclose(measure_gain(frame, tank), [0.9, 1.0, 0.8], atol=4e-3)
    assert np.isnan(measure_gain(frame * 0, tank * 0)).all()
    np.testing.assert_array_equal(undo_gain(frame, np.full(3, np.nan)), frame)


def test_flicker_and_drift_are_what_was_put_in():
    time_s = np.arange(1000) / 25
    wave = 1 + 0.04 * np.sin(2 * np.pi * 7.3 * time_s)
    assert measure_light(wave, 25).flicker_pct == pytest.approx(4 / 2**0.5, rel=0.03)
    assert measure_light(wave, 25).flicker_hz == pytest.approx(7.3, abs=0.1)
    assert measure_light(wave, 25).drift_pct < 0.5
    slope = 0.9 + 0.2 * time_s / time_s[-1]
    assert measure_light(slope, 25).drift_pct == pytest.approx(20, rel=0.08)
    assert measure_light(slope, 25).flicker_pct < 0.05
    noise = 1 + RNG.uniform(-0.1, 0.1, 1000)
    assert measure_light(noise, 25).flicker_pct == pytest.approx(10 / 3**0.5, rel=0.1)
    assert np.isnan(measure_light(noise, 25).flicker_hz)


# --- shake


@pytest.mark.parametrize("x, y", [(0, 0), (1, -2), (0.4, 1.7), (-6.3, 5.2), (11.5, -9.25)])
def test_a_shift_is_that_of_the_camera_to_a_part_of_a_pixel(x, y):
    tank = floor()
    marks = find_landmarks(tank_picture(tank, fish=30))
    found = measure_shift(tank_picture(tank, x, y, fish=150), marks)
    assert (found.x, found.y) == pytest.approx((x, y), abs=0.07)
    assert found.apart < 0.2


def test_a_fish_that_swims_on_a_floor_without_marks_is_no_shake():
    plain = np.full((240, 300), 200, np.float32)
    marks = find_landmarks(tank_picture(plain, fish=50))
    assert measure_shift(tank_picture(plain, fish=60), marks) is UNKNOWN


def test_a_zoom_is_seen_as_parts_that_move_apart():
    tank = floor()
    zoom = cv2.getRotationMatrix2D((150, 120), 0, 1.02)
    zoomed = cv2.warpAffine(tank, zoom, tank.shape[::-1], flags=cv2.INTER_CUBIC)
    assert measure_shift(tank_picture(zoomed), find_landmarks(tank_picture(tank))).apart > 0.3


def test_a_frame_is_moved_back():
    tank = floor()
    shot, by = tank_picture(tank, 2.6, -1.3), Shift(2.6, -1.3, 0)
    back = undo_shift(shot, by)
    kernel = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    matrix = np.array([[1, 0, by.x], [0, 1, by.y]])
    warped = cv2.warpAffine(
        shot, matrix, shot.shape[::-1], flags=kernel, borderMode=cv2.BORDER_REPLICATE
    )
    assert np.abs(back.astype(float) - warped).mean() < 0.1
    assert np.array_equal(undo_shift(shot, Shift(3.0, -1.0, 0))[1:, :-3], shot[:-1, 3:])
    off = back.astype(float) - tank_picture(tank)
    assert np.abs(off[6:-6, 6:-6]).mean() < 3


@pytest.mark.parametrize("shape", [(9, 5), (9, 5, 3)])
@pytest.mark.parametrize(("right", "down"), [(0, 0), (2, -3), (-30, 4), (40, -25)])
def test_what_a_moved_back_frame_lacks_is_its_border_repeated(shape, right, down):
    frame = RNG.integers(0, 256, shape, np.uint8)
    frame.flags.writeable = False  # as the decoder's own memory
    rows, columns = (np.clip(np.arange(n) + by, 0, n - 1) for n, by in ((9, down), (5, right)))
    assert np.array_equal(undo_shift(frame, Shift(right, down, 0)), frame[rows][:, columns])


# --- doubled pictures


def changes(times: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Of a film that shows the pictures `times`: as far as the fish has swum, and some noise."""
    way = np.cumsum(speed)[times]
    return np.concatenate([[np.nan], np.diff(way) + RNG.uniform(0.1, 0.3, len(times) - 1)])


@pytest.mark.parametrize("rate", [1 / 3, 2 / 5, 1 / 2, 0.62, 4 / 5, 25 / 30 * 1001 / 1000, 24 / 25])
def test_a_conversion_to_a_higher_rate_is_undone(rate):
    speed = 8 + 5 * np.sin(np.arange(3000) / 9)
    times = np.floor(np.arange(2000) * rate + 0.3).astype(int)
    found = find_repeats(changes(times, speed))
    assert found.rate == pytest.approx(rate, abs=1e-4)
    assert 100 * found.share == pytest.approx(100 * (1 - rate), abs=1)
    right = np.diff(times, prepend=-1) == 0
    assert (found.repeats == right)[1:].mean() > 0.99
    steps = np.diff(found.pictures[~found.repeats])
    assert (steps == 1).mean() > 0.98
    assert found.pictures[-1] == pytest.approx(times[-1], abs=1)


def test_an_animal_that_moves_by_fits_and_starts_doubles_nothing():
    speed = np.abs(10 * np.sin(np.arange(1500) ** 1.5 / 900)) + RNG.uniform(0.1, 0.3, 1500)
    assert find_repeats(changes(np.arange(1500), speed)).share < 0.01
    assert find_repeats(np.array([np.nan, 0.0, 0.0, 0.0])).share == 0


def test_an_animal_that_rests_and_darts_away_doubles_nothing():
    # Bouts of 7 frames between rests of 6 frames and more.
    speed = np.full(1500, 0.2)
    starts = np.cumsum(RNG.integers(13, 30, 50))
    for start in starts:
        speed[start : start + 7] = RNG.uniform(6, 12) * np.sin(np.linspace(0.7, 3, 7))
    assert find_repeats(changes(np.arange(1500), speed)).share < 0.01


def test_stutter_is_told_from_a_conversion():
    times = np.arange(1500)
    late = RNG.choice(np.arange(1, 1500), 150, replace=False)
    times[late] = times[late - 1]
    found = find_repeats(changes(times, np.full(1500, 9.0)))
    assert found.share > 0.05 and np.isnan(found.rate) and not found.repeats.any()


# --- fields


def interlace(earlier: np.ndarray, later: np.ndarray, top: bool) -> np.ndarray:
    """One picture of two moments: the earlier one in the upper field or in the lower one."""
    both = later.copy()
    both[0 if top else 1 :: 2] = earlier[0 if top else 1 :: 2]
    return both


@pytest.mark.parametrize("top", [True, False])
def test_woven_fields_and_their_order_are_seen(carp, top):
    frames = [interlace(a, b, top) for a, b in zip(carp[0::2], carp[1::2], strict=True)]
    order = [measure_field_order(a, b) for a, b in zip(frames, frames[1:], strict=False)]
    assert np.nanmedian(order) * (1 if top else -1) > 0.25
    whole = [measure_field_order(a, b) for a, b in zip(carp, carp[1:], strict=False)]
    assert abs(np.nanmedian(whole)) < 0.05
    assert np.isnan(measure_field_order(carp[0], carp[0]))


# --- the whole film


def test_a_film_that_begins_plain_white_is_compared_with_its_first_other_frame():
    tank = np.tile(np.linspace(100, 200, 64), (48, 1))
    tally = ClipTally()
    for gain in (3.0, 3.0, 1.0, 0.9, 3.0, 1.1):
        tally.add_frame(np.clip(np.rint(gain * tank), 0, 255).astype(np.uint8))
    unknown = [True, True, False, False, True, False]
    assert np.isnan(tally.lights).tolist() == unknown
    assert np.array(tally.lights)[~np.array(unknown)] == pytest.approx([1, 0.9, 1.1], abs=0.01)


def check_frames(frames: list[np.ndarray], rate_hz: float = 25.0):
    tally = ClipTally()
    for frame in frames:
        tally.add_frame(frame)

    return check_film(lambda numbers: [frames[number] for number in numbers], rate_hz, tally)


def faults(frames: list[np.ndarray]) -> set[str]:
    return {one.word for one in list_findings(check_frames(frames)[0]) if not one.good}


def test_a_good_film_has_no_fault(carp):
    quality, table, tank = check_frames(carp)
    assert {one.word for one in list_findings(quality) if not one.good} == set()
    assert quality.noise_grey == pytest.approx(2.5, rel=0.15)  # as drawn
    assert quality.shake_px < 0.05
    assert len(table) == 64 and list(table) == CHECK.names
    assert tank.shape == (168, 224)


def test_each_fault_is_found_and_no_other(carp):
    lamp = RNG.uniform(0.9, 1.1, 64)
    flickering = [np.clip(f * g, 0, 255).astype(np.uint8) for f, g in zip(carp, lamp, strict=True)]
    assert faults(flickering) == {"flicker"}
    jitter = [Shift(x, y, 0) for x, y in RNG.uniform(-2, 2, (64, 2))]
    assert faults(list(map(undo_shift, carp, jitter))) == {"shake"}
    assert faults([carp[k * 2 // 3] for k in range(64)]) == {"doubled"}
    woven = [interlace(a, b, True) for a, b in zip(carp[0::2], carp[1::2], strict=True)]
    assert faults(woven) == {"interlaced"}
    assert faults([f // 12 for f in carp[:20]]) >= {"contrast"}
    assert faults([carp[0]] * 20) >= {"contrast"}  # nothing moves


@pytest.mark.parametrize("levels", [2, 4, 8])
def test_flicker_of_few_grey_levels_is_not_taken_for_a_large_shift(carp, levels):
    lamp = np.random.default_rng(1).uniform(0.9, 1.1, len(carp))
    step = 256 // levels
    frames = [
        np.clip(frame * gain, 0, 255).astype(np.uint8) // step * step
        for frame, gain in zip(carp, lamp, strict=True)
    ]
    quality, table, _ = check_frames(frames)
    assert not (table[["shift_x", "shift_y"]].abs() > 1).to_numpy().any()
    assert not quality.shake_px > 0.5


@pytest.mark.parametrize("frames", [EXAMINED + 1, 150, 500, 1500, 10_000])
def test_a_long_film_is_examined_in_spread_runs_from_key_frames(frames):
    numbers = np.array(choose_examined_frames(frames, 12))
    assert EXAMINED / 2 < len(numbers) <= EXAMINED
    starts = numbers[np.diff(numbers, prepend=-2) > 1]
    assert not (starts % 12).any() and len(numbers) >= 2 * len(starts)
    assert (np.diff(numbers) > 0).all()
    assert numbers[0] == 0 and numbers[-1] > frames - 2 * max(12, frames // 64)


def test_a_short_film_is_examined_whole():
    assert choose_examined_frames(EXAMINED, 12) == list(range(EXAMINED))
