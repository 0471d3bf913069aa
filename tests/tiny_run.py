"""The run on a tiny carp, stage by stage in this process, shared by all workers and test files."""

import fcntl
import importlib
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import ROOT, TINY_CARP
from scratch import prepare

from benchmarks.pipeline import with_dependencies, written_paths
from stages.code import stage_module

PIPELINE: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text())
STAGES: dict[str, Any] = PIPELINE["stages"]
GIVEN = ("benchmarks", "data/drawings", "data/gaits")  # what stages read and none makes


def plot_sources(plot: str | dict[str, Any]) -> set[str]:
    """The paths that an entry of `plots` in dvc.yaml draws: of its `y`, or its name."""
    if isinstance(plot, str):
        return {plot}
    ((name, shape),) = plot.items()
    return {*shape["y"]} if isinstance(shape["y"], dict) else {name}


def pipeline_of(words: Iterable[str]) -> str:
    """dvc.yaml of these stages and all that they wait for, alone."""
    stages = {one: STAGES[one] for one in with_dependencies(words)}
    made = set().union(*map(written_paths, stages.values()))
    shown = [plot for plot in PIPELINE["plots"] if plot_sources(plot) <= made]
    return yaml.safe_dump({"stages": stages, "plots": shown}, sort_keys=False)


def link_given(folder: Path) -> None:
    """Link what stages read and none makes into a folder."""
    for given in GIVEN:
        (folder / given).parent.mkdir(exist_ok=True)
        (folder / given).symlink_to(ROOT / given)


@dataclass(frozen=True)
class TinyRun:
    """What stages make of `overrides`, in a folder that no test writes to.

    Fixtures of a module or a session ask for it: a test may have patched what a stage uses.
    """

    folder: Path
    overrides = TINY_CARP

    def bring(self, to: Path, words: Iterable[str]) -> None:
        """Copy what `words` and all stages before them make; run those that have not run yet."""
        wanted = with_dependencies(words)
        self.folder.mkdir(exist_ok=True)
        self._once("params.yaml", self._prepare)
        for word in wanted:
            self._once(word, partial(self._run, word))
        for out in sorted(set().union(*(written_paths(STAGES[one]) for one in wanted))):
            (to / out).parent.mkdir(parents=True, exist_ok=True)
            made = self.folder / out
            if made.is_dir():
                shutil.copytree(made, to / out, dirs_exist_ok=True)
            else:
                shutil.copy2(made, to / out)

    def _once(self, name: str, make: Callable[[], None]) -> None:
        """Make something if nobody has; a worker that needs it waits for one that makes it."""
        (self.folder / "done").mkdir(exist_ok=True)
        with (self.folder / "done" / name).open("a+") as note:
            fcntl.flock(note, fcntl.LOCK_EX)
            note.seek(0)
            if not note.read():
                make()
                note.write("done\n")

    def _prepare(self) -> None:
        prepare(self.folder, *self.overrides)
        link_given(self.folder)

    def _run(self, word: str) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(self.folder)
            importlib.import_module(stage_module(word)).main()


def stage_run(*words: str) -> Any:
    """Return a fixture of a module: a folder in which stages, and all before them, have run."""

    @pytest.fixture(scope="module")
    def run(tmp_path_factory: pytest.TempPathFactory, tiny_run: TinyRun) -> Path:
        folder = tmp_path_factory.mktemp(words[0])
        prepare(folder, *TINY_CARP)
        tiny_run.bring(folder, words)
        return folder

    return run


def copy_of(run: str, *others: str) -> Any:
    """Return a fixture: the working folder is a copy of a run; other fixtures are set up, too."""

    @pytest.fixture
    def workspace(
        request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> Path:
        for name in others:
            request.getfixturevalue(name)
        shutil.copytree(request.getfixturevalue(run), tmp_path, dirs_exist_ok=True)
        monkeypatch.chdir(tmp_path)
        return tmp_path

    return workspace
