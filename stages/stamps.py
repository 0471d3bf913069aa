"""Compute stamps of films, tracks and paths that parameters name, so that DVC sees them change.

A path in params.yaml stays the same when the film there is replaced, or its folder gets one more.
So params.yaml holds a stamp of the files: a digest of their names, sizes and times. Composing sets
it; `python -m stages.stamps` (`make repro`) renews it.

DVC and Hydra import this to compose, so modules that read films are loaded only for a named film.
"""

import hashlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from stages.settings import FILES, PARAMS, read_params

Groups = Mapping[str, Mapping[str, Any]]


def file_stamp(stamp_name: str, groups: Groups) -> str | None:
    """Return a digest of the paths, sizes and times of the files that some parameters name.

    Of a folder, of all its files. None if there are none, or they cannot be read or listed.
    stamp_name: says which parameters, one of `FILES`. groups: content of params.yaml, group →
    parameters.
    """
    try:
        paths = _LISTS[stamp_name](groups)
        if not paths:
            return None
        from finloop.io.footage import read_file_stamps

        # Of a folder, the names, sizes and times of all its files.
        content = [(str(path.absolute()), *read_file_stamps(path)) for path in paths]
        return hashlib.sha256(repr(content).encode()).hexdigest()[:16]
    except (FinloopError, OSError):
        return None


def _film_files(groups: Groups) -> list[Path]:
    """Return the films that `clip.path` names."""
    paths = groups.get("clip", {}).get("path")
    if not paths:
        return []
    from finloop.io.footage import list_films

    entries = [paths] if isinstance(paths, str) else paths
    # An entry is a path, or the parameters of one film with its path.
    paths = [entry if isinstance(entry, str) else entry["path"] for entry in entries]
    return [film for path in paths for film in list_films(path)]


def _films_and_masks(groups: Groups) -> list[Path]:
    """Return the films, and the files with the masks of their arenas."""
    paths = groups.get("clip", {}).get("path")
    entries = paths if isinstance(paths, list | tuple) else []
    # A film of a list may have parameters of its own.
    settings = [groups.get("clip", {}), *(item for item in entries if isinstance(item, Mapping))]
    masks = [Path(film["arena"]) for film in settings if isinstance(film.get("arena"), str)]
    return [*_film_files(groups), *(mask.expanduser() for mask in masks)]


def _track_files(groups: Groups) -> list[Path]:
    """Return the files of tracks from other programs, one for each film."""
    path = groups.get("extract", {}).get("tracks_path")
    if not path:
        return []
    from finloop.extract.load_given import find_tracks_path

    films = _film_files(groups)
    paths = [find_tracks_path(film, path) for film in films] if len(films) > 1 else [path]
    return [Path(file).expanduser() for file in paths]


def _path_files(groups: Groups) -> list[Path]:
    """Return the files that contain the paths to swim."""
    paths = groups.get("matching", {}).get("path")
    entries = [paths] if isinstance(paths, str) else paths or []
    return [Path(path).expanduser() for path in entries if path and not path.startswith("track:")]


def _retarget_files(groups: Groups) -> list[Path]:
    """Return the files from which the track to retarget is read."""
    path = groups.get("retarget", {}).get("tracks")
    if not path:
        return []
    from finloop.retarget.load import film_data_folder, film_track_files

    folder = film_data_folder(Path(path).expanduser())
    return [Path(path).expanduser()] if folder is None else film_track_files(folder)


_LISTS: dict[str, Callable[[Groups], list[Path]]] = dict(
    zip(FILES, (_films_and_masks, _track_files, _path_files, _retarget_files), strict=True)
)


def main() -> None:
    """Update the stamps in params.yaml of films, tracks or paths that have changed.

    FinloopError if a file is missing that was there: a stage would remove what was made of it.
    """
    values = read_params()
    text = old_text = PARAMS.read_text(encoding="utf-8")
    for name in FILES:
        stamp = file_stamp(name, values)
        if values.get(name) and not stamp:
            paths = ", ".join(str(file) for file in _LISTS[name](values) if not file.exists())
            raise FinloopError(
                f"there is nothing at {paths or PARAMS.name + ': ' + name} any more",
                "the files that were there when params.yaml was composed",
                "bring them back and call `make repro` again; or go on with what was made of them: "
                "dvc repro",
            )
        line = yaml.safe_dump({name: stamp}).strip()
        text = re.sub(rf"^{name}:.*$", line, text, flags=re.MULTILINE)
    if text != old_text:
        save_bytes(PARAMS, text.encode())


if __name__ == "__main__":
    from stages.run import run

    run(main)
