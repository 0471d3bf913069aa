"""Processes that end with their parent."""

import ctypes
import multiprocessing
import os
import signal
import sys
from multiprocessing.process import BaseProcess
from threading import Thread


def die_with_parent() -> None:
    """Ask Linux to kill this process when its parent ends, even by kill -9; else do nothing."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def end_with_main_process() -> None:
    """End this worker as soon as the process that submits its work ends, even by kill -9.

    That process is not its parent: the parent is a server that forks workers and outlives them. In
    a process that is no worker, do nothing.
    """
    main = multiprocessing.parent_process()
    if main is not None:
        Thread(target=_end_after, args=(main,), daemon=True).start()


def _end_after(process: BaseProcess) -> None:
    process.join()
    os._exit(1)
