"""A piece of work on a worker of a cluster: the worker checks its folder and code, then works.

A scheduler need not have this program: it gets a call as bytes, and `pickle.loads`, which exists
everywhere and makes the call.
"""

import hashlib
import os
import pickle
import platform
import socket
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import cv2
from llvmlite.binding import get_host_cpu_name

from finloop.base.errors import FinloopError

_ROOT = Path(__file__).parents[2]
_PACKAGES = (
    "av", "faiss-cpu", "numba", "numpy", "opencv-contrib-python-headless", "pandas", "pyarrow",
    "scikit-image", "scikit-learn", "scipy", "torch",
)  # fmt: skip
"""The packages that compute results."""


@dataclass(frozen=True)
class Home:
    """What a worker must share with the submitting process, so that results are the same bytes.

    folder: the stage's working folder, absolute, shared by all workers. start: the command that
    starts a worker there. facts: about code, packages, processor and thread counts, by name.
    """

    folder: str
    start: str
    facts: Mapping[str, str]

    @classmethod
    def from_process(cls, folder: Path, start: str, variables: Iterable[str]) -> "Home":
        """Return the home of this process.

        folder: its working folder. start: the command that starts a worker. variables: names of the
        environment variables that workers must share.
        """
        return cls(str(folder.absolute()), start, _facts(tuple(variables)))

    def refuse_other(self) -> None:
        """Raise FinloopError that lists the facts by which this process differs from the home's."""
        own = _facts(tuple(name for name in self.facts if name.isupper()))
        differences = [
            f"{name}: {own.get(name)} there, {value} here"
            for name, value in self.facts.items()
            if own.get(name) != value
        ]
        if differences:
            raise FinloopError(
                f"{_worker()} differs from this program: " + "; ".join(differences),
                "the same code, packages and thread counts, for the same results",
                f"stop it, and start it in {self.folder}: {self.start}",
            )


def _worker() -> str:
    return f"worker process {os.getpid()} of {socket.gethostname()}, in {_ROOT},"


@cache  # of the start of this process: it does not import its modules again
def _facts(variables: tuple[str, ...]) -> dict[str, str]:
    """Return facts of this process, by name; environment variables are in capitals."""
    return {
        "code": _code(),
        "python": platform.python_version(),
        "processor": get_host_cpu_name(),  # kernels are compiled for it, sums are rounded by it
        **{name: _version(name) for name in _PACKAGES},
        **{name: os.environ.get(name, "not set") for name in variables},
    }


@cache
def _code() -> str:
    digest = hashlib.sha256()
    for room in ("finloop", "stages"):
        for path in sorted((_ROOT / room).rglob("*.py")):
            digest.update(f"{path.relative_to(_ROOT)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


class Call:
    """A function and its arguments; to unpickle it is to call it: the result comes out."""

    def __init__(self, what: Callable[..., Any], *arguments: Any) -> None:
        self._call = what, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._call


def run_piece(home: Home, work: str, item: bytes) -> bytes:
    """Apply the shared function to one pickled item on a worker; return the pickled result.

    home: of the submitting process. work: path of the file that holds the pickled function.
    FinloopError if this worker differs from `home`, or does not see the file.
    """
    return pickle.dumps(load_work(home, work)(pickle.loads(item)))


def load_work(home: Home, work: str) -> Callable[[Any], Any]:
    """Check that this worker equals the submitting process, then load the function to apply.

    home: of the submitting process; its folder becomes this worker's working folder. work: path of
    the file that holds the pickled function. FinloopError if this worker differs or does not see
    the file.
    """
    home.refuse_other()
    try:
        os.chdir(home.folder)
        return _read(work)
    except FileNotFoundError as error:
        raise FinloopError(
            f"{_worker()} does not see {home.folder}, or sees another folder there",
            "a folder that all workers share, at the same path",
            f"share {home.folder} (NFS, for instance), and start the worker there: {home.start}",
        ) from error


@lru_cache(1)  # the same for every item, and as large as some frames
def _read(work: str) -> Callable[[Any], Any]:
    cv2.setNumThreads(1)
    return pickle.loads(Path(work).read_bytes())
