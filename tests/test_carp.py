"""The drawn carp: laws of its motion, of its picture, and that its truth is what is drawn."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from constants import with_constants
from scipy.spatial.distance import cdist

from finloop.base.settings import settings
from finloop.drawn.carp.draw import blur_drawing, draw_carp
from finloop.drawn.carp.film import (
    carp_motion,
    empty_tank,
    film_frames,
    fish_colours,
    is_tank_large_enough,
    light_levels,
    midline_bend,
    midline_curvature,
    midline_heading,
    midline_px,
)
from finloop.drawn.carp.midline import POINTS, midline_of_pose
from finloop.drawn.carp.motion import angle_share_in_turn, bend_in_turn
from finloop.drawn.carp.skin import FishColours, half_width, paint_fish

SMALL = settings(
    "clip", source="carp", frames=40, width_px=320, height_px=240, body_length_px=60.0, seed=3
)
POSES = [  # amplitude, bend (radians), axis (radians), beat
    (0.0, 0.0, 0.0, 0.0),
    (1.0, 0.0, 0.7, 0.3),
    (0.2, 1.4, -2.0, 0.1),
    (0.3, -2.0, 2.6, 0.6),
]


def carp_line(amplitude, bend, axis, beat, length=110.0):
    return length * midline_of_pose(1.3, 1.2, axis, beat, amplitude, bend)


@pytest.fixture(scope="module")
def carp():
    return paint_fish(np.random.default_rng(0), 480, 0)


@pytest.fixture(scope="module")
def long_films():
    """Four films' motion at the default size and length, with their midlines."""
    films = []
    for seed in range(4):
        params = settings("clip", source="carp", seed=seed)
        poses = carp_motion(params)
        lines = np.array([midline_px(params, poses, k, 0) for k in range(params.frames)])
        films.append((params, poses, lines))
    return films


def sides(line, i):
    """Unit vectors to the left and to the right of a midline at a point."""
    along = line[i - 1] - line[i + 1]
    left = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    return left, -left


# -- signs, by hand -----------------------------------------------------------------------------


def test_a_left_bend_seen_on_screen_has_plus_signs():
    # A quarter circle, drawn by hand. The fish's tail points left, its head up on screen (y down):
    # swimming along it from tail to head it turns from "right" to "up", which is to its left.
    angle = np.linspace(np.pi / 2, 0, POINTS)  # head first
    line = np.column_stack([np.sin(angle), np.cos(angle)])
    assert midline_heading(line) > 45
    assert midline_curvature(line) == pytest.approx(90, abs=2)
    # Quarter circle of radius 1: sector less triangle, over the square of the arc.
    assert midline_bend(line) == pytest.approx((np.pi / 4 - 0.5) / (np.pi / 2) ** 2, rel=1e-3)
    mirrored = line * (1, -1)
    assert midline_bend(mirrored) == pytest.approx(-midline_bend(line))
    assert midline_curvature(mirrored) == pytest.approx(-midline_curvature(line))


@pytest.mark.parametrize(
    ("head", "degrees"), [((1, 0), 0), ((0, -1), 90), ((-1, 0), 180), ((0, 1), -90)]
)
def test_heading_is_anticlockwise_from_screen_right(head, degrees):
    line = np.linspace(head, (0, 0), POINTS)
    assert midline_heading(line) == pytest.approx(degrees)


def test_a_bend_to_the_left_is_asked_for_with_plus():
    line = midline_of_pose(0, 0, 0.4, 0.0, 0.0, np.radians(70))
    assert midline_curvature(line) == pytest.approx(70)
    assert midline_bend(line) > 0.08
    assert midline_heading(line) > np.degrees(0.4)  # the head leads the turn
    assert midline_bend(midline_of_pose(0, 0, 0.4, 0.0, 0.0, 0.0)) == pytest.approx(0, abs=1e-12)


# -- the midline --------------------------------------------------------------------------------


@pytest.mark.parametrize("pose", POSES)
def test_the_midline_does_not_stretch(pose):
    step = np.linalg.norm(np.diff(carp_line(*pose), axis=0), axis=1)
    assert step == pytest.approx(110 / (POINTS - 1), rel=1e-9)


def test_the_wave_grows_to_the_tail_and_runs_there():
    beats = np.linspace(0, 1, 41)[:-1]
    side = np.array([-midline_of_pose(0, 0, 0, b, 1.0, 0.0)[:, 1] for b in beats])
    swing = np.ptp(side, axis=0) / 2
    assert 0.08 < swing[-1] < 0.13  # a carp's tail: about 0.1 body lengths
    assert swing[:22].max() < 0.03 < swing[-8:].min()
    phase = np.unwrap(np.angle([np.fft.rfft(side[:, i])[1] for i in range(36, 65)]))
    assert np.all(np.diff(phase) < 0)  # later and later towards the tail


def test_a_turn_goes_one_way_and_ends_straight():
    tau = np.linspace(0, 1, 200)
    progress = np.array([angle_share_in_turn(t) for t in tau])
    bend = np.array([bend_in_turn(t) for t in tau])
    assert progress[0] == 0 and progress[-1] == 1 and np.all(np.diff(progress) >= 0)
    assert bend[0] == 0 and bend[-1] == 0 and bend.max() == pytest.approx(1)
    assert np.all(bend >= 0)


# -- the picture is what the truth says ---------------------------------------------------------


@pytest.mark.parametrize("pose", POSES)
def test_the_silhouette_ends_with_the_midline_and_is_as_wide_as_the_profile(
    pose, carp, monkeypatch
):
    line = carp_line(*pose)
    # Finely drawn, so that the outline can be walked to a tenth of a pixel.
    monkeypatch.setattr("finloop.drawn.carp.draw.OVERSAMPLE", 1)
    cut = draw_carp(line * 8, (0.0, 0.0), carp)
    inside = cut.coverage > 0.5
    for end, before in ((0, 2), (-1, -3)):
        out = (line[end] - line[before]) / np.linalg.norm(line[end] - line[before])
        walk = line[end] + np.linspace(-3, 3, 241)[:, None] * out
        x, y = np.rint(walk * 8 - (cut.x0, cut.y0)).astype(int).T
        last = np.flatnonzero(inside[y, x]).max()
        assert np.linspace(-3, 3, 241)[last] == pytest.approx(0, abs=0.2)
    off = np.linspace(0, 12, 481)
    for i in (6, 20, 32, 45, 58):
        for side in sides(line, i):
            x, y = np.rint((line[i] + off[:, None] * side) * 8 - (cut.x0, cut.y0)).astype(int).T
            edge = off[np.argmin(inside[y, x])]
            assert edge == pytest.approx(110 * half_width(np.array([i / 64]))[0], abs=0.25)


def test_the_area_is_the_integral_of_the_width(carp):
    straight = draw_carp(carp_line(*POSES[0]), (0.0, 0.0), carp)
    s = np.linspace(0, 1, 4001)
    wanted = 2 * 110**2 * np.trapezoid(half_width(s), s)
    assert straight.area_px() == pytest.approx(wanted, rel=0.005)


def test_truth_is_taken_from_the_coverage(carp):
    params = replace(SMALL, frames=3, fins_open_ratio=1.0)
    poses, skins = carp_motion(params), fish_colours(params)
    for number, (_, rows) in enumerate(film_frames(params)):
        row = rows[0]
        line = midline_px(params, poses, number, 0)
        left, right = poses.fins[number, 0]
        cut = draw_carp(line, (float(left), float(right)), skins[0])
        y, x = np.mgrid[: cut.coverage.shape[0], : cut.coverage.shape[1]]
        assert row["mask_area_px"] == pytest.approx(cut.coverage.sum(), rel=1e-5)
        assert row["x_px"] == pytest.approx(np.average(x, weights=cut.coverage) + cut.x0, abs=1e-3)
        assert row["y_px"] == pytest.approx(np.average(y, weights=cut.coverage) + cut.y0, abs=1e-3)
        assert (row["head_x_px"], row["head_y_px"]) == tuple(line[0])
        assert (row["tail_x_px"], row["tail_y_px"]) == tuple(line[-1])
        assert row["backbone_x_px"] == pytest.approx(line[:, 0], abs=1e-4)
        assert row["body_length_px"] == pytest.approx(60)


def test_the_fish_in_the_frame_lies_where_the_truth_says():
    # Without noise, drift and shadow whatever differs from the empty floor is the fish: find it in
    # the finished frames. Nearly opaque, so its darkness weighs almost like its coverage.
    params = with_constants(
        SMALL, frames=30, noise_grey=0.0, light_drift=0.0, shadow=0.0, fins_open_ratio=0.0,
        colour=False,
    )  # fmt: skip
    floor = empty_tank(params)[..., 0]
    for picture, rows in list(film_frames(params))[::3]:
        dark = floor - picture > 45
        y, x = np.nonzero(dark)
        assert x.mean() == pytest.approx(rows[0]["x_px"], abs=0.6)
        assert y.mean() == pytest.approx(rows[0]["y_px"], abs=0.6)
        assert dark.sum() == pytest.approx(rows[0]["mask_area_px"], rel=0.12)


def test_a_mirrored_pose_is_a_mirrored_silhouette(carp):
    line = carp_line(0.4, 1.0, 0.0, 0.2)
    mirror = line * (1, -1) + (0, 300)
    one, other = draw_carp(line, (1.0, 0.3), carp), draw_carp(mirror, (0.3, 1.0), carp)
    (x, y), (mx, my) = one.centre_px(), other.centre_px()
    assert (mx, my) == pytest.approx((x, 300 - y), abs=0.02)
    assert other.area_px() == pytest.approx(one.area_px(), rel=2e-3)


def test_open_fins_add_to_the_silhouette_and_are_see_through(carp):
    line = carp_line(*POSES[0])
    shut, open_ = draw_carp(line, (0.0, 0.0), carp), draw_carp(line, (1.0, 1.0), carp)
    assert open_.area_px() > 1.1 * shut.area_px()
    beside = [np.flatnonzero(cut.coverage.max(axis=1) > 0.5) for cut in (shut, open_)]
    assert np.ptp(beside[0]) == pytest.approx(2 * 0.09 * 110, abs=2)
    assert np.ptp(beside[1]) > 0.40 * 110  # they stand off to both sides
    web = (open_.coverage > 0.99) & (open_.opacity < 0.8)
    assert web.sum() > 80 and open_.opacity[web].min() > 0.15


@pytest.mark.parametrize("pose", POSES)
def test_the_skin_sticks_to_the_body(pose, monkeypatch):
    # A skin that says where it is: red = place along the body, green = 200 on the left, else 20.
    rows, columns = 120, 480
    skin = np.ones((rows, columns, 4), np.float32)
    skin[..., 0] = 200 * (np.arange(columns) + 0.5) / columns
    skin[..., 1] = np.where(np.arange(rows)[:, None] < rows // 2, 200, 20)
    marked = FishColours(skin, np.zeros((8, 8, 5), np.float32))
    line = carp_line(*pose, length=330)
    monkeypatch.setattr("finloop.drawn.carp.draw.LIGHT", (0.0, 0.0))
    monkeypatch.setattr("finloop.drawn.carp.draw.GLOSS", 0.0)
    cut = draw_carp(line, (0.0, 0.0), marked)
    for i in (8, 24, 40, 50):
        for side, green in zip(sides(line, i), (200, 20), strict=True):
            x, y = line[i] + 6 * side - (cut.x0, cut.y0)
            red_seen, green_seen, _ = cut.colour[round(y), round(x)]
            assert red_seen == pytest.approx(200 * i / 64, abs=0.8)
            assert green_seen == pytest.approx(green, abs=1)


# -- the swimming -------------------------------------------------------------------------------


def test_it_swims_without_jumps_and_stays_in_the_tank(long_films):
    for params, poses, lines in long_films:
        assert lines.min() > 10
        assert lines[..., 0].max() < params.width_px - 11
        assert lines[..., 1].max() < params.height_px - 11
        step = np.hypot(np.diff(poses.x[:, 0]), np.diff(poses.y[:, 0]))
        assert step.max() < 3.0 / params.frame_rate_hz  # at most 3 body lengths a second
        assert np.median(step) > 0.4 / params.frame_rate_hz
        assert np.abs(np.diff(step)).max() < 0.02  # nor does the speed jump
        assert np.abs(np.diff(lines, axis=0)).max() < 0.35 * params.body_length_px


@pytest.mark.parametrize("seed", range(2))
def test_it_stays_in_a_small_tank(seed):
    params = settings(
        "clip", source="carp", frames=1000, fish=2, width_px=190, height_px=300,
        body_length_px=60.0, seed=seed,
    )  # fmt: skip
    assert is_tank_large_enough(params)
    poses = carp_motion(params)
    lines = np.array([[midline_px(params, poses, k, i) for i in (0, 1)] for k in range(0, 1000, 2)])
    assert lines.min() > 2 + 0.02 * 60
    assert lines[..., 0].max() < 187 and lines[..., 1].max() < 297


def test_it_turns_both_ways_a_fifth_of_the_time(long_films):
    kinds = np.array([poses.swimming_type[:, 0] for _, poses, _ in long_films])
    assert set(np.unique(kinds)) == {-1, 0, 1}
    share = (kinds != 0).mean(axis=1)
    assert np.all(share > 0.10) and np.all(share < 0.26)
    assert 0.15 <= share.mean() <= 0.25
    assert np.all((kinds > 0).mean(axis=1) > 0.03) and np.all((kinds < 0).mean(axis=1) > 0.03)


def test_the_swimming_type_is_that_of_the_turn(long_films):
    angles, bends = [], []
    for params, poses, lines in long_films:
        kind = poses.swimming_type[:, 0].astype(int)
        axis = np.degrees(np.unwrap(poses.axis[:, 0]))
        heading = np.unwrap([midline_heading(line) for line in lines], period=360)
        bend = np.array([midline_bend(line) for line in lines])
        still = zip(poses.axis[:, 0], poses.bend[:, 0], strict=True)  # without a tail beat
        unbeaten = [midline_heading(midline_of_pose(0, 0, a, 0, 0, b)) for a, b in still]
        unbeaten = np.unwrap(unbeaten, period=360)
        edges = np.flatnonzero(np.diff(kind)) + 1
        for start, stop in pairwise(edges):
            sign = kind[start]
            if sign == 0:
                rate = np.diff(unbeaten[start:stop]) * params.frame_rate_hz
                assert np.all(np.abs(rate) < 45)  # nobody could call this a turn
                assert np.degrees(np.abs(poses.bend[start:stop])).max() < 10
                continue
            assert 5 <= stop - start <= 40
            # It is seen from the first frame to the last: the head turns or the body is bent.
            rate = np.abs(np.diff(unbeaten[start - 1 : stop + 1])) * params.frame_rate_hz
            seen = np.maximum(rate[:-1], rate[1:]) > 20
            assert np.all(seen | (np.degrees(np.abs(poses.bend[start:stop, 0])) > 8))
            # The heading rises in a left turn, and the body bends to the left at its height.
            assert sign * (axis[stop] - axis[start - 1]) > 18
            assert sign * (heading[stop] - heading[start - 1]) > 5
            assert sign * bend[(start + stop) // 2 - 1] > 0
            angles.append(abs(axis[stop] - axis[start - 1]))
            bends.append(np.abs(bend[start:stop]).max())
    assert len(angles) > 60
    assert min(angles) < 50 and 120 < max(angles) < 156
    assert np.corrcoef(angles, bends)[0, 1] > 0.6  # wide turns bend the body more


def test_it_speeds_up_and_glides(long_films):
    steps = [np.diff([poses.x[:, 0], poses.y[:, 0]]) for _, poses, _ in long_films]
    speeds = np.concatenate([np.hypot(*step) for step in steps]) * long_films[0][0].frame_rate_hz
    beating = np.concatenate([poses.amplitude[:, 0] for _, poses, _ in long_films])
    assert np.quantile(speeds, 0.99) > 1.5 and np.quantile(speeds, 0.05) < 0.6
    assert (beating < 0.25).mean() > 0.15 and (beating > 0.7).mean() > 0.3


@pytest.mark.parametrize("fins", [0.0, 0.3, 1.0])
def test_fins_are_open_the_asked_share_of_the_time(fins):
    poses = carp_motion(settings("clip", source="carp", frames=3000, fins_open_ratio=fins, seed=5))
    assert (poses.fins[100:] > 0.5).mean() == pytest.approx(fins, abs=0.08)


def test_several_fish_never_touch():
    fish = 8
    params = settings("clip", source="carp", frames=120, fish=fish, seed=2)
    assert is_tank_large_enough(params)
    poses, skins = carp_motion(params), fish_colours(params)
    clear = np.inf
    whose = np.repeat(np.arange(fish), len(range(0, POINTS, 2)))
    others = whose[:, None] != whose
    for number in range(0, params.frames, 3):
        lines = [midline_px(params, poses, number, i) for i in range(fish)]
        points = np.concatenate([line[::2] for line in lines])
        clear = min(clear, cdist(points, points)[others].min())
        if number % 60 == 0:
            seen = np.zeros((params.height_px, params.width_px))
            for line, skin in zip(lines, skins, strict=True):
                cut = draw_carp(line, (1.0, 1.0), skin)
                y, x = np.nonzero(cut.coverage)
                y, x = y + cut.y0, x + cut.x0
                assert min(y.min(), x.min()) >= 0
                seen[y, x] += 1
            assert seen.max() == 1
    assert 20 < clear < 300  # no two skins (20 px wide) touch, yet they do meet


def test_a_tank_that_is_too_small_is_known():
    assert is_tank_large_enough(settings("clip", source="carp"))
    assert not is_tank_large_enough(replace(SMALL, body_length_px=150.0))
    assert not is_tank_large_enough(settings("clip", source="carp", fish=60))


# -- the film -----------------------------------------------------------------------------------


def test_the_seed_decides_everything_and_nothing_else_does():
    short, longer = (list(film_frames(replace(SMALL, frames=frames))) for frames in (5, 9))
    other = list(film_frames(replace(SMALL, frames=5, seed=4)))
    for (a, rows_a), (b, rows_b) in zip(short, longer, strict=False):
        assert np.array_equal(a, b)
        for row_a, row_b in zip(rows_a, rows_b, strict=True):
            assert all(np.array_equal(row_a[key], row_b[key]) for key in row_a)
    assert not np.array_equal(short[0][0], other[0][0])
    assert short[0][1][0]["x_px"] != other[0][1][0]["x_px"]
    harsh = with_constants(SMALL, frames=5, noise_grey=9.0, light_drift=0.2)
    rough = [rows[0]["x_px"] for _, rows in film_frames(harsh)]
    assert rough == [rows[0]["x_px"] for _, rows in short]


@pytest.mark.parametrize("colour", [True, False])
@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_noise_is_as_strong_as_asked(noise, colour):
    params = with_constants(
        SMALL, frames=24, noise_grey=noise, light_drift=0.0, shadow=0.0, colour=colour
    )
    frames = np.array([picture for picture, _ in film_frames(params)], np.float64)
    if colour:
        frames = frames @ (0.299, 0.587, 0.114)
    spread = np.sqrt(frames[:, :4].var(axis=0, ddof=1).mean())  # no fish comes so near the wall
    rounding = np.sqrt((1 / 12) * (np.square((0.299, 0.587, 0.114)).sum() if colour else 1))
    rounding *= noise > 0
    assert spread == pytest.approx(np.hypot(noise, rounding), rel=0.02)


def test_light_drifts_slowly_and_as_far_as_asked():
    params = with_constants(settings("clip", source="carp"), light_drift=0.1)
    lamp = light_levels(params)
    assert 0.05 < np.abs(lamp - 1).max() <= 0.1
    assert np.abs(np.diff(lamp)).max() < 0.002
    assert np.array_equal(light_levels(with_constants(params, light_drift=0.0)), np.ones(1500))
    slow = with_constants(SMALL, frame_rate_hz=2.0, noise_grey=0.0, light_drift=0.1, frames=30)
    seen = np.array([np.median(picture) for picture, _ in film_frames(slow)])
    assert seen / seen[0] == pytest.approx(light_levels(slow) / light_levels(slow)[0], abs=0.02)


def test_the_fish_stands_out_from_the_floor_and_its_shadow_less():
    slow = 12.5  # half the frames of the same way
    params = with_constants(
        SMALL, frames=8, frame_rate_hz=slow, noise_grey=0.0, light_drift=0.0, fins_open_ratio=0.0,
        colour=False,
    )  # fmt: skip
    for seed in range(2):
        params = replace(params, seed=seed)
        frames, truth = zip(*film_frames(params), strict=True)
        floor = empty_tank(params)[..., 0]
        poses, skins = carp_motion(params), fish_colours(params)
        for number in (0, 4, 7):
            line = midline_px(params, poses, number, 0)
            cut = draw_carp(line, (0.0, 0.0), skins[0])
            rows, columns = cut.coverage.shape
            window = np.s_[cut.y0 : cut.y0 + rows, cut.x0 : cut.x0 + columns]
            darker = floor[window] - frames[number][window]
            assert np.quantile(darker[cut.coverage > 0.99], 0.05) > 35
            assert truth[number][0]["mask_area_px"] == pytest.approx(cut.area_px())
            shade = darker[blur_drawing(cut)[1] < 1e-3]
            assert 8 < shade.max() < 40
