"""The film to swim by, loops mode, hybrid mode: laws, a slow search, ground truth.

A made-up fish of constant speed swims on circles and straight lines; every picture of it is alike,
so a loop may join any two of its rows. Positions are px, y down; angles degrees, anticlockwise.
"""

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pandas as pd
import pytest
from test_animate import (
    ARENA,
    DELTA,
    HEAD,
    LENGTH,
    RATE,
    TOUCH,
    Model,
    order,
    sprites,
)  # fmt: skip
from test_animate import film as learnt

from finloop.animate import measures
from finloop.animate import search as ahead
from finloop.animate.arena import inside, tank
from finloop.animate.edit_list import CONSIDERED, EDIT, FRAME, HYBRID, LOOPS, NETWORK, SPRITE, Goal
from finloop.animate.hybrid import HybridMode
from finloop.animate.kinematics import bearing, touches
from finloop.animate.loops import LoopMode, Options, choose, considered
from finloop.animate.motion import ACCELERATE, STRAIGHT, learn
from finloop.animate.motion import FILM as IN_FILM
from finloop.animate.network import Fish, NetworkMode
from finloop.animate.players import frame_hulls, players, reach
from finloop.animate.search import film
from finloop.animate.swim import Cast, Player, edit_list, random_goals, swim
from finloop.distance.picture import BODY, FILM
from finloop.features.table import wrap_deg
from finloop.gateways.find import GATEWAYS
from finloop.io.table import load_table, save_table
from finloop.loops.graph import goes_on, loop_graph

ORIENTATIONS = 24  # conf/features/default.yaml

SPEED = 2.0  # body lengths/s
STEP = SPEED * LENGTH / RATE  # px per tick
ROOM = tank(ARENA, 0.6 * LENGTH)
MOTION = learn(learnt(), RATE, DELTA)


# --- a film that was never made


def swum(turns, heading=0.0, track=0, length=LENGTH, at=(500.0, 500.0)):
    """A track that turns by so many degrees from row to row, at a constant speed."""
    headings = heading + np.cumsum([0.0, *turns])
    angle = np.radians(headings)
    step = SPEED * length / RATE * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    place = np.array(at) + np.cumsum(np.vstack([[0, 0], step[:-1]]), axis=0)
    n = len(headings)
    return pd.DataFrame(
        {
            "track_id": track, "frame": np.arange(n), "x_px": place[:, 0], "y_px": place[:, 1],
            "heading_deg": wrap_deg(headings), "body_length_px": length,
            "motion_area_rel": 0.1, "swimming_type": 0, "bend": 0.0,
        }
    )  # fmt: skip


def table_of(*tracks):
    return pd.concat([t.assign(track_id=i) for i, t in enumerate(tracks)], ignore_index=True)


def loops(*pairs):
    rows = [(min(p[:2]), max(p[:2]), p[2] if len(p) > 2 else 0.5) for p in pairs]
    made = pd.DataFrame(rows, columns=["a", "b", "distance"])
    return made.astype({"a": int, "b": int, "distance": float})


def film_of(features, found, pose=BODY, step=1.0, barred=None):
    n = len(features)
    graph = loop_graph(found, features["track_id"].to_numpy())
    barred = np.zeros(n, bool) if barred is None else np.isin(np.arange(n), barred)
    return film(features, graph, step, pose, RATE, DELTA, barred)


def rich(seed=0, heading=True):
    """Circles to both sides and straight lines, 150 rows each; loops between any of them."""
    rng = np.random.default_rng(seed)
    rates = (0.0, 2.0, -2.0, 4.0, -4.0, 7.0, -7.0, 0.5)
    tracks = table_of(*(swum([rate] * 149, rng.uniform(-180, 180)) for rate in rates))
    ends = np.concatenate([150 * i + np.arange(4, 146, 6) for i in range(len(rates))])
    pairs = {(a, b) for a in ends for b in rng.choice(ends, 4) if abs(int(a) - b) > 12}
    if not heading:  # FILM: both fish of a loop must head alike
        angle = tracks["heading_deg"].to_numpy()
        every = np.array([(a, b) for a in ends for b in ends if b - a > 12])
        alike = np.abs(wrap_deg(angle[every[:, 0]] - angle[every[:, 1]])) < 7.5
        pairs = {tuple(pair) for pair in every[alike]}
    far = rng.uniform(0.1, 0.7, len(pairs))
    return tracks, loops(*((a, b, d) for (a, b), d in zip(sorted(pairs), far, strict=True)))


TABLE, PAIRS = rich()
REEL = film_of(TABLE, PAIRS)


def loop_mode(reel=REEL, room=ROOM, stay_s=0.4):
    return LoopMode(reel, MOTION, room, TOUCH, HEAD, stay_s)


def cast_of(reel=REEL):
    hull = np.array([[20.0, 0], [-20, 5], [-20, -5]])
    hulls = np.repeat(hull[None].astype(np.float32), len(reel.more), axis=0)
    return Cast(sprites(), order(), reel, [hull] * len(sprites()), hulls)


def gateways(table=TABLE, every=7, seed=1):
    """Ways in from every sprite of a cycle, ways out to every one, the headings fitting exactly."""
    rng = np.random.default_rng(seed)
    heading = table["heading_deg"].to_numpy()
    last = np.append(np.diff(table["track_id"]) != 0, True)
    rows = [
        (sprite, 0, "in", row, rank, rng.uniform(0.2, 1.0), wrap_deg(-heading[row]))
        for sprite in range(14)
        for rank, row in enumerate(np.arange(1 + sprite % 5, len(table) - 1, 97), 1)
    ] + [
        (sprite, 0, "out", row, sprite + 1, rng.uniform(0.2, 1.0), wrap_deg(-heading[row + 1]))
        for row in np.flatnonzero(~last)[::every]
        for sprite in range(14)
    ]
    return pd.DataFrame(rows, columns=[c.name for c in GATEWAYS.columns])


def network(room=ROOM):
    return NetworkMode(MOTION, order(), Model(), room, TOUCH, HEAD)


def hybrid_mode(reel=REEL, gates=None, room=ROOM, stay_s=0.4):
    gates = gateways() if gates is None else gates
    return HybridMode(network(room), loop_mode(reel, room, stay_s), gates, 1.0)


def edit_of(mode, goals, ticks, seed, fade=3, reel=REEL):
    found = swim(mode, goals, ticks, np.random.default_rng(seed))
    return found, edit_list(found, ticks, Player(mode, cast_of(reel), fade))


def flat(found):
    """The ticks of a swim: way (n, 3), numbers, rotations, whether a jump begins, stretch of each."""
    s = found.stretches
    rots = [np.zeros(len(one.way)) if one.rot is None else one.rot for one in s]
    new = np.concatenate([[one.new] + [False] * (len(one.way) - 1) for one in s])
    of = np.repeat(np.arange(len(s)), [len(one.way) for one in s])
    numbers = np.concatenate([one.number for one in s])
    return np.concatenate([one.way for one in s]), numbers, np.concatenate(rots), new, of


def on_the_spot(found):
    return np.array([s.why.startswith("no way on") for s in found.stretches])


# --- the film


@pytest.mark.parametrize("rate", [0.0, 5.0, -5.0])
def test_a_film_moves_as_its_fish_did_at_the_drawn_size(rate):
    small, large = swum([rate] * 20, 30.0, length=40.0), swum([rate] * 20, 30.0, length=80.0)
    found = film_of(table_of(small, large), loops((3, 30)))
    angle = np.radians(30.0 + rate * np.arange(20))
    drawn = SPEED * 60.0 / RATE  # the median fish is 60 px long
    for first in (0, 21):
        here = slice(first, first + 20)
        assert found.dx[here] == pytest.approx(drawn * np.cos(angle))
        assert found.dy[here] == pytest.approx(-drawn * np.sin(angle))
        assert found.dx[first + 20] == found.dy[first + 20] == 0
    assert found.scale[:21] == pytest.approx(1.5) and found.scale[21:] == pytest.approx(0.75)
    chord = np.sinc(DELTA * rate / 360) / np.sinc(rate / 360)  # over Δ the way is a chord
    assert found.speed[[8, 30]] == pytest.approx(SPEED * chord)


def test_speed_is_that_of_the_track_up_to_its_ends():
    found = film_of(table_of(swum([0.0] * 9), swum([0.0] * 9, 90.0, at=(0, 0))), loops((3, 12)))
    assert found.speed == pytest.approx(SPEED)


def test_a_film_ends_with_each_track_and_before_each_barred_row():
    table = table_of(swum([0.0] * 9), swum([0.0] * 9))
    assert list(np.flatnonzero(~film_of(table, loops((3, 12))).more)) == [9, 19]
    found = film_of(table, loops((3, 12)), barred=[5, 16])
    assert list(np.flatnonzero(~found.more)) == [4, 5, 9, 15, 16, 19]
    assert (found.dx[~found.more] == 0).all() and (found.dx[found.more] > 0).all()


def test_loops_lead_both_ways_but_never_to_a_barred_row():
    table = table_of(swum([0.0] * 19), swum([0.0] * 19))
    pairs = loops((3, 25, 0.4), (3, 10, 0.2), (10, 30, 0.8))

    def ways(reel):
        return {
            row: [
                (int(reel.to[e]), pytest.approx(reel.seam[e], rel=1e-6))
                for e in range(reel.start[k], reel.start[k + 1])
            ]
            for row, k in enumerate(reel.end) if k >= 0
        }  # fmt: skip

    assert ways(film_of(table, pairs, step=0.5)) == {
        3: [(10, 0.4), (25, 0.8)], 10: [(3, 0.4), (30, 1.6)], 25: [(3, 0.8)], 30: [(10, 1.6)],
    }  # fmt: skip
    assert ways(film_of(table, pairs, step=0.5, barred=[10])) == {
        3: [(25, 0.8)], 10: [(3, 0.4), (30, 1.6)], 25: [(3, 0.8)], 30: [],
    }  # fmt: skip


def random_film(rng, most_rows=24):
    """A few short tracks with a few random loops, and perhaps a barred row."""
    lengths = rng.integers(2, 9, rng.integers(1, 5))
    table = table_of(*(swum(rng.uniform(-30, 30, n - 1), rng.uniform(0, 360)) for n in lengths))
    n = len(table)
    drawn = {tuple(sorted(rng.choice(n, 2, replace=False))) for _ in range(rng.integers(1, 7))}
    barred = rng.choice(n, rng.integers(0, 3))
    pairs = loops(*((a, b, rng.uniform(0.1, 1)) for a, b in sorted(drawn)))
    return table, pairs, barred


def test_endless_is_what_reaches_a_cycle_of_the_graph():
    rng = np.random.default_rng(0)
    seen = np.zeros(2, int)
    for _ in range(300):
        table, pairs, barred = random_film(rng)
        reel = film_of(table, pairs, barred=barred)
        graph = nx.DiGraph()
        graph.add_nodes_from(range(len(table)))
        for row in range(len(table)):  # an edge: after this row's turn comes the turn of that one
            instead = [row]
            if reel.end[row] >= 0:
                k = reel.end[row]
                instead += list(reel.to[reel.start[k] : reel.start[k + 1]])
            graph.add_edges_from((row, other + 1) for other in instead if reel.more[other])
        cyclic = {
            row for part in nx.strongly_connected_components(graph) for row in part
            if len(part) > 1 or graph.has_edge(row, row)
        }  # fmt: skip
        wanted = [bool(({row} | nx.descendants(graph, row)) & cyclic) for row in graph]
        assert list(reel.endless) == wanted
        seen += np.bincount(reel.endless, minlength=2)
    assert seen.min() > 500  # both happen


def test_the_film_goes_on_where_the_graph_of_loops_says_so():
    rng = np.random.default_rng(1)
    for _ in range(200):
        table, pairs, _ = random_film(rng)
        track = table["track_id"].to_numpy()
        reel = film_of(table, pairs)
        after = reel.more & np.append(reel.endless[1:], False)
        assert list(after) == list(goes_on(loop_graph(pairs, track), track))


def test_without_a_loop_nothing_is_endless():
    assert not film_of(TABLE, loops()).endless.any()


# --- looking ahead, against a slow search


def slow_leg(reel, room, x, y, rot, row, stride, most, at):
    angle = np.radians(rot)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    place = np.array([x, y])
    for t in range(1, most + 1):
        if not reel.more[row]:
            return *place, (row if reel.end[row] >= 0 and t > 1 else -1), t - 1, False
        place = place + turn @ (reel.dx[row], reel.dy[row])
        row += 1
        if not inside(room.legal, *place):
            return *place, -1, t, False
        goes_on = reel.more[row] and reel.endless[row + 1]
        if goes_on and touches(*place, reel.heading[row] + rot, HEAD, at, TOUCH):
            return *place, row, t, True
        if t >= stride and reel.end[row] >= 0:
            return *place, row, t, False
    return *place, row, most, False


def slow_look(reel, room, shown, x, y, rot, row, cost, since, now, at, horizon, stride, stay):
    """Every way there is, one after the other: value, far, error, ticks; as `look` says."""
    found, longest = [], 0

    def error(x, y, heading):
        return abs(wrap_deg(bearing(x, y, *at) - heading))

    def follow(x, y, rot, row, t, since, cost):
        nonlocal longest
        x, y, row, played, touched = slow_leg(
            reel, room, x, y, rot, row, stride, max(horizon - t, 1), at
        )
        t, since = t + played, since + played
        longest = max(longest, t)
        if row < 0 or not reel.endless[row]:
            return
        heading = reel.heading[row] + rot
        if touched:
            found.append((t + cost, 0.0, 0.0, t))
        elif t >= horizon:
            far = np.hypot(at[0] - x, at[1] - y)
            off = error(x, y, heading)
            found.append((t + cost + far / 3.0 + off / 5.0, far, off, t))
        else:
            if reel.more[row] and reel.endless[row + 1]:
                follow(x, y, rot, row, t, since, cost)
            if since < stay or reel.end[row] < 0:
                return
            for e in range(reel.start[reel.end[row]], reel.start[reel.end[row] + 1]):
                other = reel.to[e]
                if reel.more[other] and reel.endless[other + 1]:
                    ago = now + t - shown[other]
                    price = 6 * reel.seam[e] + 7 * abs(reel.speed[other] - reel.speed[row])
                    price += 20 * max(0, 1 - ago / 300)
                    turned = heading - reel.heading[other] if reel.body else rot
                    follow(x, y, turned, other, t, 0, cost + price)

    if reel.endless[row] and inside(room.legal, x, y):
        follow(x, y, rot, row, 0, since, cost)
    return min(found) if found else (np.inf, np.inf, 180.0, longest)


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_looking_ahead_finds_what_a_search_of_every_way_finds(pose):
    rng = np.random.default_rng(2)
    ends = dict.fromkeys(("none", "touched", "not"), 0)
    for _ in range(150):
        table, pairs, barred = random_film(rng)
        reel = film_of(table, pairs, pose, barred=barred)
        n = len(table)
        legal = np.zeros((90, 90), bool)
        legal[5 : int(rng.integers(40, 85)), 5:85] = True
        room = SimpleNamespace(legal=legal)
        rows, rots = np.flatnonzero(reel.more), rng.uniform(-180, 180, reel.more.sum())
        x, y, now = rng.uniform(20, 40), rng.uniform(20, 40), 500
        costs, sinces = rng.uniform(0, 9, len(rows)), rng.integers(0, 9, len(rows))
        shown = rng.integers(-500, now, n)
        at = rng.uniform(-40, 130, 2)
        horizon, stride, stay = (int(rng.integers(1, top)) for top in (26, 4, 6))
        value, far, error, ticks, over = ahead.look(
            reel.dx, reel.dy, reel.heading, reel.speed, reel.more, reel.end, reel.start, reel.to,
            reel.seam, reel.endless, reel.body, shown, legal, x, y, rots, rows, costs, sinces, now,
            at, TOUCH, HEAD, 3.0, 5.0, horizon, stride, stay, 20_000, 6.0, 7.0, 20.0, 300.0,
        )  # fmt: skip
        assert not over.any()
        for i, row in enumerate(rows):
            wanted = slow_look(
                reel, room, shown, x, y, rots[i], row, costs[i], sinces[i], now, at, horizon,
                stride, stay,
            )  # fmt: skip
            found = value[i], far[i], error[i], ticks[i]
            assert found == pytest.approx(wanted, abs=1e-6)
            ends["none" if np.isinf(value[i]) else "not" if far[i] else "touched"] += 1
    assert min(ends.values()) > 25  # all three happen


def test_a_narrow_search_is_never_better_than_a_wide_one_and_says_what_it_gave_up():
    rng = np.random.default_rng(3)
    given_up = 0
    for _ in range(20):
        rows = rng.choice(np.flatnonzero(REEL.endless & REEL.more), 12)
        rots, at = rng.uniform(-180, 180, 12), rng.uniform(100, 500, 2)
        found = [
            ahead.look(
                REEL.dx, REEL.dy, REEL.heading, REEL.speed, REEL.more, REEL.end, REEL.start,
                REEL.to, REEL.seam, REEL.endless, True, np.full(len(TABLE), -(10**9)), ROOM.legal,
                400.0, 300.0, rots, rows, np.zeros(12), np.zeros(12, np.int64), 0, at, TOUCH, HEAD,
                3.0, 5.0, 30, 4, 8, width, 6.0, 7.0, 20.0, 300.0,
            )
            for width in (4, 4000)
        ]  # fmt: skip
        (narrow, *_, gone), (wide, *_, none) = found
        assert (narrow >= wide - 1e-9).all() and not none.any()
        assert narrow.min() < np.inf and not (gone & np.isfinite(narrow)).any()
        given_up += gone.sum()
    assert given_up


def test_what_remains_is_the_way_and_the_turn():
    at = np.array([130.0, 60.0])
    assert ahead.remaining(100.0, 100.0, 0.0, at, 5.0, 4.0) == pytest.approx(
        10 + np.degrees(np.arctan2(40, 30)) / 4
    )


def test_a_jump_costs_its_seam_its_change_of_speed_and_what_was_just_seen():
    cost = ahead.jump_cost
    assert cost(0.5, 0.0, 1e9, 6.0, 7.0, 20.0, 300.0) == pytest.approx(3)
    assert cost(0.0, -2.0, 1e9, 6.0, 7.0, 20.0, 300.0) == pytest.approx(14)
    assert cost(0.0, 0.0, 75.0, 6.0, 7.0, 20.0, 300.0) == pytest.approx(15)


# --- loops mode: laws of every swim


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_positions_move_as_the_film_turned_and_only_loops_are_jumped(pose):
    table, pairs = rich(heading=pose == BODY)
    reel = film_of(table, pairs, pose)
    found, _ = edit_of(loop_mode(reel), [Goal("A", 200.0, 200.0)], 1500, 1, reel=reel)
    way, number, rot, new, of = flat(found)
    partners = {(int(a), int(b)) for a, b in pairs[["a", "b"]].to_numpy()}
    partners |= {(b, a) for a, b in partners}
    still = on_the_spot(found)[of]
    jumps = 0
    for t in range(1, len(way)):
        if still[t]:
            continue
        before = number[t - 1]
        moved = ahead.moved(reel.dx[before], reel.dy[before], rot[t - 1])
        assert way[t, :2] - way[t - 1, :2] == pytest.approx(moved, abs=1e-6)
        assert way[t, 2] == pytest.approx(reel.heading[number[t]] + rot[t])
        assert new[t] == (number[t] != before + 1)
        if new[t]:
            assert (before + 1, number[t]) in partners
            jumps += 1
        elif not still[t - 1]:
            assert rot[t] == rot[t - 1]
    assert jumps > 20
    assert still.mean() < 0.3


def test_the_heading_goes_on_over_a_jump():
    found, table = edit_of(loop_mode(), [], 2000, 3)
    way, number, _, new, of = flat(found)
    would = REEL.heading[number[:-1] + 1] - REEL.heading[number[:-1]]  # had it not jumped
    turned = wrap_deg(np.diff(way[:, 2]) - would)
    calm = ~on_the_spot(found)[of][1:]
    assert turned[calm] == pytest.approx(0, abs=1e-6) and (new[1:] & calm).sum() > 20
    drawn = np.abs(wrap_deg(np.diff(table["heading_deg"].to_numpy(float))))
    assert drawn[calm[: len(drawn)]].max() <= 7.001


def test_in_the_pose_of_the_film_nothing_is_turned():
    table, pairs = rich(heading=False)
    reel = film_of(table, pairs, FILM)
    found, edit = edit_of(loop_mode(reel), [], 1500, 2, reel=reel)
    *_, of = flat(found)
    first = np.flatnonzero(on_the_spot(found)[of])
    stop = int(first[0]) if first.size else 1500
    assert stop > 100
    assert (edit["rotation_deg"][:stop] == 0).all()
    heading = table["heading_deg"].to_numpy()[edit["source"]][:stop]
    assert wrap_deg(edit["heading_deg"][:stop] - heading) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(
    "stay_s",
    [0.01, 0.4, 1.5],
)
def test_two_jumps_are_never_nearer_than_the_stay(stay_s):
    for mode in (loop_mode(stay_s=stay_s), hybrid_mode(stay_s=stay_s)):
        found, _ = edit_of(mode, [Goal("A", 200.0, 200.0)], 2000, 4)
        *_, new, of = flat(found)
        kind = np.array([s.kind == FRAME for s in found.stretches])
        into = np.append(False, ~kind[:-1])[of]  # by a gateway
        forced = np.array([s.why.startswith("no way on") for s in found.stretches])[of]
        jumps = np.flatnonzero(new & kind[of])  # a track that ends is left, however soon
        gaps = [b - a for a, b in pairwise(jumps) if not (into[b] or forced[b])]
        assert min(gaps) >= max(1, round(stay_s * RATE)) and len(gaps) > 20


def with_dead_ends():
    """Three tracks of 201 rows; each is joined to the others only in its beginning."""
    table = table_of(swum([4.0] * 200), swum([-4.0] * 200), swum([0.0] * 200))
    pairs = loops(
        *((a, b) for a in (10, 50, 90, 140) for b in (215, 255, 301, 341)),
        *((a, b) for a in (20, 100) for b in (440, 530)), (30, 470), (12, 132),
    )  # fmt: skip
    reel = film_of(table, pairs)
    after = reel.more & np.append(reel.endless[1:], False)
    assert after[:140].all() and after[201:341].all() and after[402:530].all()
    assert after.sum() == 140 + 140 + 128
    return reel, after


def test_a_dead_end_is_never_played_into():
    reel, after = with_dead_ends()
    for seed in range(6):
        found, _ = edit_of(loop_mode(reel), [], 2000, seed, reel=reel)
        _, number, _, new, of = flat(found)
        assert after[number].all()
        assert on_the_spot(found)[of].mean() < 0.3 and new.sum() > 20


def test_the_fish_begins_where_the_film_goes_on():
    reel, after = with_dead_ends()
    mode = loop_mode(reel)
    rng = np.random.default_rng(0)
    assert all(after[mode.begin(rng).row] for _ in range(2000))


def test_the_film_never_stops():
    for seed in range(6):
        found, table = edit_of(loop_mode(), [Goal("A", 700.0, 60.0)], 2000, seed)
        _, number, *_, of = flat(found)
        assert (np.diff(number) != 0).all()
        assert on_the_spot(found)[of].mean() < 0.1
        assert np.ptp(table["x_px"]) > 200 and np.ptp(table["y_px"]) > 150


@pytest.mark.parametrize("make", [loop_mode, hybrid_mode])
def test_never_outside_the_tank(make):
    mode = make()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        goals = random_goals(ROOM, TOUCH + HEAD, 3, rng)
        _, table = edit_of(mode, goals, 1000, seed)
        assert all(inside(ROOM.legal, x, y) for x, y in table[["x_px", "y_px"]].to_numpy())
        assert measures.outside(table, cast_of(), ROOM) == 0


def test_a_fish_without_room_turns_up_to_the_last_row_of_the_film():
    mode = loop_mode(film_of(table_of(swum([0.0] * 199)), loops((20, 199))))
    fish = mode.begin(np.random.default_rng(0))
    fish.row, fish.rot, fish.x, fish.y = 197, 0.0, 744.0, 300.0  # into the wall
    found = mode.stretch(fish, np.array([300.0, 300.0]), "A", np.random.default_rng(0))
    assert list(found.number) == [198] and fish.row == 198
    assert found.why.startswith("no way on")


def test_a_way_is_never_swum_farther_than_it_was_looked_at():
    """Loop ends so rare that between two of them lies more film than a look ahead."""
    reel = film_of(table_of(swum([0.7] * 599)), loops((20, 560), (40, 580)))
    assert np.diff(np.flatnonzero(reel.end >= 0)).max() > 5 * RATE
    for seed in range(6):
        found, _ = edit_of(loop_mode(reel), [Goal("A", 200.0, 200.0)], 1500, seed, reel=reel)
        way = np.concatenate([stretch.way for stretch in found.stretches])
        assert all(inside(ROOM.legal, x, y) for x, y in way[:, :2])


@pytest.mark.parametrize("make", [loop_mode, hybrid_mode])
def test_goals_are_reached(make):
    mode = make()
    done = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        goals = random_goals(ROOM, TOUCH + HEAD, 3, rng)
        found, table = edit_of(mode, goals, 1500, seed)
        ticks = measures.reached(table, goals, TOUCH, HEAD)
        done.append(~np.isnan(ticks))
        assert list(found.reached) == [-1 if np.isnan(t) else t for t in ticks]
    assert np.mean(done) >= (0.95 if make is hybrid_mode else 0.8)


@pytest.mark.parametrize("make", [loop_mode, hybrid_mode])
def test_a_seed_gives_one_animation_and_another_seed_another(make):
    goals = [Goal("A", 200.0, 200.0)]
    one, same, other = (edit_of(make(), goals, 400, seed) for seed in (7, 7, 8))
    pd.testing.assert_frame_equal(one[1], same[1])
    pd.testing.assert_frame_equal(one[0].considered(400), same[0].considered(400))
    assert not np.allclose(one[1]["x_px"], other[1]["x_px"])


def test_a_goal_that_no_loop_can_reach_is_not_reached_and_nothing_breaks():
    reel = film_of(swum([4.0] * 199), loops((5, 95), (50, 140)))  # one circle, 15 px across
    goals = [Goal("A", 700.0, 60.0)]
    mode = loop_mode(reel)
    found, table = edit_of(mode, goals, 800, 1, reel=reel)
    at = np.array([table["x_px"].iloc[0], table["y_px"].iloc[0]])
    assert np.hypot(*(at - goals[0][1:3])) > 250  # far away
    assert list(found.reached) == [-1] and set(table["goal"]) == {"A"}
    measured = measures.of_goals(table, goals, mode)
    assert measured == {"goals": 1.0, "goals_reached_pct": 0.0}
    assert len(table) == 800 and np.ptp(table["x_px"]) < 120


# --- loops mode: one decision


def crossing(wall=False):
    """Straight on to the right at y = 300; at row 20 circles to the left, to the right, or on."""
    table = table_of(swum([0.0] * 149), swum([3.0] * 149), swum([-3.0] * 149))
    pairs = [(20, 170, 0.2), (20, 320, 0.2), (140, 21, 0.2), (290, 171, 0.2), (440, 321, 0.2)]
    reel = film_of(table, loops(*pairs))
    arena = ARENA.copy()
    if wall:
        arena[:, 520:] = False
    mode = loop_mode(reel, tank(arena, 0.6 * LENGTH))
    fish = Fish(400.0, 300.0, 0.0, SPEED, IN_FILM, -1)
    fish.shown, fish.row, fish.since = np.full(len(table), -(10**9)), 19, 100
    return mode, fish


@pytest.mark.parametrize(
    ("at", "row"), [((700.0, 300.0), 20), ((400.0, 120.0), 170), ((400.0, 480.0), 320)]
)
def test_the_way_that_leads_to_the_goal_is_taken(at, row):
    for seed in range(5):
        mode, fish = crossing()
        found = mode.stretch(fish, np.array(at), "A", np.random.default_rng(seed))
        assert found.number[0] == row and found.new == (row != 20)
        assert found.way[0] == pytest.approx((400 + STEP, 300, 0))
        taken = [one for one in found.considered if one[4]]
        assert [one[0] for one in taken] == [row] and len(found.considered) == 3
        assert found.why.startswith("play on" if row == 20 else "jump, 0.20 steps")
        assert "towards A" in found.why and "3 ways" in found.why


def test_a_way_that_leaves_the_tank_fails_that_test():
    mode, fish = crossing(wall=True)
    options = mode.options(fish, np.array([440.0, 100.0]))
    assert list(options.rows) == [20, 170, 320]
    assert list(options.inside) == [False, True, True]
    assert np.isinf(options.value[0]) and options.ticks[0] < 31
    assert "1 leave the tank or end" in options.counts()
    assert considered(options, 1)[0][3] == "tank"


def test_a_way_that_leads_away_or_heads_away_fails_that_test():
    mode, fish = crossing()
    seconds = 75  # three, in ticks: so far is looked ahead, and no loop comes sooner
    place = np.array([400.0 + STEP, 300.0])
    seen = set()
    for angle in np.radians(np.arange(0, 360, 15)):
        at = place + 190.0 * np.array([np.cos(angle), -np.sin(angle)])
        options = mode.options(fish, at)
        for i, (turn, row) in enumerate(((0.0, 20), (3.0, 170), (-3.0, 320))):
            ticks = turn * np.arange(seconds)
            way = place + STEP * np.array(
                [np.cos(np.radians(ticks)).sum(), -np.sin(np.radians(ticks)).sum()]
            )
            touching = options.ticks[i] < seconds  # on the way
            towards = touching or np.hypot(*(at - way)) < 190.0
            heads = touching or abs(wrap_deg(bearing(*way, *at) - turn * seconds)) <= 90
            assert (options.rows[i], options.inside[i]) == (row, True)
            assert (options.towards[i], options.heads[i]) == (towards, heads)
            wanted = "" if towards and heads else "heading" if towards else "quadrant"
            assert considered(options, 0)[i][3] == wanted
            seen.add(wanted)
    assert len(seen) == 3


def test_in_words_how_many_ways_fail_which_test():
    yes = np.ones(4, bool)
    options = Options(
        np.arange(4), np.zeros(4), np.zeros(4), np.array([1.0, 2.0, 3.0, np.inf]), np.zeros(4), yes,
        np.array([True, False, False, True]), np.array([False, False, True, True]),
    )  # fmt: skip
    told = [one[3] for one in considered(options, 0)]
    assert told == ["heading", "quadrant", "quadrant", "passed over"]
    assert options.counts() == "4 ways, 2 lead away, 1 head away"
    assert not options.legal.any()


@pytest.mark.parametrize(("heading", "quadrant"), [(30.0, 1), (120.0, 2), (210.0, 3), (300.0, 4)])
def test_a_decision_names_the_quadrant_that_the_fish_swims_into(heading, quadrant):
    table = table_of(swum([0.0] * 99), swum([0.0] * 99))
    reel = film_of(table, loops((20, 120), (60, 21), (160, 121)))
    fish = Fish(400.0, 300.0, heading, SPEED, IN_FILM, -1)
    fish.shown, fish.row, fish.rot = np.full(len(table), -(10**9)), 30, heading
    angle = np.radians(heading)
    at = np.array([400 + 200 * np.cos(angle), 300 - 200 * np.sin(angle)])
    found = loop_mode(reel).stretch(fish, at, "A", np.random.default_rng(0))
    assert f"quadrant {quadrant} towards A" in found.why


def test_a_way_must_begin_inside_the_tank():
    mode, fish = crossing()
    back = np.array([180.0])  # out of the wall, into the tank
    for x, legal in ((742.0, True), (746.0, False)):
        assert inside(ROOM.legal, x, 300.0) == legal and inside(ROOM.legal, x - STEP, 300.0)
        found = mode.weigh(
            (x, 300.0), fish, [20], back, [0.0], [0.0], [0], np.array([300.0, 300.0])
        )
        assert list(found.inside) == [legal]


def test_no_jump_is_offered_before_the_stay_is_over():
    mode, fish = crossing()
    fish.since = mode.stay - 2
    assert list(mode.options(fish, np.array([400.0, 100.0])).rows) == [20]
    fish.since = mode.stay - 1
    assert list(mode.options(fish, np.array([400.0, 100.0])).rows) == [20, 170, 320]


def test_frames_that_were_just_seen_are_avoided():
    mode, fish = crossing()
    fish.tick = 1000
    fish.shown[171:300] = 990
    assert mode.jump_cost(fish, 320, 0.2) == pytest.approx(mode.jump_cost(fish, 170, 0.2))
    fish.shown[170] = 990
    assert mode.jump_cost(fish, 170, 0.2) > mode.jump_cost(fish, 320, 0.2) + 10


def test_the_best_is_chosen_and_equals_now_and_then():
    rng = np.random.default_rng(0)
    one = np.ones(3, bool)

    def options(*value):
        zero = np.zeros(3)
        return Options(np.arange(3), zero, zero, np.array(value), zero, one, one, one)

    assert {choose(options(1.0, 9.0, 9.0), one, RATE, rng) for _ in range(50)} == {0}
    assert {choose(options(1.0, 1.0, 9.0), one, RATE, rng) for _ in range(50)} == {0, 1}
    allowed = np.array([False, False, True])
    assert choose(options(1.0, 1.0, 9.0), allowed, RATE, rng) == 2
    assert choose(options(1.0, 1.0, 9.0), ~one, RATE, rng) is None


# --- what is written down


@pytest.mark.parametrize("make", [loop_mode, hybrid_mode])
def test_an_edit_list_and_what_was_weighed_are_what_their_schemas_say(make, tmp_path):
    found, table = edit_of(make(), [Goal("A", 200.0, 200.0)], 900, 1)
    save_table(tmp_path / "a.parquet", table, EDIT)
    back = load_table(tmp_path / "a.parquet", EDIT)
    assert list(back["tick"]) == list(range(900))
    weighed = found.considered(900)
    save_table(tmp_path / "b.parquet", weighed, CONSIDERED)
    again = load_table(tmp_path / "b.parquet", CONSIDERED)
    assert (again.groupby("tick")["taken"].sum() == 1).all()
    assert set(again["fails"]) <= {"", "tank", "quadrant", "heading", "passed over"}
    assert (again["value_s"].isna() <= again["fails"].isin(["tank", "passed over"])).all()
    taken = again[again["taken"]]
    assert taken["value_s"].notna().all()
    assert list(back["source"].iloc[taken["tick"]]) == list(taken["row"])
    told = back["decision"].iloc[taken["tick"]]
    sizes = again.groupby("tick").size()
    assert all(
        f"; {n} way{'s' * (n != 1)}" in text and text.startswith(("play on: ", "jump, "))
        for n, text in zip(sizes, told, strict=True)
    )  # fmt: skip
    film_ticks = back["kind"] == FRAME
    assert (film_ticks == (back["mode"] == LOOPS)).all()
    assert (film_ticks == (back["state"] == "film")).all()


def test_a_frame_is_named_by_its_row():
    reel = film_of(TABLE, PAIRS)
    found, table = edit_of(loop_mode(reel), [], 300, 1, reel=reel)
    assert list(table["source"]) == list(flat(found)[1][:300])


@pytest.mark.parametrize("make", [loop_mode, hybrid_mode])
@pytest.mark.parametrize("fade", [0, 3])
def test_a_cross_fade_begins_at_every_jump_and_switch_and_the_old_plays_on(make, fade):
    found, table = edit_of(make(stay_s=0.4), [Goal("A", 200.0, 200.0)], 1500, 2, fade)
    number = table["source"].to_numpy() // np.where(table["kind"] == FRAME, 1, ORIENTATIONS)
    kind, weight = table["kind"].to_numpy(), table["weight"].to_numpy(float)
    rotation = table["rotation_deg"].to_numpy(float)
    order_ = order().following
    begins = np.flatnonzero(flat(found)[3][:1500])
    begins = begins[begins > 0]
    switched = np.flatnonzero(kind[1:] != kind[:-1]) + 1
    frames = (kind[1:] == FRAME) & (kind[:-1] == FRAME)
    jumped = np.flatnonzero(frames & (np.diff(number) != 1) & (np.diff(number) != 0)) + 1
    assert set(switched) | set(jumped) <= set(begins)
    assert len(jumped) > 10 and (len(switched) > 3) == (make is hybrid_mode)
    fades = np.zeros(1500)
    for begin in begins:  # a later one begins anew
        stop = min(begin + fade, 1500)
        fades[begin:stop] = (1 - np.arange(1, fade + 1) / (fade + 1))[: stop - begin]
    assert weight == pytest.approx(fades)
    assert (table["partner"].notna() == (weight > 0)).all()
    for begin, after in pairwise(begins):
        old = number[begin - 1]
        for tick in range(begin, min(begin + fade, after)):
            old = order_[old] if kind[begin - 1] == SPRITE else old + int(REEL.more[old])
            row = table.iloc[tick]
            assert row["partner_kind"] == kind[begin - 1]
            if kind[begin - 1] == FRAME:
                assert row["partner"] == old
                turned = row["partner_rotation_deg"] - rotation[begin - 1]
                assert wrap_deg(turned) == pytest.approx(0, abs=1e-3)
            else:
                assert row["partner"] // ORIENTATIONS == old


def test_wandering_uses_much_of_the_tank_and_of_the_film():
    for mode in (loop_mode(), hybrid_mode()):
        _, table = edit_of(mode, [], 3000, 5)
        assert np.ptp(table["x_px"]) > 250 and np.ptp(table["y_px"]) > 250
        assert table["source"][table["kind"] == FRAME].nunique() > 300
        assert measures.longest_repeat(table) < 500


# --- hybrid


def test_hybrid_without_gateways_is_network_mode():
    goals = [Goal("A", 200.0, 200.0), Goal("B", 600.0, 500.0)]
    none = gateways().iloc[:0]
    for reel, gates in ((REEL, none), (film_of(TABLE, loops()), gateways())):
        mode = hybrid_mode(reel, gates)
        _, mine = edit_of(mode, goals, 1200, 3, reel=reel)
        _, wanted = edit_of(network(), goals, 1200, 3)
        pd.testing.assert_frame_equal(mine, wanted)


def test_gateways_that_lead_nowhere_are_not_taken():
    last = np.flatnonzero(~REEL.more)
    gates = gateways()
    gates = gates[gates["direction"] == "in"].iloc[: len(last)].assign(row=last)
    _, table = edit_of(hybrid_mode(gates=gates), [], 600, 1)
    assert (table["kind"] == SPRITE).all()


def test_without_a_way_out_the_fish_leaves_the_film_all_the_same():
    gates = gateways().query("direction == 'in'")
    found, table = edit_of(hybrid_mode(gates=gates), [], 2500, 1)
    left = [s.why for s in found.stretches if s.why.startswith("leave the film")]
    assert left and all(
        "without a gateway" in why and re.search(r"\d+ ways?, ", why) for why in left
    )
    assert table["kind"].nunique() == 2


def test_hybrid_switches_by_gateways_and_the_heading_goes_on():
    gates = gateways(every=1)
    _, table = edit_of(hybrid_mode(gates=gates), [Goal("A", 700.0, 100.0)], 3000, 2)
    kind, heading = table["kind"].to_numpy(), table["heading_deg"].to_numpy(float)
    ins = gates.query("direction == 'in'").groupby("sprite")["row"].agg(set)
    into = np.flatnonzero((kind[1:] == FRAME) & (kind[:-1] == SPRITE)) + 1
    out = np.flatnonzero((kind[1:] == SPRITE) & (kind[:-1] == FRAME)) + 1
    assert len(into) > 5 and len(out) > 5
    for tick in into:
        assert table["source"][tick] in ins[table["source"][tick - 1] // ORIENTATIONS]
        assert wrap_deg(heading[tick] - heading[tick - 1]) == pytest.approx(0, abs=1e-3)
    assert all("leave the film" in text for text in table["decision"][out])
    share = (table["mode"] == LOOPS).mean()
    assert 0.3 < share < 1


def test_a_fish_stays_with_the_network_for_half_a_second():
    _, table = edit_of(hybrid_mode(), [], 3000, 6)
    kind = (table["kind"] == FRAME).to_numpy()
    edges = np.flatnonzero(np.diff(kind)) + 1
    stays = [b - a for a, b in pairwise([0, *edges]) if not kind[a]]
    assert min(stays) >= round(0.5 * RATE) and len(stays) > 4


@pytest.mark.parametrize("slow", [True, False])
def test_a_gateway_to_a_tail_beat_is_taken_at_any_speed(slow):
    """After the film always comes a tail beat; the only way out leads to its fourth sprite."""
    count = len(MOTION.phases.state)
    phases = replace(
        MOTION.phases, state=np.full(count, ACCELERATE, np.int8),
        before=np.full(count, STRAIGHT, np.int8),
    )  # fmt: skip
    beats = NetworkMode(replace(MOTION, phases=phases), order(), Model(), ROOM, TOUCH, HEAD)
    gates = gateways(every=1).query("direction == 'out' and sprite == 3")
    mode = HybridMode(beats, loop_mode(), gates, 1.0)
    rng = np.random.default_rng(0)
    for row in rng.choice(np.flatnonzero(REEL.more), 30):
        fish = mode.begin(rng)
        fish.x, fish.y, fish.row, fish.state, fish.sprite = 400.0, 300.0, int(row), IN_FILM, -1
        fish.rot = float(rng.uniform(-180, 180))
        fish.heading = float(wrap_deg(REEL.heading[row] + fish.rot))
        fish.speed = beats.sprites.cycle_speed * (0.6 if slow else 1.3)
        angle = np.radians(fish.heading)
        at = np.array([400 + 150 * np.cos(angle), 300 - 150 * np.sin(angle)])
        left, found, gate = mode._out(fish, at, "A", rng)
        assert found.number[0] == 3 and gate is not None
        assert left.row == -1 and fish.row == row


# --- players, hulls


def test_there_are_as_many_players_as_the_film_allows():
    rest = MOTION, Model(), gateways(), ARENA, 0.6 * LENGTH, HEAD, 0.5, 0.4, 0.1, 1.0
    made = players(cast_of(), *rest)
    assert list(made) == [NETWORK, LOOPS, HYBRID]
    assert {fish.fade for fish in made.values()} == {round(0.1 * RATE)}
    for fish in made.values():
        assert fish.mode.touch_px == 0.5 * MOTION.body_length_px
        table = fish.play([Goal("A", 200.0, 200.0)], 200, np.random.default_rng(0))
        assert len(table) == 200
    reel = film_of(TABLE, loops())
    made = players(cast_of(reel), *rest)
    assert list(made) == [NETWORK, HYBRID]
    assert made[HYBRID].mode is made[NETWORK].mode
    tail = film_of(table_of(swum([0.0] * 99), swum([0.0] * 99)), loops((20, 150)))
    # A loop, but it leads only to an end.
    assert LOOPS not in players(cast_of(tail), *rest)


def test_outlines_of_frames_are_ahead_and_to_the_left():
    # A fish headed up the screen: its head above the centre, its left to the left.
    places = pd.DataFrame({"x_px": [100.0], "y_px": [50.0], "heading_deg": [90.0]})
    outline = np.array([[[100.0, 30.0], [95.0, 50.0], [100.0, 80.0]]])
    hull = frame_hulls(outline, places, np.array([2.0]))
    assert hull[0] == pytest.approx(np.array([[40, 0], [0, 10], [-60, 0]]), abs=1e-4)


def test_the_outline_of_a_frame_is_where_its_pixels_were():
    rng = np.random.default_rng(0)
    n = 50
    places = pd.DataFrame(
        {
            "x_px": rng.uniform(0, 900, n),
            "y_px": rng.uniform(0, 900, n),
            "heading_deg": rng.uniform(-180, 180, n),
        }
    )
    outline = places[["x_px", "y_px"]].to_numpy()[:, None] + rng.normal(0, 20, (n, 12, 2))
    ahead_, left = np.moveaxis(frame_hulls(outline, places, np.ones(n)), -1, 0)
    angle = np.radians(places["heading_deg"].to_numpy())[:, None]
    x = places["x_px"].to_numpy()[:, None] + ahead_ * np.cos(angle) - left * np.sin(angle)
    y = places["y_px"].to_numpy()[:, None] - ahead_ * np.sin(angle) - left * np.cos(angle)
    assert np.stack([x, y], -1) == pytest.approx(outline, abs=1e-3)


def test_the_widest_frames_are_barred():
    hull = np.array([[20.0, 0], [-20, 5]])
    hulls = np.repeat(hull[None].astype(np.float32), 1000, axis=0)
    hulls[::200] *= 3
    most, barred = reach([hull], hulls)
    assert most == pytest.approx(np.hypot(20, 5), rel=1e-6)
    assert list(np.flatnonzero(barred)) == list(range(0, 1000, 200))
    most, barred = reach([10 * hull], hulls)  # sprites are shown, so they must fit in
    assert most == pytest.approx(10 * np.hypot(20, 5)) and not barred.any()
