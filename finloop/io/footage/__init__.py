"""Film from any source: what FFmpeg opens, a folder of pictures, a stack of TIFF pages, an array.

`list_films` finds the films that a path names. `open_footage` inspects one (rate, colour,
orientation, depth) and reports its faults; `Footage.stream_numbered` then streams its frames,
upright, as uint8 grey or RGB, each with its time. Only a few frames are in memory at a time.
"""

import math
import unicodedata
from collections.abc import Iterable
from fractions import Fraction
from glob import has_magic, iglob
from pathlib import Path
from typing import NamedTuple

from finloop.base.errors import FinloopError
from finloop.io.footage.arrays import is_array_file
from finloop.io.footage.film import open_film
from finloop.io.footage.pictures import SUFFIXES, TIFF, natural_sort_key, open_pictures
from finloop.io.footage.source import WANTED, Footage, restrict_time

FILMS = {
    ".avi", ".gif", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".ogv",
    ".ts", ".webm", ".wmv",
}  # fmt: skip
"""Endings of films in a folder; a file that the path names may have any ending."""


def open_footage(
    path: Path, *, frame_rate_hz: float | None = None, start_s: float = 0.0,
    end_s: float | None = None, colour: bool | None = None,
) -> Footage:  # fmt: skip
    """Inspect a film, folder of pictures, TIFF stack or array and choose how to read it.

    frame_rate_hz: replaces the file's rate: every frame is kept, frame k at the time k /
    `frame_rate_hz`. start_s, end_s: half-open range of time; `end_s` None = to the end. colour:
    True = RGB, False = grey, None = RGB where the film has colours. FinloopError if there is
    nothing at `path`, it is no film, holds fewer than two frames, states no frame rate, or is
    shorter than the range of time.
    """
    # The denominator 1001 makes 29.97 the rate of television, 30000/1001.
    rate = None if frame_rate_hz is None else Fraction(frame_rate_hz).limit_denominator(1001)
    if not path.exists():
        raise FinloopError(
            came=f"there is nothing at {path.absolute()}",
            wanted=WANTED,
            do="correct the path, or make it absolute: an experiment may run in another folder",
        )
    if path.is_dir() or path.suffix.lower() in TIFF or is_array_file(path):
        footage, times = open_pictures(path, rate, colour)
    else:
        footage, times = open_film(path, rate, colour)
    return restrict_time(footage, times, start_s, math.inf if end_s is None else end_s)


def list_films(path: str) -> list[Path]:
    """Return the films that a path or pattern names, in natural order: 2 before 10.

    A file is a film, and so is a folder of pictures. A folder of films, or of folders of pictures,
    gives each; a pattern with `*`, `?`, `[…]` or `**` gives what it matches. A path to nothing is
    returned unchanged: opening it fails. FinloopError if a pattern matches nothing.
    """
    pattern = Path(path).expanduser()
    if pattern.is_dir():
        return _films_in_folder(pattern) or [pattern]
    if pattern.exists() or not has_magic(str(pattern)):
        return [pattern]
    films = [Path(name) for name in iglob(str(pattern), recursive=True)]  # noqa: PTH207 (absolute)
    if not films:
        raise FinloopError(
            came=f"the pattern {path} matches no file (searched from {Path.cwd()})",
            wanted=WANTED,
            do="correct the pattern, or make it absolute: /some/where/*.mp4",
        )
    return sorted(films, key=natural_sort_key)


def _films_in_folder(folder: Path) -> list[Path]:
    """Return a folder's films and subfolders of pictures, in natural order.

    The list is empty if it holds pictures and no films: then it is a folder of pictures itself.
    """
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    films = [path for path in inside if path.is_file() and path.suffix.lower() in FILMS]
    if not films and any(path.suffix.lower() in SUFFIXES for path in inside):
        return []
    for subfolder in filter(Path.is_dir, inside):
        if any(path.suffix.lower() in SUFFIXES for path in subfolder.iterdir()):
            films.append(subfolder)
    return sorted(films, key=natural_sort_key)


def unique_film_names(paths: Iterable[Path]) -> list[str]:
    """Return a unique name for each film, from its file's name, for folders and metrics.

    Equal names are numbered: fish, fish-2. Names have only letters, digits, `_` and `-`.
    """
    unique_names: list[str] = []
    for path in paths:
        stem = unicodedata.normalize("NFC", path.stem if path.suffix else path.name)
        letters = (letter if letter.isalnum() or letter in "_-" else "-" for letter in stem)
        name = "".join(letters) or "film"
        folded = {earlier.casefold() for earlier in unique_names}  # some file systems ignore case
        number = 2
        unique = name
        while unique.casefold() in folded:
            unique, number = f"{name}-{number}", number + 1
        unique_names.append(unique)
    return unique_names


class FileStamp(NamedTuple):
    """Name, size [bytes] and modification time [ns] of a file: they change when the file does."""

    name: str
    size: int
    modified_ns: int


def read_file_stamps(path: Path) -> list[FileStamp]:
    """Return the stamp of a film's file, or of every file in its folder, sorted by name."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    stats = [(file.name, file.stat()) for file in files]
    return [FileStamp(name, stat.st_size, stat.st_mtime_ns) for name, stat in stats]


def refuse_changed_film(path: Path, before: list[FileStamp]) -> None:
    """Raise FinloopError if a film's files have changed since `before`, their earlier stamps."""
    if read_file_stamps(path) != before:
        raise FinloopError(
            came=f"{path} has changed while it was read",
            wanted="a film that is finished",
            do="wait until it is recorded or copied, then run the same command again",
        )
