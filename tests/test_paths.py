"""Paths to be swum: what is read and refused, feet on a path, steering, following, what is reported."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import toy_film as toy

from finloop.animate.paths import lay_path
from finloop.animate.route import Route, due_along, find_nearest_on_route, point_along
from finloop.animate.shoal import animate_fish
from finloop.base.errors import FinloopError
from finloop.base.line import MM, PX, TANK, Line
from finloop.edit.schema import PATH
from finloop.features.line import track_as_path
from finloop.io.line import load_line
from finloop.io.table import save_table
from finloop.plan.advance import swim_trajectory
from finloop.plan.cost import Steering
from finloop.plan.matching_settings import MatchingSettings
from finloop.plan.objectives import ANYWHERE, path_objective
from finloop.plan.path_measures import (
    DEPARTURES,
    PATH_ROWS,
    find_departures,
    path_metrics,
    path_table,
    swimming_limits,
)
from finloop.plan.search_graph import search_graph
from finloop.plan.walls import tank_bounds
from finloop.plots.path import draw_path as figure

TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)
EIGHT = Line("eight", 400 + 200 * np.sin(TURN), 300 + 120 * np.sin(2 * TURN), PX, closed=True)


def lay_line(line, **changes):
    own_world = toy.film_world_of(**changes)
    return lay_path(line, own_world.tank, own_world.motion, None)


# --- what is read


def test_a_table_says_its_unit_or_is_told_it(tmp_path):
    (tmp_path / "a.csv").write_text("X,y,time_s\n0.1,0.2,0\n0.5,0.25,1.5\n")
    line = load_line(tmp_path / "a.csv", TANK)
    assert (list(line.x), list(line.y), line.unit) == ([0.1, 0.5], [0.2, 0.25], TANK)
    assert list(line.time_s) == [0, 1.5] and line.heading_deg is None and not line.closed
    table = pa.table({"x_mm": [1, 2], "y_mm": [3.0, 4.0], "heading_deg": [0, 90]})
    pq.write_table(table, tmp_path / "b.parquet")
    line = load_line(tmp_path / "b.parquet", TANK)
    assert (list(line.y), list(line.heading_deg), line.unit) == ([3, 4], [0, 90], MM)


def drawing(*paths):
    shapes = "".join(f'<path d="{d}"/>' for d in paths)
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="200" height="100">{shapes}</svg>'


def test_an_svg_has_one_path_in_px_or_in_shares_of_its_picture(tmp_path):
    file = tmp_path / "a.svg"
    file.write_text(drawing("M 20 50 L 100 50 L 100 80 Z"))
    px, share = load_line(file, PX), load_line(file, TANK)
    assert px.closed and list(px.x) == [20, 100, 100] and list(px.y) == [50, 50, 80]
    assert list(share.x) == [0.1, 0.5, 0.5] and list(share.y) == [0.5, 0.5, 0.8]


@pytest.mark.parametrize(
    "name, text, came",
    [
        ("a.csv", "x,y\n1,2\n", "1 place,"),
        ("a.csv", "x,y\n1,2\n1,2\n", "2 places, none of which lies apart"),
        ("a.csv", "x,y\n1,2\n,3\n4,5\n", "1 of 3 rows have no x, row 1 first"),
        ("a.csv", "x,y,time_s\n1,2,0\n3,4,2\n5,6,1\n", "time decreases 1 times"),
        ("a.csv", "x,y\n1,1\n2,inf\n", "have no y"),
        ("a.csv", "x,z\n1,2\n3,4\n", "the columns x, z"),
        ("a.csv", "x,y\n1,2\nhere,4\n", "holds no numbers"),
        ("a.csv", "", "cannot be read as a table"),
        ("a.parquet", "x,y\n", "cannot be read as a table"),
        ("a.txt", "1 2", "no file that finloop can read a path from"),
        ("a.svg", drawing(), "has no contour"),
        ("a.svg", drawing("M 1 1 L 2 2", "M 3 3 L 4 4"), "has 2 paths"),
    ],
)
def test_what_is_no_path_is_refused_in_words(tmp_path, name, text, came):
    (tmp_path / name).write_text(text)
    with pytest.raises(FinloopError, match=came):
        load_line(tmp_path / name, PX)


def test_a_track_of_the_film_has_times_and_headings_and_an_unknown_one_is_refused():
    tracks = toy.arc_track([5.0] * 30, track=3), toy.arc_track([0.0] * 9, track=8)
    table = pd.concat(tracks, ignore_index=True)
    table["time_s"] = table["frame"] / toy.RATE
    line = track_as_path(table, "track:8")
    assert list(line.rows) == list(range(31, 41)) and line.time_s[1] == 1 / toy.RATE
    assert list(line.heading_deg) == [0] * 10 and line.unit == PX
    for name in ("track:9", "track:fish"):
        with pytest.raises(FinloopError, match="longest: 3, 8"):
            track_as_path(table, name)


# --- in the tank


def test_shares_and_mm_become_px_and_what_is_outside_is_refused():
    corners = Line("a", np.array([0.25, 0.75]), np.array([0.5, 0.5]), TANK)
    asked = lay_line(corners).asked
    assert asked.x[[0, -1]] == pytest.approx([30 + 0.25 * 739, 30 + 0.75 * 739])
    own_world = toy.film_world_of()
    mm = corners._replace(x=np.array([10.0, 20.0]), y=np.array([10.0, 10.0]), unit=MM)
    assert lay_path(mm, own_world.tank, own_world.motion, 0.05).asked.x[-1] == pytest.approx(400)
    with pytest.raises(FinloopError, match="scale is not known"):
        lay_line(mm)
    with pytest.raises(FinloopError, match="1 of 2 places are outside the tank"):
        lay_line(corners._replace(x=np.array([0.25, 1.75])))
    with pytest.raises(FinloopError, match="body lengths long"):
        lay_line(corners._replace(x=np.array([0.25, 0.251])))


def test_a_million_trembling_places_become_as_many_as_the_path_is_long():
    rng, n = np.random.default_rng(0), 1_000_000
    x = np.linspace(100, 700, n)
    path = lay_line(Line("a", x, 300 + rng.normal(0, 0.2, n), PX, time_s=np.linspace(0, 20, n)))
    assert path.asked.length == pytest.approx(600, rel=0.02)
    assert len(path.route.x) == pytest.approx(600 / (0.1 * toy.LENGTH), rel=0.05)
    # Half of the time, half of the way.
    assert path.route.when[len(path.route.when) // 2] == pytest.approx(300, rel=0.02)


def test_the_centre_is_sent_where_it_may_be_and_the_error_is_of_what_was_asked():
    path = lay_line(Line("a", np.array([40.0, 760.0]), np.array([25.0, 25.0]), PX))
    own_world = toy.film_world_of()
    cells = np.round([path.route.y, path.route.x]).astype(int)
    assert own_world.tank.legal[tuple(cells)].all() and (path.asked.y == 25).all()


def test_a_path_that_ends_where_it_began_is_closed_unless_it_has_times():
    x, y = np.append(EIGHT.x, EIGHT.x[0]), np.append(EIGHT.y, EIGHT.y[0])
    open_ = EIGHT._replace(x=x, y=y, closed=False)
    assert lay_line(open_).route.closed
    assert not lay_line(open_._replace(time_s=np.arange(201.0))).route.closed
    assert lay_line(open_).asked.length == pytest.approx(lay_line(EIGHT).asked.length, rel=1e-3)


# --- feet


def test_whoever_swims_a_path_that_crosses_itself_stays_on_its_branch():
    route = lay_line(EIGHT).route
    along = 0.0
    for to in np.arange(0, 2.2 * route.length, 3.0):  # and on, lap after lap
        x, y = point_along(route, to)
        along, fx, fy = find_nearest_on_route(route, x, y, along)
        assert along == pytest.approx(to, abs=1e-6) and (fx, fy) == pytest.approx((x, y))


def test_a_foot_is_the_nearest_place_and_never_goes_back():
    route = lay_line(Line("a", np.array([100.0, 700.0]), np.array([300.0, 300.0]), PX)).route
    assert find_nearest_on_route(route, 110.0, 320.0, 0.0) == pytest.approx((10, 110, 300))
    assert find_nearest_on_route(route, 50.0, 320.0, 5.0) == pytest.approx((5, 105, 300))
    assert find_nearest_on_route(route, 900.0, 300.0, 595.0) == pytest.approx((600, 700, 300))


# --- steering


def ahead(n, heading=0.0, step=3.0):
    """A way straight ahead from (200, 300)."""
    angle = np.radians(heading)
    far = step * np.arange(n)[:, None] * [[np.cos(angle), -np.sin(angle)]]
    return np.column_stack([np.array([200.0, 300.0]) + far, np.full(n, heading)])


def steer(way, y=300.0, swims=2.0, **changes):
    route = lay_line(Line("a", np.array([100.0, 700.0]), np.array([y, y]), PX)).route
    usual = Steering(0.5, 0.2, 1.0, 10, toy.LENGTH, 30.0, 10.0, 3.0, 0.1)
    speed = np.full(len(way) - 1, swims)
    world, bounds, steering = (
        toy.film_world_of(),
        tank_bounds(toy.open_tank()),
        usual._replace(**changes),
    )
    graph = search_graph(world.film, bounds, world.cost_weights, world.steering_ticks)
    rows = np.zeros(len(way) - 11, np.int64)
    return swim_trajectory(
        way, speed, rows, 100.0, 0, path_objective(route, steering), ANYWHERE, graph
    )[:3]


def test_a_way_along_the_path_is_left_as_it_is():
    way = ahead(60)
    out, used, along = steer(way)
    assert out == pytest.approx(way[1:50]) and not used.any()
    assert along == pytest.approx(100 + 3 * 49)


def test_a_way_beside_the_path_is_brought_onto_it_within_its_limits():
    for heading, y in ((8.0, 300.0), (0.0, 308.0), (-8.0, 290.0)):
        out, used, _ = steer(ahead(110, heading), y)
        assert abs(out[-1, 1] - y) < 0.5 < max(abs(ahead(110, heading)[99, 1] - y), 1)
        assert np.abs(used[:, 0]).max() <= 0.5 + 1e-9 and used[:, 1].max() <= 0.4 + 1e-9


def test_who_swims_slowly_is_corrected_less_and_who_rests_not_at_all():
    used = [steer(ahead(60, 20.0), swims=speed)[1] for speed in (0, 0.5, 1, 3)]
    most = [np.abs(one).max(0).tolist() for one in used]
    assert most == [[0, 0], [0.25, 0.1], [0.5, 0.2], [0.5, pytest.approx(0.6)]]


def test_a_way_ends_before_it_leaves_the_tank():
    out, used, _ = steer(ahead(400, 90.0), turn=1e-9, shift=0.0)
    assert len(out) == len(used) < 389
    assert toy.open_tank().legal[tuple(np.round(out[:, 1::-1].T).astype(int))].all()


# --- following


def follow_line(line, ticks=700, **changes):
    """What is made of a path: the swim, columns of `PATH_ROWS`, measures."""
    own_world = toy.film_world_of(**changes)
    player, path = toy.matching_of(own_world), lay_line(line)
    recorded = animate_fish(player, [], ticks, np.random.default_rng(0), path.route)
    table = path_table("matching", recorded, path, ticks, own_world)
    left = find_departures(table, path, own_world, swimming_limits(own_world.film, own_world))
    return recorded, table, left, path_metrics(table, left, path, own_world)


def test_the_film_is_swum_along_a_path_lap_after_lap():
    recorded, table, left, numbers = follow_line(EIGHT)
    assert numbers["path_across_rms_body_lengths"] < 0.1 and not len(left)
    assert numbers["path_covered_pct"] > 100 and len(table) == 700
    assert 0 < numbers["path_turn_corrected_pct"] < 15
    assert 0 < numbers["path_way_corrected_pct"] < 15
    cells = np.round([table["y_px"], table["x_px"]]).astype(int)
    assert toy.open_tank().legal[tuple(cells)].all()
    # What is shown is the film, turned as the fish is, and goes on as the film does between jumps.
    film = toy.film_world_of().film
    for one in recorded.stretches:
        turned = one.trajectory[:, 2] - film.heading[one.number] - one.rotation_deg
        assert np.cos(np.radians(turned)) == pytest.approx(1)
        assert (np.diff(one.number) == 1).all()


def test_a_path_is_followed_to_its_end_and_no_tick_longer_and_then_the_fish_wanders():
    """Of a path without times the last tick alone is at its end; one with times lasts as long."""
    line = Line("a", np.array([150.0, 500.0]), np.array([300.0, 320.0]), PX)
    path, player = lay_line(line), toy.matching_of()
    made = animate_fish(player, [], 900, np.random.default_rng(0), path.route)
    table = path_table("matching", made, path, 900, player.world)
    at = [name == PATH for name in made.names]
    assert at == sorted(at, reverse=True) and not all(at)
    followed_ = [len(one.trajectory) for one, on in zip(made.stretches, at, strict=True) if on]
    end = path.asked.length - 1e-3
    assert sum(followed_) == len(table) < 900
    assert table["along_px"].iloc[-1] >= end > table["along_px"].iloc[-2]
    timed = lay_line(line._replace(time_s=np.array([0.0, 3.03])))
    made = animate_fish(player, [], 900, np.random.default_rng(0), timed.route)
    ticks = [len(one.trajectory) for one, at in zip(made.stretches, made.names, strict=True) if at]
    assert sum(ticks) == len(timed.route.when)


def test_with_times_the_fish_is_there_on_time():
    x = np.linspace(150, 600, 100)
    y = 300 + 60 * np.sin(x / 60)
    far = np.append(0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    pace = toy.SPEED * toy.LENGTH
    heading = np.degrees(np.arctan(-np.cos(x / 60)))
    line = Line("a", x, y, PX, time_s=far / pace, heading_deg=heading)
    _, table, left, numbers = follow_line(line)
    assert len(table) == 1 + int(far[-1] / pace * toy.RATE) and not len(left)
    assert numbers["path_late_rms_body_lengths"] < 0.25
    assert numbers["path_across_rms_body_lengths"] < 0.1
    assert numbers["path_heading_error_rms_deg"] < 20
    # Four times as fast as any fish of the film, it is late, and that is said.
    _, _, left, numbers = follow_line(line._replace(time_s=far / pace / 4))
    assert numbers["path_late_rms_body_lengths"] > 1 and "fast" in set(left["why"])


def test_where_a_path_cannot_be_swum_it_is_left_and_that_is_said():
    wall = Line("a", np.array([150.0, 600.0]), np.array([22.0, 22.0]), PX)
    _, _, left, numbers = follow_line(wall)
    assert set(left["why"]) == {"wall"} and numbers["path_left_pct"] == 100
    assert left["most"].iloc[0] == pytest.approx(
        (0.6 * toy.LENGTH + 20 - 22) / toy.LENGTH, abs=0.15
    )
    x = np.array([150.0, 500.0, 150.0, 500.0])
    spike = Line("a", x, np.array([200.0, 210.0, 220.0, 230.0]), PX)
    _, _, left, numbers = follow_line(spike)
    assert "sharp" in set(left["why"]) and numbers["path_covered_pct"] == pytest.approx(100)
    assert (left["to_s"] >= left["from_s"]).all() and (left["most"] > 0.25).all()


def test_a_step_along_a_path_is_pure_and_a_cut_one_goes_on_from_the_cut():
    player, route = toy.matching_of(), lay_line(EIGHT).route
    rng = np.random.default_rng(3)
    state = player.begin(rng, route)
    for _ in range(12):
        draws = rng.bit_generator.state
        stretch, then = player.plan(state, route, rng)
        again = np.random.default_rng(0)
        again.bit_generator.state = draws
        assert repr(player.plan(state, route, again)) == repr((stretch, then))
        short, cut = player.cut(state, stretch, 2)
        on, after_ = player.plan(cut, route, again)
        assert len(short.steer if short.steer is not None else short.trajectory) <= 2
        assert np.hypot(*(on.trajectory[0, :2] - short.trajectory[-1, :2])) < 0.5 * toy.LENGTH
        assert after_.progress.along >= state.progress.along
        state = then


def test_a_film_that_only_swims_straight_leaves_the_fish_where_the_path_begins():
    """Every way of it leaves the tank in the end: the fish turns on the spot, and says so."""
    table = toy.arc_track([0.0] * 300, at=(100.0, 100.0))
    own_world = toy.film_world_of(toy.film_of(table, toy.loops((20, 280))))
    player, path = toy.matching_of(own_world), lay_line(EIGHT)
    made = animate_fish(player, [], 200, np.random.default_rng(0), path.route)
    reasons = [one.decision.reason for one in made.stretches]
    assert set(reasons) <= {"play", "spot"} and reasons.count("spot") > 10
    recorded = path_table("matching", made, path, 200, own_world)
    left = find_departures(recorded, path, own_world, swimming_limits(own_world.film, own_world))
    numbers = path_metrics(recorded, left, path, own_world)
    assert numbers["path_covered_pct"] < 50


def test_what_is_swum_is_written_and_drawn(tmp_path):
    _, table, left, _ = follow_line(EIGHT, ticks=100)
    save_table(tmp_path / "a.parquet", table, PATH_ROWS)
    save_table(tmp_path / "b.parquet", left, DEPARTURES)
    assert len(figure(table, left, np.full((600, 800), 128, np.uint8)).axes) == 2


def test_at_a_tick_before_its_times_a_path_is_at_its_beginning():
    route = lay_line(EIGHT._replace(closed=False, time_s=np.arange(200.0) / toy.RATE)).route
    assert due_along(route, 0) == due_along(route, 1) == 0.0
    assert due_along(route, 10**6) == route.when[-1] == pytest.approx(route.length)
    assert isinstance(route, Route) and route.is_timed and not route.is_done(route.length, 5)


def test_the_parameters_of_paths_do_not_touch_who_swims_to_goals(monkeypatch):
    """Without a path nothing of it counts."""
    swims = [animate_fish(toy.matching_of(), [], 200, np.random.default_rng(1))]
    monkeypatch.setattr(MatchingSettings, "path_commit", 3.0)
    changed = toy.film_world_of(path_max_correction_ratio=0.9, path_offset_cost=0.0)
    swims.append(animate_fish(toy.matching_of(changed), [], 200, np.random.default_rng(1)))
    assert all(repr(a) == repr(b) for a, b in zip(*(s.stretches for s in swims), strict=True))
