"""Compare experiments: `python -m stages.compare [name …]` writes reports/compare.html.

Without names, all experiments on the present commit and that commit itself. Parameters are read
from git, numbers from git and DVC's cache: no stage runs, and the workspace stays as it is.
"""

from stages.run import run  # isort: skip  (before numpy)

import argparse
import json
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from finloop.io.atomic import save_bytes
from finloop.io.numbers import NUMBERS_NAME, parse_numbers
from finloop.report.compare import OBJECTIVES, compare_experiments, comparison_page
from stages.previews import choose_mode, draw_previews
from stages.repository import (
    describe_commit,
    describe_differing_code,
    find_experiments,
    list_experiments,
    run_git,
)
from stages.settings import PARAMS, STAMPS

OUT = Path("reports/compare.html")
BASE = "present commit"
LINE = 160  # characters of the printed table; runs that do not fit stand below the others


def _load_parameters(commit: str) -> dict[str, Any]:
    """Return a commit's parameters, `group.key` → value; lists, mappings and null as JSON texts."""
    content = yaml.safe_load(run_git("show", f"{commit}:{PARAMS}"))
    return {
        f"{group}.{key}": value if isinstance(value, int | float | str) else json.dumps(value)
        for group, parameters in content.items()
        if group not in STAMPS  # digests of files, not parameters
        for key, value in parameters.items()
    }


def load_numbers(commits: list[str], stages: list[str]) -> dict[str, dict[str, float]]:
    """Return some stages' numbers in each of several commits: commit → {`stage.number`: value}.

    Numbers that are neither in git nor in DVC's cache are left out.
    """
    folders = [f"reports/{stage}/" for stage in stages]
    values: dict[str, dict[str, float]] = {commit: {} for commit in commits}
    for commit in commits:
        in_git = run_git("ls-tree", "--name-only", commit, *folders).splitlines()
        for stage in stages:
            path = f"reports/{stage}/{NUMBERS_NAME}"
            if path in in_git:
                text = run_git("show", f"{commit}:{path}")
            else:
                text = _read_cached(commit, path)
            numbers = parse_numbers(text) if text else {}
            values[commit] |= {f"{stage}.{key}": value for key, value in numbers.items()}
    return values


def describe_unknown(measures: Iterable[str], known: Collection[str]) -> str:
    """Return the measures that are not among known ones, as text; "" if there is none.

    Each is followed by the known one that was perhaps meant.
    """
    meant = []
    for name in measures:
        if name not in known:
            near = get_close_matches(name, known, 1)
            meant.append(f"{name} (did you mean {near[0]}?)" if near else name)
    return ", ".join(meant)


def _read_cached(commit: str, path: str) -> str:
    """Return a file's text in a commit, from DVC's cache; "" if it is not there."""
    from dvc.api import DVCFileSystem  # not at the top: the import takes half a second

    try:
        return DVCFileSystem(rev=commit).read_text(path)
    except OSError:
        return ""


def write_comparison(names: list[str], measures: list[str], title: str, why: str) -> str:
    """Write reports/compare.html, which compares experiments; return its table as text.

    names: of experiments; none for all of them and the present commit. measures: numbers
    `<stage>.<number>` to show beside the usual ones; if both names and measures are given, only the
    numbers of the measures' stages are read. title, why: heading and text of the page. FinloopError
    if a name is unknown.
    """
    revisions = find_experiments(names) if names else list_experiments() | {BASE: "HEAD"}
    commits = {name: run_git("rev-parse", rev).strip() for name, rev in revisions.items()}
    keys = [*measures, *(objective.key for objective in OBJECTIVES)]
    stages = {key.partition(".")[0] for key in (measures if names and measures else keys)}
    parameters = {name: _load_parameters(commit) for name, commit in commits.items()}
    numbers = load_numbers([*{*commits.values()}], sorted(stages))
    values = {name: numbers.get(commit, {}) for name, commit in commits.items()}
    table = compare_experiments(pd.DataFrame(parameters).T, pd.DataFrame(values).T, measures)
    # Runs that differ only in their seeds are one experiment; the first of them is drawn.
    first_commits = {run: commits[run] for run in table.first_runs}
    previews = draw_previews(first_commits, choose_mode(measures)) if "animate" in stages else {}
    unknown = describe_unknown(measures, {key for row in values.values() for key in row})
    notes = [
        f"On commit {describe_commit('HEAD')}.",
        describe_differing_code(commits),
        f"There is no number {unknown}." if unknown else "",
    ]
    page = comparison_page(table, title, [why, *notes], commits, previews)
    save_bytes(OUT, page.encode())
    rows = pd.concat([table.parameters, table.measures.map("{:.4g}".format)], axis=1).T
    digests = {name: commits[run][:8] for name, run in zip(rows, table.first_runs, strict=True)}
    rows = pd.concat([pd.DataFrame([digests], ["commit"]), rows])
    lines = [
        f"{effect.parameter} → {effect.measure}: {effect.verdict}." for effect in table.effects
    ]
    return "\n".join([*filter(None, notes), rows.to_string(line_width=LINE), "", *lines])


def main() -> None:
    """Compare the experiments on the command line: write reports/compare.html, print its table."""
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
