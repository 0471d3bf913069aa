"""Choose where a stage computes: on this machine, or with the workers that conf/cluster/ names.

`python -m stages.cluster tcp://host:8786 [--count N]` starts workers of a Dask scheduler on this
machine, in this folder. No stage has the parameters `cluster` under `params` in dvc.yaml: results
are the same bytes, so a change of them runs no stage again. A stage reads them from params.yaml.
"""

from stages.run import PROCESSES, THREAD_VARIABLES, THREADS, run  # isort: skip  (before numpy)

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.base.parallel import Processes, Threads, Workers, start_fork_server
from finloop.cluster.settings import ClusterSettings, DefaultWorkers
from stages.settings import load_settings


@contextmanager
def open_workers(modules: Sequence[str], threads: bool = False) -> Iterator[Workers]:
    """Yield the workers of a stage: processes of this machine, or those of a cluster.

    modules: names of those that workers import first. threads: whether this machine's are threads.
    """
    p: ClusterSettings = load_settings("cluster")
    if isinstance(p, DefaultWorkers) and p.scheduler_address is None:
        # Where a sweep makes a run on each processor, two processes of a run gain nothing, and take
        # time to start.
        count = int(os.environ.get(PROCESSES, THREADS))
        if count > 1 and not threads:
            start_fork_server(modules)
        yield Threads(THREADS) if threads else Processes(count)
        return
    from finloop.cluster.workers import WorkerHome, connect_dask_workers  # loads a compiler

    address = p.scheduler_address if isinstance(p, DefaultWorkers) else ""
    start = f"python -m stages.cluster {address}"  # how the user starts a worker, for messages
    home = WorkerHome.from_process(Path.cwd(), start, THREAD_VARIABLES)
    with connect_dask_workers(p, home, THREADS, modules) as cluster:
        dashboard = cluster.client.dashboard_link
        watch = f"; watch them at {dashboard}" if dashboard else ""
        print(f"finloop: {cluster.count} workers of Dask{watch}", file=sys.stderr)
        yield cluster


def main() -> None:
    """Replace this process by Dask workers for a scheduler on this machine."""
    parser = argparse.ArgumentParser(prog="python -m stages.cluster", description=__doc__)
    parser.add_argument("address", help="address of Dask's scheduler: tcp://host:8786")
    parser.add_argument("--count", type=int, default=THREADS, help="workers, one thread each")
    arguments = parser.parse_args()
    if not find_spec("distributed"):
        raise FinloopError(
            "Dask is not installed", "the packages of the extra `cluster`", "run `make cluster`"
        )
    command = (sys.executable, "-m", "dask", "worker", arguments.address)
    # A memory limit would count mapped files, and end workers that map a long film.
    limits = ("--nthreads", "1", "--nworkers", str(arguments.count), "--memory-limit", "0")
    path = os.pathsep.join(filter(None, (str(Path.cwd()), os.environ.get("PYTHONPATH"))))
    os.execve(sys.executable, (*command, *limits), os.environ | {"PYTHONPATH": path})


if __name__ == "__main__":
    run(main)
