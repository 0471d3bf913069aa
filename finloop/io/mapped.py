"""Arrays with a row per row of the film, too long to load: `.npy` files mapped into memory.

Opening is instant, access to rows is random, and processes share what they have read.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_file
from finloop.io.checksums import check_file


def save_array(path: Path, array: NDArray[Any]) -> None:
    """Write an array as .npy, completely or not at all; FinloopError if the disk is full."""
    with whole_file(path) as part:
        np.save(part, array, allow_pickle=False)


def create_array(path: Path, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    """Create an .npy file of zeros and return it as an array whose changes reach the file.

    kind: its dtype. The file appears at once, so use it inside `whole_folder`. OSError if the disk
    is full: the file takes all its space from the beginning, because the system kills a process
    that writes to a mapped page without space.
    """
    array = np.lib.format.open_memmap(path, "w+", np.dtype(kind), shape)
    if hasattr(os, "posix_fallocate"):
        with path.open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, array.offset + array.nbytes)
    return array.view(np.ndarray)


def flush_array(array: NDArray[Any]) -> None:
    """Write the content of a `create_array` array to its file, for other processes to open."""
    assert isinstance(array.base, np.memmap)
    array.base.flush()


def open_array(path: Path, shape: tuple[int | None, ...], kind: str) -> NDArray[Any]:
    """Open an .npy file as an array whose rows are read only when they are used.

    Writing to the array does not change the file. FinloopError if the file is missing, damaged, or
    has another shape (None for any length) or dtype (kind).
    """
    again = "run the stage that makes it again: `dvc repro`"
    wanted = f"an array of {kind} of shape {shape}, None for any length"
    try:
        array = np.load(check_file(path), mmap_mode="c", allow_pickle=False)
    except (EOFError, OSError, ValueError) as error:
        raise FinloopError(f"{path} cannot be read as an array ({error})", wanted, again) from error
    fits = len(shape) == array.ndim and all(
        length in (None, actual) for length, actual in zip(shape, array.shape, strict=True)
    )
    if array.dtype != np.dtype(kind) or not fits:
        came = f"{path} holds an array of {array.dtype} of shape {array.shape}"
        raise FinloopError(came, wanted, again)
    return array.view(np.ndarray)
