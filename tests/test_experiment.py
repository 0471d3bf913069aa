"""Sweeps and their comparison, what params.yaml says beyond conf/; test_pipeline.py runs one."""

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from browser import chromium, visit
from conftest import ROOT, TINY_CARP
from scratch import A_FILM

from finloop.base.errors import FinloopError
from finloop.base.settings import check_values, settings
from finloop.edit.modes import MODES
from finloop.io.numbers import load_numbers
from finloop.realism.windows import HALVES
from finloop.report.compare import (
    OBJECTIVES,
    compare_experiments,
    comparison_page,
    draw_parallel_axes,
    draw_parameter_effects,
    pareto_front,
)
from stages import compose
from stages.compose import compose_params
from stages.experiment import Experiment, parse_values
from stages.settings import list_overrides as overrides_of

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


@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_varies_what_there_is_and_measures_what_is_measured(name):
    assert compose_mapping(f"+experiment={name}") == compose_mapping()  # no title, no sweep
    sweep = experiment(name)
    for key, values in sweep.params.items():
        word, key = key.split(".")
        varied = list(parse_values(values))
        assert len(set(varied)) == len(varied) > 1
        assert str(usual()[word][key]) in varied  # what is usual is among them
        for value in varied:
            settings(word, **{key: yaml.safe_load(value)})  # every value is allowed
    for measure in (*sweep.measures, *(each.key for each in OBJECTIVES)):
        stage, key = measure.split(".")
        if stage == "realism":  # its numbers are not in git
            assert key.removesuffix("_auc") in (*MODES, HALVES)
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


def test_an_experiment_that_is_not_there_names_the_others():
    with pytest.raises(FinloopError, match="learning_rate"):
        experiment("nosuch")


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
    rng = np.random.default_rng(3)
    names = [f"run-{k}" for k in range(count)]
    parameters = pd.DataFrame(
        {
            "bpn.hidden_units": [10, 9, 100, 2, 5][:count],
            "distance.frame_of_reference": list("babab")[:count],
            "bpn.seed": 0,
        },
        index=names,
    )
    numbers = pd.DataFrame(rng.random((count, 3)), names, [one.key for one in OBJECTIVES])
    return parameters, numbers.assign(**{"bpn.error": rng.random(count)})


def test_what_differs_is_compared_numbers_by_size():
    parameters, numbers = random_runs(5)
    found = compare_experiments(
        parameters[["bpn.hidden_units", "bpn.seed"]], numbers, ["bpn.error", "no.such"]
    )
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
    parameters = pd.DataFrame(
        {"features.delta_s": MIXED, "gait.gamma_per_scale": [True, False, True, False]},
        numbers.index,
    )
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
    assert up.spread == pytest.approx(np.sqrt(cells.var(axis=1, ddof=1).mean()))
    assert up.size == pytest.approx(np.ptp(cells.mean(axis=1)) / up.spread)
    assert np.isinf(effects["animate.no_seed"].size)


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
    assert len(runs) == len(means) == 5
    for point, line, effect in zip(runs, means, found.effects, strict=True):
        assert line.x == (0, 1, 2, 3, 4) and line.y == tuple(effect.means)
        assert set(line.error_y.array) == {effect.spread}
        assert sorted(point.y) == sorted(numbers[effect.measure])


def test_the_page_draws_its_charts_without_a_network(tmp_path: Path):
    path = tmp_path / "compare.html"
    path.write_text(
        comparison_page(compare_experiments(*random_runs(5), ["bpn.error"]), "Of <several>", "why"),
        encoding="utf-8",
    )
    with chromium() as browser:
        seen = visit(browser, path)
        assert seen.page.locator(".chart .main-svg").count() >= 3
        assert seen.page.locator(".y-axis").count() == 6  # of the parallel coordinates
        assert seen.page.locator(".scatterlayer .point").count() >= 10
        assert seen.page.locator("table").nth(1).locator("tbody tr").count() == 5
        assert seen.bad == []
