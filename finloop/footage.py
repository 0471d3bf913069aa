"""A film and its tracks, as verbs exchange them, and their folders and stores."""

import atexit
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Mask
from finloop.base.settings import settings
from finloop.clip.rewrite import make_clip
from finloop.clip.write import open_source
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import CutoutStore, open_cutouts
from finloop.io.video import CLIP_NAME, VideoFacts, read_frames

_OPEN = ExitStack()  # stores and temporary folders, until the program ends
atexit.register(_OPEN.close)


@dataclass(frozen=True)
class Film:
    """A normalised clip; iterating over it yields its frames.

    folder: holds clip.mp4. facts: size, rate, … arena (h, w): True where animals can be.
    """

    folder: Path
    facts: VideoFacts
    arena: Mask

    @property
    def rate_hz(self) -> float:
        """Return the clip's frames per second."""
        return self.facts.frame_rate_hz

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames, (h, w) grey or (h, w, 3) RGB uint8, one after the other."""
        return read_frames(self.folder / CLIP_NAME, colour=self.facts.colour)


@dataclass(frozen=True)
class Tracks:
    """Where every fish of a film is in every frame, with its cut-out.

    table (n rows): columns of `tracks_schema`, a row per fish per frame, in the order track_id,
    frame; cutouts: n pictures of the same fish; background (h, w) or (h, w, 3) uint8: the tank;
    given (n rows): columns of `GIVEN`, from another program's tracks of the same rows.
    """

    film: Film
    table: pd.DataFrame
    cutouts: CutoutStore
    background: NDArray[np.uint8]
    given: pd.DataFrame | None = None


def open_film(path: str | Path, folder: str | Path | None = None, **changes: Any) -> Film:
    """Read a film, a folder of pictures or a TIFF stack; write it as a clip and return the clip.

    The clip lies in `folder`/clip, or in a temporary folder. `changes` override
    `finloop.clip.settings.File`, for example frame_rate_hz=25.0 or end_s=60.0.
    """
    return _film(folder, source="file", path=str(path), **changes)


def draw_carp(folder: str | Path | None = None, **changes: Any) -> Film:
    """Draw a synthetic film of carp; write it as a clip to `folder`/clip and return the clip.

    `changes` override `finloop.clip.settings.Carp`.
    """
    return _film(folder, source="carp", **changes)


def _film(folder: str | Path | None, **values: Any) -> Film:
    p, home = settings("clip", **values), make_folder(folder) / "clip"
    source = open_source(p)
    with whole_folder(home) as part:
        clip = make_clip(p, source, part)
    return Film(home, clip.facts, clip.arena)


def make_folder(folder: str | Path | None) -> Path:
    """Return the folder; for None a new temporary one that lasts until the program ends."""
    if folder is not None:
        return Path(folder)
    return Path(_OPEN.enter_context(tempfile.TemporaryDirectory(prefix="finloop-")))


def open_store(path: Path) -> CutoutStore:
    """Open the store of cut-outs at `path`; it stays open until the program ends."""
    return _OPEN.enter_context(open_cutouts(path))
