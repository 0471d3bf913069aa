"""Run a sweep: `python -m stages.sweep learning_rate [key=value …]`, or `make sweep experiment=…`.

Every run is a DVC experiment on the present commit, from what params.yaml says now. They run in
copies of the workspace that share its cache, so the workspace stays as it is, stages whose
parameters do not change are not run again, and every processor has one. In a copy, all runs are
made by one process, and their stages are forked from a server that has imported them: to start DVC
and Python anew takes longer than a short stage itself.

A package, because of a module that is run as `-m stages.sweep` every forked process imports all.
"""

from stages.run import THREADS, progress, run  # isort: skip  (before numpy)

import argparse
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from multiprocessing import get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import networkx as nx
from dvc.exceptions import DvcException
from dvc.repo import Repo
from dvc.stage import run as dvc_run
from dvc.stage.exceptions import StageCmdFailedError
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from finloop.errors import FinloopError
from stages.compare import compare, git, head, table
from stages.compose import composed, experiment
from stages.settings import LOCAL, overrides, read

COMMAND = "exec python -m "  # of every stage in dvc.yaml
LOG = Path(".dvc/tmp/sweep.log")
TOLD = 12  # lines of a failed run's log


def copy(root: Path, folder: Path, cache: Path) -> Path:
    """A clone of the repository `root` with its uncommitted changes and its cache, in `folder`."""
    git("clone", "--quiet", "--shared", str(root), str(folder), at=root)
    listed = git("ls-files", "-z", "--modified", "--others", "--exclude-standard", at=root)
    for name in filter(None, listed.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name)
        else:
            (folder / name).unlink(missing_ok=True)
    if (root / LOCAL).is_file():  # which git ignores
        shutil.copyfile(root / LOCAL, folder / LOCAL)
    # Times too: numba takes its compiled code only for a source as old as it was.
    shutil.copytree(root / "finloop", folder / "finloop", dirs_exist_ok=True)
    settings = f"[cache]\n    dir = {cache}\n"
    (folder / ".dvc/config.local").write_text(settings, encoding="utf-8")
    return folder


def affected(repo: Repo, swept: Collection[str], until: str) -> list[str]:
    """The stages that parameters of the groups `swept` can change, in order, as far as `until`."""
    graph = repo.index.graph.reverse()  # DVC's leads from a stage to what it needs
    stages = {stage.addressing: stage for stage in graph}
    reached = {stages[word] for word in swept}
    reached |= {below for stage in reached for below in nx.descendants(graph, stage)}
    wanted = nx.ancestors(graph, stages[until]) | {stages[until]}
    order = nx.topological_sort(graph.subgraph(reached & wanted))
    return [stage.addressing for stage in order]


def begin(folder: Path) -> None:
    """Go on in a copy, with all that is said in its log, no longer than the parent does."""
    os.chdir(folder)
    LOG.parent.mkdir(exist_ok=True)
    said = os.open(LOG, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    os.dup2(said, 1)
    os.dup2(said, 2)
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    # The kernel cannot tell: for it, the parent is the server.
    threading.Thread(target=watch, daemon=True).start()


def enter(folder: Path, stages: Sequence[str]) -> None:
    """Begin a process that makes runs: in a copy of its own, stages forked, not started."""
    begin(folder)
    get_context("forkserver").set_forkserver_preload([__name__, *map(module, stages)])
    dvc_run._run = forked
    # What is not in the cache is made by the first run.
    with suppress(DvcException), Repo() as repo:
        repo.checkout(force=True)


def forked(executable: str, cmd: str, cwd: str, env: dict[str, str], **_: Any) -> None:
    """What DVC would start as `cmd`, in a process forked from where it is imported already."""
    name = cmd.removeprefix(COMMAND)
    child = get_context("forkserver").Process(target=stage, args=(name, cwd, env))
    child.start()
    child.join()
    if child.exitcode:
        raise StageCmdFailedError(cmd, child.exitcode)


def stage(name: str, folder: str, env: dict[str, str]) -> None:
    """As `python -m name` in that folder."""
    os.environ.clear()
    os.environ.update(env)
    begin(Path(folder))
    run(import_module(module(name)).main)


def module(name: str) -> str:
    """What `python -m name` runs."""
    folder = Path(__file__).parents[2].joinpath(*name.split("."))
    return f"{name}.__main__" if folder.is_dir() else name


def work(name: str, overrides: Sequence[str], stages: Sequence[str], alone: bool) -> str:
    """One run, of these stages and, unless `alone`, all before them; the log's end if it failed."""
    before = LOG.stat().st_size
    try:
        with Repo() as repo:
            repo.experiments.run(
                targets=stages, single_item=alone, params=list(overrides), name=name
            )
    except (DvcException, HydraException, OmegaConfBaseException) as error:
        print(error, flush=True)
        lines = LOG.read_bytes()[before:].decode(errors="replace").splitlines()
        return "\n    ".join(lines[-TOLD:])
    return ""


def keep(name: str, where: Path) -> None:
    """Bring the experiment of a copy into this repository, over one of the same name."""
    refs = git("for-each-ref", "--format=%(refname)", "refs/exps", at=where).split()
    (ref,) = [ref for ref in refs if ref.rpartition("/")[2] == name]
    git("fetch", "--quiet", "--no-write-fetch-head", str(where), f"+{ref}:{ref}")


@contextmanager
def worker(folder: Path, stages: Sequence[str]) -> Iterator[ProcessPoolExecutor]:
    """A process that makes runs in a copy."""
    pool = ProcessPoolExecutor(1, get_context("spawn"), enter, (folder, stages))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def sweep(runs: dict[str, list[str]], base: list[str], until: str, jobs: int) -> dict[str, str]:
    """Make all runs; the ends of the logs of those that failed, by name.

    The first is made alone. The others differ from it in the swept groups only, in copies of its
    copy, so DVC need not look at the stages before those: a tenth of a second for each.
    """
    root, failed = Path.cwd(), dict[str, str]()
    swept = sorted({one.partition(".")[0] for overrides in runs.values() for one in overrides})
    with Repo() as repo:
        stages = affected(repo, swept, until)
        cache = Path(repo.cache.local.path).parents[1]
    (root / ".dvc/tmp").mkdir(exist_ok=True)
    with (
        TemporaryDirectory(dir=root / ".dvc/tmp", prefix="sweep-") as apart,
        ExitStack() as stack,
        progress("sweep", len(runs), "runs") as advance,
    ):

        def start(folder: Path) -> ProcessPoolExecutor:
            return stack.enter_context(
                worker(folder, [f"stages.{name.replace('-', '.')}" for name in stages])
            )

        def make(pool: ProcessPoolExecutor, folder: Path, name: str, alone: bool) -> bool:
            targets = stages if alone else [until]
            if log := pool.submit(work, name, base + runs[name], targets, alone).result():
                failed[name] = log
            else:
                keep(name, folder)
            advance()
            return not log

        todo = list(runs)
        folders = [copy(root, Path(apart) / "0", cache)]
        pools = [start(folders[0])]
        while todo and not make(pools[0], folders[0], todo.pop(0), alone=False):
            pass  # until there is one to go on from
        for number in range(1, min(jobs, len(todo))):
            folders.append(copy(folders[0], Path(apart) / str(number), cache))
            pools.append(start(folders[-1]))

        def turns(pool: ProcessPoolExecutor, folder: Path) -> None:
            with suppress(IndexError):  # nothing is left to do
                while True:
                    make(pool, folder, todo.pop(0), alone=True)

        with ThreadPoolExecutor(len(pools)) as threads:
            list(threads.map(turns, pools, folders))
    return failed


def main() -> None:
    """Run it; print the table and write the page."""
    parser = argparse.ArgumentParser(prog="make sweep experiment=", description=__doc__)
    parser.add_argument("experiment", help="a name in conf/experiment/")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="for every run")
    parser.add_argument("--jobs", type=int, default=THREADS, help="runs at a time")
    given = parser.parse_args()
    asked, base = experiment(given.experiment), overrides(read()) + given.overrides
    runs = asked.runs(given.experiment)
    composed([*base, *next(iter(runs.values()))])  # refused now rather than in every run
    head()  # a commit is there for the experiments to stand on
    failed = sweep(runs, base, asked.until, max(1, given.jobs))
    made = [name for name in runs if name not in failed]
    if made:
        wide = {} if sys.stdout.isatty() else {"COLUMNS": "200"}
        subprocess.run(table(asked.params, asked.measures), env=os.environ | wide, check=False)
        print(f"\n{compare(made, list(asked.measures), asked.title, asked.why)} compares them.")
    if failed:
        for name, log in failed.items():
            print(f"\n{name} failed:\n    {log}", file=sys.stderr)
        raise FinloopError(
            f"{len(failed)} of {len(runs)} runs failed: {', '.join(failed)}",
            "values that the film allows",
            f"see above; conf/experiment/{given.experiment}.yaml holds the values",
        )
