"""Compare all results with their checksums, after a power cut or on a doubtful disk: `make verify`.

Every reader of a result compares it, too. This also finds damage in what only people open, such as
films, and in files that are remembered as whole.
"""

from stages.run import run  # isort: skip

from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.checksums import RECORD_NAME, find_damage

PLACES = (Path("data"), Path("reports"))


def main() -> None:
    """Print how many folders of results are as they were written; FinloopError names the damage."""
    folders = sorted({path.parent for place in PLACES for path in place.rglob(RECORD_NAME)})
    if not folders:
        raise FinloopError(
            "no folder of data/ or reports/ has a record of its checksums",
            f"results of this version of finloop, with a file {RECORD_NAME} each",
            "run the pipeline: `dvc repro`",
        )
    damage = dict.fromkeys(error.came for folder in folders for error in find_damage(folder))
    if damage:
        raise FinloopError(
            "\n    ".join(damage), "the files as they were written", "make them again: `dvc repro`"
        )
    print(f"verify: all files are as they were written, in {len(folders)} folders")


if __name__ == "__main__":
    run(main)
