"""Keep results of parts of a stage for its next run, so that only changed ones are made again.

A stage that works on every mode would work on all of them again when one mode changes. So it keeps
the result for each in a hidden folder beside its output, in a file whose name is a digest of
all that the result is made from. DVC keeps that folder; temporary experiments share it.
"""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from finloop.io.atomic import whole_file
from stages.origins import path_digest
from stages.reuse import key_digest

MOST = 100  # files that are kept, those that were used last


@dataclass(frozen=True)
class KeptResults:
    """Results that earlier runs of a stage have kept, each under a name such as a mode.

    folder: where they are; None keeps nothing and has nothing. made_from: digest of what all
    results are made from. own: name → what only that result is made from, too.
    """

    folder: Path | None
    made_from: str
    own: Mapping[str, Any]

    def load(self, name: str, kind: str, read: Callable[[Path], Any]) -> Any:
        """Return a kept result, read by `read`; None if there is none or it cannot be read.

        kind: the ending of its file, "parquet" or "json".
        """
        if self.folder is None:
            return None
        path = self._path(name, kind)
        try:
            result = read(path)
            os.utime(path)  # `save` removes those that were not used for long
        except (OSError, ValueError, KeyError):
            return None
        return result

    def save(self, name: str, kind: str, write: Callable[[Path], Any]) -> None:
        """Keep a result: write it with `write`, and remove all but the MOST recently used files.

        kind: the ending of the file, "parquet" or "json".
        """
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with whole_file(self._path(name, kind)) as part:
            write(part)
        oldest_first = sorted(self.folder.iterdir(), key=lambda path: path.stat().st_mtime)
        for path in oldest_first[:-MOST]:
            path.unlink(missing_ok=True)

    def _path(self, name: str, kind: str) -> Path:
        """Return the path of a result's file, named by a digest of all it is made from."""
        assert self.folder is not None
        key = {"all": self.made_from, "name": name, "own": self.own.get(name)}
        return self.folder / f"{key_digest(key)}.{kind}"


def open_kept(stage: str, inputs: list[Path], own: Mapping[str, Any]) -> KeptResults:
    """Return the kept results of a stage that are made from its present inputs.

    inputs: files and folders that every result is made from, beside the stage's parameters and
    program. own: name → what only that result is made from. Parameters and program are known from
    data/params/<stage>.yaml; without it nothing is kept.
    """
    settings = Path(f"data/params/{stage}.yaml")
    if not settings.exists():
        return KeptResults(None, "", own)
    digests = {str(path): path_digest(path) for path in (settings, *inputs)}
    root = Path(os.environ.get("DVC_ROOT", "."))
    return KeptResults(root / f"data/.{stage}.kept", key_digest(digests), own)


def save_frames(path: Path, frames: list[pd.DataFrame]) -> None:
    """Write data frames of equal columns to one Parquet file, exactly."""
    pd.concat(frames, keys=range(len(frames))).to_parquet(path)


def load_frames(path: Path, count: int) -> list[pd.DataFrame]:
    """Read `count` data frames that `save_frames` wrote, in the same order."""
    table = pd.read_parquet(path)
    numbers = table.index.get_level_values(0)
    return [table[numbers == number].droplevel(0) for number in range(count)]


def save_values(path: Path, values: Any) -> None:
    """Write plain values (dictionaries, lists, numbers, text) as JSON, with exact numbers."""
    path.write_text(json.dumps(values), encoding="utf-8")


def load_values(path: Path) -> Any:
    """Read plain values that `save_values` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))
