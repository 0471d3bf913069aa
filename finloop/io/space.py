"""Room on the disk, looked at before a long run begins."""

import shutil
from pathlib import Path

from finloop.base.errors import FinloopError


def refuse_small(folder: Path, wanted: float, what: str, do: str) -> None:
    """FinloopError where a folder's disk has less room than `wanted` bytes for `what`."""
    above = (folder.absolute(), *folder.absolute().parents)
    home = next(one for one in above if one.exists() and one.suffix != ".part")
    free = shutil.disk_usage(home).free
    if free < wanted:
        raise FinloopError(
            f"{what} will take about {in_words(wanted)}, and {in_words(free)} are free in {home}",
            "room for all of it",
            f"make room (`dvc gc --workspace` drops unused results), or {do}",
        )


def in_words(size: float) -> str:
    """Bytes as people say them: 1.5 GB."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5:
            break
        size, unit = size / 1000, "TB" if unit == "GB" else unit
    return f"{size:.3g} {unit}"
