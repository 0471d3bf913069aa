"""One study or sweep at a time in a folder, and none of what killed ones have left."""

import os
import shutil
from pathlib import Path

import psutil

from finloop.base.errors import FinloopError

PROGRAMS = ("stages.study", "stages.sweep")
APART, PREFIX = Path(".dvc/tmp"), "sweep-"
"""Where sweeps and studies clone the workspace, and how the names of those folders begin."""


def require_only_one(program: str) -> None:
    """Raise FinloopError if a study or sweep runs in this folder; remove what killed ones left.

    program: the module of the present one, such as "stages.study".
    """
    if others := _other_runs():
        raise FinloopError(
            f"{', '.join(others)} works in this folder already",
            f"one study or sweep at a time, and not {program} beside it",
            "wait until it ends, or stop it; what it has made is kept",
        )
    for left in APART.glob(f"{PREFIX}*"):
        shutil.rmtree(left, ignore_errors=True)


def _other_runs() -> list[str]:
    """Return the studies and sweeps that run in the present folder, each with its process."""
    own = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    found = []
    for process in psutil.process_iter(["cmdline", "cwd"]):
        words, folder = process.info["cmdline"] or [], process.info["cwd"]
        if process.pid in own or not folder or Path(folder) != Path.cwd():
            continue
        found += [f"{word} (process {process.pid})" for word in PROGRAMS if word in words]
    return found
