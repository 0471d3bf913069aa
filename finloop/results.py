"""Results of the library's verbs: a film, its tracks, and the folders of big results."""

import atexit
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Mask
from finloop.io.cutouts import CutoutStore, open_cutouts
from finloop.io.video import CLIP_NAME, VideoFacts, read_frames

_OPEN = ExitStack()  # stores and temporary folders, till the program ends
atexit.register(_OPEN.close)


@dataclass(frozen=True)
class Film:
    """A normalised clip. folder: of clip.mp4; arena (h, w): True where animals can be."""

    folder: Path
    facts: VideoFacts
    arena: Mask

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self.facts.frame_rate_hz

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """The frames, (h, w) grey or (h, w, 3) RGB uint8, one after the other."""
        return read_frames(self.folder / CLIP_NAME, colour=self.facts.colour)


@dataclass(frozen=True)
class Tracks:
    """Where every fish of a film is.

    table (n rows): columns of `tracks_schema`, a row per fish per frame, in the order track_id,
    frame; cutouts: n pictures of the same fish; background (h, w) or (h, w, 3) uint8: the tank;
    given (n rows): columns of `GIVEN`, what another program's tracks say of the same rows.
    """

    film: Film
    table: pd.DataFrame
    cutouts: CutoutStore
    background: NDArray[np.uint8]
    given: pd.DataFrame | None = None


def folder_of(folder: str | Path | None) -> Path:
    """The folder that is given, or a new temporary one."""
    if folder is not None:
        return Path(folder)
    return Path(_OPEN.enter_context(tempfile.TemporaryDirectory(prefix="finloop-")))


def opened(path: Path) -> CutoutStore:
    """A store of cut-outs, open till the program ends."""
    return _OPEN.enter_context(open_cutouts(path))
