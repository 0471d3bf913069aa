"""Let one study or sweep at a time run in a folder; remove clones that killed ones left."""

import os
import shutil
from pathlib import Path

import psutil

from finloop.base.errors import FinloopError

PROGRAMS = ("stages.study", "stages.sweep")
APART, PREFIX = Path(".dvc/tmp"), "sweep-"
"""Where sweeps and studies clone the workspace, and how the names of those folders begin."""


def claim_folder(program: str) -> None:
    """Refuse a second study or sweep in this folder, and remove clones that killed ones have left.

    program: module of the study or sweep that is about to begin, such as "stages.study".
    FinloopError, and nothing is removed, if another one runs here.
    """
    if others := _list_other_runs():
        raise FinloopError(
            f"{', '.join(others)} works in this folder already",
            f"one study or sweep at a time, and not {program} beside it",
            "wait until it ends, or stop it; what it has made is kept",
        )
    for leftover in APART.glob(f"{PREFIX}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _list_other_runs() -> list[str]:
    """Return the other studies and sweeps in the present folder, as "stages.study (process 12)"."""
    own_processes = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    found = []
    for process in psutil.process_iter(["cmdline", "cwd"]):
        words, folder = process.info["cmdline"] or [], process.info["cwd"]
        if process.pid in own_processes or not folder or Path(folder) != Path.cwd():
            continue
        found += [f"{word} (process {process.pid})" for word in PROGRAMS if word in words]
    return found
