"""The optional packages that read and write other programs' tracks: the extra `tracks`."""

from importlib import import_module
from types import ModuleType

from finloop.base.errors import FinloopError


def extra(module: str, path: object) -> ModuleType:
    """A module of the extra `tracks`; FinloopError if it is not installed.

    path: of the file that it is wanted for.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise not_installed(path, error) from error


def not_installed(path: object, error: ImportError) -> FinloopError:
    """The error for a package of the extra that is missing."""
    return FinloopError(
        f"{path} is read and written with packages that are not all installed: {error}",
        "the optional packages of the extra `tracks` (pyproject.toml)",
        "make tracks",
    )


def unreadable(path: object, software: str, why: object) -> FinloopError:
    """The error for a file that is not what it should be."""
    return FinloopError(
        f"{path} cannot be read as tracks of {software}: {why}",
        f"a whole file that {software} wrote",
        "export it again; if another program made it, name it: extract.tracks_software",
    )
