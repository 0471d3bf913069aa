"""Shapes of several contours: letters with holes morph, and no contour meets another one."""

from pathlib import Path

import numpy as np
import pytest
import skimage.measure

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, signed_area
from finloop.curve.glyph import glyph_outlines
from finloop.io.svg import load_svg
from finloop.morph.folds import ContourLayout, contours_stay_simple, count_contour_folds
from finloop.morph.layers import morph_drawings
from finloop.morph.regions import split_regions
from finloop.morph.simple import morph_regions_without_folds

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
ANGLE = np.linspace(0, 2 * np.pi, 60, endpoint=False)
POINTS = 64


def morph_of(a, b, frames=16):
    """The morph of two letters: contours side by side (frames, n, 2), and their layout."""
    stacks = morph_regions_without_folds(glyph_outlines(a), glyph_outlines(b), frames, POINTS)
    return np.concatenate(stacks, axis=1), ContourLayout((POINTS,) * len(stacks))


def filled_area(stack, layout):
    """The area of each frame's first contour less its holes."""
    areas = [
        [abs(signed_area(Curve(pose[part], closed=True))) for part in layout.parts]
        for pose in stack
    ]
    return np.array([outer - sum(holes) for outer, *holes in areas])


# --- contours beside each other


def test_edges_of_two_contours_that_meet_are_folds():
    layout = ContourLayout((4, 4))
    for inner, count in ((SQUARE / 2 + 2, 0), (SQUARE + 5, 2), (SQUARE + 30, 0), (SQUARE * 1, 12)):
        assert count_contour_folds(np.concatenate([SQUARE, inner]), layout).tolist() == [count]


def test_a_hole_that_leaves_between_two_poses_is_found():
    inside, outside = SQUARE / 4 + 3, SQUARE / 4 + 30
    poses = np.stack([np.concatenate([SQUARE, hole]) for hole in (inside, outside)])
    layout = ContourLayout((4, 4))
    assert not count_contour_folds(poses, layout).any()
    assert not contours_stay_simple(poses, layout)
    assert not contours_stay_simple(poses[[0, 1, 0]], layout)  # it leaves, and comes back
    stays = np.stack([np.concatenate([SQUARE, hole]) for hole in (inside, inside + 1)])
    assert contours_stay_simple(stays, layout)


# --- letters


@pytest.mark.parametrize("pair", ["d9", "8e", "QM", "&R", "IB"])
def test_no_contour_of_a_letter_meets_another_and_holes_stay_inside(pair):
    stack, layout = morph_of(*pair)
    assert not count_contour_folds(stack, layout).any()
    outer, *holes = layout.parts
    for pose in stack:
        for hole in holes:
            assert skimage.measure.points_in_poly(pose[hole], pose[outer]).all()
    areas = filled_area(stack, layout)
    for end, letter in ((0, pair[0]), (-1, pair[1])):
        drawn = sorted(abs(signed_area(curve)) for curve in glyph_outlines(letter))
        assert areas[end] == pytest.approx(2 * drawn[-1] - sum(drawn), rel=0.04)


def test_a_hole_without_a_partner_ends_as_a_point():
    stack, layout = morph_of("O", "I")
    outer, hole = layout.parts
    shares = [
        abs(signed_area(Curve(pose[hole], True)) / signed_area(Curve(pose[outer], True)))
        for pose in stack
    ]
    assert shares[0] > 0.5 and shares[-1] < 2e-6


def test_size_and_place_do_not_matter():
    d, nine = glyph_outlines("d"), glyph_outlines("9")
    moved = [
        [Curve(curve.points * 0.5 + [1024, -512], True) for curve in side] for side in (d, nine)
    ]
    for one, other in zip(
        morph_regions_without_folds(d, nine, 8, POINTS),
        morph_regions_without_folds(*moved, 8, POINTS),
        strict=True,
    ):
        np.testing.assert_allclose(other, one * 0.5 + [1024, -512], atol=1e-2)


def test_parts_and_holes_are_told_apart_by_the_even_odd_rule():
    nested = [Curve(SQUARE * size - 5 * size, True) for size in (1, 0.7, 0.5, 0.2)]
    far = Curve(SQUARE * 0.9 + 100, True)
    found = split_regions([*nested[::-1], far])
    assert [region.outer for region in found] == [nested[0], far, nested[2]]
    assert [region.holes for region in found] == [[nested[1]], [], [nested[3]]]


def test_dot_goes_to_dot_and_separate_parts_must_be_as_many():
    stack, layout = morph_of("i", "j")
    assert not count_contour_folds(stack, layout).any()
    with pytest.raises(
        FinloopError, match="separate parts: 2 in the first drawing, 1 in the second"
    ):
        morph_of("i", "X")


@pytest.mark.parametrize(
    ("contours", "said"),
    [
        ([], "without any"),
        ([Curve(SQUARE, False)], "open contour"),
        ([Curve(SQUARE, True), Curve(SQUARE * [1, 0] + 3, True)], "no area"),
        ([Curve(SQUARE, True), Curve(SQUARE, True)], "contours meet"),
        ([Curve(SQUARE, True), Curve(SQUARE / 2, True)], "contours meet"),  # touches from inside
        ([Curve(SQUARE, True), Curve(SQUARE + 5, True)], "contours meet"),
    ],
)
def test_contours_that_are_no_region_are_refused(contours, said):
    with pytest.raises(FinloopError, match=said):
        morph_regions_without_folds(contours, [Curve(SQUARE, True)], 5, POINTS)


def test_a_layout_that_does_not_fit_its_contours_is_refused():
    for sizes in ((4, 4), (2, 2), ()):
        with pytest.raises(FinloopError, match="polygons of shape"):
            count_contour_folds(SQUARE, ContourLayout(sizes))


def test_a_hole_finds_room_in_a_thin_line_and_a_winding_one_becomes_round():
    """A thin C has no place for a hole at most spots; a spiral hole is small from the beginning."""
    angle = np.linspace(0.3, 2 * np.pi - 0.3, 90)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    thin = Curve(np.concatenate([50 * arc, 48 * arc[::-1]]), True)
    disc = Curve(60 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], 1), True)
    stacks = morph_regions_without_folds([disc, Curve(SQUARE, True)], [thin], 8, 256)
    layout = ContourLayout((256, 256))
    assert not count_contour_folds(np.concatenate(stacks, axis=1), layout).any()
    assert skimage.measure.points_in_poly(stacks[1][-1], stacks[0][-1]).all()
    turns = np.linspace(np.pi, 5 * np.pi, 60)
    spiral = turns[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    winding = Curve(0.1 * np.concatenate([spiral, 0.9 * spiral[::-1]]), True)
    stacks = morph_regions_without_folds([disc, winding], glyph_outlines("D"), 8, 256)
    assert not count_contour_folds(np.concatenate(stacks, axis=1), layout).any()


# --- drawings


def drawing_of(path: Path, letter: str) -> Drawing:
    """A drawing of a letter, one path with several contours, read from a file."""
    steps = "".join(
        "M" + "L".join(f"{x:.1f},{y:.1f}" for x, y in curve.points + [100, 900]) + "Z"
        for curve in glyph_outlines(letter)
    )
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1200 1200"><path id="letter" d="{steps}"/></svg>',
        encoding="utf-8",
    )
    return load_svg(path)


def test_a_drawing_with_a_hole_is_one_region_and_a_crossing_is_counted(tmp_path):
    d, nine, b = (drawing_of(tmp_path / f"{name}.svg", name) for name in "d9B")
    whole = morph_drawings(d, nine, "fold_free", 20, POINTS)
    assert list(whole.layers) == ["letter", "letter#2"] and not whole.count_fold_frames()
    linear = morph_drawings(d, nine, "linear", 20, POINTS)
    stacks = np.concatenate([linear.layers["letter"], linear.layers["letter#2"]], axis=1)
    together = count_contour_folds(stacks, ContourLayout((POINTS, POINTS)))
    assert sum(sum(count) for count in linear.folds.values()) == together.sum() > 0
    assert not any(linear.continuous.values())
    more = morph_drawings(d, b, "fold_free", 8, POINTS)
    assert list(more.layers) == ["letter", "letter#2", "letter#3"]
    for method in ("linear", "physical"):  # a hole grows by any method
        assert list(morph_drawings(d, b, method, 8, POINTS).layers) == list(more.layers)
