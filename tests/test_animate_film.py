"""The film to swim by, the search of mode `matching` through it: laws, a slow search, ground truth."""

from dataclasses import replace

import networkx as nx
import numpy as np
import pandas as pd
import pytest
import toy_film as toy

from finloop.animate import measures
from finloop.animate.arena import is_legal_point, make_tank
from finloop.animate.kinematics import rotate
from finloop.animate.memory import (
    NEVER,
    find_last_on_screen,
    index_memory,
    last_on_screen,
    mark_rows,
    remember_rows,
)
from finloop.animate.obstacles import Discs
from finloop.animate.silhouettes import FilmOutlines, FrameOutlines
from finloop.animate.size import measure_reach
from finloop.animate.state import Fish, State
from finloop.distance.picture import BODY, FILM
from finloop.edit.schema import CONSIDERED, EDIT, FRAME, TERMS, VERDICTS, WHY, Goal
from finloop.edit.schema import FILM as IN_FILM
from finloop.edit.stretch import Decision, describe_decision
from finloop.features.table import wrap_deg
from finloop.io.table import load_table, save_table
from finloop.plan.plan import candidate_table


def film_player(film_=None, room_=None, **changes):
    """A player of mode `matching` that shows the film alone."""
    return toy.matching_of(toy.film_world_of(film_, room_, **changes))


def flat(found):
    """The ticks of a swim: way (n, 3), numbers, rotations, whether a jump begins, stretch of each."""
    s = found.stretches
    rotations_deg = [
        np.zeros(len(one.trajectory)) if one.rotation_deg is None else one.rotation_deg for one in s
    ]
    new = np.concatenate(
        [[one.begins_with_transition] + [False] * (len(one.trajectory) - 1) for one in s]
    )
    of = np.repeat(np.arange(len(s)), [len(one.trajectory) for one in s])
    numbers = np.concatenate([one.number for one in s])
    return (
        np.concatenate([one.trajectory for one in s]),
        numbers,
        np.concatenate(rotations_deg),
        new,
        of,
    )


def on_the_spot(found):
    return np.array([s.decision.reason == "spot" for s in found.stretches])


# --- the film


@pytest.mark.parametrize("rate", [0.0, 5.0, -5.0])
def test_a_film_moves_as_its_fish_did_at_the_drawn_size(rate):
    small, large = (toy.arc_track([rate] * 20, 30.0, length=length) for length in (40.0, 80.0))
    found = toy.film_of(toy.table_of(small, large), toy.loops((3, 30)))
    angle = np.radians(30.0 + rate * np.arange(20))
    drawn = toy.SPEED * 60.0 / toy.RATE  # the median fish is 60 px long
    for first in (0, 21):
        here = slice(first, first + 20)
        assert found.dx[here] == pytest.approx(drawn * np.cos(angle))
        assert found.dy[here] == pytest.approx(-drawn * np.sin(angle))
        assert found.dx[first + 20] == found.dy[first + 20] == 0
    assert found.scale[:21] == pytest.approx(1.5) and found.scale[21:] == pytest.approx(0.75)
    chord = np.sinc(toy.DELTA * rate / 360) / np.sinc(rate / 360)  # over Δ the way is a chord
    rows = [8, 30] if rate else np.arange(42)  # of a straight track also at its ends
    assert found.speed[rows] == pytest.approx(toy.SPEED * chord)


def test_a_film_ends_with_each_track_and_before_each_barred_row():
    table = toy.table_of(toy.arc_track([0.0] * 9), toy.arc_track([0.0] * 9))
    assert list(np.flatnonzero(~toy.film_of(table, toy.loops((3, 12))).has_next)) == [9, 19]
    found = toy.film_of(table, toy.loops((3, 12)), barred=[5, 16])
    assert list(np.flatnonzero(~found.has_next)) == [4, 5, 9, 15, 16, 19]
    assert (found.dx[~found.has_next] == 0).all() and (found.dx[found.has_next] > 0).all()


def test_loops_lead_both_ways_but_never_to_a_barred_row_or_where_the_film_ends():
    table = toy.table_of(toy.arc_track([0.0] * 19), toy.arc_track([0.0] * 19))
    pairs = toy.loops(
        (3, 25, 0.4), (3, 10, 0.2), (8, 35, 0.6), (10, 30, 0.8), (15, 28, 0.5)
    )  # fmt: skip

    def ways(reel):
        return {
            row: [
                (int(reel.to[e]), pytest.approx(reel.seam[e], rel=1e-6))
                for e in range(reel.start[k], reel.start[k + 1])
            ]
            for row, k in enumerate(reel.jump_slot) if k >= 0
        }  # fmt: skip

    wanted = {
        3: [(10, 0.4), (25, 0.8)], 8: [], 10: [(3, 0.4), (30, 1.6)], 15: [(28, 1.0)],
        25: [(3, 0.8)], 28: [], 30: [(10, 1.6)], 35: [(8, 1.2)],
    }  # fmt: skip
    assert ways(toy.film_of(table, pairs, step=0.5)) == wanted
    assert ways(toy.film_of(table, pairs, step=0.5, barred=[25])) == wanted | {3: [(10, 0.4)]}


def test_endless_is_what_reaches_a_cycle_of_the_graph():
    rng = np.random.default_rng(0)
    seen = np.zeros(2, int)
    for _ in range(30):
        table, pairs, barred = toy.random_film(rng)
        reel = toy.film_of(table, pairs, barred=barred)
        graph = nx.DiGraph()
        graph.add_nodes_from(range(len(table)))
        for row in range(len(table)):  # an edge: after this row's turn comes the turn of that one
            instead = [row]
            if reel.jump_slot[row] >= 0:
                k = reel.jump_slot[row]
                instead += list(reel.to[reel.start[k] : reel.start[k + 1]])
            graph.add_edges_from((row, other + 1) for other in instead if reel.has_next[other])
        cyclic = {
            row for part in nx.strongly_connected_components(graph) for row in part
            if len(part) > 1 or graph.has_edge(row, row)
        }  # fmt: skip
        wanted = [bool(({row} | nx.descendants(graph, row)) & cyclic) for row in graph]
        assert list(reel.recurrent) == wanted
        seen += np.bincount(reel.recurrent, minlength=2)
    assert seen.min() > 100  # both happen


# --- laws of every swim


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_positions_move_as_the_film_turned_and_only_loops_are_jumped(pose):
    table, pairs = toy.rich(heading=pose == BODY)
    reel = toy.film_of(table, pairs, pose)
    found, _ = toy.edit_of(film_player(reel), [Goal("A", 200.0, 200.0)], 900, 1)
    way, number, rotation_deg, new, of = flat(found)
    partners = {(int(a), int(b)) for a, b in pairs[["a", "b"]].to_numpy()}
    partners |= {(b, a) for a, b in partners}
    still = on_the_spot(found)[of]
    jumps = 0
    for t in range(1, len(way)):
        if still[t]:
            continue
        before = number[t - 1]
        moved = rotate(reel.dx[before], reel.dy[before], rotation_deg[t - 1])
        assert way[t, :2] - way[t - 1, :2] == pytest.approx(moved, abs=1e-6)
        assert wrap_deg(way[t, 2] - reel.heading[number[t]] - rotation_deg[t]) == pytest.approx(
            0, abs=1e-6
        )
        assert new[t] == (number[t] != before + 1)
        if new[t]:
            assert (before + 1, number[t]) in partners
            jumps += 1
        elif not still[t - 1]:
            assert rotation_deg[t] == pytest.approx(rotation_deg[t - 1])
    assert jumps > 20
    assert still.mean() < 0.3
    if pose == FILM:  # nothing is turned, but on the spot
        stop = int(still.argmax()) if still.any() else len(still)
        assert stop > 100 and not rotation_deg[:stop].any()


def test_the_heading_goes_on_over_a_jump():
    found, table = toy.edit_of(film_player(), [], 1200, 3)
    way, number, _, new, of = flat(found)
    heading = toy.rich_film().heading
    would = heading[number[:-1] + 1] - heading[number[:-1]]  # had it not jumped
    turned = wrap_deg(np.diff(way[:, 2]) - would)
    calm = ~on_the_spot(found)[of][1:]
    assert turned[calm] == pytest.approx(0, abs=1e-6) and (new[1:] & calm).sum() > 20
    drawn = np.abs(wrap_deg(np.diff(table["heading_deg"].to_numpy(float))))
    assert drawn[calm[: len(drawn)]].max() <= 7.001


def test_an_animation_lasts_as_many_seconds_as_are_asked_for_and_decisions_so_many_delta():
    own_world = toy.film_world_of(seconds=7.0)
    assert (own_world.duration, own_world.to_ticks(7.0)) == (7 * toy.RATE, 7 * toy.DELTA)


def test_the_fish_begins_where_the_film_goes_on():
    mode = film_player(reel := toy.film_with_dead_ends())
    after = reel.has_next & np.append(reel.recurrent[1:], False)
    assert after[:140].all() and after[201:341].all() and after[402:530].all()
    assert after.sum() == 140 + 140 + 128
    rng = np.random.default_rng(0)
    assert all(after[mode.begin(rng).fish.row] for _ in range(2000))


def test_the_film_never_stops():
    for seed in range(3):
        found, table = toy.edit_of(film_player(), [Goal("A", 700.0, 60.0)], 2000, seed)
        _, number, *_, of = flat(found)
        assert (np.diff(number) != 0).all()
        assert on_the_spot(found)[of].mean() < 0.1
        assert np.ptp(table["x_px"]) > 200 and np.ptp(table["y_px"]) > 150


def test_a_fish_in_the_film_shows_less_of_what_is_dear():
    table, pairs = toy.rich()
    costs = np.where(np.arange(len(table)) // 25 % 3 == 0, 1.0, -0.5)
    shown = []
    for share in (0.0, 3.0):
        player = film_player(toy.film_of(table, pairs, rarity_sum=(share * costs).cumsum()))
        found, _ = toy.edit_of(player, [], 1500, 5)
        rows = np.concatenate([one.number for one in found.stretches])
        shown.append(costs[rows % len(costs)].mean())
    assert shown[1] < shown[0] - 0.1


def test_a_fish_without_room_turns_up_to_the_last_row_of_the_film():
    mode = film_player(toy.film_of(toy.table_of(toy.arc_track([0.0] * 199)), toy.loops((20, 199))))
    state = mode.begin(np.random.default_rng(0))
    fish = state.fish._replace(row=197, rotation_deg=0.0, x=744.0, y=300.0)  # into the wall
    goal = Goal("A", 300.0, 300.0)
    found, then = mode.plan(state._replace(fish=fish), goal, np.random.default_rng(0))
    assert list(found.number) == [198] and then.fish.row == 198
    assert found.decision == Decision("spot")


def test_a_fish_that_fits_a_narrow_place_in_one_picture_alone_gets_away():
    """At the wall, headed straight for its goal: no other picture fits, and none needs a turn."""
    world, fits_there = toy.film_world_of(), 200
    table = np.zeros((len(world.film.has_next), 6, 3))
    table[..., 2] = 3 * toy.LENGTH / 10
    table[fits_there, :, 2] = 2.0
    world = replace(world, discs=Discs(table, len(table), 3 * toy.LENGTH / 10))
    mode, goal = toy.matching_of(world), Goal("A", 400.0, 300.0)
    ys, xs = np.nonzero(world.tank.arena & ~world.tank.legal)
    for at in np.random.default_rng(0).choice(len(xs), 12):
        x, y = float(xs[at]), float(ys[at])
        heading = float(np.degrees(np.arctan2(y - goal.y_px, goal.x_px - x)))
        rotation_deg = float(wrap_deg(heading - world.film.heading[fits_there]))
        fish = Fish(x, y, heading, 0.0, IN_FILM, -1, row=fits_there, rotation_deg=rotation_deg)
        state = State(fish, np.zeros(2))
        rng = np.random.default_rng(0)
        for _ in range(60):
            _, state = mode.plan(state, goal, rng)
        assert np.hypot(state.fish.x - x, state.fish.y - y) > toy.LENGTH


def test_a_way_is_never_swum_farther_than_it_was_looked_at():
    """Loop ends so rare that between two of them lies more film than a look ahead."""
    reel = toy.film_of(toy.table_of(toy.arc_track([0.7] * 599)), toy.loops((20, 560), (40, 580)))
    assert np.diff(np.flatnonzero(reel.jump_slot >= 0)).max() > 5 * toy.RATE
    for seed in range(3):
        found, _ = toy.edit_of(film_player(reel), [Goal("A", 200.0, 200.0)], 1500, seed)
        way = np.concatenate([stretch.trajectory for stretch in found.stretches])
        assert all(is_legal_point(toy.open_tank().legal, x, y) for x, y in way[:, :2])


def test_a_goal_that_no_loop_can_reach_is_not_reached_and_nothing_breaks():
    reel = toy.film_of(
        toy.arc_track([4.0] * 199), toy.loops((5, 95), (50, 140))
    )  # one circle, 15 px across
    goals = [Goal("A", 700.0, 60.0)]
    mode = film_player(reel)
    found, table = toy.edit_of(mode, goals, 800, 1)
    at = np.array([table["x_px"].iloc[0], table["y_px"].iloc[0]])
    assert np.hypot(*(at - goals[0][1:3])) > 250  # far away
    assert list(found.reached) == [-1] and set(table["goal"]) == {"A"}
    measured = measures.measure_goals(table, goals, mode.world)
    assert measured == {"goals": 1.0, "goals_reached_pct": 0.0}
    assert len(table) == 800 and np.ptp(table["x_px"]) < 120


# --- one decision


def three_ways(wall=False):
    """Straight on to the right at y = 300; at row 20 circles to the left, to the right, or on."""
    table = toy.table_of(
        toy.arc_track([0.0] * 149), toy.arc_track([3.0] * 149), toy.arc_track([-3.0] * 149)
    )
    pairs = [(20, 170, 0.2), (20, 320, 0.2), (140, 21, 0.2), (290, 171, 0.2), (440, 321, 0.2)]
    reel = toy.film_of(table, toy.loops(*pairs))
    arena = toy.ARENA.copy()
    if wall:
        arena[:, 520:] = False
    # Rare steps cost so much that a turn on the spot, which no film shows, never pays.
    player = film_player(reel, make_tank(arena, 0.6 * toy.LENGTH), rarity_weight=1.0)
    return player, Fish(400.0, 300.0, 0.0, toy.SPEED, IN_FILM, -1, row=19, since=100)


@pytest.mark.parametrize(
    ("at", "row"), [((700.0, 300.0), 20), ((400.0, 120.0), 170), ((400.0, 480.0), 320)]
)
def test_the_way_that_leads_to_the_goal_is_taken(at, row):
    player, fish = three_ways()
    for seed in range(5):
        found, then = player.plan(
            State(fish, np.zeros(2)), Goal("A", *at), np.random.default_rng(seed)
        )
        assert found.number[0] == row and found.begins_with_transition == (row != 20)
        assert found.trajectory[0] == pytest.approx((400 + toy.STEP, 300, 0))
        assert found.options.rows[found.options.taken] == row and len(found.options.rows) == 3
        decision = found.decision
        assert decision.reason == ("play" if row == 20 else "jump") and decision.candidates == 3
        assert np.isnan(decision.seam) if row == 20 else decision.seam == pytest.approx(0.2)
        assert decision.value_s == found.options.costs[found.options.taken]
        assert then.fish.tick == len(found.trajectory)


def test_what_a_way_costs_is_the_sum_of_its_terms():
    player, fish = three_ways()
    seen = fish._replace(tick=1000, recent=np.array([[181, 299, 861]]))
    options = player.plan(
        State(seen, np.zeros(2)), Goal("A", 400.0, 120.0), np.random.default_rng(0)
    )[0].options
    ends = np.isinf(options.costs)
    assert not ends.all()
    terms = dict(zip(TERMS, options.terms[~ends].T, strict=True))
    chance = terms.pop("chance")
    assert sum(terms.values()) == pytest.approx(options.costs[~ends])
    assert (chance > 0).all() and (terms["time"] > 0).all() and (terms["path"] == 0).all()
    jumps = options.seams[~ends] > 0
    assert (terms["seam"][jumps] > 0).all()
    assert options.costs[options.taken] + chance.max() >= options.costs.min()


def test_a_way_that_leaves_the_tank_fails_that_test():
    player, fish = three_ways(wall=True)
    found, _ = player.plan(State(fish, np.zeros(2)), Goal("A", 440, 100), np.random.default_rng(0))
    options = found.options
    assert list(options.rows) == [20, 170, 320]
    said = [VERDICTS[number] for number in options.verdict]
    assert said[0] == "tank" and "tank" not in said[1:]
    assert np.isinf(options.costs[0]) and options.ticks[0] < 31
    assert (found.decision.candidates, found.decision.candidates_tank) == (3, 1)


@pytest.mark.parametrize(("heading", "quadrant"), [(30.0, 1), (120.0, 2), (210.0, 3), (300.0, 4)])
def test_a_decision_names_the_quadrant_that_the_fish_swims_into(heading, quadrant):
    table = toy.table_of(toy.arc_track([0.0] * 99), toy.arc_track([0.0] * 99))
    player = film_player(toy.film_of(table, toy.loops((20, 120), (60, 21), (160, 121))))
    fish = Fish(400.0, 300.0, heading, toy.SPEED, IN_FILM, -1, row=30, rotation_deg=heading)
    angle = np.radians(heading)
    goal = Goal("A", 400 + 200 * np.cos(angle), 300 - 200 * np.sin(angle))
    found, _ = player.plan(State(fish, np.zeros(2)), goal, np.random.default_rng(0))
    assert found.decision.quadrant == quadrant


def test_ways_that_cost_about_the_same_are_all_taken():
    player, fish = three_ways()
    aims = Goal("A", 700.0, 300.0), Goal("A", 400.0, 120.0)
    for wide, taken in ((1e-6, 1), (1e3, 3)):
        settings = replace(player.world.settings, choice_noise=wide)
        loose = replace(player, world=replace(player.world, settings=settings))
        for goal in aims:
            rows = {
                loose.plan(State(fish, np.zeros(2)), goal, np.random.default_rng(seed))[0].number[0]
                for seed in range(40)
            }
            assert len(rows) == taken


def test_what_was_on_screen_is_remembered_as_long_as_it_counts():
    player = film_player()
    state, rng = player.begin(np.random.default_rng(3)), np.random.default_rng(4)
    last = np.full(len(toy.rich_table()), NEVER)
    for _ in range(150):
        tick, (stretch, state) = state.fish.tick, player.plan(state, None, rng)
        last[stretch.number] = tick + np.arange(len(stretch.number))
        memory = player.world.cost_weights.memory
        recent = state.fish.recent
        mine = np.array([last_on_screen(recent, row, row) for row in range(len(last))])
        counts = last > state.fish.tick - memory
        assert (mine[counts] == last[counts]).all()
        assert (mine[~counts] <= state.fish.tick - memory).all()
    assert len(state.fish.recent) < memory  # not as many as rows of the film


def test_a_memory_is_what_an_array_of_all_rows_would_remember():
    rng = np.random.default_rng(0)
    recent, last, cut = np.zeros((0, 3), np.int64), np.full(40, NEVER), 0
    for tick in range(0, 1200, 6):
        first, ticks, before = int(rng.integers(35)), int(rng.integers(1, 6)), len(recent)
        recent = remember_rows(recent, first, first + ticks - 1, tick, float(tick - 90))
        last[first : first + ticks] = tick + np.arange(ticks)
        assert (np.diff(recent[:, :2].ravel()) >= np.tile([0, 1], len(recent))[:-1]).all()
        mine = np.array([last_on_screen(recent, row, row) for row in range(40)])
        index = index_memory(recent)
        assert mine.tolist() == [find_last_on_screen(recent, index, r, r) for r in range(40)]
        counts = last > tick - 90
        assert (mine[counts] == last[counts]).all() and (mine[~counts] < tick - 89).all()
        a, b = sorted(rng.integers(0, 40, 2))
        assert last_on_screen(recent, a, b) == mine[a : b + 1].max()
        assert find_last_on_screen(recent, index, a, b) == mine[a : b + 1].max()
        cut += len(recent) > before + 1
    assert cut  # a stretch of which the middle is shown again becomes two


def test_the_index_of_a_memory_finds_rows_far_apart_and_none_in_an_empty_one():
    rng = np.random.default_rng(1)
    empty = np.zeros((0, 3), np.int64)
    assert find_last_on_screen(empty, index_memory(empty), 3, 9) == NEVER
    firsts = np.sort(rng.choice(10**7, 60, replace=False)) * 10
    memory = np.column_stack([firsts, firsts + rng.integers(0, 9, 60), rng.integers(0, 900, 60)])
    index = index_memory(memory)
    assert len(index.starts) <= 3 * len(memory)
    near = (firsts[:, None] + np.arange(-3, 12)).ravel()
    for first, length in zip(near.tolist(), rng.integers(0, 99, len(near)).tolist(), strict=True):
        expected = last_on_screen(memory, first, first + length)
        assert find_last_on_screen(memory, index, first, first + length) == expected


def test_a_row_that_was_added_is_marked_and_few_others_are():
    rng = np.random.default_rng(2)
    for _ in range(50):
        first, length = int(rng.integers(10**6)), int(rng.integers(1, 200))
        marks = mark_rows(mark_rows(0, first, first + length - 1), 7, 7)
        shown = [7, *range(first, first + length)]
        assert all(mark_rows(0, row, row) & marks for row in shown)
        others = rng.integers(0, 10**6, 400).tolist()
        assert np.mean([bool(mark_rows(0, row, row) & marks) for row in others]) < 0.3


@pytest.mark.parametrize(("rarity_weight", "reason"), [(0.01, "spot"), (1.0, "play")])
def test_a_fish_turns_on_the_spot_first_only_where_that_costs_less(rarity_weight, reason):
    """The goal is behind the fish, and the film shows no turn; or a turn costs too much."""
    pairs = toy.loops(*((row, 199 - row) for row in range(10, 100, 10)))
    reel = toy.film_of(toy.table_of(toy.arc_track([0.0] * 199)), pairs)
    player = film_player(reel, rarity_weight=rarity_weight)
    fish = Fish(300.0, 300.0, 0.0, toy.SPEED, IN_FILM, -1, row=25)
    state, goal = State(fish, np.zeros(2)), Goal("A", 100.0, 300.0)
    found, _ = player.plan(state, goal, np.random.default_rng(0))
    decision = found.decision
    assert decision.reason == reason and decision.candidates == 1
    if reason == "spot":
        terms, others = (
            {name: costs[k] for k, name in enumerate(TERMS)}
            for costs in (decision.taken_terms, decision.other_terms)
        )
        turn_ticks = 180 / player.world.most_spot_turn_deg
        assert terms["rarity"] == pytest.approx(turn_ticks * 199 * rarity_weight / toy.RATE)
        assert decision.value_s == pytest.approx(sum(terms.values()))
        assert decision.value_s < sum(others.values()) - others["chance"]
        assert "turn first" in describe_decision(decision, "A", 0.0)


# --- what is written down


def test_an_edit_list_and_what_was_weighed_are_what_their_schemas_say(tmp_path):
    found, table = toy.edit_of(film_player(), [Goal("A", 200.0, 200.0)], 900, 1)
    save_table(tmp_path / "a.parquet", table, EDIT)
    back = load_table(tmp_path / "a.parquet", EDIT)
    assert list(back["tick"]) == list(range(900))
    weighed = candidate_table(found, 900, toy.rich_film().filmed_count)
    save_table(tmp_path / "b.parquet", weighed, CONSIDERED)
    again = load_table(tmp_path / "b.parquet", CONSIDERED)
    counts = again.groupby("tick")["taken"].sum()
    turns_first = (back["reason"] == "spot") & back["taken_time_s"].notna()
    assert (counts == np.where(turns_first[counts.index], 0, 1)).all()
    assert set(again["fails"]) <= {"", "tank", "quadrant", "heading", "passed over"}
    assert (again["value_s"].isna() <= again["fails"].isin(["tank", "passed over"])).all()
    taken = again[again["taken"]]
    assert (taken["value_s"].notna() == (taken["fails"] == "")).all()
    assert taken["value_s"].notna().mean() > 0.9
    assert list(back["source"].iloc[taken["tick"]]) == list(taken["row"])
    decided = back.iloc[taken["tick"]]
    assert decided["reason"].isin(["play", "jump"]).all()
    assert list(decided["candidates"]) == list(again.groupby("tick").size()[taken["tick"]])
    assert decided["value_s"].to_numpy() == pytest.approx(taken["value_s"].to_numpy(), nan_ok=True)
    for term in TERMS:  # of the way taken, and of the cheapest other one
        costs = taken[f"{term}_s"].to_numpy()
        assert decided[f"taken_{term}_s"].to_numpy() == pytest.approx(costs, nan_ok=True)
    is_decided = again["tick"].isin(taken["tick"])
    rest = again[is_decided & ~again["taken"] & again["value_s"].notna()]
    best = rest.loc[rest.groupby("tick")["value_s"].idxmin()].set_index("tick")
    others = decided[decided["other_time_s"].notna()]
    assert set(others["tick"]) == set(best.index) and len(others) > 10
    shown = others[[f"other_{term}_s" for term in TERMS if term != "chance"]].sum(axis=1)
    wanted = best.loc[others["tick"], "value_s"].to_numpy()
    assert shown.to_numpy() == pytest.approx(wanted, abs=1e-4)
    assert (decided["seam"].isna() == (decided["reason"] == "play")).all()
    later = back["reason"].isna()
    assert 0.3 < later.mean() < 1 and not back["reason"].isna()[0]
    assert back.loc[later, WHY].isna().all(axis=None)
    assert set(back["kind"]) == {FRAME} and set(back["mode"]) == {"matching"}
    assert set(back["state"]) == {"film"}


# --- decisions in words


@pytest.mark.parametrize(
    ("decision", "said"),
    [
        (Decision("phase", film_speed=2.04), "like a stretch of the film from 2.0 body lengths/s on"),
        (Decision("wall"), "a wall is ahead"),
        (Decision("spot", candidates=2, candidates_tank=2),
         "on the spot: no candidate stays in the tank (2 candidates, 2 leave the tank or end)"),
        (Decision("play", quadrant=2, candidates=1), "play on: quadrant 2 towards A; 1 candidate"),
        (Decision("turn", turn_deg=-43.4, sprite_area=0.41, room=0.5),
         "turn right 43° towards A: the network asks for motion area 0.44, the sprites have 0.41, little room"),
        (Decision("jump", seam=0.2, value_s=3.21, quadrant=2, candidates=4, candidates_quadrant=2, candidates_heading=1),
         "jump, 0.20 steps: quadrant 2 towards A; 4 candidates, 2 lead away, 1 head away; 3.2 s"),
        (Decision("play", value_s=3.21, quadrant=2, candidates=4, other_terms=(0.0, 4.0, *[0.0] * 5, 1.0),
                  taken_terms=(0.0, 0.3, -0.12, 0.01, 0.0, 2.02, 1.0, 9.0)),
         "play on: quadrant 2 towards A; 4 candidates; 3.2 s (repeat 0.3, rarity −0.1, time 2.0, to come 1.0), the next best 4.0 s"),
        (Decision("wall", exit="no_way", candidates=1, candidates_tank=1),
         "leave the film without a gateway: no legal candidate (1 candidate, 1 leave the tank or end); a wall is ahead"),
        (Decision("wall", exit="mode", seam=0.5),
         "leave the film by a gateway, 0.50 steps: the mode shows sprites; a wall is ahead"),
    ],
)  # fmt: skip
def test_a_decision_is_told_in_words(decision, said):
    assert describe_decision(decision, "A", 0.44) == said


def test_every_decision_can_be_told():
    for player in toy.players_of().values():
        found, _ = toy.edit_of(player, [Goal("A", 200.0, 200.0)], 800, 1)
        for stretch, name in zip(found.stretches, found.names, strict=True):
            text = describe_decision(stretch.decision, name, stretch.area)
            assert "nan" not in text and "inf" not in text


# --- hulls


def test_outlines_of_frames_are_ahead_and_to_the_left():
    # A fish headed up the screen: its head above the centre, its left to the left.
    places = pd.DataFrame({"x_px": [100.0], "y_px": [50.0], "heading_deg": [90.0]})
    outline = np.array([[[100.0, 30.0], [95.0, 50.0], [100.0, 80.0]]])
    hull = FrameOutlines(FilmOutlines.from_rows(outline, places), np.array([2.0]))
    assert hull[:][0] == pytest.approx(np.array([[40, 0], [0, 10], [-60, 0]]), abs=1e-4)


def test_the_widest_frames_are_barred():
    hull = np.array([[20.0, 0], [-20, 5], [0, 3]])
    hulls = np.repeat(hull[None].astype(np.float32), 1000, axis=0)
    hulls[::200] *= 3
    places = pd.DataFrame(np.full((1000, 3), 50.0), columns=["x_px", "y_px", "heading_deg"])
    frames = FrameOutlines(FilmOutlines.from_rows(hulls + 50, places), np.ones(1000))
    most, barred = measure_reach([hull], frames, 0.99)
    assert most == pytest.approx(np.hypot(20, 5), rel=1e-6)
    assert list(np.flatnonzero(barred)) == list(range(0, 1000, 200))
    most, barred = measure_reach([10 * hull], frames, 0.99)  # sprites are shown: they must fit in
    assert most == pytest.approx(10 * np.hypot(20, 5)) and not barred.any()
