"""Room on the disk, looked at before a long run begins."""

import shutil
from pathlib import Path

from rich.filesize import decimal

from finloop.base.errors import FinloopError


def refuse_small(folder: Path, wanted: float, what: str, do: str) -> None:
    """FinloopError where a folder's disk has less room than `wanted` bytes for `what`."""
    above = (folder.absolute(), *folder.absolute().parents)
    home = next(one for one in above if one.exists() and one.suffix != ".part")
    free = shutil.disk_usage(home).free
    if free < wanted:
        needs, has = decimal(int(wanted)), decimal(free)
        raise FinloopError(
            f"{what} will take about {needs}, and {has} are free in {home}",
            "room for all of it",
            f"make room (`dvc gc --workspace` drops unused results), or {do}",
        )
