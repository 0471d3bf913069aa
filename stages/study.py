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
from collections.abc import Iterable, Mapping
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from finloop.base.errors import FinloopError
from finloop.base.finding import FINDINGS_NAME, GOOD
from finloop.base.override import format_override
from finloop.base.yaml_limits import refuse_yaml_bomb
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.footage import list_films, unique_film_names
from finloop.io.numbers import NUMBERS_NAME, parse_numbers
from finloop.io.table import save_csv
from finloop.report.study import COLUMNS, FilmResult, study_page, study_table
from stages.clones import claim_folder
from stages.film import parse_film_paths
from stages.origins import path_digest
from stages.repository import list_experiments, read_git_user, run_git
from stages.settings import LOCAL
from stages.sweep import RunMaker

PAGE, TABLE, REPORTS = Path("reports/study.html"), Path("reports/study.csv"), Path("reports/study")
PREFIX = "study-"  # of the experiments' names
PICTURES = {
    "what was found in the film": "reports/film/extract/detections.png",
    "the route of mode hybrid": "reports/modes/render/hybrid.png",
}
REPORT = "reports/index.html"
FINDINGS = [f"data/{stage}/{FINDINGS_NAME}" for stage in ("clip", "extract", "features")]
STAGES = sorted({column.key.partition(".")[0] for column in COLUMNS})  # whose numbers are shown
NAME = re.compile(r"[\w-]+")
EXAMPLE = "films: {mouse: /films/mouse.mp4, carp: {clip: carp, clip.frames: 600}}"
Overrides = list[str]


def parse_study(text: str) -> tuple[dict[str, Overrides], Overrides]:
    """Return the films of a study, name → overrides, and the overrides common to all.

    text: paths of films, separated by spaces, or the path of one YAML file. FinloopError if a film
    is missing, a film stands twice, or the file is not a study.
    """
    path, common = Path(text.strip()).expanduser(), list[str]()
    if path.suffix.lower() in (".yaml", ".yml"):
        films, common = read_study_file(path)
    else:
        paths = [
            film for name in parse_film_paths(text, "make study FILMS") for film in list_films(name)
        ]
        names = unique_film_names(paths)
        films = {
            name: clip_path_overrides(str(film.absolute()))
            for name, film in zip(names, paths, strict=True)
        }
    require_different_films(films)
    return films, common


def require_different_films(films: Mapping[str, Overrides]) -> None:
    """Raise FinloopError if two films of a study are one film with equal settings.

    films: name → overrides. A film, a link to it and a copy of it count as one film.
    """
    size_counts = Counter(map(_file_size, films.values()))
    first_names: dict[tuple[str, ...], str] = {}  # film and settings → the first name of both
    for name, overrides in films.items():
        key, path = tuple(overrides), _film_path(overrides)
        if path and path.exists():
            # A digest takes long: only files of one size can be copies.
            may_be_copy = path.is_file() and size_counts[_file_size(overrides)] > 1
            film = path_digest(path) if may_be_copy else str(path.resolve())
            key = (film, *(text for text in overrides if not text.startswith("clip.path=")))
        other = first_names.setdefault(key, name)
        if other != name:
            paths = {str(_film_path(films[twin]) or "") for twin in (other, name)}
            both_paths = f" ({' and '.join(sorted(paths))})" if len(paths) > 1 else ""
            raise FinloopError(
                f"{other} and {name} are one film with the same settings{both_paths}",
                "each film once, or with settings of its own",
                "take one of them out",
            )


def _film_path(settings: Overrides) -> Path | None:
    """Return the path of the film that overrides name; None if they name none."""
    paths = [text.partition("=")[2] for text in settings if text.startswith("clip.path=")]
    # The value is YAML with "${" escaped, as `clip_path_overrides` writes it.
    return Path(yaml.safe_load(paths[-1].replace("\\${", "${"))) if paths else None


def _file_size(settings: Overrides) -> int | None:
    """Return the size in bytes of the film that overrides name; None if there is no file."""
    path = _film_path(settings)
    return path.stat().st_size if path and path.is_file() else None


def read_study_file(path: Path) -> tuple[dict[str, Overrides], Overrides]:
    """Return the films of a study file, name → overrides, and the overrides common to all.

    FinloopError lists what makes the file no study.
    """
    try:
        text = path.read_text(encoding="utf-8")
        refuse_yaml_bomb(text)
        # Not PyYAML alone, which takes the second of two films of one name, without a word.
        values: Any = OmegaConf.to_container(OmegaConf.load(StringIO(text)))
    except (OSError, ValueError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise FinloopError(f"{path} cannot be read: {error}", EXAMPLE, "correct it") from error
    values = values if isinstance(values, Mapping) else {}
    films, common, problems = values.get("films"), values.get("settings") or {}, []
    if not films:
        problems.append("it has no films")
    elif not isinstance(films, Mapping):
        problems.append("its films are no `name: path`")
    elif unknown := set(values) - {"films", "settings"}:
        problems.append(f"it has {', '.join(sorted(map(str, unknown)))}")
    if not _are_settings(common):
        problems.append("its settings are no `parameter: value`")
    runs: dict[str, Overrides] = {}
    for name, film in () if problems else films.items():
        if not NAME.fullmatch(str(name)):
            problems.append(f"the name {name!r} has more than letters, digits, _ and -")
        settings = {"path": film} if isinstance(film, str) else film
        if not _are_settings(settings):
            problems.append(f"{name} is neither a path nor settings")
            continue
        runs[str(name)] = _format_overrides(settings, path.parent)
    if problems:
        raise FinloopError(f"{path} is not a study: {'; '.join(problems)}", EXAMPLE, "correct it")
    return runs, _format_overrides(common, path.parent)


def _are_settings(values: Any) -> bool:
    """Return whether a value of a study file is settings: names with values, a path as a text."""
    has_names = isinstance(values, Mapping) and all(isinstance(name, str) for name in values)
    return has_names and isinstance(values.get("path", ""), str)


def _format_overrides(values: Mapping[str, Any], folder: Path) -> Overrides:
    """Return settings, name → value, as overrides `key=value`.

    A setting `path` is the film's path, relative to `folder`.
    """
    overrides = []
    for key, value in values.items():
        if key == "path":
            overrides += clip_path_overrides(str((folder / Path(value).expanduser()).absolute()))
        else:
            # A key without a dot is a group, and its value the name of a variant, never quoted.
            overrides.append(f"{key}={value if '.' not in key else format_override(value)}")
    return overrides


def clip_path_overrides(path: str) -> Overrides:
    """Return the overrides with which the pipeline runs on the film at a path."""
    return ["clip=file", f"clip.path={format_override(path)}"]


def collect_results(
    films: Mapping[str, Overrides], failures: Mapping[str, str], folder: Path
) -> list[FilmResult]:
    """Write each film's report to `folder`; return the results of all films, in order.

    films: name → overrides. failures: experiment → why it failed.
    """
    commits, results = list_experiments(), list[FilmResult]()
    for name, settings in films.items():
        experiment = PREFIX + name
        if experiment in failures:
            results.append(FilmResult(name, settings, error=failures[experiment]))
            continue
        files = load_experiment_files(commits[experiment])
        pictures = {text: files[path] for text, path in PICTURES.items() if path in files}
        report = f"{REPORTS.name}/{name}.html" if REPORT in files else ""
        if report:
            (folder / f"{name}.html").write_bytes(files[REPORT])
        results.append(FilmResult(name, settings, read_numbers(files), pictures, report))
    return results


@cache  # `main` reads an experiment before the runs, and after them
def load_experiment_files(commit: str) -> dict[str, bytes]:
    """Return the files of an experiment that a study shows, path → content.

    commit: that of the experiment. A file that its pipeline does not make is left out. FinloopError
    if a file that it makes is neither in DVC's cache nor on the remote.
    """
    from dvc.api import DVCFileSystem  # not at the top: the import takes half a second

    files = DVCFileSystem(rev=commit)
    numbers = [f"reports/{stage}/{NUMBERS_NAME}" for stage in STAGES]
    try:
        return {
            path: files.cat_file(path)
            for path in (*numbers, *FINDINGS, REPORT, *PICTURES.values())
            if files.exists(path)
        }
    except OSError as error:
        raise FinloopError(
            f"the results of an experiment are not in DVC's cache: {error}",
            "what `make study` has made of each film",
            "dvc exp remove its name, and `make study` again",
        ) from error


def read_numbers(files: Mapping[str, bytes]) -> dict[str, float]:
    """Return the numbers in an experiment's files, `<stage>.<number>` → value.

    files: path → content. The number `film.findings`, of faults found in the film, is counted here.
    """
    values = {
        f"{Path(path).parent.name}.{key}": value
        for path, content in files.items()
        if Path(path).name == NUMBERS_NAME
        for key, value in parse_numbers(content.decode()).items()
    }
    tables = [pd.read_csv(StringIO(files[path].decode())) for path in FINDINGS if path in files]
    if tables:
        values["film.findings"] = sum(int((table["verdict"] != GOOD).sum()) for table in tables)
    return values


def forget_lost_results(names: Iterable[str]) -> None:
    """Remove experiments whose results DVC's cache has lost, so that they run again.

    names: of experiments. `dvc gc` removes the results and leaves the experiment in git.
    """
    commits = list_experiments()
    for name in commits.keys() & {*names}:
        try:
            load_experiment_files(commits[name])
        except FinloopError:
            print(f"finloop: the results of {name} are lost, and made again", file=sys.stderr)
            head = run_git("rev-parse", "HEAD").strip()
            run_git("update-ref", "-d", f"refs/exps/{head[:2]}/{head[2:]}/{name}")


def main() -> None:
    """Run the films of a study; write reports/study.html, study.csv and each film's report."""
    parser = argparse.ArgumentParser(prog="make study FILMS=", description=__doc__)
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="for every film")
    parser.add_argument("--jobs", type=int, default=THREADS, help="films at a time")
    arguments = parser.parse_args()
    films, common = parse_study(os.environ.get("FILMS", ""))
    common += arguments.overrides
    list_experiments()  # raises if there is no commit for them
    read_git_user()  # raises if there is none
    claim_folder("stages.study")
    forget_lost_results(PREFIX + name for name in films)
    if LOCAL.is_file():
        print(f"finloop: a study does not use {LOCAL}", file=sys.stderr)
    runs = {PREFIX + name: ["~local", *common, *settings] for name, settings in films.items()}
    with RunMaker(stages=[], jobs=arguments.jobs, shared=False) as maker:  # of all stages
        failures = maker.make(runs)
    with whole_folder(REPORTS) as folder:
        results = collect_results(films, failures, folder)
    save_csv(TABLE, study_table(results), decimals=4)
    save_bytes(PAGE, study_page(results, common).encode())
    print(f"\nDone: {PAGE}, {TABLE}")
    if failures:
        raise FinloopError(
            f"{len(failures)} of {len(films)} films failed: {', '.join(failures)}",
            "films that the pipeline can measure, and settings that it has",
            "correct what is named above, in the study's file or where you typed it; then "
            "`make study` again: films with a result are not run again",
        )


if __name__ == "__main__":
    run(main)
