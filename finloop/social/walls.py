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
    def depth(self) -> Floats:
        """Distance (h, w) of each pixel of the arena from the nearest pixel outside, in BL."""
        walled = np.pad(self.arena.astype(np.uint8), 1)
        depth = cv2.distanceTransform(walled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(depth[1:-1, 1:-1], float) / self.length

    @cached_property
    def _directions_from_wall(self) -> Complex:
        """Direction (h, w) away from the wall at each pixel, as complex unit vectors."""
        down, right = np.gradient(self.depth)
        slope = right - 1j * down
        size = np.abs(slope)
        return np.asarray(slope / np.where(size > 0, size, 1), complex)

    def wall_distance(self, place: Complex) -> Floats:
        """Return the distance (…) of places (…) from the wall, in BL, at the nearest pixels."""
        return self._values_at_places(self.depth, place)

    def vectors_from_wall(self, place: Complex, heading: Complex) -> Complex:
        """Return vectors (…) away from the wall, of length 1 / (1 + distance in body lengths).

        They are complex, relative to the body. place, heading (…): complex.
        """
        away = self._values_at_places(self._directions_from_wall, place) * heading.conj()
        return away / (1 + self._values_at_places(self.depth, place))

    def is_inside(self, place: Complex) -> Mask:
        """Return a mask (…) of the places (…) that lie in the arena."""
        height, width = self.arena.shape
        x, y = place.real * self.length, -place.imag * self.length
        on = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        return on & self._values_at_places(self.arena, place)

    def _values_at_places(self, values: np.ndarray, place: Complex) -> np.ndarray:
        """Look up the values (h, w) of pixels at places.

        Places outside the arena get those of the nearest pixel inside.
        """
        row, column = (
            np.clip(np.rint(at * self.length), 0, size - 1).astype(int)
            for at, size in zip((-place.imag, place.real), values.shape, strict=True)
        )
        return values[row, column]
