"""Keep results of parts of a stage for its next run, so that only changed ones are made again.

A stage that works on every mode would work on all of them again when one mode changes. So it keeps
the result for each in a hidden folder beside its output, in a file whose name is a digest of
all that the result is made from. DVC keeps that folder; temporary experiments share it.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import pandas as pd

from finloop.io.atomic import save_bytes
from finloop.io.checksums import seal, unseal
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

    def load_values(self, name: str) -> Any:
        """Return plain values that were kept; None if there are none, or a checksum is wrong."""
        packed = self._load(name, "values")
        return None if packed is None else json.loads(packed)

    def save_values(self, name: str, values: Any) -> None:
        """Keep plain values (dictionaries, lists, numbers, text), numbers exactly."""
        self._save(name, "values", json.dumps(values).encode())

    def load_frames(self, name: str, count: int) -> list[pd.DataFrame] | None:
        """Return `count` data frames that were kept; None if there are none, or damaged ones."""
        packed = self._load(name, "frames")
        if not packed:  # None, or of no frames
            return None if packed is None else []
        table = pd.read_parquet(BytesIO(packed))
        numbers = table.index.get_level_values(0)
        return [table[numbers == number].droplevel(0) for number in range(count)]

    def save_frames(self, name: str, frames: list[pd.DataFrame]) -> None:
        """Keep data frames of equal columns, exactly."""
        packed = pd.concat(frames, keys=range(len(frames))).to_parquet() if frames else b""
        self._save(name, "frames", packed)

    def _load(self, name: str, ending: str) -> bytes | None:
        """Return a kept result as bytes; None if there is none, or its checksum is wrong."""
        if self.folder is None or (content := unseal(path := self._path(name, ending))) is None:
            return None
        with suppress(OSError):
            os.utime(path)  # `_save` removes those that were not used for long
        return content

    def _save(self, name: str, ending: str, packed: bytes) -> None:
        """Keep a result as bytes, and remove all but the MOST recently used files."""
        if self.folder is None:
            return
        save_bytes(self._path(name, ending), seal(packed))
        oldest_first = sorted(self.folder.iterdir(), key=lambda path: path.stat().st_mtime)
        for path in oldest_first[:-MOST]:
            path.unlink(missing_ok=True)

    def _path(self, name: str, ending: str) -> Path:
        """Return the path of a result's file: a digest of what made it, and the ending."""
        assert self.folder is not None
        key = {"all": self.made_from, "name": name, "own": self.own.get(name)}
        return self.folder / f"{key_digest(key)}.{ending}"


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
