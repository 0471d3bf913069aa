"""The films that a path names: a film, those of a folder, or those that match a pattern."""

import unicodedata
from collections.abc import Iterable
from glob import has_magic, iglob
from pathlib import Path
from typing import NamedTuple

from finloop.base.errors import FinloopError
from finloop.io.footage.pictures import SUFFIXES, natural_sort_key
from finloop.io.footage.source import WANTED

FILMS = {
    ".avi", ".gif", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".ogv",
    ".ts", ".webm", ".wmv",
}  # fmt: skip
"""Endings of films in a folder; a file that the path names may have any ending."""


def list_films(path: str) -> list[Path]:
    """List the films at a path in natural order: 2 before 10.

    A file is a film, and so is a folder of pictures. A folder of films, or of folders of pictures,
    gives each; a pattern with `*`, `?`, `[…]` or `**` gives what it matches. A path that does not
    exist is returned unchanged: opening it fails. FinloopError if a pattern matches nothing.
    """
    whole = Path(path).expanduser()
    if whole.is_dir():
        return _in_folder(whole) or [whole]
    if whole.exists() or not has_magic(str(whole)):
        return [whole]
    films = [Path(name) for name in iglob(str(whole), recursive=True)]  # noqa: PTH207 (absolute ones too)
    if not films:
        raise FinloopError(
            came=f"the pattern {path} matches no file (searched from {Path.cwd()})",
            wanted=WANTED,
            do="correct the pattern, or make it absolute: /some/where/*.mp4",
        )
    return sorted(films, key=natural_sort_key)


def _in_folder(folder: Path) -> list[Path]:
    """List the films and picture folders in a folder; none if it holds the pictures itself."""
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    films = [path for path in inside if path.is_file() and path.suffix.lower() in FILMS]
    if not films and any(path.suffix.lower() in SUFFIXES for path in inside):
        return []
    films += [path for path in inside if path.is_dir() and _holds_pictures(path)]
    return sorted(films, key=natural_sort_key)


def _holds_pictures(folder: Path) -> bool:
    return any(path.suffix.lower() in SUFFIXES for path in folder.iterdir())


def film_names(paths: Iterable[Path]) -> list[str]:
    """Return a short, unique name for each film: its file's name, numbered where that is taken.

    Names have only letters, digits, `_` and `-`, so they can be folders and parts of metric names.
    """
    unique_names: list[str] = []
    for path in paths:
        stem = unicodedata.normalize("NFC", path.stem if path.suffix else path.name)
        name = "".join(c if c.isalnum() or c in "_-" else "-" for c in stem) or "film"
        folded = {earlier.casefold() for earlier in unique_names}  # some file systems ignore case
        number = 2
        unique = name
        while unique.casefold() in folded:
            unique, number = f"{name}-{number}", number + 1
        unique_names.append(unique)
    return unique_names


class Stamp(NamedTuple):
    """What changes when a file changes: its name, size [bytes] and time of modification [ns]."""

    name: str
    size: int
    modified_ns: int


def stamps(path: Path) -> list[Stamp]:
    """Return the stamps of a film's file, or of all pictures in its folder."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files_with_stat = ((file.name, file.stat()) for file in files)
    return [Stamp(name, stat.st_size, stat.st_mtime_ns) for name, stat in files_with_stat]


def refuse_grown(path: Path, before: list[Stamp]) -> None:
    """Raise FinloopError if a film's files have changed since `stamps(path)` returned `before`."""
    if stamps(path) != before:
        raise FinloopError(
            came=f"{path} has changed while it was read",
            wanted="a film that is finished",
            do="wait until it is recorded or copied, then run the same command again",
        )
