"""`make ci-fixture`: the tiny film's numbers against kept ones, and the workflows that call it."""

import re
from pathlib import Path

import pytest
import yaml
from conftest import ROOT

import stages.fixture
from finloop.base.errors import FinloopError
from finloop.io.numbers import load_numbers, save_numbers
from finloop.lab.new import make_repository
from stages.fixture import FILM, KEPT, OUT, compare_numbers, main, read_tiny_film

WORKFLOWS = Path(".github/workflows")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A lab's own repository, whose tests call no DVC."""
    return make_repository(tmp_path_factory.mktemp("labs") / "lab")


def fake_dvc(number: float, fails: bool = False):
    """What stands in for DVC: its run writes one number of the stage clip, and a report."""

    def run_dvc(*_arguments: str, folder: Path, processes: int) -> tuple[bool, str]:
        assert yaml.safe_load((folder / "params.yaml").read_text())["clip"]["source"] == "carp"
        assert processes == 1
        assert not (folder / "reports").exists() and not (folder / "conf/local").is_file()
        save_numbers(folder / "reports/clip", {"frames": number})
        save_numbers(folder / "reports/realism", {"auc": 0.5})
        (folder / "reports/index.html").write_text("<p>the report</p>")
        return (
            not fails,
            "Running stage\nfinloop: no fish\n  wanted: fish\n  do: film one\nERROR: x",
        )

    return run_dvc


def test_numbers_are_kept_compared_and_shown(lab, monkeypatch, capsys):
    monkeypatch.chdir(lab)
    before = Path("params.yaml").read_text()
    monkeypatch.setattr(stages.fixture, "run_dvc", fake_dvc(100))
    monkeypatch.setattr("sys.argv", ["fixture", "--keep"])
    save_numbers(KEPT.parent, {"clip.frames": 90, "clip.gone": 1})
    main()
    assert load_numbers(KEPT.parent) == {"clip.frames": 100}  # none of realism: DVC caches it
    assert (OUT / "index.html").read_text() == "<p>the report</p>"
    assert "1 numbers of the tiny film, 0 of them" in capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["fixture"])
    monkeypatch.setattr(stages.fixture, "run_dvc", fake_dvc(99))
    with pytest.raises(FinloopError, match=r"clip\.frames \| 100 \| 99"):
        main()
    assert "| clip.frames | 100 | 99 |" in (OUT / "comparison.md").read_text()
    assert load_numbers(KEPT.parent) == {"clip.frames": 100}
    monkeypatch.setattr(stages.fixture, "run_dvc", fake_dvc(100, fails=True))
    with pytest.raises(FinloopError, match=r"no fish(.|\n)*film one(.|\n)*dvc\.log has all"):
        main()
    assert Path("params.yaml").read_text() == before and not list(Path(".dvc/tmp").glob("fix*"))
    KEPT.unlink()
    with pytest.raises(FinloopError, match="S=--keep, and commit it"):
        main()


def test_numbers_differ_by_more_than_a_processor_makes():
    kept = {"a": 5, "b": 0.1234, "c": 0.0, "gone": 1}
    assert compare_numbers(kept, kept | {"b": 0.12345, "c": 1e-5}) == []
    rows = compare_numbers(kept, {"a": 6, "b": 0.124, "c": 0.0, "new": 2})
    assert rows == ["| a | 5 | 6 |", "| b | 0.1234 | 0.124 |", "| gone | 1 | none |"]


def test_a_tiny_film_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(FinloopError, match="No such file"):
        read_tiny_film(tmp_path / "film.yaml")
    (tmp_path / "film.yaml").write_text("- carp\n")
    with pytest.raises(FinloopError, match=r"clip\.frames: 100"):
        read_tiny_film(tmp_path / "film.yaml")
    assert "clip.colour=false" in read_tiny_film(ROOT / FILM)


@pytest.mark.parametrize("command", ["study", "sweep", "runs", "repro", "pull", "ci-fixture"])
def test_a_command_of_the_guides_does_the_same_in_a_lab(command, lab):
    """In finloop's own Makefile a command first makes the environment."""
    recipes = [
        re.search(rf"^{command}:.*\n((?:\t.*\n?)+)", (root / "Makefile").read_text(), re.MULTILINE)
        for root in (ROOT, lab)
    ]
    assert recipes[0] and recipes[1] and recipes[0][1].strip() == recipes[1][1].strip()


def triggers(workflow: dict) -> dict:
    """What a workflow runs on; YAML takes the word `on` for true."""
    return workflow[True]


def test_workflows_call_what_there_is(lab):
    shared = yaml.safe_load((ROOT / WORKFLOWS / "fixture.yml").read_text())
    inputs = triggers(shared)["workflow_call"]["inputs"]
    text = (ROOT / WORKFLOWS / "fixture.yml").read_text()
    assert (lab / WORKFLOWS / "fixture.yml").read_text() == text
    for root in (ROOT, lab):
        rules = (root / "Makefile").read_text()
        jobs = yaml.safe_load((root / WORKFLOWS / "ci.yml").read_text())["jobs"]
        assert (root / jobs["tiny-film"]["uses"]).is_file()
        for step in shared["jobs"]["fixture"]["steps"]:
            for target in re.findall(r"make ([\w-]+)", step.get("run", "")):
                assert re.search(rf"^{target}:.* ## ", rules, re.MULTILINE), target
    own = yaml.safe_load((lab / WORKFLOWS / "ci.yml").read_text())
    assert {"push", "pull_request"} <= {*triggers(own)}
    assert {*own["jobs"]["tiny-film"]["with"]} <= {*inputs}
    assert {*re.findall(r"inputs\.([\w-]+)", text)} == {*inputs}
    assert f"{OUT}/comparison.md" in text and f"path: {OUT}/" in text
    for step in shared["jobs"]["fixture"]["steps"]:
        assert ("uses" in step) != ("run" in step)
    assert "@PYTHON@" not in (lab / WORKFLOWS / "ci.yml").read_text()
