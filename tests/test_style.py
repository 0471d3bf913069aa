"""Paints between two paints: Oklab, gradients, opacity, dashes; and gradients that move."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from finloop.base.drawing import Drawing
from finloop.base.style import (
    Gradient,
    Paint,
    Stop,
    colour_to_oklab,
    colours_at,
    gradient_offsets,
    mix_colours,
    mix_paints,
    oklab_to_colour,
)
from finloop.curve.contour import Curve
from finloop.morph.layers import METHODS, fit_drawing, morph_drawings

RED, BLUE, WHITE, BLACK = (255, 0, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)
UNIT = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
LINEAR = Gradient("linear", (Stop(0, RED, 1), Stop(1, BLUE, 1)), UNIT)
RADIAL = Gradient("radial", (Stop(0, WHITE, 1), Stop(0.5, RED, 0), Stop(1, BLACK, 1)), UNIT)
DASHES = Paint(None, BLACK, 1, 1, 2, dashes=(6, 3), dash_offset=4)
BYTE = st.integers(0, 255)
POINTS = np.random.default_rng(0).uniform(-1, 2, (50, 2))


def colours_of(fill):
    """Return what a gradient shows at some points."""
    return colours_at(fill, gradient_offsets(fill, POINTS))


def fill_paint(fill, opacity=1.0):
    return Paint(fill, None, opacity, 1, 1)


# --- colours


@pytest.mark.parametrize(
    ("colour", "lab"),  # from Ottosson's article: white, and sRGB's red and blue
    [(WHITE, (1, 0, 0)), (RED, (0.62796, 0.22486, 0.12585)), (BLUE, (0.45201, -0.03246, -0.31153))],
)
def test_oklab_of_known_colours(colour, lab):
    np.testing.assert_allclose(colour_to_oklab(colour), lab, atol=2e-4)


@settings(max_examples=40)
@given(a=st.tuples(BYTE, BYTE, BYTE), b=st.tuples(BYTE, BYTE, BYTE), share=st.floats(0, 1))
def test_colours_between(a, b, share):
    assert oklab_to_colour(colour_to_oklab(a)) == a
    assert (mix_colours(a, b, 0), mix_colours(a, b, 1)) == (a, b)
    assert mix_colours(a, b, share) == mix_colours(b, a, 1 - share)
    light = (1 - share) * colour_to_oklab(a)[0] + share * colour_to_oklab(b)[0]
    # Colours outside sRGB are clipped, which may make them lighter or darker.
    assert colour_to_oklab(mix_colours(a, b, share))[0] == pytest.approx(light, abs=0.06)


def test_grey_lies_between_black_and_white_evenly_for_the_eye():
    assert mix_colours(BLACK, WHITE, 0.5) == (99, 99, 99)  # linear light gives 188, sRGB 128


# --- fills and lines


@pytest.mark.parametrize("a", [None, RED, LINEAR, RADIAL])
@pytest.mark.parametrize("b", [None, RED, LINEAR, RADIAL, replace(LINEAR, stops=RADIAL.stops)])
def test_both_ends_look_as_drawn_and_nothing_jumps(a, b):
    mixed = [
        mix_paints(fill_paint(a, 0.8), fill_paint(b, 0.4), share)
        for share in np.linspace(0, 1, 257)
    ]

    def blend_on_white(fill, opacity):
        """Return what is seen on white."""
        rgba = (
            colours_of(fill) if isinstance(fill, Gradient) else np.array([[*(fill or WHITE), 1.0]])
        )
        share = rgba[:, 3:] * (0 if fill is None else opacity)
        return np.broadcast_to(share * rgba[:, :3] + (1 - share) * 255, (50, 3))

    for paint, fill, opacity in ((mixed[0], a, 0.8), (mixed[-1], b, 0.4)):
        seen_at_end = blend_on_white(paint.fill, paint.fill_opacity)
        np.testing.assert_allclose(seen_at_end, blend_on_white(fill, opacity), atol=0.51)
    frames = np.stack([blend_on_white(paint.fill, paint.fill_opacity) for paint in mixed])
    assert np.abs(np.diff(frames, axis=0)).max() < 12  # of 255, in steps of 1/256


def test_a_colour_is_a_gradient_of_one_colour():
    paint = mix_paints(fill_paint(RED), fill_paint(RADIAL), 0.25)
    assert [stop.offset for stop in paint.fill.stops] == [0, 0.5, 1]
    assert paint.fill.stops[2].colour == mix_colours(RED, BLACK, 0.25)
    assert paint.fill.stops[1] == Stop(0.5, RED, 0.75)
    assert paint.fill.matrix == RADIAL.matrix


def test_stops_positions_and_spread_are_interpolated():
    moved = replace(
        LINEAR, matrix=(3, 4, -4, 3, 10, 20), stops=(Stop(0.4, RED, 1), Stop(0.8, RED, 0))
    )
    fill = mix_paints(fill_paint(LINEAR), fill_paint(replace(moved, spread="repeat")), 0.5).fill
    assert fill.matrix == (2, 2, -2, 2, 5, 10)
    assert fill.stops == (Stop(0.2, RED, 1), Stop(0.9, mix_colours(BLUE, RED, 0.5), 0.5))
    assert fill.spread == "repeat"


def test_widths_dashes_and_opacity_are_interpolated():
    b = replace(DASHES, stroke=RED, stroke_opacity=0.5, width=4, dashes=(2, 3, 4, 5), dash_offset=0)
    paint = mix_paints(DASHES, b, 0.5)
    assert (paint.width, paint.stroke_opacity, paint.dash_offset) == (3, 0.75, 2)
    assert paint.dashes == (4, 3, 5, 4)  # (6, 3, 6, 3) and (2, 3, 4, 5)
    assert paint.stroke == mix_colours(BLACK, RED, 0.5)


def test_gaps_open_in_a_whole_line_and_a_missing_line_fades():
    whole = replace(DASHES, dashes=(), dash_offset=0)
    assert mix_paints(whole, DASHES, 0) == whole
    assert mix_paints(whole, DASHES, 0.5).dashes == (7.5, 1.5)
    paint = mix_paints(fill_paint(RED), DASHES, 0.25)
    assert (paint.stroke, paint.stroke_opacity, paint.width, paint.dashes) == (
        BLACK,
        0.25,
        2,
        (6, 3),
    )
    assert (paint.fill, paint.fill_opacity) == (RED, 0.75)


# --- with their contours

SQUARE = np.array([[20, 20], [60, 20], [60, 60], [20, 60.0]])


def drawing(points, fill, size=100):
    paint = replace(DASHES, fill=fill)
    return Drawing({"box": Curve(points, True)}, size, size, {"box": paint})


@pytest.mark.parametrize("method", METHODS)
def test_a_gradient_moves_with_its_contour(method):
    """The second drawing is the first, moved and smaller: so is its gradient."""
    turn = np.eye(2) * 0.7
    gradient = replace(RADIAL, matrix=(30, 0, 0, 10, 40, 40), focus=(0.3, 0))
    rows = np.reshape(gradient.matrix, (3, 2)) @ turn + [[0, 0], [0, 0], [9, -5]]
    other = drawing(SQUARE @ turn + [9, -5], replace(gradient, matrix=tuple(rows.ravel())))
    done = morph_drawings(drawing(SQUARE, gradient), other, method, 7, points=64)
    box = done.layers["box"]
    for frame, paint in enumerate(done.styles["box"]):
        axes = np.reshape(paint.fill.matrix, (3, 2))
        motion = np.linalg.lstsq(np.c_[box[0], np.ones(64)], box[frame], rcond=None)[0]
        wanted = np.c_[np.reshape(gradient.matrix, (3, 2)), [0, 0, 1]] @ motion
        np.testing.assert_allclose(axes, wanted, atol=0.01)


def test_paints_are_scaled_with_their_drawing():
    gradient = replace(LINEAR, matrix=(30, 0, 0, 10, 40, 40))
    (paint,) = fit_drawing(drawing(SQUARE, gradient), 300, 200).styles.values()
    assert paint.fill.matrix == (60, 0, 0, 20, 130, 80)
    assert (paint.width, paint.dashes, paint.dash_offset) == (4, (12, 6), 8)


def test_a_hard_edge_stays_hard_between_gradients_of_different_stops():
    hard = replace(
        LINEAR, stops=(Stop(0, RED, 1), Stop(0.5, RED, 1), Stop(0.5, BLUE, 1), Stop(1, BLUE, 1))
    )
    flat = replace(LINEAR, stops=(Stop(0, WHITE, 1), Stop(1, WHITE, 1)))
    for share in (0.0, 0.5):
        mixed = mix_paints(fill_paint(hard), fill_paint(flat), share).fill
        before, after = colours_at(mixed, np.array([0.499, 0.501]))[:, :3]
        ends = colours_at(mixed, np.array([0.0, 1.0]))[:, :3]
        np.testing.assert_allclose([before, after], ends, atol=2)
        assert abs(before - after).max() > 60
