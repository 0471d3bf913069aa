"""How a film codes its pictures: orientation, colour, range and depth of levels.

Frames are (h, w) grey or (h, w, 3) RGB; x runs right, y down.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

CHROMA_LEVELS = 12.0  # a pixel this far from the film's own tint is coloured
CHROMA_FRACTION = 5e-4  # least share of coloured pixels of a colour film; a goldfish: 3e-3 of 1 MP
DEEP_PERCENTILES = (0.01, 99.99)  # black and white of a deep film: hot pixels lie outside
# Y of the limited ("studio") range: 16 is black and 235 white (BT.601).
FULL_FROM_LIMITED = np.clip(np.rint((np.arange(256) - 16) * (255 / 219)), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Turn:
    """One of the eight orientations of a picture, by which it becomes upright.

    A pixel goes from (x, y) to (a x + c y, b x + d y); each of a, b, c, d is −1, 0 or 1.
    """

    a: int = 1
    b: int = 0
    c: int = 0
    d: int = 1

    @property
    def rotation_deg(self) -> int:
        """Return the anticlockwise rotation, after the mirroring: 0, 90, 180 or 270 degrees."""
        return round(np.degrees(np.arctan2(self.c, self.d))) % 360

    @property
    def is_mirrored(self) -> bool:
        """Return whether left and right are swapped before the rotation."""
        return self.a * self.d - self.b * self.c < 0

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """Turn the picture upright; no pixel is lost or changed."""
        if not self.a:
            return np.ascontiguousarray(frame.swapaxes(0, 1)[:: self.b, :: self.c])
        return np.ascontiguousarray(frame[:: self.d, :: self.a])


UPRIGHT = Turn()


def turn_of(matrix: Sequence[int] | np.ndarray) -> tuple[Turn, bool]:
    """Return the orientation nearest to a film's display matrix, and whether it is exact.

    matrix: nine numbers, row by row: a, b, _, c, d, …; a pixel goes to x′ = a x + c y, y′ = b x + d
    y.
    """
    a, b, _, c, d = (float(value) for value in matrix[:5])
    upright = abs(a) + abs(d) >= abs(b) + abs(c)
    exact = max(abs(b), abs(c)) == 0 if upright else max(abs(a), abs(d)) == 0
    if upright:
        return Turn(a=_sign(a), d=_sign(d)), exact
    return Turn(a=0, b=_sign(b), c=_sign(c), d=0), exact


def _sign(value: float) -> int:
    return -1 if value < 0 else 1


def chroma_fraction(frames: Iterable[np.ndarray]) -> float:
    """Return the share (0 … 1) of pixels whose colour differs clearly from their frame's own tint.

    frames: (h, w, 3) RGB. An even tint, as of an infrared camera, does not count as colour.
    """
    parts = []
    for frame in frames:
        chroma = cv2.cvtColor(frame, cv2.COLOR_RGB2YCrCb)[..., 1:].astype(np.float32)
        chroma -= np.median(chroma, axis=(0, 1))
        parts.append(float((np.hypot(chroma[..., 0], chroma[..., 1]) > CHROMA_LEVELS).mean()))
    return float(np.mean(parts)) if parts else 0.0


def deep_levels(frames: Iterable[np.ndarray]) -> tuple[float, float]:
    """Return the two grey levels that become 0 and 255 in a film of more than 8 bits.

    These are robust percentiles over all pixels of the sampled `frames`: cameras rarely fill their
    16 bits, and a few hot pixels must not decide.
    """
    lows, highs = zip(*(np.percentile(f, DEEP_PERCENTILES) for f in frames), strict=True)
    low, high = float(min(lows)), float(max(highs))
    return low, max(high, low + 1)


def stretch_levels(frame: np.ndarray, low: float, high: float) -> np.ndarray:
    """Map a frame's levels `low` … `high` to 0 … 255, clip others; return the frame as uint8."""
    scaled = (frame.astype(np.float32) - low) * (255 / (high - low))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
