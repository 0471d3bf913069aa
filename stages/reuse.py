"""Reuse what an earlier run made of each film, so that only changed films are processed again.

DVC removes a stage's outputs before it runs the stage. So what was made of each film is kept beside
them, in a folder whose name is a digest of the parameters, the film and the code.
"""

import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from finloop.io.atomic import whole_folder
from finloop.io.checksums import RECORD_NAME, find_damage, report_remake, save_checksums
from finloop.io.record import save_json
from stages.code import file_list_text

NUMBERS_NAME = "numbers.json"
Numbers = Mapping[str, float]


def reuse_or_make(kept: Path, folder: Path, make: Callable[[Path], Numbers]) -> dict[str, float]:
    """Fill `folder` with kept files of a film, or `make` them; return the film's numbers.

    kept: folder of the film's files, named by the `key_digest` of what they are made from. make:
    writes the files into a folder and returns numbers; those that are finite are then kept, with
    the files and their checksums. Damaged ones are made again. After an error in `make` there is no
    folder.
    """
    if (kept / RECORD_NAME).is_file():
        if not find_damage(kept):
            _link_folder(kept, folder)
            (folder / RECORD_NAME).unlink()
            (folder / NUMBERS_NAME).unlink()
            kept_numbers: dict[str, float] = json.loads((kept / NUMBERS_NAME).read_bytes())
            return kept_numbers
        report_remake(kept)
    folder.mkdir(parents=True)
    try:
        numbers = {name: value for name, value in make(folder).items() if math.isfinite(value)}
    except BaseException:
        shutil.rmtree(folder)
        raise
    kept.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(kept) as new:
        _link_folder(folder, new)
        save_json(new / NUMBERS_NAME, numbers)
        save_checksums(new)
    return numbers


def _link_folder(source: Path, target: Path) -> None:
    """Link all files of the folder `source` into `target`; copy them where links are impossible."""
    shutil.copytree(source, target, copy_function=_link_or_copy, dirs_exist_ok=True)


def _link_or_copy(source: str, target: str) -> None:
    """Make `target` a hard link to the file `source`, or a copy where links are not possible."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def key_digest(key: Mapping[str, Any]) -> str:
    """Return a digest of plain values, 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:16]


def code_digest(stage: str) -> str:
    """Return a digest of all files of the program that a stage may run."""
    return hashlib.sha256(file_list_text(stage).encode()).hexdigest()
