"""The search of mode `matching`: against every way there is, as laws, and what it keeps."""

import numpy as np
import pytest
from toy_film import (
    ARENA,
    DELTA,
    LENGTH,
    RATE,
    STEP,
    arc_track,
    film_of,
    film_world_of,
    loops,
    matching_of,
    open_tank,
    random_film,
    rich_film,
    spot,
    table_of,
)

from finloop.animate.arena import Tank, is_legal_point, make_tank
from finloop.animate.kinematics import bearing, touches_target
from finloop.animate.memory import NEVER, last_on_screen
from finloop.animate.paths import lay_path
from finloop.animate.state import State
from finloop.base.line import PX, Line
from finloop.distance.picture import BODY, FILM
from finloop.edit.schema import TERMS, WAITING, Goal
from finloop.features.table import wrap_deg
from finloop.plan.cost import CHANCE, LAG, RARITY, REPEAT, SEAM, CostWeights, repeat_cost
from finloop.plan.objectives import (
    estimate_angle_deg,
    path_objective,
    target_objective,
)
from finloop.plan.search import (
    EXTENSION,
    RANKED,
    RUN,
    Beam,
    Candidates,
    Extension,
    SearchStart,
    beam_search,
    film_candidates,
    insert_extension,
    tick_row_shown,
)
from finloop.plan.search_graph import search_graph
from finloop.plan.walls import tank_bounds

WEIGHTS = CostWeights(3.0, 5.0, 4, 24, 6.0, 20.0, 300.0)
"""Of a fish that does 3 px and 5° a tick."""
NOTHING = np.zeros((0, 3), np.int64)
TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)
EIGHT = Line("eight", 400 + 200 * np.sin(TURN), 300 + 120 * np.sin(2 * TURN), PX, closed=True)


def candidates_of(rows, rotations_deg, terms=None):
    """Candidates that are no jumps; terms (k, t) of what each costs."""
    n = len(rows)
    terms = np.zeros((n, len(TERMS))) if terms is None else terms
    return Candidates(np.asarray(rows), rotations_deg, np.zeros(n), np.zeros(n, bool), terms)


# --- against a slow search


def slow_leg(reel, legal, place, rotation_deg, row, left, stride, aim):
    """A leg in strides: the place, the row (−1: no farther), its ticks, whether it touches."""
    angle, t = np.radians(rotation_deg), 0
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    stop, to_end = row, 0
    while reel.has_next[stop] and not (to_end >= stride and reel.jump_slot[stop] >= 0):
        stop, to_end = stop + 1, to_end + 1
    left = min(left, to_end)
    if left == 0:
        return place, -1, 0, False
    while left > 0:
        ticks = min(stride, left)
        for _ in range(ticks):
            place, row = place + turn @ (reel.dx[row], reel.dy[row]), row + 1
        t, left = t + ticks, left - ticks
        if not is_legal_point(legal, *place):
            return place, -1, t - ticks, False
        goes_on = reel.has_next[row] and reel.recurrent[row + 1]
        if goes_on and touches_target(*place, reel.heading[row] + rotation_deg, aim):
            return place, row, t, True
    return place, row, t, False


def slow_search(reel, legal, start, rotation_deg, row, aim, weights, horizon):
    """Every way there is, one after the other: the value of the best, and ticks."""
    found, longest = [], 0

    def repeat(row, t, shown):
        last = row + weights.stride - 1
        tick = max(last_on_screen(start.recent, row, last), shown.get(last, NEVER))
        return 20 * max(0, 1 - (start.tick + t - tick) / 300)

    def follow(place, rotation_deg, row, t, cost, shown):
        nonlocal longest
        first, before = row, t
        place, row, ticks, touched = slow_leg(
            reel, legal, place, rotation_deg, row, horizon - t, weights.stride, aim
        )
        t += ticks
        longest = max(longest, t)
        if row < 0:
            return
        shown = shown | {first + k: start.tick + before + k for k in range(ticks)}
        cost += reel.rarity_sum[row] - reel.rarity_sum[first]
        if not reel.recurrent[row]:
            return
        heading = reel.heading[row] + rotation_deg
        if touched:
            found.append((t + cost, t))
            return
        if t >= horizon:
            off = abs(wrap_deg(bearing(*place, aim.x, aim.y) - heading))
            found.append((t + cost + np.hypot(*(place - aim[:2])) / 3 + off / 5, t))
            return
        if reel.has_next[row] and reel.recurrent[row + 1]:
            follow(place, rotation_deg, row, t, cost + repeat(row, t, shown), shown)
        if reel.jump_slot[row] < 0:
            return
        for e in range(reel.start[reel.jump_slot[row]], reel.start[reel.jump_slot[row] + 1]):
            other = reel.to[e]
            if not reel.has_next[other : other + weights.stride].all():
                continue  # the film ends too soon
            price = 6 * reel.seam[e] + repeat(other, t, shown)
            turned = heading - reel.heading[other] if reel.jumps_keep_heading else rotation_deg
            follow(place, turned, other, t, cost + price, shown)

    place = np.array([start.x, start.y])
    if reel.recurrent[row] and is_legal_point(legal, *place):
        follow(place, rotation_deg, row, 0, 0.0, {})
    return min(found) if found else (np.inf, longest)


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_looking_ahead_finds_what_a_search_of_every_way_finds(pose):
    rng = np.random.default_rng(2)
    ends = dict.fromkeys(("none", "some"), 0)
    for _ in range(15):
        table, pairs, barred = random_film(rng)
        reel = film_of(table, pairs, pose, barred=barred)
        n = len(table)
        legal = np.zeros((90, 90), bool)
        legal[5 : int(rng.integers(40, 85)), 5:85] = True
        rows = np.flatnonzero(reel.has_next)
        rotations_deg, every = rng.uniform(-180, 180, len(rows)), np.arange(n)
        recent = np.stack([every, every, rng.integers(-500, 500, n)], 1)
        start = SearchStart(rng.uniform(20, 40), rng.uniform(20, 40), 500, recent)
        aim = spot(*rng.uniform(-40, 130, 2))
        horizon, stride = (int(rng.integers(2, top)) for top in (20, 4))
        weights = WEIGHTS._replace(stride=stride, beam=50_000)
        bounds = tank_bounds(Tank(legal, legal, np.zeros((2, 90, 90), np.int32)))
        graph = search_graph(reel, bounds, weights, 5)
        terms = np.zeros((len(rows), len(TERMS)))
        terms[:, CHANCE] = rng.uniform(0, 9, len(rows))
        made = candidates_of(rows, rotations_deg, terms)
        found, _ = beam_search(graph, made, start, target_objective(aim), weights, horizon)
        assert not found.displaced.any()
        for i, row in enumerate(rows):
            value, ticks = slow_search(
                reel, legal, start, rotations_deg[i], row, aim, weights, horizon
            )
            # The angle to the goal is estimated, to 0.004° of 5° a tick.
            assert found.costs[i] - terms[i, CHANCE] == pytest.approx(value, abs=1e-3)
            if np.isfinite(value):
                assert found.terms[i].sum() == pytest.approx(found.costs[i])
                assert found.ticks[i] == ticks
            ends["some" if np.isfinite(value) else "none"] += 1
    assert min(ends.values()) > 10


# --- laws


def test_after_a_jump_the_film_plays_for_a_stride():
    """Branches of single ticks would cost least for their leg, and crowd out all others."""
    rng, legal = np.random.default_rng(3), np.ones((90, 90), bool)
    bounds = tank_bounds(Tank(legal, legal, np.zeros((2, 90, 90), np.int32)))
    for stride in (1, 3, 6):
        table, pairs, barred = random_film(rng)
        film = film_of(table, pairs, BODY, barred=barred)
        graph = search_graph(film, bounds, WEIGHTS._replace(stride=stride), 5)
        to = graph.film.to[:, None] + np.arange(stride)
        assert film.has_next[to].all()
    assert 0 < len(to) < len(film.to)


def test_the_angle_of_a_cosine_is_estimated_to_a_fraction_of_a_degree():
    cosines = np.append(np.linspace(-1, 1, 2001), [-1 - 1e-12, 1 + 1e-12])
    angles = np.array([estimate_angle_deg(cosine) for cosine in cosines])
    assert np.abs(angles - np.degrees(np.arccos(np.clip(cosines, -1, 1)))).max() < 0.0045
    assert angles[0] == 180 and angles[-1] == 0


def wanderer(reel, room, rows, rotations_deg, aim, beam=24, place=(400.0, 300.0), horizon=40):
    graph = search_graph(reel, tank_bounds(room), WEIGHTS, 5)
    start, weights = SearchStart(*place, 0, NOTHING), WEIGHTS._replace(beam=beam)
    return beam_search(
        graph, candidates_of(rows, rotations_deg), start, target_objective(aim), weights, horizon
    )


def test_more_beam_is_never_worse_and_a_narrow_one_says_what_it_gave_up():
    rng, given_up, reel = np.random.default_rng(3), 0, rich_film()
    for _ in range(20):
        rows = rng.choice(np.flatnonzero(reel.recurrent & reel.has_next), 12)
        rotations_deg, aim = rng.uniform(-180, 180, 12), spot(*rng.uniform(100, 500, 2))
        asked = reel, open_tank(), rows, rotations_deg, aim
        narrow, wide = (wanderer(*asked, beam, horizon=16)[0] for beam in (4, 100_000))
        assert (narrow.costs >= wide.costs - 1e-9).all() and not wide.displaced.any()
        assert narrow.costs.min() < np.inf
        assert not (narrow.displaced & np.isfinite(narrow.costs)).any()
        given_up += narrow.displaced.sum()
    assert given_up


def room_of(arena):
    return make_tank(arena, 0.6 * LENGTH)


def test_turning_the_tank_turns_the_plan():
    """A quarter turn, of the tank, the fish and its aim: the same rows at the same cost."""
    rng, reel = np.random.default_rng(5), rich_film()
    arena = np.zeros((601, 601), bool)
    arena[20:580, 60:400] = True
    turned = np.rot90(arena)  # anticlockwise as seen
    for _ in range(10):
        rows = rng.choice(np.flatnonzero(reel.recurrent & reel.has_next), 8)
        rotations_deg, (x, y) = rng.uniform(-180, 180, 8), rng.uniform(120, 300, 2).round()
        aim_x, aim_y = rng.uniform(100, 380, 2).round()
        one, here = wanderer(
            reel, room_of(arena), rows, rotations_deg, spot(aim_x, aim_y), 500, (x, y)
        )
        other, there = wanderer(
            reel,
            room_of(turned),
            rows,
            rotations_deg + 90,
            spot(aim_y, 600 - aim_x),
            500,
            (y, 600 - x),
        )
        assert one.costs == pytest.approx(other.costs, abs=1e-6)
        assert here.tolist() == there.tolist()


def test_a_mirrored_tank_gives_the_mirrored_plan():
    """Film, tank and fish upside down: the same rows at the same cost."""
    rng = np.random.default_rng(6)
    parts = (arc_track([4.0] * 200), arc_track([-3.0] * 200, 30.0), arc_track([0.0] * 200, 200.0))
    pairs = loops(*((int(a), int(b)) for a, b in rng.integers(5, 595, (60, 2)) if abs(a - b) > 20))
    table, other_table = table_of(*parts), table_of(*parts)
    other_table["y_px"] = 600 - other_table["y_px"]
    other_table["heading_deg"] = wrap_deg(-other_table["heading_deg"].to_numpy(float))
    reel, flipped = film_of(table, pairs), film_of(other_table, pairs)
    arena = np.zeros((601, 801), bool)
    arena[20:400, 60:700] = True
    for _ in range(10):
        rows = rng.choice(np.flatnonzero(reel.recurrent & reel.has_next), 8)
        rotations_deg, (x, y) = rng.uniform(-180, 180, 8), rng.uniform(120, 300, 2).round()
        aim_x, aim_y = rng.uniform(100, 380, 2).round()
        one, here = wanderer(
            reel, room_of(arena), rows, rotations_deg, spot(aim_x, aim_y), 500, (x, y)
        )
        other, there = wanderer(
            flipped, room_of(arena[::-1].copy()), rows, -rotations_deg, spot(aim_x, 600 - aim_y), 500,
            (x, 600 - y),
        )  # fmt: skip
        assert one.costs == pytest.approx(other.costs, abs=1e-6)
        assert here.tolist() == there.tolist()


def test_the_jumps_of_a_row_are_there_the_cheapest_first():
    for reel in (rich_film(), matching_of(film_world_of()).film.graph.film):
        for row in np.flatnonzero(reel.jump_slot >= 0):
            first, last = reel.start[reel.jump_slot[row] : reel.jump_slot[row] + 2]
            assert (np.diff(reel.seam[first:last]) >= 0).all()


def test_film_just_seen_costs_less_and_less():
    costs = [repeat_cost(ticks_ago, WEIGHTS) for ticks_ago in (0.0, 75.0, 300.0, 1e9)]
    assert costs == pytest.approx([20, 15, 0, 0])


def test_a_fish_that_wanders_searches_with_the_whole_beam_where_few_branches_find_none():
    """In a narrow tank a quarter of the beam often finds none; the planner searches again."""
    arena = np.zeros((200, 200), bool)
    arena[20:180, 20:180] = True
    world = film_world_of(room_=room_of(arena), beam=12, wander="film")
    p, few = world.settings, world.cost_weights._replace(beam=4)
    horizon = world.to_ticks(p.replan_interval_deltas) + world.to_ticks(p.look_ahead_deltas)
    planner, rng, ends, ends_of_few = matching_of(world), np.random.default_rng(6), 0, 0
    for _ in range(200):
        state = planner.begin(rng)
        if not world.film.has_next[state.fish.row]:
            continue
        made, start = planner.film.candidates(state.fish, 0.0, 0.0)
        objective = target_objective(spot(100, 100)._replace(free=True))
        found, _ = beam_search(planner.film.graph, made, start, objective, few, horizon)
        ends_of_few += np.isinf(found.costs).all()
        stretch, _ = planner.plan(state, None, rng)
        ends += stretch.options is None or np.isinf(stretch.options.costs).all()
    assert ends < 0.85 * ends_of_few


WEIGHT_OF = {
    SEAM: "discontinuity_cost", REPEAT: "repeat_cost", RARITY: "rarity_weight", LAG: "rest_cost",
}  # fmt: skip


@pytest.mark.parametrize("term", WEIGHT_OF)
def test_a_term_that_is_switched_off_costs_nothing(term):
    planner, rng = matching_of(film_world_of(**{WEIGHT_OF[term]: 0.0})), np.random.default_rng(0)
    state, steps = planner.begin(rng), 0
    while steps < 20:
        stretch, state = planner.plan(state, Goal("A", 600.0, 100.0), rng)
        if stretch.options is not None:
            steps += 1
            assert (stretch.options.terms[:, term] == 0).all()
    assert ARENA[int(state.fish.y), int(state.fish.x)]


# --- what is kept of it


@pytest.mark.parametrize("most", [1, 2, 7, 64])
def test_the_best_branches_are_kept_and_who_lost_one_is_known(most):
    rng = np.random.default_rng(most)
    totals = np.round(rng.normal(size=200), 1)  # some alike
    none, ranking = np.zeros(0), np.zeros(most, RANKED)
    beam = Beam(none, none, np.zeros(most, EXTENSION), ranking, none, none, none)
    over, n = np.zeros(len(totals), bool), 0
    for k, total in enumerate(totals):
        n = insert_extension(beam, n, Extension(total, k, 2 * k, k, 0.5), over)
        assert n == min(k + 1, most)
        assert (np.diff(ranking["cost"][:n]) >= 0).all()
    kept = beam.extensions[ranking["number"]]
    firsts = kept["candidate"]
    assert ranking["cost"].tolist() == totals[firsts].tolist() == sorted(totals)[:most]
    assert sorted([*firsts, *np.flatnonzero(over)]) == list(range(len(totals)))
    assert (kept["branch"] == 2 * firsts).all()


def test_what_a_way_has_shown_is_found_in_all_of_its_runs():
    runs = np.array([(100, 3, -1), (40, 13, 0), (104, 33, 1)], RUN)
    # Rows 100-109 from tick 3 on, 40-59 from tick 13, and from tick 33 on 104 …
    for row, tick in ((100, 3), (103, 6), (59, 32), (104, 33), (108, 37), (60, NEVER), (39, NEVER)):
        assert tick_row_shown(runs, 2, row, 38) == tick
    assert tick_row_shown(runs, 2, 109, 38) == 12  # the last run has not come so far
    assert tick_row_shown(runs, 0, 40, 13) == NEVER


# --- along a path


def lay_route(line, world):
    return lay_path(line, world.tank, world.motion, None).route


def search_route(world, route, beam, row=5, rotation_deg=0.0, place=(400.0, 300.0)):
    """The graph, what becomes of the ways on from a row along a path, the rows of the best."""
    graph, film = matching_of(world).film.graph, world.film
    made = film_candidates(film, row, rotation_deg)
    start = SearchStart(*place, 1, NOTHING)
    weights = world.cost_weights._replace(beam=beam, repeat=0.0)
    return graph, *beam_search(
        graph, made, start, path_objective(route, world.steering), weights, 40
    )


def test_along_a_path_a_beam_that_loses_nothing_finds_the_cheapest_way():
    world, values = film_world_of(), []
    route = lay_route(EIGHT, world)
    for beam in (1, 10, 20_000):
        _, found, _ = search_route(world, route, beam)
        values.append(found.costs.min())
    assert not found.displaced.any() and np.isfinite(values[-1])
    assert min(values) >= values[-1] - 1e-9 and values[0] > values[-1]


def test_the_best_way_is_the_film_s_between_jumps_that_the_film_has():
    world = film_world_of()
    graph, _, rows = search_route(world, lay_route(EIGHT, world), 100)
    legs = graph.nodes["leg"][rows]
    ends = rows + np.minimum(legs, 40)
    assert legs.sum() >= 40
    film = world.film
    for end, begins in zip(ends[:-1], rows[1:], strict=True):
        to = film.to[film.start[film.jump_slot[end]] : film.start[film.jump_slot[end] + 1]]
        assert begins == end or begins in to


def test_the_way_that_turns_as_the_path_does_is_taken():
    """A straight film, whose fish may jump to one that turns left, or to one that turns right."""
    for side in (1, -1):
        table = table_of(arc_track([0.0] * 60), arc_track([4.0] * 90), arc_track([-4.0] * 90))
        world = film_world_of(film_of(table, loops((20, 66), (20, 157), (70, 140), (162, 230))))
        radius = STEP / np.radians(4.0)
        bend = np.linspace(0, np.pi, 90)
        x = np.append(200.0, 300 + radius * np.sin(bend))
        y = np.append(300.0, 300 - side * radius * (1 - np.cos(bend)))
        route = lay_route(Line("bend", x, y, PX), world)
        _, _, rows = search_route(world, route, 100, row=5, place=(300.0 - 15 * STEP, 300.0))
        taken = rows[(rows > 60) & (rows != 5)]
        assert len(taken) and ((taken < 151) == (side > 0)).all()


def test_tracks_shorter_than_a_stride_are_swum_by_and_left_in_time():
    table = table_of(*(arc_track([rate] * 13, 40.0 * rate) for rate in (0.0, 3.0, -3.0, 6.0, -6.0)))
    rng = np.random.default_rng(0)
    ends = np.concatenate([14 * k + np.array([2, 9, 13]) for k in range(5)])
    pairs = {(a, b) for a in ends for b in rng.choice(ends, 6) if abs(int(a) - b) > 13}
    world = film_world_of(film_of(table, loops(*sorted(pairs))), search_step_deltas=2.0)
    planner, route = matching_of(world), lay_route(EIGHT, world)
    rng = np.random.default_rng(1)
    state = planner.begin(rng, route)
    for _ in range(60):
        stretch, state = planner.plan(state, route, rng)
        assert 0 < len(stretch.trajectory) <= 14 and (np.diff(stretch.number) == 1).all()


def test_a_fish_swims_by_its_plan_alone_and_beside_others_that_are_not_in_its_way():
    world = film_world_of()
    planner, route, rng = matching_of(world), lay_route(EIGHT, world), np.random.default_rng(0)
    state, ticks, searches, stretches = planner.begin(rng, route), 0, 0, 0
    while ticks < 300:
        stretch, state = planner.plan(state, route, rng)
        ticks, stretches = ticks + len(stretch.trajectory), stretches + 1
        searches += stretch.options is not None
    assert searches < stretches / 2
    assert searches <= 1 + 300 / (world.to_ticks(world.settings.path_commit) / 2)
    while not state.progress.runs:
        _, state = planner.plan(state, route, rng)
    run, _ = planner.plan(state, route, rng)
    assert run.options is None
    clear = np.array([[state.fish.x + 2 * LENGTH, state.fish.y, 0.0, 0.0]])
    beside = planner.with_obstacles(state, clear[:, None])
    assert beside.fish.obstacles.near_count == 1
    found, _ = planner.plan(beside, route, rng)
    assert found.options is None and np.array_equal(found.trajectory, run.trajectory)
    # A fish in the way: the run is cut before it, and the next plan begins anew.
    ahead = np.append(run.trajectory[-1], run.number[-1])
    found, cut = planner.plan(planner.with_obstacles(state, ahead[None, None]), route, rng)
    assert len(found.trajectory) < len(run.trajectory) or found.decision.reason == WAITING
    assert cut.progress.runs == ()


def test_a_plan_is_given_up_for_another_path_and_where_it_is_cut():
    world = film_world_of()
    planner, rng = matching_of(world), np.random.default_rng(0)
    route = lay_route(EIGHT, world)
    state = planner.begin(rng, route)
    while not state.progress.runs:
        stretch, then = planner.plan(state, route, rng)
        before, state = state, then
    assert planner.plan(state, route, rng)[0].options is None
    other = lay_route(EIGHT._replace(y=EIGHT.y + 40), world)
    assert planner.plan(state, other, rng)[0].options is not None
    assert planner.plan(state, Goal("A", 100.0, 100.0), rng)[0].options is not None
    _, cut = planner.cut(before, stretch, 1)
    assert cut.progress.runs == ()


def test_nothing_is_swum_that_was_not_looked_at():
    for commit, ahead in ((1.0, 0.2), (4.0, 0.2), (8.0, 3.0)):
        world = film_world_of(replan_interval_deltas=commit, look_ahead_deltas=ahead)
        planner, rng = matching_of(world), np.random.default_rng(1)
        state = State(planner.begin(rng).fish, np.zeros(2))
        for _ in range(40):
            stretch, state = planner.plan(state, Goal("A", 700.0, 100.0), rng)
            planned = len(stretch.trajectory) + sum(run.ticks for run in state.progress.runs)
            assert planned <= max(commit + ahead, 2) * DELTA + world.cost_weights.stride
            assert stretch.trajectory.shape[0] < 10 * RATE
