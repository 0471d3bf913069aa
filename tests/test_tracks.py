"""Tracks from toy spots: who is who, where a track ends, and that the order of spots is nothing."""

import numpy as np
import pytest

from finloop.extract.tracks import SilhouettePlace, TrackLinker

GATE, RATIO = 60.0, 1.4
LONG = 40  # of a toy fish's box


def spot(x, y, area=400.0, isolated=True, size=LONG):
    half = size // 2
    return SilhouettePlace(
        x, y, area, (int(x) - half, int(y) - half, int(x) + half, int(y) + half), isolated
    )


def link(film, cuts=(), gate=GATE, ratio=RATIO):
    """Track numbers of every spot of every frame."""
    linker, numbers = TrackLinker(gate, ratio), []
    for frame, spots in enumerate(film):
        if frame in cuts:
            linker.end_tracks()
        numbers.append(linker.link_frame(spots))
    return numbers


def swim(x, y, vx, vy, frames, **more):
    return [spot(x + vx * k, y + vy * k, **more) for k in range(frames)]


def together(*fish):
    return [list(spots) for spots in zip(*fish, strict=True)]


def test_each_fish_is_one_track():
    assert link([[], [], []]) == [[], [], []]
    assert link(together(swim(0, 0, 7, 3, 20))) == [[0]] * 20
    assert link(together(swim(0, 0, 5, 0, 4), swim(300, 0, 5, 0, 4))) == [[0, 1]] * 4


@pytest.mark.parametrize("speed", [6, 12, 30])
def test_fish_that_cross_far_apart_in_time_or_space_keep_their_numbers(speed):
    # The first swims right; the second swims left past it, a body length below.
    frames = 400 // speed
    film = together(swim(0, 0, speed, 0, frames), swim(400, 50, -speed, 0, frames))
    assert link(film) == [[0, 1]] * frames


def test_a_school_swims_through_with_its_numbers():
    # Twelve fish on a lattice, each with its own way, a body length and more apart, never mixed up.
    rng = np.random.default_rng(1)
    home = 100.0 * np.stack(np.meshgrid(np.arange(4), np.arange(3)), -1).reshape(-1, 2)
    phase = rng.uniform(0, 2 * np.pi, 12)
    film = []
    for k in range(60):
        sway = 20 * np.stack([np.cos(0.5 * k + phase), np.sin(0.5 * k + phase)], -1)
        areas = 400 + rng.uniform(-20, 20, 12)
        film.append([spot(*at, area) for at, area in zip(home + sway, areas, strict=True)])
    assert link(film) == [list(range(12))] * 60


def test_where_a_fish_is_expected_counts_and_not_where_it_was():
    # One behind the other, soon so fast that each comes to where the other one has just been.
    place = np.cumsum([0, 6, 12, 18, 24, 25, 25, 25, 25])
    film = [[spot(x, 0), spot(x - 25, 0)] for x in place]
    assert link(film) == [[0, 1]] * 9


def test_the_order_of_the_spots_does_not_matter():
    rng = np.random.default_rng(0)
    film = together(
        swim(0, 0, 9, 1, 30), swim(400, 60, -9, 0, 30), swim(100, 200, 3, -2, 30),
        swim(300, -200, 0, 5, 30),
    )  # fmt: skip
    plain = link(film)
    orders = [rng.permutation(4) for _ in film]
    mixed = link([[spots[i] for i in order] for spots, order in zip(film, orders, strict=True)])
    names: dict[int, int] = {}  # numbers may differ, but one for one
    for row, shuffled, order in zip(plain, mixed, orders, strict=True):
        for i, number in zip(order, shuffled, strict=True):
            assert names.setdefault(number, row[i]) == row[i]
    assert len(set(names.values())) == len(names) == 4


@pytest.mark.parametrize("spots", [[], [spot(16, 0, isolated=False)]])
def test_a_fish_that_vanishes_or_is_not_isolated_returns_with_a_new_number(spots):
    film = together(swim(0, 0, 4, 0, 9))
    film[4] = spots
    assert link(film) == [[0]] * 4 + [[None] * len(spots)] + [[1]] * 4


def test_a_silhouette_that_is_not_isolated_holds_its_place():
    # A neighbour that has come to the border still is what the spot there is: nobody else's fish.
    film = [[spot(0, 0), spot(30, 0, isolated=False)], [spot(27, 0, isolated=False)]]
    assert link(film) == [[0, None], [None]]


def test_a_cut_ends_every_track():
    film = together(swim(0, 0, 4, 0, 9), swim(300, 0, 4, 0, 9))
    assert link(film, cuts=[5]) == [[0, 1]] * 5 + [[2, 3]] * 4


@pytest.mark.parametrize(("far", "same"), [(GATE - 1, True), (GATE + 1, False)])
def test_the_gate(far, same):
    first, second = link([[spot(0, 0)], [spot(far, 0)]])
    assert (first == second) == same


@pytest.mark.parametrize(("grown", "same"), [(1.39, True), (1.41, False)])
@pytest.mark.parametrize("turn", [1, -1])
def test_a_silhouette_changes_only_so_much(grown, same, turn):
    areas = (400.0, 400.0 * grown)[::turn]
    first, second = link([[spot(k, 0, area)] for k, area in enumerate(areas)])
    assert (first == second) == same


def test_a_long_step_must_be_unrivalled():
    # 40 px in a frame may be; but not where another fish stands that could be meant as well.
    assert link([[spot(0, 0)], [spot(40, 0)]]) == [[0], [0]]
    film = [[spot(0, 0), spot(75, 0)], [spot(40, 0)]]
    assert link(film) == [[0, 1], [2]]


def test_the_nearest_in_sum_and_not_one_by_one():
    # The right fish is nearest to the spot that the left one needs: 11 + 12 beats 24 + 1. All is
    # within a quarter of the gate, where the assignment alone decides.
    film = [[spot(0, 0), spot(12, 0)], [spot(11, 0), spot(24, 0)]]
    assert link(film, gate=120) == [[0, 1], [0, 1]]


def test_where_fish_touch_both_tracks_end():
    apart = [[spot(5 * k - 60, 0), spot(60 - 5 * k, 0)] for k in range(8)]
    touching = [[spot(0, 0, 800.0, isolated=False, size=80)]] * 3
    assert link(apart + touching + apart[::-1]) == ([[0, 1]] * 8 + [[None]] * 3 + [[2, 3]] * 8)


def test_where_a_fish_takes_in_a_small_neighbour_its_track_ends():
    # The whole still passes for a fish by its size; but it has grown, and the neighbour is missing
    # from where it must be, inside the box.
    film = [
        [spot(0, 0), spot(30, 0, 100.0, size=10)],
        [spot(6, 0, 500.0, size=80)],
        [spot(8, 0, 500.0, size=80)],
    ]
    assert link(film) == [[0, 1], [None], [2]]
    # Grown alone, with no neighbour missing, it is the same fish (it opened its fins).
    alone = [[spots[0]] for spots in film]
    assert link(alone) == [[0], [0], [0]]


def test_where_a_part_leaves_a_silhouette_both_are_new():
    film = [
        [spot(6, 0, 500.0, size=80)],
        [spot(0, 0), spot(30, 0, 130.0, size=10)],
        [spot(0, 0), spot(31, 0, 130.0, size=10)],
    ]
    assert link(film) == [[0], [1, 2], [1, 2]]
    # What shrinks without anything having left it stays what it was.
    assert link([[spots[0]] for spots in film]) == [[0], [0], [0]]


def test_a_speck_that_leaves_a_silhouette_changes_nothing():
    film = [[spot(6, 0, 500.0, size=80)], [spot(0, 0), spot(30, 0, 90.0, size=8)]]
    assert link(film) == [[0], [0, 1]]


def test_who_was_there_before_has_not_left_anything():
    # A neighbour inside the box, seen in the frame before as well, but in no track (too small).
    mate = spot(30, 0, 130.0, isolated=False, size=10)
    film = [[spot(6, 0, 500.0, size=80), mate], [spot(0, 0), mate]]
    assert link(film) == [[0, None], [0, None]]


@pytest.mark.parametrize("move", ["shift", "turn", "mirror"])
def test_place_and_direction_do_not_matter(move):
    rng = np.random.default_rng(2)
    way = 60 * rng.standard_normal((25, 5, 2)).cumsum(0) / 5 + 80 * np.arange(5)[:, None]
    change = {
        "shift": lambda p: p + (1000, -500), "turn": lambda p: p[..., ::-1] * (1, -1),
        "mirror": lambda p: p * (-1, 1),
    }[move]  # fmt: skip
    film = [[spot(x, y) for x, y in points] for points in way]
    other = [[spot(x, y) for x, y in points] for points in change(way)]
    assert link(film) == link(other)
