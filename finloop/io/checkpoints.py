"""Stored results of the steps of a long run, from which an interrupted run continues.

A result is a file. Its folder's name is a digest of the film, the parameters and the code. Results
are removed when the run has succeeded; one whose checksum is wrong is computed again.
"""

import pickle
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import pyarrow as pa

from finloop.io.atomic import save_bytes
from finloop.io.checksums import seal, unseal

T = TypeVar("T")
_CODEC = pa.Codec("zstd", compression_level=1)
_SIZE = 8  # bytes of the size in front of a result


@dataclass(frozen=True)
class Checkpoints:
    """Stored results of the steps of a long run, from which an interrupted run continues.

    Each result is a file in `folder`. An object of this class can be sent to another process.
    """

    folder: Path

    def load_or_make(self, name: str, make: Callable[[], T]) -> T:
        """Return a stored result by its name; compute and store it if it is missing or damaged.

        name: also that of the file. make: computes the result. FinloopError if the disk is full.
        """
        path = self.folder / name
        if (content := unseal(path)) is not None:  # the unpacked size, then the compressed pickle
            plain = _CODEC.decompress(content[_SIZE:], int.from_bytes(content[:_SIZE]))
            return pickle.loads(plain)
        result = make()
        save_bytes(path, pack_result(result))
        return result

    def stored_bytes(self) -> int:
        """Return the size of all stored results together [bytes]."""
        return sum(path.stat().st_size for path in self.folder.glob("*"))

    def remove(self) -> None:
        """Remove all stored results and their folder, and the folder above it if that is empty."""
        shutil.rmtree(self.folder, ignore_errors=True)
        with suppress(OSError):  # another run has checkpoints there
            self.folder.parent.rmdir()


def pack_result(result: object) -> bytes:
    """Pack a result for its file: checksum, size of its pickle (8 bytes), the compressed pickle."""
    plain = pickle.dumps(result, pickle.HIGHEST_PROTOCOL)
    return seal(len(plain).to_bytes(_SIZE) + _CODEC.compress(plain, asbytes=True))


def remove_folders_except(folder: Path, names: Iterable[str]) -> None:
    """Remove the subfolders of a folder except those named; then the folder, if it is empty."""
    names = set(names)
    for path in folder.glob("*"):
        if path.name not in names:
            shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):  # it is not empty
        folder.rmdir()
