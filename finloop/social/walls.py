"""The wall of a tank, seen by fish near it: how far, and which direction leads away from it."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from finloop.base.arrays import Complex, Floats, Mask


@dataclass(frozen=True)
class Walls:
    """The wall of a tank: how far places are from it, and which direction leads away from it.

    arena (h, w): True where animals can be; length: of a body, px. Places are complex, in body
    lengths, y up, as from `finloop.social.neighbours.complex_vectors`.
    """

    arena: Mask
    length: float

    @cached_property
    def distances_from_wall(self) -> Floats:
        """Return the distance (h, w), in BL, of each pixel from the wall; 0 outside the arena."""
        walled = np.pad(self.arena.astype(np.uint8), 1)  # outside the picture is outside the arena
        px = cv2.distanceTransform(walled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(px[1:-1, 1:-1], float) / self.length

    @cached_property
    def _directions_from_wall(self) -> Complex:
        """Return the direction (h, w) away from the wall at each pixel, as complex unit vectors."""
        down, right = np.gradient(self.distances_from_wall)
        slope = right - 1j * down  # complex places have y up
        size = np.abs(slope)
        return np.asarray(slope / np.where(size > 0, size, 1), complex)

    def wall_distance(self, place: Complex) -> Floats:
        """Return the distance (…) [BL] of complex places (…) from the wall, by nearest pixels."""
        return self._values_at_places(self.distances_from_wall, place)

    def vectors_from_wall(self, place: Complex, heading: Complex) -> Complex:
        """Return vectors (…) away from the wall, of length 1 / (1 + distance in body lengths).

        They are complex, relative to the fish's body. place, heading (…): of the fish, complex.
        """
        away = self._values_at_places(self._directions_from_wall, place) * heading.conj()
        return away / (1 + self._values_at_places(self.distances_from_wall, place))

    def is_inside(self, place: Complex) -> Mask:
        """Return a mask (…) of the places (…) that lie in the arena."""
        height, width = self.arena.shape
        x, y = place.real * self.length, -place.imag * self.length
        in_picture = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        return in_picture & self._values_at_places(self.arena, place)

    def _values_at_places(self, values: np.ndarray, place: Complex) -> np.ndarray:
        """Return the values of an array (h, w) at the pixels nearest to places (…).

        Places outside the picture get the value of the nearest pixel in it.
        """
        height, width = values.shape
        row = np.clip(np.rint(-place.imag * self.length), 0, height - 1).astype(int)
        column = np.clip(np.rint(place.real * self.length), 0, width - 1).astype(int)
        return values[row, column]
