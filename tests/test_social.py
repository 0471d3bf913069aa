"""Rules between fish: laws of symmetry, who is seen, who leads; measures of known shoals."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from finloop.base.errors import FinloopError
from finloop.io.table import load_table, save_table
from finloop.social import measures
from finloop.social import zones as zones_module
from finloop.social.leader import describe_contradiction, leaders_by_follower
from finloop.social.measures import SCHOOL, compare_groups, measure_group, wasserstein_distances
from finloop.social.neighbours import all_neighbours, complex_vectors, relative_neighbours
from finloop.social.rule import (
    DecidingFish,
    OtherFish,
    SchoolRule,
    SocialSteps,
    next_place_in_school,
)
from finloop.social.walls import Walls
from finloop.social.zones import COUZIN, NO_ZONES, Zones, pull_of_others, zone_pulls

ZONES = Zones(1.0, 3.0, 8.0, 90.0, 1.5, 0.7, 0.4)
PX = 20.0  # of a body length
OPEN = Walls(np.ones((400, 600), bool), PX)


def shoal(seed, count=7):
    """Places and headings of fish in the frame of the tank, body lengths."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(0, 9, count) + 1j * rng.uniform(0, 9, count)
    return place, np.exp(2j * np.pi * rng.random(count))


def neighbour_pull(place, heading, zones=ZONES):
    return pull_of_others(all_neighbours(place, heading), zones)


def pull_of(*others, zones=ZONES):
    """What a fish at 0 that heads to the right is wished by others: place, heading in degrees."""
    places = np.array([place for place, _ in others], complex)
    headings = np.exp(1j * np.radians([heading for _, heading in others]))
    seen = relative_neighbours(np.array(0j), np.array(1 + 0j), places, headings)
    return complex(pull_of_others(seen, zones))


# --- zones


@given(st.integers(0, 10_000), st.floats(-np.pi, np.pi), st.floats(-50, 50))
def test_zones_turn_move_and_are_mirrored_with_the_shoal_in_any_order(seed, angle, far):
    place, heading = shoal(seed)
    plain = neighbour_pull(place, heading)
    turn = np.exp(1j * angle)
    moved_on = neighbour_pull(place * turn + far * (1 - 2j), heading * turn)
    assert moved_on == pytest.approx(plain, abs=1e-9)
    assert neighbour_pull(place.conj(), heading.conj()) == pytest.approx(plain.conj(), abs=1e-12)
    order = np.random.default_rng(seed).permutation(len(place))
    again = neighbour_pull(place[order], heading[order])
    assert again == pytest.approx(plain[order], abs=1e-12)
    means = zone_pulls(all_neighbours(place, heading), COUZIN.radii, COUZIN.blind_deg)
    assert means.shape == (7, 3) and np.abs(means).max() <= 1 + 1e-12


def test_repulsion_beats_all():
    crowd = [(2 + 0j, 90.0), (5 + 1j, 0.0)]
    assert pull_of((0.5j, 0.0), *crowd) == pull_of((0.5j, 0.0))
    assert pull_of((0.5j, 0.0)) == pytest.approx(-1.5j)  # away from who is to the left


def test_each_zone_wishes_what_it_is_called():
    assert pull_of((2 + 0j, 90.0)) == pytest.approx(0.7j)  # aligned: takes on the heading
    assert pull_of((5j, 17.0)) == pytest.approx(0.4j)  # attracted: towards it, however it heads
    assert pull_of((2 + 0j, 90.0), (5j, 17.0)) == pytest.approx(1.1j)
    assert pull_of((9j, 0.0)) == 0  # beyond all zones
    assert ZONES.widths == (1, 2, 5)
    assert Zones(2.0, 1.0, 3.0, 0.0, 1.0, 1.0, 1.0).widths == (2, 0, 1)
    # A zone pulls no more the more fish are in it.
    assert pull_of((5j, 0.0), (6j, 0.0)) == pytest.approx(pull_of((5j, 0.0)))
    assert pull_of((5j, 0.0), (-5j, 0.0)) == pytest.approx(0)


@pytest.mark.parametrize("blind", [0.0, 90.0, 200.0, 360.0])
def test_nobody_in_the_blind_angle_is_seen(blind):
    zones = replace(ZONES, blind_deg=blind)
    for behind in (0.49 * blind - 1, 0.51 * blind + 1):
        if not 0 < behind < 180:
            continue
        place = -5 * np.exp(1j * np.radians(behind))
        assert (pull_of((place, 0.0), zones=zones) == 0) == (behind < blind / 2)
        assert pull_of((place / 10, 0.0), zones=zones) != 0  # who is that near is felt


def test_who_is_alone_is_wished_nothing():
    assert neighbour_pull(np.array([3 + 1j]), np.array([1j])) == 0
    absent = np.array([3 + 1j, np.nan]), np.array([1j, np.nan])
    assert neighbour_pull(*absent)[0] == 0
    assert pull_of_others(all_neighbours(*shoal(3)), NO_ZONES) == pytest.approx(0)


class NoBlas(np.ndarray):
    """An array of which no matrix product is made."""

    def __array_ufunc__(self, ufunc, method, *arrays, **options):
        assert ufunc is not np.matmul
        return getattr(ufunc, method)(*(np.asarray(one) for one in arrays), **options)


def test_a_pull_is_a_sum_that_no_blas_rounds(monkeypatch):
    seen = all_neighbours(*shoal(1))
    means = zone_pulls(seen, ZONES.radii, ZONES.blind_deg)
    wanted = means[:, 0] * 1.5 + means[:, 1] * 0.7 + means[:, 2] * 0.4
    monkeypatch.setattr(zones_module, "zone_pulls", lambda *_: means.view(NoBlas))
    assert pull_of_others(seen, ZONES) == pytest.approx(wanted)


@pytest.mark.parametrize(
    "bad", [{"repulsion": -1.0}, {"blind_deg": 400.0}, {"attraction_weight": np.nan}]
)
def test_zones_that_are_none_are_refused(bad):
    with pytest.raises(FinloopError, match=next(iter(bad))) as caught:
        replace(ZONES, **bad)
    assert "calibrate" in caught.value.do


# --- leader and follower


def test_followers_know_their_leaders():
    assert leaders_by_follower([[2, 1], [3, 2], [4, 2]], 4) == {2: 1, 3: 2, 4: 2}
    assert leaders_by_follower([], 3) == {}


@pytest.mark.parametrize(
    ("pairs", "named"),
    [
        ([[1, 2], [2, 1]], "fish 1 follows fish 2 follows fish 1"),
        ([[1, 2], [2, 3], [3, 1]], "fish 1 follows fish 2 follows fish 3 follows fish 1"),
        ([[2, 2]], "fish 2 follows itself"),
        ([[2, 1], [2, 3]], "fish 2 has two leaders, 1 and 3"),
        ([[2, 5]], "names fish 5 of 4"),
        ([[2]], "not a pair"),
        ([[a, b] for a in (1, 2, 3) for b in (1, 2, 3) if a != b], "two leaders"),
    ],
)
def test_contradictory_leaders_are_refused(pairs, named):
    with pytest.raises(FinloopError, match="contradict each other") as caught:
        leaders_by_follower(pairs, 4)
    assert named in caught.value.came and "matching.follow_pairs" in caught.value.do


def test_who_would_close_a_circle_is_told():
    assert describe_contradiction({2: 1}, 3, 2) is None
    circle = "fish 1 follows fish 3 follows fish 2 follows fish 1"
    assert describe_contradiction({2: 1, 3: 2}, 1, 3) == circle
    assert describe_contradiction({2: 1}, 2, 3) is None  # it changes its leader


# --- steps, and the place that is swum to


def steps(count=40, seed=0):
    """Own steps, most of them ahead."""
    rng = np.random.default_rng(seed)
    wall, last, move = rng.normal(0, 1, (3, count)) + 1j * rng.normal(0, 1, (3, count))
    turn = np.exp(1j * rng.normal(0, 0.3, count))
    return SocialSteps(0.3 * wall, 0.5 * last, 1 + 0.1 * move, turn, 1.0, 0.5)


def test_steps_that_are_alike_are_drawn():
    rng, own = np.random.default_rng(0), steps()
    moves, turns = own.sample_similar_steps(own.wall[[3, 7]], own.last[[3, 7]], 1, rng)
    assert moves == pytest.approx(own.move[[3, 7], None])
    assert turns == pytest.approx(own.turn[[3, 7], None])
    mirrored, _ = own.sample_similar_steps(own.wall[[3]].conj(), own.last[[3]].conj(), 1, rng)
    assert mirrored == pytest.approx(own.move[[3], None].conj())
    many, _ = own.sample_similar_steps(own.wall[[3]], own.last[[3]], 1000, rng)
    assert many.shape == (1, 80)  # no more than there are, and their mirror images
    again = SocialSteps.from_table(own.to_table(), own.move_per_pull, own.turn_per_pull)
    assert np.array_equal(again.turn, own.turn) and np.array_equal(again.wall, own.wall)


def test_a_pull_adds_to_the_own_turn():
    own = steps()
    turned = own.turn_by_pulls(np.array([1 + 0j, 0j]), np.array([2j, 0j]))
    assert turned[0] == pytest.approx((1 + 1j) / np.sqrt(2))
    assert abs(turned[1]) == 1


def place_of(others, zones=ZONES, x=300.0, y=200.0, walls=OPEN, seed=0):
    rule = SchoolRule(zones, steps(), 5, 10)
    company = OtherFish(
        np.array([place for place, _ in others]).reshape(-1, 2), np.array([h for _, h in others])
    )
    own = DecidingFish(x, y, 0.0, 1.0)
    return next_place_in_school(own, company, rule, walls, np.random.default_rng(seed))


def test_a_fish_is_drawn_to_the_company_it_has():
    zones = replace(ZONES, attraction_weight=3.0)
    above = np.array([place_of([((300.0, 90.0), 0.0)], zones, seed=seed) for seed in range(20)])
    below = np.array([place_of([((300.0, 310.0), 0.0)], zones, seed=seed) for seed in range(20)])
    assert (above[:, 1] < 200).all() and (below[:, 1] > 200).all()
    assert np.hypot(*(above - (300, 200)).T).mean() == pytest.approx(PX * np.hypot(1, 3), rel=0.2)
    assert place_of([]) is None  # without company there is no place
    assert place_of([((300.0, 390.0), 0.0)]) is None  # too far away
    assert place_of([((310.0, 200.0), 0.0)], NO_ZONES) is None


def test_a_place_beside_a_wall_is_in_the_tank_if_a_step_is():
    arena = np.zeros((400, 600), bool)
    arena[:, :310] = True
    for seed in range(10):
        x, _ = place_of([((290.0, 100.0), 0.0)], x=290.0, walls=Walls(arena, PX), seed=seed)
        assert x < 310


# --- measures


NEIGHBOURS = ["neighbour_distance", "alignment_deg", "inter_fish_deg", "polarisation"]


def table(places, headings, frame=None):
    frame = np.zeros(len(places), int) if frame is None else np.array(frame)
    return measure_group(frame, np.array(places, float), np.array(headings, float), OPEN)


def test_measures_of_fish_whose_places_are_known():
    made = table([(100, 100), (140, 100), (100, 300)], [0.0, 90.0, 0.0])
    assert made["neighbour_distance"].tolist() == pytest.approx([2, 2, 10])
    assert made["alignment_deg"].tolist() == pytest.approx([90, 90, 0])
    assert made["inter_fish_deg"].tolist() == pytest.approx([0, 90, 90])
    assert made["wall_distance"].tolist() == pytest.approx([101 / PX, 101 / PX, 100 / PX], abs=0.06)
    assert made["polarisation"].tolist() == pytest.approx([np.sqrt(5) / 3] * 3)
    made = table([(100, 100), (140, 100), (100, 100), (100, 300)], [0, 0, 0, 180], [0, 0, 1, 1])
    assert made["neighbour_distance"].tolist() == pytest.approx([2, 2, 10, 10])
    assert made["polarisation"].tolist() == pytest.approx([1, 1, 0, 0], abs=1e-6)
    assert made["fish"].tolist() == [0, 1, 0, 1]


def test_who_is_alone_has_a_wall_and_no_neighbour(tmp_path):
    made = table([(100, 100), (140, 100), (60, 100)], [0, 0, 0], [0, 0, 1])
    save_table(tmp_path / "shoal.parquet", made, SCHOOL)
    alone = load_table(tmp_path / "shoal.parquet", SCHOOL).iloc[2]
    assert alone[NEIGHBOURS].isna().all()
    assert alone["wall_distance"] > 0


@given(st.integers(0, 1000), st.floats(-180, 180))
def test_measures_of_company_do_not_know_where_the_tank_lies(seed, angle):
    rng = np.random.default_rng(seed)
    places, headings = rng.uniform(150, 250, (5, 2)), rng.uniform(-180, 180, 5)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turned = (places - 200) @ np.array([[c, -s], [s, c]]) + 200  # y down: anticlockwise on screen
    one_, other = table(places, headings), table(turned, headings + angle)
    for name in NEIGHBOURS:
        assert other[name].to_numpy() == pytest.approx(one_[name].to_numpy(), abs=1e-3)


def test_measures_of_many_frames_are_those_of_each(monkeypatch):
    rng = np.random.default_rng(0)
    frame = np.sort(rng.integers(0, 90, 300))  # some frames show nobody, some a single fish
    places, headings = rng.uniform(50, 350, (300, 2)), rng.uniform(-180, 180, 300)
    whole = table(places, headings, frame)
    monkeypatch.setattr(measures, "_PAIRS", 400)
    assert table(places, headings, frame).equals(whole)
    assert whole["neighbour_distance"].isna().any()


def test_memory_of_the_measures_does_not_grow_by_pairs():
    frames, fish = 300, 100
    rng = np.random.default_rng(0)
    where = rng.uniform(0, 390, (frames * fish, 2)), rng.uniform(-180, 180, frames * fish)
    OPEN.distances_from_wall  # noqa: B018  (the tank keeps it)
    tracemalloc.start()
    try:
        measure_group(np.repeat(np.arange(frames), fish), *where, OPEN)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 20 * frames * fish**2  # bytes: a distance and a vector of every pair have 24


def test_shoals_are_as_far_apart_as_they_are():
    near, far = (table([(100, 100), (100 + gap, 100)], [0, 0]) for gap in (20, 60))
    assert wasserstein_distances(near, near)["neighbour_distance"] == 0
    assert wasserstein_distances(near, far)["neighbour_distance"] == pytest.approx(2)
    assert wasserstein_distances(near, table([(5, 5)], [0])).keys() == {"wall_distance"}
    told = compare_groups({"film": near}, {"far": far}).set_index("measure")
    assert told.loc["neighbour_distance", ["median", "distance"]].tolist() == pytest.approx([3, 2])


def test_a_wall_is_away_from_where_it_is():
    place, heading = complex_vectors(
        np.array([[20.0, 100.0]]), np.array([90.0]), PX
    )  # y counts down
    assert place == pytest.approx([1 - 5j]) and heading == pytest.approx([1j])
    walls = Walls(np.ones((200, 400), bool), PX)
    up, ahead = np.array([10 - 1j]), np.array([1 + 0j])
    behind, above = (walls.vectors_from_wall(one, ahead)[0] for one in (place, up))
    assert np.angle(behind) == pytest.approx(0, abs=0.01)
    assert np.angle(above) == pytest.approx(-np.pi / 2, abs=0.01)
    assert abs(behind) == pytest.approx(1 / (1 + 21 / PX), rel=0.01)
    assert walls.is_inside(np.array([1 - 5j, -1 - 5j, 1 - 50j])).tolist() == [True, False, False]
