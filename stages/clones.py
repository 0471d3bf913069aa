"""What must be so before experiments are made in copies of the workspace, by a study or a sweep."""

import os
import shutil
import subprocess
from pathlib import Path

import psutil

from finloop.base.errors import FinloopError

PROGRAMS = ("stages.study", "stages.sweep")
CLONES = ".dvc/tmp/sweep-*"


def require_git_user() -> None:
    """Raise FinloopError if Git does not know who the user is: an experiment is a commit."""
    for key, example in (("name", "Your Name"), ("email", "you@example.org")):
        if f"GIT_COMMITTER_{key.upper()}" in os.environ:
            continue
        done = subprocess.run(["git", "config", f"user.{key}"], capture_output=True, check=False)
        if not done.stdout.strip():
            raise FinloopError(
                f"Git does not know your {key}",
                "a name and an e-mail for the experiments, which are commits",
                f'git config user.{key} "{example}"',
            )


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
    for left in Path().glob(CLONES):
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
