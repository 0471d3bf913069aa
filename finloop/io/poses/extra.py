"""The optional packages that read and write other programs' tracks: the extra `tracks`."""

from importlib import import_module
from types import ModuleType

from finloop.base.errors import FinloopError


def extra(module: str, path: object) -> ModuleType:
    """Import a module of the extra `tracks` to read or write the file at `path`.

    FinloopError if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise not_installed(path, error) from error


def not_installed(path: object, error: ImportError) -> FinloopError:
    """Return the error for a package of the extra that is missing."""
    return FinloopError(
        f"{path} needs packages that are not all installed: {error}",
        "the optional packages of the extra `tracks` (pyproject.toml)",
        "make tracks",
    )


def unreadable(path: object, software: str, why: object) -> FinloopError:
    """Return the error for a file that is not what `software` writes."""
    return FinloopError(
        f"{path} cannot be read as tracks of {software}: {why}",
        f"a complete file that {software} wrote",
        "export it again; if another program made it, name it: extract.tracks_software",
    )
