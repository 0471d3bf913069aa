"""Checksums of results: written when a stage ends, compared whenever a result is read.

The file `finloop-checksums.yaml` in a folder has the SHA-256 of every file of the folder, of files
beside it that were written with them, and of what all were made from. Its first line is the SHA-256
of its other lines. A file that no such record names is not compared.

A digest is remembered by the file's place on the disk, size and times of change: by this process,
and of a large file by all processes, until the temporary folder is emptied. So arrays of gigabytes
are read as a whole once, and not by every stage and worker that maps them into memory.
"""

import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

RECORD_NAME = "finloop-checksums.yaml"
_HEAD = "# SHA-256 of the lines below: "
_LEVELS = 3  # folders above a file in which its record is looked for
_LARGE = 1 << 23  # bytes of a file whose digest all processes remember
_SETTLED_S = 2.0  # since a file's last change; a later one within the clock's step would not show
_DIGEST_BYTES = 32  # of a SHA-256
_known: dict[str, str] = {}  # state of a file → its digest


class DamagedFileError(FinloopError):
    """The error that a file is not what was written."""


# --- records


def save_checksums(
    folder: Path, written: Iterable[Path] = (), made_from: Iterable[Path] = ()
) -> None:
    """Write the record of a folder: digests of its files, of others, and of what they come from.

    written: files outside the folder that belong to it. made_from: files and folders that all were
    made from; the record of such a folder stands for its files.
    """
    inside = [path for path in folder.rglob("*") if path != folder / RECORD_NAME]
    sources = [part for path in made_from for part in files_or_record(path)]
    sections = {
        "files": _digest_files([*inside, *written], folder),
        "made_from": _digest_files(sources, folder),
    }
    text = f"{json.dumps(sections, indent=2)}\n".encode()  # YAML, too
    save_bytes(folder / RECORD_NAME, f"{_HEAD}{hashlib.sha256(text).hexdigest()}\n".encode() + text)


def files_or_record(path: Path) -> list[Path]:
    """Return the record of a folder; its files if it has none; of a file, the file."""
    record = path / RECORD_NAME
    if record.is_file():
        return [record]
    return [*path.rglob("*")] if path.is_dir() else [path]


def _digest_files(paths: Iterable[Path], folder: Path) -> dict[str, str]:
    """Return the digests of the files among paths, by their paths relative to a folder."""
    return {
        Path(os.path.relpath(path, folder)).as_posix(): file_digest(path)
        for path in sorted(paths)
        if path.is_file()
    }


def _load_record(path: Path) -> dict[str, str]:
    """Return the digests of a record's files by their paths relative to its folder.

    DamagedFileError if its first line is not the digest of the rest.
    """
    head, _, text = path.read_bytes().partition(b"\n")
    if head.decode(errors="replace") != f"{_HEAD}{hashlib.sha256(text).hexdigest()}":
        raise _damage_error(path, "its lines do not have the digest that the first one says")
    digests: dict[str, str] = json.loads(text)["files"]
    return digests


def load_digests(folder: Path) -> dict[Path, str]:
    """Return the files that a folder's record names as written, with their digests.

    {} for a folder without a record; DamagedFileError if the record is damaged.
    """
    record = folder / RECORD_NAME
    digests = _load_record(record) if record.is_file() else {}
    return {Path(os.path.normpath(folder / name)): digest for name, digest in digests.items()}


# --- files


def check_file(path: Path) -> Path:
    """Return a path, after comparing the file's content with the record that names it, if any.

    The record is in one of the next folders above the file, in the folder beside it that has its
    name without the ending, or in data/<stage> or a folder of it for reports/<stage>/<file>.
    DamagedFileError if the content or the record is not what was written; the time of the file is
    then set to now, so that DVC looks at it again. A missing file is left to its reader.
    """
    wanted = _find_digest(path)
    if not wanted or not path.is_file() or file_digest(path) == wanted:
        return path
    if (came := _read_digest(path)) == wanted:  # what is remembered was damaged
        return path
    raise _damage_error(path, f"its SHA-256 is {came[:12]}…, not {wanted[:12]}…")


def _find_digest(path: Path) -> str | None:
    """Return the digest of a file as the nearest record that names it has it; None without one."""
    *above, top = path.absolute().parents[:_LEVELS]
    results = top / "data" / path.parent.name
    parts = (record.parent for record in results.glob(f"*/{RECORD_NAME}"))
    for folder in (*above, top, path.with_suffix(""), results, *parts):
        record = folder / RECORD_NAME
        if record.is_file():
            name = Path(os.path.relpath(path, folder)).as_posix()
            if digest := _load_record(record).get(name):
                return digest
    return None


def find_damage(folder: Path) -> list[DamagedFileError]:
    """Return an error for each file of a folder's record that is missing or damaged.

    All files are read, whatever is remembered. The list is empty for a folder without a record.
    """
    errors = list[DamagedFileError]()
    try:
        digests = load_digests(folder)
    except DamagedFileError as error:
        return [error]
    for path, wanted in digests.items():
        if not path.is_file():
            errors.append(_damage_error(path, "it is missing"))
        elif (came := _read_digest(path)) != wanted:
            errors.append(_damage_error(path, f"its SHA-256 is {came[:12]}…, not {wanted[:12]}…"))
    return errors


def _damage_error(path: Path, why: str) -> DamagedFileError:
    """Return the error for a damaged file, whose time it sets to now; why: how it is known."""
    with suppress(OSError):  # it is missing, or of another user
        os.utime(path)
    return DamagedFileError(
        f"{path} is damaged: {why}",
        "the file as it was written",
        "make it again: `dvc repro`",
    )


# --- digests


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file; if it is known and the file has not changed, without reading.

    OSError if the file cannot be read.
    """
    status = path.stat()
    state = _describe_state(status)
    if state not in _known:
        digest = (status.st_size >= _LARGE and _recall_digest(state)) or _read_digest(path)
        if time.time() - max(status.st_mtime, status.st_ctime) < _SETTLED_S:
            return digest
        _known[state] = digest
        if status.st_size >= _LARGE:
            _remember_digest(state, digest)
    return _known[state]


def _read_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, 64 hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _describe_state(status: os.stat_result) -> str:
    """Return a text that changes whenever a file is written or replaced."""
    times = status.st_mtime_ns, status.st_ctime_ns
    return "-".join(map(str, (status.st_dev, status.st_ino, status.st_size, *times)))


def _memory_folder() -> Path:
    """Return the folder in which this user's processes remember digests of large files.

    OSError if another user has made it, or there is no temporary folder.
    """
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"finloop-checksums-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != user:
        raise PermissionError(f"{folder} is another user's")
    return folder


def _recall_digest(state: str) -> str | None:
    """Return the digest that another process has found of a file in a state; None if unknown."""
    with suppress(OSError, UnicodeDecodeError):
        digest = (_memory_folder() / state).read_text(encoding="ascii")
        return digest if len(digest) == 2 * _DIGEST_BYTES else None
    return None


def _remember_digest(state: str, digest: str) -> None:
    """Let other processes know the digest of a file in a state, if there is a place for it."""
    with suppress(OSError):
        (_memory_folder() / state).write_text(digest, encoding="ascii")


# --- caches: files that nothing but this program reads


def seal(content: bytes) -> bytes:
    """Return a content with its SHA-256 in front, for `unseal`."""
    return hashlib.sha256(content).digest() + content


def unseal(path: Path) -> bytes | None:
    """Return the content of a file that `seal` has made; None if it is missing or damaged.

    A note on stderr names a damaged one. Its caller makes it again.
    """
    try:
        sealed = path.read_bytes()
    except OSError:
        return None
    content = sealed[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() == sealed[:_DIGEST_BYTES]:
        return content
    report_remake(path)
    return None


def report_remake(path: Path) -> None:
    """Print that a kept file is damaged, and that it is made again."""
    print(f"finloop: note: {path} is damaged; what it kept is made again", file=sys.stderr)
