"""The live tank: it is the engine of `animate`, cut where a wish comes, with a past to look at."""

import json
import math
from dataclasses import fields, replace

import cv2
import numpy as np
import pandas as pd
import pytest
from test_animate import ARENA, HEAD, LENGTH, RATE, TOUCH, Model
from test_animate_film import MOTION, REEL, STEP, cast_of, gateways
from test_render import drop

from finloop.animate import kinematics as step
from finloop.animate.arena import inside
from finloop.animate.edit_list import FRAME, HYBRID, LOOPS, MODES, NETWORK, SPRITE
from finloop.animate.motion import TURN
from finloop.animate.players import players
from finloop.animate.sprites import from_bend
from finloop.animate.swim import Swimmer, edit_list, swim
from finloop.base.cutout import Cutout
from finloop.errors import FinloopError
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.table import wrap_deg
from finloop.live import fish as play_fish
from finloop.live.cut import cut, snapshot
from finloop.live.fish import ROW
from finloop.live.message import parsed
from finloop.live.tank import LiveTank
from finloop.live.view import View
from finloop.render.painter import Gallery, Painter, Shelf

PLAYERS = players(
    cast_of(), MOTION, Model(), gateways(), ARENA, 0.6 * LENGTH, HEAD, TOUCH / LENGTH, 0.4, 0.12, 1.0
)  # fmt: skip
ROOM = PLAYERS[NETWORK].mode.tank


class Drops:
    """A store of which every picture is the same drop."""

    def __init__(self, count):
        self.count = count

    def __len__(self):
        return self.count

    def __getitem__(self, row):
        return Cutout(0, 0, 0, 0, drop())


def view_of(mode=HYBRID, fish=1, seed=0, colour=False):
    floor = np.full(ARENA.shape + ((3,) if colour else ()), 200, np.uint8)
    counts = {FRAME: len(REEL.more), SPRITE: 24 * 60}
    gallery = Gallery({kind: Shelf(Drops(n), np.full((n, 2), 15.0)) for kind, n in counts.items()})
    return View(LiveTank(PLAYERS, mode, fish, seed), Painter(floor), gallery)


def read(frame):
    """A frame as the page takes it apart: the state, the picture."""
    length = int.from_bytes(frame[:4], "little")
    picture = cv2.imdecode(np.frombuffer(frame[4 + length :], np.uint8), cv2.IMREAD_UNCHANGED)
    return json.loads(frame[4 : 4 + length]), picture


def played(tank, ticks, fish=0):
    rows = []
    for _ in range(ticks):
        tank.on()
        rows.append(tank.fish[fish].at(tank.tick))
    return np.array(rows, ROW)


def steps(rows):
    return np.hypot(np.diff(rows["x_px"]), np.diff(rows["y_px"]))


# --- the same engine


@pytest.mark.parametrize("mode", MODES)
def test_left_alone_it_is_the_edit_list_of_animate(mode):
    ticks = 400
    found = swim(PLAYERS[mode].mode, [], ticks, np.random.default_rng([7, 0]))
    wanted = edit_list(found, ticks, PLAYERS[mode])
    tank = LiveTank(PLAYERS, mode, 1, 7)
    rows = pd.DataFrame(np.append(np.array([tank.fish[0].at(0)], ROW), played(tank, ticks - 1)))
    faded = (wanted["weight"] > 0).to_numpy()
    assert faded.any() and not faded.all()
    for name in set(wanted.columns) & set(ROW.names):
        here = faded if name.startswith("partner") else slice(None)
        a, b = wanted[name].to_numpy()[here], rows[name].to_numpy()[here]
        if name in ("kind", "partner_kind", "mode", "state", "goal"):
            assert (a == b).all(), name
        else:
            assert a.astype(float) == pytest.approx(b.astype(float), abs=1e-4), name


@pytest.mark.parametrize("mode", MODES)
def test_a_stretch_cut_at_its_end_leaves_the_fish_where_planning_did(mode):
    swimmer, seen = Swimmer(PLAYERS[mode].mode, [], np.random.default_rng(1)), set()
    for _ in range(100):
        before = snapshot(swimmer.fish)
        found, _ = swimmer.swim_on()
        fish, kept = cut(before, swimmer.fish, found, len(found.way), PLAYERS[mode])
        seen.add((found.kind, found.state))
        assert len(kept.way) == len(found.way) and kept.touched == found.touched
        unlike = {"since"} if mode == NETWORK else set()  # only the film asks for it
        if (found.kind == SPRITE and before.row >= 0) or (found.kind == FRAME and before.row < 0):
            unlike |= {"phase"}  # of no use in the film, and after a turn
        if found.state == TURN:
            unlike |= {"phase"}
        for field in fields(fish):
            if field.name not in unlike:
                a, b = (np.asarray(getattr(one, field.name)) for one in (fish, swimmer.fish))
                assert np.allclose(a, b, rtol=0, atol=1e-9), (field.name, found.why)
    assert len(seen) > (1 if mode != LOOPS else 0)


@pytest.mark.parametrize("mode", MODES)
def test_a_goal_counts_from_the_next_tick_on_and_nothing_jumps(mode):
    tank, rng = LiveTank(PLAYERS, mode, 1, 3), np.random.default_rng(2)
    fast = 1.6 * max(MOTION.high * LENGTH / RATE, STEP)
    for _ in range(40):
        before = played(tank, int(rng.integers(2, 30)))
        past = [tank.fish[0].at(tick) for tick in range(max(0, tank.tick - 50), tank.tick)]
        asked = tank.tick
        tank.send(None, *rng.uniform((40, 30), (760, 570)))
        rows = np.append(before, played(tank, 5)).view(ROW)
        decision = tank.fish[0].decision(asked + 1)
        assert decision.tick == asked + 1
        assert (rows["goal"][len(before)] == "A") and not math.isnan(rows["goal_x_px"][-1])
        now = [tank.fish[0].at(tick) for tick in range(max(0, asked - 50), asked)]
        assert repr(past) == repr(now)
        assert steps(rows).max() <= fast
        assert all(inside(ROOM.legal, row["x_px"], row["y_px"]) for row in rows)


@pytest.mark.parametrize("mode", [NETWORK, HYBRID])
@pytest.mark.parametrize("drag", [False, True])
def test_the_fish_gets_there_even_while_its_goal_is_dragged(mode, drag):
    rng, took = np.random.default_rng(4), []
    for seed in range(8):
        tank = LiveTank(PLAYERS, mode, 1, seed)
        x, y = rng.uniform((80, 70), (720, 530))
        for tick in range(600):
            if tick == 0 or (drag and tick < 400):
                tank.send(0, x + (tick % 3) * 0.1, y, drag=tick > 0)
            tank.on()
            if tank.fish[0].reached:
                break
        took.append(tick)
        row = tank.fish[0].at(tank.tick)
        goal = np.array([row.goal_x_px, row.goal_y_px], float)
        assert step.touches(row.x_px, row.y_px, row.heading_deg, HEAD, goal, TOUCH + 0.1)
    assert max(took) < 500


def test_a_goal_beyond_the_wall_is_put_where_a_fish_can_touch_it():
    tank = LiveTank(PLAYERS, NETWORK, 1, 0)
    tank.send(0, -50.0, 900.0)
    goal = tank.fish[0].goal
    assert ROOM.into(goal.x_px, goal.y_px) == (goal.x_px, goal.y_px)
    tank.send(0, 400.0, 300.0)
    assert tank.fish[0].goal[1:3] == (400.0, 300.0)


@pytest.mark.parametrize("mode", MODES)
def test_while_a_goal_is_dragged_a_stretch_is_swum_for_a_moment(mode):
    tank, decided = LiveTank(PLAYERS, mode, 1, 3), []
    tank.on()
    for tick in range(60):
        tank.send(0, 400.0 + 3 * tick, 300.0, drag=tick > 0)
        tank.on()
        decided.append(int(tank.fish[0].at(tank.tick).decided))
    assert decided[0] == 2  # the first click counts at once
    apart = np.diff(sorted(set(decided)))
    assert 1 < np.median(apart) <= 3 and len(apart) > 15


# --- a turn that was cut


def test_a_bent_fish_goes_on_from_its_bend():
    network = PLAYERS[NETWORK].mode
    turns = network.sprites.turns
    plan = network._plan(LEFT, 100, 90)
    for at, sprite in enumerate(plan.frames[:-1]):
        on = from_bend(plan, turns, LEFT, sprite)
        first = int(np.flatnonzero(plan.frames == sprite)[0])
        assert list(on.frames) == list(plan.frames[first + 1 :]), at
        assert on.share[-1] == 1 and (np.diff(on.share, prepend=0) > 0).all()
        other = from_bend(network._plan(RIGHT, 100, 90), turns, RIGHT, sprite)
        undone = turns[LEFT].undone(sprite)[::2]
        assert list(other.frames[: len(undone)]) == list(undone)
        assert (np.diff(other.share, prepend=0) > 0).all() and other.share[-1] == 1
    shallow = network._plan(LEFT, 10, 5)
    deep = turns[LEFT].up[-1]
    assert deep not in shallow.frames
    assert list(from_bend(shallow, turns, LEFT, deep).frames) == list(turns[LEFT].undone(deep))
    assert from_bend(plan, turns, LEFT, int(network.sprites.cycles[0][0])) is plan


def test_who_is_stopped_amid_a_turn_is_bent_and_only_then():
    swimmer, bent = Swimmer(PLAYERS[NETWORK].mode, [], np.random.default_rng(5)), 0
    for _ in range(200):
        before = snapshot(swimmer.fish)
        found, _ = swimmer.swim_on()
        assert not swimmer.fish.bent
        if found.state == TURN and len(found.way) > 4:
            fish, _ = cut(before, swimmer.fish, found, 4, PLAYERS[NETWORK])
            assert fish.bent
            bent += 1
    assert bent > 10


# --- modes


def test_modes_are_changed_while_it_swims():
    tank = LiveTank(PLAYERS, NETWORK, 2, 1)
    kinds = {NETWORK: SPRITE, LOOPS: FRAME}
    fast = 1.6 * max(MOTION.high * LENGTH / RATE, STEP)
    for mode in (LOOPS, NETWORK, HYBRID, LOOPS, NETWORK, LOOPS, HYBRID, NETWORK):
        tank.switch(mode)
        rows = played(tank, 250)
        if mode == NETWORK:
            assert (rows["kind"] == SPRITE).all()
        elif mode == LOOPS:
            into = int(np.argmax(rows["kind"] == FRAME))
            assert (rows["kind"][into:] == kinds[mode]).all() and into < 100
        assert steps(rows).max() <= fast
    tank.switch(NETWORK)  # it is in that mode already: nothing is cut
    decided = tank.fish[0].at(tank.tick).decided
    tank.on()
    assert tank.fish[0].at(tank.tick).decided in (decided, tank.tick)


def test_who_is_to_go_on_by_the_film_takes_a_way_that_gains_nothing(monkeypatch):
    hybrid = PLAYERS[HYBRID].mode
    monkeypatch.setattr(hybrid, "_worth", lambda options, fish, target: options.legal & False)
    for mode, kinds in ((HYBRID, {SPRITE}), (LOOPS, {FRAME})):
        tank = LiveTank(PLAYERS, NETWORK, 1, 1)
        tank.switch(mode)
        assert set(played(tank, 200)["kind"][100:]) == kinds


def test_a_mode_that_the_film_does_not_allow_is_refused():
    few = dict.fromkeys((NETWORK, HYBRID), PLAYERS[NETWORK])
    with pytest.raises(FinloopError, match="no mode loops"):
        LiveTank(few, LOOPS, 1, 0)
    tank = LiveTank(few, HYBRID, 1, 0)
    tank.switch(LOOPS)
    played(tank, 50)
    assert tank.mode == HYBRID


# --- the past


def test_the_past_is_kept_as_it_was_and_no_longer_than_said(monkeypatch):
    monkeypatch.setattr(play_fish, "HISTORY", 60)
    tank = LiveTank(PLAYERS, HYBRID, 1, 2)
    rows = played(tank, 400)
    fish = tank.fish[0]
    assert len(fish._ring) == 60
    assert sum(one.tick < tank.oldest - 90 for one in fish._decisions) <= 1
    assert tank.oldest == tank.tick - 59
    for back in range(60):
        assert repr(tuple(fish.at(tank.tick - back))) == repr(rows[-1 - back].item())
        decision = fish.decision(tank.tick - back)
        assert decision.tick <= tank.tick - back
    assert fish.at(tank.oldest - 1) is None and fish.at(tank.tick + 1) is None
    assert fish.decision(tank.oldest - 1) is None


def test_what_was_weighed_is_told_with_its_costs():
    tank, loops = LiveTank(PLAYERS, HYBRID, 1, 2), PLAYERS[LOOPS].mode
    tank.send(0, 700.0, 100.0)
    seen = set()
    for _ in range(600):
        tank.on()
        decision = tank.fish[0].decision(tank.tick)
        row = tank.fish[0].at(tank.tick)
        taken = [way for way in decision.weighed if way.taken]
        assert len(taken) <= 1
        if row.kind == FRAME and taken:
            assert decision.tick == row.decided
        for way in decision.weighed:
            terms = way.seam_s, way.speed_s, way.again_s
            assert min(terms) >= 0
            seen.add((way.fails, way.taken, sum(terms) > 0))
            if math.isfinite(way.value_s):
                assert way.value_s >= sum(terms) - 1e-6
    assert {("", True, True), ("", True, False)} <= seen  # jumps, and played on
    fish = replace(tank.fish[0]._swimmer.fish, row=3)
    for row, seam in ((40, 0.4), (400, 0.0)):
        assert sum(loops.jump_terms(fish, row, seam)) * RATE == pytest.approx(
            loops.jump_cost(fish, row, seam)
        )


def test_ghosts_are_not_drawn_and_do_not_come_back():
    def rows(ghost):
        tank = LiveTank(PLAYERS, HYBRID, 1, 5, ghost)
        return played(tank, 300)["weight"]

    usual = rows(lambda row: False)
    assert (usual > 0).any()
    assert not rows(lambda row: True).any()
    first = rows(lambda row: row.weight > 0.7)  # only the first tick of a cross-fade is unlike
    assert first.sum() < usual.sum() and not first[(usual > 0)].all()
    begins = np.flatnonzero(usual > 0.7)
    assert not any(first[tick + 1] for tick in begins if 0 < usual[tick + 1] < usual[tick])


# --- fish come and go; the view


def test_fish_come_and_go():
    view = view_of(fish=3)
    view.on(5)
    view.grant(parsed('{"do":"count","fish":8}'))
    view.on(5)
    state, _ = read(view.show())
    assert len(state["fish"]) == 8 and all(state["fish"])
    view.grant(parsed('{"do":"look","tick":3}'))
    state, _ = read(view.show())
    assert [fish is not None for fish in state["fish"]] == [True] * 3 + [False] * 5
    view.grant(parsed('{"do":"explain","fish":7}'))
    view.grant(parsed('{"do":"count","fish":1}'))
    assert view.explained == 0 and len(view.tank.fish) == 1
    view.grant(parsed('{"do":"goal","fish":5,"x":1,"y":1,"drag":false}'))  # not there: let be
    read(view.show())


@pytest.mark.parametrize("colour", [False, True])
def test_a_frame_is_the_painted_tank_and_the_state(colour):
    view = view_of(fish=2, colour=colour)
    view.grant(parsed('{"do":"goal","fish":1,"x":300,"y":200.5,"drag":false}'))
    view.on(40)
    state, picture = read(view.show(3.21))
    assert picture.shape == view.painter.frame.shape
    painted = view.painter.frame[..., ::-1] if colour else view.painter.frame
    assert np.abs(picture.astype(int) - painted).mean() < 2
    for fish in state["fish"]:
        x, y = round(fish["x"]), round(fish["y"])
        assert picture[y - 3 : y + 4, x - 3 : x + 4].mean() != pytest.approx(200, abs=5)
    assert state["fish"][1]["goal"] == [300, 200.5, False] and state["fish"][0]["goal"] is None
    assert state["tick"] == state["now"] == 40 and state["ms"] == 3.2
    x, y = state["fish"][0]["trail"][-1]
    assert np.hypot(x - state["fish"][0]["x"], y - state["fish"][0]["y"]) < 3 * STEP


def test_rewinding_shows_the_frame_again_and_a_goal_returns_to_now():
    view = view_of()
    view.on(30)
    then, picture = read(view.show())
    view.on(25)
    view.grant(parsed('{"do":"look","tick":30}'))
    state, again = read(view.show())
    assert np.array_equal(picture, again) and state["past"] and not view.runs
    for name in ("fish", "decision", "tick"):
        assert state[name] == then[name]
    view.grant(parsed('{"do":"goal","fish":null,"x":300,"y":200,"drag":false}'))
    assert view.tick == 55 and view.runs
    view.grant(parsed('{"do":"step"}'))
    assert view.tick == 56 and not view.runs
    view.grant(parsed('{"do":"pause","on":false}'))
    assert view.runs


def test_ways_are_drawn_as_they_would_have_been_swum():
    """The path of the way that was taken is the way that the fish then swam."""
    view, checked = view_of(LOOPS), 0
    for _ in range(130):
        view.on()
        state = view.state(view.tick)
        decision = state["decision"]
        taken = next((way for way in decision["ways"] if way["taken"]), None)
        if taken is None or state["tick"] != decision["tick"]:
            continue
        assert decision["ways"][0]["taken"]
        begin = view.tank.fish[0].at(state["tick"])
        x, y = decision["x"], decision["y"]
        path = np.array(taken["path"]) - [x, y] + [begin.x_px, begin.y_px]
        view.on(2)
        row = view.tank.fish[0].at(view.tank.tick)
        if row.decided == decision["tick"]:
            assert path[1] == pytest.approx([row.x_px, row.y_px], abs=1.1)
            checked += 1
    assert checked > 10


def test_goals_that_are_reached_are_counted_once():
    view = view_of(NETWORK, seed=3)
    view.grant(parsed('{"do":"goal","fish":0,"x":400,"y":300,"drag":false}'))
    view.on(500)
    assert view.counts.reached == 1 and view.tank.fish[0].reached
    view.grant(parsed('{"do":"goal","fish":0,"x":100,"y":300,"drag":false}'))
    assert not view.tank.fish[0].reached
    view.grant(parsed('{"do":"drop","fish":null}'))
    view.on(20)
    assert view.tank.fish[0].at(view.tank.tick).goal == ""
    assert abs(wrap_deg(view.tank.fish[0].at(view.tank.tick).heading_deg)) <= 180
