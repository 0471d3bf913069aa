"""Every shipped sweep moves the measures that it lists: FILM's value and another, on that film."""

import importlib
import os
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import ROOT
from scratch import prepare
from tiny_run import STAGES, TinyRun, link_given

import stages.forecast
import stages.modes.matching
import stages.realism
from benchmarks.pipeline import with_dependencies
from finloop.edit.modes import MODES
from finloop.io.numbers import load_numbers
from finloop.modes.matching import NothingToUse

SWEEPS = sorted((ROOT / "conf/experiment").glob("*.yaml"))
FILM = [
    "clip=carp", "clip.frames=300", "clip.width_px=320", "clip.height_px=240",
    "clip.body_length_px=70", "clip.colour=false", "clip.seed=7", "features.orientations=12",
    "bpn.epochs=5", "bpn.held_out_block_deltas=3", "forecast.epochs=2", "forecast.held_out_block_deltas=3", "loops.distance_threshold=1",
    "animate.seconds=8", "animate.trials=4", "realism.seconds=8", "realism.window_deltas=1",
    "realism.cross_validation_folds=2", "realism.classifier_trees=3", "realism.examples=1",
]  # fmt: skip
"""A film with loops and gateways, short enough to be animated again for every value."""
VALUES = {
    "bpn.learning_rate": "0.02",
    "features.delta_s": "0.15",
    "features.orientations": "24",
    "features.turn_threshold_deg": "30.0",
    "loops.distance_threshold": "0.6",
}
"""Another value that this film can be swum with; of other parameters the first of the sweep."""


LAST = ("animate", "realism")
"""Stages that take all modes together; a mode that no measure is of is taken as it was before."""


def refuse(*_: Any) -> None:
    raise NothingToUse("left out", "a mode that a sweep measures", "nothing")


def leave_out_unmeasured(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(stages.forecast, "split_held_out", refuse)
    patch.setattr(stages.modes.matching, "open_mode", refuse)
    patch.setattr(stages.realism.PictureSample, "judge", lambda *_: {})


class SweptRun(TinyRun):
    """What stages make of FILM, but for mode `matching` and how realism judges by pictures.

    No sweep measures these, and they take long.
    """

    overrides = FILM

    def _run(self, word: str) -> None:
        with pytest.MonkeyPatch.context() as patch:
            leave_out_unmeasured(patch)
            super()._run(word)


@pytest.fixture(scope="module")
def swept_run(tmp_path_factory: pytest.TempPathFactory) -> SweptRun:
    base = tmp_path_factory.getbasetemp()
    return SweptRun((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "swept")


def sweeper(path: Path) -> dict[str, Any]:
    """The sweep of a file."""
    return yaml.safe_load(path.read_text())["hydra"]["sweeper"]


def stages_that_follow(group: str, measures: list[str]) -> list[str]:
    """The stages that a changed group of parameters runs again, on the way to the measures."""
    measured = {one.partition(".")[0] for one in measures}
    modes = {one.partition(".")[2].partition("_")[0] for one in measures}
    ends = [f"modes-{mode}" for mode in MODES if mode in modes]
    ends += measured - set(LAST)
    wanted = [*with_dependencies(ends), *(word for word in LAST if word in measured)]
    found: list[str] = []
    for word in wanted:
        reads = any(
            str(one).partition(".")[0] == group
            for one in STAGES[word].get("meta", {}).get("params", [])
        )
        if reads or any(one in with_dependencies([word]) for one in found):
            found.append(word)
    return found


def numbers(folder: Path, measures: list[str]) -> dict[str, Any]:
    """The values of measures such as `animate.hybrid_film_pct`."""
    of = {one: one.partition(".") for one in measures}
    return {
        one: load_numbers(folder / f"reports/{word}")[key] for one, (word, _, key) in of.items()
    }


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_another_value_of_a_sweep_moves_its_measures(path, swept_run, tmp_path, monkeypatch):
    asked = sweeper(path)
    if "params" not in asked:
        pytest.skip("an experiment, no sweep")
    assert not re.search(r"matching_|realism\.\w*picture", " ".join(asked["measures"]))
    ((name, values),) = asked["params"].items()
    value = VALUES.get(name, values.partition(",")[0])
    words = stages_that_follow(name.partition(".")[0], asked["measures"])
    swept_run.bring(tmp_path, sorted({one.partition(".")[0] for one in asked["measures"]}))
    link_given(tmp_path)
    one = numbers(tmp_path, asked["measures"])
    prepare(tmp_path, *FILM, f"{name}={value}")
    with monkeypatch.context() as patch:
        patch.chdir(tmp_path)
        leave_out_unmeasured(patch)
        for word in words:
            importlib.import_module(f"stages.{word.replace('-', '.')}").main()
    other = numbers(tmp_path, asked["measures"])
    same = [key for key in one if one[key] == other[key]]
    # `halves` is of the film itself; and both values may lead to all goals, or to no film at all.
    moved = [key for key in one if key.startswith(LAST) and key not in same]
    could = [key for key in one if key.startswith(LAST) and not key.endswith("halves_auc")]
    assert len(moved) >= len(could) / 3, (one, other)
