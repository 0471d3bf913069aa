"""The wall of a tank, seen by fish near it: how far, and which direction leads away from it."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from finloop.base.arrays import Complex, Floats, Mask, Reals


@dataclass(frozen=True)
class Walls:
    """The arena (h, w), where animals can be, and a body length in px.

    Places are complex, in body lengths, as in `finloop.social.neighbours`.
    """

    arena: Mask
    length: float

    @cached_property
    def depth(self) -> Floats:
        """The distance (h, w) of each pixel from the nearest one outside, in body lengths."""
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
        """Return the distance of places (…) from the wall, in body lengths."""
        return self._pixels(self.depth, place)

    def near(self, place: Complex, heading: Complex) -> Complex:
        """Return nearness 1 / (1 + distance) as a vector (…) of the body away from the wall."""
        away = self._pixels(self._slope, place) * heading.conj()
        return away / (1 + self._pixels(self.depth, place))

    def inside(self, place: Complex) -> Mask:
        """Return whether places (…) are in the arena."""
        height, width = self.arena.shape
        x, y = place.real * self.length, -place.imag * self.length
        on = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        return on & self._pixels(self.arena, place)

    def _pixels(self, values: np.ndarray, place: Complex) -> np.ndarray:
        """Return the values (h, w) at places; outside the arena, those of the nearest pixel."""
        height, width = values.shape
        columns = _nearest(place.real * self.length, width)
        return values[_nearest(-place.imag * self.length, height), columns]


def _nearest(at: Reals, count: int) -> np.ndarray:
    return np.clip(np.rint(at), 0, count - 1).astype(int)
