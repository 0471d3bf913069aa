"""Goals → edit list: the tank, steps, what the film shows, the edit list, the measures."""

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import scipy
from toy_film import (
    ARENA,
    DELTA,
    LENGTH,
    RATE,
    learnt,
    lessons,
    network_of,
    paper_player,
    phases,
    track,
)

from finloop.animate import kinematics as step
from finloop.animate import measures
from finloop.animate.arena import (
    FilmHulls,
    are_points_inside,
    choose_fish_area,
    is_floor_alike_beyond,
    make_tank,
    place_goals,
    scale_that_fits,
    tank_area,
)
from finloop.animate.kinematics import StraightSwim, Target, Turning
from finloop.animate.motion import learn_motion
from finloop.animate.shoal import plan_edit_list
from finloop.base.distributions import wasserstein_distance
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.edit import measures as edit_measures
from finloop.edit.joins import PictureSequence, cross_fade_partners
from finloop.edit.schema import CUT, FRAME, SLIDE, SPRITE, STATES, TURN, Goal
from finloop.features.table import wrap_deg
from finloop.modes.phases import Phases, learn_phases, state_shares
from finloop.modes.player import PaperPlayer


@pytest.fixture(scope="module")
def player() -> PaperPlayer:
    """Mode network, which shows sprites alone."""
    return paper_player(network_of())


def play_seeded(player: PaperPlayer, goals: list[Goal], ticks: int, seed: int) -> pd.DataFrame:
    return plan_edit_list(player, goals, ticks, np.random.default_rng(seed))


# --- the tank


def test_a_centre_is_legal_where_the_whole_fish_fits_in():
    found = make_tank(ARENA, 24.0)
    rows, columns = np.nonzero(found.legal)
    assert (rows.min(), rows.max()) == (45, 554)
    assert (columns.min(), columns.max()) == (55, 744)
    found = make_tank(np.ones((100, 100), bool), 20.0)  # the edge of the picture is a wall
    assert not found.legal[:20].any() and not found.legal[:, -20:].any() and found.legal[50, 50]


def disc(radius: float) -> np.ndarray:
    """Outlines (40, 12, 2) of small fish all round a disc in the middle of 200 × 160 px."""
    middle = np.stack([radius * np.cos(np.arange(40.0)), radius * np.sin(np.arange(40.0))], -1)
    edge = 4 * np.stack([np.cos(np.arange(12)), np.sin(np.arange(12))], -1)
    return (100, 80) + middle[:, None] + edge


def test_without_an_arena_the_fish_is_where_animals_were_filmed():
    whole, wide = np.ones((160, 200), bool), disc(66.0)
    there = tank_area(whole, FilmHulls(wide), "auto")
    rows, columns = np.mgrid[:160, :200]
    away = np.hypot(columns - 100, rows - 80)
    assert there[away < 68].all() and not there[away > 71].any()
    given = columns > 50  # an arena that was given is believed
    assert np.array_equal(tank_area(given, FilmHulls(wide), "auto"), given)
    assert np.array_equal(tank_area(given, FilmHulls(wide), "filmed"), given & there)
    assert tank_area(whole, FilmHulls(wide), "arena").all()
    assert tank_area(whole, FilmHulls(disc(20.0)), "auto").all()  # it held its place


def test_a_film_that_shows_the_tank_piece_by_piece_is_too_short_to_tell_where_it_ends():
    whole, wide = np.ones((160, 200), bool), disc(66.0)
    order = np.argsort(wide[:, 0, 0])  # from left to right: each half of the film shows a half
    assert FilmHulls(wide).show_whole_tank
    assert not FilmHulls(wide[order]).show_whole_tank
    floor = np.random.default_rng(0).integers(140, 160, (160, 200)).astype(np.uint8)
    assert tank_area(whole, FilmHulls(wide[order]), "auto", floor).all()
    there = tank_area(whole, FilmHulls(wide), "auto", floor)
    assert not there.all()
    assert np.array_equal(tank_area(whole, FilmHulls(wide[order]), "filmed", floor), there)
    unknown_floor = tank_area(whole, FilmHulls(wide[order]), "auto")
    assert np.array_equal(unknown_floor, there)
    both = np.concatenate([wide[order], wide[order][::-1]])  # and back again
    assert FilmHulls(both).show_whole_tank
    assert np.array_equal(tank_area(whole, FilmHulls(both), "auto", floor), there)
    rests = np.concatenate([wide, wide[order][:20].repeat(2, 0)])
    # A half that adds little shows that there is little to add.
    assert FilmHulls(rests).show_whole_tank
    assert not FilmHulls(wide[:1]).show_whole_tank


@pytest.mark.parametrize(("beyond", "same"), [(0, True), (10, True), (60, False), (-60, False)])
def test_a_floor_goes_on_where_most_beyond_is_as_bright(beyond, same):
    filmed = np.zeros((100, 200), bool)
    filmed[30:70, 60:140] = True
    grey = np.random.default_rng(0).integers(140, 160, (100, 200))
    floor = np.where(filmed, grey, grey + beyond).astype(np.uint8)
    assert is_floor_alike_beyond(floor, filmed) == same
    assert is_floor_alike_beyond(np.dstack([floor] * 3), filmed) == same
    assert not is_floor_alike_beyond(floor, np.ones_like(filmed))
    order = np.argsort(disc(66.0)[:, 0, 0])
    whole, picture = np.ones((160, 200), bool), np.full((160, 200), 150 + beyond, np.uint8)
    picture[tank_area(whole, FilmHulls(disc(66.0)), "filmed")] = 150
    kept = choose_fish_area(whole, FilmHulls(disc(66.0)[order]), 30.0, "auto", picture)
    assert kept.all() == (beyond == 0)


def test_where_animals_were_filmed_does_not_depend_on_how_many_are_looked_at_at_a_time(monkeypatch):
    whole, wide = np.ones((160, 200), bool), disc(66.0)
    there = tank_area(whole, FilmHulls(wide), "filmed")
    monkeypatch.setattr("finloop.base.parallel._BLOCK", 3)
    assert np.array_equal(tank_area(whole, FilmHulls(wide), "filmed"), there)


def test_of_two_pools_the_larger_is_the_tank():
    arena = np.zeros((200, 400), bool)
    arena[10:190, 10:120] = True
    arena[10:190, 150:390] = True
    legal = make_tank(arena, 15.0).legal
    assert legal[100, 300] and not legal[100, 60]


def test_a_fish_that_does_not_fit_into_where_it_was_filmed_may_be_anywhere():
    whole, hulls = np.ones((160, 200), bool), FilmHulls(disc(66.0))
    filmed = tank_area(whole, hulls, "auto")
    assert not filmed.all()
    assert np.array_equal(choose_fish_area(whole, hulls, 30.0, "auto"), filmed)
    assert choose_fish_area(whole, hulls, 75.0, "auto").all()
    assert np.array_equal(choose_fish_area(whole, hulls, 75.0, "filmed"), filmed)  # asked for
    given = np.zeros((160, 200), bool)
    given[20:60, 20:180] = True
    assert np.array_equal(choose_fish_area(given, hulls, 30.0, "auto"), given)
    for small in (given, np.zeros((50, 50), bool)):
        with pytest.raises(FinloopError, match="smaller than the fish"):
            make_tank(small, 30.0)


@pytest.mark.parametrize("reach", [5.0, 39.0, 41.0, 90.0, 1000.0])
def test_a_fish_is_drawn_smaller_only_where_it_could_hardly_turn(reach):
    whole = np.ones((160, 200), bool)  # 80 px from the edge to the middle
    size = scale_that_fits(whole, reach)
    assert size == (1 if reach <= 40 else pytest.approx(40 / reach))
    assert make_tank(whole, size * reach).legal.mean() >= 0.2


def test_a_wall_ends_the_sight_and_a_way_leads_round_it():
    arena = np.ones((300, 400), bool)
    arena[:200, 190:210] = False  # open at the bottom
    found = make_tank(arena, 10.0)
    assert not found.can_swim_straight(50.0, 50.0, 350.0, 50.0)
    x, y, ways = 50.0, 50.0, 0
    while (x, y) != (350.0, 50.0):
        ahead = found.waypoint(x, y, 350.0, 50.0)
        assert found.can_swim_straight(x, y, *ahead)
        x, y = ahead
        ways += 1
        assert ways < 20
    assert ways > 1


def test_from_every_place_a_path_leads_round_a_column_to_every_other():
    """Places at the edge of the legal too, as a fish that grazes a wall has no free cell of its own."""
    rows, columns = np.mgrid[:300, :400]
    arena = np.hypot(rows - 150, columns - 200) > 60
    arena[:, 195:205] &= rows[:, 195:205] > 150  # open at the bottom alone
    found, rng = make_tank(arena, 20.0), np.random.default_rng(0)
    edges = np.argwhere(found.legal & (found.depth_px < 22))[:, ::-1].astype(float)
    for _ in range(30):
        (x, y), target = rng.choice(edges), tuple(rng.choice(edges))
        for _ in range(20):
            x, y = found.waypoint(x, y, *target)
        assert (x, y) == target


def test_no_path_leads_through_a_thin_wall_round_which_a_small_fish_can_swim():
    arena = np.ones((200, 2000), bool)
    arena[:180, 998:1001] = False
    found = make_tank(arena, 2.0)
    places, target = [(900.0, 100.0)], (1100.0, 100.0)
    while places[-1] != target:
        places.append(found.waypoint(*places[-1], *target))
        on_way = np.linspace(*places[-2:], 1000)
        assert are_points_inside(found.arena, *on_way.T).all()
        assert len(places) < 20


def test_a_point_beyond_the_legal_is_brought_to_its_edge():
    found = make_tank(ARENA, 24.0)
    assert found.nearest_legal_point(400.0, 300.0) == (400.0, 300.0)
    assert found.nearest_legal_point(400.0, -50.0) == (400.0, 45.0)


def test_goals_in_shares_of_the_tank_and_in_pixels():
    room = make_tank(ARENA, 24.0)
    a, b = place_goals([[0.0, 0.5], [1.0, 0.5]], "tank", room, 60.0)
    assert (a.x_px, b.x_px) == (30, 769)
    assert place_goals([[31, 77]], "px", room, 60.0) == [Goal("A", 31.0, 77.0)]


def test_a_goal_in_the_corner_of_a_round_tank_is_moved_inside():
    rows, columns = np.mgrid[:400, :400]
    room = make_tank(np.hypot(columns - 200, rows - 200) < 150, 20.0)
    corner, middle = place_goals([[0.0, 0.0], [0.5, 0.5]], "tank", room, 5.0)
    assert np.hypot(corner.x_px - 200, corner.y_px - 200) == pytest.approx(129, abs=2)
    assert corner.x_px == pytest.approx(corner.y_px, abs=2)
    assert np.hypot(middle.x_px - 200, middle.y_px - 200) < 2


@pytest.mark.parametrize(
    ("given", "unit", "said"),
    [
        ([], "tank", "animate.goals is empty"),
        ([[0.5, 0.5], [5.0, 300.0]], "px", r"A: .*outside.*\n.*B: \(5, 300\) px is outs"),
        ([[1.2, 0.5]], "tank", "A: .* is outside the tank"),
        ([[0.5]], "tank", r"A: \[0.5\] is not x, y"),
        ([[31.0, 21.0]], "px", "A: .* does not fit in"),
    ],
)
def test_goals_that_cannot_be_reached_are_named(given, unit, said):
    with pytest.raises(FinloopError) as refused:
        place_goals(given, unit, make_tank(ARENA, 24.0), 20.0)
    assert re.search(said, str(refused.value))


# --- steps

OPEN = np.ones((1000, 1000), bool)
FAR = Target(-1e6, -1e6, 5.0, 9.0)


def test_ahead_is_along_the_heading_with_y_down_and_left_to_its_left():
    assert step.offset_point(0.0, 0.0, 0.0, 1.0, 0.0) == pytest.approx((1, 0))
    assert step.offset_point(0.0, 0.0, 90.0, 1.0, 0.0) == pytest.approx((0, -1))
    assert step.offset_point(0.0, 0.0, 0.0, 0.0, 1.0) == pytest.approx((0, -1))
    assert step.bearing(0.0, 0.0, 0.0, -5.0) == pytest.approx(90)


def test_straight_ahead_goes_straight_ahead():
    start = np.array([100.0, 500.0, 30.0])
    none = np.zeros(50)
    way, good, touched = step.swim_ahead(
        OPEN, start, StraightSwim(np.full(50, 4.0), none, none), FAR
    )
    assert (good, touched) == (50, 50)
    assert way[-1] == pytest.approx([100 + 200 * np.cos(np.pi / 6), 400.0, 30.0])


def test_a_wall_is_seen_from_the_distance_in_which_one_can_stop():
    start = np.array([900.0, 500.0, 0.0])
    none = np.zeros(50)
    _, good, _ = step.swim_ahead(OPEN, start, StraightSwim(np.full(50, 4.0), none, none), FAR)
    assert good == 24  # 900 + 4 · 24 = 996; the next stands at 1000
    _, good, _ = step.swim_ahead(OPEN, start, StraightSwim(np.full(50, 4.0), none, none + 40), FAR)
    assert good == 14


def test_a_goal_is_touched_by_the_head_before_the_centre():
    start, none = np.array([100.0, 500.0, 0.0]), np.zeros(100)
    swim = StraightSwim(np.full(100, 4.0), none, none)
    for head, tick in ((0.0, 48), (16.0, 44)):  # 100 + 4 · 49 = 296, 4 px before the goal
        assert step.swim_ahead(OPEN, start, swim, Target(300.0, 500.0, 4.0, head))[2] == tick


@pytest.mark.parametrize("target", [(700.0, 200.0), (450.0, 100.0), (100.0, 520.0)])
def test_in_a_turn_the_error_falls_at_every_tick_to_nothing(target):
    start, at = np.array([500.0, 500.0, -20.0]), np.array(target)
    share = np.cumsum(np.hanning(14)[1:-1])
    share /= share[-1]
    flow, side = np.full(12, 3.0), np.full(12, 0.5)
    way, good, _ = step.swim_turn(
        OPEN, start, Turning(share, flow, side), FAR, Target(*target, 1.0, 9.0), 90.0
    )
    assert good
    bearing = np.degrees(np.arctan2(way[:, 1] - at[1], at[0] - way[:, 0]))
    error = np.abs(wrap_deg(bearing - way[:, 2]))
    assert (np.diff(error) < 0).all()
    assert error[-1] == pytest.approx(0, abs=1e-9)
    assert np.hypot(*np.diff(way[:, :2], axis=0).T) == pytest.approx(np.hypot(3.0, 0.5))


def test_a_mirrored_target_gives_the_mirrored_turn():
    share, flow, side = np.linspace(0.1, 1, 10), np.full(10, 3.0), np.full(10, 0.4)
    start = np.array([500.0, 500.0, 0.0])
    swim = Turning(share, flow, side)
    left, _, _ = step.swim_turn(OPEN, start, swim, FAR, Target(400.0, 200.0, 1.0, 9.0), 90.0)
    right, _, _ = step.swim_turn(OPEN, start, swim, FAR, Target(400.0, 800.0, 1.0, 9.0), 90.0)
    assert right[:, 0] == pytest.approx(left[:, 0])
    assert right[:, 1] - 500 == pytest.approx(500 - left[:, 1])
    assert right[:, 2] == pytest.approx(-left[:, 2])


def test_a_target_too_near_for_a_turn_is_refused():
    share, flow = np.linspace(0.1, 1, 10), np.full(10, 30.0)
    start = np.array([500.0, 500.0, 0.0])
    near = Target(500.0, 460.0, 1.0, 9.0)
    _, good, _ = step.swim_turn(OPEN, start, Turning(share, flow, 0 * flow), FAR, near, 20.0)
    assert not good


# --- what the film shows


def phases_of(table: pd.DataFrame) -> Phases:
    return learn_phases(learnt(table), settings("network"))


def test_every_tick_of_a_film_is_learnt_once():
    table = lessons()
    motion, found = learnt(table), phases_of(table)
    assert found.ticks.sum() == (table["swimming_type"] == 0).sum()
    assert motion.straight_ticks.sum() == found.ticks.sum()
    assert len(found.speed_change) == found.ticks.sum()
    assert len(motion.turns.forward) == motion.turns.ticks.sum()


def test_a_flick_within_straight_swimming_is_not_learnt_as_drift():
    table = lessons()
    here = (table["track_id"] == 1) & (table["frame"] >= 4)
    table.loc[here, "heading_deg"] = wrap_deg(table.loc[here, "heading_deg"] + 70)
    assert np.abs(phases_of(table).drift_deg).max() <= 20


def test_turns_have_the_angle_that_was_swum():
    table = lessons()
    angles = learnt(table).turns.angle_deg
    animation = []
    for _, one in table.groupby("track_id"):
        kind = one["swimming_type"].to_numpy()
        heading = np.unwrap(one["heading_deg"], period=360)
        edges = np.flatnonzero(np.diff(kind)) + 1
        animation += [
            abs(heading[b] - heading[a - 1]) for a, b in pairwise([*edges, len(kind) - 1])
            if kind[a] != 0
        ]  # fmt: skip
    assert set(np.round(angles, 6)) <= set(np.round(animation, 6))
    assert len(angles) >= 28


def test_a_glide_is_told_from_a_burst():
    found = phases_of(track(0, 3))
    glides = found.state == SLIDE
    ends = found.start + found.ticks - 1
    assert glides.any() and not glides.all()
    assert (found.speed_change[ends][glides] < 0.1).all()
    faster = found.state == STATES.index("accelerate")
    assert faster.any() and (found.speed_change[ends][faster] > 0).all()


def test_a_film_that_is_mirrored_or_of_a_larger_fish_teaches_the_same():
    one, other, mirrored = (learnt(lessons(**how)) for how in ({}, {"scale": 3.0}, {"mirror": -1}))
    assert other.body_length_px == pytest.approx(3 * one.body_length_px)
    assert other.turns.forward == pytest.approx(one.turns.forward)
    for name in ("angle_deg", "forward", "sideways"):
        assert getattr(mirrored.turns, name) == pytest.approx(getattr(one.turns, name))
    small, large = phases_of(lessons()), phases_of(lessons(scale=3.0))
    assert large.speed_change == pytest.approx(small.speed_change)


@pytest.mark.parametrize("only", [0, 1])
def test_a_film_without_turns_or_without_straight_swimming_teaches_what_it_shows(only):
    table = lessons().assign(swimming_type=only)
    found = learn_motion(table, RATE, DELTA)
    assert (found.turns.angle_deg > 0).all() and (found.turns.ticks > 0).all()
    assert phases_of(table).ticks.sum() > 0 and found.straight_ticks.sum() > 0


def test_a_film_in_which_nothing_moves_is_refused():
    still = lessons().assign(x_px=100.0, y_px=100.0)
    with pytest.raises(FinloopError, match="no swimming"):
        learn_motion(still, RATE, DELTA)


# --- the edit list


def test_an_edit_list_of_one_tick_begins_as_any_other(player):
    one, longer = (play_seeded(player, [], ticks, 1) for ticks in (1, 20))
    apart = ["speed"]  # there is no second place to have moved to
    pd.testing.assert_frame_equal(one.drop(columns=apart), longer[:1].drop(columns=apart))
    assert one["speed"].item() == 0 and longer["speed"][0] == longer["speed"][1]


def test_orientation_and_rest_make_the_heading(player):
    cut = replace(player, join_rules=replace(player.join_rules, kind=CUT, fade=0))
    table = play_seeded(cut, [], 2000, 1)
    direction = (table["orientation"].to_numpy(float) - 1) * 15.0
    made = wrap_deg(direction + table["rotation_deg"].to_numpy(float))
    assert wrap_deg(made - table["heading_deg"].to_numpy(float)) == pytest.approx(0, abs=1e-4)
    assert np.abs(table["rotation_deg"]).max() <= 7.5 + 1e-4


def sprites_shown(number: list[int]) -> PictureSequence:
    no = np.zeros(len(number), bool)
    return PictureSequence(no, np.array(number), np.zeros(len(number)), no)


def test_a_new_sequence_fades_in_while_the_old_one_plays_on(player):
    # A cycle of straight frames 0-7, then the turn that begins with frame 14.
    shown = sprites_shown([5, 6, 7, 14, 15, 16, 17])
    partner, weight = cross_fade_partners(shown, [3], 2, player.edit_inputs.next_number)
    assert weight == pytest.approx([0, 0, 0, 2 / 3, 1 / 3, 0, 0])
    assert list(partner.number[3:5]) == [0, 1] and not partner.frame.any()
    # After the last frame of a turn that one stays: there is no other.
    shown = sprites_shown([20, 21, 22, 8, 9, 10, 11])
    partner, _ = cross_fade_partners(shown, [3], 3, player.edit_inputs.next_number)
    assert list(partner.number[3:6]) == [22, 22, 22]


def test_what_goes_on_does_not_fade(player):
    shown = sprites_shown([5, 6, 7, 0, 1, 2])
    _, weight = cross_fade_partners(shown, [], 2, player.edit_inputs.next_number)
    assert not weight.any()
    _, weight = cross_fade_partners(shown, [3], 0, player.edit_inputs.next_number)
    assert not weight.any()


def test_a_fade_that_a_new_one_cuts_short_does_not_come_back(player):
    shown = sprites_shown([5, 6, 14, 15, 8, 9, 10, 11])
    partner, weight = cross_fade_partners(shown, [2, 4], 3, player.edit_inputs.next_number)
    assert weight == pytest.approx([0, 0, 0.75, 0.5, 0.75, 0.5, 0.25, 0])
    assert list(partner.number[2:7]) == [7, 0, 16, 17, 18]


# --- measures


def straight_list(n: int = 101) -> pd.DataFrame:
    return pd.DataFrame({
        "x_px": np.linspace(100, 500, n), "y_px": 300.0, "heading_deg": 0.0, "state": "straight",
        "reason": ["turn"] + [None] * (n - 1), "room": [1.0] + [np.nan] * (n - 1),
        "aim_x_px": 600.0, "aim_y_px": 300.0,
    })  # fmt: skip


def test_a_straight_way_to_the_goal_has_no_error(player):
    table = straight_list()
    touching = SimpleNamespace(motion=player.world.motion, touch_px=8.0, head_px=0.0)
    found = measures.measure_goals(table, [Goal("A", 500, 300)], touching)
    assert found["goals_reached_pct"] == 100
    assert found["path_error_rms_body_lengths"] == pytest.approx(0)
    assert found["straightness"] == pytest.approx(1)
    assert found["time_to_goal_median_s"] == pytest.approx(98 / RATE)
    off = table.assign(y_px=300 + 2 * LENGTH)
    assert measures.measure_goals(off, [Goal("A", 500, 300)], touching)["goals_reached_pct"] == 0
    in_turn = [Goal("A", 400, 300), Goal("B", 200, 300)]
    assert np.isnan(measures.arrival_ticks(table, in_turn, 8.0, 0.0)[1])


def test_turns_that_turn_away_or_have_little_room_are_counted():
    for third, share in ((31.0, 0), (20.0, 100)):
        table = straight_list(5).assign(state="turn", heading_deg=[40.0, 30.0, third, 10.0, 0.0])
        assert edit_measures.turn_measures(table)["turns_monotone_pct"] == share
    table = straight_list(4).assign(state="turn", reason=["turn", None, "turn", None])
    table["room"] = [0.5, np.nan, 1.0, np.nan]
    assert edit_measures.turn_measures(table)["turns_with_little_room_pct"] == 50


def test_the_distance_of_samples_is_that_of_scipy():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=300), rng.normal(0.4, 2, 70).round(1)  # with ties
    wanted = scipy.stats.wasserstein_distance(a, b)
    assert wasserstein_distance(a, b) == pytest.approx(wanted, rel=1e-12)


def test_kinematic_distance_is_in_deviations_of_the_film():
    film_speed = np.random.default_rng(0).normal(3, 2, 5000)
    assert measures.kinematic_distance(film_speed, film_speed) == 0
    shifted = measures.kinematic_distance(film_speed + 2 * film_speed.std(), film_speed)
    assert shifted == pytest.approx(2)


def picture_table(kind, source):
    """The pictures of an edit list, every sprite in orientation 1."""
    table = pd.DataFrame({"kind": kind, "source": source})
    return table.assign(orientation=np.where(table["kind"] == SPRITE, 1, None), mirrored=False)


def test_the_longest_exact_repeat_is_of_the_very_same_pictures():
    for shown, longest in (
        ([1, 2, 3, 4], 0), ([1, 2, 3, 9, 1, 2, 3], 3), ([1, 1, 1, 1], 2), ([1, 2, 1, 2, 1, 2], 2),
        ([5, 1, 2, 3, 4, 6, 1, 2, 3, 4, 7, 1, 2], 4), ([1, 2, 3] * 8, 12),
    ):  # fmt: skip
        for kind in (SPRITE, FRAME):
            assert edit_measures.longest_repeat(picture_table(kind, shown)) == longest
    kinds = [SPRITE] * 4 + [FRAME] * 4  # a frame is no repeat of the sprite of its number
    assert edit_measures.longest_repeat(picture_table(kinds, [0, 1, 2, 3] * 2)) == 0
    turned = picture_table(SPRITE, [0, 1, 2, 3] * 2).assign(orientation=[1] * 4 + [2] * 4)
    assert edit_measures.longest_repeat(turned) == 0


@pytest.mark.parametrize("kind", [SPRITE, FRAME])
def test_a_fish_half_out_of_the_tank_is_counted(kind):
    long, short = np.array([[20.0, 0], [-20, 5], [-20, -5]]), np.zeros((1, 2))
    hulls = (long, short) if kind == SPRITE else (short, long)
    here = paper_player(network_of(), hulls=hulls)
    table = pd.DataFrame({"x_px": [100.0, 760, 400, 40], "y_px": [300.0, 300, 300, 300]})
    for heading, count in ((0.0, 2), (90.0, 0), (180.0, 2)):
        drawn = table.assign(heading_deg=heading, kind=kind, source=[0, 0, 1, 1], mirrored=False)
        assert measures.count_ticks_outside(drawn, here) == count
        other = drawn.assign(kind=FRAME if kind == SPRITE else SPRITE)
        assert measures.count_ticks_outside(other, here) == 0


def test_the_head_of_a_sprite_sways_that_of_a_frame_is_as_measured(player):
    sprites_ = player.silhouettes.sprites.assign(head_offset_deg=np.arange(32) % 2 * 10.0)
    swaying = replace(player, silhouettes=replace(player.silhouettes, sprites=sprites_))
    table = pd.DataFrame(
        {"kind": SPRITE, "source": np.arange(8), "x_px": 0.0, "y_px": 0.0, "heading_deg": 0.0}
    )
    _, rate = measures.motion_of_edit(table, swaying)
    assert np.abs(rate) == pytest.approx(10.0 * RATE / DELTA)
    _, rate = measures.motion_of_edit(table.assign(kind=FRAME), swaying)
    assert rate == pytest.approx(0)


def test_steps_and_seams_of_the_film_itself_are_one():
    steps = np.random.default_rng(0).uniform(1, 3, 501)
    assert edit_measures.step_measures(steps, steps)["step_ratio_median"] == 1
    found = edit_measures.discontinuity_measures(steps, steps)
    assert found["seam_ratio_median"] == 1
    assert found["jumps_above_film_p95_pct"] == pytest.approx(5, abs=0.5)
    assert edit_measures.discontinuity_measures(np.zeros(0), steps) == {"jumps": 0}


def test_states_of_the_film_sum_to_all_of_it():
    share = state_shares(lessons(), phases())
    assert sum(share.values()) == pytest.approx(100)
    turning = 100 * (lessons()["swimming_type"] != 0).mean()
    assert share[f"{STATES[TURN]}_pct"] == pytest.approx(turning)
