"""Run the pipeline on a tiny drawn film, and compare its numbers with earlier ones.

`make ci-fixture` calls `python -m stages.fixture`. The film and its settings are in
.ci/fixture/film.yaml, the kept numbers in .ci/fixture/metrics.json. The run is made in copies of
the workspace, without conf/local/, and from an empty cache: the workspace does not change.
reports/fixture/ gets the report, all numbers, the comparison, and what DVC has printed. The exit
status is 1 where a number is not the kept one. `--keep` keeps the present values instead.
Numbers that differ between processors are not in the file, and not compared.
"""

from stages.run import report_progress, run  # isort: skip

import argparse
import math
import shutil
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from finloop.io.numbers import NUMBERS_NAME, load_numbers, save_numbers
from stages.clones import APART
from stages.compose import write_params
from stages.forks import open_stage_server
from stages.repository import failure_lines, run_dvc, run_git
from stages.settings import PARAMS, format_override

FILM, KEPT = Path(".ci/fixture/film.yaml"), Path(".ci/fixture") / NUMBERS_NAME
OUT = Path("reports/fixture")
SIDE_STAGES = ("morph", "gait", "modes-matching", "modes-hybrid", "tank", "export")
"""Stages that run beside the others, in this order; most are done before the others reach them."""
TOLERANCE = 1e-3  # largest relative difference of like numbers; half of it: the largest absolute


def read_tiny_film(path: Path) -> list[str]:
    """Return the settings of the tiny film, from the file `path`, as overrides `key=value`.

    FinloopError if it cannot be read.
    """
    try:
        values = dict(yaml.safe_load(path.read_text(encoding="utf-8")))
    except (OSError, TypeError, ValueError, yaml.YAMLError) as error:
        raise FinloopError(
            f"{path} cannot be read: {error}",
            "the tiny film, as `clip: carp` and lines such as `clip.frames: 100`",
            "git checkout it; `finloop new` makes one, too",
        ) from error
    # A key without a dot is a group, and its value the name of a variant, never quoted.
    return [
        f"{key}={format_override(value) if '.' in key else value}" for key, value in values.items()
    ]


def compare_numbers(kept: Mapping[str, float], now: Mapping[str, float]) -> list[str]:
    """Return a Markdown table's rows: the numbers of a run that differ from kept ones.

    kept, now: numbers by name, of an earlier run and of this one. A number that is missing now
    differs; new ones are not compared.
    """
    return [
        f"| {name} | {value} | {now.get(name, 'none')} |"
        for name, value in sorted(kept.items())
        if name not in now or not _is_same(value, now[name])
    ]


def _is_same(first: float, second: float) -> bool:
    """Return whether two whole numbers are equal, or other numbers agree in about three digits.

    Further digits depend on the processor.
    """
    if isinstance(first, int) and isinstance(second, int):
        return first == second
    return math.isclose(first, second, rel_tol=TOLERANCE, abs_tol=TOLERANCE / 2)


def load_comparable_numbers(folder: Path) -> dict[str, float]:
    """Return a run's numbers that are equal on all processors, `stage.number` → value.

    folder: the workspace of the run. Git keeps the numbers of stages whose metrics DVC does not
    cache; the others differ between processors.
    """
    stages: dict[str, Any] = yaml.safe_load((folder / "dvc.yaml").read_text("utf-8"))["stages"]
    numbers: dict[str, float] = {}
    for name, stage in stages.items():
        # A path with an option is {path: {cache: false}}.
        if any(isinstance(path, dict) for path in stage.get("metrics", [])):
            values = load_numbers(folder / "reports" / name)
            numbers |= {f"{name}.{key}": value for key, value in values.items()}
    return numbers


def copy_workspace(folder: Path, cache: Path) -> None:
    """Copy the files that git tracks or would add, without results, into a new repository.

    folder: of the copy. cache: the folder of the copy's DVC cache.
    """
    listed = run_git("ls-files", "-z", "--cached", "--others", "--exclude-standard")
    for name in filter(None, listed.split("\0")):
        if Path(name).is_file() and not name.startswith(("reports/", "dvc.lock")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(name, folder / name)
    for package in (path.parent for path in Path("finloop").glob("**/__init__.py")):
        compiled = package / "__pycache__"  # machine code takes half a minute to compile: shared
        compiled.mkdir(exist_ok=True)
        (folder / compiled).symlink_to(compiled.absolute())
    run_git("init", "--quiet", folder=folder)
    settings = f"[cache]\n    dir = {cache}\n"
    (folder / ".dvc/config.local").write_text(settings, encoding="utf-8")


def run_on_tiny_film(overrides: list[str]) -> dict[str, float]:
    """Run the pipeline on the tiny film; return its numbers, and put log and report in `OUT`.

    Two copies of the workspace run at the same time and share DVC's cache: the second makes
    `SIDE_STAGES`, so that the first finds them done. Each works on one process: small as the film
    is, more would take longer to start than to work. overrides: the film and its settings.
    FinloopError, with the failed stage's message, if a stage fails.
    """
    APART.mkdir(exist_ok=True)
    with (
        TemporaryDirectory(dir=APART.absolute(), prefix="fixture-") as folder,
        report_progress("fixture", 1, "runs") as advance,
        ExitStack() as servers,
        ThreadPoolExecutor(1) as pool,  # ends before the servers and the folder
    ):
        first, second = Path(folder) / "first", Path(folder) / "second"
        for copy in (first, second):
            copy_workspace(copy, Path(folder) / "cache")
            servers.enter_context(open_stage_server(copy))
        with chdir(first):
            write_params(["~local", *overrides])
        shutil.copyfile(first / PARAMS, second / PARAMS)
        for stage in SIDE_STAGES:
            pool.submit(run_dvc, "repro", stage, folder=second, processes=1)
        succeeds, text = run_dvc("repro", folder=first, processes=1)
        save_bytes(OUT / "dvc.log", text.encode())
        if not succeeds:
            raise FinloopError(
                "\n    ".join(["the pipeline fails on the tiny film:", *failure_lines(text)]),
                "a run of all stages",
                f"see above; {OUT}/dvc.log has all that DVC has printed",
            )
        shutil.copyfile(first / "reports/index.html", OUT / "index.html")
        advance()
        return load_comparable_numbers(first)


def main() -> None:
    """Run the pipeline on the tiny film; keep its numbers (--keep), or compare them with kept ones.

    FinloopError if a number differs.
    """
    parser = argparse.ArgumentParser(prog="make ci-fixture", description=__doc__)
    parser.add_argument("--keep", action="store_true", help=f"renew the values in {KEPT}")
    keeps = parser.parse_args().keep
    if not keeps and not KEPT.is_file():
        raise FinloopError(
            f"{KEPT} is missing", "the kept numbers", "make ci-fixture S=--keep, and commit it"
        )
    now = run_on_tiny_film(read_tiny_film(FILM))
    save_numbers(OUT, now)
    if keeps:
        names = load_numbers(KEPT.parent) or now  # all, if no numbers were kept
        save_numbers(KEPT.parent, {name: now[name] for name in names if name in now})
    kept = load_numbers(KEPT.parent)
    rows = compare_numbers(kept, now)
    summary = f"{len(kept)} numbers of the tiny film, {len(rows)} of them not as kept in {KEPT}"
    table = ["", "| number | kept | now |", "|---|---|---|", *rows] if rows else []
    save_bytes(OUT / "comparison.md", "\n".join([summary, *table, ""]).encode())
    print(f"fixture: {summary}\n{OUT}/index.html is the report.")
    if rows:
        raise FinloopError(
            "\n    ".join(["numbers differ (kept, now):", *rows[:20]]),
            f"the numbers in {KEPT}",
            "if the change is meant: make ci-fixture S=--keep, and commit the file",
        )


if __name__ == "__main__":
    run(main)
