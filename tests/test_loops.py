"""Video loops: finding them, their graph, the position table; laws, the paper's figures, a toy film.

Maps are drawn here: a film is a row of numbers or of points, D the distance between them. y is
down in pixels; angles are degrees, anticlockwise as seen.
"""

import re
from collections import defaultdict
from itertools import pairwise, product
from string import ascii_uppercase

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from constants import with_constants
from scipy.spatial.distance import cdist
from scratch import content, prepare, put_clip, same_but_figures

import stages.loops
import stages.plots.loops
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.distance.map import PAIRS, STEPS, MapFacts
from finloop.distance.picture import BODY, successive_distances
from finloop.distance.reel import Reel
from finloop.features.table import FEATURES, wrap_deg
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import save_record
from finloop.io.table import load_table, save_table
from finloop.loops.graph import (
    JUMP,
    PLAY,
    Leg,
    build_loop_graph,
    can_play_for_ever,
    find_routes,
    rows_of_largest_component,
)
from finloop.loops.positions import (
    choose_table_ends,
    merge_play_legs,
    position_table,
    quadrant_of_displacement,
    route_table,
)
from finloop.loops.search import (
    LOOPS,
    LoopsSettings,
    binomial_weights,
    choose_best_loops,
    filter_diagonals,
    find_improper_loops,
    find_local_minima,
    find_loop_candidates,
    find_video_loops,
    group_overlapping_loops,
    measure_travel,
    to_sparse_map,
)
from finloop.plots.improper_loop import figure13, find_most_improper_loop, loop_path_rows
from finloop.plots.loop_groups import figure12, find_runs, rows_within_loops
from finloop.plots.loop_routes import figure10, find_three_routes, jump_legs, route_letters
from finloop.plots.loops import choose_separate_loops, spread_table_rows

RATE = 20.0
DELTA = 4
EASY = LoopsSettings(
    distance_threshold=1.0, min_length_deltas=2.5, compared_neighbour_frames=1,
    improper_angle_deg=90.0, loop_end_choice="play", min_deltas_between_jumps=1.0, join="fade",
)  # fmt: skip


def settings(**asked):
    return with_constants(EASY, **asked)


def features_at(x, y, heading=0.0, track=0, length=50.0):
    """A feature table of fish at places (y up here) with headings; only what loops look at."""
    n = len(x)
    track = np.broadcast_to(track, n).astype(np.int32)
    table = pd.DataFrame({c.name: np.zeros(n) for c in FEATURES.columns})
    table["track_id"], table["frame"] = track, pd.Series(track).groupby(track).cumcount()
    table["time_s"] = table["frame"] / RATE
    table["x_px"], table["y_px"] = np.asarray(x, float), -np.asarray(y, float)
    table["heading_deg"] = np.broadcast_to(heading, n).astype(float)
    table["body_length_px"], table["orientation"] = length, 1
    left = table[::-1].groupby("track_id").cumcount()[::-1]
    table["displacement"] = np.where(left < DELTA, np.nan, 0.0)
    table["included_angle_deg"] = table["displacement"]
    return table


def still(n, track=0):
    return features_at(np.zeros(n), np.zeros(n), track=track)


def film_map(film, keep=np.inf):
    """The sparse map of a film (n, k), pairs i < j up to `keep`."""
    film = np.asarray(film, float).reshape(len(film), -1)
    i, j = np.triu_indices(len(film), 1)
    far = np.linalg.norm(film[i] - film[j], axis=1)
    kept = far <= keep
    table = pd.DataFrame({"i": i[kept], "j": j[kept], "distance": far[kept]})
    return to_sparse_map(table, len(film))


def dense(pairs, values):
    """A square matrix of a value for every pair of a map, inf elsewhere."""
    n = len(pairs.start) - 1
    out = np.full((n, n), np.inf)
    out[np.repeat(np.arange(n), np.diff(pairs.start)), pairs.j] = values
    return out


def filtered_map(pairs, track, n, limit):
    return filter_diagonals(pairs, track, binomial_weights(n), limit)


def minima_of(pairs, value, track, radius, least):
    minimal = find_local_minima(pairs, value, track, radius, least)
    found = dense(pairs, np.where(minimal, 0.0, np.inf))
    return [tuple(pair) for pair in np.argwhere(found == 0).tolist()]


# -- finding ----------------------------------------------------------------------------------------


def written_out(far, track, n, radius, least, limit):
    """Diagonal filter and local minima, over a dense map, as they are defined."""
    rows = len(far)
    value = np.full_like(far, np.inf)
    for a in range(rows):
        for b in range(a + 1, rows):
            ks = np.arange(-n, n + 1)
            if min(a, b) - n < 0 or max(a, b) + n >= rows:
                continue
            if any(track[a + ks] != track[a]) or any(track[b + ks] != track[b]):
                continue
            total = (binomial_weights(n) * far[a + ks, b + ks]).sum()
            if total <= limit:
                value[a, b] = total
    found = []
    for a, b in zip(*np.nonzero(np.isfinite(value)), strict=True):
        if track[a] == track[b] and b - a < least:
            continue
        rows_near = [r for r in range(rows) if abs(r - a) <= radius and track[r] == track[a]]
        columns = [c for c in range(rows) if abs(c - b) <= radius and track[c] == track[b]]
        block = value[np.ix_(rows_near, columns)]
        if value[a, b] == block.min():
            found.append((int(a), int(b)))
    return value, found


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("n", [0, 1, 2])
def test_filter_and_minima_are_as_defined(seed, n):
    rng = np.random.default_rng(seed)
    track = np.sort(rng.integers(0, 4, 70)).astype(np.int32)
    pairs = film_map(np.cumsum(rng.normal(size=(70, 2)), axis=0), keep=4.0)
    value = filtered_map(pairs, track, n, 2.0)
    want_value, want = written_out(dense(pairs, pairs.distance), track, n, 2, 6, 2.0)
    np.testing.assert_allclose(dense(pairs, value), want_value, rtol=1e-6)
    assert want  # else the test says nothing
    assert minima_of(pairs, value, track, 2, 6) == want


def test_of_equal_minima_the_first_is_one():
    """A film that stands still for a while is alike in all its frames."""
    film = np.r_[np.arange(10), np.full(3, 20.0), np.arange(30, 50), np.full(3, 20.0), [60, 70]]
    pairs = film_map(film[:, None], keep=0.1)
    track = np.zeros(38, np.int32)
    assert minima_of(pairs, filtered_map(pairs, track, 0, 1.0), track, 3, 10) == [(10, 33)]


def test_loops_of_a_periodic_film_are_whole_periods():
    period, rows = 16, 70
    angle = 2 * np.pi * np.arange(rows) / period
    film = np.stack([np.cos(angle), np.sin(angle), 0.5 * np.sin(2 * angle)], 1)
    loops, counts = find_video_loops(
        film_map(film), still(rows), RATE, 0.4, settings(max_loops_per_end=99)
    )
    assert set((loops["b"] - loops["a"]) % period) == {0}
    np.testing.assert_allclose(loops["length_s"], (loops["b"] - loops["a"]) / RATE)
    assert loops["filtered"].is_monotonic_increasing
    assert list(loops["loop"]) == list(range(len(loops)))
    assert counts["pairs"] == rows * (rows - 1) // 2 and counts["minima"] == len(loops)


def test_dynamics_keep_the_direction_of_motion():
    """A tail that beats to and fro looks the same on its way out and back, and moves otherwise."""
    film = np.sin(2 * np.pi * (np.arange(120) + 0.5) / 24)[:, None]
    speed = np.gradient(film[:, 0])
    step = np.median(np.abs(np.diff(film[:, 0])))

    def opposed_share(n):
        p = settings(compared_neighbour_frames=n, distance_threshold=0.4, max_loops_per_end=99)
        loops, _ = find_video_loops(film_map(film), still(120), RATE, step, p)
        fast = (np.abs(speed[loops["a"]]) > step / 2) & (np.abs(speed[loops["b"]]) > step / 2)
        return (np.sign(speed[loops["a"]]) != np.sign(speed[loops["b"]]))[fast].mean()

    assert opposed_share(0) > 0.2  # without it, as often as not
    assert opposed_share(1) == 0


def test_no_loop_lies_at_the_end_of_a_track_or_looks_beyond_it():
    """Two tracks that show the same: every frame is like its twin, but the ends have no past."""
    film = np.tile(np.arange(30) * 5.0, 2)[:, None]
    track = np.repeat([3, 8], 30).astype(np.int32)
    for n in (0, 1, 2):
        value = filtered_map(film_map(film, 1), track, n, 5.0)
        assert np.isfinite(value).tolist() == [n <= frame < 30 - n for frame in range(30)]
    loops, _ = find_video_loops(
        film_map(film, 1), still(60, track), RATE, 5.0, settings(compared_neighbour_frames=2)
    )
    assert sorted(loops["a"]) == list(range(2, 28, 3))  # all equal: as near as apart allows
    assert (loops["b"] - loops["a"] == 30).all() and loops["length_s"].isna().all()


# -- Fig. 13 ----------------------------------------------------------------------------------------

LINE = np.arange(40) * 3.0


@pytest.mark.parametrize(
    ("heading", "bad"), [(0, False), (180, True), (80, False), (100, True), (-80, False)]
)
def test_a_loop_is_improper_if_it_travels_against_the_heading(heading, bad):
    """The fish drifts to the right; each end does too, so look at each test alone."""
    table = features_at(LINE, np.zeros(40), heading)
    assert find_improper_loops(np.array([5]), np.array([30]), table, 90.0)[0] == bad
    across = features_at(np.r_[LINE[:20], LINE[:20]], np.zeros(40), heading, np.repeat([0, 1], 20))
    # ... by its ends alone
    assert find_improper_loops(np.array([5]), np.array([30]), across, 90.0)[0] == bad
    # ... and by its whole way alone: at its ends the fish stays where it is.
    held = np.r_[np.zeros(10), np.arange(20) * 3.0, np.full(10, 57.0)]
    table = features_at(held, np.zeros(40), heading)
    assert find_improper_loops(np.array([5]), np.array([35]), table, 90.0)[0] == bad


def test_a_fish_that_turned_round_or_stayed_is_not_tested():
    # Nearly a full circle: what is left of its headings says nothing of where it gets to.
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    circle = features_at(
        100 * np.sin(angle) + 3 * np.arange(60), -100 * np.cos(angle), wrap_deg(np.degrees(angle))
    )
    assert not find_improper_loops(np.array([2]), np.array([57]), circle, 90.0)[0]
    stays = features_at(np.arange(40) * -0.01, np.zeros(40))  # it drifts back by almost nothing
    assert not find_improper_loops(np.array([5]), np.array([30]), stays, 90.0)[0]


def test_improper_loops_are_dropped_and_counted():
    film = np.tile(np.arange(20) * 5.0, 2)[:, None]
    for heading, kept in ((0, True), (180, False)):
        table = features_at(np.arange(40) * 3.0, np.zeros(40), heading)
        if kept:
            loops, counts = find_video_loops(film_map(film, 1), table, RATE, 5.0, EASY)
            assert len(loops) and counts["improper_dropped"] == 0
        else:
            with pytest.raises(FinloopError, match=r"loops.improper_angle_deg=180"):
                find_video_loops(film_map(film, 1), table, RATE, 5.0, EASY)


# -- choice, groups ---------------------------------------------------------------------------------


def test_no_end_has_more_loops_than_asked_and_only_full_ends_lose_one():
    rng = np.random.default_rng(1)
    pairs = np.unique(np.sort(rng.integers(0, 30, (300, 2)), axis=1), axis=0).astype(np.int32)
    a, b = rng.permutation(pairs[pairs[:, 0] < pairs[:, 1]]).T.copy()
    keep = choose_best_loops(a, b, 3)
    used = np.bincount(np.r_[a[keep], b[keep]], minlength=30)
    assert used.max() == 3 and keep[0]
    for p in np.flatnonzero(~keep):  # better ones had filled one of its ends
        before = np.r_[a[:p][keep[:p]], b[:p][keep[:p]]]
        assert max((before == a[p]).sum(), (before == b[p]).sum()) == 3
    assert choose_best_loops(a, b, 10**6).all()


def test_loops_fall_into_groups_as_in_fig12():
    """Six loops in time order; the former three overlap, and the later three do."""
    a, b = np.array([0, 3, 6, 20, 22, 25]), np.array([5, 9, 11, 24, 30, 28])
    assert group_overlapping_loops(a, b, np.zeros(40, int)).tolist() == [0, 0, 0, 1, 1, 1]
    later = np.r_[a, 32], np.r_[b, 36]
    assert group_overlapping_loops(*later, np.zeros(40, int)).tolist() == [0, 0, 0, 1, 1, 1, 2]
    # One from group to group joins them; the last stays alone.
    joined = np.r_[later[0], 10], np.r_[later[1], 21]
    assert group_overlapping_loops(*joined, np.zeros(40, int)).tolist() == [0, 0, 0, 0, 0, 0, 1, 0]


def test_a_loop_across_tracks_lies_over_its_two_ends_alone():
    track = np.repeat([0, 1, 2], 20)
    a, b = np.array([2, 22, 5, 12]), np.array([10, 30, 25, 50])
    # (12, 50) passes over (22, 30), no more.
    assert group_overlapping_loops(a, b, track).tolist() == [0, 0, 0, 1]
    assert group_overlapping_loops(a, b, np.zeros(60, int)).tolist() == [0, 0, 0, 0]


# -- the graph: Fig. 10 -----------------------------------------------------------------------------


def table_of(*pairs, distance=1.0):
    a, b = np.array(pairs).T
    return pd.DataFrame({"a": a, "b": b, "distance": np.float32(distance)})


FIG10 = {name: 10 * k + 5 for k, name in enumerate("ABCDEFGH")}
LOOPS_OF_FIG10 = ["AG", "BE", "DF", "CH"]


@pytest.fixture(scope="module")
def fig10():
    pairs = [tuple(FIG10[end] for end in name) for name in LOOPS_OF_FIG10]
    return build_loop_graph(table_of(*pairs), np.zeros(90, int))


def way_letters(way):
    """A way as the paper writes it."""
    letter = {row: name for name, row in FIG10.items()}
    return "".join([letter[way[0][0]], *(letter[b] for _, b, _ in way)])


def test_the_ways_of_fig10(fig10):
    source, target = "ABCDEFGH".index("G"), "ABCDEFGH".index("F")
    ways = find_routes(fig10, source, target, 12)
    found = [way_letters(way) for way in ways]
    assert {"GHCDEF", "GABCDEF", "GHCDEBCDEF"} <= set(found)
    assert set(found[:2]) == {"GHCDF", "GABEF"}  # by two loops, quicker than what the paper draws
    assert len(set(found)) == len(found) == 9  # all that take no jump twice
    shown = [sum(b - a for a, b, how in way if how == PLAY) for way in ways]
    assert shown == sorted(shown)
    for way in ways:
        jumps = [leg for leg in way if leg[2] == JUMP]
        assert len(set(jumps)) == len(jumps)
        assert all(leg[2] == PLAY or following[2] == PLAY for leg, following in pairwise(way))
        assert all(leg[1] == following[0] for leg, following in pairwise(way))


def test_dear_jumps_are_rare(fig10):
    source, target = "ABCDEFGH".index("G"), "ABCDEFGH".index("F")
    assert [(65, 75, PLAY), (75, 25, JUMP), (25, 35, PLAY), (35, 55, JUMP)] in find_routes(
        fig10, source, target, 2
    )
    (dear,) = find_routes(fig10, source, target, 1, jump_frames=1000)
    assert way_letters(dear) == "GHCDEF"  # the quickest of those with one jump


def test_no_way_is_an_empty_list():
    graph = build_loop_graph(table_of((5, 25), (35, 55)), np.zeros(60, int))
    assert find_routes(graph, 0, 3, 5)  # playing on leads there
    assert find_routes(graph, 3, 0, 5) == []  # Fig. 12: never back


def test_the_graph_of_fig10(fig10):
    assert fig10.ends.tolist() == list(FIG10.values())
    assert fig10.ahead.tolist() == [1, 2, 3, 4, 5, 6, 7, -1]
    ends = [[int(t) for t in fig10.jump_targets(k)] for k in range(8)]
    assert ends == [[6], [4], [7], [5], [1], [3], [0], [2]]
    assert fig10.component.tolist() == [0, 0, 0, 0, 0, 0, 0, 1]  # no film follows H
    assert fig10.endless.tolist() == [True] * 7 + [False]
    assert can_play_for_ever(fig10, np.zeros(90, int)).tolist() == [True] * 75 + [False] * 15
    assert rows_of_largest_component(fig10, 90).nonzero()[0].tolist() == list(range(5, 75))


def test_one_loop_goes_on_for_ever_within_a_track_alone():
    graph = build_loop_graph(table_of((10, 30)), np.zeros(40, int))
    assert graph.cyclic.tolist() == [True, False] and graph.endless.tolist() == [True, False]
    assert graph.segment_frames.tolist() == [20, 0]
    # Between two tracks it leads there and back, and from either the film runs out.
    graph = build_loop_graph(table_of((10, 30)), np.repeat([0, 1], 20))
    assert not graph.endless.any() and not graph.cyclic.any()
    assert not can_play_for_ever(graph, np.repeat([0, 1], 20)).any()


@pytest.mark.parametrize("seed", range(3))
def test_components_and_dead_ends_are_those_of_the_film_frame_by_frame(seed):
    """Against a graph of all rows: each is followed by the next, or by what is shown instead."""
    rng = np.random.default_rng(seed)
    track = np.sort(rng.integers(0, 5, 120))
    pairs = np.unique(np.sort(rng.integers(0, 120, (9, 2)), axis=1), axis=0)
    loops = table_of(*[(a, b) for a, b in pairs.tolist() if b - a > 3])
    graph = build_loop_graph(loops, track)
    reach = np.zeros((120, 120), bool)
    reach[np.arange(119), np.arange(1, 120)] = track[1:] == track[:-1]
    for a, b in loops[["a", "b"]].to_numpy().tolist():
        for end, instead in ((a, b), (b, a)):
            if end and track[end - 1] == track[end]:
                reach[end - 1, instead] = True
    for _ in range(7):  # steps, double steps, … 128 steps
        reach |= (reach.astype(np.float32) @ reach) > 0
    again = reach.diagonal()
    for_ever = (reach & again).any(axis=1)
    np.testing.assert_array_equal(can_play_for_ever(graph, track), for_ever)
    np.testing.assert_array_equal(graph.endless, for_ever[graph.ends])
    together = reach & reach.T
    mine = rows_of_largest_component(graph, 120)
    if again.any():
        assert mine.sum() == together.sum(axis=1).max()
        np.testing.assert_array_equal(together[mine.argmax()], mine)
    else:
        assert not graph.cyclic.any()


def test_the_first_component_has_the_most_film_not_the_most_loops():
    many = [(5, 15), (10, 20), (17, 25)]
    graph = build_loop_graph(table_of(*many, (60, 110)), np.zeros(120, int))
    assert graph.component[np.searchsorted(graph.ends, 60)] == 0
    assert rows_of_largest_component(graph, 120).nonzero()[0].tolist() == list(range(60, 110))


def test_jumps_are_sorted_by_distance():
    graph = build_loop_graph(
        table_of((10, 30), (10, 50), (10, 70), distance=[3, 1, 2]), np.zeros(80)
    )
    assert graph.jump_targets(0).tolist() == [2, 3, 1]
    assert graph.distance[:3].tolist() == [1, 2, 3]


# -- the position table: Fig. 11 --------------------------------------------------------------------

FIG11 = """,A,B,C,D,E,F,G,H
A,,1,2,2,2,2,1,1
B,,,2,2,2,2,2,1
C,,,,2,2,2,1,1
D,,,,,2,2,1,1
E,,,,,,2,1,4
F,,,,,,,1,4
G,,,,,,,,4
H,,,,,,,,
"""
PLACES = [(0, 0), (2, 1), (-1, 2), (-2, 3), (-3, 5), (-4, 6), (1, 7), (3, 4)]  # of A … H, y up


def test_the_table_of_fig11_as_printed():
    """A way that goes as the figure's does, from end to end in straight lines."""
    rows = np.array(list(FIG10.values()))
    x, y = (np.interp(np.arange(90), rows, [p[k] for p in PLACES]) for k in (0, 1))
    table = position_table(rows, features_at(50 * x, 50 * y))
    assert table.to_csv(lineterminator="\n") == FIG11
    assert table.loc["F", "G"] == "1" and table.loc["F", "H"] == "4"


def test_quadrants_count_anticlockwise_from_the_upper_right():
    """The quadrant is the whole number of right angles in the direction; axes end the one before."""
    for dx, dy in product(range(-3, 4), repeat=2):
        angle = np.degrees(np.arctan2(dy, dx)) % 360
        assert quadrant_of_displacement(float(dx), float(dy)) == angle // 90 + 1


def test_the_table_is_of_pairs_of_one_track_and_y_is_up():
    rng = np.random.default_rng(3)
    x, y = rng.normal(0, 100, (2, 80))
    features = features_at(x, y, track=np.repeat([2, 7], 40))
    table = position_table(np.array([3, 9, 20, 38, 45, 60]), features)
    pairs = [table.index[i] + table.columns[j] for i, j in np.argwhere(table.to_numpy() != "")]
    assert pairs == ["AB", "AC", "AD", "BC", "BD", "CD", "EF"]
    assert table.loc["A", "B"] == str(quadrant_of_displacement(x[9] - x[3], y[9] - y[3]))


def test_a_table_for_people_has_at_most_26_ends_of_one_track():
    track = np.repeat([0, 1], [50, 300])
    few = np.array([5, 9, 60, 90, 120])
    assert choose_table_ends(few, track).tolist() == [60, 90, 120]
    some = choose_table_ends(np.arange(50, 350), track)
    assert len(some) == 26 and some[0] == 50 and some[-1] == 349
    assert np.diff(some).max() <= 2 * np.diff(some).min()
    assert (np.diff(choose_table_ends(np.r_[50:90, 340:350], track)) > 0).all()


def test_routes_are_told_stretch_by_stretch(fig10):
    rows = [(65, 75, PLAY), (75, 25, JUMP), (25, 35, PLAY), (35, 45, PLAY), (45, 55, PLAY)]
    way = [Leg(*leg) for leg in rows]
    assert merge_play_legs(way) == [(65, 75, PLAY), (75, 25, JUMP), (25, 55, PLAY)]
    told = route_table([way, way[:1]], fig10, still(90, 4), step_median=2.0)
    assert told["route"].tolist() == [1, 1, 1, 2]
    assert told["frames"].tolist() == [10, 0, 30, 10]
    assert told["jump_distance"].dropna().tolist() == [0.5]
    assert told["from_track"].eq(4).all() and told["from_frame"].tolist() == [65, 75, 25, 65]
    assert list(route_table([], fig10, still(90), 2.0).columns) == list(told.columns)


# -- no loops ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [10.0, 1e-3])
@pytest.mark.parametrize("threshold", [0.2, 0.0])
def test_too_low_a_threshold_is_told_which_would_have_done(unit, threshold):
    film = np.r_[np.arange(20.0), np.arange(20.0) + 0.304][:, None] * unit
    given = film_map(film), still(40), RATE, unit
    with pytest.raises(FinloopError) as error:
        find_video_loops(*given, settings(distance_threshold=threshold))
    assert f"loops.distance_threshold {threshold:g} (median" in error.value.came
    assert "loops.distance_threshold=0.31 " in error.value.do
    assert len(find_video_loops(*given, settings(distance_threshold=0.31))[0])
    with pytest.raises(FinloopError):
        find_video_loops(*given, settings(distance_threshold=0.3))


@pytest.mark.parametrize(
    ("frames", "keep", "message"),
    [
        (10, 99.0, "one track of 10 frames.*at least 10 apart"),
        (60, 0.5, "(?s)no pair of frames at all.*distance.max_distance_steps"),
        # Only frames close in time are alike.
        (60, 3.0, "(?s)at any threshold.*loops.min_length_deltas 2.5"),
    ],
)
def test_the_error_of_a_film_without_loops_says_why(frames, keep, message):
    pairs = film_map(np.arange(float(frames)), keep)
    with pytest.raises(FinloopError, match=message):
        find_video_loops(pairs, still(frames), RATE, 1.0, EASY)


# -- pictures ---------------------------------------------------------------------------------------


def test_a_sample_is_even_and_examples_are_apart():
    loops = pd.DataFrame({"a": np.arange(1000), "b": np.arange(1000) + 2000})
    some = spread_table_rows(loops, 11)
    assert len(some) == 11 and some["a"].iloc[[0, -1]].tolist() == [0, 999]
    assert len(spread_table_rows(loops[:5], 11)) == 5 and len(spread_table_rows(loops[:0], 11)) == 0
    places = choose_separate_loops(loops, 20, 4)
    assert places == [0, 21, 42, 63]
    assert choose_separate_loops(loops[:5], 20, 4) == [0]


# -- Fig. 10, three ways ----------------------------------------------------------------------------


def within_track(*pairs, rate=RATE):
    """Loops of one track, or of the tracks that a table of features says."""
    table = table_of(*pairs)
    return table.assign(length_s=(table["b"] - table["a"]) / rate, group=0)


PAPERS = [tuple(FIG10[end] for end in name) for name in LOOPS_OF_FIG10]


def test_the_papers_loops_give_the_papers_three_ways():
    three = find_three_routes(within_track(*PAPERS), np.zeros(90, int))
    assert three.ends.tolist() == list(FIG10.values())
    ways = [route_letters(way, three.ends) for way in three.cases]
    assert ways == ["GHCDEF", "GABCDEF", "GHCDEBCDEF"]


def check_cases(three):
    """The three ways begin at G, end at F and differ in their jumps as in Fig. 10b."""
    g, f = three.ends[[6, 5]]
    for way in three.cases:
        assert way[0][0] == g and way[-1][1] == f
        assert all(leg[1] == following[0] for leg, following in pairwise(way))
        assert all(b > a for a, b, how in way if how == PLAY)
    first, second, third = three.cases
    jumps = [len(jump_legs(way)) for way in three.cases]
    assert jumps == [1, 1, 2] and jump_legs(third)[0] == jump_legs(first)[0]
    assert first[0][2] == third[0][2] == PLAY and second[0][2] == JUMP
    assert all(a > b for a, b, _ in jump_legs(third))
    shown = [sum(b - a for a, b, how in way if how == PLAY) for way in three.cases]
    assert shown[2] > shown[0]


@pytest.mark.parametrize("seed", range(4))
def test_whatever_loops_are_found_their_ways_are_those_of_fig10(seed):
    rng = np.random.default_rng(seed)
    pairs = np.unique(np.sort(rng.integers(0, 200, (12, 2)), axis=1), axis=0)
    loops = within_track(*pairs[pairs[:, 0] < pairs[:, 1]].tolist())
    three = find_three_routes(loops, np.zeros(200, int))
    assert three is not None
    check_cases(three)
    ends = three.loops[["a", "b"]].to_numpy()
    assert sorted(ends.ravel()) == three.ends.tolist() and len(set(three.ends)) == 8


def test_loops_side_by_side_or_across_tracks_have_no_three_ways():
    apart_in_time = within_track((5, 15), (20, 30), (35, 45), (50, 60), (65, 75))
    assert find_three_routes(apart_in_time, np.zeros(90, int)) is None
    across = within_track(*PAPERS).assign(length_s=np.nan)
    assert find_three_routes(across, np.zeros(90, int)) is None
    assert find_three_routes(within_track(*PAPERS[:3]), np.zeros(90, int)) is None


def test_of_two_tracks_the_loops_are_of_the_one_that_is_easier_to_read():
    crowded = [(a // 5 + 100, b // 5 + 100) for a, b in PAPERS[:3]] + [(108, 120)]
    track = np.repeat([0, 1], [90, 90])
    three = find_three_routes(within_track(*PAPERS, *crowded), track)
    assert (track[three.ends] == 0).all() and three.ends.tolist() == list(FIG10.values())


# -- Fig. 12, groups --------------------------------------------------------------------------------


def test_stretches_are_of_one_track_and_hold_what_is_inside():
    track = np.repeat([0, 1, 4], [5, 3, 4])
    inside = np.array([1, 1, 0, 1, 1, 1, 0, 0, 1, 1, 1, 1], bool)
    assert find_runs(inside, track) == [(0, 2), (3, 5), (5, 6), (8, 12)]
    assert find_runs(~inside, track) == [(2, 3), (6, 8)]
    assert find_runs(np.zeros(12, bool), track) == []


@pytest.mark.parametrize("seed", range(2))
def test_no_film_lies_below_two_groups(seed):
    rng = np.random.default_rng(seed)
    track = np.sort(rng.integers(0, 6, 150))
    pairs = np.unique(np.sort(rng.integers(0, 150, (14, 2)), axis=1), axis=0)
    a, b = pairs[pairs[:, 0] < pairs[:, 1]].T
    loops = pd.DataFrame({"a": a, "b": b, "group": group_overlapping_loops(a, b, track)})
    below = [rows_within_loops(mine, track) for _, mine in loops.groupby("group")]
    assert np.sum(below, axis=0).max() == 1 and len(below) > 1
    for _, loop in loops.iterrows():
        ends = loop[["a", "b"]].to_numpy()
        assert below[loop["group"]][ends].all()
        if track[ends[0]] == track[ends[1]]:
            assert below[loop["group"]][ends[0] : ends[1] + 1].all()


def test_fig_12_tells_the_sizes_of_the_groups_and_names_the_dead_ends():
    """The former three loops overlap, and the later three do; after the last the film ends."""
    pairs = [(0, 5), (3, 9), (6, 11), (20, 24), (22, 30), (25, 28)]
    loops = within_track(*pairs, rate=1.0)
    track = np.zeros(40, int)
    loops["group"] = group_overlapping_loops(loops["a"].to_numpy(), loops["b"].to_numpy(), track)
    figure = figure12(loops, build_loop_graph(loops, track), still(40), 1.0)
    within, every, bar, *_ = figure.axes
    assert "6 loops within a track, 2 groups" in within.get_title("left")
    assert [text.get_text() for text in within.texts] == ["3", "3"]
    (side,) = every.child_axes
    shown = [label.get_text() for label in side.get_yticklabels()]
    assert shown == ["3 loops over 12.0 s of film", "3 loops over 11.0 s of film"]
    (named,) = bar.texts
    assert named.get_text().splitlines() == ["track 0", "frames 30–39", "10.0 s"]


def test_fig_12_has_as_many_rows_as_can_be_read():
    pairs = [(20 * k, 20 * k + 5) for k in range(15)]
    loops = within_track(*pairs)
    track = np.zeros(320, int)
    loops["group"] = group_overlapping_loops(loops["a"].to_numpy(), loops["b"].to_numpy(), track)
    figure = figure12(loops, build_loop_graph(loops, track), still(320), RATE)
    (side,) = figure.axes[1].child_axes
    shown = [label.get_text() for label in side.get_yticklabels()]
    assert len(shown) == 10 and shown[-1].startswith("6 more groups: 6 loops")


# -- Fig. 13, an improper loop ----------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.0, 50.0, 180.0, -110.0])
def test_travel_and_heading_turn_with_the_film(turn):
    spin = np.exp(1j * np.radians(turn))
    place = (LINE - 0.3j * LINE) * spin
    table = features_at(place.real, place.imag, wrap_deg(np.array([turn + 10.0]))[0])
    travel = measure_travel(np.array([5]), np.array([30]), table)
    assert travel.off_deg == pytest.approx(10 + np.degrees(np.arctan(0.3)), abs=1e-3)
    assert wrap_deg(travel.heading_deg - turn) == pytest.approx(10, abs=1e-3)


def test_the_improper_loop_that_is_drawn_goes_farthest_against_its_heading():
    x = np.r_[np.zeros(30), -LINE[:30], np.zeros(10)]  # it drifts backwards in the middle
    table = features_at(x, np.zeros(70))
    pairs = [(2, 25), (10, 55), (30, 50)]
    bad = find_improper_loops(*np.array(pairs).T, table, 90.0)
    assert bad.tolist() == [False, True, True]
    every = table_of(*pairs).assign(filtered=0.5, improper=bad)
    loop = find_most_improper_loop(every, table, 90.0)
    assert (loop.a, loop.b) in pairs[1:] and loop.place == 0
    assert loop.off_deg == pytest.approx(180)
    assert loop_path_rows(loop, table).tolist() == list(range(loop.a, loop.b + 1))
    assert find_most_improper_loop(every.assign(improper=False), table, 90.0) is None


def test_a_pair_across_tracks_is_improper_at_one_of_its_ends():
    track = np.repeat([0, 1], 40)
    table = features_at(np.r_[LINE, -LINE], np.zeros(80), track=track)
    every = table_of((20, 60)).assign(filtered=0.5, improper=True)
    loop = find_most_improper_loop(every, table, 90.0)
    assert (loop.place, loop.off_deg) == (2, pytest.approx(180))
    assert loop_path_rows(loop, table).tolist() == list(range(58, 63))  # Δ about the end b


# -- the stage --------------------------------------------------------------------------------------

N = 80


def draw(phase, rng):
    """A fish headed to the right whose tail beats, premultiplied (40, 60, 2); its centre (30, 20)."""
    alpha = np.zeros((40, 60), np.uint8)
    cv2.ellipse(alpha, (34, 20), (16, 5), 0, 0, 360, 255, -1, cv2.LINE_AA)
    tail = (6, round(20 + 8 * np.sin(phase)))
    cv2.line(alpha, (22, 20), tail, 255, 3, cv2.LINE_AA)
    colour = alpha * rng.uniform(0.4, 0.6, alpha.shape)  # no two frames of a film are the same
    return np.dstack([colour.astype(np.uint8), alpha])


def put_film(folder, n=N, period=16, tracks=2, keep=2.5, backwards=False):
    """Everything the stage reads: a fish headed right in each track, where it swims, or drifts left."""
    prepare(folder, *TINY_CARP, "loops.compared_neighbour_frames=1")
    put_clip(folder, [np.zeros((120, 360), np.uint8)] * 4, rate=round(RATE))
    save_picture(folder / "data/extract/background.png", np.full((120, 360), 200, np.uint8))
    track = np.repeat(np.arange(tracks), n)
    place = 40 + 3.0 * np.tile(np.arange(n)[:: -1 if backwards else 1], tracks)
    table = features_at(place, -40.0 - 30 * track, 0.0, track, length=44.0)
    save_table(folder / "data/features/features.parquet", table, FEATURES)
    rng = np.random.default_rng(0)
    with CutoutWriter(folder / "data/extract/cutouts.arrow") as writer:
        for one in table.itertuples():
            x, y = int(one.x_px) - 30, int(one.y_px) - 20
            phase = 2 * np.pi * (one.frame + 0.3 + 5 * one.track_id) / period
            writer.write(Cutout(one.track_id, one.frame, x, y, draw(phase, rng)))
    with open_cutouts(folder / "data/extract/cutouts.arrow") as film:
        pictures = Reel(table, film).draw_rows(np.arange(n * tracks), 24, BODY)
    far = cdist(*[pictures.reshape(n * tracks, -1)] * 2)
    step = np.where(np.diff(track) == 0, successive_distances(pictures), np.nan)
    median, p95 = float(np.nanmedian(step)), float(np.nanquantile(step, 0.95))
    i, j = np.nonzero(np.triu(far <= keep * median, 1))
    pairs = pd.DataFrame({"i": i, "j": j, "distance": far[i, j]})
    distance = folder / "data/distance"
    save_table(distance / "pairs.parquet", pairs, PAIRS)
    step = np.r_[step, np.nan]
    table = table[["track_id", "frame"]].assign(step=step, headed=step, as_filmed=np.nan)
    save_table(distance / "steps/steps.parquet", table, STEPS)
    save_record(distance / "steps/facts.json", MapFacts(BODY, 24, 0.1, keep, median, p95))


@pytest.fixture(scope="module")
def toy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops")
    put_film(folder)
    return folder


def test_stage_writes_loops_tables_and_pictures(toy, monkeypatch, request):
    monkeypatch.chdir(toy)
    stages.loops.main()
    stages.plots.loops.main()
    loops = load_table(toy / "data/loops/loops.parquet", LOOPS)
    frame = np.tile(np.arange(N), 2)
    beat = (frame + np.repeat([0, 5], N)) % 16
    assert (beat[loops["a"]] == beat[loops["b"]]).all()  # whole beats of the tail
    assert loops["length_s"].isna().any() and loops["length_s"].notna().any()
    reports, drawn = toy / "reports/loops", toy / "reports/motion/loops"
    assert sorted(p.name for p in reports.iterdir()) == ["metrics.json"]
    assert sorted(p.name for p in drawn.iterdir()) == [
        "best_and_worst.png", "fig10.png", "fig11.png", "fig13.png", "over_tank.png", "over_time.png",
    ]  # fmt: skip
    table = pd.read_csv(toy / "data/loops/position_table.csv", index_col=0)
    assert list(table.columns) == list(table.index) == list(ascii_uppercase)[: len(table)]
    assert set(table.stack().dropna()) == {1}
    assert all(load_picture(picture).ndim == 3 for picture in drawn.glob("*.png"))
    metrics = load_numbers(reports)
    assert metrics["loops"] == len(loops) and metrics["components"] == metrics["groups"] == 1
    assert metrics["seam_median_steps"] < 0.7 and metrics["loops_per_end_max"] <= 6
    assert metrics["endless_film_pct"] > 80 and metrics["dead_ends"] == 2
    ways = pd.read_csv(toy / "data/loops/routes.csv")
    assert ways["route"].nunique() == 5 and set(ways["how"]) == {PLAY, JUMP}
    first = content(toy / "data/loops") | content(reports)
    request.getfixturevalue("no_drawing")
    stages.loops.main()
    assert same_but_figures(first, content(toy / "data/loops") | content(reports))


def toy_reel(folder):
    table = load_table(folder / "data/features/features.parquet", FEATURES)
    return table, open_cutouts(folder / "data/extract/cutouts.arrow")


def test_the_three_ways_of_a_film_are_drawn_with_a_dotted_line_a_jump(toy, monkeypatch):
    monkeypatch.chdir(toy)
    if not (toy / "data/loops").exists():
        stages.loops.main()
    loops = load_table(toy / "data/loops/loops.parquet", LOOPS)
    table, opened = toy_reel(toy)
    three = find_three_routes(loops, table["track_id"].to_numpy())
    check_cases(three)
    with opened as film:
        figure = figure10(three, Reel(table, film), BODY, 1.0)
    upper, middle, lower = figure.subfigs
    letters = [text.get_text() for text in upper.axes[0].texts]
    assert letters == ["L1", "L2", "L3", "L4", *"ABCDEFGH"]
    assert len(middle.axes) == 8
    frame = table["frame"].to_numpy()
    for axes, way, jumps in zip(lower.axes, three.cases, (1, 1, 2), strict=True):
        dotted = [line for line in axes.lines if line.get_linestyle() == ":"]
        solid = [line.get_xdata() for line in axes.lines if line.get_linestyle() == "-"]
        assert len(dotted) == jumps
        played = sum(x[1] - x[0] for x in solid if len(x) == 2)
        assert played == sum(b - a for a, b, how in way if how == PLAY)
        named = [text.get_text() for text in axes.texts]
        assert "".join(named) == route_letters(way, three.ends) and named[0] + named[-1] == "GF"
        assert axes.texts[0].xy[0] == frame[three.ends[6]]
    plain = " ".join(axes.get_title("left") for axes in lower.axes)
    assert re.findall(r"(\d) jumps?", plain) == ["1", "1", "2"]


def test_a_film_that_drifts_backwards_has_no_loops_but_an_improper_one(
    tmp_path, monkeypatch, capsys
):
    put_film(tmp_path, backwards=True)
    monkeypatch.chdir(tmp_path)
    stages.loops.main()
    assert "only the network mode" in capsys.readouterr().err
    stages.plots.loops.main()
    assert load_table(tmp_path / "data/loops/loops.parquet", LOOPS).empty
    reports = tmp_path / "reports/motion/loops"
    words, drawn = (load_picture(reports / f"{name}.png") for name in ("fig10", "fig13"))
    assert drawn.shape[0] > 2 * words.shape[0]
    table, opened = toy_reel(tmp_path)
    pairs = to_sparse_map(load_table(tmp_path / "data/distance/pairs.parquet", PAIRS), len(table))
    every, counts = find_loop_candidates(pairs, table, 100.0, EASY)
    assert every["improper"].all() and counts["improper_dropped"] == len(every)
    loop = find_most_improper_loop(every, table, 90.0)
    assert abs(loop.travel_deg) == pytest.approx(180) and loop.heading_deg == pytest.approx(0)
    with opened as film:
        figure = figure13(loop, Reel(table, film), BODY, np.full((120, 360), 200, np.uint8), "")
    ahead = defaultdict(list)  # of the arrows of each colour, how far to the right they lead
    for text in figure.subfigs[0].axes[0].texts:
        if getattr(text, "arrow_patch", None) is not None:
            ahead[text.arrow_patch.get_edgecolor()].append(text.xy[0] - text.get_position()[0])
    assert sorted(map(len, ahead.values())) == [1, 3]  # travel; headings at a, at b, and mean
    assert sorted(np.sign([np.mean(one) for one in ahead.values()])) == [-1, 1]  # opposed
