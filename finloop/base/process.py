"""Processes that end with their parent."""

import ctypes
import multiprocessing
import os
import signal
import sys
from multiprocessing.process import BaseProcess
from threading import Thread


def die_with_parent() -> None:
    """Ask the kernel to kill this process when its parent ends, by kill -9 too (Linux only)."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def end_with_employer() -> None:
    """In a worker: end as soon as the process that employs it ends, by kill -9 too.

    That is not its parent, which is a server that forks workers and lives as long as one of them.
    """
    employer = multiprocessing.parent_process()
    if employer is not None:
        Thread(target=_end_after, args=(employer,), daemon=True).start()


def _end_after(process: BaseProcess) -> None:
    process.join()
    os._exit(1)
