"""Stamps of the films, tracks and paths that parameters name, so that DVC sees them change.

A path in params.yaml stays the same when the film there is replaced, or its folder gets one more.
So params.yaml holds a stamp of the files: a digest of their names, sizes and times. Composing sets
it; `python -m stages.stamps` (`make repro`) renews it.

DVC and Hydra import this whenever they compose, so modules that read films are loaded only for a
named film.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_file
from stages.settings import FILES, PARAMS, read


def film_stamp(clip: Mapping[str, Any]) -> str | None:
    """Return the stamp of the films of `clip` and of the masks of their arenas.

    None where there are no files, or one is missing.
    """
    several = clip.get("path")
    each = several if isinstance(several, list | tuple) else []
    parts = [clip, *(part for part in each if isinstance(part, Mapping))]
    masks = [part["arena"] for part in parts if isinstance(part.get("arena"), str)]
    try:
        return digest([*_films(clip), *(Path(mask).expanduser() for mask in masks)])
    except (FinloopError, OSError):
        return None


def tracks_stamp(clip: Mapping[str, Any], extract: Mapping[str, Any]) -> str | None:
    """Return the stamp of the files of tracks; None if none is named, or one is missing.

    clip, extract: groups of params.yaml, which name the films and the tracks.
    """
    path = extract.get("tracks_path")
    if not path:
        return None
    from finloop.extract.load_given import tracks_of

    try:
        films = _films(clip)
        paths = [tracks_of(film, path) for film in films] if len(films) > 1 else [path]
        return digest(Path(file).expanduser() for file in paths)
    except (FinloopError, OSError):
        return None


def path_stamp(matching: Mapping[str, Any]) -> str | None:
    """Return the stamp of the files with paths; None if none exists.

    matching: group of params.yaml. Files that do not exist are left out.
    """
    paths = matching.get("path")
    several = [paths] if isinstance(paths, str) else paths or []
    files = [Path(path).expanduser() for path in several if path]
    return _stamp([file for file in files if file.exists()])


def retarget_stamp(retarget: Mapping[str, Any]) -> str | None:
    """Return the stamp of the file of tracks to retarget; None if none is named or it is missing.

    For another film's folder it is the stamp of the files that are read from it. retarget: group of
    params.yaml.
    """
    path = retarget.get("tracks")
    if not path:
        return None
    from finloop.retarget.load import film_files, film_folder

    folder = film_folder(Path(path).expanduser())
    return _stamp_at(path) if folder is None else _stamp(film_files(folder))


def _stamp_at(path: str | None) -> str | None:
    return _stamp([Path(path).expanduser()]) if path else None


def _stamp(paths: list[Path]) -> str | None:
    try:
        return digest(paths)
    except (FinloopError, OSError):
        return None


def _films(clip: Mapping[str, Any]) -> list[Path]:
    paths = clip.get("path")
    if not paths:
        return []
    from finloop.io.footage import list_films

    several = [paths] if isinstance(paths, str) else paths
    names = [item if isinstance(item, str) else item["path"] for item in several]
    return [film for path in names for film in list_films(path)]


def digest(paths: Iterable[Path]) -> str | None:
    """Return 16 hexadecimal digits of the names, sizes and times of files; None for no files.

    A folder stands for its files.
    """
    files = list(paths)
    if not files:
        return None
    from finloop.io.footage import file_stamps

    stamps_of = [(str(path.absolute()), *file_stamps(path)) for path in files]
    return hashlib.sha256(repr(stamps_of).encode()).hexdigest()[:16]


def main() -> None:
    """Renew the stamps in params.yaml where films, tracks or paths have changed."""
    values = read()
    clip, extract = values.get("clip", {}), values.get("extract", {})
    stamps = (
        film_stamp(clip),
        tracks_stamp(clip, extract),
        path_stamp(values.get("matching", {})),
        retarget_stamp(values.get("retarget", {})),
    )
    text = old = PARAMS.read_text(encoding="utf-8")
    for name, new in zip(FILES, stamps, strict=True):
        line = yaml.safe_dump({name: new}).strip()
        text = re.sub(rf"^{name}:.*$", line, text, flags=re.MULTILINE)
    if text != old:
        with whole_file(PARAMS) as part:
            part.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    from stages.run import run

    run(main)
