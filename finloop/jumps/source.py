"""A film whose rows are worked block by block: in memory, or in files that every worker opens."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from finloop.distance.reel import Reel
from finloop.pose.film import FilmPoses

Pictures = NDArray[np.uint8]


class RowSource(Protocol):
    """Rows of a film, their postures, and room for their pictures.

    It is asked again for every block. A cluster pickles it, once for all blocks.
    """

    def film(self) -> tuple[Reel, FilmPoses]:
        """The rows and their postures."""
        ...

    def pictures(self) -> Pictures:
        """Room for pictures of all rows, of `shape_of`."""
        ...

    def keep(self) -> None:
        """All pictures have been drawn, and others will look at them."""
        ...


def shape_of(reel: Reel, size: int) -> tuple[int, ...]:
    """The shape (n, s, s, c) of pictures of all rows, `size` px across."""
    return len(reel), size, size, reel.film[0].pixels.shape[2]


@dataclass(frozen=True)
class InMemory:
    """A film that is in memory, with its pictures; for workers of this process."""

    reel: Reel
    poses: FilmPoses
    drawn: Pictures

    @classmethod
    def from_reel(cls, reel: Reel, poses: FilmPoses, size: int) -> "InMemory":
        """Make the source with room for pictures `size` px across. poses: of the reel's rows."""
        return cls(reel, poses, np.empty(shape_of(reel, size), np.uint8))

    def film(self) -> tuple[Reel, FilmPoses]:
        """As in `RowSource`."""
        return self.reel, self.poses

    def pictures(self) -> Pictures:
        """As in `RowSource`."""
        return self.drawn

    def keep(self) -> None:
        """As in `RowSource`."""
