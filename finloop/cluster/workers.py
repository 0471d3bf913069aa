"""Dask workers as `base.parallel.Workers`: connect to them, check them, and let them compute.

A scheduler need not have this program: it gets a call as bytes, and `pickle.loads`, which exists
everywhere and makes the call. It keeps all submitted items: if a worker leaves, the others take its
pieces, and lost results are computed again. A worker checks its folder and code before it works.
"""

import hashlib
import logging
import os
import pickle
import platform
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

import cv2
from llvmlite.binding import get_host_cpu_name

from finloop.base.errors import FinloopError
from finloop.base.parallel import TRIES, worker_loss_error
from finloop.cluster.settings import ClusterSettings, LocalWorkers
from finloop.io.atomic import temporary_file

A = TypeVar("A")
B = TypeVar("B")

_ROOT = Path(__file__).parents[2]
_PACKAGES = (
    "av", "faiss-cpu", "numba", "numpy", "opencv-contrib-python-headless", "pandas", "pyarrow",
    "scikit-image", "scikit-learn", "scipy", "torch",
)  # fmt: skip
"""The packages that compute results."""
_CONNECT_S = 5.0  # timeout to reach a scheduler
_JOIN_S = 30.0  # timeout for the first worker
_BACK_S = 120.0  # timeout for a worker to return where none is left
_LOOK_S = 5.0  # between two checks whether any worker is left
# On a busy machine a worker takes longer to restart than Dask's default of 15 s.
_LOCAL = {"distributed.deploy.lost-worker-timeout": "1 hour"}
_FOLDER = "data"  # below the stage's folder: where the work lies for the workers

# --- on a worker


@dataclass(frozen=True)
class WorkerHome:
    """What workers must share with the submitting process so that results are equal.

    folder: the stage's working folder, absolute, shared by all workers. start: the command that
    starts a worker there. facts: about code, packages, processor and thread counts, by name.
    """

    folder: str
    start: str
    facts: Mapping[str, str]

    @classmethod
    def from_process(cls, folder: Path, start: str, variables: Iterable[str]) -> "WorkerHome":
        """Return what workers must share with this process, which works in `folder`.

        start: the command that starts a worker there. variables: names, in capitals, of the
        environment variables that workers must share.
        """
        return cls(str(folder.absolute()), start, _process_facts(tuple(variables)))

    def require_equal_process(self) -> None:
        """Raise FinloopError, which lists the differences, if this process differs from `facts`.

        It is called on a worker.
        """
        variables = tuple(name for name in self.facts if name.isupper())
        worker_facts = _process_facts(variables)
        differences = [
            f"{name}: {worker_facts.get(name)} there, {value} here"
            for name, value in self.facts.items()
            if worker_facts.get(name) != value
        ]
        if differences:
            raise FinloopError(
                f"{_describe_worker()} differs from this program: " + "; ".join(differences),
                "the same code, packages and thread counts, for the same results",
                f"stop it, and start it in {self.folder}: {self.start}",
            )


def _describe_worker() -> str:
    """Return a phrase for messages that names this worker: its number, machine and folder."""
    return f"worker process {os.getpid()} of {socket.gethostname()}, in {_ROOT},"


@cache  # of the start of this process: it does not import its modules again
def _process_facts(variables: tuple[str, ...]) -> dict[str, str]:
    """Return facts of this process by name: code, packages, processor, environment variables."""
    return {
        "code": _hash_code(),
        "python": platform.python_version(),
        "processor": get_host_cpu_name(),  # kernels are compiled for it, sums are rounded by it
        **{name: _package_version(name) for name in _PACKAGES},
        **{name: os.environ.get(name, "not set") for name in variables},
    }


@cache
def _hash_code() -> str:
    """Return 12 hex digits of the SHA-256 of all Python files of finloop and its stages."""
    digest = hashlib.sha256()
    for package in ("finloop", "stages"):
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(f"{path.relative_to(_ROOT)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _package_version(package: str) -> str:
    """Return the version of an installed package, or "not installed"."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


class DeferredCall:
    """A function with arguments that is called when this object is unpickled."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Store the function and its arguments."""
        self._call = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return the function and arguments that pickle calls on loading."""
        return self._call


def run_pickled_item(home: WorkerHome, work: str, item: bytes) -> bytes:
    """Apply a pickled function to a pickled item, on a worker; return the pickled result.

    home: what workers must have in common with the submitting process. work: path of the file that
    holds the pickled function. FinloopError if this worker differs from `home`, or does not see the
    file.
    """
    return pickle.dumps(_prepare_worker(home, work)(pickle.loads(item)))


def _prepare_worker(home: WorkerHome, work: str) -> Callable[[Any], Any]:
    """Check and set up this worker; return the function that is pickled in `work`.

    The worker must equal the submitting process (`home`), enters the shared folder, and gets one
    OpenCV thread. FinloopError if it differs, or does not see the file.
    """
    home.require_equal_process()
    cv2.setNumThreads(1)
    try:
        os.chdir(home.folder)
        return _unpickle_file(work)
    except FileNotFoundError as error:
        raise FinloopError(
            f"{_describe_worker()} does not see {home.folder}, or sees another folder there",
            "a folder that all workers share, at the same path",
            f"share {home.folder} (NFS, for instance), and start the worker there: {home.start}",
        ) from error


@lru_cache(1)  # the same for every item, and as large as some frames
def _unpickle_file(path: str) -> Callable[[Any], Any]:
    """Return the function that is pickled in a file."""
    return pickle.loads(Path(path).read_bytes())


def _prepare_and_import(modules: Sequence[str], home: WorkerHome, work: str) -> None:
    """Prepare a worker as `_prepare_worker` does, and import modules, given by name."""
    _prepare_worker(home, work)
    for name in modules:
        import_module(name)


# --- in the submitting process


@contextmanager
def connect_dask_workers(
    settings: ClusterSettings, home: WorkerHome, processes: int, modules: Sequence[str] = ()
) -> Iterator["DaskWorkers"]:
    """Connect to a Dask cluster, and yield its workers until the `with` block ends.

    settings: a running scheduler's address, or `LocalWorkers`: a cluster started here with
    `processes` workers. home: what workers must have in common with this process. modules: names of
    those that workers import at once. FinloopError if Dask is not installed, no scheduler or
    worker answers, or a worker has another folder or other code.
    """
    distributed = _import_distributed()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # our own messages suffice
    with ExitStack() as stack:
        address: Any = settings.source
        if isinstance(settings, LocalWorkers):
            stack.enter_context(import_module("dask").config.set(_LOCAL))
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=processes,
                    threads_per_worker=1,
                    memory_limit=0,  # a limit counts mapped memory: it kills workers of long films
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
        else:
            cluster = address = settings.scheduler_address
        try:
            client = distributed.Client(cluster, timeout=_CONNECT_S, set_as_default=False)
            stack.enter_context(client)
            client.wait_for_workers(1, _JOIN_S)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise FinloopError(
                f"no scheduler with workers answers at {address} ({error})",
                "Dask's scheduler there, and workers that have joined it",
                f"start them (dask scheduler; {home.start}), or correct cluster.scheduler_address",
            ) from error
        workers = DaskWorkers(client, home, str(address))
        workers.check_workers(modules)
        yield workers


@dataclass(frozen=True)
class DaskWorkers:
    """The workers of a Dask cluster, each a process of one thread, for `base.parallel`.

    home: what they must share with this process. address: the scheduler's, for messages.
    """

    client: Any  # distributed.Client, which is there only with the extra
    home: WorkerHome
    address: str
    is_alone = False  # see `base.parallel.Workers`

    @property
    def count(self) -> int:
        """Return the present number of workers, at least 1.

        FinloopError if a worker has several threads.
        """
        threads = self.count_threads()
        if multithreaded := [worker for worker, number in threads.items() if number != 1]:
            raise FinloopError(
                f"worker {multithreaded[0]} works with {threads[multithreaded[0]]} threads",
                "processes of one thread, as many as a machine has cores",
                f"stop it, and start it in {self.home.folder}: {self.home.start}",
            )
        return max(1, len(threads))

    def count_threads(self) -> dict[str, int]:
        """Return how many threads each worker has, by the worker's address.

        FinloopError if no scheduler answers.
        """
        try:
            return dict(self.client.nthreads())
        except (OSError, CancelledError) as error:
            raise self.lost_scheduler_error() from error

    @contextmanager
    def open_submitter(self, work: Callable[[A], B]) -> Iterator[Callable[[A], "_SubmittedItem"]]:
        """Share a function with the workers; yield `submit(item)`, which gives a pending result.

        work: the function, applied to each item.
        """
        name, numbers = uuid4().hex, count()  # they make a key for each try of each item
        with self._share_work(work) as path:

            def submit(item: A) -> _SubmittedItem:
                """Submit one item; return its pending result."""
                # Unpickling a DeferredCall makes the call: the scheduler needs no finloop.
                call = pickle.dumps(
                    DeferredCall(run_pickled_item, self.home, path, _pickle_bytes(item))
                )

                def send_item() -> Any:
                    """Send the item to the scheduler, with retries; return Dask's future."""
                    key = f"piece-{name}-{next(numbers)}"
                    try:
                        return self.client.submit(pickle.loads, call, key=key, pure=False)
                    except (OSError, RuntimeError) as error:
                        raise self.lost_scheduler_error() from error

                return _SubmittedItem(self, send_item)

            yield submit

    def check_workers(self, modules: Sequence[str]) -> None:
        """Let every worker check its folder and code, and import modules by name.

        FinloopError names all workers that differ from this process. An exception of another kind,
        see `refusal_error`, is raised again.
        """
        with self._share_work(None) as path:
            # Unpickling a DeferredCall makes the call: the scheduler needs no finloop.
            prepare = partial(_prepare_and_import, modules)
            call = pickle.dumps(DeferredCall(prepare, self.home, path))
            answers = self.client.run(pickle.loads, call, on_error="return")
        # With on_error="return", a worker's answer is the exception that it raised, else None.
        errors = [answer for answer in answers.values() if isinstance(answer, Exception)]
        refusals = [self.refusal_error(error) for error in errors]
        if refusals:
            came = "\n    ".join(sorted({refusal.came for refusal in refusals}))
            raise FinloopError(came, refusals[0].wanted, refusals[0].do)

    @contextmanager
    def _share_work(self, work: Callable[[A], B] | None) -> Iterator[str]:
        """Write a function to a file in the shared folder; yield the file's path.

        The file is removed when the block ends.
        """
        with temporary_file(Path(self.home.folder) / _FOLDER / f"cluster-{uuid4().hex}") as path:
            path.write_bytes(_pickle_bytes(work))
            yield str(path)

    def refusal_error(self, error: Exception) -> FinloopError:
        """Return the error for the user when a worker cannot work; raise other exceptions again.

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
        """Return the error that the scheduler has stopped answering."""
        return FinloopError(
            f"the scheduler at {self.address} has stopped answering",
            "a scheduler that runs until the stage has ended",
            "start it and its workers again, then run the same command again",
        )

    def no_worker_error(self) -> FinloopError:
        """Return the error that the scheduler has had no worker for two minutes."""
        return FinloopError(
            f"the scheduler at {self.address} has had no worker for {_BACK_S:.0f} s",
            "at least one worker",
            f"start one in {self.home.folder}: {self.home.start}; then run the same command again",
        )


class _SubmittedItem:
    """One item that was submitted to Dask's scheduler, and its pending result."""

    def __init__(self, workers: DaskWorkers, submit: Callable[[], Any]) -> None:
        """Send an item to the scheduler by calling `submit`, which returns its future."""
        self._workers, self._submit, self._future = workers, submit, submit()

    def result(self) -> Any:
        """Wait for the result and return it; submit the item again if its worker was killed.

        FinloopError if no worker is left, or workers were killed in all `TRIES` tries.
        """
        killed = _import_distributed().KilledWorker
        for _ in range(TRIES - 1):
            try:
                return self._wait_for_result()
            except killed:
                self._future = self._submit()
        try:
            return self._wait_for_result()
        except killed as error:
            raise worker_loss_error(self._workers.count) from error

    def _wait_for_result(self) -> Any:
        """Wait for the result and return it; FinloopError if no worker is left for two minutes."""
        without_worker_s = 0.0
        while not self._future.done():
            try:
                with self._workers.client.as_current():
                    _import_distributed().wait([self._future], timeout=_LOOK_S)
            except CancelledError:  # by the scheduler's end; `result` below says so again
                break
            except TimeoutError as error:
                has_worker = bool(self._workers.count_threads())
                without_worker_s = 0.0 if has_worker else without_worker_s + _LOOK_S
                if without_worker_s >= _BACK_S:
                    raise self._workers.no_worker_error() from error
        try:
            return pickle.loads(self._future.result())
        except CancelledError as error:
            raise self._workers.lost_scheduler_error() from error
        except (ImportError, AttributeError) as error:
            raise self._workers.refusal_error(error) from error


def _pickle_bytes(value: Any) -> bytes:
    """Return a value as pickled bytes, including code defined in the program's main module."""
    return import_module("cloudpickle").dumps(value)


def _import_distributed() -> Any:
    """Return Dask's package `distributed`; FinloopError if it is not installed."""
    try:
        return import_module("distributed")
    except ImportError as error:
        raise FinloopError(
            f"Dask is not installed ({error})",
            "the packages of the extra `cluster`",
            "run `make cluster`",
        ) from error
