"""The workers of a Dask cluster, as `base.parallel.Workers`.

Dask's scheduler keeps all submitted items: if a worker leaves, the others take its pieces, and lost
results are computed again.
"""

import logging
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from finloop.base.errors import FinloopError
from finloop.base.parallel import TRIES, worker_loss_error
from finloop.cluster.piece import Call, Home, load_work, run_piece
from finloop.cluster.settings import ClusterSettings, Local
from finloop.io.atomic import temporary_file

A = TypeVar("A")
B = TypeVar("B")
Client = Any  # distributed.Client, which is there only with the extra

_CONNECT_S = 5.0  # timeout to reach a scheduler
_JOIN_S = 30.0  # timeout for the first worker
_BACK_S = 120.0  # timeout for a worker to return where none is left
_LOOK_S = 5.0  # between two checks whether any worker is left
# On a busy machine a worker takes longer to restart than Dask's default of 15 s.
_LOCAL = {"distributed.deploy.lost-worker-timeout": "1 hour"}
_FOLDER = "data"  # below the stage's folder: where the work lies for the workers


@contextmanager
def dask_workers(
    p: ClusterSettings, home: Home, processes: int, need: Sequence[str] = ()
) -> Iterator["DaskWorkers"]:
    """Connect to a Dask cluster and yield its workers for a block.

    p: a running scheduler's address, or `Local`: a cluster started here with `processes` workers.
    home: what the workers must share with this process. need: names of modules that workers import
    at once. FinloopError if Dask is not installed, no scheduler or worker answers, or a worker has
    another folder or other code.
    """
    distributed = _import_distributed()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # our own messages suffice
    with ExitStack() as stack:
        address: Any = p.source
        if isinstance(p, Local):
            stack.enter_context(import_module("dask").config.set(_LOCAL))
            where = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=processes,
                    threads_per_worker=1,
                    memory_limit=0,  # a limit counts mapped memory: it kills workers of long films
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
        else:
            where = address = p.scheduler_address
        try:
            client = distributed.Client(where, timeout=_CONNECT_S, set_as_default=False)
            stack.enter_context(client)
            client.wait_for_workers(1, _JOIN_S)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise FinloopError(
                f"no scheduler with workers answers at {address} ({error})",
                "Dask's scheduler there, and workers that have joined it",
                f"start them (dask scheduler; {home.start}), or correct cluster.scheduler_address",
            ) from error
        workers = DaskWorkers(client, home, str(address))
        workers.check(need)
        yield workers


@dataclass(frozen=True)
class DaskWorkers:
    """The workers of a Dask cluster, processes of one thread each, as `base.parallel.Workers`.

    home: what they must share with this process. address: the scheduler's, for messages.
    """

    client: Client
    home: Home
    address: str
    alone = False

    @property
    def count(self) -> int:
        """Return the present number of workers, at least 1.

        FinloopError if a worker has more than one thread, or no scheduler answers.
        """
        threads = self.threads()
        if several := [worker for worker, number in threads.items() if number != 1]:
            raise FinloopError(
                f"worker {several[0]} works with {threads[several[0]]} threads",
                "processes of one thread, as many as a machine has cores",
                f"stop it, and start it in {self.home.folder}: {self.home.start}",
            )
        return max(1, len(threads))

    def threads(self) -> dict[str, int]:
        """Return each worker's threads by its address; FinloopError if no scheduler answers."""
        try:
            return dict(self.client.nthreads())
        except (OSError, CancelledError) as error:
            raise self.lost_scheduler_error() from error

    @property
    def dashboard(self) -> str:
        """Return the web address of Dask's dashboard; "" if there is none."""
        return self.client.dashboard_link or ""

    @contextmanager
    def submitter(self, work: Callable[[A], B]) -> Iterator[Callable[[A], "_Task"]]:
        """Share `work` with the workers; yield a function that submits one item to it."""
        name, number = uuid4().hex, count()
        with self._share_work(work) as path:

            def submit(item: A) -> _Task:
                call = pickle.dumps(Call(run_piece, self.home, path, _pickle_bytes(item)))

                def fetch_result() -> Any:
                    key = f"piece-{name}-{next(number)}"
                    try:
                        return self.client.submit(pickle.loads, call, key=key, pure=False)
                    except (OSError, RuntimeError) as error:
                        raise self.lost_scheduler_error() from error

                return _Task(self, fetch_result)

            yield submit

    def check(self, need: Sequence[str] = ()) -> None:
        """Let every worker check its folder and code against this process, and import some modules.

        need: names of the modules. FinloopError names all workers that differ.
        """
        with self._share_work(_do_nothing) as path:
            call = pickle.dumps(Call(partial(_fit, need), self.home, path))
            answers = self.client.run(pickle.loads, call, on_error="return")
        refused = [
            self.refusal(answer) for answer in answers.values() if isinstance(answer, Exception)
        ]
        if refused:
            came = "\n    ".join(sorted({answer.came for answer in refused}))
            raise FinloopError(came, refused[0].wanted, refused[0].do)

    @contextmanager
    def _share_work(self, work: Callable[[A], B]) -> Iterator[str]:
        """Write `work` to a file in the shared folder for the workers, and yield its path."""
        with temporary_file(Path(self.home.folder) / _FOLDER / f"cluster-{uuid4().hex}") as path:
            path.write_bytes(_pickle_bytes(work))
            yield str(path)

    def refusal(self, error: Exception) -> FinloopError:
        """Convert the exception of a worker that cannot work to a FinloopError for the user.

        An exception other than FinloopError, ImportError and AttributeError is raised again.
        """
        if isinstance(error, FinloopError):
            return error
        if isinstance(error, ImportError | AttributeError):
            return FinloopError(
                f"a worker at {self.address} lacks the program: {error}",
                f"workers that were started in {self.home.folder}",
                f"stop it, and start it there: {self.home.start}",
            )
        raise error

    def lost_scheduler_error(self) -> FinloopError:
        """Return the error for a scheduler that has stopped answering."""
        return FinloopError(
            f"the scheduler at {self.address} has stopped answering",
            "a scheduler that runs until the stage has ended",
            "start it and its workers again, then run the same command again",
        )

    def no_worker_error(self) -> FinloopError:
        """Return the error for a scheduler that has had no worker for two minutes."""
        return FinloopError(
            f"the scheduler at {self.address} has had no worker for {_BACK_S:.0f} s",
            "at least one worker",
            f"start one in {self.home.folder}: {self.home.start}; then run the same command again",
        )


class _Task:
    """One item that Dask's scheduler has. submit: sends it, and returns its future."""

    def __init__(self, workers: DaskWorkers, submit: Callable[[], Any]) -> None:
        self._workers, self._submit, self._future = workers, submit, submit()

    def result(self) -> Any:
        """Wait for the result as `base.parallel.PendingResult`; FinloopError without any worker."""
        killed = _import_distributed().KilledWorker
        for _ in range(TRIES - 1):
            try:
                return self._outcome()
            except killed:
                self._future = self._submit()
        try:
            return self._outcome()
        except killed as error:
            raise worker_loss_error(self._workers.count) from error

    def _outcome(self) -> Any:
        alone_s = 0.0
        while not self._future.done():
            try:
                with self._workers.client.as_current():
                    _import_distributed().wait([self._future], timeout=_LOOK_S)
            except CancelledError:
                break
            except TimeoutError as error:
                alone_s = 0.0 if self._workers.threads() else alone_s + _LOOK_S
                if alone_s >= _BACK_S:
                    raise self._workers.no_worker_error() from error
        try:
            return pickle.loads(self._future.result())
        except CancelledError as error:
            raise self._workers.lost_scheduler_error() from error
        except (ImportError, AttributeError) as error:
            raise self._workers.refusal(error) from error


def _fit(need: Sequence[str], home: Home, work: str) -> None:
    """On a worker: check that it is ready, and import its modules."""
    load_work(home, work)
    for name in need:
        import_module(name)


def _do_nothing(_: Any) -> None:
    """Do nothing: the work of a check."""


def _pickle_bytes(what: Any) -> bytes:
    """Pickle to bytes; what the program's main module defines goes with its code."""
    return import_module("cloudpickle").dumps(what)


def _import_distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise FinloopError(
            f"Dask is not installed ({error})", "the extra `cluster`", "make cluster"
        ) from error
