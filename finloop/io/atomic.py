"""Outputs that appear under their names only when they are complete, and space for them.

The unfinished work lies beside the output under the hidden name `.<name>.<process>.part…`, so the
last step is a rename within one file system. The next process that writes into the same folder
removes the unfinished files of killed processes.
"""

import errno
import glob
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.filesize import decimal

from finloop.base.errors import FREE_SPACE, MOVE_AWAY, FinloopError, user_error

_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path for a file; rename that file to `path` when the block succeeds.

    So the file is written completely or not at all: else `path` does not change. FinloopError if
    the disk is full, `path` is a folder, or it cannot be written.
    """
    if path.is_dir():
        raise FinloopError(f"{path} is a folder", "a file, or nothing of that name", MOVE_AWAY)
    with _temporary_path(path, f".{path.stem}.{_process_tag()}.part{path.suffix}") as part:
        yield part
        _flush_to_disk(part)
        part.replace(path)
    _flush_to_disk(path.parent)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder; let it replace the folder `path` when the block succeeds.

    So the folder is filled completely or not at all: after an exception `path` is unchanged.
    FinloopError if the disk is full, `path` is a file or a link, or it cannot be written.
    """
    _require_folder_place(path)
    with _temporary_path(path, f".{path.name}.{_process_tag()}.part") as part:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        yield part
        for inner in part.rglob("*"):
            _flush_to_disk(inner)
        _flush_to_disk(part)
        old = part.with_name(f"{part.name}.old")  # removed last, so that nothing is lost before
        with suppress(FileNotFoundError):
            path.replace(old)
        part.replace(path)
        _remove_path(old)
    _flush_to_disk(path.parent)


def _require_folder_place(path: Path) -> None:
    """Raise FinloopError if a new folder could not replace what stands at `path`."""
    _require_no_link(path)
    if path.exists() and not path.is_dir():
        raise FinloopError(f"{path} is a file", "a folder, or nothing of that name", MOVE_AWAY)


def _require_no_link(path: Path) -> None:
    """Raise FinloopError if `path` is a link: what replaces it would not be where that leads."""
    if path.is_symlink():
        raise FinloopError(
            f"{path} is a link to {path.readlink()}, and an output would replace the link",
            "a file or folder, or nothing of that name",
            f"remove the link (rm {path}); for room on another disk, clone the repository there",
        )


def require_output_place(path: Path) -> None:
    """Raise FinloopError if an output of a stage could not be written, before it is made.

    path: relative to the present folder. Neither it nor a folder above it may be a link.
    """
    for folder in reversed(path.parents):
        _require_folder_place(folder)
    _require_no_link(path)
    folder = next(folder for folder in path.parents if folder.exists())
    if not os.access(folder, os.W_OK):
        error = PermissionError(errno.EACCES, "it cannot be written", str(folder.absolute()))
        raise user_error(error) or error


@contextmanager
def temporary_file(path: Path) -> Iterator[Path]:
    """Yield the path of a hidden file beside `path`; remove that file when the block ends."""
    with _temporary_path(path, f".{path.name}.{_process_tag()}.part") as part:
        yield part


@contextmanager
def _temporary_path(path: Path, name: str) -> Iterator[Path]:
    """Yield the path of a hidden file or folder beside `path`; remove it when the block ends.

    name: of that file or folder. FinloopError if the disk is full, or it cannot be written.
    """
    part = path.with_name(name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(path.parent)
        yield part
    except OSError as error:
        # Name the output that was asked for, not the hidden one, nor a file inside a hidden folder.
        is_inner = _process_tag() in str(path.parent)
        is_own = str(error.filename or "").startswith(str(part)) or error.errno in _NO_SPACE
        message = user_error(error, path) if is_own and not is_inner else None
        if message is None:
            raise
        raise message from error
    finally:
        _remove_path(part)


def _process_tag() -> str:
    """Return a text that identifies this process: its machine's name and its process number."""
    return f"{socket.gethostname().partition('.')[0]}-{os.getpid()}"


def _remove_leftovers(folder: Path) -> None:
    """Remove from a folder the unfinished files of processes of this machine that have ended."""
    host = _process_tag().rpartition("-")[0]
    for path in folder.glob(f".*.{glob.escape(host)}-*.part*"):
        number = path.name.rpartition(".part")[0].rpartition("-")[2]
        if not number.isdecimal():
            continue
        try:
            os.kill(int(number), 0)  # signal 0 ends nothing; it fails if no such process runs
        except ProcessLookupError:
            _remove_path(path)
        except (PermissionError, OverflowError):
            pass  # another user's process, which runs; or no process has so large a number


def _remove_path(path: Path) -> None:
    """Remove a file, or a folder with all it holds; do nothing if it does not exist."""
    shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _flush_to_disk(path: Path) -> None:
    """Wait until a file's or folder's content is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def save_bytes(path: Path, content: bytes) -> None:
    """Write bytes to a file, completely or not at all; FinloopError if the disk is full."""
    with whole_file(path) as part:
        part.write_bytes(content)


def require_free_space(folder: Path, size_bytes: float, content: str, advice: str) -> None:
    """Raise FinloopError if the disk of `folder` has less than `size_bytes` free.

    content: what needs the space; advice: what the user can do instead of freeing some. Both go
    into the message.
    """
    above = (folder.absolute(), *folder.absolute().parents)
    # Not a temporary folder: the user shall recognise the one in the message.
    existing = next(path for path in above if path.exists() and path.suffix != ".part")
    free = shutil.disk_usage(existing).free
    if free < size_bytes:
        raise FinloopError(
            f"{content} will take about {decimal(int(size_bytes))}, "
            f"and {decimal(free)} are free in {existing}",
            "enough free space for all of it",
            f"{FREE_SPACE}, or {advice}",
        )
