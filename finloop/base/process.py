"""A process that ends with its parent."""

import ctypes
import signal
import sys


def die_with_parent() -> None:
    """Ask Linux to kill this process when its parent ends; on other systems do nothing.

    It is killed even if its parent ends by kill -9.
    """
    if sys.platform == "linux":
        pr_set_pdeathsig = 1  # PR_SET_PDEATHSIG of <sys/prctl.h>
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
