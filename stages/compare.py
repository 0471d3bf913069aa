"""Compare experiments: `python -m stages.compare [name …]` writes reports/compare.html.

Without names, all experiments on the present commit and that commit itself. Numbers and parameters
are read from git: no stage runs, and the workspace stays as it is.
"""

from stages.run import run  # isort: skip  (before numpy)

import argparse
import json
import re
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_file
from finloop.report.compare import OBJECTIVES, Comparison, comparison, html
from stages.settings import PARAMS, STAMPS

OUT = Path("reports/compare.html")
BASE = "present commit"


def git(*arguments: str, at: Path | None = None) -> str:
    """The output of a git command; FinloopError with its message if it fails."""
    process = subprocess.run(
        ["git", *arguments], cwd=at, capture_output=True, text=True, check=False
    )
    if process.returncode:
        raise FinloopError(
            f"git {arguments[0]} failed: {process.stderr.strip()}",
            "a repository of git with a commit, and room",
            "git add --all; git commit",
        )
    return process.stdout


def head() -> str:
    """The present commit."""
    return git("rev-parse", "HEAD").strip()


def experiments() -> dict[str, str]:
    """The experiments on the present commit: name → its own commit."""
    parent = head()
    refs = git(
        "for-each-ref", "--format=%(refname) %(objectname)", f"refs/exps/{parent[:2]}/{parent[2:]}"
    )
    lines = (line.split() for line in refs.splitlines())
    return {ref.rpartition("/")[2]: commit for ref, commit in lines}


def parameters(commit: str) -> dict[str, Any]:
    """`group.key` → value."""
    values = yaml.safe_load(git("show", f"{commit}:{PARAMS}"))
    return {
        f"{word}.{key}": value if isinstance(value, int | float | str) else json.dumps(value)
        for word, group in values.items()
        if word not in STAMPS
        for key, value in group.items()
    }


def numbers(commit: str, stages: Iterable[str]) -> dict[str, float]:
    """`stage.number` → value, of the stages that have metrics in this commit."""
    paths = [f"reports/{stage}/metrics.json" for stage in stages]
    files = git("ls-tree", "--name-only", commit, *paths).split()
    return {
        f"{Path(path).parent.name}.{key}": value
        for path in files
        for key, value in json.loads(git("show", f"{commit}:{path}")).items()
    }


def side_by_side(names: list[str], measures: list[str]) -> Comparison:
    """The comparison of the named experiments, by default of all and the present commit."""
    commits_of = experiments()
    if missing := [name for name in names if name not in commits_of]:
        raise FinloopError(
            f"no experiment {', '.join(missing)} on the present commit",
            f"names out of: {', '.join(commits_of) or 'none yet'}",
            "make sweep experiment=…, or dvc exp list",
        )
    commits = {name: commits_of[name] for name in names} if names else commits_of | {BASE: "HEAD"}
    keys = [*measures, *(objective.key for objective in OBJECTIVES)]
    stages = {key.partition(".")[0] for key in keys}
    rows = {name: parameters(commit) for name, commit in commits.items()}
    values = {name: numbers(commit, sorted(stages)) for name, commit in commits.items()}
    return comparison(pd.DataFrame(rows).T, pd.DataFrame(values).T, measures)


def compare(names: list[str], measures: list[str], title: str, why: str) -> Path:
    """Write the page and return its path."""
    with whole_file(OUT) as part:
        part.write_text(html(side_by_side(names, measures), title, why), encoding="utf-8")
    return OUT


def table(swept: Mapping[str, Any], measures: Iterable[str]) -> list[str]:
    """The `dvc exp show` that prints these parameters and numbers, and no others."""
    keys = [*measures, *(objective.key for objective in OBJECTIVES)]
    columns = [*swept, *(key.partition(".")[2] for key in keys)]
    ending = "|".join(map(re.escape, columns))
    return ["dvc", "exp", "show", "--no-pager", "--hide-workspace", "--drop", "^(?!Experiment$).*",
            "--keep", f"(^|[.:])({ending})$"]  # fmt: skip


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(prog="python -m stages.compare", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="of experiments")
    parser.add_argument(
        "--measure", action="append", default=[], metavar="stage.number", help="one more"
    )
    options = parser.parse_args()
    path = compare(options.names, options.measure, "Experiments on one commit", "")
    print(f"{path} compares them.")


if __name__ == "__main__":
    run(main)
