"""Sweeps and their comparison, what params.yaml says beyond conf/; test_pipeline.py runs one."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from browser import chromium, visit
from conftest import ROOT, TINY_CARP

from finloop.errors import FinloopError
from finloop.report.compare import OBJECTIVES, comparison, html, pareto
from stages import experiment as door
from stages.compose import composed
from stages.experiment import experiment
from stages.settings import overrides as changed

EXPERIMENTS = sorted(path.stem for path in (ROOT / "conf/experiment").glob("*.yaml"))


@pytest.fixture(autouse=True)
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


# --- conf/experiment


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_varies_what_there_is_and_measures_what_is_measured(name):
    one = experiment(name)
    whole = yaml.safe_load(composed([]))
    for key, values in one.sweep.items():
        word, key = key.split(".")
        assert key in whole[word]
        assert len(set(map(str, values))) == len(values) > 1
        assert whole[word][key] in values  # what is usual is among them
    for measure in (*one.measures, *(each.key for each in OBJECTIVES)):
        stage, key = measure.split(".")
        assert key in json.loads((ROOT / f"reports/{stage}/metrics.json").read_text())


def test_every_value_is_allowed():
    for name in EXPERIMENTS:  # one key after the other, all values of one experiment at once
        for overrides in [list(experiment(name).runs(name).values())[-1]]:
            composed(overrides)
    runs = experiment("orientations").runs("orientations")
    assert list(runs)[:2] == ["orientations-12-film", "orientations-12-body"]
    assert runs["orientations-48-film"] == ["features.orientations=48", "distance.pose=film"]


GOOD = {
    "title": "t",
    "why": "w",
    "sweep": {"bpn.hidden": [1, 2]},
    "until": "animate",
    "measures": [],
}


@pytest.mark.parametrize(
    ("change", "said"),
    [({"until": "nowhere"}, "nowhere is no stage"), ({"sweep": {}}, "sweep"), ({"more": 1}, "more"),
     ({"sweep": {"hidden": [1]}}, "sweep.hidden"), ({"measures": ["nosuch.a"]}, "nosuch is no stage")],
)  # fmt: skip
def test_a_wrong_experiment_is_refused_by_name(change, said, tmp_path, monkeypatch):
    monkeypatch.setattr(door, "CONF", tmp_path)
    (tmp_path / "experiment").mkdir()
    path = tmp_path / "experiment/one.yaml"
    path.write_text(yaml.safe_dump(GOOD))
    assert experiment("one").runs("one") == {"one-1": ["bpn.hidden=1"], "one-2": ["bpn.hidden=2"]}
    path.write_text(yaml.safe_dump(GOOD | change))
    with pytest.raises(FinloopError, match=said):
        experiment("one")
    with pytest.raises(FinloopError, match="one of one"):
        experiment("two")


@pytest.mark.parametrize(
    "overrides",
    [[], TINY_CARP, ["clip=file", "clip.path='a: b,c.mp4'", 'sprites.straight="8:120-140"',
                     "animate.goals=[[0.1,0.2],[0.9,0.5]]", "distance.keep=null", "morph.back=false"]],
)  # fmt: skip
def test_what_was_changed_composes_to_the_same_again(overrides):
    text = composed(list(overrides))
    again = changed(yaml.safe_load(text))
    assert bool(again) == bool(overrides)
    assert composed(again) == text


# --- which are best


def test_the_best_are_those_that_none_beats():
    wanted = np.array([[1, 5], [2, 4], [2, 5], [1, 5], [3, 1], [0, np.nan]])
    assert pareto(wanted).tolist() == [True, True, False, True, True, False]


def test_the_best_stay_the_best_in_any_order_and_scale():
    rng = np.random.default_rng(2)
    wanted = rng.integers(0, 6, (60, 3)).astype(float)
    best, order = pareto(wanted), rng.permutation(60)
    assert 0 < best.sum() < 60
    assert (pareto(wanted[order]) == best[order]).all()
    assert (pareto(np.exp(wanted) - 7) == best).all()
    beaten = wanted[~best]
    assert all(any((w <= b).all() and (w < b).any() for w in wanted[best]) for b in beaten)


def some(count: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    rng = np.random.default_rng(3)
    names = [f"run-{k}" for k in range(count)]
    parameters = pd.DataFrame(
        {
            "bpn.hidden": [10, 9, 100, 2, 5][:count],
            "distance.pose": list("babab")[:count],
            "bpn.seed": 0,
        },
        index=names,
    )
    numbers = pd.DataFrame(rng.random((count, 3)), names, [one.key for one in OBJECTIVES])
    return parameters, numbers.assign(**{"bpn.error": rng.random(count)})


def test_what_differs_is_compared_numbers_by_size():
    parameters, numbers = some(5)
    found = comparison(parameters[["bpn.hidden", "bpn.seed"]], numbers, ["bpn.error", "no.such"])
    assert list(found.parameters) == ["bpn.hidden"]
    assert list(found.parameters["bpn.hidden"]) == [2, 5, 9, 10, 100]
    assert list(found.measures.index) == list(found.parameters.index)
    assert list(found.measures)[-1] == "bpn.error" and found.measures.shape == (5, 4)
    sign = [1, -1, 1]
    assert (found.best == pareto(found.measures.iloc[:, :3].to_numpy() * sign)).all()
    bare = comparison(parameters, numbers[["bpn.error"]], ["bpn.error"])
    assert bare.objectives == [] and not bare.best.any()


def test_the_page_draws_its_charts_without_a_network(tmp_path: Path):
    path = tmp_path / "compare.html"
    path.write_text(
        html(comparison(*some(5), ["bpn.error"]), "Of <several>", "why"), encoding="utf-8"
    )
    with chromium() as browser:
        seen = visit(browser, path)
        assert seen.page.locator(".chart .main-svg").count() >= 3
        assert seen.page.locator(".y-axis").count() == 6  # of the parallel coordinates
        assert seen.page.locator(".scatterlayer .point").count() == 10
        assert seen.page.locator("tbody tr").count() == 5
        assert seen.bad == []
