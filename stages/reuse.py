"""Reuse results of an earlier run: of several films, only changed ones are made again.

A film's folder holds its key: the parameters, the film and the code from which it was made.
"""

import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from finloop.io.record import save_json
from stages.code import file_list_text

KEY_NAME, NUMBERS_NAME = "made_from.json", "numbers.json"
Numbers = Mapping[str, float]


def reuse_or_make(
    old: Path, folder: Path, key: Mapping[str, Any], make: Callable[[Path], Numbers]
) -> dict[str, float]:
    """Put a film's files into `folder`, from an earlier run or made anew; return its numbers.

    old: the earlier run's folder, reused if it has the same key, plain values; make: writes the
    files into a folder. After an error in `make` there is no folder.
    """
    text = json.loads(json.dumps(key))
    if _read(old / KEY_NAME) == text and isinstance(numbers := _read(old / NUMBERS_NAME), dict):
        shutil.copytree(old, folder, copy_function=_link)
        return numbers
    folder.mkdir(parents=True)
    try:
        numbers = {name: value for name, value in make(folder).items() if math.isfinite(value)}
    except BaseException:
        shutil.rmtree(folder)
        raise
    save_json(folder / NUMBERS_NAME, numbers)
    save_json(folder / KEY_NAME, key)
    return numbers


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def name_of(key: Mapping[str, Any]) -> str:
    """Return 16 hexadecimal digits that name a key; different keys have different names."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:16]


def code_digest(stage: str) -> str:
    """Return one digest of all files of the program that a stage may run."""
    return hashlib.sha256(file_list_text(stage).encode()).hexdigest()
