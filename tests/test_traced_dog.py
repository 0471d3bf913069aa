"""The traced dog: every leg in every frame; its trot is found, and goes by diagonals; its tool."""

import cv2
import numpy as np
import pytest

from benchmarks.dog import FOLDER, SLACK_PX, find_dog
from benchmarks.horse import Axis, load_axes, outline_parts
from benchmarks.pipeline import ROOT
from finloop.curve.contour import Curve, signed_area
from finloop.gait.compare import compare_clocks
from finloop.gait.cycles import walker_gait_contours
from finloop.gait.fit import fit_gait
from finloop.gait.limbs import check_traced_contour, region_contour
from finloop.gait.tool import load_gait
from finloop.io.regions import load_regions
from finloop.morph.folds import count_polygon_folds

LEGS = ("fore_left", "fore_right", "hind_left", "hind_right")
WIDTH = 1280


@pytest.fixture(scope="module")
def outlines():
    return load_regions(FOLDER, region_contour, check_traced_contour)


@pytest.fixture(scope="module")
def trot(outlines):
    return walker_gait_contours(outlines.frames, 30, 64, first=outlines.first)


def test_every_frame_shows_the_body_and_every_leg_at_its_joints(outlines):
    axes = load_axes(FOLDER / "joints.csv")
    assert outlines.first == min(axes) and len(outlines.frames) == len(axes) == 29
    for frame, marked in zip(outlines.frames, axes.values(), strict=True):
        assert set(frame) == {"body", *LEGS}
        for name in LEGS:
            curve = frame[name]
            assert isinstance(curve, Curve) and count_polygon_folds(curve.points) == 0
            ring = curve.points.astype(np.float32)
            for x, y in marked[name].joints_px:  # the outlines are mirrored
                assert cv2.pointPolygonTest(ring, (WIDTH - 1 - x, y), True) > -3


def test_the_period_is_found_and_diagonal_legs_stand_together(trot):
    film, period, _ = trot
    assert period.frequency_hz == pytest.approx(30 / 14, rel=0.02) and period.confidence > 0.9
    gait, _ = fit_gait(film, "trot", float(period.frequency_hz))
    starts = {leg: spans[0][0] for leg, spans in gait.support.items()}
    for one, other, apart in (
        ("fore_left", "hind_right", 0), ("fore_right", "hind_left", 0), ("fore_left", "fore_right", 0.5),
    ):  # fmt: skip
        late = (starts[one] - starts[other] - apart + 0.5) % 1 - 0.5
        assert abs(late) < 0.06
    shipped = load_gait(ROOT / "data/gaits/dog_trot.json")
    assert shipped.frequency_hz == pytest.approx(period.frequency_hz, rel=0.01)
    for leg, start in starts.items():
        assert (shipped.support[leg][0][0] - start + 0.5) % 1 - 0.5 == pytest.approx(0, abs=0.03)


def test_the_gait_predicts_the_stride_that_was_held_out(trot):
    rms = compare_clocks(trot[0]).rms
    assert rms["coordinate"] < rms["limb"] < 0.053 < rms["linear"]


def test_a_leg_is_found_beside_its_marks_and_the_leash_is_no_leg():
    ground = np.full((120, 160, 3), 190, np.uint8)
    frame = ground.copy()
    cv2.line(frame, (60, 20), (60, 100), (230, 225, 220), 12)
    cv2.line(frame, (20, 70), (140, 70), (30, 30, 30), 3)  # the leash
    marked = Axis(np.array([[61.0, 20], [61, 100]]), np.array([9.0, 9]))
    solid = {"leg": np.ones((120, 160), bool)}
    found = outline_parts({"leg": marked}, find_dog(frame, ground), solid, SLACK_PX)["leg"]
    assert abs(signed_area(found)) == pytest.approx(12 * 80 + np.pi * 36, rel=0.12)
    assert np.ptp(found.points[:, 0]) < 15
