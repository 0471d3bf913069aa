"""Run a sweep: `python -m stages.sweep learning_rate`, or `python -m stages.sweep bpn.epochs=5,50`.

`make sweep experiment=learning_rate S="…"` calls it, with the text of S in the variable SWEEP.
Every run becomes an experiment of DVC on the present commit, with the present params.yaml. The runs
are made in copies of the workspace that share its cache, one copy per processor. The workspace does
not change. Cached results of stages, and experiments with the same code and parameters, are reused.
"""

from stages.run import THREADS, report_progress, run  # isort: skip  (before numpy)

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from finloop.base.errors import FinloopError
from finloop.base.parallel import start_fork_server
from finloop.base.program import holds_sources
from finloop.base.settings import WORDS, check_values
from finloop.io.numbers import load_numbers as load_stage_numbers
from finloop.report.headlines import HEADLINES
from stages.clones import APART, PREFIX, claim_folder
from stages.code import OUT as CODE
from stages.code import file_lists
from stages.compare import OUT, describe_unknown, load_numbers, write_comparison
from stages.compose import (
    compose_params,
    load_experiment,
    quoting_error,
    refuse_unknown_group,
    refuse_wrong_values,
)
from stages.experiment import FOLDER, Experiment
from stages.forks import open_stage_server
from stages.pull import cache_committed_numbers
from stages.repository import (
    failure_lines,
    list_experiments,
    read_git_user,
    run_dvc,
    run_git,
    run_python,
)
from stages.settings import CONF, LOCAL, PARAMS, list_overrides, read_params
from stages.trials import make_trials

# What may differ between runs of the same code: results, and DVC's settings (a remote's name).
NOT_COMPARED = (PARAMS.name, "dvc.lock", "reports", ".dvc")
AFTER_ANIMATE = {*WORDS[WORDS.index("animate") + 1 :]}  # stages that `animate` does not need


def _clone(root: Path, folder: Path, cache: str) -> None:
    """Clone the repository `root` with uncommitted changes into `folder`; share DVC's cache.

    cache: path of DVC's cache, which the clone then uses.
    """
    run_git("clone", "--quiet", "--shared", str(root), str(folder), folder=root)
    listed = run_git("ls-files", "-z", "--modified", "--others", "--exclude-standard", folder=root)
    ignored = [LOCAL.as_posix()] if (root / LOCAL).is_file() else []
    for name in (*filter(None, listed.split("\0")), *ignored):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name)
        else:  # git has it, but it is deleted in the workspace
            (folder / name).unlink(missing_ok=True)
    # Also the machine code in __pycache__, which takes half a minute to compile.
    if (root / "finloop").is_dir():  # else it is installed
        shutil.copytree(root / "finloop", folder / "finloop", dirs_exist_ok=True)
    for key, value in zip(("user.name", "user.email"), read_git_user(), strict=True):
        run_git("config", key, value, folder=folder)
    settings = f"[cache]\n    dir = {cache}\n"
    (folder / ".dvc/config.local").write_text(settings, encoding="utf-8")
    drop_lock_without_results(folder / "dvc.lock", Path(cache))


def drop_lock_without_results(lock: Path, cache: Path) -> None:
    """Remove a dvc.lock that names a folder of results that DVC's cache lacks.

    lock: the file; cache: folder of the cache. DVC stops at such a lock as soon as it takes a stage
    from the cache: it looks up the folders that the lock names.
    """
    if not lock.is_file():
        return
    # Dependencies that git keeps, such as finloop/, are folders, too, and need not be there.
    stages = yaml.load(lock.read_text("utf-8"), yaml.CSafeLoader)["stages"].values()
    digests = [output["md5"] for stage in stages for output in stage.get("outs", [])]
    folders = [digest for digest in digests if digest.endswith(".dir")]
    if not all((cache / "files/md5" / name[:2] / name[2:]).is_file() for name in folders):
        lock.unlink()


def _has_same_code_and_params(commit: str, params: str) -> bool:
    """Return whether an experiment's commit has the present code and `params` as params.yaml."""
    excludes = [f":(exclude){name}" for name in NOT_COMPARED]
    changed = subprocess.run(["git", "diff", "--quiet", commit, "--", ".", *excludes], check=False)
    if changed.returncode or run_git("show", f"{commit}:{PARAMS}") != params:
        return False
    # Where the program is installed elsewhere, git does not know it.
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


def _make_run(name: str, changes: list[str], stages: list[str], clone: Path, processes: int) -> str:
    """Make one run in a clone and fetch its experiment; return "", or why it failed.

    changes: overrides. stages: to run, all if empty. processes: the number of processes of a stage.
    """
    options = [f"--stage={stage}" for stage in stages]
    command = "-m", "stages.make_run", name, *changes, *options
    succeeds, text = run_python(*command, folder=clone, processes=processes)
    if not succeeds:
        return "\n    ".join(failure_lines(text))
    ref = f"refs/exps/*/{name}"
    run_git("fetch", "--quiet", "--no-write-fetch-head", str(clone), f"+{ref}:{ref}")
    return ""


def _print_failure(name: str, cause: str) -> None:
    """Print at once that a run has failed, and why."""
    print(f"\n{name} failed:\n    {cause}\n", file=sys.stderr, flush=True)


def describe_run(name: str, seconds: float, folder: Path, measures: Sequence[str]) -> str:
    """Return the line that reports a finished run: its name, how long it took, its measures.

    folder: where it ran. measures: `<stage>.<number>`; those that the run lacks are left out.
    """
    parts = [f"{name}: {seconds:.0f} s"]
    for measure in measures:
        stage, _, number = measure.partition(".")
        value = load_stage_numbers(folder / "reports" / stage).get(number)
        if value is not None:
            parts.append(f"{measure} {value:.4g}")
    return ", ".join(parts)


class RunMaker(ExitStack):
    """Makes runs in clones of the workspace, as many at once as there are clones.

    stages: to run, all if empty. jobs: runs at a time. shared: whether the runs have stages in
    common, which the first run makes for all. measures: `<stage>.<number>`, to print with each
    finished run. As a context manager it removes its clones at the end.
    """

    def __init__(
        self, stages: list[str], jobs: int, shared: bool = True, measures: Sequence[str] = ()
    ) -> None:
        """Check that git can store experiments; FinloopError if not."""
        super().__init__()
        self.stages, self.jobs, self.shared = stages, max(1, jobs), shared
        self.measures = measures
        self.existing = list_experiments()  # raises if there is no commit for them
        read_git_user()  # raises if there is none
        self._clones: list[Path] = []

    def make(self, runs: Mapping[str, list[str]]) -> dict[str, str]:
        """Make runs, name → overrides; return the failed ones, name → cause.

        A line is printed when a run ends. An experiment with the same code and parameters is kept.
        """
        todo, failures = self._choose_runs_to_make(runs)
        if not todo:
            return failures
        at_once = min(self.jobs, len(todo))
        print(f"{len(todo)} of {len(runs)} runs to make, {at_once} at a time", file=sys.stderr)
        if replaced := [name for name in todo if name in self.existing]:
            print(
                f"finloop: {', '.join(replaced)}: made again, as the film, the settings or the "
                "code were others; dvc exp rename NAME OTHER keeps one",
                file=sys.stderr,
            )
        self._open_clones(at_once)
        waiting, free_clones = iter(todo), SimpleQueue[Path]()
        for clone in self._clones:
            free_clones.put(clone)
        run_processes = max(1, THREADS // len(self._clones))  # a run goes on in each clone
        with report_progress("runs", len(todo), "runs") as advance:

            def make_run(name: str, processes: int = run_processes) -> bool:
                """Make a run in a free clone, on some processes; return whether it succeeds."""
                clone = free_clones.get()
                try:
                    cause = self._make_and_report(name, runs[name], clone, processes)
                finally:
                    free_clones.put(clone)
                if cause:
                    failures[name] = cause
                advance()
                return not cause

            # Stages that runs have in common are to be made: one run at a time until one succeeds.
            while self.shared and (name := next(waiting, "")):
                self.shared = not make_run(name, THREADS)
            with ThreadPoolExecutor(len(self._clones)) as threads:
                list(threads.map(make_run, waiting))  # if interrupted, it starts no further runs
        return failures

    def _make_and_report(self, name: str, changes: list[str], clone: Path, processes: int) -> str:
        """Make a run in a clone and print how it ended; return "", or the cause if it failed.

        changes: overrides. processes: the number of processes of a stage.
        """
        start_s = time.monotonic()
        cause = _make_run(name, changes, self.stages, clone, processes)
        if cause:
            _print_failure(name, cause)
        else:
            line = describe_run(name, time.monotonic() - start_s, clone, self.measures)
            print(line, file=sys.stderr, flush=True)
        return cause

    def _choose_runs_to_make(
        self, runs: Mapping[str, list[str]]
    ) -> tuple[list[str], dict[str, str]]:
        """Return the names of the runs to make, and the runs that cannot be made, name → cause.

        A run is not made again if there is an experiment of its name with the present code and the
        same parameters. It cannot be made if its overrides are wrong. runs: name → overrides.
        """
        todo, failures = list[str](), dict[str, str]()
        # The overrides with which all runs begin are composed once.
        equal = takewhile(lambda words: len({*words}) == 1, zip(*runs.values(), strict=False))
        common = [words[0] for words in equal]
        values: dict[str, Any] = {}
        for name, changes in runs.items():
            try:
                if name not in self.existing:
                    values = values or yaml.load(compose_params(common), yaml.CSafeLoader)
                    with suppress(KeyError):
                        refuse_wrong_values(values, changes[len(common) :])
                        todo.append(name)
                        continue
                params = compose_params(changes)
            except FinloopError as error:
                failures[name] = str(error)
                _print_failure(name, failures[name])
                continue
            commit = self.existing.get(name)
            if not (commit and _has_same_code_and_params(commit, params)):
                todo.append(name)
        return todo, failures

    def _open_clones(self, count: int) -> None:
        """Make further clones until there are `count`.

        Before the first one, find out whether the stages that runs have in common are to be made.
        """
        root = Path.cwd()
        (root / APART).mkdir(exist_ok=True)
        if not self._clones:
            self._cache = run_dvc("cache", "dir", folder=root)[1].strip()
            cache_committed_numbers(Path(self._cache))
            if self.shared:
                self.shared = "up to date" not in run_dvc("status", *self.stages, folder=root)[1]
            apart = TemporaryDirectory(dir=root / APART, prefix=PREFIX)
            self._folder = Path(self.enter_context(apart))
        while len(self._clones) < count:
            clone = self._folder / str(len(self._clones))
            _clone(root, clone, self._cache)
            self.enter_context(open_stage_server(clone))
            self._clones.append(clone)


def plan_sweep(
    words: Sequence[str], measures: Sequence[str], changes: Mapping[str, Any]
) -> tuple[str, Experiment, list[str]]:
    """Return the name of a sweep, its declaration, and the overrides of all its runs.

    words: a name in conf/experiment/, `key=1,2` to vary and `key=3` for every run. measures: what
    is measured. If there are none, the named sweep declares them; without a name they are the
    headline numbers of the varied stages and of `animate`. changes: other fields of the experiment,
    None = as declared. FinloopError if there is nothing to vary, or a name is unknown.
    """
    names, varied, fixed = _sort_words(words)
    if len(names) > 1 or not (names or varied):
        came = f"more than one sweep: {', '.join(names)}" if names else "nothing to sweep"
        if fixed and not names:
            came += f": {' '.join(fixed)} has one value"
        raise FinloopError(
            came,
            'make sweep experiment=learning_rate, or S="group.key=1,2,3 other.key=4,5"',
            f"name one of {', '.join(list_sweeps())}, or give a parameter several values",
        )
    # What the named sweep declares, changed by what was typed.
    fields: dict[str, Any] = {"title": " and ".join(varied), "why": "", "seen": ""}
    if names:
        fields = asdict(load_experiment(names[0]))
    fields |= {"params": fields.get("params", {}) | varied}
    fields |= {key: value for key, value in changes.items() if value is not None}
    groups = list(dict.fromkeys(key.partition(".")[0] for key in fields["params"]))
    if measures or not names:
        fields["measures"] = list(measures) or _headline_measures(groups)
    name = names[0] if names else "-".join(key.partition(".")[2] for key in varied)
    plan, problems = check_values(FOLDER, {name: Experiment}, fields)
    if plan is None:
        raise FinloopError(
            "\n    ".join(problem.removeprefix(f"{FOLDER}: ") for problem in problems),
            "parameters of conf/, each with two or more values, and numbers of stages",
            f"correct it; `make params S=help={groups[0]}` prints the parameters",
        )
    return name, plan, fixed


def _sort_words(words: Sequence[str]) -> tuple[list[str], dict[str, str], list[str]]:
    """Return the words of a command line, sorted: names, values to vary, and other overrides.

    A name is a word without "=". The values are by `group.key`, in Hydra's notation, as "1,2".
    FinloopError if a word with "=" is no override of Hydra, or varies what no group has.
    """
    names, varied, fixed = list[str](), dict[str, str](), list[str]()
    for word in words:
        if "=" not in word:
            names.append(word)
            continue
        try:
            override = OverridesParser.create().parse_override(word)
        except HydraException as error:
            raise quoting_error([word]) or error from error
        if override.is_sweep_override():
            key = override.key_or_group
            refuse_unknown_group(word, key.partition(".")[0], key)
            varied[override.get_key_element()] = word.partition("=")[2]
        else:
            fixed.append(word)
    return names, varied, fixed


def list_sweeps() -> list[str]:
    """Return the names of the sweeps in conf/experiment/, sorted."""
    return sorted(path.stem for path in (CONF / FOLDER).glob("*.yaml"))


def _headline_measures(groups: Iterable[str]) -> list[str]:
    """Return the names of the headline numbers of stages and of `animate`: `<stage>.<number>`.

    Those of `animate` are left out if it runs before all these stages. groups: names of stages.
    """
    stages = dict.fromkeys(group for group in groups if group in HEADLINES)
    if not {*groups} <= AFTER_ANIMATE:
        stages["animate"] = None
    return [f"{stage}.{headline.name}" for stage in stages for headline in HEADLINES[stage]]


def make_sweep(
    name: str, plan: Experiment, overrides: list[str], jobs: int
) -> tuple[list[str], dict[str, str], str]:
    """Make all runs of a sweep; return the finished ones, the failed ones, and a text.

    overrides: of every run. jobs: runs at a time. The text says what Optuna found, "" for a grid.
    """
    params = yaml.safe_load(compose_params(overrides))
    present = {key: params[key.partition(".")[0]]["seed"] for key in plan.list_seeds()}
    with RunMaker(plan.stages, jobs, measures=plan.measures) as maker:

        def make(runs: Mapping[str, list[str]]) -> dict[str, str]:
            """Make runs, each with its own overrides after the common ones."""
            return maker.make({key: overrides + changes for key, changes in runs.items()})

        if plan.sweeper == "optuna":
            runs, failures, text = make_trials(plan, name, present, jobs, make, read_measure)
        else:
            runs, text = plan.list_runs(name, present), ""
            failures = make(runs)
    return [run for run in runs if run not in failures], failures, text


def read_measure(name: str, measure: str) -> float | None:
    """Return a measure `<stage>.<number>` of an experiment; None if it has none."""
    commit = list_experiments()[name]
    return load_numbers([commit], [measure.partition(".")[0]])[commit].get(measure)


def describe_doubtful_measures(plan: Experiment) -> str:
    """Return the measures of a sweep that the present commit lacks, as text; "" if there is none.

    Measures of stages of which it has no number at all do not count: nobody may have run them.
    """
    present = load_numbers(["HEAD"], plan.stages)["HEAD"]
    known_stages = {name.partition(".")[0] for name in present}
    checked = [name for name in plan.measures if name.partition(".")[0] in known_stages]
    return describe_unknown(checked, present)


def main() -> None:
    """Run the sweep on the command line; print a comparison and write reports/compare.html."""
    parser = argparse.ArgumentParser(prog="make sweep", description=__doc__)
    parser.add_argument("words", nargs="*", metavar="NAME or key=value[,value]")
    parser.add_argument("--seeds", type=int, help="runs of each value")
    parser.add_argument("--sweeper", choices=["grid", "optuna"], help="who chooses the values")
    parser.add_argument("--trials", type=int, help="combinations of values that Optuna tries")
    parser.add_argument("--goal", metavar="stage.number", help="what Optuna improves")
    parser.add_argument(
        "--measure", action="append", default=[], metavar="stage.number", help="what is compared"
    )
    parser.add_argument("--jobs", type=int, default=THREADS, help="runs at a time")
    # From a variable: words may have parentheses, which the shell of make would misunderstand.
    text = os.environ.get("SWEEP", "")
    try:
        arguments = vars(parser.parse_args(sys.argv[1:] + shlex.split(text)))
    except ValueError as error:
        raise FinloopError(
            f'S="{text}" cannot be read: {error}', 'S="group.key=1,2,3"', "close the quotes"
        ) from error
    words, measures, jobs = arguments.pop("words"), arguments.pop("measure"), arguments.pop("jobs")
    name, plan, fixed = plan_sweep(words, measures, arguments)
    chosen = [f"+{FOLDER}={name}"] if name in list_sweeps() else []
    overrides = [*chosen, *list_overrides(read_params()), *fixed]
    claim_folder("stages.sweep")
    if doubtful := describe_doubtful_measures(plan):
        print(f"finloop: the present commit has no number {doubtful}", file=sys.stderr)
    start_fork_server([])  # what draws the films is imported while the runs go on
    finished, failures, found = make_sweep(name, plan, overrides, max(1, jobs))
    if finished:
        why = " ".join(filter(None, (plan.why, plan.seen, found)))
        print(write_comparison(finished, list(plan.measures), plan.title, why))
        print(f"\n{OUT} compares them.")
    if failures:
        raise FinloopError(
            f"{len(failures)} of {len(finished) + len(failures)} runs failed: "
            f"{', '.join(failures)}",
            "values that the film allows",
            "see above, and correct the values",
        )


if __name__ == "__main__":
    run(main)
