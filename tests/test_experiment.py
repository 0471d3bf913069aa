"""Sweeps and their comparison, what params.yaml says beyond conf/; test_pipeline.py runs one."""

import os
import re
import shutil
import subprocess
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml
from browser import chromium, visit
from conftest import ROOT, TINY_CARP
from scratch import A_FILM, write_frames

from finloop.base.errors import FinloopError
from finloop.base.settings import check_values, settings
from finloop.edit.modes import MODES
from finloop.io.movie import Mp4Writer
from finloop.io.numbers import load_numbers, save_numbers
from finloop.realism.windows import HALVES
from finloop.report.compare import (
    OBJECTIVES,
    Preview,
    compare_experiments,
    comparison_page,
    draw_parallel_axes,
    draw_parameter_effects,
    pareto_front,
)
from finloop.report.effects import rank_importance
from stages import compose
from stages.compare import describe_unknown
from stages.compose import compose_params
from stages.experiment import Experiment, parse_values
from stages.make_run import keep_experiment
from stages.repository import find_experiments, list_experiments, read_git_user, run_git
from stages.settings import list_overrides as overrides_of
from stages.sweep import describe_doubtful_measures, describe_run, plan_sweep
from stages.trials import make_trials

SWEEPS = sorted(path.stem for path in (ROOT / "conf/experiment").glob("*.yaml"))


@cache  # composing takes Hydra a third of a second
def compose_mapping(*overrides: str) -> dict[str, Any]:
    return yaml.load(compose_params(list(overrides)), yaml.CSafeLoader)


@pytest.fixture(autouse=True)
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(compose, "compose_params", lambda overrides: compose_mapping(*overrides))


def usual() -> dict[str, Any]:
    return compose_mapping("~local")


experiment = cache(compose.load_experiment)


# --- conf/experiment


def test_an_experiment_that_varies_nothing_is_no_sweep(tmp_path, monkeypatch):
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    own = "# @package _global_\nbpn:\n  hidden_units: 7\n"
    (tmp_path / "conf/experiment/seven.yaml").write_text(own)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    assert compose_mapping("+experiment=seven")["bpn"]["hidden_units"] == 7
    with pytest.raises(FinloopError, match="has no sweep"):
        experiment("seven")
    with pytest.raises(FinloopError, match="learning_rate"):  # the others are named
        experiment("nosuch")


@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_varies_what_there_is_and_measures_what_is_measured(name):
    assert compose_mapping(f"+experiment={name}") == compose_mapping()  # no title, no sweep
    sweep = experiment(name)
    assert re.search(r"\b(one|two|three) seeds?\b", sweep.seen)  # what one seed shows may be chance
    for key, values in sweep.params.items():
        word, key = key.split(".")
        varied = list(parse_values(values))
        assert len(set(varied)) == len(varied) > 1
        assert str(usual()[word][key]) in varied  # what is usual is among them
        for value in varied:
            settings(word, **{key: yaml.safe_load(value)})  # every value is allowed
    assert sweep.seeds == 3 and {"bpn.seed", "animate.seed"} <= {*sweep.list_seeds()}
    for measure in (*sweep.measures, *(each.key for each in OBJECTIVES)):
        stage, key = measure.split(".")
        if stage == "realism":  # its numbers are not in git
            assert key.removesuffix("_auc").removesuffix("_picture") in (*MODES, HALVES)
        else:
            assert key in load_numbers(ROOT / f"reports/{stage}")


@pytest.mark.parametrize(
    ("params", "names", "last"),
    [
        ({"features.orientations": "12, 48", "distance.frame_of_reference": "film, body"},
         ["one-12-film", "one-12-body", "one-48-film", "one-48-body"],
         ["features.orientations=48", "distance.frame_of_reference=body"]),
        ({"bpn.hidden_units": "range(1, 3)", "bpn.seed": "7, 8"},
         ["one-1-7", "one-1-8", "one-2-7", "one-2-8"], ["bpn.hidden_units=2", "bpn.seed=8"]),
    ],
)  # fmt: skip
def test_every_combination_of_values_in_the_notation_of_hydra_is_a_run(params, names, last):
    runs = Experiment("t", "w", "s", params, ["animate.frames"]).list_runs("one", {})
    assert list(runs) == names and runs[names[-1]] == last


def test_what_is_random_runs_with_several_seeds_and_the_values_of_each_seed_together():
    params = {"bpn.epochs": "1, 2"}
    sweep = Experiment("t", "w", "s", params, ["bpn.held_out_area_rmse", "animate.loops_film_pct"])
    seeds = sweep.list_seeds()
    assert seeds == ["bpn.seed", "animate.seed"]
    runs = sweep.list_runs("one", {"bpn.seed": 4, "animate.seed": 0})
    assert list(runs) == [f"one-{value}-seed{seed}" for seed in range(3) for value in (1, 2)]
    assert runs["one-2-seed0"] == ["bpn.epochs=2"]  # what was there before is taken
    assert runs["one-2-seed2"] == ["bpn.epochs=2", "bpn.seed=6", "animate.seed=2"]
    sweep = Experiment("t", "w", "s", {"distance.motion_area_threshold": "1, 2"}, ["loops.loops"])
    assert sweep.list_seeds() == [] and len(sweep.list_runs("one", {})) == 2
    sweep = Experiment("t", "w", "s", {"bpn.seed": "1, 2"}, ["bpn.held_out_area_rmse"])
    assert sweep.list_seeds() == []


GOOD = {"title": "t", "why": "w", "seen": "s", "params": {"bpn.hidden_units": "1, 2"},
        "measures": ["animate.frames"]}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "problem"),
    [({"measures": []}, "one.measures"), ({"params": {}}, "one.params"),
     ({"more": 1}, "one.more: unknown"), ({"params": {"hidden": "1"}}, "one.params.hidden"),
     ({"measures": ["nosuch.a"]}, "nosuch is no stage"),
     ({"params": {"bpn.hiden_units": "1, 2"}}, "did you mean bpn.hidden_units"),
     ({"params": {"bpn.hidden_units": "7"}}, "has one value, 7"),
     ({"params": {"bpn.hidden_units": "7, 7"}}, "has the value 7 twice"),
     ({"seeds": 0}, "one.seeds"), ({"title": "???"}, "title: has no value")],
)  # fmt: skip
def test_a_wrong_sweep_is_refused_by_name(change, problem):
    assert check_values("one", {"one": Experiment}, GOOD)[1] == []
    (problem_here,) = check_values("one", {"one": Experiment}, GOOD | change)[1]
    assert problem in problem_here


@pytest.mark.parametrize(
    "overrides",
    [TINY_CARP, ["clip=file", f"clip.path={A_FILM}", 'sprites.straight_frames="8: 120-140"',
                     "animate.goals=[[0.1,0.2],[0.9,0.5]]", "distance.max_distance_steps=null", "tank.camera=top"]],
)  # fmt: skip
def test_what_was_changed_composes_to_the_same_again(overrides):
    text = compose_params(["~local", *overrides])
    again = overrides_of(yaml.safe_load(text))
    assert again and overrides_of(usual()) == []
    assert compose_params(["~local", *again]) == text


# --- which are best


def test_the_best_are_those_that_none_beats_in_any_order_and_scale():
    wanted = np.array([[1, 5], [2, 4], [2, 5], [1, 5], [3, 1], [0, np.nan]])
    assert pareto_front(wanted).tolist() == [True, True, False, True, True, False]
    rng = np.random.default_rng(2)
    wanted = rng.integers(0, 6, (60, 3)).astype(float)
    best, order = pareto_front(wanted), rng.permutation(60)
    assert 0 < best.sum() < 60
    assert (pareto_front(wanted[order]) == best[order]).all()
    assert (pareto_front(np.exp(wanted) - 7) == best).all()
    beaten = wanted[~best]
    assert all(any((w <= b).all() and (w < b).any() for w in wanted[best]) for b in beaten)


def random_runs(count: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    rng, names = np.random.default_rng(3), [f"run-{k}" for k in range(count)]
    units, frame = [10, 9, 100, 2, 5][:count], list("babab")[:count]
    given = {"bpn.hidden_units": units, "distance.frame_of_reference": frame, "bpn.seed": 0}
    parameters = pd.DataFrame(given, names)
    numbers = pd.DataFrame(rng.random((count, 3)), names, [one.key for one in OBJECTIVES])
    return parameters, numbers.assign(**{"bpn.error": rng.random(count)})


def test_what_differs_is_compared_numbers_by_size():
    parameters, numbers = random_runs(5)
    varied = parameters[["bpn.hidden_units", "bpn.seed"]]
    found = compare_experiments(varied, numbers, ["bpn.error", "no.such"])
    assert list(found.parameters) == ["bpn.hidden_units"]
    assert list(found.parameters["bpn.hidden_units"]) == [2, 5, 9, 10, 100]
    assert list(found.measures.index) == list(found.parameters.index)
    assert list(found.measures)[-1] == "bpn.error" and found.measures.shape == (5, 4)
    sign = [1, -1, 1]
    assert (found.best == pareto_front(found.measures.iloc[:, :3].to_numpy() * sign)).all()
    bare = compare_experiments(parameters, numbers[["bpn.error"]], ["bpn.error"])
    assert bare.objectives == [] and not bare.best.any()


MIXED = ["auto", 10.0, 0.1, 2.0]


def test_words_among_numbers_come_after_them_on_axes_and_in_the_table():
    _, numbers = random_runs(4)
    numbers.iloc[3, 0] = np.nan
    varied = {"features.delta_s": MIXED, "clip.colour": [True, False, True, False]}
    parameters = pd.DataFrame(varied, numbers.index)
    found = compare_experiments(parameters, numbers, [])
    assert list(found.parameters["features.delta_s"]) == [0.1, 2.0, 10.0, "auto"]
    delta, back, *_ = draw_parallel_axes(found).data[0].dimensions
    assert delta.ticktext == ("0.1", "10", "auto") and delta.values == (0, 1, 2)
    assert back.ticktext == ("False", "True") and back.values == (1, 0, 1)
    lines = [axis.values for axis in draw_parallel_axes(found).data[0].dimensions]
    assert np.isfinite(lines).all() and len(lines[0]) == 3  # run-3 lacks a measure


def sweep_with_seeds() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Five values with three seeds each: `up` follows the value, `noise` and `flat` do not."""
    rng = np.random.default_rng(5)
    values, seeds = np.repeat([0.1, 0.2, 0.5, 1.0, 2.0], 3), np.tile([0, 1, 2], 5)
    names = [f"rate-{value:g}-seed{seed}" for value, seed in zip(values, seeds, strict=True)]
    parameters = pd.DataFrame({"bpn.learning_rate": values, "bpn.seed": seeds}, names)
    best = np.abs(np.log(values / 0.3)) > 0.6
    noise = rng.normal(0, 0.01, 15)
    numbers = pd.DataFrame(
        {"animate.up": values + noise, "bpn.held_out_area_rmse": 1 + best + noise,
         "animate.noise": noise, "animate.flat": 7.0, "animate.no_seed": values}, names,
    )  # fmt: skip
    return parameters, numbers


def test_a_sentence_says_what_a_parameter_does_beyond_the_seeds():
    parameters, numbers = sweep_with_seeds()
    found = compare_experiments(parameters, numbers, list(numbers))
    assert list(found.parameters.index) == [f"rate-{value:g}" for value in (0.1, 0.2, 0.5, 1, 2)]
    assert list(found.parameters) == ["bpn.learning_rate"]
    effects = {effect.measure: effect for effect in found.effects}
    assert {measure: effect.verdict for measure, effect in effects.items()} == {
        "animate.up": "rises from 0.09 to 2.00",
        "bpn.held_out_area_rmse": "best between 0.2 and 0.5",
        "animate.noise": "no effect beyond the seeds",
        "animate.flat": "the same in every run",
        "animate.no_seed": "rises from 0.10 to 2",
    }
    up = effects["animate.up"]
    cells = numbers["animate.up"].to_numpy().reshape(5, 3)
    by_seed = cells - cells.mean(axis=0) + cells.mean()  # without what a seed changes alike
    spread = np.sqrt(((by_seed - by_seed.mean(axis=1, keepdims=True)) ** 2).sum() / (4 * 2))
    assert up.spread == pytest.approx(spread)
    assert up.size == pytest.approx(np.ptp(cells.mean(axis=1)) / up.spread)
    assert np.isinf(effects["animate.no_seed"].size)


def test_values_are_compared_seed_by_seed():
    """Whatever a seed adds to the measure of every value, also where a run is missing."""
    parameters, numbers = sweep_with_seeds()
    measure = "bpn.held_out_area_rmse"
    numbers[measure] += np.tile([0.0, 50.0, -30.0], 5)
    for kept in (numbers, numbers.iloc[1:], numbers.iloc[:-1]):
        found = compare_experiments(parameters.loc[kept.index], kept, [measure])
        (effect,) = found.effects
        assert effect.verdict == "best between 0.2 and 0.5" and effect.spread < 0.02
        assert np.ptp(effect.means) == pytest.approx(1, abs=0.05)
    # Where each value has seeds of its own, they cannot be taken out.
    own = parameters.assign(**{"bpn.seed": range(len(parameters))})
    (effect,) = compare_experiments(own, numbers, [measure]).effects
    assert effect.verdict == "no effect beyond the seeds" and effect.spread > 10


def test_without_seeds_a_sentence_says_that_it_may_be_chance():
    parameters, numbers = sweep_with_seeds()
    found = compare_experiments(parameters[::3], numbers[::3], list(numbers))
    verdicts = {effect.measure: effect.verdict for effect in found.effects}
    assert verdicts["bpn.held_out_area_rmse"].startswith("best ")
    assert verdicts["bpn.held_out_area_rmse"].endswith("one seed: it may be chance")
    assert verdicts["animate.flat"] == "the same in every run"


def test_a_parameter_has_a_panel_for_every_measure_with_its_spread():
    parameters, numbers = sweep_with_seeds()
    found = compare_experiments(parameters, numbers, list(numbers))
    figure = draw_parameter_effects(found, "bpn.learning_rate")
    runs, means = figure.data[::2], figure.data[1::2]
    shown = [effect for effect in found.effects if effect.measure != "animate.flat"]
    assert len(runs) == len(means) == 4
    for point, line, effect in zip(runs, means, shown, strict=True):
        assert line.x == (0, 1, 2, 3, 4) and line.y == tuple(effect.means)
        assert set(line.error_y.array) == {effect.spread}
        assert sorted(y for y in point.y if y == y) == sorted(numbers[effect.measure])
        assert sum(y != y for y in point.y) == 3  # a line for each seed, and a gap after it


def test_long_names_of_measures_stand_in_short_lines():
    parameters, numbers = sweep_with_seeds()
    name = "animate.network_trials_turn_rate_kinematic_distance_sd"
    numbers[name] = numbers.iloc[:, 0]
    figure = draw_parallel_axes(compare_experiments(parameters, numbers, [name]))
    lines = figure.data[0].dimensions[-1].label.split("<br>")
    assert " ".join(lines) == "network trials turn rate kinematic distance sd"
    assert max(map(len, lines)) < 30


def two_parameters() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Two parameters with two seeds: `error` depends on the first, `noise` on none."""
    rng = np.random.default_rng(1)
    grid = [(rate, units, seed) for rate in (1, 2, 3) for units in (5, 10) for seed in (0, 1)]
    names = [f"two-{rate}-{units}-seed{seed}" for rate, units, seed in grid]
    parameters = pd.DataFrame(grid, names, ["bpn.learning_rate", "bpn.hidden_units", "bpn.seed"])
    noise = rng.normal(0, 0.01, 12)
    error = parameters["bpn.learning_rate"] + noise
    return parameters, pd.DataFrame(
        {"bpn.held_out_area_rmse": error, "animate.flat": 3.0, OBJECTIVES[0].key: error}, names
    )


def test_of_several_parameters_the_one_that_matters_is_named():
    parameters, numbers = two_parameters()
    given = parameters.drop(columns="bpn.seed")
    shares = rank_importance(given, numbers)
    assert set(shares.index) == {"bpn.held_out_area_rmse", OBJECTIVES[0].key}
    assert (shares["bpn.learning_rate"] > 0.9).all()
    assert shares.sum(axis=1).to_numpy() == pytest.approx(1)


SHOWN = "[...document.querySelectorAll('%s')].filter(one => !one.hidden)"
NAMES = f"{SHOWN}.map(one => one.dataset.name)"


def test_the_page_sorts_filters_and_plays_without_a_network(tmp_path: Path):
    found = compare_experiments(*two_parameters(), ["bpn.held_out_area_rmse", "animate.flat"])
    frames = [np.full((40, 60), 90 + 10 * tick, np.uint8) for tick in range(3)]
    write_frames(Mp4Writer(tmp_path / "film.mp4", (40, 60), Fraction(25), 30), frames)
    picture = cv2.imencode(".webp", frames[0])[1].tobytes()
    preview = Preview(picture, (tmp_path / "film.mp4").read_bytes())
    commits = dict.fromkeys(found.run_parameters.index, "0123456789")
    path = tmp_path / "compare.html"
    previews = {"two-1-5-seed0": preview, "two-2-5-seed0": preview}
    page = comparison_page(found, "Of <several>", ["why", ""], commits, previews)
    path.write_text(page, encoding="utf-8")
    with chromium() as browser:
        seen = visit(browser, path)
        shown = seen.page
        assert shown.locator(".chart .main-svg").count() >= 3
        assert shown.locator("#axes .y-axis").count() == 5  # of the parallel coordinates
        assert shown.locator("#experiments tbody tr").count() == 6
        assert "commit 01234567" in shown.inner_text("#experiments")
        assert "The same in every run: flat." in shown.inner_text("main")
        assert "best at 1" in shown.inner_text(".words")
        assert "two-1-10" in shown.evaluate(NAMES % "#experiments tbody tr")
        for _ in range(2):  # of the seam ratio, the greatest first
            shown.click("#experiments thead th:nth-child(4) button")
        assert shown.evaluate(NAMES % "#experiments tbody tr")[0].startswith("two-3-")
        assert shown.evaluate(NAMES % "figure") == ["two-2-5", "two-1-5"]
        shown.evaluate("Plotly.restyle('axes', {'dimensions[0].constraintrange': [[[0.5, 1.5]]]})")
        assert set(shown.evaluate(NAMES % "#experiments tbody tr")) == {"two-1-5", "two-1-10"}
        assert shown.evaluate(NAMES % "figure") == ["two-1-5"]
        shown.fill("#filter", "-10")
        assert shown.evaluate(NAMES % "#experiments tbody tr") == ["two-1-10"]
        assert "1 of 6" in shown.inner_text("#count")
        shown.click("#play")
        assert shown.inner_text("#play") == "Stop all"
        assert seen.bad == []


# --- planning a sweep


NO_CHANGES: dict[str, Any] = {}


def test_values_given_on_the_line_are_a_sweep_of_the_headline_numbers():
    words = ["bpn.hidden_units=10,20", "bpn.epochs=range(1,3)", "bpn.momentum=0.3"]
    name, plan, fixed = plan_sweep(words, [], {"seeds": 2})
    assert name == "hidden_units-epochs" and fixed == ["bpn.momentum=0.3"] and plan.seeds == 2
    assert plan.params == {"bpn.hidden_units": "10,20", "bpn.epochs": "range(1,3)"}
    assert plan.stages == ["bpn", "animate"]
    runs = plan.list_runs(name, {"bpn.seed": 0})
    assert "hidden_units-epochs-10-1-seed0" in runs and len(runs) == 8
    assert plan_sweep(["render.crf=20,30"], [], NO_CHANGES)[1].stages == ["render"]
    _, plan, _ = plan_sweep(["animate.goals=[[0.1,0.2]],[[0.3,0.4]]"], ["animate.frames"], {})
    assert list(plan.list_runs("g", {})) == ["g-_0.1_0.2_", "g-_0.3_0.4_"]


def test_a_named_sweep_takes_other_values_and_measures():
    words = ["learning_rate", "bpn.learning_rate=0.1,0.3"]
    _, plan, _ = plan_sweep(words, ["bpn.held_out_area_rmse"], NO_CHANGES)
    assert plan.params == {"bpn.learning_rate": "0.1,0.3"} and plan.title
    assert plan.stages == ["bpn"]


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ([], "nothing to sweep"),
        (["bpn.hidden_units=10"], "bpn.hidden_units=10 has one value"),
        (["bpn.hiden_units=10,20"], "did you mean bpn.hidden_units"),
        (["bpm.hidden_units=10,20"], "there is no group bpm; did you mean bpn?"),
        (["learning_rate=10,20"], "did you mean bpn.learning_rate"),
        (["learning_rate", "momentum"], "more than one sweep"),
        (["nosuch"], "nosuch"),
        (["bpn.learning_rate=interval(0.1,1)"], "sweeper: optuna"),
        (["clip.path=a b.mp4,c=d"], "is no `key=value`"),
    ],
)
def test_what_cannot_be_swept_is_refused(words, problem):
    with pytest.raises(FinloopError, match=re.escape(problem)):
        plan_sweep(words, [], NO_CHANGES)


def test_a_measure_that_no_run_has_is_named():
    known = {"bpn.held_out_area_rmse", "animate.film_pct"}
    assert describe_unknown(known, known) == ""
    text = describe_unknown(["bpn.held_out_area_rms", "animate.film_pct", "tank.x"], known)
    assert text == "bpn.held_out_area_rms (did you mean bpn.held_out_area_rmse?), tank.x"


def test_a_measure_of_a_stage_that_nobody_has_run_is_not_doubted(monkeypatch):
    present = {"HEAD": {"bpn.held_out_area_rmse": 0.2}}
    monkeypatch.setattr("stages.sweep.load_numbers", lambda *_: present)
    measures = ["bpn.held_out_area_rms", "realism.loops_auc"]
    plan = plan_sweep(["learning_rate"], measures, NO_CHANGES)[1]
    assert describe_doubtful_measures(plan).startswith("bpn.held_out_area_rms (did you mean")
    assert "realism" not in describe_doubtful_measures(plan)


# --- Optuna


def bowl(runs: dict[str, list[str]], values: dict[str, float]) -> dict[str, str]:
    """Note what each run would measure: least at a learning rate of 0.1; one rate fails."""
    for name, changes in runs.items():
        given = dict(change.split("=") for change in changes)
        rate, seed = float(given["bpn.learning_rate"]), int(given.get("bpn.seed", 0))
        values[name] = np.log(rate / 0.1) ** 2 + 0.001 * seed
    return {}


def test_optuna_finds_the_best_value_and_drops_bad_ones_early():
    pytest.importorskip("optuna")
    plan = Experiment(
        "t", "w", "s", {"bpn.learning_rate": "tag(log, interval(0.001, 10))"},
        ["bpn.train_rows", "bpn.held_out_area_rmse"], sweeper="optuna", trials=16,
    )  # fmt: skip
    values: dict[str, float] = {}
    own = plan, "one", {"bpn.seed": 0}, 2
    made = [
        make_trials(*own, lambda runs: bowl(runs, values), lambda name, goal: values[name])
        for _ in range(2)
    ]
    runs, failures, text = made[0]
    assert made[0] == made[1] and not failures  # what was made is found again
    assert 16 < len(runs) < 48 and "16 trials" in text and "bpn.held_out_area_rmse" in text
    best = min(runs, key=lambda name: values[name])
    assert 0.05 < float(best.split("-")[1]) < 0.2
    _, failures, text = make_trials(*own, lambda runs: dict.fromkeys(runs, "bad"), lambda *_: 0.0)
    assert len(failures) == 16 and "none of 16 trials" in text


def test_optuna_needs_a_measure_with_a_good_direction():
    plan = Experiment("t", "w", "s", {"bpn.epochs": "1, 2"}, ["bpn.train_rows"])
    with pytest.raises(FinloopError, match="unknown whether more or less is better"):
        make_trials(plan, "one", {}, 2, lambda _: {}, lambda *_: None)


def test_a_finished_run_is_one_line(tmp_path):
    save_numbers(tmp_path / "reports/bpn", {"held_out_area_rmse": 0.123456})
    measures = ["bpn.held_out_area_rmse", "bpn.gone", "loops.loops"]
    line = describe_run("rate-0.1-seed0", 31.7, tmp_path, measures)
    assert line == "rate-0.1-seed0: 32 s, bpn.held_out_area_rmse 0.1235"


# --- git


def git(folder: Path, *arguments: str) -> None:
    subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True)


def test_an_experiment_has_what_git_tracks_and_what_stages_read_or_write(tmp_path, monkeypatch):
    """And nothing else of the folder, such as a film. The commit itself stays as it is."""
    monkeypatch.chdir(tmp_path)
    stage = {"cmd": "x", "deps": ["conf"], "outs": ["data/a"], "metrics": [{"a.json": {}}]}
    (tmp_path / "dvc.yaml").write_text(yaml.safe_dump({"stages": {"a": stage}}))
    (tmp_path / ".gitignore").write_text("/data\n")
    (tmp_path / "kept.txt").write_text("old")
    (tmp_path / "gone.txt").touch()
    git(tmp_path, "init", "--quiet", ".")
    for key in ("user.name", "user.email"):
        git(tmp_path, "config", key, "a@example.org")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message", "first version")
    head = run_git("rev-parse", "HEAD")
    (tmp_path / "kept.txt").write_text("new")
    (tmp_path / "gone.txt").unlink()
    for name in ("conf/new.yaml", "data/a", "a.json", "params.yaml", "dvc.lock", "film.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    keep_experiment("one")
    (commit,) = find_experiments(["one"]).values()
    assert run_git("rev-parse", "HEAD") == head == run_git("rev-parse", f"{commit}~1")
    assert run_git("ls-tree", "-r", "--name-only", commit).split() == [
        ".gitignore", "a.json", "conf/new.yaml", "dvc.lock", "dvc.yaml", "kept.txt", "params.yaml",
    ]  # fmt: skip
    assert run_git("show", f"{commit}:kept.txt") == "new"
    (tmp_path / "a.json").unlink()  # the next run in the same folder does not make it
    keep_experiment("two")
    assert run_git("diff", "--name-only", commit, find_experiments(["two"])["two"]) == "a.json\n"


def test_each_lack_of_git_has_its_own_advice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("GIT_CONFIG_GLOBAL", "GIT_CONFIG_SYSTEM"):
        monkeypatch.setenv(name, os.devnull)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    with pytest.raises(FinloopError, match="git init"):
        list_experiments()
    git(tmp_path, "init", "--quiet", ".")
    with pytest.raises(FinloopError, match="git commit --message"):
        list_experiments()
    with pytest.raises(FinloopError, match=r"git config user\.name"):
        read_git_user()
    git(tmp_path, "config", "user.name", "A Name")
    git(tmp_path, "config", "user.email", "a@example.org")
    assert read_git_user() == ("A Name", "a@example.org")
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", "first version")
    head = run_git("rev-parse", "HEAD").strip()
    git(tmp_path, "update-ref", f"refs/exps/{head[:2]}/{head[2:]}/old", head)
    assert find_experiments(["old"]) == {"old": head}
    git(tmp_path, "switch", "--quiet", "--detach")  # an experiment is of a commit, not of a branch
    assert find_experiments(["old"]) == {"old": head}
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", "second version")
    with pytest.raises(FinloopError, match=r"old is of another version.*first version") as caught:
        find_experiments(["old", "new"])
    assert "no experiment new" in str(caught.value)
