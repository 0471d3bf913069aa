"""What a display shows of the tank, and where the tracker's points fall in it."""

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.show.drawn import ALPHA, PICTURE, POSTURE, X, Y
from finloop.stimulus.display import DisplayCalibration
from finloop.stimulus.listing import describe_points
from finloop.stimulus.screen import ScreenCheck
from finloop.stimulus.tracker import TrackerSettings

ARENA = np.ones((100, 200), bool)
WHOLE = (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)
HALF = (0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)


def check(mm_per_px=1.0, **facts):
    display = {"width_px": 400, "height_px": 200, "ratio": 1.0, "refresh_hz": 60.0} | facts
    return ScreenCheck(DisplayCalibration(**display), ARENA, mm_per_px)


@pytest.mark.parametrize(
    ("facts", "share"),
    [
        ({}, 0.0),  # as large as fits
        ({"px_per_mm": 2.0}, 0.0),
        ({"px_per_mm": 4.0}, 0.75),  # half of the width and half of the height are seen
        ({"px_per_mm": 4.0, "mm_per_px": 0.5}, 0.0),  # a tank of half the size
        ({"scale": 4.0, "px_per_mm": 2.0}, 0.75),
        ({"scale": 4.0, "corners": WHOLE}, 0.75),
        ({"scale": 4.0, "corners": HALF}, 0.0),  # what is too large is made smaller
        ({"width_px": 200}, 0.0),
        ({"width_px": 200, "px_per_mm": 2.0}, 0.5),
    ],
)
def test_the_share_of_the_tank_that_is_cut_off_is_that_of_its_area(facts, share):
    assert check(**facts).share_outside == pytest.approx(share, abs=0.005)


def test_ticks_are_outside_if_a_fish_that_is_shown_is():
    states = np.zeros((2, POSTURE + 1), np.float32)
    states[:, [X, Y, ALPHA]] = 100, 50, 1
    small = check(px_per_mm=4.0)
    small.count_tick(states)
    assert (small.ticks, small.ticks_outside) == (1, 0)
    states[1, X] = 30
    small.count_tick(states)
    assert (small.ticks, small.ticks_outside) == (2, 1)
    states[1, ALPHA] = 0
    small.count_tick(states)
    states[:, PICTURE] = -1  # no fish at all
    small.count_tick(states)
    assert (small.ticks, small.ticks_outside) == (3, 1)
    assert "33.33 % of the ticks (1 of 3)" in small.describe_ticks()


def test_sizes_are_said_in_mm_where_they_are_known():
    assert (
        "is 100 × 50 mm, the screen 100 × 50 mm: 0.0 %" in check(0.5, px_per_mm=4.0).describe_tank()
    )
    assert "is 200 × 100 px, the screen 400 × 200 px: 0.0 %" in check(None).describe_tank()


def settings(width, height, first=(0.0, 0.0)):
    left, top = first
    corners = (left, top), (width, top), (width, height), (left, height)
    return TrackerSettings(points=[
        {"tracker": (2 * x + 10, 2 * y), "tank": (float(x), float(y))} for x, y in corners
    ])  # fmt: skip


def test_corners_of_another_tank_are_refused_and_landmarks_are_not():
    text = describe_points(settings(1159, 937), 1160, 938)
    assert text.splitlines()[0].endswith("1160 × 938:")
    places = "(2328.0, 1874.0) (1159.0, 937.0) (1159.0, 937.0)"
    assert text.splitlines()[4].split() == places.split()
    assert describe_points(settings(1160, 938), 1160, 938)  # counted from 1
    assert describe_points(settings(639, 479, first=(20.0, 30.0)), 1160, 938)
    assert describe_points(TrackerSettings(), 1160, 938) == ""
    with pytest.raises(FinloopError, match=r"640 × 480 px.*1160 × 938") as error:
        describe_points(settings(639, 479), 1160, 938)
    assert "[1159, 937]" in str(error.value)
