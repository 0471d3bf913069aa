"""The live tank: it is the engine of `animate`, cut where a wish comes, with a past to look at."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from tiny_run import stage_run
from toy_film import (
    ARENA,
    LENGTH,
    RATE,
    STEP,
    TOUCH,
    film_world_of,
    matching_of,
    open_tank,
    phases,
    spot,
)
from toy_tank import played_rows, read, resting_players, tick_on_screen, toy_players, view_of

from finloop.animate import kinematics as step
from finloop.animate.arena import is_legal_point
from finloop.animate.arena import make_tank as arena_tank
from finloop.animate.obstacles import Plans
from finloop.animate.shoal import animate_fish
from finloop.base.errors import FinloopError
from finloop.edit.build import build_edit_list
from finloop.edit.modes import MODES, ONE_FISH
from finloop.edit.schema import FRAME, PATH, SPRITE, TERMS, TURN
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.table import wrap_deg
from finloop.live import fish as play_fish
from finloop.live.fish import ROW
from finloop.live.message import MOST_FISH, parse_message
from finloop.live.tank import LiveTank, warm_up_paths
from finloop.modes.sprites import start_from_bend
from finloop.show.drawn import PARTNER, PICTURE, X, Y
from stages.play import open_view


def steps(rows):
    return np.hypot(np.diff(rows["x_px"]), np.diff(rows["y_px"]))


def fast():
    """The longest step of a fish that does not jump, px."""
    return 1.6 * max(phases().high * LENGTH / RATE, STEP)


def say(view, **wish):
    view.handle_request(parse_message(json.dumps(wish)))


# --- the same engine


@pytest.mark.parametrize("rest", [0.0, 0.8])
@pytest.mark.parametrize("mode", MODES)
def test_left_alone_it_is_the_edit_list_of_animate(mode, rest):
    ticks, players = 240, resting_players(rest)
    found = animate_fish(players[mode], [], ticks, np.random.default_rng([7, 0]))
    wanted = build_edit_list(found, ticks, players[mode].edit_inputs)
    tank = LiveTank(players, mode, 1, 7)
    first = np.array([tank.fish[0].row_at(0)[:-1]], ROW)
    rows = pd.DataFrame(np.append(first, played_rows(tank, ticks - 1)))
    faded = (wanted["weight"] > 0).to_numpy()
    assert faded.any() and not faded.all()
    for name in set(wanted.columns) & set(ROW.names):
        here = faded if name.startswith("partner") else slice(None)
        column = wanted[name].fillna(0) if name.endswith("orientation") else wanted[name]
        a, b = column.to_numpy()[here], rows[name].to_numpy()[here]
        if name in ("kind", "partner_kind", "mode", "state", "goal"):
            assert (a == b).all(), name
        else:
            assert a.astype(float) == pytest.approx(b.astype(float), abs=1e-4), name
    for tick, pose in enumerate(wanted["pose"]):
        assert np.array_equal(pose, tank.fish[0].row_at(tick).pose)


@pytest.mark.parametrize("mode", MODES)
def test_a_goal_counts_from_the_next_tick_on_and_nothing_jumps(mode):
    tank, rng = LiveTank(toy_players(), mode, 1, 3), np.random.default_rng(2)
    for _ in range(8):
        before = played_rows(tank, int(rng.integers(2, 30)))
        past = [tank.fish[0].row_at(tick) for tick in range(max(0, tank.tick - 50), tank.tick)]
        asked = tank.tick
        tank.send_to_goal(None, *rng.uniform((40, 30), (760, 570)))
        rows = np.append(before, played_rows(tank, 5)).view(ROW)
        choice = tank.fish[0].decision_at(asked + 1)
        assert choice.tick == asked + 1
        assert (rows["goal"][len(before)] == "A") and not math.isnan(rows["goal_x_px"][-1])
        now = [tank.fish[0].row_at(tick) for tick in range(max(0, asked - 50), asked)]
        assert repr(past) == repr(now)
        assert steps(rows).max() <= fast()
        assert all(is_legal_point(open_tank().legal, row["x_px"], row["y_px"]) for row in rows)


@pytest.mark.parametrize("mode", ["network", "hybrid", "matching"])
@pytest.mark.parametrize("drag", [False, True])
def test_the_fish_gets_there_even_while_its_goal_is_dragged(mode, drag):
    rng, took = np.random.default_rng(4), []
    for seed in range(2):
        tank = LiveTank(toy_players(), mode, 1, seed)
        x, y = rng.uniform((80, 70), (720, 530))
        for tick in range(600):
            if tick == 0 or (drag and tick < 400):
                tank.send_to_goal(0, x + (tick % 3) * 0.1, y, drag=tick > 0)
            tank.advance()
            if tank.fish[0].reached:
                break
        took.append(tick)
        row = tank.fish[0].row_at(tank.tick)
        goal = spot(row.goal_x_px, row.goal_y_px, TOUCH + 0.1)
        # A way of loops that touches the goal ends at the next loop end.
        last = [tank.fish[0].row_at(tick) for tick in range(row.decided, tank.tick + 1)]
        assert any(step.touches_target(one.x_px, one.y_px, one.heading_deg, goal) for one in last)
    assert max(took) < 599  # reached before the time is over


def test_a_goal_beyond_the_wall_is_put_where_a_fish_can_touch_it():
    tank = LiveTank(toy_players(), "network", 1, 0)
    tank.send_to_goal(0, -50.0, 900.0)
    goal = tank.fish[0].goal
    assert open_tank().nearest_legal_point(goal.x_px, goal.y_px) == (goal.x_px, goal.y_px)
    tank.send_to_goal(0, 400.0, 300.0)
    assert tank.fish[0].goal[1:3] == (400.0, 300.0)


@pytest.mark.parametrize("mode", MODES)
def test_while_a_goal_is_dragged_a_stretch_is_swum_for_a_moment(mode):
    tank, decided = LiveTank(toy_players(), mode, 1, 3), []
    tank.advance()
    for tick in range(60):
        tank.send_to_goal(0, 400.0 + 3 * tick, 300.0, drag=tick > 0)
        tank.advance()
        decided.append(int(tank.fish[0].row_at(tank.tick).decided))
    assert decided[0] == 2  # the first click counts at once
    apart = np.diff(sorted(set(decided)))
    assert 1 < np.median(apart) <= 3 and len(apart) > 15


# --- a turn that was cut


def test_a_bent_fish_goes_on_from_its_bend():
    network = toy_players()["network"].mode
    turns, plan_of = network.sprites.turns, network.cached_turn
    plan = plan_of(LEFT, 100, 90)
    for at, sprite in enumerate(plan.frames[:-1]):
        on = start_from_bend(plan, turns, LEFT, sprite)
        first = int(np.flatnonzero(plan.frames == sprite)[0])
        assert list(on.frames) == list(plan.frames[first + 1 :]), at
        assert on.share[-1] == 1 and (np.diff(on.share, prepend=0) > 0).all()
        other = start_from_bend(plan_of(RIGHT, 100, 90), turns, RIGHT, sprite)
        undone = turns[LEFT].straightening_sprites(sprite)[::2]
        assert list(other.frames[: len(undone)]) == list(undone)
        assert (np.diff(other.share, prepend=0) > 0).all() and other.share[-1] == 1
    shallow = plan_of(LEFT, 10, 5)
    deep = turns[LEFT].number[turns[LEFT].peak]
    assert deep not in shallow.frames
    unbent = list(turns[LEFT].straightening_sprites(deep))
    assert list(start_from_bend(shallow, turns, LEFT, deep).frames) == unbent
    assert start_from_bend(plan, turns, LEFT, int(network.sprites.cycles[0][0])) is plan


def test_a_fish_that_is_stopped_in_a_turn_is_bent_and_only_then():
    player, rng, bent = toy_players()["network"], np.random.default_rng(5), 0
    state = player.begin(rng)
    for _ in range(200):
        stretch, then = player.plan(state, None, rng)
        assert not then.fish.is_bent
        if stretch.state == TURN and len(stretch.trajectory) > 4:
            assert player.cut(state, stretch, 4)[1].fish.is_bent
            bent += 1
        state = then
    assert bent > 10


# --- modes


EACH_TO_EACH = ("loops", "network", "hybrid", "loops", "matching", "network", "matching", "hybrid",
                "network", "loops", "hybrid", "matching", "loops")  # fmt: skip


def test_modes_are_changed_from_each_to_each_while_it_swims():
    tank = LiveTank(toy_players(), "hybrid", 1, 1)
    kinds = {"network": {SPRITE}, "loops": {FRAME}, "matching": {FRAME}, "hybrid": {SPRITE, FRAME}}
    before = played_rows(tank, 60)[-1:]
    for mode in EACH_TO_EACH:
        tank.switch_mode(mode)
        rows = np.append(before, played_rows(tank, 90)).view(ROW)
        before = rows[-1:]
        assert set(rows["kind"][1:]) <= kinds[mode]  # from the next tick on
        own = {mode} if mode != "hybrid" else {"network", "loops"}
        assert set(rows["mode"][1:]) <= own
        assert steps(rows).max() <= fast()
        tank.switch_mode(mode)  # it is in that mode already: nothing is cut
        decided = tank.fish[0].row_at(tank.tick).decided
        tank.advance()
        assert tank.fish[0].row_at(tank.tick).decided in (decided, tank.tick)
        before = np.array([tank.fish[0].row_at(tank.tick)[:-1]], ROW)


@pytest.mark.parametrize("mode", ONE_FISH)
def test_a_mode_of_the_paper_drops_the_plan_of_matching(mode):
    """It moves the fish to where that plan does not begin, if only for a tick."""
    players, rng = toy_players(), np.random.default_rng(3)
    state = players["matching"].begin(rng)
    while not state.progress.runs:
        _, state = players["matching"].plan(state, None, rng)
    stretch, later = players[mode].plan(state, None, rng)
    _, cut = players[mode].cut(state, stretch, 1)
    assert later.progress.runs == cut.progress.runs == ()


def test_where_a_mode_takes_over_pictures_are_joined_and_it_can_be_gone_back_to():
    tank = LiveTank(toy_players(), "loops", 1, 1)
    for mode in ("network", "loops", "network", "matching"):
        played_rows(tank, 40)
        tank.switch_mode(mode)
        then = tank.tick
        rows = played_rows(tank, 60)
        assert rows["weight"][0] > 0 or mode == "matching"  # which is inertialized
        for tick in (then + 1, then + 20):
            tank.go_back_to(tick)
            assert tank.mode == mode
            assert repr(played_rows(tank, 60 + then - tick)) == repr(rows[tick - then :])


def test_a_mode_that_the_film_does_not_allow_is_refused():
    few = {mode: toy_players()[mode] for mode in ("network", "hybrid")}
    with pytest.raises(FinloopError, match="no mode loops"):
        LiveTank(few, "loops", 1, 0)
    tank = LiveTank(few, "hybrid", 1, 0)
    tank.switch_mode("loops")
    played_rows(tank, 50)
    assert tank.mode == "hybrid" and "too little" in tank.explain_unavailable_mode("loops")


def test_a_mode_of_the_paper_moves_one_fish_to_goals():
    tank = LiveTank(toy_players(), "matching", 2, 1)
    for mode in ONE_FISH:
        with pytest.raises(FinloopError, match=f"mode {mode} cannot do 2 fish"):
            tank.switch_mode(mode)
        assert "one fish" in tank.explain_unavailable_mode(mode)
        with pytest.raises(FinloopError, match="2 fish"):
            LiveTank(toy_players(), mode, 2, 1)
    assert tank.mode == "matching" and len(tank.fish) == 2
    tank.set_fish_count(1)
    tank.follow_path(0, circle(140))
    tank.switch_mode("hybrid")
    assert tank.fish[0].path_task is None  # nobody swims a path in this mode
    for wish in (lambda: tank.follow_path(0, circle(140)), lambda: tank.swim_in_group(0),
                 lambda: tank.follow_leader(None, 0), lambda: tank.set_fish_count(2)):  # fmt: skip
        with pytest.raises(FinloopError, match="mode hybrid cannot do") as refused:
            wish()
        assert "matching" in refused.value.do
    played_rows(tank, 20)
    tank.send_to_goal(0, 300.0, 200.0)
    assert tank.fish[0].goal is not None


def test_the_view_tells_every_mode_and_why_one_cannot_be_had():
    view = view_of("matching", fish=2)
    told = {one["name"]: one for one in view.describe_tick(0)["modes"]}
    assert list(told) == list(MODES)
    assert [name for name, one in told.items() if one["lack"]] == [*ONE_FISH]
    assert all(told[name]["title"] == facts.title for name, facts in MODES.items())
    say(view, do="mode", mode="loops")
    assert "one fish" in view.refused or "2 fish" in view.refused
    say(view, do="count", fish=1)
    say(view, do="mode", mode="loops")
    state = view.describe_tick(0)
    assert (state["mode"], state["most"], view.refused) == ("loops", 1, "")
    assert not any(one["lack"] for one in state["modes"])


a_run = stage_run("animate")


def test_the_tank_of_a_run_has_all_modes_and_draws_every_change(a_run, monkeypatch):
    """There every mode has a reel of its own, with sprites or without."""
    monkeypatch.chdir(a_run)
    with open_view("hybrid", None, 0) as view:
        for mode in EACH_TO_EACH:
            say(view, do="mode", mode=mode)
            for _ in range(12):
                view.advance()
                state, _ = tick_on_screen(view)
            assert (state["mode"], state["refused"]) == (mode, "")
    with pytest.raises(FinloopError, match="mode loops cannot do 3 fish"):
        with open_view("loops", 3, 0):
            pass
    with open_view("matching", 3, 0) as view:
        assert len(tick_on_screen(view)[0]["fish"]) == 3


# --- the past


def test_the_past_is_kept_as_it_was_and_no_longer_than_said(monkeypatch):
    monkeypatch.setattr(play_fish, "HISTORY", 60)
    tank = LiveTank(toy_players(), "hybrid", 1, 2)
    rows = played_rows(tank, 400)
    fish = tank.fish[0]
    assert tank.oldest_tick == tank.tick - 59
    for back in range(60):
        assert repr(tuple(fish.row_at(tank.tick - back)[:-1])) == repr(rows[-1 - back].item())
        choice = fish.decision_at(tank.tick - back)
        assert choice.tick <= tank.tick - back
    assert fish.row_at(tank.oldest_tick - 1) is None and fish.row_at(tank.tick + 1) is None
    assert fish.decision_at(tank.oldest_tick - 1) is None
    oldest = tank.oldest_tick
    tank.go_back_to(3)  # no further back than is known
    assert tank.tick == oldest and repr(tuple(fish.row_at(oldest)[:-1])) == repr(rows[-60].item())
    played_rows(tank, 100)


def test_what_was_weighed_is_told_with_its_costs():
    tank = LiveTank(toy_players(), "matching", 1, 2)
    tank.send_to_goal(0, 700.0, 100.0)
    seen = set()
    for _ in range(600):
        tank.advance()
        choice = tank.fish[0].decision_at(tank.tick)
        row, options = tank.fish[0].row_at(tank.tick), choice.stretch.options
        if options is None:
            continue
        if row.kind == FRAME:
            assert choice.tick == row.decided and options.taken >= 0
        finite, chance = np.isfinite(options.costs), options.terms[:, TERMS.index("chance")]
        assert options.costs[finite] == pytest.approx((options.terms.sum(1) - chance)[finite])
        assert (options.terms[finite, TERMS.index("time")] > 0).all()
        if options.taken >= 0:
            seen.add(bool(options.seams[options.taken] > 0))
    assert seen == {True, False}  # jumps, and played on


# --- swimming on from a tick that has been


@pytest.mark.parametrize("mode", MODES)
def test_left_alone_it_swims_on_from_the_past_as_it_did(mode):
    many = 1 if mode in ONE_FISH else 2
    tank = LiveTank(toy_players(), mode, many, 4, lambda row: row.weight < 0.5)
    played_rows(tank, 40)
    tank.send_to_goal(None, 600.0, 400.0)
    first = [played_rows(tank, 1, fish=0) for _ in range(160)]
    second = [tank.fish[-1].row_at(tick) for tick in range(tank.tick + 1)]
    for tick in (197, 90, 41, 44):
        tank.go_back_to(tick)
        assert tank.tick == tick and tank.mode == mode
        again = played_rows(tank, 160 + 40 - tick)
        assert repr(np.concatenate(first)[tick - 40 :]) == repr(again)
        assert repr([tank.fish[-1].row_at(t) for t in range(tank.tick + 1)]) == repr(second)


def test_from_the_past_it_can_be_sent_elsewhere():
    tank = LiveTank(toy_players(), "hybrid", 1, 4)
    tank.send_to_goal(0, 100.0, 100.0)
    rows = played_rows(tank, 120)
    tank.switch_mode("network")
    played_rows(tank, 30)
    tank.let_wander(0)
    played_rows(tank, 30)
    tank.go_back_to(60)
    fish = tank.fish[0]
    assert tank.mode == fish.mode == "hybrid"  # as it was then
    assert fish.goal is not None or rows["reached"][59]
    tank.send_to_goal(0, 700.0, 500.0)
    later = played_rows(tank, 100)
    assert fish.decision_at(61).goal.x_px == 700.0 and fish.row_at(181) is None
    assert repr(rows[:60]) == repr(np.array([fish.row_at(t)[:-1] for t in range(1, 61)], ROW))
    whole = np.concatenate([rows[:60], later])
    assert steps(whole).max() <= fast()


def test_a_goal_that_was_being_dragged_then_is_swum_to():
    tank = LiveTank(toy_players(), "hybrid", 1, 3)
    played_rows(tank, 20)
    for move in range(20):
        tank.send_to_goal(0, 300.0 + 10 * move, 300.0, drag=move > 0)
        tank.advance()
    tank.go_back_to(33)
    first = tank.fish[0].goal
    assert first.x_px == 300.0 + 10 * 12
    played_rows(tank, 3)
    assert tank.fish[0].decision_at(tank.tick).goal == first


@pytest.mark.parametrize(("mode", "fish"), [("hybrid", 1), ("matching", 3)])
def test_a_future_that_was_left_goes_on_as_if_it_had_not_been(mode, fish):
    tank, left_alone = (LiveTank(toy_players(), mode, fish, 4) for _ in range(2))
    for one in (tank, left_alone):
        one.send_to_goal(0, 600.0, 450.0)
        played_rows(one, 90)
    before = [tank.fish[0].row_at(tick)[:-1] for tick in range(1, 91)]
    tank.branch_from(30)
    assert tank.tick == 30 and [future[:2] for future in tank.futures] == [(30, 90)]
    tank.send_to_goal(0, 100.0, 100.0)
    other = played_rows(tank, 40)
    tank.return_to(0)
    assert tank.tick == 90 and [future[:2] for future in tank.futures] == [(30, 70)]
    after = [tank.fish[0].row_at(tick)[:-1] for tick in range(1, 91)]
    assert repr(after) == repr(before)
    for number in range(fish):
        rows = [played_rows(one, 30, number) for one in (tank, left_alone)]
        assert rows[0].tobytes() == rows[1].tobytes()
    tank.return_to(0)  # and back once more
    again = [tank.fish[0].row_at(tick)[:-1] for tick in range(31, 71)]
    assert np.array(again, ROW).tobytes() == other.tobytes()
    tank.return_to(5)  # there is none
    tank.branch_from(tank.tick)  # nothing came after it
    assert len(tank.futures) == 1
    for _ in range(6):
        tank.branch_from(tank.tick - 1)
    assert len(tank.futures) == 3


def test_the_past_is_played_and_leads_to_the_present():
    view = view_of()
    view.advance(60)
    say(view, do="look", tick=20)
    say(view, do="pause", on=False)
    assert view.is_running and view.shown_tick == 20
    view.advance(7)
    assert (view.shown_tick, view.tank.tick) == (27, 60)
    say(view, do="pause", on=True)
    assert not view.is_running and view.shown_tick == 27
    say(view, do="pause", on=False)
    view.advance(40)
    assert view.past_tick is None and view.is_running and view.tank.tick == 60
    view.advance()
    assert view.tank.tick == 61


def test_what_happened_is_told_with_its_ticks():
    view = view_of("hybrid")
    view.advance(10)
    say(view, do="goal", fish=0, x=600, y=400, drag=False)
    view.advance(20)
    say(view, do="mode", mode="matching")
    view.advance(120)
    events = view.describe_tick(view.shown_tick)["events"]
    assert events[0] == (0, "hybrid") and [tick for tick, _ in events] == sorted(
        tick for tick, _ in events
    )
    assert [tick for tick, what in events if what == "goal"] == [11]
    assert [tick for tick, what in events if what == "matching"] == [31]
    fish = view.tank.fish[0]
    jumps = [tick for tick, what in events if what == "jump"]
    assert jumps and all(fish.row_at(tick).state for tick in jumps)


def test_a_fish_that_was_not_there_yet_is_gone_and_the_page_swims_on():
    view = view_of(fish=1)
    view.advance(30)
    say(view, do="count", fish=3)
    say(view, do="explain", fish=2)
    view.advance(30)
    say(view, do="pause", on=True)
    say(view, do="look", tick=20)
    say(view, do="branch", tick=20)
    state, _ = tick_on_screen(view)
    assert (state["now"], state["tick"], len(state["fish"])) == (20, 20, 1)
    assert view.is_running and not state["past"] and view.explained == 0
    say(view, do="branch", tick=900)  # it has not been: stay
    assert view.tank.tick == 20


def test_ghosts_are_not_drawn_and_do_not_come_back():
    def rows(ghost):
        tank = LiveTank(toy_players(), "hybrid", 1, 5, ghost)
        return played_rows(tank, 300)["weight"]

    usual = rows(lambda row: False)
    assert (usual > 0).any()
    assert not rows(lambda row: True).any()
    first = rows(lambda row: row.weight > 0.6)  # only the first tick of a cross-fade is unlike
    assert first.sum() < usual.sum() and not first[(usual > 0)].all()
    begins = np.flatnonzero(usual > 0.6)
    assert not any(first[tick + 1] for tick in begins if 0 < usual[tick + 1] < usual[tick])


# --- along a path that is drawn


def circle(radius, count=80):
    angle = np.linspace(0, 2 * np.pi, count)
    return [(400 + radius * np.cos(a), 300 + radius * np.sin(a)) for a in angle]


def path_log(tank, ticks):
    """What of a fish's path had been begun, and where it was, tick by tick."""
    log = []
    for _ in range(ticks):
        tank.advance()
        fish = tank.fish[0]
        row, path_task = fish.row_at(tank.tick), fish.path_task
        log.append((path_task is not None and path_task.begun, row.x_px - 400, row.y_px - 300))
    begun, x, y = np.array(log).T
    return begun.astype(bool), x, y


def test_it_swims_to_where_a_path_begins_and_then_along_it():
    tank = LiveTank(toy_players(), "matching", 1, 3)
    tank.advance()
    tank.follow_path(0, circle(140))
    begun, x, y = path_log(tank, 900)
    first = int(np.argmax(begun))
    assert begun[first:].all() and not begun[:first].any()  # closed: again and again
    off = np.hypot(x, y)[first + 100 :] - 140  # it comes from afar, at any angle
    assert np.sqrt((off**2).mean()) < 0.15 * LENGTH
    laps = np.diff(np.unwrap(np.arctan2(y, x)[first:])).sum() / (2 * np.pi)
    assert laps > 1.5
    assert tank.fish[0].row_at(tank.tick).goal == PATH
    ticks = range(first + 5, tank.tick)
    weighed = [tank.fish[0].decision_at(tick).stretch.options for tick in ticks]
    weighed = [one for one in weighed if one is not None]
    jumps = [one.terms[(one.seams > 0) & np.isfinite(one.costs), 0] for one in weighed]
    assert (np.concatenate(jumps) > 0).all()
    assert any((one.terms[:, TERMS.index("path")] > 0).any() for one in weighed)


def test_an_open_path_ends_and_is_given_up_for_a_goal():
    tank = LiveTank(toy_players(), "matching", 1, 3)
    half = circle(140)[:40]
    tank.follow_path(None, half)
    begun, x, y = path_log(tank, 600)
    last = np.flatnonzero(begun)[-1]
    assert np.hypot(x[last] + 140, y[last]) < LENGTH  # where the half circle ends
    assert tank.fish[0].path_task is None and tank.fish[0].reached
    tank.follow_path(0, half)
    assert tank.fish[0].goal[1:3] == pytest.approx(half[0], abs=0.1 * LENGTH)
    tank.send_to_goal(0, 100.0, 100.0)
    assert tank.fish[0].path_task is None and tank.fish[0].goal.x_px == 100.0
    tank.follow_path(0, half)
    tank.let_wander(0)
    assert tank.fish[0].path_task is None and tank.fish[0].goal is None


def test_a_path_no_longer_than_a_goal_is_one_and_none_leads_out_of_the_tank():
    tank = LiveTank(toy_players(), "matching", 1, 0)
    tank.follow_path(0, [(400.0, 300.0), (401.0, 300.0)])
    assert tank.fish[0].path_task is None and tank.fish[0].goal[1:3] == (401.0, 300.0)
    tank.follow_path(0, [(-500.0, 300.0), (400.0, 300.0), (5000.0, 9000.0)])
    route = tank.fish[0].path_task.route
    places = zip(route.x, route.y, strict=True)
    assert all(is_legal_point(open_tank().legal, *place) for place in places)


def test_a_tank_with_room_for_no_path_is_opened_all_the_same():
    side = round(1.2 * LENGTH) + 6
    room = arena_tank(np.ones((side, side), bool), 0.6 * LENGTH)
    player = matching_of(film_world_of(room_=room))
    warm_up_paths(player)
    tank = LiveTank({"matching": player}, "matching", 1, 0)
    tank.follow_path(0, [(5.0, 5.0), (side - 5.0, side - 5.0)])
    assert tank.fish[0].path_task is None and tank.fish[0].goal is not None


def test_along_a_path_too_it_swims_on_from_the_past_as_it_did():
    tank = LiveTank(toy_players(), "matching", 1, 4)
    tank.follow_path(0, circle(140))
    rows = played_rows(tank, 300)
    begun = [tank.fish[0].request_at(tick).path_task.begun for tick in range(1, 301)]
    assert begun[-1] and not begun[0]
    for tick in (290, begun.index(True) + 1, 40):
        tank.go_back_to(tick)
        assert repr(played_rows(tank, 300 - tick)) == repr(rows[tick:])


# --- fish come and go; the view


def test_fish_come_and_go():
    view = view_of(fish=3)
    view.advance(5)
    say(view, do="count", fish=8)
    view.advance(5)
    state, _ = tick_on_screen(view)
    assert len(state["fish"]) == 8 and all(state["fish"])
    say(view, do="look", tick=3)
    state, _ = tick_on_screen(view)
    assert [fish is not None for fish in state["fish"]] == [True] * 3 + [False] * 5
    say(view, do="explain", fish=7)
    say(view, do="count", fish=1)
    assert view.explained == 0 and len(view.tank.fish) == 1
    say(view, do="goal", fish=5, x=1, y=1, drag=False)  # not there: let be
    tick_on_screen(view)


@pytest.mark.parametrize("colour", [False, True])
def test_pages_are_told_what_is_there_and_where_the_fish_are(colour):
    view = view_of(fish=2, colour=colour)
    say(view, do="goal", fish=1, x=300, y=200.5, drag=False)
    view.advance(40)
    state, states = tick_on_screen(view)
    hello, floor = read(view.opening_messages()[0])
    height, width = view.feed.tank.floor.shape[:2]
    assert (hello["width"], hello["height"], hello["fish"]) == (width, height, MOST_FISH)
    assert floor == view.feed.tank.floor.tobytes()
    for fish, drawn in zip(state["fish"], states, strict=True):
        assert drawn[[X, Y]] == pytest.approx([fish["x"], fish["y"]], abs=0.06)
    assert state["fish"][1]["goal"] == [300, 200.5, False] and state["fish"][0]["goal"] is None
    assert state["tick"] == state["now"] == 40
    x, y = state["fish"][0]["trail"][-1]
    assert np.hypot(x - state["fish"][0]["x"], y - state["fish"][0]["y"]) < 3 * STEP


def test_a_picture_is_sent_once_and_before_the_fish_that_shows_it():
    view, known = view_of("network"), set()
    for _ in range(200):
        view.advance()
        for facts, payload in map(read, view.frame_messages()):
            if facts["kind"] == "picture":
                assert facts["picture"] not in known
                known.add(facts["picture"])
            if facts["kind"] == "rows":
                states = np.frombuffer(payload, np.float32)
                assert {states[PICTURE], states[PARTNER]} - {-1} <= known
    for facts, _ in map(read, view.opening_messages()):
        known.discard(facts.get("picture"))
    assert not known  # a page that comes later gets them all


def test_what_stays_the_same_is_not_sent_again():
    view = view_of()
    kinds = []
    for _ in range(60):
        view.advance()
        kinds += [read(one)[0]["kind"] for one in view.frame_messages()]
    assert kinds.count("modes") == 1 and kinds.count("tank") == 60
    assert 1 < kinds.count("decision") < 60
    told = [read(one)[0]["kind"] for one in view.opening_messages()]
    assert told[-4:] == ["modes", "decision", "events", "tank"]


def test_a_paused_tank_and_a_past_tick_are_shown_at_once():
    view = view_of()

    def jumps():
        [facts] = [one for one, _ in map(read, view.frame_messages(5.0)) if one["kind"] == "rows"]
        return facts["jump"]

    view.advance(30)
    assert jumps()  # the first one: there is nothing to come from
    view.advance()
    assert not jumps()
    say(view, do="look", tick=10)
    assert jumps()
    say(view, do="look", tick=None)
    assert jumps()
    view.advance()
    assert not jumps()


def test_rewinding_shows_the_tick_again_and_a_goal_returns_to_now():
    view = view_of()
    view.advance(30)
    then, drawn = tick_on_screen(view)
    view.advance(25)
    say(view, do="look", tick=30)
    state, again = tick_on_screen(view)
    assert np.array_equal(drawn, again) and state["past"] and not view.is_running
    for name in ("fish", "decision", "tick"):
        assert state[name] == then[name]
    say(view, do="goal", fish=None, x=300, y=200, drag=False)
    assert view.shown_tick == 55 and view.is_running
    say(view, do="step")
    assert view.shown_tick == 56 and not view.is_running
    say(view, do="pause", on=False)
    assert view.is_running


def test_ways_are_drawn_as_they_would_have_been_swum():
    """The path of the way that was taken is the way that the fish then swam.

    The candidates stay while the fish swims on what it planned.
    """
    view, plan, checked, kept = view_of("matching"), {}, 0, 0
    for _ in range(130):
        view.advance()
        state = view.describe_tick(view.shown_tick)
        decision = state["decision"]
        taken = next((one for one in decision["candidates"] if one["taken"]), None)
        if decision["planned"] < decision["tick"]:
            assert decision["candidates"] == plan["candidates"]
            assert decision["planned"] == plan["tick"]
            kept += 1
        else:
            plan = decision
        if taken is None or state["tick"] != decision["planned"]:
            continue
        assert decision["candidates"][0]["taken"]
        begin = view.tank.fish[0].row_at(state["tick"])
        x, y = decision["x"], decision["y"]
        path = np.array(taken["path"]) - [x, y] + [begin.x_px, begin.y_px]
        view.advance(2)
        row = view.tank.fish[0].row_at(view.tank.tick)
        if row.decided == decision["tick"]:
            assert path[1] == pytest.approx([row.x_px, row.y_px], abs=1.1)
            checked += 1
    assert checked > 10 and kept > 10


def test_goals_that_are_reached_are_counted_once():
    view = view_of("network", seed=3)
    say(view, do="goal", fish=0, x=400, y=300, drag=False)
    view.advance(500)
    assert view.goals_reached == 1 and view.tank.fish[0].reached
    say(view, do="goal", fish=0, x=100, y=300, drag=False)
    assert not view.tank.fish[0].reached
    say(view, do="drop", fish=None)
    view.advance(20)
    assert view.tank.fish[0].row_at(view.tank.tick).goal == ""
    assert abs(wrap_deg(view.tank.fish[0].row_at(view.tank.tick).heading_deg)) <= 180


# --- a tick decided anew


def test_a_tick_that_is_decided_anew_heads_for_the_new_goal_and_keeps_the_tick_before():
    tank = LiveTank(toy_players(), "matching", 1, 3)
    fish, rng = tank.fish[0], np.random.default_rng(0)
    for turn in range(60):
        for _ in range(int(rng.integers(1, 9))):
            tank.advance()
        before, now = fish.row_at(tank.tick - 1), tank.tick
        x, y = rng.uniform(0, ARENA.shape[1]), rng.uniform(0, ARENA.shape[0])
        tank.send_to_goal(0, x, y)
        goal = fish.goal
        tank.redo_last_tick(0)
        assert tank.tick == fish.last_tick == now, turn
        np.testing.assert_equal(fish.row_at(now - 1)[:-1], before[:-1])
        choice = fish.decision_at(now)
        assert choice.tick == now and choice.goal == goal
        # At the next tick all goes on as planned: nothing is decided once more.
        tank.advance()
        assert fish.decision_at(tank.tick).tick in (now, now + 1)


def test_the_first_tick_of_a_stretch_decided_anew_for_the_same_goal_stays_as_it_is():
    tank = LiveTank(toy_players(), "matching", 1, 4)
    fish, same = tank.fish[0], 0
    for _ in range(300):
        tank.advance()
        if fish.decision_at(tank.tick).tick == tank.tick:
            old = fish.row_at(tank.tick)
            tank.redo_last_tick(0)
            np.testing.assert_equal(fish.row_at(tank.tick)[:-1], old[:-1])
            same += 1
    assert same > 10


def test_fish_that_decide_anew_keep_clear_of_each_other():
    tank, rng = LiveTank(toy_players(), "matching", 3, 6), np.random.default_rng(2)
    player = tank.players["matching"]
    for _ in range(300):
        tank.advance()
        which = int(rng.integers(3))
        goal = tank.fish[(which + 1) % 3].row_at(tank.tick)
        tank.send_to_goal(which, goal.x_px, goal.y_px)
        tank.redo_last_tick(which)
        for fish in tank.fish:
            last = fish.decision_at(tank.tick)
            paths = [one.planned_path_from(last.tick) for one in tank.fish if one is not fish]
            others = Plans.from_paths(paths, last.tick).places_of_others(-1, last.tick)
            state = player.with_obstacles(last.state, others)
            assert player.is_clear(state._replace(fish=last.state.fish), last.stretch)
