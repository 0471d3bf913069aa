"""Free space on the disk, checked before a long run begins."""

import shutil
from pathlib import Path

from rich.filesize import decimal

from finloop.base.errors import FinloopError


def refuse_small(folder: Path, size: float, what: str, do: str) -> None:
    """Raise FinloopError if a folder's disk has less than `size` bytes free.

    what, do: for the message: what needs the space, and what the user can do instead of freeing it.
    """
    above = (folder.absolute(), *folder.absolute().parents)
    home = next(path for path in above if path.exists() and path.suffix != ".part")
    free = shutil.disk_usage(home).free
    if free < size:
        needs, has = decimal(int(size)), decimal(free)
        raise FinloopError(
            f"{what} will take about {needs}, and {has} are free in {home}",
            "enough free space for all of it",
            f"free some space (`dvc gc --workspace` drops unused results), or {do}",
        )
