"""Folds of polygons: counts known beforehand, exact arithmetic done anew, and motions between."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from finloop.base.errors import FinloopError
from finloop.morph.folds import count_polygon_folds, is_simple, stays_simple

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def circle(n, radius=1.0, by=1):
    t = 2 * np.pi * by * np.arange(n) / n
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def sign(a, b, c):
    (ax, ay), (bx, by), (cx, cy) = a, b, c
    d = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (d > 0) - (d < 0)


def within(p, a, b):
    return all(min(a[k], b[k]) <= p[k] <= max(a[k], b[k]) for k in range(2))


def folds_by_fractions(points, closed):
    """Pairs of edges that meet, in rational numbers, all pairs looked at."""
    p = [tuple(Fraction(float(x)) for x in point) for point in points]
    n = len(p)
    edges = [(p[i], p[(i + 1) % n]) for i in range(n if closed else n - 1)]
    count = sum(a == b for a, b in edges)
    for (i, (a, b)), (j, (c, d)) in combinations(enumerate(edges), 2):
        if j == i + 1 or (closed and i == 0 and j == n - 1):
            before, corner, after = (a, b, d) if j == i + 1 else (c, d, b)
            if before != corner != after and n > 2 and sign(before, corner, after) == 0:
                both = zip(before, corner, after, strict=True)
                count += sum((x - y) * (z - y) for x, y, z in both) > 0
            continue
        across = sign(a, b, c) * sign(a, b, d) < 0 and sign(c, d, a) * sign(c, d, b) < 0
        count += across or any(
            sign(u, v, w) == 0 and within(w, u, v)
            for u, v, w in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
        )
    return count


def test_no_folds_in_simple_polygons():
    assert count_polygon_folds(SQUARE).tolist() == [0]
    assert is_simple(circle(1000)) and is_simple(circle(3)) and is_simple(circle(1000)[::-1])
    assert is_simple(np.array([[0, 0], [1, 0], [2, 0], [2, 1], [0, 1]], float))  # straight on


@pytest.mark.parametrize(("n", "by"), [(5, 2), (7, 3), (16, 3), (101, 7), (257, 5), (1024, 3)])
def test_star_polygons(n, by):
    """Each edge of {n / by} meets 2 (by − 1) others in crossings, every one shared by two."""
    star = circle(n, by=by) + np.random.default_rng(n).normal(0, 1e-9, (n, 2))
    assert count_polygon_folds(star).tolist() == [n * (by - 1)]
    assert not is_simple(star)


def test_touching_is_folding():
    bow = SQUARE[[0, 2, 1, 3]]
    point_on_edge = np.array([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], float)
    spike = np.array([[0, 0], [4, 0], [2, 0], [2, 2]], float)
    twice = np.array([[0, 0], [1, 0], [1, 0], [1, 1], [0, 1]], float)
    for polygon in (bow, point_on_edge, spike, twice):
        assert not is_simple(polygon)
        assert count_polygon_folds(polygon)[0] == folds_by_fractions(polygon, True) > 0


def test_open_curves_have_no_last_edge():
    bow = SQUARE[[0, 2, 1, 3]]
    assert not is_simple(bow)
    u = np.array([[0, 0], [0, 1], [1, 1], [1, -1], [-1, -1], [-1, 2], [3, 2]], float)
    assert is_simple(u, closed=False) and not is_simple(u)
    assert is_simple(SQUARE[:2], closed=False)
    back = np.array([[0, 0], [2, 0], [1, 0]], float)
    assert count_polygon_folds(back, closed=False).tolist() == [1]


def test_one_unit_in_the_last_place():
    """A vertex beside an edge, on it, and beyond by the smallest step there is."""
    for height, count in ((np.nextafter(0.1, 1), 0), (0.1, 2), (np.nextafter(0.1, 0), 2)):
        low = np.array([[0, 0.1], [2, 0.1], [2, 3], [1, height], [0, 3]])
        assert (count_polygon_folds(low)[0] > 0) == (count > 0)
        assert count_polygon_folds(low)[0] == folds_by_fractions(low, True)
    slope = np.array([[0, 0], [3, 0.3], [3, 2], [1, 0.1], [0, 2]])
    assert count_polygon_folds(slope)[0] == folds_by_fractions(slope, True)


coordinate = st.integers(0, 5).map(float)
near = st.tuples(st.integers(0, 3), st.integers(-2, 2)).map(lambda v: v[0] / 10 + v[1] * 2.0**-55)


@settings(max_examples=150)
@given(
    st.one_of(
        st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=24),
        st.lists(st.tuples(near, near), min_size=3, max_size=12),
    ),
    st.booleans(),
)
def test_counts_as_fractions_do(points, closed):
    points = np.array(points)
    assert count_polygon_folds(points, closed)[0] == folds_by_fractions(points, closed)
    assert is_simple(points, closed) == (count_polygon_folds(points, closed)[0] == 0)


def test_rigid_motions_stay_simple():
    shape = circle(200) * (1 + 0.6 * np.cos(7 * np.arange(200) * 2 * np.pi / 200))[:, None]
    turn = np.deg2rad(60)
    turned = shape @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    assert stays_simple(np.stack([shape, shape + [5, 3], 0.1 * turned, turned]))
    assert not stays_simple(np.stack([shape, -shape]))  # through a point


def test_a_fold_between_two_simple_poses_is_found():
    """An end goes through an edge; neither pose shows it."""
    above = np.array([[0, 0], [4, 0], [4.5, 1], [2, 1]], float)
    below = above * [1, -1]
    assert is_simple(above, False) and is_simple(below, False)
    assert not stays_simple(np.stack([above, below]), closed=False)
    aside = above + [[0, 0], [0, 0], [0, 0], [5, 2]]  # out past the corner, and in below
    assert stays_simple(np.stack([above, aside, aside * [1, -1], below]), closed=False)


def test_an_edge_that_turns_through_a_point_is_contact():
    here = np.array([[0, 0], [1, 0], [1, 2], [2, 2], [2, 5], [-1, 5], [-1, 0]], float)
    there = here.copy()
    there[2:4] = [[1, 2], [0, 2]]
    there[4] = [0, 5]
    assert is_simple(here) and is_simple(there) and not stays_simple(np.stack([here, there]))


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1), st.integers(4, 9), st.floats(0.05, 1.5), st.booleans())
def test_proved_motions_show_no_fold_at_any_moment(seed, n, much, closed):
    rng = np.random.default_rng(seed)
    start = circle(n)[rng.permutation(n)] if much > 1.2 else circle(n)
    ends = np.stack([start, start + rng.normal(0, much, (n, 2))])
    share = np.linspace(0, 1, 301)[:, None, None]
    folded = count_polygon_folds((1 - share) * ends[0] + share * ends[1], closed).any()
    proved = stays_simple(ends, closed)
    assert not (proved and folded)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_small_motions_are_proved(seed):
    """Edges of 0.098, and no vertex goes a quarter of that: none comes near another edge."""
    rng = np.random.default_rng(seed)
    path = circle(64) + rng.uniform(-0.017, 0.017, (3, 64, 2))
    assert stays_simple(path)


def test_bad_stacks():
    for bad in (SQUARE[:2], np.zeros((3, 4, 3)), np.zeros(4)):
        with pytest.raises(FinloopError, match="polygons of shape"):
            count_polygon_folds(bad)
    with pytest.raises(FinloopError, match="not finite"):
        count_polygon_folds(SQUARE * np.nan)
