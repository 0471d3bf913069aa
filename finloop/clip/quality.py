"""Brightness of a clip, whether it is plain, and the loss by its coding."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np

from finloop.clip.doubled import change, subsample_grey
from finloop.clip.light import gain

PLAIN_LEVELS = 8  # least difference between the darkest and brightest pixel of a usable film
SAMPLES = 32  # most frames of a clip that are kept to compare them with the coded ones


@dataclass
class Tally:
    """Brightness of a clip, its changes and samples of its frames, gathered frame by frame.

    lights (frames,): brightness of each frame relative to the first one, where both show the tank.
    changes (frames,): how much each frame differs from the one before [grey levels], by
    `finloop.clip.doubled.change`; NaN for the first. samples: some frames, by their numbers.
    """

    frames: int = 0
    brightness_sum: float = 0.0
    darkest: int = 255
    brightest: int = 0
    samples: dict[int, np.ndarray] = field(default_factory=dict)
    _stride: int = 1
    lights: list[float] = field(default_factory=list)
    changes: list[float] = field(default_factory=list)
    _first: np.ndarray | None = None
    _last: np.ndarray | None = None

    def add(self, frame: np.ndarray) -> None:
        """Add one frame (h, w[, 3]); keep copies of at most `SAMPLES` frames, evenly spread."""
        self.brightness_sum += float(np.mean(cv2.mean(frame)[: 3 if frame.ndim == 3 else 1]))
        low, high, *_ = cv2.minMaxLoc(frame.reshape(frame.shape[0], -1))
        self.darkest, self.brightest = min(self.darkest, int(low)), max(self.brightest, int(high))
        here = subsample_grey(frame)
        self._first = here if self._first is None else self._first
        self.lights.append(float(gain(here, self._first)[0]))
        self.changes.append(float("nan") if self._last is None else change(self._last, here))
        self._last = here
        if self.frames % self._stride == 0:
            self.samples[self.frames] = frame.copy()
            if len(self.samples) > SAMPLES:
                self._stride *= 2
                self.samples = {
                    i: sample for i, sample in self.samples.items() if i % self._stride == 0
                }
        self.frames += 1

    @property
    def brightness_mean(self) -> float:
        """Return the mean grey level of all pixels of all frames, 0 … 255."""
        return self.brightness_sum / max(self.frames, 1)

    @property
    def plain(self) -> bool:
        """Return whether all pixels of all frames have about the same grey level."""
        return self.brightest - self.darkest < PLAIN_LEVELS


def psnr_db(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the peak signal-to-noise ratio [dB] of pairs of pictures, such as filmed and coded.

    It is 10 log₁₀(255² / mean squared difference) of all pixels of all pairs; infinite where
    nothing differs.
    """
    squares = pixels = 0.0
    for a, b in pairs:
        squares += float(np.square(cv2.absdiff(a, b).astype(np.float32)).sum(dtype=np.float64))
        pixels += a.size
    return 10 * np.log10(255**2 * pixels / squares) if squares else float("inf")
