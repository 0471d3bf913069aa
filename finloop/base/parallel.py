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
_TRIES = 3  # once may be bad luck; the same item again and again is not


def warm_up(modules: Sequence[str]) -> None:
    """Start importing `modules` for future workers, while this process goes on."""
    if _FORKSERVER:
        multiprocessing.get_context("forkserver").set_forkserver_preload(list(modules))
        forkserver.ensure_running()


def ordered_map(work: Callable[[A], B], items: Iterable[A], workers: int) -> Iterator[B]:
    """`work(item)` for every item, in the items' order, on `workers` processes.

    At most `workers` + 1 results are kept at a time. With one worker, or one item, the work is done
    in this process. Exceptions of `work` are raised here. `work`, items and results are pickled.
    What was in the hands of the processes when one is killed is done again by new ones.

    Raises FinloopError where a worker is killed `_TRIES` times at the same item.
    """
    todo = deque(items)
    if workers < 2 or len(todo) < 2:
        yield from map(work, todo)
        return
    start = multiprocessing.get_context("forkserver" if _FORKSERVER else "spawn")
    given: deque[A] = deque()  # to the processes, and no result is taken yet
    killed = 0
    while todo or given:
        with ProcessPoolExecutor(workers, start, _begin) as pool, contextlib.ExitStack() as stack:
            stack.callback(pool.shutdown, wait=True, cancel_futures=True)
            results: deque[Future[B]] = deque()
            while todo or given:
                while todo and len(given) < workers + 1:
                    given.append(todo.popleft())
                try:
                    results += [
                        pool.submit(work, given[k]) for k in range(len(results), len(given))
                    ]
                    result = results[0].result()
                except BrokenProcessPool as error:
                    killed += 1
                    if killed == _TRIES:
                        raise _ended(workers) from error
                    break
                results.popleft()
                given.popleft()
                killed = 0
                yield result


def _ended(workers: int) -> FinloopError:
    return FinloopError(
        f"worker processes were ended from outside, {_TRIES} times, perhaps for want of memory",
        f"{workers} processes that each hold a stretch of the film",
        "run again; with FINLOOP_THREADS=1 in the environment one process does it all",
    )


def _begin() -> None:
    """In a worker: leave Ctrl-C to the parent, end with it, and use one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent()
    cv2.setNumThreads(1)
