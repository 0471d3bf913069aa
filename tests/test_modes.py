"""Laws of every mode; the fish paper's modes network, loops and hybrid: a slow look-up, ground truth."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import pandas as pd
import pytest
import toy_film as toy

from finloop.animate import measures
from finloop.animate.arena import is_legal_point, make_tank
from finloop.animate.kinematics import bearing, rotate, touches_target
from finloop.animate.places import random_goals
from finloop.animate.route import Route
from finloop.animate.shoal import animate_fish
from finloop.animate.state import Fish
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.distance.picture import BODY, FILM
from finloop.edit.measures import (
    longest_repeat,
    motion_area_errors,
    picture_kind_shares,
    picture_kinds,
    turn_measures,
)
from finloop.edit.modes import MODES, ONE_FISH
from finloop.edit.schema import ACCELERATE, FADE, FRAME, SPRITE, STATES, STRAIGHT, VERDICTS, Goal
from finloop.edit.schema import FILM as IN_FILM
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.table import find_orientations, orientation_heading_deg, wrap_deg
from finloop.loops.positions import quadrant_of_displacement
from finloop.modes.loops import mark_loop_ends
from finloop.modes.network import Network
from finloop.modes.sprites import plan_turn
from finloop.plan.plan import candidate_table

STAY = round(settings("loops").min_deltas_between_jumps * toy.DELTA)
A = [Goal("A", 200.0, 200.0)]


@cache
def posed_film(pose):
    if pose == BODY:
        return toy.rich_film(), *toy.rich()
    table, pairs = toy.rich(heading=False)
    return toy.film_of(table, pairs, FILM), table, pairs


@cache
def posed_gateways(pose):
    """Gateways of the rich film; in pose FILM each is of one orientation."""
    if pose == BODY:
        return toy.gateways()
    _, table, _ = posed_film(FILM)
    made = toy.gateways(table, every=5)
    row = made["row"].to_numpy()
    leads = row + (made["direction"] == "out")  # to what follows on the row
    number = find_orientations(table["heading_deg"].to_numpy()[leads], toy.ORIENTATIONS)
    turn = wrap_deg(-orientation_heading_deg(number, toy.ORIENTATIONS))
    made = made.assign(orientation=number, turn_deg=turn)
    made["rank"] = made.groupby(["direction", "sprite", "orientation"]).cumcount() + 1
    return made


def player_in(mode, pose=BODY, **changes):
    film = posed_film(pose)[0]
    if mode == "loops":
        return toy.paper_player(toy.loops_of(film, **changes))
    if mode == "matching":
        return toy.matching_of(toy.film_world_of(film, **changes))
    assert not changes
    return toy.player_of(mode, toy.film_world_of(film), posed_gateways(pose))


def in_film(film, rng, room=None):
    """A fish somewhere in the tank, at a row from which the film goes on."""
    goes_on = film.has_next[:-2] & film.can_play_on(np.arange(1, len(film.has_next) - 1))
    row = int(rng.choice(np.flatnonzero(goes_on)))
    rotation_deg = float(rng.uniform(-180, 180)) if film.jumps_keep_heading else 0.0
    x, y = (room or toy.open_tank()).random_point(rng)
    heading = float(wrap_deg(film.heading[row] + rotation_deg))
    return Fish(x, y, heading, 2.0, IN_FILM, -1, row=row, rotation_deg=rotation_deg, since=100)


def partners(pairs):
    """The ends of loops, both ways."""
    ends = {(int(a), int(b)) for a, b in pairs[["a", "b"]].to_numpy()}
    return ends | {(b, a) for a, b in ends}


# --- every mode


@pytest.mark.parametrize("mode", MODES)
def test_a_step_changes_nothing_and_a_kept_state_has_one_future(mode):
    """The same state, goal and draws give the same stretch, whatever was swum since."""
    player, rng = player_in(mode), np.random.default_rng(3)
    state, kept = player.begin(rng), []
    for number in range(60):
        to = A[0] if number % 20 > 10 else None
        before, draws = (repr(state), state.fish.recent.tolist()), rng.bit_generator.state
        stretch, then = player.plan(state, to, rng)
        assert (repr(state), state.fish.recent.tolist()) == before
        kept.append((state, to, draws, stretch, then))
        state = then
    for begin in (0, 27, 45):
        state, again = kept[begin][0], np.random.default_rng(0)
        again.bit_generator.state = kept[begin][2]
        for _, to, _, stretch, then in kept[begin:]:
            mine, state = player.plan(state, to, again)
            assert repr(mine) == repr(stretch) and repr(state) == repr(then)


@pytest.mark.parametrize("mode", MODES)
def test_a_stretch_that_is_cut_leaves_the_fish_at_the_cut_from_where_it_goes_on(mode):
    player, rng, shorter = player_in(mode), np.random.default_rng(1), 0
    state = player.begin(rng)
    for _ in range(60):
        stretch, then = player.plan(state, None, rng)
        whole, end = player.cut(state, stretch, len(stretch.trajectory))
        assert whole is stretch and repr(end.fish) == repr(then.fish)
        for ticks in {1, len(stretch.trajectory) - 1} - {0, len(stretch.trajectory)}:
            short, at = player.cut(state, stretch, ticks)
            assert len(short.trajectory) == ticks and not short.touches_goal
            assert at.fish.tick == state.fish.tick + ticks
            assert (at.fish.x, at.fish.y) == tuple(stretch.trajectory[ticks - 1, :2])
            on, _ = player.plan(at, A[0], np.random.default_rng(0))
            assert np.hypot(*(on.trajectory[0, :2] - short.trajectory[-1, :2])) < toy.LENGTH / 2
            shorter += 1
        state = then
    assert shorter > 20


@pytest.mark.parametrize("mode", MODES)
def test_a_seed_gives_one_animation_and_another_seed_another(mode):
    one, same, other = (toy.edit_of(player_in(mode), A, 400, seed) for seed in (7, 7, 8))
    pd.testing.assert_frame_equal(one[1], same[1])
    weighed, again = (candidate_table(found, 400, 10**6) for found, _ in (one, same))
    pd.testing.assert_frame_equal(weighed, again)
    assert weighed.empty == (mode != "matching")
    assert not np.allclose(one[1]["x_px"], other[1]["x_px"])


@pytest.mark.parametrize(
    ("mode", "pose"), [*product(MODES, [BODY]), *product(("loops", "hybrid"), [FILM])]
)
def test_never_outside_the_tank(mode, pose):
    player = player_in(mode, pose)
    for seed in range(3 if mode == "matching" else 2):
        goals = random_goals(player.world, 3, np.random.default_rng(seed))
        _, table = toy.edit_of(player, goals, 1000, seed)
        places = table[["x_px", "y_px"]].to_numpy()
        assert all(is_legal_point(toy.open_tank().legal, x, y) for x, y in places)
        assert measures.count_ticks_outside(table, player) == 0


def player_of_a_film_at(rate, mode):
    """A player of a mode, by a film that is said to be of another frame rate."""
    taught = replace(toy.lesson(), rate_hz=rate)
    if mode == "matching":
        taught = toy.learnt(toy.lessons(), rate)
    film = toy.film_of(*toy.rich(), taught=taught)
    return toy.player_of(mode, toy.film_world_of(film, taught=taught))


@pytest.mark.parametrize("mode", MODES)
def test_a_film_said_to_be_of_a_quicker_camera_is_swum_frame_by_frame_alike(mode):
    """What has a time is measured in Δ, and so in frames; eight times as fast: no bit is lost."""
    swims = []
    for rate in (toy.RATE, 8 * toy.RATE):
        player = player_of_a_film_at(rate, mode)
        parts = animate_fish(player, A, 600, np.random.default_rng(3)).stretches
        swims.append(
            [(one.trajectory, one.number, one.rotation_deg, one.decision.reason) for one in parts]
        )
    for one, quicker in zip(*swims, strict=True):
        for mine, other in zip(one, quicker, strict=True):
            np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_goes_on_from_the_state_of_any_other(mode):
    made, rng = toy.players_of(), np.random.default_rng(0)
    for other in MODES:
        state = made[other].begin(rng)
        for player in (made[other], made[mode]):
            for _ in range(30):
                before = state.fish
                stretch, state = player.plan(state, None, rng)
                assert (
                    np.hypot(*(stretch.trajectory[0, :2] - (before.x, before.y))) < toy.LENGTH / 2
                )
                assert abs(wrap_deg(stretch.trajectory[0, 2] - before.heading)) < 40
        kinds = {"network": SPRITE, "loops": FRAME, "matching": FRAME}
        assert stretch.kind == kinds.get(mode, stretch.kind)


@pytest.mark.parametrize("mode", ONE_FISH)
def test_a_path_is_refused(mode):
    with pytest.raises(FinloopError, match="a path, in a mode of one fish"):
        player_in(mode).begin(np.random.default_rng(0), Route(*[None] * len(Route._fields)))


# --- loops: the choice at a loop end


def slow_way(film, tank_, start, place, goal, least):
    """(px to the goal, rows, touched) of the best loop end, and of the best that is only inside.

    None where there is none; a way that has touched its goal ends at the next loop end.
    """
    (row, rotation_deg), (x, y), n, legal, within, touch = start, place, 0, [], [], False
    begins = film.heading[row] + rotation_deg
    wanted = quadrant_of_displacement(goal.x - place[0], place[1] - goal.y)
    while is_legal_point(tank_.legal, x, y):
        n += 1
        touch = touch or touches_target(x, y, film.heading[row] + rotation_deg, goal)
        end = film.jump_slot[row + 1] if film.has_next[row] else -1
        ends = end >= 0 and film.start[end + 1] > film.start[end]
        if ends and (touch or n >= least):
            off = abs(wrap_deg(bearing(*place, x, y) - begins))
            within.append((0.0 if touch else np.hypot(goal.x - x, goal.y - y), n, touch))
            there = goal.free or quadrant_of_displacement(x - place[0], place[1] - y) == wanted
            if touch or (there and off <= 45):
                legal.append(within[-1])
        if not film.has_next[row] or (touch and ends):
            break
        dx, dy = rotate(film.dx[row], film.dy[row], rotation_deg)
        x, y, row = x + dx, y + dy, row + 1
    return nearest_of(legal), nearest_of(within)


def nearest_of(ends):
    """The first of the nearest ends, None of none; NaN where others are as near but for a bit."""
    best = min(ends, default=None)
    tied = [one for one in ends if one[0] < best[0] + 1e-6]
    return best if len(tied) < 2 else (best[0], np.nan, best[2])


@pytest.mark.parametrize("pose", [BODY, FILM])
@pytest.mark.parametrize("free", [False, True])
def test_looking_up_finds_the_nearest_loop_end_in_the_goal_s_quadrant(pose, free):
    """Of a fish that wanders, in any quadrant."""
    small = make_tank(toy.ARENA[:300, :300], 0.6 * toy.LENGTH)
    play_, rng = toy.loops_of(posed_film(pose)[0], toy.world_of(small)), np.random.default_rng(2)
    play_.p = replace(play_.p, improper_angle_deg=45.0)
    film, seen = play_.film, dict.fromkeys(["", "tank", "quadrant", "heading", "touched"], 0)
    for _ in range(200):
        fish = in_film(film, rng, small)
        goal = toy.spot(*small.random_point(rng))._replace(free=free)
        starts = play_.next_candidates(fish)
        ways = play_.roll_out(play_.next_place(fish), starts, goal)
        for way, (row, rotation_deg, seam) in enumerate(zip(*starts[:3], strict=True)):
            place, least = play_.next_place(fish), STAY if seam > 0 else 1
            best, any_ = slow_way(film, small, (row, rotation_deg), place, goal, least)
            if any(one is not None and np.isnan(one[1]) for one in (best, any_)):
                continue  # round in a circle: by the last bit one or the other is nearer
            assert ways.ticks[way] == (best[1] if best else 0)
            assert ways.touches_goal[way] == (best is not None and best[2])
            assert ways.inside[way] == (any_[1] if any_ else 0)
            assert ways.far[way] == pytest.approx(best[0] if best else np.inf)
            fails = VERDICTS[ways.verdict[way]]
            assert (fails == "") == bool(best) and (fails == "tank") == (any_ is None)
            seen["touched" if ways.touches_goal[way] else fails] += 1
    assert (seen.pop("quadrant") == 0) == free
    assert min(seen[name] for name in ("", "tank", "touched")) > 10
    assert free or seen["heading"] > 10


@pytest.mark.parametrize("pose", [BODY, FILM])
@pytest.mark.parametrize("choice", ["play", "jump", "any"])
def test_only_the_film_s_next_frame_or_a_loop_s_other_end_follows_a_frame(pose, choice):
    film, table, pairs = posed_film(pose)
    found, edit = toy.edit_of(player_in("loops", pose, loop_end_choice=choice), A, 1200, 1)
    ends, jumps, before = partners(pairs), 0, None
    for one in found.stretches:
        assert (np.diff(one.number) == 1).all() and film.has_next[one.number[:-1]].all()
        heading = film.heading[one.number] + one.rotation_deg
        assert wrap_deg(one.trajectory[:, 2] - heading) == pytest.approx(0, abs=1e-9)
        if one.decision.reason != "spot":  # each row leads as its fish swam, turned
            shown = [one] if before is None else [before, one]
            way, number, rotation_deg = (
                np.concatenate([getattr(part, name) for part in shown])[
                    -len(one.rotation_deg) - 1 :
                ]
                for name in ("trajectory", "number", "rotation_deg")
            )
            rows = zip(number[:-1], rotation_deg[:-1], strict=True)
            goes = [rotate(film.dx[row], film.dy[row], angle) for row, angle in rows]
            assert np.diff(way[:, :2], axis=0) == pytest.approx(np.array(goes), abs=1e-6)
        if before is not None:
            last, first = before.number[-1], one.number[0]
            assert one.begins_with_transition == (first != last + 1)
            assert (
                ((last + 1, first) in ends) if one.begins_with_transition else film.has_next[last]
            )
            assert mark_loop_ends(film)[last] or not one.begins_with_transition
            if pose == BODY:  # the heading goes on as if the film had played on
                turned = film.heading[last + 1] + before.rotation_deg[-1] - heading[0]
                assert wrap_deg(turned) == pytest.approx(0, abs=1e-6)
            jumps += one.begins_with_transition
        before = one
    assert jumps > (20 if choice == "jump" else 5)
    assert (pose == BODY) == bool(edit["rotation_deg"].any())
    assert set(edit["kind"]) == {FRAME} and set(edit["mode"]) == {"loops"}
    assert not edit["mirrored"].any() and edit["pose"].isna().all()
    assert edit["source"].max() < len(table) and set(picture_kinds(edit)) == {"film"}
    assert (edit["weight"] > 0).any()  # joins are cross-fades


@pytest.mark.parametrize("choice", ["play", "jump", "any"])
def test_the_choice_says_whether_the_film_plays_on_or_jumps_where_both_pass(choice):
    """Fig. 10b."""
    mode, rng = toy.loops_of(loop_end_choice=choice), np.random.default_rng(5)
    took = {True: 0, False: 0}
    film, ends = mode.film, np.flatnonzero(toy.loops_of().ends)
    for _ in range(300):
        fish = in_film(film, rng)._replace(row=int(rng.choice(ends)))
        goal = toy.spot(*toy.open_tank().random_point(rng))
        starts = mode.next_candidates(fish)
        ways = mode.roll_out(mode.next_place(fish), starts, goal)
        passes = ways.ticks > 0
        plays, jumps = passes & (starts.seams == 0), passes & (starts.seams > 0)
        taken = mode.next_stretch(fish, goal, rng)
        chosen = mode.choose_candidate(starts, ways, np.random.default_rng(0))
        assert passes[chosen] if passes.any() else chosen is None
        if passes.any():
            assert taken.number[0] in starts.rows[passes]
            assert choice == "any" or taken.number[0] == starts.rows[chosen]
            assert taken.begins_with_transition == (taken.decision.reason == "jump")
        if passes.any() and choice != "any":  # of several jumps the one that leads nearest
            mine = starts.rows == taken.number[0]
            assert (
                ways.far[mine].item()
                == ways.far[jumps if taken.begins_with_transition else plays].min()
            )
        if plays.any() and jumps.any():
            took[taken.begins_with_transition] += 1
        elif plays.any() or jumps.any():
            assert taken.begins_with_transition == jumps.any()
    assert (took[True] > 0, took[False] > 0) == (choice != "play", choice != "jump")
    assert sum(took.values()) > 50


@pytest.mark.parametrize("stay", [0.05, 4.0])
@pytest.mark.parametrize("choice", ["play", "jump"])
def test_after_a_jump_comes_at_least_so_much_film(stay, choice):
    """Even where a goal is touched soon, or a live fish is sent elsewhere."""
    player = player_in("loops", min_deltas_between_jumps=stay, loop_end_choice=choice)
    rng = np.random.default_rng(6)
    film, gaps, since = player.mode.film, [], None
    state = player.begin(rng)
    for _ in range(400):
        before = state
        stretch, state = player.plan(state, Goal("A", *toy.open_tank().random_point(rng)), rng)
        if rng.random() < 0.5:
            stretch, state = player.cut(before, stretch, int(rng.integers(1, 9)))
        if stretch.begins_with_transition:
            last = before.fish.row + 1
            plays_on = film.has_next[last] and film.recurrent[last + 1]
            if since is not None and plays_on and stretch.decision.reason != "spot":
                gaps.append(since)
            since = 0
        if since is not None:
            since += len(stretch.trajectory)
    assert min(gaps) >= max(1, round(stay * toy.DELTA)) and len(gaps) > 10


STRAIGHT_LOOPS = toy.loops((20, 95), (22, 120), (60, 160), (104, 165), (110, 185))


def straight_on():
    """A straight film in two tracks, with loops in the beginning and the end of each."""
    table = toy.table_of(toy.arc_track([0.0] * 99), toy.arc_track([0.0] * 99))
    return toy.film_of(table, STRAIGHT_LOOPS)


@pytest.mark.parametrize("row", [10, 60, 90, 92, 93, 110, 183])
def test_a_fish_no_way_of_which_stays_in_the_tank_keeps_its_place(row):
    mode, rng = toy.loops_of(straight_on()), np.random.default_rng(0)
    film, x = mode.film, float(np.flatnonzero(toy.open_tank().legal[300])[-1])
    fish = Fish(x, 300.0, 0.0, 2.0, IN_FILM, -1, row=row, since=100)
    ends = partners(STRAIGHT_LOOPS)
    for _ in range(20):
        found = mode.next_stretch(fish, toy.spot(100, 300), rng)
        assert found.decision.reason == "spot"
        assert found.decision.candidates_tank == found.decision.candidates
        assert (found.trajectory == [x, 300.0, 0.0]).all() and not found.touches_goal
        assert found.begins_with_transition == (found.number[0] != fish.row + 1)
        if found.begins_with_transition:
            assert (fish.row + 1, found.number[0]) in ends
        assert (np.diff(found.number) == 1).all() and film.has_next[found.number].all()
        fish = mode.end_state(fish, found)
        assert (fish.x, fish.y) == (x, 300.0)


@pytest.mark.parametrize("mode", ["loops", "matching"])
def test_a_dead_end_is_never_played_into(mode):
    film = toy.film_with_dead_ends()
    player = (
        toy.matching_of(toy.film_world_of(film))
        if mode == "matching"
        else toy.paper_player(toy.loops_of(film))
    )
    goes_on = film.can_play_on(np.arange(len(film.has_next) - 1))
    assert not goes_on.all()
    for seed in range(2):
        found, _ = toy.edit_of(player, [], 2000, seed)
        assert goes_on[np.concatenate([one.number for one in found.stretches])].all()
        assert sum(one.begins_with_transition for one in found.stretches) > 20


def test_a_film_whose_loops_lead_to_its_end_alone_is_not_played():
    assert (
        toy.loops_of().can_play
        and not toy.loops_of(toy.film_of(toy.rich_table(), toy.loops())).can_play
    )
    tail = toy.table_of(toy.arc_track([0.0] * 99), toy.arc_track([0.0] * 99))
    assert not toy.loops_of(toy.film_of(tail, toy.loops((20, 150)))).can_play


def three_ways():
    """Straight on to the right at y = 300; at row 20 circles to the left, to the right, or on."""
    table = toy.table_of(
        toy.arc_track([0.0] * 149), toy.arc_track([2.0] * 149), toy.arc_track([-2.0] * 149)
    )
    pairs = [(20, 170), (20, 320), (41, 201), (41, 351), (60, 231), (60, 381), (25, 225), (25, 375)]
    return toy.film_of(table, toy.loops(*pairs))


@pytest.mark.parametrize(
    ("goal", "quadrant_", "rows"),
    [((340, 150), 1, {20, 170}), ((500, 290), 1, {20, 170}), ((340, 450), 4, {320}),
     ((250, 150), 2, set()), ((250, 450), 3, set())],
)  # fmt: skip
def test_the_way_is_taken_that_leads_to_the_goal_s_quadrant(goal, quadrant_, rows):
    """No way leads back: what lies behind is of no quadrant that any loop end is in."""
    mode = toy.loops_of(three_ways(), loop_end_choice="any")
    fish = Fish(300.0, 300.0, 0.0, 2.0, IN_FILM, -1, row=19, since=100)
    draws = map(np.random.default_rng, range(30))
    found = [mode.next_stretch(fish, toy.spot(*goal), rng) for rng in draws]
    assert {int(one.number[0]) for one in found} == (rows or {20, 170, 320})
    for one in found:
        assert one.trajectory[0] == pytest.approx((300 + toy.STEP, 300, 0))
        assert one.begins_with_transition == (one.number[0] > 20)
        assert one.decision.candidates == 3 and one.decision.quadrant == (quadrant_ if rows else 0)
        assert one.decision.candidates_quadrant == 3 - len(rows)


# --- sprites as network mode plays them


@pytest.mark.parametrize("side", [LEFT, RIGHT])
@pytest.mark.parametrize("angle", [2, 20, 60, 120, 180])
def test_a_turn_is_done_step_by_step_to_the_end(side, angle):
    plan = plan_turn(toy.order().turns[side], angle, angle / 180, toy.DELTA, settings("network"))
    assert (np.diff(plan.share) > 0).all() and plan.share[0] > 0
    assert plan.share[-1] == 1
    sequence = toy.sprites().loc[plan.frames, "sequence"].unique()
    assert list(sequence) == ["left" if side == LEFT else "right"]
    assert plan.frames[0] == toy.sprites().index[toy.sprites()["sequence"] == sequence[0]][0]


def test_a_larger_area_bends_deeper_and_a_larger_angle_holds_longer():
    turn, p = toy.order().turns[LEFT], settings("network")
    areas = [plan_turn(turn, 60, area, toy.DELTA, p).area for area in (0.2, 0.5, 0.8, 1.0)]
    assert areas == sorted(areas) and areas[0] < areas[-1]
    deep = [plan_turn(turn, angle, 1.0, toy.DELTA, p) for angle in (90, 150, 180)]
    assert len(deep[0].frames) < len(deep[1].frames) <= len(deep[2].frames)


def test_frames_turn_by_what_they_turned_in_the_film():
    # All nine frames once: their own angles, in the shares of the film.
    plan = plan_turn(toy.order().turns[LEFT], 120, 1.0, toy.DELTA, settings("network"))
    table = toy.sprites()
    film_deg = table.loc[table["sequence"] == "left", "turn_deg"].to_numpy()
    assert plan.film_deg == pytest.approx(film_deg[:-1].sum())
    assert np.diff(plan.share) * 120 == pytest.approx(film_deg[:-1], abs=2.5)


# --- network


@pytest.fixture(scope="module")
def network():
    return player_in("network")


def test_figure18_turns_towards_a_goal_beside_and_swims_straight_to_one_ahead():
    mode, rng = toy.network_of(), np.random.default_rng(0)
    fish = mode.begin(rng)._replace(x=400.0, y=300.0, heading=0.0)
    for (x, y), reason, side in (
        ((700.0, 300.0), "phase", np.nan), ((400.0, 100.0), "turn", 90.0),
        ((400.0, 500.0), "turn", -90.0),
    ):  # fmt: skip
        found = mode.next_stretch(fish, toy.spot(x, y), rng)
        assert found.decision.reason == reason
        assert found.decision.turn_deg == pytest.approx(side, nan_ok=True)
        assert np.isnan(found.area) == (reason != "turn")  # only then the network is asked


class Recorder(toy.Model):
    """A model that keeps what it is asked, and answers some motion area."""

    def __init__(self, answer):
        self.answer, self.asked = answer, []

    def predict(self, inputs):
        self.asked.append(inputs.copy())
        return np.array([[self.answer, 0.0]])


@pytest.mark.parametrize("answer", [-0.5, 0.3, 2.0])
def test_a_turn_asks_the_network_for_what_eq_4_says_and_shows_its_area(answer):
    model, rng, sides = Recorder(answer), np.random.default_rng(1), set()
    mode, turns = toy.network_of(model=model), toy.lesson().turns
    fish, bent = mode.begin(rng), 0
    for _ in range(200):
        goal = toy.spot(*toy.open_tank().random_point(rng))
        found = mode.next_stretch(fish, goal, rng)
        if found.decision.reason != "turn":
            assert not model.asked and np.isnan(found.area)
        else:
            (((area, none, displacement, included),),) = model.asked
            assert area == fish.area and none == 0.0
            at = np.flatnonzero(turns.displacement == displacement)
            # The angle is that of the film's turn over Δ, or less where all of it is more.
            assert np.sign(included) == np.sign(found.decision.turn_deg)
            assert abs(included) <= turns.included_angle_deg[at].max() + 1e-9
            assert found.area == min(max(answer, 0.0), 1.0)
            sides.add(np.sign(included))
            bent += area > 0
        assert mode.ideal_motion_area(fish, 1.0, 30.0) == min(max(answer, 0.0), 1.0)
        model.asked.clear()
        cut = found.cut(int(rng.integers(1, 12)))
        fish = mode.end_state(fish, cut)
    assert sides == {-1, 1} and bent > 5


def test_a_turn_bends_as_far_as_the_network_says(network):
    _, table = toy.edit_of(network, [], 4000, 6)
    asked = table[table["motion_area"].notna() & table["reason"].notna()]
    assert (table["state"][table["motion_area"].notna()] == "turn").all()
    area, begins = (
        toy.sprites()["motion_area_rel"].to_numpy(),
        np.flatnonzero(table["reason"].notna()),
    )
    deepest = [
        area[table["source"].iloc[a:b].to_numpy()].max()
        for a, b in pairwise([*begins, len(table)]) if table["state"].iloc[a] == "turn"
    ]  # fmt: skip
    assert len(deepest) == len(asked)
    assert np.corrcoef(asked["motion_area"], deepest)[0, 1] > 0.8
    missed = np.median(np.abs(asked["motion_area"] - deepest))
    assert motion_area_errors(table)["turn_area_missed_median"] == pytest.approx(missed)


@pytest.mark.parametrize(
    ("mode", "pose"), [("network", BODY), ("hybrid", BODY), ("hybrid", FILM), ("matching", BODY)]
)
def test_goals_are_reached_in_the_open_tank_and_sprites_turn_towards_them_tick_by_tick(mode, pose):
    player, done = player_in(mode, pose), []
    for seed in range(2):
        goals = random_goals(player.world, 3, np.random.default_rng(seed))
        found, table = toy.edit_of(player, goals, 2000, seed)
        ticks = measures.arrival_ticks(table, goals, toy.TOUCH, toy.HEAD)
        done.append(~np.isnan(ticks))
        if mode == "hybrid":  # the way that touches a goal ends at a loop end
            assert (found.reached >= ticks).all()
        else:
            assert list(found.reached) == [-1 if np.isnan(tick) else tick for tick in ticks]
        assert mode != "network" or turn_measures(table)["turns_monotone_pct"] == 100
    assert np.mean(done) >= (0.8 if mode == "matching" else 1.0)


def test_when_the_goals_are_done_the_fish_wanders_on(network):
    _, table = toy.edit_of(network, A, 3000, 2)
    names = table["goal"].to_numpy()
    assert names[0] == "A" and names[-1] == ""
    wandering = table[names == ""]
    assert np.ptp(wandering["x_px"]) > 0.5 * np.ptp(np.flatnonzero(toy.open_tank().legal.any(0)))
    assert set(wandering["state"]) >= {STATES[state] for state in toy.phases().state} | {"turn"}


def with_phases(network, state, before):
    """The same mode, the phases of whose film are of these states, after these states."""
    n = len(network.phases.state)
    state, before = (np.resize(one, n).astype(np.int8) for one in (state, before))
    taught = replace(network.phases, state=state, before=before)
    return Network(network.world, network.sprites, taught, network.model, network.p)


def test_a_fish_is_in_all_states_of_the_film():
    every = with_phases(toy.network_of(), range(4), range(4, 0, -1))
    _, table = toy.edit_of(toy.paper_player(every), [], 2000, 2)
    assert set(table["state"]) == set(STATES[:5])
    share = table["state"].value_counts(normalize=True)
    assert share.min() > 0.02


def test_a_wandering_fish_swims_as_the_film_does(network):
    _, table = toy.edit_of(network, [], 10_000, 1)
    film = measures.motion_of_film(toy.lessons(), toy.lesson())
    far = measures.kinematic_distances(measures.motion_of_edit(table, network), film)
    assert far["speed_kinematic_distance_sd"] < 0.5
    assert far["turn_rate_kinematic_distance_sd"] < 0.5
    # Nothing jumps: no tick moves or, but in a turn, turns the fish more than the film does.
    moved = np.hypot(*np.diff(table[["x_px", "y_px"]].to_numpy(), axis=0).T)
    assert moved.max() <= toy.phases().high / toy.RATE * toy.LENGTH * np.sqrt(2) + 1e-6
    turned = np.abs(wrap_deg(np.diff(table["heading_deg"].to_numpy(float))))
    in_turn = (table["state"] == "turn").to_numpy()[1:]
    assert turned[~in_turn].max() <= np.abs(np.diff(toy.phases().drift_deg)).max() + 1


def test_a_way_leads_round_a_wall_to_the_goal_and_into_a_corner():
    arena = toy.ARENA.copy()
    arena[:380, 390:410] = False
    player = toy.paper_player(toy.network_of(toy.world_of(make_tank(arena, 0.6 * toy.LENGTH))))
    goals = [Goal("A", 200.0, 100.0), Goal("B", 600.0, 100.0), Goal("C", 38.0, 30.0)]
    _, found = toy.edit_of(player, goals, 2500, 3)
    assert not np.isnan(measures.arrival_ticks(found, goals, toy.TOUCH, toy.HEAD)).any()
    legal = player.world.tank.legal
    assert all(is_legal_point(legal, *at) for at in found[["x_px", "y_px"]].to_numpy())


# --- hybrid


def switches(table):
    """The ticks at which an edit list enters the film, and leaves it."""
    frame = (table["kind"] == FRAME).to_numpy().astype(int)
    return np.flatnonzero(np.diff(frame) > 0) + 1, np.flatnonzero(np.diff(frame) < 0) + 1


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_every_switch_goes_through_a_gateway_as_it_is_listed(pose):
    gates = posed_gateways(pose)
    listed = gates.set_index(["direction", "orientation", "sprite", "row"])["distance"]
    player = player_in("hybrid", pose)
    goals = random_goals(player.world, 40, np.random.default_rng(0))
    _, table = toy.edit_of(player, goals, 2500, 2)
    into, out = switches(table)
    assert len(into) > 5 and len(out) > 5 and abs(len(into) - len(out)) <= 1
    heading, number = table["heading_deg"].to_numpy(float), table["source"].to_numpy()
    sector = np.zeros(len(table), int)
    if pose == FILM:
        sector = find_orientations(heading, toy.ORIENTATIONS)
    for tick in into:
        gate = "in", sector[tick - 1], number[tick - 1], number[tick]
        assert table["seam"][tick] == pytest.approx(listed[gate])  # steps of a film whose own is 1
        assert table["reason"][tick] == "enter" and table["exit"].isna()[tick]
    for tick in out:
        assert table["exit"][tick] == "no_way" and table["reason"][tick] == "phase"
        ways = gates[(gates["direction"] == "out") & (gates["row"] == number[tick - 1])]
        mine = ways[ways["sprite"] == number[tick]]
        assert len(mine) and table["seam"][tick] == pytest.approx(mine["distance"].item())
        assert mine["rank"].item() == ways["rank"].min()  # the nearest
        if pose == FILM:
            assert mine["orientation"].item() == sector[tick]
        names = ("candidates", "candidates_tank", "candidates_quadrant", "candidates_heading")
        every, *failed = (table[name][tick] for name in names)
        assert every == sum(failed)  # no way on is legal
    turned = np.abs(wrap_deg(heading[[*into, *out]] - heading[[*into - 1, *out - 1]]))
    assert turned.max() <= (7.01 if pose == BODY else 7.5 + 7.01)
    assert set(table["mode"][table["kind"] == FRAME]) == {"loops"}
    assert set(table["mode"][table["kind"] == SPRITE]) == {"network"}
    numbers = picture_kind_shares(table)
    assert numbers["switches"] == len(into) + len(out)
    assert numbers["switches_without_gateway"] == 0
    assert 30 < numbers["film_pct"] < 100


@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_after_the_sprite_of_a_gateway_comes_the_next_one_at_any_speed(speed):
    """After the film always comes a tail beat; the only way out leads to its fourth sprite."""
    gates = toy.gateways(every=1).query("direction == 'in' or sprite == 3")
    mode, rng = toy.hybrid_of(gates=gates), np.random.default_rng(0)
    network, film = with_phases(mode.network, [ACCELERATE], [STRAIGHT]), mode.loops.film
    for _ in range(40):
        fast = network.sprites.cycle_speed * speed
        fish = in_film(film, rng)._replace(x=400.0, y=300.0, speed=fast)
        starts = mode.loops.next_candidates(fish)
        angle = np.radians(fish.heading)
        goal = toy.spot(fish.x + 150 * np.cos(angle), fish.y - 150 * np.sin(angle))
        ways = mode.loops.roll_out(mode.loops.next_place(fish), starts, goal)
        left = mode.leave_film(fish, ways, goal)
        assert (
            list(left.number) == [3]
            and left.begins_with_transition
            and left.decision.exit == "no_way"
        )
        there = mode.end_state(fish, left)
        assert (there.row, there.sprite, there.since) == (-1, 3, 1)
        then = network.next_stretch(there, goal, rng)
        assert then.number[0] == 4 and not then.begins_with_transition


def test_a_gateway_is_entered_as_soon_as_a_way_from_there_is_legal():
    mode, rng, entered = toy.hybrid_of(), np.random.default_rng(2), 0
    fish = mode.begin(rng)
    for _ in range(400):
        goal = toy.spot(*toy.open_tank().random_point(rng))
        found = mode.next_stretch(fish, goal, rng)
        starts = mode.rows_behind_gateways(fish) if fish.row < 0 else None
        if starts is not None:
            ways = mode.loops.roll_out(mode.loops.next_place(fish), starts, goal)
            if found.kind == SPRITE:  # a way may end where there is a way out alone
                left = fish.since == 1  # the film, a tick ago
                assert left or not (ways.ticks > 0).any() or not mode.enter_film(fish, goal)
            else:
                assert found.number[0] in starts.rows and found.decision.reason == "enter"
                entered += 1
        fish = mode.end_state(fish, found)
    assert entered > 5


def test_hybrid_without_loops_or_gateways_is_network_mode(network):
    goals = [Goal("A", 200.0, 200.0), Goal("B", 600.0, 500.0)]
    _, wanted = toy.edit_of(network, goals, 1200, 3)
    none = toy.gateways().iloc[:0]
    for film, gates in (
        (toy.rich_film(), none),
        (toy.film_of(toy.rich_table(), toy.loops()), toy.gateways()),
    ):
        _, mine = toy.edit_of(toy.paper_player(toy.hybrid_of(film, gates=gates)), goals, 1200, 3)
        pd.testing.assert_frame_equal(mine, wanted)


def test_gateways_that_lead_nowhere_are_not_taken():
    """Film that ends, and film from which no gateway leads."""
    last, leads_in = (
        np.flatnonzero(~toy.rich_film().has_next),
        toy.gateways().query("direction == 'in'"),
    )
    for gates in (leads_in.iloc[: len(last)].assign(row=last), leads_in):
        _, table = toy.edit_of(toy.paper_player(toy.hybrid_of(gates=gates)), [], 600, 1)
        assert (table["kind"] == SPRITE).all()


def test_a_sprite_has_an_orientation_and_a_frame_has_none():
    _, table = toy.edit_of(player_in("hybrid"), A, 1500, 2)
    for kind, name in (("kind", "orientation"), ("partner_kind", "partner_orientation")):
        assert table[kind].isin([FRAME]).any() and table[kind].isin([SPRITE]).any()
        assert (table[name].notna() == (table[kind] == SPRITE)).all()
        assert table[name].dropna().between(1, toy.ORIENTATIONS).all()


@pytest.mark.parametrize(
    ("mode", "ticks"), [*((m, None) for m in ONE_FISH), *product(["matching"], [0, 3])]
)
def test_a_cross_fade_begins_at_every_jump_and_switch_and_the_old_plays_on(mode, ticks):
    changes = {}
    if mode == "matching":
        changes = {"search_step_deltas": 2.0, "cross_fade_deltas": ticks / toy.DELTA, "join": FADE}
    player = player_in(mode, **changes)
    found, table = toy.edit_of(player, A, 1500, 2)
    fade = player.join_rules.fade if ticks is None else ticks
    film = toy.rich_film()
    assert ticks is not None or fade == round(settings("animate").cross_fade_deltas * toy.DELTA) > 1
    number, kind = table["source"].to_numpy(), table["kind"].to_numpy()
    rotation, weight = table["rotation_deg"].to_numpy(float), table["weight"].to_numpy(float)
    starts = np.cumsum([0, *(len(one.trajectory) for one in found.stretches)])
    begins = [
        tick
        for tick, one in zip(starts, found.stretches, strict=False)
        if one.begins_with_transition
    ]
    begins = np.array([tick for tick in begins if 0 < tick < 1500])
    assert set(np.concatenate(switches(table))) <= set(begins) and len(begins) > 10
    if mode == "matching":
        jumped = np.flatnonzero((np.diff(number) != 1) & (np.diff(number) != 0)) + 1
        assert set(jumped) <= set(begins) and len(jumped) > 10
    fades = np.zeros(1500)
    for begin in begins:  # a later one begins anew
        stop = min(begin + fade, 1500)
        fades[begin:stop] = (1 - np.arange(1, fade + 1) / (fade + 1))[: stop - begin]
    assert weight == pytest.approx(fades)
    assert (table["partner"].notna() == (weight > 0)).all()
    for begin, later in pairwise(begins):
        old = number[begin - 1]
        for tick in range(begin, min(begin + fade, later)):
            goes_on = kind[begin - 1] == FRAME
            old = old + int(film.has_next[old]) if goes_on else toy.order().following[old]
            row = table.iloc[tick]
            assert (row["partner_kind"], row["partner"]) == (kind[begin - 1], old)
            if goes_on:
                turned = row["partner_rotation_deg"] - rotation[begin - 1]
                assert wrap_deg(turned) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("mode", ["hybrid", "matching"])
def test_wandering_uses_much_of_the_tank_and_of_the_film(mode):
    _, table = toy.edit_of(player_in(mode), [], 3000, 5)
    assert np.ptp(table["x_px"]) > 250 and np.ptp(table["y_px"]) > 250
    assert table["source"][table["kind"] == FRAME].nunique() > 300
    assert longest_repeat(table) < 500
