"""The traced horse: every leg in every frame, none exchanged, a cycle that closes; and its tool."""

import cv2
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.horse import FOLDER, Axis, load_axes, svg_text, trace_parts
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, signed_area
from finloop.gait.compare import compare_clocks
from finloop.gait.cycles import walker_gait_contours
from finloop.gait.fit import fit_gait
from finloop.gait.limbs import check_traced_contour, limb_contours, region_contour
from finloop.gait.model import gait_to_record, opposite_limb
from finloop.io.regions import load_regions
from finloop.io.svg import load_svg
from finloop.morph.folds import count_polygon_folds

LEGS = ("fore_left", "fore_right", "hind_left", "hind_right")


@pytest.fixture(scope="module")
def outlines():
    return load_regions(FOLDER, region_contour, check_traced_contour)


@pytest.fixture(scope="module")
def joints():
    """Joints (15, 4, 2) of each leg, from elbow or stifle to the toe."""
    axes = load_axes(FOLDER / "joints.csv")
    return {leg: np.stack([axes[frame][leg].joints_px for frame in axes]) for leg in LEGS}


def inside_px(curve, points):
    """How far inside an outline each point lies, px; negative outside."""
    ring = curve.points.astype(np.float32)
    return [cv2.pointPolygonTest(ring, point, True) for point in points.astype(float)]


def close_path(path):
    """A path through the frames (15, …) of a cycle, back to its first."""
    return np.concatenate([path, path[:1]])


def test_every_frame_shows_the_body_and_every_leg(outlines):
    assert (len(outlines.frames), outlines.first) == (15, 1)
    for frame in outlines.frames:
        assert set(frame) == {"body", *LEGS}
        for curve in frame.values():
            assert isinstance(curve, Curve) and curve.closed
            assert count_polygon_folds(curve.points) == 0


def test_outlines_lie_on_the_joints_and_keep_their_size(outlines, joints):
    for leg, places in joints.items():
        curves = [frame[leg] for frame in outlines.frames]
        worst = [min(inside_px(*pair)) for pair in zip(curves, places, strict=True)]
        assert min(worst) > -5  # a pale toe
        areas = np.array([signed_area(curve) for curve in curves])
        assert np.abs(areas / np.median(areas) - 1).max() < 0.15
        lengths = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
        assert np.abs(lengths / np.median(lengths) - 1).max() < 0.12


def test_hooves_move_along_smooth_closed_paths(joints):
    near = np.array([-3, -2, -1, 1, 2, 3])
    for places in joints.values():
        hoof = places[:, -1]
        reach = np.ptp(hoof[:, 0])
        steps = np.linalg.norm(np.diff(close_path(hoof), axis=0), axis=1)
        assert steps.max() < 0.3 * reach
        # each frame predicted from three before and three after it, over the end of the cycle
        predicted = [CubicSpline(near, hoof[(frame + near) % 15])(0) for frame in range(15)]
        error = np.linalg.norm(predicted - hoof, axis=1)
        assert np.sqrt((error**2).mean()) < 0.05 * reach


@pytest.mark.parametrize("right", ["fore_right", "hind_right"])
def test_left_and_right_are_exchanged_in_no_frame(joints, right):
    pair = np.stack([joints[opposite_limb(right, LEGS)], joints[right]])

    def path_length(pair):
        return sum(np.linalg.norm(np.diff(close_path(leg), axis=0)) for leg in pair)

    for start in range(15):
        for count in range(1, 8):  # frames in a row, over the end of the cycle too
            exchanged = pair.copy()
            frames = (start + np.arange(count)) % 15
            exchanged[:, frames] = pair[::-1, frames]
            assert path_length(exchanged) > path_length(pair)


def test_legs_land_in_the_order_of_a_gallop_on_the_right_lead(joints):
    landing = {leg: int(places[:, -1, 0].argmax()) for leg, places in joints.items()}
    assert sorted(landing, key=landing.get) == [
        "hind_left",
        "hind_right",
        "fore_left",
        "fore_right",
    ]


def test_points_of_a_leg_stay_on_their_place_as_it_folds(outlines, joints):
    limbs = limb_contours(outlines.frames, 128)
    for leg, places in joints.items():
        hoof = places[:, -1] - limbs.course
        nearest = np.linalg.norm(limbs.points[leg] - hoof[:, None], axis=2).argmin(axis=1)
        assert np.ptp(nearest) <= 12  # of 128; upside down it would be 64


# --- its gait


@pytest.fixture(scope="module")
def gallop(outlines):
    frames, first = outlines.frames, outlines.first
    return walker_gait_contours(frames, 30, 64, first=first, symmetry="none", cycle_frames=15)


def test_the_given_cycle_closes_and_the_body_stays(gallop):
    film, period, limbs = gallop
    assert (period.frequency_hz, limbs.notes) == (pytest.approx(2), ())
    assert np.isnan(period.confidence)
    np.testing.assert_allclose(np.diff(film.phase), 1 / 15)
    assert np.ptp(limbs.course, axis=0) == pytest.approx(0)


def test_with_symmetry_a_given_cycle_keeps_its_length_and_partners_their_hips(outlines):
    film, *_ = walker_gait_contours(outlines.frames, 30, 16, cycle_frames=15)
    np.testing.assert_allclose(np.diff(film.phase), 1 / 15)
    assert film.offsets is not None and np.abs(film.offsets["fore_left"]).max() > 1  # px


def test_gamma_predicts_frames_of_the_gallop_that_were_held_out(gallop):
    found = compare_clocks(gallop[0])
    assert found.by_contour["frames"].sum() == 60  # every leg of every frame
    rms = found.rms
    assert rms["coordinate"] < 0.025 < rms["coefficient"] < rms["limb"] < rms["linear"] < 0.046


def test_hooves_are_on_the_ground_when_they_are_marked_low(gallop, joints):
    film, *_ = gallop
    gait, keys = fit_gait(film, "gallop", 2.0)
    assert len(keys) == 4
    for leg, ((start, end),) in gait.support.items():
        stands = np.mod(film.phase - start, 1) < end - start
        low = joints[leg][:, -1, 1] >= 335
        assert (stands != low).sum() <= 1
        assert 3 <= stands.sum() <= 6
    assert gait_to_record(gait)["symmetry"] == "none"


def test_several_cycles_need_no_given_one(outlines, gallop):
    frames = outlines.frames * 3
    film, period, _ = walker_gait_contours(frames, 30, 16, symmetry="none")
    assert period.frequency_hz == pytest.approx(2, rel=0.02) and period.confidence > 0.9
    found, wanted = (fit_gait(one, "gallop", 2.0)[0].support for one in (film, gallop[0]))
    for leg in LEGS:
        assert np.ravel(found[leg]) == pytest.approx(np.ravel(wanted[leg]), abs=0.02)


def test_a_film_shorter_than_its_cycle_is_refused(outlines):
    with pytest.raises(FinloopError, match="15 frames, and a gait cycle of 16"):
        walker_gait_contours(outlines.frames, 30, 64, symmetry="none", cycle_frames=16)


# --- the tool


def picture_of(axes, shape=(120, 160)):
    """A dark animal of known edges before a light sky that darkens to one side."""
    sky = np.broadcast_to(np.linspace(200, 240, shape[1]), shape)
    inside = np.min([axis.distances(*shape) for axis in axes], axis=0)
    return cv2.GaussianBlur(np.where(inside < 0, 0.2, 1) * sky, (0, 0), 1)


def axis(*joints):
    table = np.array(joints, float)
    return Axis(table[:, :2], table[:, 2])


def test_an_outline_follows_the_edge_though_joints_are_marked_beside_it():
    leg = axis((60, 20, 20), (80, 60, 12), (60, 100, 8))
    marked = axis((61, 22, 16), (79, 61, 9), (61, 98, 6))
    found = trace_parts(picture_of([leg]), {"fore_left": marked})["fore_left"]
    inside = leg.distances(120, 160)
    x, y = np.round(found.points).astype(int).T
    assert np.abs(inside[y, x]).max() < 2
    area = (inside < 0).sum()
    assert abs(signed_area(found)) == pytest.approx(area, rel=0.05)


def test_legs_that_cross_are_both_whole_and_neither_follows_the_other():
    legs = {
        "fore_left": axis((40, 20, 16), (110, 100, 8)),
        "fore_right": axis((110, 20, 16), (40, 100, 8)),
    }
    found = trace_parts(picture_of([*legs.values()]), legs)
    for name, leg in legs.items():
        x, y = np.round(found[name].points).astype(int).T
        outside = leg.distances(120, 160)[y, x]
        assert outside.min() > -2 and outside.max() < 7  # less than 6 px from the other's edge
        assert min(inside_px(found[name], leg.joints_px)) > 2


def test_a_picture_without_the_animal_is_refused():
    with pytest.raises(FinloopError, match="hind_left: empty"):
        trace_parts(np.full((120, 160), 220.0), {"hind_left": axis((60, 20, 20), (60, 90, 8))})


def test_the_svg_comes_back(tmp_path):
    curve = Curve(np.array([[10.0, 10], [50.5, 12], [30, 80.2]]), True)
    path = tmp_path / "01.svg"
    path.write_text(svg_text({"body": curve}, 120, 160))
    drawing = load_svg(path)
    assert (drawing.width, drawing.height) == (160, 120)
    assert drawing.curves["body"].points == pytest.approx(curve.points)
