"""The search along a path: what is kept of its branches, what it finds, and how a plan is swum."""

import numpy as np
import pytest
from toy_film import (
    LENGTH,
    STEP,
    film_of,
    loops,
    matching_of,
    swum,
    table_of,
    waters_of,
)

import finloop.plan.search
from finloop.animate.memory import NEVER
from finloop.animate.paths import lay
from finloop.base.line import PX, Line
from finloop.plan.objectives import along_path
from finloop.plan.search import (
    BRANCH,
    RUN,
    Branch,
    SearchStart,
    keep,
    tick_row_shown,
    ways_on,
    weigh,
)

TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)
EIGHT = Line("eight", 400 + 200 * np.sin(TURN), 300 + 120 * np.sin(2 * TURN), PX, closed=True)


def laid(line, waters):
    return lay(line, waters.tank, waters.motion, None).route


@pytest.mark.parametrize("most", [1, 2, 7, 64])
def test_the_best_branches_are_kept_and_who_lost_one_is_known(most):
    rng = np.random.default_rng(most)
    totals = np.round(rng.normal(size=200), 1)  # some alike
    branches, over, n = np.zeros(most, BRANCH), np.zeros(len(totals), bool), 0
    for k, total in enumerate(totals):
        n = keep(branches, n, Branch(total, k, 2 * k, k, 0.5), over)
        assert n == min(k + 1, most)
        assert (np.diff(branches["total"][:n]) >= 0).all()
    assert branches["total"].tolist() == sorted(totals)[:most]
    assert sorted([*branches["first"], *np.flatnonzero(over)]) == list(range(len(totals)))
    assert (branches["way"] == 2 * branches["first"]).all()


def test_what_a_way_has_shown_is_found_in_all_of_its_runs():
    runs = np.array([(100, 3, -1), (40, 13, 0), (104, 33, 1)], RUN)
    # Rows 100-109 from tick 3 on, 40-59 from tick 13, and from tick 33 on 104 …
    for row, tick in ((100, 3), (103, 6), (59, 32), (104, 33), (108, 37), (60, NEVER), (39, NEVER)):
        assert tick_row_shown(runs, 2, row, 38) == tick
    assert tick_row_shown(runs, 2, 109, 38) == 12  # the last run has not come so far
    assert tick_row_shown(runs, 0, 40, 13) == NEVER


def looked(waters, route, beam, row=5, rot=0.0, place=(400.0, 300.0)):
    """What becomes of the ways on from a row, and the rows of the best, of a beam so wide."""
    follower, film = matching_of(waters).follower, waters.film
    every = ways_on(film, row, rot, True)
    here = SearchStart(*place, 1, 2.0, 99, np.zeros((0, 3), np.int64))
    rules = follower._alone._replace(beam=beam, horizon=40, again=0.0)
    path = along_path(route, follower.steering)
    return follower._film, weigh(follower._film, every, here, path, rules)


def test_whoever_looks_at_more_ways_finds_none_that_is_dearer():
    """A beam that loses nothing finds the cheapest way; no narrower one a cheaper."""
    waters = waters_of()
    route = laid(EIGHT, waters)
    values = []
    for beam in (1, 3, 10, 10_000):
        _, (_, found, _) = looked(waters, route, beam)
        values.append(found.value.min())
    assert not found.over.any() and np.isfinite(values[-1])
    assert min(values) >= values[-1] - 1e-9 and values[0] > values[-1]


def test_the_best_way_is_the_film_s_between_jumps_that_the_film_has():
    waters = waters_of()
    footage, (_, _, rows) = looked(waters, laid(EIGHT, waters), 100)
    ends, legs = rows + np.minimum(footage.leg[rows], 40), footage.leg[rows]
    assert legs.sum() >= 40
    film = waters.film
    for end, begins in zip(ends[:-1], rows[1:], strict=True):
        to = film.to[film.start[film.end[end]] : film.start[film.end[end] + 1]]
        assert begins == end or begins in to


def test_the_way_that_turns_as_the_path_does_is_taken():
    """A straight film, whose fish may jump to one that turns left, or to one that turns right."""
    for side in (1, -1):
        table = table_of(swum([0.0] * 60), swum([4.0] * 90), swum([-4.0] * 90))
        waters = waters_of(film_of(table, loops((20, 66), (20, 157), (70, 140), (162, 230))))
        radius = STEP / np.radians(4.0)
        bend = np.linspace(0, np.pi, 90)
        x = np.append(200.0, 300 + radius * np.sin(bend))
        y = np.append(300.0, 300 - side * radius * (1 - np.cos(bend)))
        route = laid(Line("bend", x, y, PX), waters)
        start = (300.0 - 15 * STEP, 300.0)
        _, (_, _, rows) = looked(waters, route, 100, row=5, place=start)
        taken = rows[(rows > 60) & (rows != 5)]
        assert len(taken) and ((taken < 151) == (side > 0)).all()


def test_tracks_shorter_than_a_stride_are_swum_by_and_left_in_time():
    table = table_of(*(swum([rate] * 13, 40.0 * rate) for rate in (0.0, 3.0, -3.0, 6.0, -6.0)))
    rng = np.random.default_rng(0)
    ends = np.concatenate([14 * k + np.array([2, 9, 13]) for k in range(5)])
    pairs = {(a, b) for a in ends for b in rng.choice(ends, 6) if abs(int(a) - b) > 13}
    waters = waters_of(film_of(table, loops(*sorted(pairs))), stay=0.4, path_stride=2.0)
    player, route = matching_of(waters), laid(EIGHT, waters)
    rng = np.random.default_rng(1)
    state = player.begin(rng, route)
    for _ in range(60):
        stretch, state = player.step(state, route, rng)
        assert 0 < len(stretch.way) <= 14 and (np.diff(stretch.number) == 1).all()


def counted_searches(monkeypatch):
    searches = []
    inner = finloop.plan.search.weigh
    monkeypatch.setattr(
        finloop.plan.search, "weigh", lambda *all_: searches.append(1) or inner(*all_)
    )
    return searches


def steps(player, route, state, ticks, rng):
    """So many ticks and more, stretch by stretch."""
    swum_ = []
    while sum(len(one.way) for one in swum_) < ticks:
        stretch, state = player.step(state, route, rng)
        swum_.append(stretch)
    return swum_, state


def test_a_fish_alone_swims_by_its_plan_and_beside_others_looks_after_every_stride(monkeypatch):
    waters = waters_of()
    player, route, rng = matching_of(waters), laid(EIGHT, waters), np.random.default_rng(0)
    begun = player.begin(rng, route)
    searches = counted_searches(monkeypatch)
    alone, state = steps(player, route, begun, 300, rng)
    assert len(searches) < len(alone) / 2
    assert len(searches) <= 1 + 300 / (waters.ticks(waters.settings.path_plan) / 2)
    while not state.path.runs:
        _, state = player.step(state, route, rng)
    searches.clear()
    other = np.array([[state.fish.x + 2 * LENGTH, state.fish.y, 0.0, 0.0]])
    beside = player.among(state, other[:, None])
    assert beside.fish.company.near == 1
    stretch, after = player.step(beside, route, rng)
    assert len(searches) == 1 and sum(run.ticks for run in after.path.runs) <= 6
    assert len(stretch.way) <= player.follower.rules.stride


def test_no_more_of_a_plan_is_swum_than_was_looked_at():
    for horizon in (7, 40, 41):
        waters = waters_of()
        follower = matching_of(waters).follower
        follower._alone = follower._alone._replace(horizon=horizon)
        every = ways_on(waters.film, 5, 0.0, True)
        here = SearchStart(400.0, 300.0, 1, 2.0, 99, np.zeros((0, 3), np.int64))
        plan = follower._best(follower._film, every, here, 0.0, laid(EIGHT, waters))
        assert plan.ticks.sum() == horizon
        assert sum(run.ticks for run in plan.runs(10**6)) == horizon


def test_a_plan_is_given_up_for_another_path_and_where_it_is_cut(monkeypatch):
    waters = waters_of()
    player, rng = matching_of(waters), np.random.default_rng(0)
    route = laid(EIGHT, waters)
    state = player.begin(rng, route)
    while not state.path.runs:
        stretch, then = player.step(state, route, rng)
        before, state = state, then
    searches = counted_searches(monkeypatch)
    player.step(state, route, rng)
    assert not searches
    player.step(state, laid(EIGHT._replace(y=EIGHT.y + 40), waters), rng)
    assert len(searches) == 1
    _, cut = player.cut(before, stretch, 1)
    assert cut.path.runs == ()
