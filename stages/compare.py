"""Compare experiments: `python -m stages.compare [name …]` writes reports/compare.html.

Without names, all experiments on the present commit and that commit itself. Parameters are read
from git, numbers from git and DVC's cache: no stage runs, and the workspace stays as it is.
"""

from stages.run import run  # isort: skip  (before numpy)

import argparse
import json
import subprocess
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from finloop.io.numbers import NUMBERS_NAME, parse_numbers
from finloop.report.compare import OBJECTIVES, compare_experiments, comparison_page
from stages.settings import PARAMS, STAMPS

OUT = Path("reports/compare.html")
BASE = "present commit"
LINE = 160  # characters of the printed table; runs that do not fit stand below the others


def run_git(*arguments: str, folder: Path | None = None) -> str:
    """Run a git command; return its output, or raise FinloopError with git's message.

    folder: in which it runs, None for the present one.
    """
    process = subprocess.run(
        ["git", *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    if process.returncode:
        raise FinloopError(
            f"git {arguments[0]} failed: {process.stderr.strip()}",
            "a git repository with a commit, and room",
            "git add --all; git commit",
        )
    return process.stdout


def list_experiments() -> dict[str, str]:
    """Return the DVC experiments on the present commit, name → commit of the experiment.

    FinloopError if there is no commit.
    """
    head = run_git("rev-parse", "HEAD").strip()
    refs = run_git(
        "for-each-ref", "--format=%(refname) %(objectname)", f"refs/exps/{head[:2]}/{head[2:]}"
    )
    lines = (line.split() for line in refs.splitlines())
    return {ref.rpartition("/")[2]: commit for ref, commit in lines}


def _load_parameters(commit: str) -> dict[str, Any]:
    """Return a commit's parameters as `group.key` → value; lists and mappings as JSON texts."""
    values = yaml.safe_load(run_git("show", f"{commit}:{PARAMS}"))
    return {
        f"{word}.{key}": value if isinstance(value, int | float | str) else json.dumps(value)
        for word, group in values.items()
        if word not in STAMPS
        for key, value in group.items()
    }


def load_numbers(commits: list[str], stages: list[str]) -> dict[str, dict[str, float]]:
    """Return the numbers of some stages in some commits: commit → {`stage.number`: value}."""
    from dvc.repo import Repo  # not at the top: the import takes half a second

    paths = [f"reports/{stage}/metrics.json" for stage in stages]
    with Repo() as repo:
        shown = repo.metrics.show(targets=paths, revs=commits, on_error="ignore")
    values = {
        commit: {
            f"{Path(path).parent.name}.{key}": value
            for path, file in found.get("data", {}).items()
            for key, value in file.get("data", {}).items()
        }
        for commit, found in shown.items()
    }
    for commit in commits:  # git keeps all numbers of most stages
        kept = run_git("ls-tree", "--name-only", commit, *(f"reports/{stage}/" for stage in stages))
        for path in filter(lambda path: Path(path).name == NUMBERS_NAME, kept.splitlines()):
            stage = Path(path).parent.name
            numbers = parse_numbers(run_git("show", f"{commit}:{path}"))
            values[commit] |= {f"{stage}.{key}": value for key, value in numbers.items()}
    return values


def write_comparison(names: list[str], measures: list[str], title: str, why: str) -> str:
    """Write reports/compare.html, which compares experiments; return its table as text.

    names: of experiments; none for all of them and the present commit. measures: further
    `<stage>.<number>`. title, why: heading and text of the page. FinloopError if a name is unknown.
    """
    commits_of = list_experiments()
    if missing := [name for name in names if name not in commits_of]:
        raise FinloopError(
            f"no experiment {', '.join(missing)} on the present commit",
            f"names from: {', '.join(commits_of) or 'none yet'}",
            "correct the name, or run its sweep first: `make sweep experiment=…`",
        )
    commits = {name: commits_of[name] for name in names} if names else commits_of | {BASE: "HEAD"}
    keys = [*measures, *(objective.key for objective in OBJECTIVES)]
    stages = sorted({key.partition(".")[0] for key in keys})
    parameters = {name: _load_parameters(commit) for name, commit in commits.items()}
    found = load_numbers([*{*commits.values()}], stages)
    values = {name: found.get(commit, {}) for name, commit in commits.items()}
    table = compare_experiments(pd.DataFrame(parameters).T, pd.DataFrame(values).T, measures)
    save_bytes(OUT, comparison_page(table, title, why).encode())
    rows = pd.concat([table.parameters, table.measures.map("{:.4g}".format)], axis=1).T
    lines = [
        f"{effect.parameter} → {effect.measure}: {effect.verdict}." for effect in table.effects
    ]
    return "\n".join([rows.to_string(line_width=LINE), "", *lines])


def main() -> None:
    """Write reports/compare.html and print its table."""
    parser = argparse.ArgumentParser(prog="python -m stages.compare", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="experiments to compare")
    parser.add_argument(
        "--measure", action="append", default=[], metavar="stage.number", help="one more measure"
    )
    options = parser.parse_args()
    print(write_comparison(options.names, options.measure, "Experiments on one commit", ""))
    print(f"\n{OUT} compares them.")


if __name__ == "__main__":
    run(main)
