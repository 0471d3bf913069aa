"""Curves: length, area, orientation, equal arc length; laws on drawn shapes. y is down."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from finloop.base.drawing import clean_curve
from finloop.base.errors import FinloopError
from finloop.curve.contour import (
    Curve,
    orient_clockwise,
    resample_curve,
    signed_area,
)
from finloop.curve.glyph import glyph_outlines

SQUARE = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])  # right, down, left: clockwise on a screen
ANY = arrays(np.float64, st.tuples(st.integers(3, 12), st.just(2)), elements=st.integers(-50, 50))


def clean_or_none(points, closed):
    """The curve, or None where the points are too few to be one."""
    try:
        return clean_curve(Curve(points, closed), "drawn")
    except FinloopError:
        return None


def path(curve):
    """Its points in order; of a closed curve the first again at the end."""
    return np.r_[curve.points, curve.points[:1]] if curve.closed else curve.points


def length(curve):
    return np.hypot(*np.diff(path(curve), axis=0).T).sum()


def test_a_square():
    closed, opened = Curve(SQUARE, True), Curve(SQUARE, False)
    assert signed_area(closed) == 4
    back = SQUARE[[0, 3, 2, 1]]
    assert signed_area(Curve(back, True)) == -4
    assert np.array_equal(orient_clockwise(Curve(back, True)).points, SQUARE)
    assert np.array_equal(orient_clockwise(Curve(back, False)).points, back)
    middle = resample_curve(closed, 8).points
    assert np.allclose(middle[:4], [[0, 0], [1, 0], [2, 0], [2, 1]])
    assert np.allclose(resample_curve(opened, 4).points, SQUARE)


def test_a_fine_circle_has_the_circles_area():
    t = 2 * np.pi * np.arange(4096) / 4096
    circle = Curve(3 * np.stack([np.cos(t), np.sin(t)], axis=1) + 1e3, True)
    assert signed_area(circle) == pytest.approx(9 * np.pi, rel=1e-5)


@given(ANY, st.booleans(), st.integers(0, 11), st.floats(0.1, 10), st.floats(0, 6))
@settings(max_examples=60)
def test_motion_scale_start_and_direction(points, closed, start, scale, angle):
    curve = clean_or_none(points, closed)
    if curve is None:
        return
    turn = scale * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = Curve(curve.points @ turn + (3, -7), closed)
    area = signed_area(curve)
    assert signed_area(moved) == pytest.approx(scale**2 * area, abs=1e-9 * length(moved) ** 2)
    assert signed_area(Curve(curve.points[::-1], closed)) == pytest.approx(-area, abs=1e-9)
    even = resample_curve(curve, 16).points
    assert np.allclose(resample_curve(moved, 16).points, even @ turn + (3, -7))
    if closed:
        other = Curve(np.roll(curve.points, -start, axis=0), True)
        assert signed_area(other) == pytest.approx(signed_area(curve), abs=1e-9)
        assert signed_area(orient_clockwise(curve)) >= 0


@given(ANY, st.booleans(), st.integers(3, 60))
@settings(max_examples=60)
def test_resampled_points_are_evenly_spaced_along_the_polyline(points, closed, n):
    curve = clean_or_none(points, closed)
    if curve is None:
        return
    new = resample_curve(curve, n)
    assert new.points.shape == (n, 2)
    assert np.array_equal(new.points[0], curve.points[0])
    if not closed:
        assert np.allclose(new.points[-1], curve.points[-1])
    even = length(curve) / (n if closed else n - 1)
    assert np.hypot(*np.diff(path(new), axis=0).T).max() <= even * (1 + 1e-9)
    # One segment after the other, walked apart from the code under test.
    for number, point in enumerate(new.points):
        left = number * even
        for a, b in pairwise(path(curve)):
            d = np.linalg.norm(b - a)
            if left <= d * (1 + 1e-9) + 1e-9:
                assert np.allclose(point, a + (b - a) * min(left / d, 1), atol=1e-6)
                break
            left -= d


def test_points_that_repeat_are_dropped():
    points = np.array([[0.0, 0], [0, 0], [1, 0], [1, 1], [1, 1], [0, 0]])
    assert len(clean_curve(Curve(points, True), "a").points) == 3
    assert len(clean_curve(Curve(points, False), "a").points) == 4


@pytest.mark.parametrize(
    ("points", "closed", "word"),
    [
        ([[0, 0], [1, np.nan], [2, 0]], True, "point 1"),
        ([[0, 0], [1, 1], [np.inf, 0]], False, "inf"),
        ([[0, 0], [1, 1], [1e200, 0]], False, "1e\\+200"),
        ([[0, 0], [1, 1]], True, "closed curve brow has 2 different points"),
        ([[0, 0], [1, 1], [0, 0]], True, "2 different points of 3"),
        ([[1, 1], [1, 1], [1, 1]], False, "its length is 0"),
        ([[1, 1]] * 5, True, "its length is 0"),
        (np.zeros((0, 2)), True, "0 different points of 0"),
        ([[1, 1, 1]], True, "shape"),
        ([1, 2, 3], True, "shape"),
    ],
)
def test_what_is_no_curve_is_refused_by_name(points, closed, word):
    with pytest.raises(FinloopError, match=word) as refused:
        clean_curve(Curve(np.array(points, float), closed), "brow")
    assert "brow" in str(refused.value)


def test_resampling_needs_points():
    with pytest.raises(FinloopError, match="at least 3"):
        resample_curve(Curve(SQUARE, True), 2)


def test_glyphs_are_outlines_the_right_way_up():
    (three,) = glyph_outlines("3")
    assert three.points[:, 1].max() < 50  # of an em of 1000: hardly below the baseline
    assert -800 < three.points[:, 1].min() < -650
    assert abs(signed_area(three)) > 1e5
    (seven,) = glyph_outlines("7")  # its bar is above: at the top it is wide
    top = seven.points[seven.points[:, 1] < -600]
    foot = seven.points[seven.points[:, 1] > -100]
    assert np.ptp(top[:, 0]) > 2 * np.ptp(foot[:, 0])
    assert len(glyph_outlines("8")) == 3
    for word in ("", "12", " "):
        with pytest.raises(FinloopError):
            glyph_outlines(word)
