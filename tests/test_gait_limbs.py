"""Limb contours from regions: sub-pixel contours, points that belong together, body frame."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from toy_dog import fill, true_masks

from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, area_centroids, signed_area
from finloop.drawn.dog.walk import (
    NAMES,
    DogFilm,
    frame_phases,
    standing_points_px,
    true_limb_contours,
)
from finloop.gait.limbs import (
    BORDER,
    EMPTY,
    limb_contours,
    match_contours,
    region_contour,
    smooth_track,
)
from finloop.gait.truth import true_gamma

DOG = DogFilm(frames=32, frame_rate_hz=16.0, cycles=2.0, width_px=240, height_px=160, trunk_px=85.0)


def egg(n=400, angle=0.0, at=(0.0, 0.0), start=0):
    """A shape with no symmetry, turned, moved, and begun elsewhere; clockwise."""
    t = 2 * np.pi * (np.arange(n) + start) / n
    z = 20 * np.exp(1j * t) + 5 * np.exp(-1j * t) + 2 * np.exp(2j * t) + 1.5j * np.exp(-2j * t)
    z = z * np.exp(1j * angle) + complex(*at)
    return Curve(np.column_stack([z.real, z.imag]), True)


@pytest.fixture(scope="module")
def regions():
    return [
        {name: region_contour(mask) for name, mask in true_masks(DOG, k).items()}
        for k in range(DOG.frames)
    ]


@pytest.fixture(scope="module")
def whole(regions):
    return limb_contours(regions, 64, 16)


@pytest.mark.parametrize("middle", [(30.0, 30.0), (30.4, 29.7)])
def test_the_contour_of_a_disc_is_a_circle_to_a_tenth_of_a_pixel(middle):
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    disc = 18 * np.column_stack([np.cos(angle), np.sin(angle)]) + middle
    found = region_contour(fill(disc, 60, 60))
    radius = np.linalg.norm(found.points - middle, axis=1)
    assert radius.mean() == pytest.approx(18, abs=0.1)
    assert radius.std() < 0.15
    assert signed_area(found) > 0
    assert area_centroids(found.points) == pytest.approx(middle, abs=0.1)


def test_of_several_parts_the_largest_counts_and_its_holes_do_not():
    mask = np.zeros((50, 60), bool)
    mask[10:40, 10:40] = True
    mask[20:25, 20:25] = False
    mask[5:9, 50:55] = True
    found = region_contour(mask)
    assert found.points[:, 0].max() == pytest.approx(39.5, abs=0.1)
    assert signed_area(found) == pytest.approx(900, rel=0.02)
    mask[:] = False
    mask[5, 5] = True
    assert region_contour(mask) == EMPTY
    mask[30:, 10:20] = True
    assert region_contour(mask) == BORDER


def test_points_belong_together_however_a_contour_is_turned_moved_and_begun():
    given = [egg(angle=0.4 * np.sin(k), at=(3 * k, -k), start=37 * k) for k in range(12)]
    found = match_contours(given, 32)
    back = [
        ((points - area_centroids(points)) @ [1, 1j]) * np.exp(-0.4j * np.sin(k))
        for k, points in enumerate(found)
    ]
    # The grid in which starts are sought is 1/16 of the distance of two points.
    grid = 130 / 32 / 16
    assert max(np.abs(one - back[0]).max() for one in back) < grid


def test_a_contour_the_other_way_round_and_a_gap_change_nothing_else():
    given = [egg(angle=0.1 * k) for k in range(6)]
    there = match_contours(given, 32)
    given[2] = Curve(given[2].points[::-1].copy(), True)
    given[4] = "not there"
    found = match_contours(given, 32)
    assert np.isnan(found[4]).all()
    rest = [0, 1, 2, 3, 5]
    assert found[rest] == pytest.approx(there[rest], abs=0.3)


def test_a_leg_that_swings_far_is_never_taken_upside_down():
    # Its ends look alike, and it bends either way: upside down it fits best where it bends back.
    t = 2 * np.pi * np.arange(400) / 400
    given, feet = [], []
    for k in range(15):
        swing = np.pi / 2 - 1.13 * np.cos(2 * np.pi * k / 15)
        bend = 0.01 * np.sin(2 * np.pi * k / 15)
        leg = 30 * np.cos(t) + 1j * (7 * np.sin(t) + bend * (30 * np.cos(t)) ** 2)
        leg = np.append(leg, 0) * np.exp(1j * swing)
        given.append(Curve(np.column_stack([leg[:-1].real, leg[:-1].imag]), True))
        feet.append([leg[0].real, leg[0].imag])
    found = match_contours(given, 64)
    foot = np.linalg.norm(found - np.array(feet)[:, None], axis=2).argmin(axis=1)
    assert np.ptp(foot) <= 8


def test_points_do_not_drift_in_a_long_film():
    # Twenty turns of a shape that swells and shrinks: the last as the first.
    given = [
        Curve(egg(start=3 * k).points * [1, 1 + 0.2 * np.sin(k * np.pi / 5)], True)
        for k in range(200)
    ]
    found = match_contours(given, 32)
    assert found[190] == pytest.approx(found[0], abs=0.3)


def test_smoothing_takes_away_the_sway_and_keeps_a_steady_course():
    at = np.arange(70.0)
    course = np.column_stack([3 + 0.7 * at, 40 - 0.1 * at])
    assert smooth_track(course, 14) == pytest.approx(course)
    assert smooth_track(course, None) == pytest.approx(course)
    sway = np.column_stack([2 * np.sin(2 * np.pi * at / 14), np.cos(4 * np.pi * at / 14)])
    assert smooth_track(course + sway, 14) == pytest.approx(course, abs=0.02)
    assert smooth_track(course + sway, 13.6) == pytest.approx(course, abs=0.25)
    bend = np.column_stack([0.01 * at**2, at])
    assert smooth_track(bend, 14)[20:50] == pytest.approx(bend[20:50], abs=0.2)


def test_limbs_of_the_drawn_dog_lie_on_its_exact_contours(whole):
    assert set(whole.points) == set(NAMES)
    assert whole.notes == ()
    exact = true_limb_contours(DOG, 512)
    for name in NAMES:
        for k in range(0, DOG.frames, 6):
            here = whole.points[name][k] + whole.course[k]
            far, _ = cKDTree(exact[name][k] + standing_points_px(DOG)[k]).query(here)
            assert np.sqrt((far**2).mean()) < 0.25  # px
    assert whole.length_px == pytest.approx(1.52 * DOG.trunk_px, rel=0.02)
    # The course is that of the body but for a constant.
    off = whole.course - standing_points_px(DOG)
    assert np.ptp(off, axis=0) == pytest.approx([0, 0], abs=0.35)


def test_left_and_right_points_belong_together(whole):
    for end in ("fore", "hind"):
        later = np.roll(whole.points[f"{end}_left"], 8, axis=0)
        near = whole.points[f"{end}_right"]
        off = near - later - (near - later).mean(axis=(0, 1))
        assert np.sqrt((off**2).sum(axis=2).mean()) < 0.35  # px


def gamma_of(points, name, which):
    """Least squares, written anew; keys are the mean of the frames at their phases."""
    quarter = np.mod(4 * frame_phases(DOG), 4)
    here, there = (points[name][quarter == which + k].mean(axis=0) for k in (0, 1))
    inside = (quarter > which) & (quarter < which + 1)
    tau = (quarter[inside] - which)[:, None, None]
    way, bow = here - there, tau * (1 - tau)
    return (bow * way * (there + (1 - tau) * way - points[name][inside])).sum() / (
        (bow * way) ** 2
    ).sum()


@pytest.mark.parametrize("with_body", [True, False])
def test_gamma_is_found_again_in_regions_of_whole_pixels(regions, with_body):
    frames = [
        {name: one for name, one in frame.items() if with_body or name != "body"}
        for frame in regions
    ]
    points = limb_contours(frames, 64, 16).points
    exact, wanted = true_limb_contours(DOG, 64), true_gamma(DOG, 64)
    for name in NAMES:
        for which, label in enumerate("AB"):
            true = wanted[name][label]
            assert gamma_of(exact, name, which) == pytest.approx(true, abs=2e-3)
            assert gamma_of(points, name, which) == pytest.approx(true, rel=0.1, abs=0.04)


def test_a_limb_that_some_frames_lack_is_said_and_the_others_stay(regions, whole):
    frames = [dict(frame) for frame in regions]
    del frames[3]["fore_left"]
    frames[4]["fore_left"] = frames[9]["fore_left"] = BORDER
    found = limb_contours(frames, 64, 16)
    (note,) = found.notes
    assert note == (
        "fore_left is left out of frames 3: not there; 4, 9: touches the border of the picture"
    )
    gone = np.isnan(found.points["fore_left"]).all(axis=(1, 2))
    assert np.flatnonzero(gone).tolist() == [3, 4, 9]
    assert found.points["hind_left"] == pytest.approx(whole.points["hind_left"])
    cut = regions[6]["hind_left"].points  # another limb hides a part
    frames = [dict(frame) for frame in regions]
    frames[6]["hind_left"] = Curve(np.minimum(cut, np.median(cut, axis=0)), True)
    (note,) = limb_contours(frames, 64, 16).notes
    assert note.startswith("hind_left is smaller than usual in frames 6:")


def test_regions_without_a_limb_are_refused(regions):
    frames = [dict(frame) for frame in regions]
    frames[7]["fore_lft"] = frames[7].pop("fore_left")
    for given, said in (
        (frames, r"'fore_lft' in frames 0-6, 8-31.*is it fore_left\?"),
        ([{"body": frame["body"]} for frame in regions], "without a limb"),
        ([], "0 frames"),
    ):
        with pytest.raises(FinloopError, match=said):
            limb_contours(given, 64)
