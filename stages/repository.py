"""Use Git and DVC for sweeps and studies: commands, the user, experiments on commits."""

from stages.run import PROCESSES, THREADS  # isort: skip  (before numpy)

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

from finloop.base.errors import FinloopError

_FIRST_COMMIT = 'git add --all; git commit --message "first state"'
_GIT_ADVICE = (  # what git says, what is wanted, what to do
    ("not a git repository", "the folder of a git repository", f"git init; {_FIRST_COMMIT}"),
    ("ambiguous argument 'HEAD'", "a git repository with a commit", _FIRST_COMMIT),
    (
        "auto-detection is disabled",
        "your name and e-mail, with which git commits each run",
        'git config user.name "Your Name"; git config user.email you@example.org',
    ),
)

DVC = (sys.executable, "-m", "stages.call_dvc")  # the command `dvc`
LAST_LINES = 12  # of the output of a failed run


def run_git(*arguments: str, folder: Path | None = None) -> str:
    """Run git with these arguments; return its output, or raise FinloopError with its message.

    folder: where it runs, None for the present folder.
    """
    process = subprocess.run(
        ["git", *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    if process.returncode:
        message = process.stderr.strip()
        advice = "a repository that git can read and write", "correct what git names"
        for text, wanted, do in _GIT_ADVICE:
            if text in message:
                message = next(line for line in message.splitlines() if text in line)
                advice = wanted, do
        raise FinloopError(f"git failed: {message}", *advice)
    return process.stdout


def run_dvc(*arguments: str, folder: Path, processes: int = THREADS) -> tuple[bool, str]:
    """Run a DVC command as in `run_python`; return whether it succeeds, and its output."""
    return run_python(*DVC[1:], *arguments, folder=folder, processes=processes)


def run_python(*arguments: str, folder: Path, processes: int) -> tuple[bool, str]:
    """Run Python with arguments in a folder; return whether it succeeds, and its output.

    processes: the number of processes on which a stage works.
    """
    process = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder, text=True, check=False, env=os.environ | {PROCESSES: str(processes)},
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return not process.returncode, process.stdout


def failure_lines(text: str) -> list[str]:
    """Return the last message of a failed run's output; its last lines if there is none."""
    lines = text.splitlines()
    # A message of finloop begins with "finloop: " and has a line "  wanted: "; DVC's own follows.
    wanted = [number for number, line in enumerate(lines) if line.startswith("  wanted: ")]
    if not wanted:
        return lines[-LAST_LINES:]
    last_wanted = wanted[-1]
    first = max(number for number in range(last_wanted) if lines[number].startswith("finloop: "))
    return [*takewhile(lambda line: not line.startswith("ERROR:"), lines[first:])]


def read_git_user() -> tuple[str, str]:
    """Return the name and the e-mail with which git commits; raise FinloopError if it has none."""
    identity = run_git("-c", "user.useConfigOnly=true", "var", "GIT_COMMITTER_IDENT")
    name, _, rest = identity.partition(" <")
    return name, rest.partition(">")[0]


def list_experiments() -> dict[str, str]:
    """Return the DVC experiments on the present commit, name → commit of the experiment.

    FinloopError if there is no commit.
    """
    # DVC keeps them as refs/exps/<2 digits of the commit>/<the others>/<name>.
    head = run_git("rev-parse", "HEAD").strip()
    refs = run_git(
        "for-each-ref", "--format=%(refname) %(objectname)", f"refs/exps/{head[:2]}/{head[2:]}"
    )
    lines = (line.split() for line in refs.splitlines())
    return {ref.rpartition("/")[2]: commit for ref, commit in lines}


def find_experiments(names: Sequence[str]) -> dict[str, str]:
    """Return named DVC experiments on the present commit, name → commit of the experiment.

    FinloopError if one is not there; it says on which other commit there is one of that name.
    """
    known = list_experiments()
    missing = [name for name in names if name not in known]
    if not missing:
        return {name: known[name] for name in names}
    refs = run_git("for-each-ref", "--format=%(refname)", "refs/exps").split()
    # refs/exps/<2 digits of the commit>/<the others>/<name>; other refs are DVC's own.
    parts = [ref.split("/") for ref in refs if ref.count("/") == 4]
    elsewhere = {name: start + rest for *_, start, rest, name in parts if name in missing}
    reasons = [
        f"experiment {name} is of another version, commit {describe_commit(elsewhere[name])}"
        if name in elsewhere
        else f"no experiment {name} on the present commit"
        for name in missing
    ]
    raise FinloopError(
        "\n    ".join(reasons),
        f"names from: {', '.join(known) or 'none yet'}",
        "correct the name, run its sweep on this commit (`make sweep experiment=…`), or go to the "
        "other commit: git switch --detach COMMIT",
    )


def describe_commit(commit: str) -> str:
    """Return the short name of a commit and the first line of its message."""
    return run_git("log", "-1", "--format=%h (%s)", commit).strip()


def describe_differing_code(commits: Mapping[str, str]) -> str:
    """Return a sentence on experiments whose program differs from the first one's; "" if none.

    commits: experiment → its commit. The sentence is "" if there is no such experiment.
    """
    trees = {
        name: run_git("ls-tree", commit, "finloop", "stages", "dvc.yaml")
        for name, commit in commits.items()
    }
    first, *_ = trees
    others = [name for name in trees if trees[name] != trees[first]]
    if not others:
        return ""
    return f"The program of {first} is not that of {', '.join(others)}: that alone can be a cause."
