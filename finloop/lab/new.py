"""Make a lab's own repository: the pipeline and its parameters, without finloop's sources."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from finloop import __version__
from finloop.base.errors import FinloopError
from finloop.base.program import HOME, shipped_folder
from finloop.io.atomic import whole_folder

FILES = Path(__file__).with_name("files.txt")
TEMPLATE = Path(__file__).with_name("template")
PLACES = {
    "README.md": "README.md",
    "Makefile": "Makefile",
    "requirements.txt": "requirements.txt",
    "ci.yml": ".github/workflows/ci.yml",
}
"""Where each file of `TEMPLATE` goes."""
_SOURCES = "deps: [finloop, stages]"  # of the stage `code`
_EVERY_TIME = "always_changed: true # the program is installed elsewhere, where DVC does not look"
WANTED = "a new folder, or an empty one, outside any repository"


def make_repository(folder: Path) -> Path:
    """Make a lab's own repository at `folder`, with params.yaml composed; return its full path.

    FinloopError if the folder has something in it, lies in a repository or cannot be written, or if
    git is missing.
    """
    folder = folder.expanduser().absolute()
    try:
        _require_free_folder(folder)
        with whole_folder(folder) as unfinished:
            _copy_shipped_files(unfinished)
            _fill_template(unfinished, folder.name)
            _run([sys.executable, "-m", "stages.compose"], unfinished)
            _run(["git", "init", "--quiet"], unfinished)
            _run(["git", "add", "--all"], unfinished)
    except OSError as error:
        raise FinloopError(
            f"{folder} cannot be made ({error.strerror})", "a place that you may write to",
            "choose another place, or ask for the right to write there",
        ) from error  # fmt: skip
    return folder


def _require_free_folder(folder: Path) -> None:
    """Raise FinloopError unless `folder` is new or empty and in no repository, and git is there."""
    if shutil.which("git") is None:
        raise FinloopError(
            "git is missing", "git, which keeps your settings and results", "install git"
        )
    if folder.exists() and not folder.is_dir():
        raise FinloopError(f"{folder} is a file", WANTED, "choose another name")
    if folder.is_dir() and (names := sorted(path.name for path in folder.iterdir())):
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        raise FinloopError(
            f"{folder} is not empty: it has {', '.join(names[:3])}{more}",
            WANTED,
            "choose another name, or move these files away",
        )
    existing = next(path for path in (folder, *folder.parents) if path.is_dir())
    command = ["git", "rev-parse", "--show-toplevel"]
    answer = subprocess.run(command, cwd=existing, env=_plain_env(), capture_output=True, text=True)
    if answer.returncode == 0:
        raise FinloopError(
            f"{folder} lies in the repository {answer.stdout.strip()}",
            WANTED,
            "choose a folder elsewhere; in that repository both would keep the same files",
        )


def list_shipped_files() -> Iterator[str]:
    """Yield the files of finloop that a lab gets, as paths below `shipped_folder()`.

    The file `FILES` holds their glob patterns.
    """
    root = shipped_folder()
    for pattern in FILES.read_text(encoding="utf-8").split():
        for path in sorted(root.glob(pattern)):
            name = path.relative_to(root).as_posix()
            if path.is_file() and name != "conf/local/default.yaml":  # somebody's own settings
                yield name


def _copy_shipped_files(folder: Path) -> None:
    """Copy the shipped files to a folder; its dvc.yaml does not depend on finloop's sources."""
    for name in list_shipped_files():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(shipped_folder() / name, folder / name)
    pipeline = folder / "dvc.yaml"
    text = pipeline.read_text(encoding="utf-8")
    assert text.count(_SOURCES) == 1
    pipeline.write_text(text.replace(_SOURCES, _EVERY_TIME), encoding="utf-8")


def _fill_template(folder: Path, name: str) -> None:
    """Write the lab's own files to a folder, from templates; name: the lab's, for headings."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    for source, place in PLACES.items():
        text = (TEMPLATE / source).read_text(encoding="utf-8")
        for mark, value in (("NAME", name), ("VERSION", __version__), ("PYTHON", python)):
            text = text.replace(f"@{mark}@", value)
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text, encoding="utf-8")


def _plain_env() -> dict[str, str]:
    """Return the environment variables without those that lead git or DVC to other repositories."""
    unwanted = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "DVC_ROOT", "DVC_STAGE")
    return {key: value for key, value in os.environ.items() if key not in unwanted}


def _run(command: list[str], folder: Path) -> None:
    """Run a command in a folder, with this finloop; FinloopError with its output if it fails."""
    path = os.pathsep.join(filter(None, [str(HOME), os.environ.get("PYTHONPATH")]))
    env = _plain_env() | {"PYTHONPATH": path}
    result = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    if result.returncode:
        raise FinloopError(
            f"{' '.join(command)} failed:\n    {(result.stderr or result.stdout).strip()}",
            "git, and a whole finloop",
            "see the message; install finloop again if a file of it is missing",
        )
