"""Compare all results with their checksums, after a power cut or on a doubtful disk: `make verify`.

Every reader of a result compares it, too. This also finds damage in what only people open, such as
films, in files that are remembered as whole, and in DVC's cache. DVC trusts its cache, and would
bring a damaged file back from there: such files are removed, and made again when they are wanted.
"""

from stages.run import run  # isort: skip

import hashlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.checksums import RECORD_NAME, find_damage
from stages.repository import run_dvc

PLACES = (Path("data"), Path("reports"))
_MD5 = partial(hashlib.md5, usedforsecurity=False)


def find_cache_damage(cache: Path) -> Iterator[Path]:
    """Yield the files of DVC's cache whose content does not have the MD5 that is their name."""
    for path in sorted(cache.glob("files/md5/??/*")):
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, _MD5).hexdigest()
        if digest != f"{path.parent.name}{path.stem}":  # a list of files ends in .dir
            yield path


def main() -> None:
    """Print whether all results are as they were written; FinloopError names those that are not.

    Damaged files of DVC's cache are named, too, and removed.
    """
    folders = sorted({path.parent for place in PLACES for path in place.rglob(RECORD_NAME)})
    if not folders:
        raise FinloopError(
            "no folder of data/ or reports/ has a record of its checksums",
            f"results of this version of finloop, with a file {RECORD_NAME} each",
            "run the pipeline: `dvc repro`",
        )
    damage = [error.came for folder in folders for error in find_damage(folder)]
    for path in find_cache_damage(Path(run_dvc("cache", "dir", folder=Path.cwd())[1].strip())):
        path.unlink()
        damage.append(f"{path}, in DVC's cache, was damaged, and is removed")
    if damage:
        raise FinloopError(
            "\n    ".join(dict.fromkeys(damage)),
            "the files as they were written",
            "make them again: `dvc repro`",
        )
    print(f"verify: all files are as they were written, in {len(folders)} folders and DVC's cache")


if __name__ == "__main__":
    run(main)
