"""The wall of a tank, seen by fish near it: how far, and which direction leads away from it."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from finloop.base.arrays import Complex, Floats, Mask


@dataclass(frozen=True)
class Walls:
    """The tank's wall: distance from it, and direction away from it.

    arena (h, w): True where animals can be; length: BL in px. Places are complex, in BL, y up, as
    from `finloop.social.neighbours.vectors`.
    """

    arena: Mask
    length: float

    @cached_property
    def depth(self) -> Floats:
        """The distance (h, w) of each pixel of the arena from the nearest one outside, in BL."""
        walled = np.pad(self.arena.astype(np.uint8), 1)
        depth = cv2.distanceTransform(walled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(depth[1:-1, 1:-1], float) / self.length

    @cached_property
    def _slope(self) -> Complex:
        down, right = np.gradient(self.depth)
        slope = right - 1j * down
        size = np.abs(slope)
        return np.asarray(slope / np.where(size > 0, size, 1), complex)

    def wall_distance(self, place: Complex) -> Floats:
        """Return the distance (…) of places (…) from the wall, in BL, at their nearest pixels."""
        return self._pixels(self.depth, place)

    def near(self, place: Complex, heading: Complex) -> Complex:
        """Return vectors (…) away from the wall, of length 1 / (1 + distance in BL).

        They are complex, in the frame of the body. place, heading (…): complex.
        """
        away = self._pixels(self._slope, place) * heading.conj()
        return away / (1 + self._pixels(self.depth, place))

    def inside(self, place: Complex) -> Mask:
        """Return whether places (…) lie in the arena, as a mask (…)."""
        height, width = self.arena.shape
        x, y = place.real * self.length, -place.imag * self.length
        on = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        return on & self._pixels(self.arena, place)

    def _pixels(self, values: np.ndarray, place: Complex) -> np.ndarray:
        """Return the values (h, w) at places; outside the arena, those of the nearest pixel."""
        row, column = (
            np.clip(np.rint(at * self.length), 0, size - 1).astype(int)
            for at, size in zip((-place.imag, place.real), values.shape, strict=True)
        )
        return values[row, column]
