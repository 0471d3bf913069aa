"""Several fish planned together: they keep clear, swim as each would alone, and are read by all."""

import sys
from contextlib import ExitStack, chdir
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import toy_film as toy
from conftest import TINY_CARP
from scratch import prepare

import stages.animate
import stages.export
import stages.modes.matching
import stages.modes.network
import stages.plots.animate
import stages.plots.render
import stages.render
from finloop.animate import encounters
from finloop.animate.arena import make_tank
from finloop.animate.encounters import (
    count_overlaps,
    do_outlines_overlap,
    nearest_distances,
    place_outline,
)
from finloop.animate.kinematics import Target
from finloop.animate.obstacles import Plans, can_stay
from finloop.animate.paths import lay_path
from finloop.animate.places import random_goals
from finloop.animate.shoal import (
    NoRoom,
    animate_fish,
    animate_group,
    deal_goals,
    make_tasks,
    refuse_shared_goals,
    settle_fish,
)
from finloop.base.errors import FinloopError
from finloop.base.line import PX, Line
from finloop.base.settings import settings
from finloop.edit.build import build_edit_lists
from finloop.edit.measures import average_measures
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT, PATH, PLAY, Goal, split_by_fish
from finloop.edit.stretch import Decision
from finloop.io.numbers import load_numbers
from finloop.io.parameters import build_settings, read_parameters
from finloop.io.table import load_table, save_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.live.tank import LiveTank
from finloop.modes import samples
from finloop.modes.matching import MatchingAnimator
from finloop.modes.samples import sample_animations
from finloop.plan import fallback
from finloop.plan.load_paths import load_path_lines
from finloop.plan.path_measures import DEPARTURES, PATH_ROWS
from finloop.project import Project


@cache
def spacious():
    """A player in a tank in which fish hardly ever meet."""
    arena = np.zeros((2000, 2000), bool)
    arena[20:-20, 20:-20] = True
    return toy.matching_of(toy.film_world_of(room_=make_tank(arena, 0.6 * toy.LENGTH)))


def swim_group(player, fish, ticks, goals=(), seed=0):
    todo = make_tasks(goals, fish, np.random.default_rng(seed))
    return build_edit_lists(animate_group(player, todo, ticks), ticks, player.edit_inputs)


# --- fish of one tank


def test_nobody_swims_through_another_and_all_goals_are_reached():
    met = {}
    for through in (False, True):
        player, ticks = toy.crowd_player(through), 700
        goals = random_goals(player.world, 6, np.random.default_rng(1))
        swims = animate_group(player, make_tasks(goals, 6, np.random.default_rng(2)), ticks)
        assert all((one.reached >= 0).all() for one in swims)
        table = build_edit_lists(swims, ticks, player.edit_inputs)
        met[through] = count_overlaps(table, player).sum()
    assert met[False] == 0 < met[True]


def test_fish_that_do_not_meet_swim_as_each_would_alone():
    player, ticks = spacious(), 60
    goals = random_goals(player.world, 6, np.random.default_rng(3))
    together = animate_group(player, make_tasks(goals, 3, np.random.default_rng(5)), ticks)
    table = build_edit_lists(together, ticks, player.edit_inputs)
    apart = [np.hypot(*(a - b).T).min() for a, b in combinations(encounters.fish_places(table), 2)]
    assert min(apart) > 4 * toy.LENGTH
    alone = [
        animate_fish(player, task.goals, ticks, task.rng)
        for task in make_tasks(goals, 3, np.random.default_rng(5))
    ]
    pd.testing.assert_frame_equal(table, build_edit_lists(alone, ticks, player.edit_inputs))


def test_planning_keeps_no_hold_of_what_it_was_given():
    """Kernels that count no references must not take or give one either."""
    player = toy.crowd_player()
    own_world = player.world
    film = own_world.film
    given = [film.rows, film.to, own_world.tank.legal, player.silhouettes.discs.table]
    goals, held = random_goals(own_world, 6, np.random.default_rng(1)), []
    for _ in range(2):  # what the first one makes, and keeps, the second one uses
        animate_group(player, make_tasks(goals, 6, np.random.default_rng(2)), 300)
        held.append([sys.getrefcount(one) for one in given])
    assert held[0] == held[1]


def test_the_first_fish_has_the_generator_of_a_fish_alone_and_each_its_own():
    one, *others = make_tasks([], 3, np.random.default_rng(9))
    draws = [task.rng.random(4).tolist() for task in (one, *others)]
    assert draws[0] == np.random.default_rng(9).random(4).tolist()
    assert draws[0] != draws[1] != draws[2] != draws[0]
    again = make_tasks([], 8, np.random.default_rng(9))  # others change nothing for these
    assert [task.rng.random(4).tolist() for task in again[:3]] == draws


def test_the_live_tank_swims_the_same():
    ticks, fish = 120, 4
    table = swim_group(toy.crowd_player(), fish, ticks, seed=6)
    live = LiveTank({"matching": toy.crowd_player()}, "matching", fish, 6)
    for _ in range(ticks - 1):
        live.advance()
    shown = [[live.fish[k].row_at(t)[:12] for t in range(ticks)] for k in range(fish)]
    columns = ["kind", "source", "x_px", "y_px"]
    for own, one in zip(split_by_fish(table), shown, strict=True):
        theirs = pd.DataFrame(one, columns=live.fish[0].row_at(0)._fields[:12])
        assert own[columns].values.tolist() == theirs[columns].values.tolist()


def test_a_fish_in_a_row_along_a_wall_leaves_it_aside(monkeypatch):
    """Its neighbours leave it less than the drift of a tick, and it heads for the wall."""
    arena = np.zeros((400, 400), bool)
    arena[50:350, 50:350] = True
    wall = make_tank(arena, 0.6 * toy.LENGTH)
    player = toy.matching_of(toy.film_world_of(room_=wall))
    x, y = 200.0, float(np.flatnonzero(wall.legal[:, 200])[0])
    begun = player.begin(np.random.default_rng(0)).fish
    first = begun._replace(
        x=x, y=y, heading=90.0, rotation_deg=begun.rotation_deg + 90.0 - begun.heading
    )
    avoider = player._fallback

    def with_neighbours(fish, gap):
        sides = [np.array([[x + side, y, 90.0, first.picture]]) for side in (-gap, gap)]
        others = Plans.from_paths(sides, fish.tick).places_of_others(-1, fish.tick)
        return fish._replace(obstacles=player.others_to_avoid(others, fish.tick))

    def free(gap):
        return can_stay(
            with_neighbours(first, gap).obstacles, first.picture, np.array([x, y, 90.0]), 0
        )

    gap, ways = 0.1 + next(gap for gap in np.arange(10.0, 20.0, 0.1) if free(gap)), []
    for directions in (fallback._ASIDE_DEG, (0.0,)):  # and back to back alone
        monkeypatch.setattr(fallback, "_ASIDE_DEG", directions)
        fish = with_neighbours(first, gap)
        ahead = avoider.stay(fish, Target(x + 100, y, 0, 0))
        way = np.repeat([[x + gap, y, 90.0]], len(ahead.trajectory), axis=0)
        blocked = replace(ahead, trajectory=way, decision=Decision(PLAY))
        way = avoider.keep_clear(fish, blocked).trajectory
        ways.append(way[-1, :2] - (x, y))
    drift_px = fallback._DRIFT * toy.LENGTH / toy.DELTA
    assert ways[0][1] > 0.9 * drift_px and abs(ways[0][0]) < 0.5
    assert np.hypot(*ways[1]) < 0.2 + 1e-9


def ring(x, y, radius=60.0):
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    return Line("ring", x + radius * np.cos(angle), y + radius * np.sin(angle), PX, closed=True)


def plans_of(lines, **changes):
    """A planner of the crowded tank whose first fish have these lines, None for one with none."""
    own_world = toy.crowd_player().world
    own_world = replace(own_world, settings=replace(own_world.settings, **changes))
    player = replace(toy.crowd_player(), world=own_world)
    paths = tuple(one and lay_path(one, own_world.tank, own_world.motion, None) for one in lines)
    return MatchingAnimator(player, None, 1.0, player.world.settings, 0.6 * toy.LENGTH, paths)


def test_each_fish_has_a_path_or_goals_of_its_own():
    plans = plans_of([ring(290, 200), None, ring(480, 400)], fish=4)
    assert plans.goal_seekers == [1, 3] and plans.fish_without_rule == [0, 1, 2, 3]
    goals = [Goal(name, x, 300.0, toy.TOUCH) for name, x in (("A", 250), ("B", 350), ("C", 450))]
    todo = plans.tasks(goals)
    assert [[goal.name for goal in task.goals] for task in todo] == [[], ["A", "C"], [], ["B"]]
    player = plans.player
    swims = animate_group(player, todo, 500)
    assert [set(swims[fish].names) == {PATH} for fish in range(4)] == [True, False, True, False]
    assert all((swims[fish].reached >= 0).all() for fish in (1, 3))
    table = build_edit_lists(swims, 500, player.edit_inputs)
    assert not count_overlaps(table, player).any()
    for fish, (cx, cy) in ((0, (290, 200)), (2, (480, 400))):
        x, y = encounters.fish_places(table)[fish].T
        assert np.median(np.abs(np.hypot(x - cx, y - cy) - 60)) < toy.LENGTH / 2


def test_two_paths_that_begin_at_one_place_are_refused_unless_fish_overlap():
    lines = [ring(290, 200), None, ring(290, 200 + 0.5 * toy.LENGTH)]
    with pytest.raises(FinloopError, match="begins fish 3 on fish 1, at "):
        plans_of(lines, fish=3, trials=0).check_room([])
    plans_of(lines, fish=3, overlap=True, trials=0).check_room([])


def test_who_begins_a_path_on_the_way_of_another_is_not_run_into():
    player, along = toy.crowd_player(), np.array([220.0, 580.0])
    first = Line("first", along, np.array([300.0, 300.0]), PX)
    second = Line("second", np.array([330.0, 330.0]), np.array([300.0, 480.0]), PX)
    routes = [
        lay_path(line, player.world.tank, player.world.motion, None).route
        for line in (first, second)
    ]
    tasks = make_tasks([], 2, np.random.default_rng(0))
    todo = [task._replace(route=one) for task, one in zip(tasks, routes, strict=True)]
    swims = animate_group(player, todo, 200)
    assert not count_overlaps(build_edit_lists(swims, 200, player.edit_inputs), player).any()


def test_there_is_a_path_a_fish_at_most(tmp_path):
    (tmp_path / "a.csv").write_text("x,y\n0.2,0.2\n0.8,0.8\n")
    p = settings("matching", path=[str(tmp_path / "a.csv"), None], fish=2)
    lines = load_path_lines(p, pd.DataFrame())
    assert lines[0].name.endswith("a.csv") and lines[1] is None
    with pytest.raises(FinloopError, match="2 paths for 1 fish"):
        load_path_lines(replace(p, fish=1), pd.DataFrame())


# --- the edit list


def test_one_table_has_all_fish_one_after_the_other_and_comes_back_from_disk(tmp_path):
    alone, table = swim_group(toy.crowd_player(), 1, 50), swim_group(toy.crowd_player(), 3, 50)
    assert list(table["fish"]) == 50 * [0] + 50 * [1] + 50 * [2]
    assert list(table["tick"]) == 3 * list(range(50)) and list(table.index) == list(range(150))
    pd.testing.assert_frame_equal(table, swim_group(toy.crowd_player(), 3, 50))  # the same seed
    loaded = []
    for one in (alone, table):
        save_table(tmp_path / "one.parquet", one, EDIT)
        loaded.append(load_table(tmp_path / "one.parquet", EDIT))
    assert (loaded[0].dtypes == loaded[1].dtypes).all() and list(loaded[0]) == EDIT.names
    for number, one in enumerate(split_by_fish(table)):
        assert list(one.index) == list(range(50)) and set(one["fish"]) == {number}


def test_measures_are_of_each_fish_on_average():
    assert average_measures([{"a": 1, "b": 2}]) == {"a": 1, "b": 2}
    assert average_measures([{"a": 1.0}, {"a": 4.0, "b": 2.0}]) == {"a": 2.5, "b": 2.0}


# --- goals


def goals_at(*places):
    return [Goal("ABCDEF"[k], x, y, toy.TOUCH) for k, (x, y) in enumerate(places)]


def test_goals_are_dealt():
    goals = goals_at((1, 1), (2, 2), (3, 3), (4, 4), (5, 5))
    assert [[g.name for g in own] for own in deal_goals(goals, 2)] == [["A", "C", "E"], ["B", "D"]]
    assert deal_goals(goals, 1) == [goals] and deal_goals(goals[:1], 3) == [goals[:1], [], []]


def test_two_fish_sent_to_one_place_are_refused():
    far, near = (100.0, 100.0), (100.0, 100.0 + 0.9 * toy.TOUCH)
    with pytest.raises(FinloopError, match=r"A \(fish 1\) and B \(fish 2\)") as refused:
        refuse_shared_goals(goals_at(far, near), range(2))
    assert (
        "animate.goals" in str(refused.value)
        and f"{toy.TOUCH:.0f} px apart" in refused.value.wanted
    )
    with pytest.raises(FinloopError, match=r"D \(fish 1\) and F \(fish 3\)"):
        refuse_shared_goals(goals_at((0, 0), (0, 99), (99, 0), far, (300, 0), near), range(3))
    refuse_shared_goals(goals_at(far, near), [0])  # one after the other
    refuse_shared_goals(goals_at(far, (300, 0), near, (300, 300)), range(2))  # of one fish
    refuse_shared_goals(goals_at(far, (100.0, 100.0 + 1.1 * toy.TOUCH)), range(2))


def planner_of(p):
    own_world = toy.film_world_of(**p)
    return MatchingAnimator(toy.matching_of(own_world), None, 1.0, own_world.settings, 20.0)


def test_the_planner_refuses_what_cannot_be_before_anything_is_planned():
    same = {"goals": [[0.5, 0.5], [0.5, 0.5]], "trials": 0}
    with pytest.raises(FinloopError, match="one place at the same time"):
        planner_of(same | {"fish": 2}).goals()
    assert len(planner_of(same | {"fish": 2, "overlap": True}).goals()) == 2
    assert len(planner_of(same | {"fish": 1}).goals()) == 2
    planner_of(same | {"fish": 3}).check_room([])
    led = same | {"fish": 3, "follow_pairs": [[1, 2]]}  # the second and third swim to goals
    with pytest.raises(FinloopError, match=r"A \(fish 2\) and B \(fish 3\)") as refused:
        planner_of(led).goals()
    assert "to the fish 2, 3" in refused.value.wanted


def test_more_fish_than_fit_are_refused():
    own_world = toy.film_world_of(room_=toy.narrow_tank(), fish=40)
    plans = MatchingAnimator(toy.matching_of(own_world), None, 1.0, own_world.settings, 20.0)
    with pytest.raises(FinloopError, match=r"matching\.fish=40: the tank has room for ") as refused:
        plans.check_room([])
    assert "at most" in refused.value.wanted and "matching.overlap=true" in refused.value.do
    through = replace(own_world, settings=replace(own_world.settings, overlap=True))
    todo = make_tasks([], 40, np.random.default_rng(0))
    assert len(settle_fish(toy.matching_of(through), todo, Plans(40))) == 40


def test_where_few_places_leave_room_samples_are_drawn_at_other_ones(monkeypatch):
    own_world = toy.film_world_of(room_=toy.narrow_tank(), fish=3, seconds=0.2, trial_goals=1)
    plans = MatchingAnimator(toy.matching_of(own_world), None, 1.0, own_world.settings, 20.0)

    def room(seed):
        try:
            return bool(plans.sample(seed, 0.2).size)
        except NoRoom:
            return False

    few = next(seed for seed in range(40) if room(seed) and not room(seed + 1))
    p = replace(own_world.settings, seed=few)
    edits = split_by_fish(sample_animations(plans, 1.2, p))
    assert len(edits) == 6
    assert not edits[0].drop(columns="fish").equals(edits[3].drop(columns="fish"))
    monkeypatch.setattr(samples, "_SEEDS", 1)
    with pytest.raises(FinloopError, match="the tank has room for"):
        sample_animations(plans, 1.2, p)


def test_samples_number_each_fish_on():
    for fish, works in ((1, 3), (3, 3), (4, 4)):
        plans = planner_of({"fish": fish, "seconds": 2.0, "trial_goals": 1})
        made = split_by_fish(sample_animations(plans, 6.0, plans.world.settings))
        assert [set(edit["fish"]) for edit in made] == [{number} for number in range(works)]
        assert sum(len(edit) for edit in made) == pytest.approx(6 * toy.RATE, abs=works)
        assert all(list(edit["tick"]) == list(range(len(edit))) for edit in made)


# --- how near they come


def test_outlines_that_share_a_pixel_overlap():
    square = np.array([[10.0, 10], [-10, 10], [-10, -10], [10, -10]])
    for gap, shared in ((18.0, True), (22.0, False)):
        one, other = (place_outline(square, 50 + x, 50, 0.0, False) for x in (0, gap))
        assert do_outlines_overlap(one, other) == do_outlines_overlap(other, one) == shared
    corner = place_outline(toy.HULL, 30.0, 40.0, 90.0, True)  # headed up: its tip is above
    assert corner == pytest.approx(np.array([[30, 20], [35, 60], [25, 60]]))


def test_pairs_are_counted_at_each_tick():
    player = toy.crowd_player()
    table = swim_group(player, 3, 4)
    table[["kind", "mirrored", "heading_deg"]] = ["frame", False, 0.0]
    table["x_px"] = [0.0, 0, 0, 0] + [0.0, 500, 4, 500] + [900.0, 500, 8, 900]
    table["y_px"] = 300.0
    assert count_overlaps(table, player).tolist() == [1, 1, 3, 0]
    numbers = encounters.measure_clearance(table, player)
    assert numbers["overlapping_pairs_per_1000_ticks"] == pytest.approx(1250)
    assert encounters.measure_clearance(split_by_fish(table)[0], player) == {}


def test_the_nearest_neighbour_is_that_of_every_pair():
    where = np.random.default_rng(0).uniform(0, 100, (7, 2))
    wanted = [min(np.hypot(*(a - b)) for b in where if (a != b).any()) for a in where]
    assert nearest_distances(where) == pytest.approx(wanted)


def test_of_a_film_animals_of_one_frame_are_neighbours():
    features = pd.DataFrame({
        "track_id": [0, 0, 1], "frame": [0, 1, 1], "x_px": [0.0, 0, 30], "y_px": 0.0,
        "body_length_px": 10.0,
    })  # fmt: skip
    found = encounters.measure_film_clearance(features)
    assert found["nearest_median_body_lengths"] == pytest.approx(3)
    assert encounters.measure_film_clearance(features.iloc[:2]) == {}


# --- stages


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tiny_run):
    """What the stages make of a tiny carp of which three swim in one tank."""
    path = tmp_path_factory.mktemp("shoal")
    tiny_run.bring(path, ["identity", *(f"modes-{mode}" for mode in MODES)])
    own = [
        "matching.fish=3", "animate.seconds=1", "animate.goal_radius_bl=0.2", "animate.trials=1",
        "realism.seconds=1", "render.mode=matching", "export.mode=matching",
    ]  # fmt: skip
    prepare(path, *TINY_CARP, *own)
    with chdir(path):
        stages.modes.matching.main()
        stages.animate.main()
    return path


def open_mode(project, mode=stages.modes.matching, **changes):
    """A mode of a run, some of its parameters changed."""

    def change_settings(word):
        p = build_settings(word, read_parameters(project.root / "params.yaml"))
        return replace(p, **{name: one for name, one in changes.items() if hasattr(p, name)})

    project.forget("film_assets", "sprite_assets")  # they depend on these parameters
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(project, "settings", change_settings)
        return mode.open_mode(project)


def test_a_fish_alone_has_no_company_to_measure():
    alone = SimpleNamespace(settings=lambda word: settings(word, fish=1))
    table = stages.animate.compare_schools(alone)  # nothing is read
    assert table.empty and list(table) == ["shoal", "beside", "measure", "median", "distance"]


def test_all_stages_take_several_fish(folder, monkeypatch, no_drawing):
    monkeypatch.chdir(folder)
    table = load_table(folder / "data/animate/matching.parquet", EDIT)
    ticks = round(toy.RATE)
    assert list(table["fish"].value_counts(sort=False)) == [ticks] * 3
    for stage in (stages.plots.animate, stages.render, stages.plots.render, stages.export):
        stage.main()
    table = pd.read_csv(folder / "data/animate/beside/measures.csv", index_col="measure")
    measures = table["matching"]
    assert measures["overlapping_pairs_per_1000_ticks"] == 0
    assert measures["trials_overlapping_pairs_per_1000_ticks"] == 0
    assert measures["nearest_median_body_lengths"] > 0
    assert load_numbers(folder / "reports/render")["frames"] == ticks
    company = pd.read_csv(folder / "data/animate/beside/company.csv")
    assert set(company["shoal"]) == {"first_half", "matching"}
    assert set(company["measure"]) == {"wall_distance"}  # the film has one fish
    listed = pd.read_csv(folder / "data/export/matching.csv")
    assert sorted(listed["fish"].unique()) == [0, 1, 2]
    samples = load_table(folder / "data/animate/matching/samples.parquet", EDIT)
    assert samples["fish"].nunique() == 3


def test_paths_of_several_fish_are_measured_and_drawn_one_by_one(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    for name, y in (("a", 0.3), ("b", 0.7)):
        (tmp_path / f"{name}.csv").write_text(f"x,y\n0.3,{y}\n0.7,{y}\n")
    paths = [str(tmp_path / "a.csv"), None, str(tmp_path / "b.csv")]
    with Project() as project:
        plans = open_mode(project, fish=3, path=paths)
        swims, edit = plans.plan(plans.goals())
        numbers = stages.modes.matching.save_matching_tables(tmp_path, plans, swims, edit)
    swum_ = load_table(tmp_path / "path.parquet", PATH_ROWS)
    assert set(swum_["fish"]) == {0, 2} and set(swum_["mode"]) == {"matching"}
    left = load_table(tmp_path / "left.parquet", DEPARTURES)
    assert set(left["fish"]) <= {0, 2}
    across = swum_.groupby("fish")["across"]
    assert numbers["path_across_rms_body_lengths"] == pytest.approx(
        across.agg(lambda far: np.sqrt((far**2).mean())).mean()
    )
    report = tmp_path / "report"
    report.mkdir()
    left.to_csv(tmp_path / "left.csv", index=False)
    monkeypatch.setattr(stages.plots.animate, "DEPARTURES", tmp_path / "left.csv")
    (report / "metrics.json").write_text((folder / "reports/animate/metrics.json").read_text())
    monkeypatch.setattr(stages.plots.animate, "PATH", tmp_path / "path.parquet")
    monkeypatch.setattr(stages.plots.animate, "REPORT", report)
    stages.plots.animate.main()
    assert {file.name for file in (report / "path").iterdir()} == {"path.png", "path-3.png"}


def test_a_fish_drawn_half_as_large_swims_as_far_in_body_lengths(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with ExitStack() as stack:
        whole, half = (
            open_mode(stack.enter_context(Project()), fish=1, tank="arena", fish_scale=size)
            for size in (1.0, 0.5)
        )
        assert half.reach_px == pytest.approx(whole.reach_px / 2)
        assert half.world.touch_px == pytest.approx(whole.world.touch_px / 2)
        assert half.world.head_px == pytest.approx(whole.world.head_px / 2)
        film, small = whole.world.film, half.world.film
        assert np.allclose(small.scale, film.scale / 2)
        assert np.allclose(small.dx, film.dx / 2) and np.allclose(small.speed, film.speed)
        assert half.world.tank.legal.sum() > whole.world.tank.legal.sum()
        one, two = (each.player.silhouettes.discs for each in (whole, half))
        assert np.allclose(two.table[..., :2], one.table[..., :2] / 2, atol=1e-3)
        # Joins are measured in body lengths, so that what is drawn smaller joins no better.
        show = [each.pictures("frame", 5, 0, 30.0, float(each.world.film.scale[5]), False)
                for each in (whole, half)]  # fmt: skip
        assert np.allclose(*show, atol=1e-3) and show[0].any()


def test_sprites_drawn_half_as_large_are_as_alike(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with Project() as project:
        whole, half = (
            open_mode(project, stages.modes.network, tank="arena", fish_scale=size)
            for size in (1.0, 0.5)
        )
        sizes = (one.player.silhouettes.sprite_scale for one in (whole, half))
        assert np.allclose(next(sizes), 2 * next(sizes))
        shown = (one.pictures.right_facing_sprites for one in (whole, half))
        assert np.allclose(*shown, atol=1e-3)
        assert half.player.world.touch_px == pytest.approx(whole.player.world.touch_px / 2)


def test_the_size_is_found_for_a_fish_that_does_not_fit(folder, monkeypatch):
    monkeypatch.chdir(folder)
    facts = load_facts(Path("data/clip") / FACTS_NAME)
    narrow = np.zeros((facts.height_px, facts.width_px), bool)
    narrow[100:130] = True
    with Project() as project:
        project.arena = narrow
        plans = open_mode(project, fish=1)
        size = plans.pictures.reel.scale
        assert 0.05 < size < 0.9 and plans.reach_px <= 0.5 * 15.5
        with pytest.raises(FinloopError, match=r"smaller than the fish(.|\n)*animate.fish_scale"):
            open_mode(project, fish=1, fish_scale=1.0)
