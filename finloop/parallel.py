"""Work on every core, results in order, memory bounded: what `ProcessPoolExecutor.map` lacks."""

import contextlib
import multiprocessing
import signal
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from typing import TypeVar

import cv2

from finloop.process import die_with_parent

A = TypeVar("A")
B = TypeVar("B")


def ordered_map(work: Callable[[A], B], items: Iterable[A], workers: int) -> Iterator[B]:
    """`work(item)` for every item, in the items' order, on `workers` processes.

    At most `workers` + 1 results wait at any time, however long `items`. With one worker, or one
    item, everything happens in this process. An exception in `work` comes out here.
    """
    todo = deque(items)
    if workers < 2 or len(todo) < 2:
        yield from map(work, todo)
        return
    # OpenCV's own threads do not survive a fork, and its locks then hang: stop them before.
    cv2.setNumThreads(1)
    # Forked workers start at once; the others must import everything anew.
    start = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    with ProcessPoolExecutor(workers, start, _begin) as pool, contextlib.ExitStack() as stack:
        pending: deque[Future[B]] = deque()
        stack.callback(lambda: pool.shutdown(cancel_futures=True))
        while todo or pending:
            while todo and len(pending) < workers + 1:
                with warnings.catch_warnings():
                    # Python 3.12 and later warn of forks beside threads; ours hold no locks that
                    # a worker takes.
                    warnings.simplefilter("ignore", DeprecationWarning)
                    pending.append(pool.submit(work, todo.popleft()))
            yield pending.popleft().result()


def _begin() -> None:
    """In a worker: leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent()
