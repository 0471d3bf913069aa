"""A film that is processed block by block: in memory, or in files that every worker opens."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from finloop.distance.reel import Reel
from finloop.pose.film import FilmPoses

Pictures = NDArray[np.uint8]


class RowSource(Protocol):
    """Access to a film's rows, their postures, and the array in which their pictures are drawn.

    Each block of rows calls it again. A cluster pickles it, once for all blocks.
    """

    def film(self) -> tuple[Reel, FilmPoses]:
        """Return the film's rows and, in the same order, their postures."""
        ...

    def pictures(self) -> Pictures:
        """Return the array, uint8 (n, s, s, c), in which the rows' pictures are drawn."""
        ...

    def keep(self) -> None:
        """Make the pictures available to other processes, once all are drawn."""
        ...


def shape_of(reel: Reel, size: int) -> tuple[int, ...]:
    """Return the shape (n, s, s, c) of the array of all rows' pictures, s = `size` px across."""
    return len(reel), size, size, reel.film[0].pixels.shape[2]


@dataclass(frozen=True)
class InMemory:
    """A film and its pictures in memory, for workers of this process."""

    reel: Reel
    poses: FilmPoses
    drawn: Pictures

    @classmethod
    def from_reel(cls, reel: Reel, poses: FilmPoses, size: int) -> "InMemory":
        """Make the source with an empty array for pictures `size` px across; poses: of its rows."""
        return cls(reel, poses, np.empty(shape_of(reel, size), np.uint8))

    def film(self) -> tuple[Reel, FilmPoses]:
        """Return the film's rows and, in the same order, their postures."""
        return self.reel, self.poses

    def pictures(self) -> Pictures:
        """Return the array, uint8 (n, s, s, c), in which the rows' pictures are drawn."""
        return self.drawn

    def keep(self) -> None:
        """Do nothing: the pictures are in memory."""
