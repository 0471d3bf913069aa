"""The run on a tiny carp, stage by stage in this process, shared by all workers and test files."""

import fcntl
import importlib
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import ROOT, TINY_CARP
from scratch import prepare

STAGES: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
GIVEN = ("benchmarks", "data/drawings", "data/gaits")  # what stages read and none makes


def paths(stage: dict[str, Any]) -> set[str]:
    """What a stage of dvc.yaml writes."""
    every = [*stage.get("outs", []), *stage.get("metrics", []), *stage.get("plots", [])]
    return {next(iter(one)) if isinstance(one, dict) else one for one in every}


def with_those_before(words: Iterable[str]) -> list[str]:
    """Stages and all that they wait for, in the order of dvc.yaml, in which each can run."""
    makers = [(Path(out), one) for one, stage in STAGES.items() for out in paths(stage)]
    todo, wanted = [*words], set[str]()
    while todo:
        wanted.add(word := todo.pop())
        deps = [Path(dep) for dep in STAGES[word]["deps"]]  # a folder, or in one
        near = {one for out, one in makers for dep in deps if dep in (out, *out.parents)}
        todo += near - wanted
    return [one for one in STAGES if one in wanted]


@dataclass(frozen=True)
class TinyRun:
    """What stages make of TINY_CARP, in a folder that no test writes to.

    Fixtures of a module or a session ask for it: a test may have patched what a stage uses.
    """

    folder: Path

    def bring(self, to: Path, words: Iterable[str]) -> None:
        """Copy what `words` and all stages before them make; run those that have not run yet."""
        self.folder.mkdir(exist_ok=True)
        with (self.folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # the other worker waits, and finds it done
            wanted = with_those_before(words)
            self._run(wanted)
            for out in sorted(set().union(*(paths(STAGES[one]) for one in wanted))):
                (to / out).parent.mkdir(parents=True, exist_ok=True)
                made = self.folder / out
                if made.is_dir():
                    shutil.copytree(made, to / out, dirs_exist_ok=True)
                else:
                    shutil.copy2(made, to / out)

    def _run(self, words: list[str]) -> None:
        done = self.folder / "done"
        if not done.exists():
            prepare(self.folder, *TINY_CARP)
            for given in GIVEN:
                (self.folder / given).parent.mkdir(exist_ok=True)
                (self.folder / given).symlink_to(ROOT / given)
            done.mkdir()
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(self.folder)
            for word in words:
                if not (done / word).exists():
                    importlib.import_module(f"stages.{word.replace('-', '.')}").main()
                    (done / word).touch()
