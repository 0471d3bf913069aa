"""The film's rows in data/, opened by every process that works on some of them."""

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.mapped import keep_array, new_array, open_array
from finloop.io.table import load_table
from finloop.jumps.source import Pictures, shape_of
from finloop.pose.film import FilmPoses
from finloop.reel import Reel
from stages.poses import load_poses

DATA = Path("data")


@dataclass
class StoredFilm:
    """A `finloop.jumps.source.Source` whose pictures, `size` px across, are in the file `path`.

    Whoever unpickles it opens the files anew. OSError if the disk is full.
    """

    path: Path
    size: int
    _open: ExitStack = field(default_factory=ExitStack)

    def create(self) -> None:
        """Make the file, in the process that will fill it; others open it."""
        self._pictures = new_array(self.path, shape_of(self._film[0], self.size), "uint8")

    @cached_property
    def _film(self) -> tuple[Reel, FilmPoses]:
        features = load_table(DATA / "features/features.parquet", FEATURES)
        store = self._open.enter_context(open_cutouts(DATA / "extract/cutouts.arrow"))
        return Reel(features, store), load_poses(features)

    @cached_property
    def _pictures(self) -> Pictures:
        return open_array(self.path, shape_of(self._film[0], self.size), "uint8")

    def film(self) -> tuple[Reel, FilmPoses]:
        """As in `Source`."""
        return self._film

    def pictures(self) -> Pictures:
        """As in `Source`."""
        return self._pictures

    def keep(self) -> None:
        """As in `Source`."""
        keep_array(self._pictures)

    def __reduce__(self) -> tuple[Any, ...]:
        return StoredFilm, (self.path, self.size)
