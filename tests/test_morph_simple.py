"""Matching and morphs: laws, exact ends, and frames without folds between shapes hard to part."""

import string

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, resample_curve
from finloop.curve.contour import signed_area as area_of
from finloop.curve.glyph import glyph_outlines
from finloop.curve.wavelet import drop_details
from finloop.morph.folds import ContourLayout, count_polygon_folds, is_simple, stays_simple
from finloop.morph.layers import PhysicalOptions, linear_morph, physical_morph
from finloop.morph.match import Resolution, match_curves, misfit_by_start
from finloop.morph.relax import find_relaxing_moves
from finloop.morph.simple import (
    cut_ears,
    join_simplified_poses,
    morph_without_folds,
    path_lengths,
    round_off_contours,
    straighten_curve,
)

GLYPHS = {
    name: outlines[0]
    for name in string.ascii_letters + string.digits
    if len(outlines := glyph_outlines(name)) == 1
}


METHODS = (
    linear_morph,
    morph_without_folds,
    physical_morph,
)


def area(points):
    return area_of(Curve(points, True))


def centre(points):
    return points - points.mean(axis=-2, keepdims=True)


def spiral(turns, width, sense=1):
    t = np.linspace(1, 2 * turns, 1500) * np.pi
    strand = [(t / (2 * np.pi) + side) * np.exp(1j * sense * t) for side in (width / 2, -width / 2)]
    z = np.r_[strand[0], strand[1][::-1]]
    return Curve(np.stack([z.real, z.imag], axis=1), True)


def comb(teeth, depth):
    up_and_down = ((0, 0), (0, depth), (0.5, depth), (0.5, 0))
    tooth = [(k + x, y) for k in range(teeth) for x, y in up_and_down]
    return Curve(np.array([*tooth, (teeth - 0.5, -0.5), (0, -0.5)], float), True)


def winding(turns, sense=1):
    t = np.linspace(0.2, turns, 500) * 2 * np.pi
    return Curve(np.stack([t * np.cos(t), sense * t * np.sin(t)], axis=1), False)


def star_shaped(rng, n=60):
    t = np.sort(rng.uniform(0, 2 * np.pi, n))
    radius = rng.uniform(0.2, 1, n)
    return Curve(radius[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1), True)


def folds_seen(points, closed=True):
    """Pairs of edges that cross, by determinants of all pairs in floats: an independent count."""
    ends = np.roll(points, -1, axis=0)
    start, end = (points, ends) if closed else (points[:-1], ends[:-1])

    def side(a, b, c):
        (x, y), (to_x, to_y) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        return x * to_y - y * to_x

    a, b, c, d = start[:, None], end[:, None], start[None], end[None]
    cross = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return int(np.triu(cross, 2).sum())


# --- matching


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(0, 63), st.booleans())
def test_a_curve_is_found_again(seed, start, back):
    """Begun elsewhere, run the other way, moved: the same points come out."""
    points = resample_curve(star_shaped(np.random.default_rng(seed)), 64)
    points = resample_curve(points, 64).points
    other = np.roll(points, start, axis=0)[:: -1 if back else 1] + [30, -7]
    far = misfit_by_start(points, other if not back else other[::-1])
    assert far.min() < 1e-9 * far.max()
    one, two = match_curves(Curve(points, True), Curve(other, True), 64)
    assert abs(centre(one) - centre(two)).max() < 0.2  # resampling starts between the points


def test_the_best_of_all_start_points():
    a, b = (resample_curve(GLYPHS[name], 64).points for name in "k5")
    every = [((centre(a) - centre(np.roll(b, -s, axis=0))) ** 2).sum() for s in range(64)]
    np.testing.assert_allclose(misfit_by_start(a, b), every, rtol=1e-9)
    one, two = match_curves(GLYPHS["k"], GLYPHS["5"], 64)
    np.testing.assert_array_equal(one, a)
    assert ((centre(one) - centre(two)) ** 2).sum() == pytest.approx(min(every))


def test_both_directions():
    eight = np.stack([np.sin(2 * (t := np.arange(300) / 300 * 2 * np.pi)), np.sin(t)], axis=1)
    turned = Curve(eight[::-1] + 0.01, True)  # no sense of turning: both directions are tried
    one, two = match_curves(Curve(eight, True), turned, 300)
    assert abs(centre(one) - centre(two)).max() < 0.03
    arc = Curve(np.array([[0, 0], [1, 2], [5, 3]], float), False)
    one, two = match_curves(arc, Curve(arc.points[::-1], False), 50)
    np.testing.assert_allclose(one, two, atol=1e-12)
    one, two = match_curves(GLYPHS["C"], Curve(GLYPHS["C"].points * [-1, 1], True), 128)
    assert area(one) * area(two) > 0  # a mirror image turns the other way: run backwards


@pytest.mark.parametrize("method", METHODS)
def test_open_with_closed(method):
    with pytest.raises(FinloopError, match="one that is open"):
        method(GLYPHS["C"], winding(1), 5, 64)


# --- linear and physical


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("a", "b"), [(GLYPHS["W"], GLYPHS["I"]), (winding(0.6), winding(0.8))])
def test_ends_are_the_curves(method, a, b):
    frames = method(a, b, 9, 128)
    assert frames.shape == (9, 128, 2)
    one, two = match_curves(a, b, 128)
    size = np.ptp(one)
    np.testing.assert_allclose(frames[0], one, atol=1e-9 * size)
    assert abs(centre(frames[-1]) - centre(resample_curve(b, 128).points)).max() < 3 * size
    assert set(map(tuple, np.round(frames[-1], 6))) == set(map(tuple, np.round(two, 6)))
    np.testing.assert_allclose(method(a, a, 9, 128), np.stack([one] * 9), atol=1e-9 * size)


def test_eq_4_1():
    """Of all coefficients it is the points' own mean; of few, that of the truncated ends."""
    a, b = GLYPHS["C"], GLYPHS["S"]
    one, two = match_curves(a, b, 256)
    tau = np.linspace(0, 1, 7)[:, None, None]
    np.testing.assert_allclose(linear_morph(a, b, 7, 256), (1 - tau) * one + tau * two, atol=1e-9)
    for source, target in ((a, b), (winding(1), winding(1.2))):
        ends = drop_details(np.stack(match_curves(source, target, 256)), "db4", 4, source.closed)
        coarse = linear_morph(source, target, 7, 256, Resolution(4, "db4"))
        np.testing.assert_allclose(coarse, (1 - tau) * ends[0] + tau * ends[1], atol=1e-9)
        assert abs(coarse - linear_morph(source, target, 7, 256)).max() > 1e-3 * np.ptp(ends)
        for method in METHODS:
            frames = method(source, target, 9, 256, resolution=Resolution(4, "db4"))
            np.testing.assert_allclose(frames[[0, -1]], ends, atol=1e-9 * np.ptp(ends))
            if method is physical_morph and source.closed:  # every frame is as coarse
                few = drop_details(frames, "db4", 4)
                np.testing.assert_allclose(few, frames, atol=1e-9 * np.ptp(ends))


def test_physics():
    """Heavy damping creeps, light damping overshoots; place goes with the slowest mode."""
    t = 2 * np.pi * (np.arange(64) + 0.5) / 64
    ring = np.stack([np.cos(t), np.sin(t)], axis=1)
    a, b = Curve(1.5 * ring + [9, 0], True), Curve(ring, True)

    def radius(elastic, damping, mass):
        frames = physical_morph(a, b, 101, 64, PhysicalOptions(elastic, damping, mass))
        size = abs(centre(frames)[:, 0] @ [1, 1j])
        np.testing.assert_allclose(frames.mean(axis=1)[:, 0] / 9, 2 * size - 2, atol=1e-6)
        return size

    swing = np.cos(2 * np.pi * np.linspace(0, 1, 101))[:75]  # mode 1 swings once
    np.testing.assert_allclose(radius(1, 0, 1)[:75], 1 + 0.5 * swing, atol=2e-3)
    np.testing.assert_allclose(radius(2, 0, 2)[:75], radius(1, 0, 1)[:75], atol=1e-9)
    np.testing.assert_allclose(radius(3, 6, 3)[:75], radius(1, 2, 1)[:75], atol=1e-9)
    assert radius(1, 3, 1).min() < 0.99 < 0.999 < radius(1, 200, 1).min()
    creep = np.exp(-4 * np.pi**2 * np.linspace(0, 1, 101) / 20)[:75]
    np.testing.assert_allclose(radius(1, 20, 0)[:75], 1 + 0.5 * creep, atol=2e-3)


# --- plainer poses


@pytest.mark.parametrize(
    ("curve", "n"),
    [(GLYPHS["W"], 256), (GLYPHS["S"], 256), (spiral(6, 0.3), 128), (comb(15, 8), 64)],
)
def test_shortening(curve, n):
    """The last two are so coarse that whole steps would fold: they are halved."""
    points = resample_curve(curve, n).points
    poses, done = round_off_contours(points, ContourLayout((len(points),)))
    assert done and stays_simple(poses)
    np.testing.assert_array_equal(poses[0], points)
    areas = np.array([area(pose) for pose in poses])
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)
    length = np.hypot(*(poses - np.roll(poses, 1, axis=1)).transpose(2, 0, 1)).sum(axis=1)
    assert (np.diff(length) < 0).all() and 4 * np.pi * abs(areas[0]) / length[-1] ** 2 > 0.97


RANDOM = [
    (star_shaped(np.random.default_rng(seed), n), 0) for seed, n in enumerate(range(4, 40, 3))
]


@pytest.mark.parametrize(
    ("curve", "n"), [(GLYPHS["W"], 64), (comb(15, 8), 32), (spiral(4, 0.4), 96), *RANDOM]
)
def test_ears(curve, n):
    """Any simple polygon comes down to a triangle, also a tangle with a part within a corner."""
    points = resample_curve(curve, n).points if n else curve.points
    if not is_simple(points):
        return
    poses, done = cut_ears(points)
    assert done and len(poses) == len(points) - 2 and stays_simple(poses)
    areas = [area(pose) for pose in poses]
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)
    edges = np.roll(poses[-1], -1, axis=0) - poses[-1]
    corners = abs(np.angle(np.roll(edges, 1, axis=0) @ [1, -1j] * (edges @ [1, 1j]))) > 1e-6
    assert corners.sum() <= 3


def test_plain_ends_can_always_be_joined():
    """Whatever the turn between two near-circles, or a triangle and a circle, or two lines."""
    points, _ = round_off_contours(resample_curve(GLYPHS["k"], 64).points, ContourLayout((64,)))
    triangle, _ = cut_ears(resample_curve(comb(3, 2), 64).points)
    for start in range(0, 64, 7):
        for other in (points[-1], triangle[-1]):
            if area(other) * area(points[-1]) < 0:
                other = other[::-1]
            other = np.roll(other, start, axis=0) + [500, 40]
            poses = join_simplified_poses(points[-1], other, True)
            assert stays_simple(poses)
            np.testing.assert_array_equal(poses[[0, -1]], [points[-1], other])
    one, done = straighten_curve(resample_curve(winding(3), 64).points)
    other, also = straighten_curve(resample_curve(winding(2, -1), 64).points)
    assert done and also and stays_simple(one, False)
    for turn in np.deg2rad([0, 90, 179, 180, 181]):
        turned = other[-1] @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        assert stays_simple(join_simplified_poses(one[-1], turned, False), False)


# --- frames as rigid as possible


def test_a_bar_that_turns_keeps_its_length_on_the_way():
    """The linear frames of such a turn shrink; relaxed ones are the bar, turned."""
    bar = resample_curve(Curve(np.array([[-8, -2], [8, -2], [8, 2], [-8, 2.0]]), True), 64).points

    def turn_bar(angle):
        c, s = np.cos(angle), np.sin(angle)
        return bar @ [[c, s], [-s, c]]

    share = np.linspace(0, 1, 21)[:, None, None]
    linear = (1 - share) * bar + share * turn_bar(2.4)
    stack = linear
    for _ in range(12):
        stack = stack + find_relaxing_moves(stack, ContourLayout((64,)))
    np.testing.assert_array_equal(stack[[0, -1]], linear[[0, -1]])

    def misfit(frame):
        """How far a frame is from the bar, turned as fits best: any turn is as rigid."""
        z, rest = frame @ [1, 1j], bar @ [1, 1j]
        fit = rest.conj() @ (z - z.mean())
        return abs(z - z.mean() - rest * fit / abs(fit)).max()

    assert max(map(misfit, stack)) < 0.2
    assert misfit(linear[10]) > 4


def test_a_fold_in_one_place_leaves_the_rest_rigid():
    """An S straightens: moves to rigid frames fold where it opens, and only there are they less."""
    bar = Curve(np.array([[0, 0], [6, 0], [6, 0.5], [0, 0.5]], float), True)
    frames = morph_without_folds(GLYPHS["S"], bar, 13, 128)
    assert stays_simple(frames)
    edges = np.hypot(*np.moveaxis(np.roll(frames, -1, axis=1) - frames, 2, 0))
    slender = edges.sum(axis=1) / np.sqrt([abs(area(points)) for points in frames])
    assert slender[6] > (slender[0] + slender[-1]) / 2


def test_relaxing_keeps_what_is_rigid_and_refuses_what_has_no_triangles():
    points = resample_curve(GLYPHS["k"], 128).points
    layout = ContourLayout((128,))
    moves = find_relaxing_moves(np.stack([points + [9 * k, 0] for k in range(9)]), layout)
    assert abs(moves).max() < 1e-6 * np.ptp(points)
    eight = points.copy()
    eight[[10, 70]] = eight[[70, 10]]
    assert find_relaxing_moves(np.stack([eight, eight, eight]), layout) is None


# --- the morph


@pytest.mark.parametrize("pair", ["CS", "XI", "MW", "km", "2G", "mJ", "CI"])
def test_glyphs(pair):
    a, b = (GLYPHS[name] for name in pair)
    frames = morph_without_folds(a, b, 62, 256)
    assert not count_polygon_folds(frames).any()
    assert sum(map(folds_seen, frames)) == 0
    one, two = match_curves(a, b, 256)
    np.testing.assert_array_equal(frames[0], one)
    assert set(map(tuple, frames[-1])) == set(map(tuple, two))
    low, high = sorted(abs(area(end)) for end in (one, two))
    if not np.array_equal(frames, linear_morph(a, b, 62, 256)):
        assert all(low * (1 - 1e-9) <= abs(area(frame)) <= high * (1 + 1e-9) for frame in frames)
        assert path_lengths(frames)[-1] < 2 * np.hypot(*(frames[-1] - frames[0]).T).mean()
        steps = np.diff(path_lengths(frames))
        assert steps.max() < 4 * steps.mean()  # no jumps


def test_linear_where_that_is_simple():
    for pair in ("CI", "IS", "HW"):
        a, b = (GLYPHS[name] for name in pair)
        frames = morph_without_folds(a, b, 62, 256)
        np.testing.assert_array_equal(frames, linear_morph(a, b, 62, 256))


def test_a_fold_between_frames_is_no_linear_morph():
    """m → J: all 62 linear frames are simple, but it folds for a moment between two of them."""
    straight = linear_morph(GLYPHS["m"], GLYPHS["J"], 62, 256)
    finer = linear_morph(GLYPHS["m"], GLYPHS["J"], 61 * 200 + 1, 256)
    assert not count_polygon_folds(straight).any() and count_polygon_folds(finer).any()
    frames = morph_without_folds(GLYPHS["m"], GLYPHS["J"], 62, 256)
    assert stays_simple(frames) and not np.array_equal(frames, straight)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (spiral(4, 0.4), spiral(4, 0.4, -1)),
        (spiral(5, 0.4), comb(10, 5)),
        (comb(15, 8), comb(4, 20)),
        (winding(2), winding(2, -1)),
        (winding(4), winding(1, -1)),
    ],
)
def test_tangles(a, b):
    for count in (62, 4):
        frames = morph_without_folds(a, b, count, 256)
        assert not count_polygon_folds(frames, a.closed).any()
        assert sum(folds_seen(frame, a.closed) for frame in frames) == 0


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_any_simple_polygons(seed, back):
    rng = np.random.default_rng(seed)
    a, b = (star_shaped(rng) for _ in range(2))
    b = Curve(b.points[:: -1 if back else 1] * 40 + [300, -20], True)
    if not all(is_simple(resample_curve(curve, 128).points) for curve in (a, b)):
        return
    assert not count_polygon_folds(morph_without_folds(a, b, 20, 128)).any()


def test_too_coarse_to_shorten():
    """Ears are taken off instead: simple all the same."""
    assert not round_off_contours(resample_curve(comb(15, 8), 32).points, ContourLayout((32,)))[1]
    frames = morph_without_folds(comb(15, 8), GLYPHS["S"], 62, 32)
    assert not count_polygon_folds(frames).any()


def test_size_and_place_do_not_matter():
    a, b = GLYPHS["C"], GLYPHS["W"]
    frames = morph_without_folds(a, b, 20, 128)
    moved = [Curve(curve.points * 0.5 + [1024, -512], True) for curve in (a, b)]
    np.testing.assert_allclose(
        morph_without_folds(*moved, 20, 128), frames * 0.5 + [1024, -512], atol=1e-3
    )


def test_curves_that_meet_themselves():
    eight = Curve(np.array([[0, 0], [4, 4], [4, 0], [0, 4]], float), True)
    for which, pair in (("first", (eight, GLYPHS["C"])), ("second", (GLYPHS["C"], eight))):
        with pytest.raises(FinloopError, match=f"{which} curve, at 64 points, meets itself"):
            morph_without_folds(*pair, 5, 64)
    linear = linear_morph(eight, GLYPHS["C"], 5, 64)  # which only counts
    assert count_polygon_folds(linear)[0] > 0


def test_a_letter_becomes_a_sliver_at_even_speed():
    """Its last ears have no area, so the last poses on the way are equal (a warning is an error)."""
    sliver = Curve(np.array([[0, 0], [1, 0], [0.5, 1e-4]]), True)
    frames = morph_without_folds(GLYPHS["S"], sliver, 8, 16)
    assert np.isfinite(frames).all() and not count_polygon_folds(frames).any()
    assert (np.diff(path_lengths(frames)) > 0).all()
