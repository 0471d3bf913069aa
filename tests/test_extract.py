"""Extraction: background, noise, silhouettes, cut-outs; whole drawn films; the stage and bad clips.

Toy fish are soft ellipses, so that their area, centre, outline and colour are known.
"""

import gc
import shutil
import tracemalloc
import weakref
from collections import Counter
from contextlib import chdir
from dataclasses import replace
from functools import cache, partial
from unittest.mock import Mock

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT, TINY_CARP
from constants import with_constants
from scratch import content, prepare, put_clip
from tiny_run import stage_run

import stages.extract
import stages.features
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.parallel import ALONE, Processes, Threads
from finloop.base.settings import settings
from finloop.drawn.carp.film import film_frames
from finloop.extract import film as extract
from finloop.extract.background import (
    Scene,
    background_without_ghosts,
    difference_image,
    flat_background,
    match_scene_to_light,
    measure_scene,
    median_background,
    relative_brightness,
    scale_brightness,
)
from finloop.extract.film import (
    ClipStream,
    Detector,
    add_learnt_backgrounds,
    choose_sample_frames,
    detect_in_clip,
    link_tracks,
    track_table_rows,
)
from finloop.extract.samples import (
    TypicalFish,
    find_typical_fish,
    judge_silhouette,
    measure_scene_and_fish,
)
from finloop.extract.segment import (
    Silhouette,
    SilhouetteEdge,
    find_silhouettes,
    measure_fish,
    premultiply_cutout,
    soft_alpha,
)
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.extract.verdict import list_findings, summarize_light
from finloop.features.metrics import compare_with_truth
from finloop.features.table import FeaturesSettings as FeatureSettings
from finloop.features.table import measure_features
from finloop.io.cutouts import open_cutouts
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.io.video import read_frames
from finloop.plots.branches import (
    choose_fish_to_draw,
    figure3_4,
    find_branches,
    number_pixels,
    thin_fish,
    turn_horizontal,
)
from finloop.plots.extract import draw_detections

CONF = yaml.safe_load((ROOT / "conf/extract/default.yaml").read_text())
SETTINGS = ExtractSettings(**{name: value for name, value in CONF.items() if name != "defaults"})
KERNEL = cv2.getGaussianKernel(3, 0.85)
SIZE = (120, 160)
LONG, WIDE = 30.0, 7.0  # half axes of a toy fish


@cache
def coverage(x, y, degrees=0.0, long=LONG, wide=WIDE, size=SIZE):
    """Share of each pixel that an ellipse covers."""
    fine, cover = (np.arange(8) - 3.5) / 8, np.zeros(size)
    reach = max(long, wide) + 1
    near = tuple(
        np.arange(max(0, int(at - reach)), max(0, min(end, int(at + reach) + 1)))
        for at, end in zip((y, x), size, strict=True)
    )  # the ellipse reaches no farther
    py = (near[0][:, None] + fine).reshape(-1, 1) - y
    px = (near[1][:, None] + fine).reshape(1, -1) - x
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    inside = ((px * c - py * s) / long) ** 2 + ((px * s + py * c) / wide) ** 2 < 1
    cover[np.ix_(*near)] = inside.reshape(len(near[0]), 8, len(near[1]), 8).mean((1, 3))
    return cover


def lay_over(tank, cover, ink):
    """A picture of something of tone `ink` that covers the tank."""
    tank = np.asarray(tank, float)
    cover = cover if tank.ndim == 2 else cover[..., None]
    return np.round(tank * (1 - cover) + np.asarray(ink) * cover).astype(np.uint8)


def floor(colour=False, size=SIZE, seed=0):
    """A tank whose floor has patches of tones from 120 to 180."""
    rng = np.random.default_rng(seed)
    shape = (*size, 3) if colour else size
    rough = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), 4)
    return np.clip(150 + 30 * rough / np.abs(rough).max(), 0, 255).astype(np.uint8)


def scene_of(tank, polarity="dark", threshold=6.0):
    return Scene(tank, polarity, threshold / 5, threshold)


WHOLE = np.full(SIZE, 255, np.uint8)


def patches(frame, scene, arena=WHOLE, least=20.0, share=0.4, shadow=0.45):
    inside = arena[: frame.shape[0], : frame.shape[1]]
    return list(find_silhouettes(frame, scene, inside, least, SilhouetteEdge(share, shadow, "all")))


# -- background ---------------------------------------------------------------------------------


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("height", [120, 64, 65])
def test_the_median_is_the_empty_tank(colour, height):
    tank, size = floor(colour, (height, 160)), (height, 160)
    poses = [(20 + 15 * k, 20 + 4 * k, 20 * k) for k in range(9)]
    frames = [lay_over(tank, coverage(*pose, size=size), 40) for pose in poses]
    before = [frame.copy() for frame in frames]
    assert np.array_equal(median_background(frames), tank)
    assert all(np.array_equal(a, b) for a, b in zip(frames, before, strict=True))


def test_the_median_takes_the_noise_down_in_any_order_and_light_of_frames():
    rng = np.random.default_rng(1)
    tank = floor()
    frames = [np.round(tank + rng.normal(0, 4, SIZE)).astype(np.uint8) for _ in range(25)]
    background = median_background(frames)
    other = median_background(frames[::-1])
    assert np.abs(background.astype(int) - other).max() <= 2
    assert (background.astype(float) - tank).std() < 1.5
    lit = [scale_brightness(tank, gain) for gain in (1.15, 0.85, 0.9, 1.0, 1.1)]
    assert np.abs(median_background(lit).astype(int) - tank).max() <= 2


@pytest.mark.parametrize("bright", [1, 12])
def test_the_tank_has_the_mean_light_of_the_film_not_that_of_its_first_frames(bright):
    tank = floor()
    gains = [1.15] * bright + [0.97, 1.03] * ((24 - bright) // 2) + [1.0] * (1 + bright % 2)
    found = median_background([scale_brightness(tank, gain) for gain in gains])
    light = np.mean([scale_brightness(tank, gain).mean() for gain in gains])
    assert found.mean() == pytest.approx(light, rel=0.005)


@pytest.mark.parametrize("colour", [False, True])
def test_the_light_is_measured_past_the_fish(colour):
    tank = floor(colour)
    fish = lay_over(tank, coverage(80, 60, 20), 30)
    for gain in (0.8, 0.95, 1.1, 1.3):
        lit = scale_brightness(fish, gain)
        assert relative_brightness(lit, tank) == pytest.approx(gain, rel=0.01)
    a_third_of_a_level = scale_brightness(tank, 1.002)
    assert relative_brightness(a_third_of_a_level, tank) == 1.0
    assert match_scene_to_light(scene_of(tank), tank).background is tank
    assert match_scene_to_light(scene_of(tank), tank).gains == pytest.approx(1, abs=1e-6)
    black = np.zeros_like(tank)
    for one, other in ((black, black), (tank, black), (black, tank)):
        assert relative_brightness(one, other) == 1.0


def in_light(picture, gains):
    """A picture in a light of these gains."""
    return np.clip(np.rint(picture * np.asarray(gains)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gains", [[0.8], [0.97], [1.01], [1.25], [0.97, 1.0, 1.02]])
def test_a_fish_in_flickering_light_has_the_same_cutout_as_in_steady_light(gains):
    tank = floor(colour=len(gains) == 3)
    steady = lay_over(tank, coverage(80.3, 59.6, 30), 90)
    found = []
    for frame in (steady, in_light(steady, gains)):
        scene = match_scene_to_light(scene_of(tank), frame)
        (silhouette,) = patches(frame, scene)
        found.append((scene, measure_fish(silhouette, frame, scene, 33)))
    (_, plain), (scene, fish) = found
    assert scene.gains == pytest.approx(gains, rel=2e-3)
    (h, w), (y, x) = plain.cutout.shape[:2], (plain.y0 - fish.y0, plain.x0 - fish.x0)
    moved = np.roll(fish.cutout, (-y, -x), (0, 1))[:h, :w].astype(int)
    body = (plain.cutout[..., -1] == 255) & (moved[..., -1] == 255)
    assert body.sum() > 300
    # Rounding in two lights, divided by a gain of 0.8: a grey level.
    assert np.abs(moved - plain.cutout)[body].max() <= 1
    assert np.abs(moved[body] - plain.cutout[body]).mean() < 0.4


def test_where_the_light_is_unknown_a_cutout_is_as_bright_as_filmed():
    tank = floor()
    fish = lay_over(tank, coverage(80, 60), 90)
    for frame, empty in (
        (in_light(fish, 2.5), tank),  # saturates
        (in_light(fish, np.linspace(0.3, 1, 160)), tank),  # a lamp at one side
        (in_light(fish, 0.05), in_light(tank, 0.05)),  # plain black
    ):
        assert match_scene_to_light(scene_of(empty), frame).gains is None
    alpha = np.full(SIZE, 255, np.uint8)
    assert np.array_equal(premultiply_cutout(fish, tank, alpha)[..., 0], fish)


def test_the_light_of_a_film_is_a_finding():
    def judge(*light):
        facts = summarize_light(np.array(light))
        animals = dict.fromkeys(
            ("silhouettes_at_border", "area_jumps_pct", "area_range", "tank_grain_grey"), 0.0
        )
        animals |= {"silhouettes_fish": 1.0, "typical_length_px": 60, "typical_edge_px": 2.0}
        (found,) = [f for f in list_findings(animals | facts._asdict()) if f.word == "light"]
        return found

    flicker = judge(0.98, 1.02, 0.98, 1.02)
    assert flicker.good and "2.0 %" in flicker.text and "even light" in flicker.text
    lamp = judge(*[0.4] * 5, *[1.0] * 5)
    assert not lamp.good and "2.50 times" in lamp.text
    white = judge(1.0, 1.0, 1.0, np.nan)
    assert not white.good and "25 %" in white.text and "as bright as filmed" in white.text
    black = judge(np.nan, np.nan)
    assert black.good and "cannot be told" in black.text


@pytest.mark.parametrize("gain", [0.8, 1.2])
def test_light_alone_is_no_difference(gain):
    tank = floor()
    frame = scale_brightness(tank, gain)
    assert difference_image(frame, scene_of(tank, "both")).min() > 20
    for polarity in ("dark", "bright", "both"):
        lit = match_scene_to_light(scene_of(tank, polarity), frame)
        assert difference_image(frame, lit).max() <= 2


@pytest.mark.parametrize("polarity", ["dark", "bright", "both"])
@pytest.mark.parametrize("size", [(2, 2), (3, 40), (33, 5), SIZE])
def test_a_difference_is_smoothed_by_a_gaussian_also_at_the_edges(polarity, size):
    rng = np.random.default_rng(7)
    frame, tank = rng.integers(0, 256, (2, *size), np.uint8)
    darker = np.clip(tank.astype(float) - frame, 0, None)
    brighter = np.clip(frame.astype(float) - tank, 0, None)
    change = {"dark": darker, "bright": brighter, "both": darker + brighter}[polarity]
    smooth = cv2.sepFilter2D(change, -1, KERNEL, KERNEL)
    assert np.abs(difference_image(frame, scene_of(tank, polarity)) - smooth).max() <= 0.6
    view = np.pad(frame, (0, 9))[: size[0], : size[1]]  # as a decoder gives it
    view.flags.writeable = False
    scene = scene_of(tank)
    assert np.array_equal(difference_image(view, scene), difference_image(frame, scene))


def test_of_three_colours_the_strongest_difference_counts():
    tank = floor(colour=True)
    for channel in range(3):
        ink = tank[60, 80].copy()
        ink[channel] -= 70
        change = difference_image(lay_over(tank, coverage(80, 60), ink), scene_of(tank))
        assert change[60, 80] == pytest.approx(70, abs=1)


@pytest.mark.parametrize("sigma", [1.5, 4.0, 9.0])
@pytest.mark.parametrize("colour", [False, True])
def test_the_noise_is_measured(sigma, colour):
    rng = np.random.default_rng(2)
    size = (300, 400)
    shape = (*size, 3) if colour else size
    tank = np.full(shape, 128, np.uint8)
    fish = lay_over(tank, coverage(200, 150, 30, size=size), 60)  # 0.5 % of the picture
    noisy = np.clip(np.round(fish + rng.normal(0, sigma, (5, *shape))), 0, 255)
    frames = list(noisy.astype(np.uint8))
    scene = measure_scene(frames, tank, "auto", 5.0, 6.0)
    true = np.hypot(sigma, 12**-0.5) * (KERNEL**2).sum()  # with rounding; smoothed over 3x3
    if colour:  # of three normal numbers the one farthest from zero
        largest = np.abs(rng.normal(0, true, (100_000, 3))).max(1)
        true = np.quantile(largest, 0.6827)
    assert scene.noise == pytest.approx(true, rel=0.1)
    assert scene.threshold == max(5.0 * scene.noise, 6.0)
    assert scene.polarity == "dark"


def test_the_noise_is_not_the_fish():
    # A tenth of the tank is fish; the noise level is that of the rest, not that of the fish.
    rng = np.random.default_rng(3)
    tank = np.full((200, 200), 128, np.uint8)
    crowded = tank.copy()
    crowded[:20] = 40
    frames = [np.round(crowded + rng.normal(0, 4, tank.shape)).astype(np.uint8) for _ in range(5)]
    alone = 4 * (KERNEL**2).sum()
    assert alone < measure_scene(frames, tank, "dark", 5.0, 6.0).noise < 1.5 * alone


@pytest.mark.parametrize(
    ("inks", "polarity"),
    [((40, 40), "dark"), ((250, 250), "bright"), ((40, 250), "both"), ((100, 90), "dark")],
)
def test_the_polarity_is_found(inks, polarity):
    tank = floor()
    frames = []
    for k in range(5):
        one = lay_over(tank, coverage(40 + k, 30), inks[0])
        frames.append(lay_over(one, coverage(110 - k, 90), inks[1]))
    assert measure_scene(frames, tank, "auto", 5.0, 6.0).polarity == polarity
    assert measure_scene(frames, tank, "bright", 5.0, 6.0).polarity == "bright"  # as asked


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("ink", [40, 230])
def test_a_flat_background_for_a_fish_that_stays(colour, ink):
    rng = np.random.default_rng(4)
    tone = np.array([120, 140, 130]) if colour else np.array(130)
    tank = np.broadcast_to(tone, (*SIZE, 3) if colour else SIZE)
    shots = [lay_over(tank, coverage(80, 60 + k), ink) for k in range(3)]
    frames = [np.round(shot + rng.normal(0, 2, tank.shape)).astype(np.uint8) for shot in shots]
    background = flat_background(frames)
    assert background.shape == tank.shape and background.dtype == np.uint8
    assert np.abs(background.astype(int) - tone).max() <= 1
    assert np.abs(median_background(frames).astype(int) - tank).max() >= 20  # what it is for


def test_how_many_frames_are_looked_at():
    def count(asked, frames=1000, shape=(100, 100, 1)):
        return len(choose_sample_frames(asked, frames, shape, key_frame_distance=1))

    assert [count(asked) for asked in (3, 4, 40, 41)] == [3, 3, 39, 41]
    assert [count(41, frames) for frames in (1, 2, 3, 8, 41, 42)] == [1, 1, 3, 7, 41, 41]
    for shape in ((4000, 6000, 3), (2160, 3840, 3), (30_000, 30_000, 3)):
        many = count(41, shape=shape)
        assert many % 2 == 1 and (many == 1 or many * np.prod(shape) <= 2**29)
    at_key_frames = choose_sample_frames(3, 250, (9, 9), key_frame_distance=12)
    assert at_key_frames == [0, 120, 240]


def test_mog2_takes_in_what_stays_and_follows_the_frames():
    tank = floor()
    stone = lay_over(tank, coverage(80, 60), 40)
    frames = [tank] * 10 + [stone] * 190
    seen = list(add_learnt_backgrounds(frames, scene_of(tank), rate_hz=2.0))
    assert all(frame is given for (frame, _), given in zip(seen, frames, strict=True))
    assert np.abs(seen[9][1].background.astype(int) - tank).max() <= 1
    assert np.abs(seen[-1][1].background.astype(int) - stone).max() <= 1
    renewed = [k for k in range(1, 200) if seen[k][1] is not seen[k - 1][1]]
    assert renewed == list(range(2, 200, 2))  # every second
    assert len({scene.threshold for _, scene in seen}) == 1


# -- silhouettes --------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 30, 77])
@pytest.mark.parametrize("colour", [False, True])
def test_a_fish_is_one_silhouette_of_its_size(degrees, colour):
    tank = floor(colour)
    (found,) = patches(lay_over(tank, coverage(80.3, 59.6, degrees), 40), scene_of(tank))
    true = np.pi * LONG * WIDE
    assert found.area_px == found.mask.sum() == pytest.approx(true, rel=0.05)
    assert not found.at_border
    assert found.contrast == pytest.approx(105, abs=20)
    inside = coverage(80.3, 59.6, degrees) > 0.5
    h, w = found.mask.shape
    here = inside[found.y0 : found.y0 + h, found.x0 : found.x0 + w]
    assert here.sum() == inside.sum()  # the cut-out holds all of it
    assert (here != found.mask).mean() < 0.04
    assert not found.mask[[0, -1]].any()  # and a rim of tank
    assert not found.mask[:, [0, -1]].any()


def test_a_picture_on_its_side_has_the_same_silhouettes_on_their_sides():
    tank = floor()
    frame = lay_over(tank, coverage(70, 60, 25), 40)
    (found,) = patches(frame, scene_of(tank))
    for turn in (lambda z: z.T, lambda z: z[::-1], lambda z: z[:, ::-1], np.rot90):
        turned = [np.ascontiguousarray(turn(z)) for z in (frame, tank, WHOLE)]
        (other,) = patches(turned[0], scene_of(turned[1]), turned[2])
        assert np.array_equal(turn(found.mask), other.mask)
        assert other.contrast == found.contrast


def test_a_pale_fish_and_a_strong_one_both_end_at_their_own_outline():
    tank = np.full(SIZE, 150, np.uint8)
    strong, pale = coverage(40, 40, 10), coverage(110, 80, 10)
    found = patches(lay_over(lay_over(tank, strong, 30), pale, 125), scene_of(tank))
    areas = sorted(s.area_px for s in found)
    assert len(areas) == 2
    assert areas[0] == pytest.approx(areas[1], rel=0.04)


def test_a_soft_shadow_does_not_enter():
    tank = floor()
    shadow = cv2.GaussianBlur(coverage(88, 68, 10), (0, 0), 3)
    shaded = lay_over(tank, 0.15 * shadow, 0)
    assert difference_image(shaded, scene_of(tank)).max() > 15  # well above the threshold
    (plain,) = patches(lay_over(tank, coverage(80, 60, 10), 40), scene_of(tank))
    (with_shadow,) = patches(lay_over(shaded, coverage(80, 60, 10), 40), scene_of(tank))
    assert with_shadow.area_px == pytest.approx(plain.area_px, rel=0.03)


def test_two_fish_under_one_shadow_are_two_silhouettes():
    tank = np.full(SIZE, 150, np.uint8)
    veil = lay_over(tank, coverage(80, 60, long=45, wide=28), 130)
    frame = lay_over(lay_over(veil, coverage(80, 45), 30), coverage(80, 75), 30)
    found = patches(frame, scene_of(tank))
    assert [s.area_px for s in found] == pytest.approx([np.pi * LONG * WIDE] * 2, rel=0.12)


def test_a_fish_beside_a_slanting_one_is_given_once():
    """The rectangle about the slanting one holds the other, too, whole or in part."""
    tank = np.full(SIZE, 150, np.uint8)
    slanting = coverage(80, 60, 45)
    for x, y in ((98, 78), (62, 42), (112, 60)):
        frame = lay_over(lay_over(tank, slanting, 30), coverage(x, y, 45, long=9, wide=4), 30)
        found = patches(frame, scene_of(tank))
        times = np.zeros(SIZE, int)
        for one in found:
            h, w = one.mask.shape
            times[one.y0 : one.y0 + h, one.x0 : one.x0 + w] += one.mask
        assert len(found) == 2
        assert times.max() == 1


def test_patterned_skin_makes_no_holes():
    tank = np.full(SIZE, 150, np.uint8)
    koi = lay_over(lay_over(tank, coverage(80, 60), 30), coverage(85, 60, long=9, wide=3), 150)
    (plain,) = patches(lay_over(tank, coverage(80, 60), 30), scene_of(tank))
    (found,) = patches(koi, scene_of(tank))
    assert np.array_equal(found.mask, plain.mask)


def test_fish_in_several_rows_are_those_of_each_alone_from_below_up():
    tank, places = floor(), ((40, 20), (110, 60), (60, 108))
    alone = [patches(lay_over(tank, coverage(x, y), 40), scene_of(tank)) for x, y in places]
    frame = tank.copy()
    for x, y in places:
        frame = lay_over(frame, coverage(x, y), 40)
    found = patches(frame, scene_of(tank))
    assert [one.y0 for one in found] == [one.y0 for (one,) in alone[::-1]]
    for one, (other,) in zip(found, alone[::-1], strict=True):
        assert (one.x0, one.area_px) == (other.x0, other.area_px)
        assert np.array_equal(one.mask, other.mask)
        assert np.array_equal(one.field, other.field)


def test_specks_and_noise_are_left_out():
    tank = np.full(SIZE, 150, np.uint8)
    frame = lay_over(tank, coverage(80, 60, long=5, wide=4), 30)  # 63 px²
    assert len(patches(frame, scene_of(tank), least=50)) == 1
    assert patches(frame, scene_of(tank), least=80) == patches(tank, scene_of(tank)) == []
    noisy = np.round(tank + np.random.default_rng(5).normal(0, 2, SIZE)).astype(np.uint8)
    assert patches(noisy, scene_of(tank)) == []


@pytest.mark.parametrize(
    ("x", "y", "at_border"),
    [(80, 60, False), (31, 60, True), (34, 60, False), (128, 60, True), (125, 60, False),
     (80, 8, True), (80, 11, False), (80, 111, True), (80, 108, False), (0, 60, True)],
)  # fmt: skip
def test_what_touches_the_edge_of_the_picture(x, y, at_border):
    tank = np.full(SIZE, 150, np.uint8)
    (found,) = patches(lay_over(tank, coverage(x, y), 40), scene_of(tank))
    assert found.at_border == at_border


@pytest.mark.parametrize(("x", "at_border"), [(80, False), (50, True), (60, False), (30, True)])
def test_what_touches_the_edge_of_the_arena(x, at_border):
    tank = floor()
    arena = WHOLE.copy()
    arena[:, :26] = 0
    (found,) = patches(lay_over(tank, coverage(x, 60), 40), scene_of(tank), arena)
    assert found.at_border == at_border
    assert patches(lay_over(tank, coverage(10, 60, long=12), 40), scene_of(tank), arena) == []


# -- one fish measured --------------------------------------------------------------------------


@pytest.fixture(params=[False, True], ids=["grey", "colour"])
def toy(request):
    """Tank, frame, silhouette and measures of a toy fish."""
    tank = floor(request.param)
    frame = lay_over(tank, coverage(80.3, 59.6, 30), [40, 60, 30] if request.param else 40)
    scene = scene_of(tank)
    (silhouette,) = patches(frame, scene)
    return tank, frame, silhouette, measure_fish(silhouette, frame, scene, 33)


def test_the_measures_of_a_fish(toy):
    _, _, silhouette, fish = toy
    assert (fish.x_px, fish.y_px) == pytest.approx((80.3, 59.6), abs=0.1)
    assert fish.area_px == pytest.approx(np.pi * LONG * WIDE, rel=0.03)
    assert fish.backbone.length_px == pytest.approx(2 * LONG, rel=0.02)
    ends = fish.backbone.points_px[[0, -1]]
    assert ends.mean(0) == pytest.approx((80.3, 59.6), abs=0.7)
    assert fish.outline_px.shape == (OUTLINE_POINTS, 2)
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    dx, dy = (fish.outline_px - (80.3, 59.6)).T
    radius = np.hypot((dx * c - dy * s) / LONG, (dx * s + dy * c) / WIDE)
    assert radius == pytest.approx(1, abs=0.06)
    assert (fish.x0, fish.y0) == (silhouette.x0, silhouette.y0)
    assert fish.cutout.shape[:2] == silhouette.mask.shape


def test_alpha_is_the_share_of_the_pixel_that_is_fish(toy):
    _, _, _, fish = toy
    alpha = fish.cutout[..., -1] / 255
    h, w = alpha.shape
    true = coverage(80.3, 59.6, 30)[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w]
    assert np.all(alpha[cv2.erode(true, np.ones((5, 5))) == 1] == 1)
    assert np.all(alpha[cv2.dilate(true, np.ones((5, 5))) == 0] == 0)
    edge = (true > 0.2) & (true < 0.8)
    assert edge.sum() > 50
    assert np.abs(alpha[edge] - true[edge]).mean() < 0.2
    assert ((alpha > 0) & (alpha < 1)).sum() > 100  # soft


def test_a_cutout_over_the_empty_tank_is_the_film(toy):
    tank, frame, _, fish = toy
    back = Cutout(0, 0, fish.x0, fish.y0, fish.cutout).blend_over(tank).astype(int)
    h, w = back.shape[:2]
    here = np.s_[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w]
    film_here, tank_here = frame[here].astype(int), tank[here].astype(int)
    alpha = fish.cutout[..., -1]
    assert np.array_equal(back[alpha == 255], film_here[alpha == 255])
    assert np.array_equal(back[alpha == 0], tank_here[alpha == 0])
    # Between, it never is farther from the film than the tank is, and hardly ever at all.
    assert np.all(np.abs(back - film_here) <= np.abs(tank_here - film_here) + 1)
    assert np.abs(back - film_here).mean() < 1
    assert np.abs(back - film_here).max() < 60


@pytest.mark.parametrize("colour", [False, True])
def test_premultiplied_by_the_true_alpha_is_exact(colour):
    rng = np.random.default_rng(6)
    tank = floor(colour)
    alpha = rng.integers(0, 256, SIZE, np.uint8)
    ink = rng.integers(0, 256, tank.shape)
    frame = lay_over(tank, alpha / 255, ink)
    cutout = premultiply_cutout(frame, tank, alpha)
    assert cutout.shape == (*SIZE, 4 if colour else 2)
    assert np.all(cutout[..., :-1] <= alpha[..., None])
    share = alpha[..., None] / 255
    assert np.abs(cutout[..., :-1] - share * ink.reshape(*SIZE, -1)).max() <= 1
    assert np.abs(Cutout(0, 0, 0, 0, cutout).blend_over(tank).astype(int) - frame).max() <= 1


def test_over_another_tank_there_is_next_to_no_fringe_of_the_first():
    tank, other, ink = np.full(SIZE, 200, np.uint8), np.full(SIZE, 90, np.uint8), 40
    scene, cover = scene_of(tank), coverage(80, 60, 30)
    frame = lay_over(tank, cover, ink)
    fish = measure_fish(patches(frame, scene)[0], frame, scene, 33)
    assert fish is not None
    moved = Cutout(0, 0, fish.x0, fish.y0, fish.cutout).blend_over(other).astype(float)
    h, w = moved.shape
    true = lay_over(other, cover, ink)[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w]
    # Alpha comes from the difference image, which is smoothed: softer than the fish by a pixel.
    assert np.abs(moved - true).max() < 0.3 * (200 - 90)
    assert np.abs(moved - true).mean() < 0.02 * (200 - 90)
    assert (moved - true).mean() == pytest.approx(0, abs=0.5)


def test_alpha_is_the_difference_over_the_largest_within_two_pixels_inside():
    rng = np.random.default_rng(8)
    blob = cv2.GaussianBlur(rng.standard_normal((40, 50)), (0, 0), 4) > 0  # up to the edges
    field = rng.integers(0, 256, blob.shape, np.uint8)
    solid = blob.astype(np.uint8) * 255
    most = np.maximum(cv2.dilate(np.where(blob, field, 0).astype(np.uint8), np.ones((5, 5))), 30)
    true = np.minimum(255 * field.astype(float) / most, 255)
    true[cv2.erode(solid, np.ones((3, 3))) > 0] = 255
    true[cv2.dilate(solid, np.ones((3, 3))) == 0] = 0
    assert np.abs(soft_alpha(blob, field, 30) - true).max() <= 0.5


# -- what a fish is -----------------------------------------------------------------------------


def silhouette(area=400.0, contrast=90.0, at_border=False):
    """One of that area: an ellipse."""
    wide = np.sqrt(area / np.pi / 4)
    field = np.round(contrast * coverage(80, 60, long=4 * wide, wide=wide)).astype(np.uint8)
    return Silhouette(0, 0, field > contrast / 2, field, contrast, area, at_border)


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "fish"), ({"at_border": True}, "at border"),
        ({"area": 400 * 1.59}, "fish"), ({"area": 400 * 1.61}, "too large"),
        ({"area": 400 * 0.51}, "fish"), ({"area": 400 * 0.49}, "too small"),
        ({"contrast": 90 * 0.51}, "fish"), ({"contrast": 90 * 0.49}, "too pale"),
    ],
)  # fmt: skip
def test_verdicts(changes, verdict):
    typical = TypicalFish(400.0, 80.0, 90.0, fins="all")
    assert judge_silhouette(silhouette(**changes), typical, SETTINGS) == verdict


def test_a_typical_fish_is_no_speck_and_no_pair():
    scene = scene_of(floor())
    school = [silhouette(400 + k, 80 + k) for k in range(-10, 11)]
    dirt = [silhouette(25.0)] * 60
    pairs = [silhouette(800.0)] * 3
    cut_off = [silhouette(200.0, at_border=True)] * 40
    typical, differ = find_typical_fish(school + dirt + pairs + cut_off, scene, SETTINGS)
    assert differ == pytest.approx(np.sqrt(407 / 393) / 2 - 0.5, rel=0.5)
    assert typical.area_px == pytest.approx(400, rel=0.03)
    assert typical.contrast == pytest.approx(80, abs=3)
    assert typical.length_px == pytest.approx(8 * np.sqrt(400 / np.pi / 4), rel=0.03)


def test_no_fish_is_said_as_it_is():
    tank = floor()

    def message(*frames):
        with pytest.raises(FinloopError, match="no fish found") as caught:
            measure_scene_and_fish([*frames, tank, tank, tank], WHOLE, SETTINGS)
        assert "extract.noise_sigmas" in caught.value.do
        return caught.value.came

    assert "nothing differs from the background by more than 6.0 grey levels" in message(tank)
    assert "all 1 silhouettes touch the edge" in message(lay_over(tank, coverage(0, 60), 40))
    ball = lay_over(tank, coverage(80, 60, long=9, wide=9), 40)
    assert "too round" in message(ball)


# -- a whole film -------------------------------------------------------------------------------

FEATURES = yaml.safe_load((ROOT / "conf/features/default.yaml").read_text())
FEATURES = FeatureSettings(**{k: value for k, value in FEATURES.items() if k != "defaults"})
SHOT = settings(
    "clip", source="carp", frames=64, width_px=420, height_px=320, body_length_px=90.0, colour=False
)
FILMS = {
    "one fish": SHOT,
    "fins open, colour": replace(SHOT, seed=1, fins_open_ratio=1.0, colour=True),
    "light drift, doubled noise": with_constants(SHOT, seed=5, light_drift=0.15, noise_grey=5.0),
    "three fish": replace(
        SHOT, seed=1, fish=3, frames=120, width_px=520, height_px=400, body_length_px=60.0
    ),
}


@pytest.fixture(scope="module")
def film_with_truth():
    """Frames and truth of the films, drawn when first asked for."""
    films = {}

    def draw(name):
        if name not in films:
            frames, truth = zip(*film_frames(FILMS[name]), strict=True)
            truth = pd.DataFrame([row for some in truth for row in some])
            films[name] = frames, truth.sort_values(["fish_id", "frame"], ignore_index=True)
        return films[name]

    return draw


def survey_film(frames, settings=SETTINGS):
    arena = np.full(frames[0].shape[:2], 255, np.uint8)
    scene, typical = measure_scene_and_fish(frames[::4], arena, settings)
    return scene, typical, Detector(arena, typical, settings)


def test_a_survey_is_the_same_by_any_number_of_threads(film_with_truth):
    """And the background of fish that swim is the median."""
    frames, _ = film_with_truth("three fish")
    arena = np.full(frames[0].shape[:2], 255, np.uint8)
    surveys = [
        measure_scene_and_fish(
            frames[::8], arena, replace(SETTINGS, background=background), workers
        )
        for background, workers in (("median", ALONE), ("auto", Threads(3)))
    ]
    (alone, typical), (scene, fish) = surveys
    assert np.array_equal(scene.background, alone.background)
    assert (scene.noise, scene.threshold, fish) == (alone.noise, alone.threshold, typical)


def follow_fish(frames, settings=SETTINGS):
    """All that is found in a film, and the verdicts on what was seen."""
    scene, typical, detector = survey_film(frames, settings)
    found, tally = [], Counter()
    seen = (detector(frame, scene) for frame in frames)
    for verdicts, some in link_tracks(seen, typical, settings):
        tally += verdicts
        found += some
    return found, tally


@pytest.mark.parametrize("name", FILMS)
def test_no_fish_is_lost_or_confused_and_all_is_where_it_is(film_with_truth, name):
    frames, truth = film_with_truth(name)
    found, tally = follow_fish(frames)
    assert tally == {"fish": len(truth)}
    tracks = track_table_rows(found).sort_values(["track_id", "frame"], ignore_index=True)
    table, backbones = measure_features(tracks, 25.0, FEATURES)
    assert table["track_id"].nunique() == FILMS[name].fish
    errors = compare_with_truth(table, backbones, truth)
    assert errors["truth_found_pct"] == 100
    assert errors["truth_head_tail_swaps"] == errors["truth_identity_changes"] == 0
    assert errors["truth_centre_error_median_px"] <= 0.6
    assert errors["truth_backbone_error_mean_pct"] <= 0.5
    assert abs(errors["truth_body_length_bias_pct"]) <= 0.6
    assert errors["truth_heading_error_median_deg"] <= 1.5
    assert errors["truth_heading_error_p95_deg"] <= 4.0
    assert errors["truth_swimming_type_agreement_pct"] >= 90
    assert errors["truth_motion_area_bend_rank_correlation"] >= 0.93


@pytest.fixture(scope="module")
def detections(film_with_truth):
    """The typical fish of a film of 64 frames, and what is detected in each."""
    frames, _ = film_with_truth("one fish")
    scene, typical, detector = survey_film(frames)
    return typical, [detector(frame, scene) for frame in frames]


@pytest.mark.parametrize(("least", "kept"), [(32, True), (33, False)])
def test_short_tracks_are_left_out_as_a_whole(detections, least, kept):
    typical, seen = detections
    linked = link_tracks(seen, typical, replace(SETTINGS, min_track_frames=least), cuts=[32])
    assert sum(len(found) for _, found in linked) == 64 * kept


def test_a_track_appears_when_it_is_long_enough(detections):
    typical, seen = detections
    counts = [len(found) for _, found in link_tracks(seen, typical, SETTINGS)]
    assert counts == [0] * 9 + [10] + [1] * 54


def test_memory_does_not_grow_with_the_film(film_with_truth, monkeypatch):
    monkeypatch.setattr(extract, "_STRETCH", 10)
    frames, _ = film_with_truth("one fish")
    scene, typical, detector = survey_film(frames)
    frames = frames[:20]
    to_and_fro = [*range(len(frames)), *range(len(frames) - 1, -1, -1)]
    alive: list[int] = []

    def read(refs, start, stop):
        for number in range(start, stop):
            frame = frames[to_and_fro[number % len(to_and_fro)]].copy()
            refs.append(weakref.ref(frame))
            refs[:] = [ref for ref in refs if ref() is not None]
            alive.append(len(refs))
            yield frame
            del frame

    def peak(length):
        gc.collect()
        tracemalloc.start()
        film = ClipStream(partial(read, []), length, 25.0)
        seen = detect_in_clip(film, scene, detector, Processes())
        count = sum(len(found) for _, found in link_tracks(seen, typical, SETTINGS))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert count == length
        return most

    peak(40)  # to and fro once
    assert peak(80) < 1.05 * peak(40)
    assert max(alive) <= 2


@pytest.mark.parametrize("colour", [False, True])
def test_the_dark_patches_of_a_white_fish_belong_to_it_and_its_shadow_does_not(colour):
    tank = np.full((*SIZE, 3) if colour else SIZE, 90, np.uint8)
    fish = coverage(80, 60)
    picture = lay_over(tank, coverage(84, 68), 72)  # a shadow
    picture = lay_over(picture, fish, 235)
    patch = coverage(92, 54, long=10.0, wide=6.0) * fish  # at the outline
    picture = lay_over(picture, patch, 36)
    (silhouette,) = patches(picture, scene_of(tank, "both"))
    mask = np.zeros(SIZE, bool)
    h, w = silhouette.mask.shape
    mask[silhouette.y0 : silhouette.y0 + h, silhouette.x0 : silhouette.x0 + w] = silhouette.mask
    assert mask[patch > 0.9].mean() > 0.95
    assert mask[fish > 0.9].mean() > 0.98
    assert not mask[cv2.dilate(fish, np.ones((5, 5))) == 0].any()


def test_the_ghost_of_a_fish_that_moves_less_than_its_length_is_painted_out():
    rng = np.random.default_rng(5)
    tank = cv2.GaussianBlur(rng.normal(170, 20, (240, 320)), (0, 0), 3).clip(0, 255)
    tank[40:60, 40:90] = 90  # a stone, which is no ghost
    frames = [
        np.round(lay_over(tank, coverage(160 + k, 140, size=tank.shape), 60)).astype(np.uint8)
        for k in range(24)
    ]
    middle = median_background(frames)
    patched = background_without_ghosts(frames, middle, 12.0)
    body = coverage(172, 140, size=tank.shape) > 0.5
    assert (middle[body] < 100).mean() > 0.5  # the ghost
    assert (patched[body] > 130).all()
    assert np.array_equal(patched[30:70, 30:100], middle[30:70, 30:100])
    found, tally = follow_fish(frames, replace(SETTINGS, background="auto"))
    assert tally["fish"] >= 24
    assert np.median([f.fish.backbone.length_px for f in found]) == pytest.approx(60, rel=0.05)


def test_bubbles_that_cover_more_than_the_fish_are_not_the_typical_fish():
    rng = np.random.default_rng(6)
    tank = np.full((160, 240), 150, np.uint8)
    frames = []
    for k in range(28):
        picture = lay_over(tank, coverage(50 + 5 * k, 50 + 2 * k, size=tank.shape), 50)
        for at in rng.uniform((10, 10), (230, 150), (14, 2)):
            picture = lay_over(picture, coverage(*at, long=5.0, wide=4.0, size=tank.shape), 130)
        frames.append(picture)
    assert survey_film(frames)[1].area_px == pytest.approx(np.pi * LONG * WIDE, rel=0.1)


def test_a_fish_that_does_not_move_at_all_is_found():
    tank = np.full((160, 220), 170, np.uint8)
    still = [lay_over(tank, coverage(110, 80, size=tank.shape), 60)] * 20
    with pytest.raises(FinloopError, match="nothing differs"):
        survey_film(still, replace(SETTINGS, background="median"))
    assert follow_fish(still, replace(SETTINGS, background="auto"))[1] == {"fish": 20}


def test_verdicts_are_drawn_in_their_colours(film_with_truth):
    frames, _ = film_with_truth("three fish")
    scene, typical, detector = survey_film(frames)
    legend = int(50 * 2 * 520 / 1800)

    def draw(count, typical=typical):
        labels = list("abcd")[:count]
        return draw_detections(frames[:count], labels, scene, typical, detector.arena, SETTINGS)

    def drawn_in(colour, picture):
        return (np.abs(picture[legend:].astype(int) - colour).max(-1) < 3).sum()

    for count, height in ((1, 1), (2, 1), (3, 2), (4, 2)):
        picture = draw(count)
        assert picture.shape == (legend + height * 400, 2 * 520, 3)
    green, orange = (0, 158, 115), (213, 94, 0)
    assert drawn_in(green, picture) > 4 * 3 * 60 and drawn_in(orange, picture) == 0  # fish
    huge = draw(4, typical._replace(area_px=10.0))
    assert drawn_in(orange, huge) > 4 * 3 * 60  # too large


# -- side branches: Figs. 3, 4 --------------------------------------------------------------------

# A is where the numbering starts, d the branch that is kept; b and c end with smaller numbers.
FIG4 = ".....b......", ".....b......", "AAAAAAAddddd", "........c...", ".........c.."


def on_skeleton(fish):
    """Every pixel of its branches, in turn; those of a joint are counted once."""
    joints = [branch.path[1:] for branch in fish[1:]]
    return np.concatenate([fish[0].path, *joints])


@pytest.mark.parametrize("turns", range(4))
def test_numbers_grow_along_branches_and_the_greatest_is_kept(turns):
    letters = np.rot90([*map(list, FIG4)], turns)
    skeleton = letters != "."
    first, *others = branches = find_branches(skeleton)
    x, y = first.path.T
    assert set(letters[y, x]) == {"A", "d"} and first.numbers.tolist() == list(range(12))
    assert {letters[y, x] for one in others for x, y in one.path[1:]} == {"b", "c"}
    assert len(others) == 2
    for one in branches:
        assert np.diff(one.numbers).tolist() == [1] * (len(one.numbers) - 1)
        assert np.abs(np.diff(one.path, axis=0)).max() == 1
        assert one.numbers[-1] <= first.numbers[-1]
    pixels = on_skeleton(branches)
    assert sorted(map(tuple, pixels)) == sorted(map(tuple, np.argwhere(skeleton)[:, ::-1]))
    number = number_pixels(skeleton, tuple(first.path[0]))
    joint = number[tuple(others[0].path[0, ::-1])]
    after = [number[tuple(p[::-1])] for p in (first.path[joint + 1], others[0].path[1])]
    assert after == [joint + 1] * 2  # both branches of a joint go on with the same number


def test_pixels_that_are_not_connected_have_no_number():
    skeleton = np.zeros((3, 9), bool)
    skeleton[1, [1, 2, 3, 6, 7]] = True
    assert number_pixels(skeleton, (1, 1))[1].tolist() == [-1, 0, 1, 2, -1, -1, -1, -1, -1]
    (alone,) = find_branches(skeleton[:, 5:7])
    assert alone.numbers.tolist() == [0]


def thin_one_fish(picture, tank=None):
    """The one fish of a picture, as Figs. 3 and 4 have it."""
    tank = np.full(SIZE, 150, np.uint8) if tank is None else tank
    typical = TypicalFish(660.0, 2 * LONG, 110.0, "all")
    arena = np.full(picture.shape, 255, np.uint8)
    (fish,) = thin_fish(picture, "frame 1", scene_of(tank), typical, arena, SETTINGS)
    return fish


def with_open_fin(length=40):
    """A fish, and pale and thin a fin that is longer than the rest of the fish before it."""
    fin = np.zeros(SIZE, np.uint8)
    cv2.line(fin, (92, 60), (92, 60 - length), 1, 3)
    return lay_over(lay_over(np.full(SIZE, 150, np.uint8), fin, 135), coverage(80, 60), 40)


def test_the_papers_rule_keeps_an_open_fin_and_the_weighted_one_the_body():
    fish = thin_one_fish(with_open_fin())
    assert len(fish.side_branches) == 1 and fish.body_ends == 2
    paper, ours = fish.branches[0].path, fish.kept
    beside = ~cv2.dilate(fish.body.astype(np.uint8), np.ones((3, 3))).astype(bool)

    def outside(path):
        return beside[path[:, 1], path[:, 0]].sum()

    assert outside(paper) > 20 and outside(ours) == 0
    assert fish.difference_px > 30
    assert np.ptp(fish.backbone[:, 0]) == pytest.approx(2 * LONG, abs=2)
    assert np.ptp(fish.backbone[:, 1]) < 3
    short = thin_one_fish(with_open_fin(18))  # shorter than the head: both rules keep the body
    assert len(short.side_branches) == 1 and short.difference_px == 0
    plain = thin_one_fish(with_open_fin(0))
    assert not plain.side_branches and plain.difference_px == 0


def test_two_fish_are_chosen_by_their_branches_and_by_what_the_rules_keep():
    long, short, plain = (thin_one_fish(with_open_fin(length)) for length in (40, 18, 0))
    chosen, words = choose_fish_to_draw([plain, long, short, plain])
    assert chosen == [long]  # the most branched one is the one of the greatest difference
    assert "4 fish" in words and "2 have a side branch" in words and "differ for 1" in words
    many = short._replace(branches=[*short.branches, *short.side_branches])
    assert choose_fish_to_draw([plain, long, many])[0] == [many, long]
    assert choose_fish_to_draw([plain])[0] == [plain]


def test_the_picture_shows_the_numbers_of_every_end():
    fish = thin_one_fish(with_open_fin())
    (part,) = figure3_4([fish], "words").subfigs
    numbered = part.axes[2]
    shown = [text.get_text() for text in numbered.texts]
    first, side = fish.branches[0].numbers, fish.side_branches[0].numbers
    assert shown == ["A 0", f"D {first[-1]}", str(side[-1]), str(side[0])]
    assert first[-1] > side[-1] > side[0] > 0
    for text, place in zip(numbered.texts, (first[0], first[-1]), strict=False):
        assert tuple(text.xy) == tuple(fish.branches[0].path[place])
    none, words = choose_fish_to_draw([])
    assert "no isolated fish" in figure3_4(none, words).texts[0].get_text()


def test_a_fish_that_stands_is_laid_down():
    lying = thin_one_fish(with_open_fin())
    assert turn_horizontal(lying) is lying
    standing = thin_one_fish(np.rot90(with_open_fin()).copy(), np.full(SIZE[::-1], 150, np.uint8))
    fish = turn_horizontal(standing)
    assert fish.film.shape == fish.whole.shape == standing.whole.shape[::-1]
    for points in (fish.kept, on_skeleton(fish.branches)):
        assert fish.skeleton[points[:, 1], points[:, 0]].all()
    assert (fish.film[fish.body] < 120).all()
    x, y = fish.backbone.round().astype(int).T
    assert fish.whole[y[1:-1], x[1:-1]].all()


# -- the stage ----------------------------------------------------------------------------------


MADE = ["background.png", "cutouts.arrow", "films.csv", "findings.csv", "grain.mp4", "scene.json",
        "tracks.parquet"]  # fmt: skip


extract_run = stage_run("plots-film")


@pytest.fixture(scope="module")
def walk_run(tmp_path_factory):
    """A folder in which the stage has run on the small toy fish that swims across."""
    folder = tmp_path_factory.mktemp("walked")
    prepare(folder, *TINY_CARP)
    put_clip(folder, walk(24))
    with chdir(folder):
        stages.extract.main()
    return folder


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """An empty folder to work in, with default parameters, and without further processes."""
    prepare(tmp_path, *TINY_CARP)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_stage_makes_its_files(extract_run):
    data = extract_run / "data/extract"
    assert list(content(data)) == MADE
    assert list(content(extract_run / "reports/extract")) == ["metrics.json"]
    drawn = content(extract_run / "reports/film/extract")
    assert list(drawn) == ["detections.png", "fig3_4.png"]
    facts = load_record(data / "scene.json", SceneFacts, "extract")
    table = load_table(data / "tracks.parquet", tracks_schema(facts.points))
    with open_cutouts(data / "cutouts.arrow") as store:
        assert store.index[["track_id", "frame"]].equals(table[["track_id", "frame"]])
        assert set(store.index["channels"]) == {2}
    metrics = load_numbers(extract_run / "reports/extract")
    assert metrics["fish_frames"] == metrics["silhouettes_fish"] == len(table) == 100
    assert metrics["tracks"] == metrics["tracks_of_60_frames"] == 1
    assert metrics["longest_track_frames"] == metrics["fish_frames_in_tracks_of_60_frames"] == 100
    assert metrics["noise_grey"] == pytest.approx(facts.noise_grey, rel=5e-4)
    assert metrics["typical_length_px"] == pytest.approx(70, rel=0.03)
    pictures = [picture.astype(float) for picture in read_frames(data / "grain.mp4")]
    assert len(pictures) == 100
    change = np.stack(pictures) - load_picture(data / "background.png")
    assert np.abs(change).max() < 20  # the animal, which is 90 darker, is in none of them
    assert metrics["tank_grain_grey"] == pytest.approx(change.std(), rel=0.2)


def test_cutouts_over_the_background_are_the_film(extract_run):
    data = extract_run / "data/extract"
    background = load_picture(data / "background.png")
    frames = list(read_frames(extract_run / "data/clip/clip.mp4"))
    with open_cutouts(data / "cutouts.arrow") as store:
        for row in (0, 40, 89):
            cutout = store[row]
            h, w = cutout.pixels.shape[:2]
            y0, x0 = cutout.y0_px, cutout.x0_px
            true = frames[cutout.frame][y0 : y0 + h, x0 : x0 + w].astype(int)
            off = np.abs(cutout.blend_over(background) - true)
            inside = cutout.pixels[..., -1] == 255
            assert off[inside].max() == 0
            assert off.mean() < 4  # around the fish there is noise, and its shadow


def test_the_same_bytes_with_any_number_of_threads(walk_run, workspace, monkeypatch):
    put_clip(workspace, walk(24))
    monkeypatch.setattr(stages.cluster, "THREADS", 3)
    stages.extract.main()
    assert content(workspace / "data/extract") == content(walk_run / "data/extract")


def test_colour_film_has_colour_cutouts_and_tracks_end_at_cuts(workspace):
    put_clip(workspace, walk(24, colour=True), cuts=[11])
    stages.extract.main()
    with open_cutouts(workspace / "data/extract/cutouts.arrow") as store:
        assert len(store) == 24
        assert set(store.index["channels"]) == {4}
    assert load_picture(workspace / "data/extract/background.png").shape == (*SIZE, 3)
    table = load_table(workspace / "data/extract/tracks.parquet", tracks_schema(33))
    spans = table.groupby("track_id")["frame"].agg(["min", "max"]).to_numpy().tolist()
    assert spans == [[0, 10], [11, 23]]
    stages.features.main()


@pytest.mark.parametrize("background", ["median", "threshold", "mog2"])
def test_every_background_finds_the_fish(workspace, background):
    prepare(workspace, *TINY_CARP, f"extract.background={background}")
    put_clip(workspace, walk(30), rate=5)
    stages.extract.main()
    metrics = load_numbers(workspace / "reports/extract")
    assert metrics["fish_frames"] >= 28
    assert metrics["tracks"] == 1
    assert metrics["typical_length_px"] == pytest.approx(24, rel=0.06)


def test_only_the_arena_counts(workspace):
    arena = np.zeros(SIZE, bool)
    arena[:, 60:] = True
    put_clip(workspace, walk(26), arena=arena)
    stages.extract.main()
    table = load_table(workspace / "data/extract/tracks.parquet", tracks_schema(33))
    assert table["backbone_x_px"].map(min).min() > 60
    assert 5 <= len(table) < 20


# -- bad clips ------------------------------------------------------------------------------------


def walk(frames, colour=False, y=60):
    """A small toy fish that swims from left to right: nowhere long enough to be taken for tank."""
    tank = np.full((*SIZE, 3) if colour else SIZE, 150, np.uint8)
    ink = [30, 60, 40] if colour else 40
    places = np.linspace(20, 140, frames)
    return [lay_over(tank, coverage(x, y, long=12, wide=4), ink) for x in places]


def bring_run(run, workspace):
    """Copy all that a run has made; return what `assert_as_before` compares."""
    for made in ("data", "reports"):
        shutil.copytree(run / made, workspace / made)
    return content(workspace / "data/extract"), content(workspace / "reports")


def assert_as_before(workspace, old):
    """Nothing has changed, and nothing half-made lies about."""
    assert (content(workspace / "data/extract"), content(workspace / "reports")) == old
    assert {path.name for path in (workspace / "data").iterdir()} == {"clip", "extract"}


def filling():
    tank = np.full(SIZE, 150, np.uint8)
    places = np.linspace(-90, 250, 24)
    return [lay_over(tank, coverage(x, 60, long=60, wide=80), 40) for x in places]


def flickering_walk():
    """Seen now and then, for a few frames."""
    empty = np.full(SIZE, 150, np.uint8)
    return [frame if k % 8 < 4 else empty for k, frame in enumerate(walk(27))]


def noise():
    rng = np.random.default_rng(7)
    return [np.round(rng.normal(128, 9, SIZE)).astype(np.uint8) for _ in range(24)]


BLACK = [np.zeros(SIZE, np.uint8)] * 24
NO_FISH = {
    "a single frame": (lambda: walk(1), [], "could be followed for 10 frames"),
    "black": (lambda: BLACK, [], "nothing differs"),
    "black, with a threshold": (
        lambda: BLACK, ["extract.background=threshold"], "every pixel of the clip has the value 0",
    ),
    "noise": (noise, [], "nothing differs"),
    "always at the border": (lambda: walk(24, y=2), [], "touch the edge"),
    "filling the frame": (filling, [], "touch the edge"),
    "of the wrong polarity": (lambda: walk(24), ["extract.polarity=bright"], "nothing differs"),
    "never long in sight": (flickering_walk, [], "could be followed for 10 frames"),
    "too few frames": (lambda: walk(9), [], "could be followed for 10 frames"),
}  # fmt: skip


@pytest.mark.parametrize("case", NO_FISH)
def test_no_fish_is_one_message_and_no_half_output(workspace, walk_run, case):
    make, overrides, said = NO_FISH[case]
    old = bring_run(walk_run, workspace)
    prepare(workspace, *TINY_CARP, *overrides)
    put_clip(workspace, make())
    with pytest.raises(FinloopError, match=said) as caught:
        stages.extract.main()
    assert "extract." in caught.value.do or "clip" in caught.value.do
    assert_as_before(workspace, old)


def damage(clip, harm):
    film, facts = clip / "clip.mp4", clip / "facts.json"
    match harm.split():
        case ["no", name]:
            (clip / name).unlink()
        case ["cut", "short"]:
            film.write_bytes(film.read_bytes()[: film.stat().st_size // 2])
        case ["empty"]:
            film.write_bytes(b"")
        case ["text"]:
            film.write_text("no film\n" * 99)
        case ["other", "facts"]:
            facts.write_text(facts.read_text().replace('"frames": 24', '"frames": 48'))
        case ["other", "arena"]:
            cv2.imwrite(str(clip / "arena.png"), np.full((9, 9), 255, np.uint8))


@pytest.mark.parametrize(
    "harm",
    ["no clip.mp4", "no facts.json", "no arena.png", "cut short", "empty", "text", "other facts",
     "other arena"],
)  # fmt: skip
def test_a_damaged_clip_is_one_message_and_no_half_output(workspace, walk_run, harm):
    old = bring_run(walk_run, workspace)
    damage(workspace / "data/clip", harm)
    with pytest.raises(FinloopError, match="data/clip") as caught:
        stages.extract.main()
    assert caught.value.do
    assert_as_before(workspace, old)


@pytest.mark.parametrize("where", ["film.track_table_rows", "save_record"])
def test_whatever_stops_the_stage_leaves_what_was_there(workspace, walk_run, monkeypatch, where):
    old = bring_run(walk_run, workspace)
    for error, said in (
        (OSError(28, "No space left on device"), "disk is full"), (KeyboardInterrupt("^C"), "^C"),
    ):  # fmt: skip
        monkeypatch.setattr(f"finloop.extract.write.{where}", Mock(side_effect=error))
        with pytest.raises((FinloopError, KeyboardInterrupt)) as caught:
            stages.extract.main()
        assert said in str(caught.value)
        shutil.rmtree(stages.extract.CHECKPOINTS, ignore_errors=True)
        assert_as_before(workspace, old)
