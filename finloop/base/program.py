"""Where the files of the program are: in a working copy of finloop, or installed from a wheel.

A wheel keeps what is no Python, such as conf/, below finloop/shipped/.
"""

from pathlib import Path

from finloop import __version__

HOME = Path(__file__).resolve().parents[2]
"""The folder with the packages `finloop` and `stages` that this process runs."""
_OF_A_COPY = ("dvc.yaml", "finloop/__init__.py", "stages/run.py")


def shipped_folder() -> Path:
    """Return the folder with conf/, dvc.yaml, data/drawings/ and data/gaits/ of this version.

    It is finloop/shipped/ of an installed wheel, else the working copy.
    """
    packed = HOME / "finloop/shipped"
    return packed if packed.is_dir() else HOME


def holds_sources(folder: Path) -> bool:
    """Return whether a folder is a working copy of finloop: the pipeline and its sources."""
    return all((folder / name).is_file() for name in _OF_A_COPY)


def describe_program() -> str:
    """Return a phrase that says which finloop runs: its version and its folder."""
    kind = "installed" if shipped_folder() != HOME else "a working copy"
    return f"finloop {__version__}, {kind} in {HOME}"
