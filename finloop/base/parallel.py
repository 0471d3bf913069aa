"""Work on every core with results in order and bounded memory."""

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver
from typing import TypeVar

import cv2

from finloop.base.errors import FinloopError
from finloop.base.process import die_with_parent

A = TypeVar("A")
B = TypeVar("B")

# Not "fork": a copy of a process whose libraries run threads hangs sooner or later. A server that
# has only imported things, and is forked for each worker, is safe and nearly as quick.
_FORKSERVER = "forkserver" in multiprocessing.get_all_start_methods()


def warm_up(modules: Sequence[str]) -> None:
    """Start importing `modules` for future workers, while this process goes on."""
    if _FORKSERVER:
        multiprocessing.get_context("forkserver").set_forkserver_preload(list(modules))
        forkserver.ensure_running()


def ordered_map(work: Callable[[A], B], items: Iterable[A], workers: int) -> Iterator[B]:
    """`work(item)` for every item, in the items' order, on `workers` processes.

    At most `workers` + 1 results are kept at a time. With one worker, or one item, the work is done
    in this process. Exceptions of `work` are raised here. `work`, items and results are pickled.

    Raises FinloopError where a worker is killed.
    """
    todo = deque(items)
    if workers < 2 or len(todo) < 2:
        yield from map(work, todo)
        return
    start = multiprocessing.get_context("forkserver" if _FORKSERVER else "spawn")
    with ProcessPoolExecutor(workers, start, _begin) as pool, contextlib.ExitStack() as stack:
        stack.callback(pool.shutdown, wait=True, cancel_futures=True)
        pending: deque[Future[B]] = deque()
        while todo or pending:
            while todo and len(pending) < workers + 1:
                pending.append(pool.submit(work, todo.popleft()))
            try:
                result = pending.popleft().result()
            except BrokenProcessPool as error:
                raise FinloopError(
                    "a worker process was ended from outside, perhaps for want of memory",
                    f"{workers} processes that each hold a stretch of the film",
                    "run again; with FINLOOP_THREADS=1 in the environment one process does it all",
                ) from error
            yield result


def _begin() -> None:
    """In a worker: leave Ctrl-C to the parent, end with it, and use one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent()
    cv2.setNumThreads(1)
