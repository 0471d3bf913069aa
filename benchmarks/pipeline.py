"""Running the real stages in a scratch folder, with some parameters overridden."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from finloop.base.settings import read_conf_values
from finloop.io.numbers import load_numbers
from stages.origins import output_paths

ROOT = Path(__file__).parents[1]
STAGES = ("clip", "extract", "features")


FilmRows = Callable[[str], Iterable[dict[str, Any]]]
"""A function that returns the rows of the film in the present folder, given its name."""


def film_table(film_rows: FilmRows) -> pd.DataFrame:
    """Return the rows of all films, whose working copies the command line names (default: .)."""
    rows: list[dict[str, Any]] = []
    for folder in map(Path, sys.argv[1:] or ["."]):
        name = folder.resolve().name
        with chdir(folder):
            rows += film_rows(name)
    return pd.DataFrame(rows)


def write_film_table(benchmark: str, film_rows: FilmRows) -> None:
    """Print `film_table` and write it beside the benchmark's file."""
    table = film_table(film_rows)
    print(table.round(3).to_string())
    table.to_csv(Path(benchmark).with_suffix(".csv"), index=False, float_format="%.3g")


def write_table(
    benchmark: str, table: pd.DataFrame, float_format: str | None = None, part: str | None = None
) -> None:
    """Print a table and write it beside the benchmark's file, as CSV in `float_format`.

    part: the column that names the part of the benchmark of which a row is. Parts that the table
    lacks keep their rows in the file; None: the file is the table.
    """
    print(table.to_string(index=False))
    path = Path(benchmark).with_suffix(".csv")
    if part is not None and path.exists():
        before = pd.read_csv(path)
        table = pd.concat([before[~before[part].isin(table[part])], table])
    table.to_csv(path, index=False, float_format=float_format)


def prepare_folder(folder: Path, overrides: Sequence[str]) -> None:
    """Give `folder` a copy of conf/ and the params.yaml that `overrides` compose to."""
    if not (folder / "conf").exists():
        shutil.copytree(ROOT / "conf", folder / "conf")
        shutil.copytree(ROOT / "hydra_plugins", folder / "hydra_plugins")
    _run_python(folder, "stages.compose", *overrides)


def run_stage(folder: Path, stage_name: str) -> dict[str, Any]:
    """Run one stage in `folder`; return its numbers in reports/, empty for stages `modes-…`."""
    _run_python(folder, f"stages.{stage_name.replace('-', '.')}")
    return load_numbers(folder / f"reports/{stage_name}")


def written_paths(stage: dict[str, Any]) -> set[str]:
    """Return the paths that a stage of dvc.yaml writes."""
    return set(output_paths(stage))


def does_read(dep: str, out: str) -> bool:
    """Return whether a stage with dependency `dep` reads an output `out`."""
    return dep == out or dep.startswith(f"{out}/") or out.startswith(f"{dep}/")


def load_stages() -> dict[str, dict[str, Any]]:
    """Return the stages of dvc.yaml by name, in their order."""
    stages: dict[str, dict[str, Any]]
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    return stages


def with_dependencies(stage_names: Iterable[str]) -> list[str]:
    """Return stages and all they depend on, in the order of dvc.yaml.

    Parameters in a dependency's path, such as the mode, have their values in conf/.
    """
    stages = load_stages()
    makers = [(out, name) for name, stage in stages.items() for out in written_paths(stage)]
    todo, wanted = [*stage_names], set[str]()
    while todo:
        wanted.add(name := todo.pop())
        deps = {*map(fill_in_parameters, stages[name]["deps"])}
        todo += {maker for out, maker in makers if any(does_read(d, out) for d in deps)} - wanted
    return [name for name in stages if name in wanted]


def data_stages(stage_names: Iterable[str]) -> list[str]:
    """Return the given stages and all they depend on, except checks and plots."""
    return [name for name in with_dependencies(stage_names) if does_make_data(name)]


def does_make_data(stage_name: str) -> bool:
    """Return whether a stage makes more than checks and plots."""
    return stage_name not in ("code", "params") and not stage_name.startswith("plots-")


def fill_in_parameters(dep: str) -> str:
    """Return a dependency of dvc.yaml with values from conf/ for its parameters, `${group.key}`."""
    return re.sub(
        r"\$\{(\w+)\.(\w+)\}", lambda name: str(read_conf_values(name[1], "default")[name[2]]), dep
    )


_LAUNCHER = """
import resource, subprocess, sys
status = subprocess.run(sys.argv[1:]).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(status)
"""


def peak_mib(folder: Path, *arguments: str) -> float:
    """Return the peak memory, in MiB, of the largest process of `python arguments` in `folder`.

    A process's `ru_maxrss` begins at the peak of its parent. So a launcher that has loaded next to
    nothing starts it, and reports its child's peak.
    """
    command = [sys.executable, "-I", "-S", "-c", _LAUNCHER, sys.executable, *arguments]
    return int(_run_and_read(folder, command).split()[-1]) / 1024


def _run_python(folder: Path, *arguments: str) -> None:
    """Run Python with arguments in a folder."""
    _run_and_read(folder, [sys.executable, "-m", *arguments])


def _run_and_read(folder: Path, command: list[str]) -> str:
    """Run a command in a folder, and return what it prints."""
    done = subprocess.run(
        command, cwd=folder, env=process_environment(), capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
    return done.stdout


def process_environment() -> dict[str, str]:
    """Return environment variables for a process that imports the program from anywhere."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return dict(os.environ) | {"PYTHONPATH": path}
