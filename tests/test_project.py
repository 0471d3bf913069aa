"""`Project`, the view of a run: it loads a file once, at its first use, and closes its stores."""

import pickle
from collections import Counter
from contextlib import contextmanager

import pytest
from tiny_run import stage_run

import finloop.project
from finloop.base.errors import FinloopError
from finloop.edit.modes import RETARGET
from finloop.edit.schema import EDIT
from finloop.io.cutouts import open_cutouts
from finloop.io.record import save_json
from finloop.io.table import save_table
from finloop.project import Project

folder = stage_run("animate", "retarget")


@pytest.fixture
def project(folder):
    with Project(folder) as project:
        yield project


def test_a_file_is_loaded_once(project, monkeypatch):
    loaded = Counter()

    def count_loads(load):
        def counts(path, *rest):
            loaded[path] += 1
            return load(path, *rest)

        return counts

    for name in ("load_table", "load_facts", "load_record", "load_mask", "open_cutouts"):
        monkeypatch.setattr(finloop.project, name, count_loads(getattr(finloop.project, name)))
    for _ in range(2):
        drawn = project.edit_with_sources("network", "render", sprites=True, bodies=True)
        project.gallery(drawn).film_picture(0)
        assert project.arena.shape == project.background.shape[:2]
        assert len(project.reel) == len(project.film_reel) == len(project.outlines.outline_px)
        assert len(project.step_distances) and len(project.jumps) and project.loops is not None
        assert project.school_rule.horizon
        assert project.has_forecast == (project.forecast_sampler is not None)
    assert len(loaded) > 8 and set(loaded.values()) == {1}
    project.forget("step_distances")
    steps = project.data / "distance/steps/steps.parquet"
    assert len(project.step_distances) and loaded.pop(steps) == 2
    assert set(loaded.values()) == {1}


def test_parts_of_a_project_belong_to_each_other(project):
    assert project.reel.features is project.film_reel.features is project.features
    assert project.reel.cutouts is project.film_reel.cutouts is project.cutouts
    columns = project.tracks(["x_px", "y_px"])
    assert list(columns) == ["x_px", "y_px"] and len(columns) == len(project.features)
    edit = project.edit_list("network", "render")
    assert edit is project.edit_with_sources("network", "render").edit
    assert project.goals("network") and project.drawn_scale("network") > 0


def test_a_recorded_track_has_no_goals_and_must_have_been_named(project):
    assert project.goals(RETARGET) == [] and project.drawn_scale(RETARGET) == 1.0
    for _ in range(2):
        with pytest.raises(FinloopError, match=r"tank\.mode is retarget, and no track"):
            project.edit_list(RETARGET, "tank")


def test_a_mode_that_the_film_is_too_short_for_says_so(tmp_path):
    save_table(tmp_path / "data/animate/loops.parquet", EDIT.empty(), EDIT)
    save_json(tmp_path / "data/animate/loops/reason.json", {"reason": "no loops"})
    with pytest.raises(FinloopError, match=r"render\.mode is loops, and there is no .*: no loops"):
        Project(tmp_path).edit_list("loops", "render")


def test_a_closed_project_has_closed_its_stores_and_opens_them_anew(folder, monkeypatch):
    there = Counter()

    @contextmanager
    def count_open(path):
        with open_cutouts(path) as store:
            there[path.name] += 1
            yield store
            there[path.name] -= 1

    monkeypatch.setattr(finloop.project, "open_cutouts", count_open)
    with Project(folder) as project:
        assert len(project.reel.store) and there == {"cutouts.arrow": 1, "sprites.arrow": 1}
        first = project.features
    assert there == {"cutouts.arrow": 0, "sprites.arrow": 0}
    with project:
        assert project.features is not first and project.features.equals(first)
        assert len(project.cutouts) and there["cutouts.arrow"] == 1
    assert there["cutouts.arrow"] == 0


def test_another_process_has_one_project_for_all_that_it_is_sent(project):
    assert project.features is not None
    sent = pickle.dumps(project)
    assert len(sent) < 300
    there = pickle.loads(sent)
    assert there is pickle.loads(sent) and there is not project
    assert there.root == project.root
    assert pickle.loads(pickle.dumps(Project(project.root))) is not there  # of a later run


def test_a_project_loads_nothing_before_it_is_used_and_no_forecast_of_a_short_film(tmp_path):
    (tmp_path / "data/forecast").mkdir(parents=True)
    (tmp_path / "data/forecast/reason.json").write_text("{}")
    project = Project(tmp_path)
    assert not project.has_forecast and project.forecast_sampler is None
    with pytest.raises(FinloopError, match=r"facts\.json"):
        _ = project.rate_hz
