"""A study of several films: `python -m stages.study`, or `make study FILMS="a.mp4 b.mp4"`.

Each film becomes a DVC experiment `study-<name>` on the present commit: the whole pipeline, in a
copy of the workspace that shares its cache, as many at once as there are processors. The workspace
does not change. A film with a result for the same code and settings is not run again, so a study
that was interrupted goes on, and a new film runs alone. reports/study.html has a row for each film,
reports/study.csv the same table, reports/study/<name>.html each film's report.

FILMS names films, or a YAML file::

    films:
      mouse: /films/mouse.mp4
      carp: {clip: carp, clip.frames: 600}
      pale: {path: /films/pale.mp4, extract.min_contrast_ratio: 0.3}
    settings: {animate.trials: 20}  # of all films
"""

from stages.run import THREADS, run  # isort: skip  (before numpy)

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from finloop.base.errors import FinloopError
from finloop.base.override import format_override
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.footage import list_films, unique_film_names
from finloop.io.table import save_csv
from finloop.report.study import COLUMNS, FilmResult, study_page, study_table
from stages.compare import load_numbers
from stages.film import parse_film_paths
from stages.repository import list_experiments
from stages.settings import LOCAL
from stages.sweep import make_runs

PAGE, TABLE, REPORTS = Path("reports/study.html"), Path("reports/study.csv"), Path("reports/study")
PREFIX = "study-"  # of the experiments' names
PICTURES = {
    "what was found in the film": "reports/extract/detections.png",
    "the route of mode hybrid": "reports/render/hybrid.png",
}
REPORT, FINDINGS = "reports/index.html", "data/clip/findings.csv"
NAME = re.compile(r"[\w-]+")
EXAMPLE = "films: {mouse: /films/mouse.mp4, carp: {clip: carp, clip.frames: 600}}"
Overrides = list[str]


def parse_study(text: str) -> tuple[dict[str, Overrides], Overrides]:
    """Return the films of a study, name → overrides, and the overrides that all films share.

    text: paths of films, separated by spaces, or the path of one YAML file. FinloopError if a film
    is missing or stands twice, or the file is not a study.
    """
    path, common = Path(text.strip()).expanduser(), list[str]()
    if path.suffix.lower() in (".yaml", ".yml"):
        films, common = read_study_file(path)
    else:
        paths = [film for name in parse_film_paths(text) for film in list_films(name)]
        names = unique_film_names(paths)
        films = {
            name: clip_path_overrides(str(film.absolute()))
            for name, film in zip(names, paths, strict=True)
        }
    twice = [name for name in films if Counter(map(str, films.values()))[str(films[name])] > 1]
    if twice:
        raise FinloopError(
            f"{' and '.join(twice)} are one film with the same settings",
            "each film once, or with settings of its own",
            "take one of them out",
        )
    return films, common


def read_study_file(path: Path) -> tuple[dict[str, Overrides], Overrides]:
    """Return the films of a study file, name → overrides, and the overrides that all films share.

    FinloopError if it is not a study.
    """
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FinloopError(f"{path} cannot be read: {error}", EXAMPLE, "correct it") from error
    films = values.get("films") if isinstance(values, Mapping) else None
    problems = []
    if not isinstance(films, Mapping) or not films:
        problems.append("it has no films")
    elif set(values) - {"films", "settings"}:
        problems.append(f"it has {', '.join(sorted(set(values) - {'films', 'settings'}))}")
    common = (values.get("settings") or {}) if isinstance(values, Mapping) else {}
    if not isinstance(common, Mapping):
        problems.append("its settings are no `parameter: value`")
    runs: dict[str, Overrides] = {}
    for name, film in (films or {}).items() if not problems else ():
        if not NAME.fullmatch(str(name)):
            problems.append(f"the name {name!r} has more than letters, digits, _ and -")
        own = {"path": film} if isinstance(film, str) else film
        if not isinstance(own, Mapping) or not isinstance(own.get("path", ""), str):
            problems.append(f"{name} is neither a path nor settings")
            continue
        runs[str(name)] = _format_overrides(own, path.parent)
    if problems:
        raise FinloopError(f"{path} is not a study: {'; '.join(problems)}", EXAMPLE, "correct it")
    return runs, _format_overrides(common, path.parent)


def _format_overrides(values: Mapping[str, Any], folder: Path) -> Overrides:
    """Return settings by name as overrides; a relative path of a film is relative to `folder`."""
    overrides = []
    for key, value in values.items():
        if key == "path":
            overrides += clip_path_overrides(str((folder / Path(value).expanduser()).absolute()))
        else:
            overrides.append(f"{key}={value if '.' not in key else format_override(value)}")
    return overrides


def clip_path_overrides(path: str) -> Overrides:
    """Return the overrides that make the film at a path the film of the pipeline."""
    return ["clip=file", f"clip.path={format_override(path)}"]


def load_results(
    films: Mapping[str, Overrides], failures: Mapping[str, str], folder: Path
) -> list[FilmResult]:
    """Return the results of a study's experiments, in the order of its films.

    failures: experiment → why it failed. folder: where each film's report is written.
    """
    from dvc.api import DVCFileSystem  # not at the top: the import takes half a second

    commits = list_experiments()
    there = {name: commits[PREFIX + name] for name in films if PREFIX + name not in failures}
    stages = sorted({column.key.partition(".")[0] for column in COLUMNS})
    found = load_numbers([*{*there.values()}], stages)
    made = []
    for name, settings in films.items():
        if name not in there:
            made.append(FilmResult(name, settings, error=failures[PREFIX + name]))
            continue
        files = DVCFileSystem(rev=there[name])
        values = dict(found[there[name]]) | {"clip.findings": count_findings(files)}
        (folder / f"{name}.html").write_bytes(files.cat_file(REPORT))
        pictures = {text: files.cat_file(path) for text, path in PICTURES.items()}
        made.append(FilmResult(name, settings, values, pictures, f"{REPORTS.name}/{name}.html"))
    return made


def count_findings(files: Any) -> int:
    """Return how many checks of the film found a fault.

    files: the file system of an experiment.
    """
    table = pd.read_csv(StringIO(files.cat_file(FINDINGS).decode()))
    return int((table["verdict"] != "good").sum())


def main() -> None:
    """Run the films of a study; write reports/study.html, study.csv and each film's report."""
    parser = argparse.ArgumentParser(prog="make study FILMS=", description=__doc__)
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="for every film")
    parser.add_argument("--jobs", type=int, default=THREADS, help="films at a time")
    arguments = parser.parse_args()
    films, common = parse_study(os.environ.get("FILMS", ""))
    common += arguments.overrides
    list_experiments()  # raises if there is no commit for them
    if LOCAL.is_file():
        print(f"finloop: a study does not use {LOCAL}", file=sys.stderr)
    runs = {PREFIX + name: ["~local", *common, *settings] for name, settings in films.items()}
    failures = make_runs(runs, [], max(1, arguments.jobs), shared=False)
    with whole_folder(REPORTS) as folder:
        films_made = load_results(films, failures, folder)
    save_csv(TABLE, study_table(films_made), decimals=4)
    save_bytes(PAGE, study_page(films_made, common).encode())
    print(f"\nDone: {PAGE}, {TABLE}")
    for name, why in failures.items():
        print(f"\n{name} failed:\n    {why}", file=sys.stderr)
    if failures:
        raise FinloopError(
            f"{len(failures)} of {len(films)} films failed: {', '.join(failures)}",
            "films that the pipeline can measure",
            "see above; then `make study` again: films with a result are not run again",
        )


if __name__ == "__main__":
    run(main)
