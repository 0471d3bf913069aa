"""Make a run and keep it as an experiment of DVC: `python -m stages.make_run NAME key=value …`.

A sweep or study calls it in a clone of the workspace, which the run changes. `dvc exp run` gives
the same experiment in three times the processor time: it puts the workspace aside and back, and
asks Git once per stage. The run starts from what the clone holds, and is put on the clone's commit.
"""

from stages.run import run  # isort: skip

import argparse
import gc
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from finloop.base.process import die_with_parent
from stages.compose import write_params
from stages.origins import output_paths
from stages.repository import run_git
from stages.settings import PARAMS

PIPELINE, LOCK = Path("dvc.yaml"), Path("dvc.lock")


def keep_experiment(name: str) -> None:
    """Commit the present state as an experiment `name` on the present commit.

    It has what Git tracks, and new files that stages read or write and Git does not ignore.
    """
    stages: dict[str, Any] = yaml.load(PIPELINE.read_text("utf-8"), yaml.CSafeLoader)["stages"]
    paths = {path for stage in stages.values() for path in (*stage["deps"], *output_paths(stage))}
    paths |= {PARAMS.name, PIPELINE.name, LOCK.name}
    listed = run_git("ls-files", "-z", "--others", "--exclude-standard", "--", *sorted(paths))
    run_git("add", "--update")
    if new := [file for file in listed.split("\0") if file]:
        run_git("add", "--", *new)
    head, tree = run_git("rev-parse", "HEAD").strip(), run_git("write-tree").strip()
    commit = run_git("commit-tree", tree, "-p", head, "-m", f"experiment {name}").strip()
    run_git("update-ref", f"refs/exps/{head[:2]}/{head[2:]}/{name}", commit)


def make_run(name: str, stages: Sequence[str], overrides: list[str]) -> None:
    """Compose params.yaml, run stages, and keep the result as an experiment `name`.

    stages: to run, all if empty. overrides: `key=value`. It ends the process if DVC fails.
    """
    from dvc.cli import main  # not at the top: the import takes half a second

    write_params(overrides)
    gc.disable()  # as in call_dvc
    if status := main(["repro", *stages]):
        sys.exit(status)
    keep_experiment(name)


def main() -> None:
    """Make the run on the command line."""
    parser = argparse.ArgumentParser(prog="python -m stages.make_run", description=__doc__)
    parser.add_argument("name", help="of the experiment")
    parser.add_argument("overrides", nargs="*", metavar="key=value")
    parser.add_argument("--stage", action="append", default=[], help="to run; without it, all")
    arguments = parser.parse_args()
    make_run(arguments.name, arguments.stage, arguments.overrides)


if __name__ == "__main__":
    die_with_parent()
    run(main)
