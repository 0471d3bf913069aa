"""The optional packages that read and write other programs' tracks: the extra `tracks`."""

from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType

from finloop.base.errors import FinloopError
from finloop.io.poses.text import TEXTS, first_lines


def import_extra(module: str, path: object) -> ModuleType:
    """Import a module of the optional packages `tracks`, with which to read or write `path`.

    FinloopError if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise FinloopError(
            f"{path} needs packages that are not all installed: {error}",
            "the optional packages of the extra `tracks` (pyproject.toml)",
            "make tracks",
        ) from error


def unreadable_error(path: object, software: str, why: object) -> FinloopError:
    """Return the error for a file that is not what its tracking program writes.

    why: the reason. Of a CSV the error also says how it begins.
    """
    seen = ""
    if isinstance(path, Path) and path.suffix.lower() in TEXTS and path.is_file():
        with suppress(FinloopError, OSError):
            seen = f"; it begins with {first_lines(path)}"
    return FinloopError(
        f"{path} cannot be read as tracks of {software}: {why}{seen}",
        f"a complete file that {software} wrote",
        "export it again; if another program made it, name it: extract.tracks_software",
    )
