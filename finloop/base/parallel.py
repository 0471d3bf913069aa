"""Work on every core with results in order and bounded memory."""

import multiprocessing
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing import forkserver
from threading import Thread
from typing import Protocol, TypeVar

import cv2

from finloop.base.errors import FinloopError

A = TypeVar("A")
B = TypeVar("B")
B_co = TypeVar("B_co", covariant=True)

# Not "fork": the copy of a process whose libraries run threads hangs sooner or later. Forking a
# server that has only imported modules is safe and nearly as fast.
_FORKSERVER = "forkserver" in multiprocessing.get_all_start_methods()
TRIES = 3
_BLOCK = 10_000  # rows
_PAUSE_S = 0.2  # before the next try after an OSError


def start_fork_server(modules: Sequence[str]) -> None:
    """Start the server that forks worker processes, on systems that have one.

    modules: names of modules that it imports in the background, so that workers start at once. It
    also imports what the module that `python -m` runs imports.
    """
    if _FORKSERVER:
        spec = getattr(sys.modules["__main__"], "__spec__", None)  # None without `python -m`
        if spec and not spec.name.endswith("__main__"):
            os.environ["FINLOOP_RUN_MODULE"] = spec.name
        preloaded = [*modules, "finloop.base.preload"]
        multiprocessing.get_context("forkserver").set_forkserver_preload(preloaded)
        forkserver.ensure_running()


class PendingResult(Protocol[B_co]):
    """The result of one item that a worker computes, which may not be ready yet."""

    def result(self) -> B_co:
        """Wait for the result and return it; raise the exception that the work raised."""
        ...


class Workers(Protocol):
    """An interface to compute in parallel, by `Threads`, `Processes` or a cluster of machines.

    All give the same results.
    """

    @property
    def count(self) -> int:
        """Return the number of workers; that of a cluster may change."""
        ...

    @property
    def is_alone(self) -> bool:
        """Return whether the calling process does the work itself, without any worker."""
        ...

    def open_submitter(
        self, work: Callable[[A], B]
    ) -> AbstractContextManager[Callable[[A], PendingResult[B]]]:
        """Return a context that starts the workers and yields a function `submit`.

        submit(item) lets a worker compute work(item) and returns a `PendingResult` at once. Either
        raises BrokenProcessPool if a worker was killed: then all submitted items are lost.
        """
        ...


@dataclass(frozen=True)
class Processes:
    """Worker processes on this machine; with `count` 1 the calling process does the work itself."""

    count: int = 1

    @property
    def is_alone(self) -> bool:
        """Return whether the calling process does the work itself."""
        return self.count < 2

    @contextmanager
    def open_submitter(self, work: Callable[[A], B]) -> Iterator[Callable[[A], Future[B]]]:
        """Start the processes; yield a function that submits one item and returns its future.

        When the block ends, items that no process has begun are cancelled.
        """
        start = multiprocessing.get_context("forkserver" if _FORKSERVER else "spawn")
        with ProcessPoolExecutor(self.count, start, _set_up_worker) as pool, ExitStack() as stack:
            stack.callback(pool.shutdown, wait=True, cancel_futures=True)

            def submit(item: A) -> Future[B]:
                """Let a process compute `work(item)`; return the future result at once."""
                try:
                    return pool.submit(work, item)
                except OSError as error:
                    # If a worker is killed while another one starts, the pool's own thread closes
                    # its pipes: "handle is closed", an OSError without a number.
                    if error.errno is not None:
                        raise
                    raise BrokenProcessPool("a worker was killed as another started") from error

            yield submit


def _set_up_worker() -> None:
    """Let a worker process ignore Ctrl-C, use one thread, and end with the main process.

    The main process is not its parent: the parent is a server that forks workers and outlives them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    main = multiprocessing.parent_process()

    def end_after_main() -> None:
        """Wait until the main process ends, then end this one."""
        if main is not None:
            main.join()
            os._exit(1)

    Thread(target=end_after_main, daemon=True).start()


@dataclass(frozen=True)
class Threads:
    """Threads of this process, for compiled work; they start quickly, and nothing is pickled."""

    count: int = 1

    @property
    def is_alone(self) -> bool:
        """Return whether the calling thread does the work itself."""
        return self.count < 2

    @contextmanager
    def open_submitter(self, work: Callable[[A], B]) -> Iterator[Callable[[A], Future[B]]]:
        """Start the threads; yield a function that submits one item and returns its future.

        When the block ends, items that no thread has begun are cancelled.
        """
        with ThreadPoolExecutor(self.count) as pool, ExitStack() as stack:
            stack.callback(cv2.setNumThreads, cv2.getNumThreads())
            stack.callback(pool.shutdown, wait=True, cancel_futures=True)
            cv2.setNumThreads(1)
            yield lambda item: pool.submit(work, item)


ALONE = Threads(1)
"""No other worker: the calling thread does the work."""


def ordered_map(work: Callable[[A], B], items: Iterable[A], workers: Workers) -> Iterator[B]:
    """Yield `work(item)` for every item, in the items' order, computed by `workers`.

    At most `workers.count` + 1 results are kept at a time. Exceptions of `work` are raised here; an
    OSError (say, a network folder that is briefly away) only after `TRIES` failures on the same
    item. `Processes` and a cluster pickle `work`, items and results. After a process is killed, new
    ones repeat the unfinished items; FinloopError if that happens `TRIES` times at the same item.
    """
    todo = deque(items)
    work = partial(_retry, work)
    if workers.is_alone or len(todo) < 2:
        yield from map(work, todo)
        return
    pending: deque[A] = deque()  # submitted, result not taken yet
    killed = 0  # times that processes were killed at the first pending item
    while todo or pending:  # once, and again whenever a process was killed
        with workers.open_submitter(work) as submit:
            results: deque[PendingResult[B]] = deque()  # of the first pending items
            while todo or pending:
                while todo and len(pending) < workers.count + 1:
                    pending.append(todo.popleft())
                try:
                    results += map(submit, list(pending)[len(results) :])
                    result = results[0].result()
                except BrokenProcessPool as error:
                    killed += 1
                    if killed == TRIES:
                        raise worker_loss_error(workers.count) from error
                    break  # start new processes, which repeat all pending items
                results.popleft()
                pending.popleft()
                killed = 0
                yield result


def map_row_blocks(work: Callable[[slice], B], count: int) -> list[B]:
    """Call `work` for each block of `count` rows, in several threads; return the results in order.

    A block is a slice of at most 10,000 rows, few enough to save memory. work: takes such a slice.
    It should spend most of its time in compiled code (NumPy, OpenCV, numba), because only such code
    runs in several threads at once.
    """
    blocks = [slice(first, first + _BLOCK) for first in range(0, count, _BLOCK)]
    import numba  # not at the top: stages without kernels would load it, too, in 0.1 s

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(work, blocks))


def prefetch(items: Iterable[A], most: int = 4) -> Iterator[A]:
    """Yield the items in order, while a thread computes up to `most` items in advance."""
    source = iter(items)

    def take_next() -> list[A]:
        """Return the next item in a list, which is empty after the last one."""
        return list(islice(source, 1))

    with ThreadPoolExecutor(1) as pool:
        waiting = deque(pool.submit(take_next) for _ in range(most))
        while taken := waiting.popleft().result():
            waiting.append(pool.submit(take_next))
            yield taken[0]


def _retry(work: Callable[[A], B], item: A) -> B:
    """Return `work(item)`; after an OSError try again, `TRIES` times at most, with pauses."""
    for _ in range(TRIES - 1):
        with suppress(OSError):
            return work(item)
        time.sleep(_PAUSE_S)
    return work(item)


def worker_loss_error(workers: int) -> FinloopError:
    """Return the error for worker processes that were killed repeatedly at the same item.

    workers: number of processes.
    """
    return FinloopError(
        f"worker processes were ended from outside, {TRIES} times, perhaps for lack of memory",
        f"{workers} processes that each hold a stretch of the film",
        "run again; or use a single process: set FINLOOP_THREADS=1 and cluster=default",
    )
