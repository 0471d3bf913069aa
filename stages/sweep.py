"""Run a sweep: `python -m stages.sweep learning_rate [key=value …]`, or `make sweep experiment=…`.

Every run is a `dvc exp run` on the present commit, with the present params.yaml. The runs are made
in copies of the workspace that share its cache, one copy per processor. The workspace does not
change, and a stage with a cached result is not run again. An existing experiment with the same code
and parameters is reused.
"""

from stages.run import THREADS, report_progress, run  # isort: skip  (before numpy)

import argparse
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from finloop.base.errors import FinloopError
from finloop.base.program import holds_sources
from stages.code import OUT as CODE
from stages.code import file_lists
from stages.compare import OUT, list_experiments, run_git, write_comparison
from stages.compose import compose_params, load_experiment
from stages.settings import LOCAL, PARAMS, list_overrides, read_params

# The command `dvc`, in a process that ends with this one. It is short and makes many small objects,
# of which garbage collection would take a sixth of its time.
DVC = """
import gc, sys
gc.disable()
from dvc.cli import main
from finloop.base.process import die_with_parent
die_with_parent()
sys.exit(main())
"""
RESULTS = (PARAMS.name, "dvc.lock", "reports")  # what git has and a run changes
LAST_LINES = 12  # of the output of a failed run


def _clone(root: Path, folder: Path, cache: str) -> None:
    """Clone the repository `root`, with uncommitted changes, into `folder`; share DVC's cache.

    cache: path of the cache.
    """
    run_git("clone", "--quiet", "--shared", str(root), str(folder), folder=root)
    listed = run_git("ls-files", "-z", "--modified", "--others", "--exclude-standard", folder=root)
    ignored = [LOCAL.as_posix()] if (root / LOCAL).is_file() else []
    for name in (*filter(None, listed.split("\0")), *ignored):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name)
        else:
            (folder / name).unlink(missing_ok=True)
    # With the machine code in __pycache__, which takes half a minute to compile.
    if (root / "finloop").is_dir():  # else it is installed
        shutil.copytree(root / "finloop", folder / "finloop", dirs_exist_ok=True)
    settings = f"[cache]\n    dir = {cache}\n"
    (folder / ".dvc/config.local").write_text(settings, encoding="utf-8")


def _run_dvc(*arguments: str, folder: Path) -> tuple[bool, str]:
    """Run a DVC command in a folder; return whether it succeeds, and its output."""
    process = subprocess.run(
        [sys.executable, "-c", DVC, *arguments],
        cwd=folder, text=True, check=False,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return not process.returncode, process.stdout


def _is_same(commit: str, params: str) -> bool:
    """Return whether an experiment has the present code and this text of params.yaml.

    commit: that of the experiment.
    """
    excludes = [f":(exclude){name}" for name in RESULTS]
    changed = subprocess.run(["git", "diff", "--quiet", commit, "--", ".", *excludes], check=False)
    if changed.returncode or run_git("show", f"{commit}:{PARAMS}") != params:
        return False
    return holds_sources(Path.cwd()) or _has_run_same_program(commit)


def _has_run_same_program(commit: str) -> bool:
    """Return whether an experiment has run the program that is installed now."""
    from dvc.api import DVCFileSystem  # not at the top: the import takes half a second

    files = DVCFileSystem(rev=commit)
    try:
        return all(
            files.cat_file((CODE / name).as_posix()) == text.encode()
            for name, text in file_lists().items()
        )
    except OSError:  # it has not listed what it ran, or its lists are not in the cache
        return False


def _make_run(name: str, changes: list[str], stages: list[str], clone: Path) -> str:
    """Make one run in a clone, and fetch its experiment; return "", or its last lines if it failed.

    changes: overrides. stages: to run, all if empty.
    """
    values = [word for change in changes for word in ("-S", change)]
    succeeds, text = _run_dvc("exp", "run", "--name", name, *values, *stages, folder=clone)
    if not succeeds:
        return "\n    ".join(failure_lines(text))
    refs = run_git("for-each-ref", "--format=%(refname)", "refs/exps", folder=clone).split()
    (ref,) = [ref for ref in refs if ref.rpartition("/")[2] == name]
    run_git("fetch", "--quiet", "--no-write-fetch-head", str(clone), f"+{ref}:{ref}")
    return ""


def failure_lines(text: str) -> list[str]:
    """Return finloop's last message in the output of a failed run, or the output's last lines."""
    lines = text.splitlines()
    said = [number for number, line in enumerate(lines) if line.startswith("  wanted: ")]
    if not said:
        return lines[-LAST_LINES:]
    begin = max(number for number in range(said[-1]) if lines[number].startswith("finloop: "))
    end = next(
        (number for number in range(said[-1], len(lines)) if lines[number].startswith("ERROR:")),
        len(lines),
    )
    return lines[begin:end]


def make_runs(
    runs: dict[str, list[str]], stages: list[str], jobs: int, shared: bool = True
) -> dict[str, str]:
    """Make the runs of a sweep; return the failed ones, name → cause.

    runs: name → overrides. stages: to run, all if empty. jobs: runs at a time. shared: whether the
    runs have stages in common, which the first run makes for all.
    """
    root, failures, todo = Path.cwd(), dict[str, str](), list[str]()
    there = list_experiments()
    for name, changes in runs.items():
        try:
            params = compose_params(changes)
        except FinloopError as error:
            failures[name] = str(error)
            continue
        if not (name in there and _is_same(there[name], params)):
            todo.append(name)
    if not todo:
        return failures
    _, cache = _run_dvc("cache", "dir", folder=root)
    status = _run_dvc("status", *stages, folder=root)[1] if shared else "up to date"
    (root / ".dvc/tmp").mkdir(exist_ok=True)
    with (
        TemporaryDirectory(dir=root / ".dvc/tmp", prefix="sweep-") as apart,
        report_progress("runs", len(todo), "runs") as advance,
    ):
        clones = [Path(apart) / str(number) for number in range(min(jobs, len(todo)))]
        for clone in clones:
            _clone(root, clone, cache.strip())

        def make_next(clone: Path) -> bool:
            name = todo.pop(0)
            if why := _make_run(name, runs[name], stages, clone):
                failures[name] = why
            advance()
            return not why

        def make_all(clone: Path) -> None:
            with suppress(IndexError):  # nothing is left
                while True:
                    make_next(clone)

        # The first alone if a stage that all need has not run, so that it runs once.
        while "up to date" not in status and todo and not make_next(clones[0]):
            pass
        with ThreadPoolExecutor(len(clones)) as threads:
            try:
                list(threads.map(make_all, clones))
            finally:
                todo.clear()  # an interrupted sweep starts no further runs
    return failures


def main() -> None:
    """Run a sweep; print the comparison of its runs and write reports/compare.html."""
    parser = argparse.ArgumentParser(prog="make sweep experiment=", description=__doc__)
    parser.add_argument("experiment", help="a name in conf/experiment/")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="for every run")
    parser.add_argument("--jobs", type=int, default=THREADS, help="runs at a time")
    arguments = parser.parse_args()
    plan = load_experiment(arguments.experiment)
    chosen = [f"+experiment={arguments.experiment}", *list_overrides(read_params())]
    params = yaml.safe_load(compose_params(chosen + arguments.overrides))
    names = [name.partition(".")[0] for name in plan.list_seeds()]
    listed = plan.list_runs(
        arguments.experiment, {f"{word}.seed": params[word]["seed"] for word in names}
    )
    runs = {name: chosen + arguments.overrides + changes for name, changes in listed.items()}
    failures = make_runs(runs, plan.stages, max(1, arguments.jobs))
    finished = [name for name in runs if name not in failures]
    if finished:
        text = f"{plan.why} {plan.seen}"
        print(write_comparison(finished, list(plan.measures), plan.title, text))
        print(f"\n{OUT} compares them.")
    if failures:
        for name, why in failures.items():
            print(f"\n{name} failed:\n    {why}", file=sys.stderr)
        raise FinloopError(
            f"{len(failures)} of {len(runs)} runs failed: {', '.join(failures)}",
            "values that the film allows",
            f"see above; the values are in conf/experiment/{arguments.experiment}.yaml",
        )


if __name__ == "__main__":
    run(main)
