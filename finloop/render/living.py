"""The empty tank at every tick of an animation: still, or with the film's grain and light.

The tank is a video texture (fish paper §4.1, of what is not a fish): pictures of it in succession
(`finloop.extract.grain`) play forward in the film's order, and jump. After a picture another may
follow that differs from it no more than successive pictures do, and was not shown just before. At
an end without such a picture the order turns round.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture

_MEAN_RUN = 8  # pictures that are played in the film's order, on average
_AS_UNLIKE = 1.25  # times as unlike as successive pictures: grain that is new at each frame is 1.1
_SAMPLE_PX = 10_000  # pixels by which pictures are compared


class LivingTank:
    """The empty tank's picture and light at every tick, the same for the same tick.

    pictures: (h, w[, 3]) uint8, at least one; several are played as a video texture. light (n,):
    brightness of successive frames relative to their mean, played forward and back; empty where
    the light is even.
    """

    def __init__(self, pictures: Sequence[Picture], light: Floats | None = None) -> None:
        """Compare the pictures, to find which may follow which."""
        self.pictures = pictures
        self._light = np.ones(1) if light is None or not len(light) else light
        self._may_follow = _alike_pictures(pictures)
        self._random = np.random.default_rng(0)
        self._order, self._step = [0], 1
        self._last_shown = np.full(len(pictures), -len(pictures))

    def number_at(self, tick: int) -> int:
        """Return the number of the picture that is shown at a tick, from 0 on."""
        while len(self._order) <= tick:
            self._order.append(self._next_number())
        return self._order[tick]

    def picture_at(self, tick: int) -> Picture:
        """Return the picture of the empty tank at a tick, from 0 on."""
        return self.pictures[self.number_at(tick)]

    def light_at(self, tick: int) -> float:
        """Return the brightness at a tick relative to the mean; at its end the course runs back."""
        period = max(1, 2 * len(self._light) - 2)
        place = tick % period
        return float(self._light[min(place, period - place)])

    def light_up(self, canvas: NDArray[np.uint8], tick: int) -> None:
        """Multiply a canvas (h, w, channels), in place, by the film's brightness at a tick."""
        gain = self.light_at(tick)
        if gain != 1.0:
            cv2.convertScaleAbs(canvas, dst=canvas, alpha=gain)

    def _next_number(self) -> int:
        """Return the number of the picture that follows the last one of the order."""
        shown, count, tick = self._order[-1], len(self.pictures), len(self._order)
        self._last_shown[shown] = tick - 1
        following = shown + self._step
        at_end = not 0 <= following < count
        if at_end or self._random.random() < 1 / _MEAN_RUN:
            is_old = self._last_shown < tick - count // 2
            targets = np.flatnonzero(self._may_follow[shown] & is_old)
            if len(targets):
                self._step = 1
                return int(self._random.choice(targets))
        if at_end:
            self._step = -self._step
        return min(max(shown + self._step, 0), count - 1)


def make_living_tank(
    background: Picture, pictures: Sequence[Picture], light: Floats | None
) -> LivingTank | None:
    """Return a tank with grain and light, as far as they are known; None if it stands still.

    background: its still picture. pictures, light: as in `LivingTank`; [] and None are unknown.
    """
    if not len(pictures) and light is None:
        return None
    return LivingTank(pictures if len(pictures) else [background], light)


def _alike_pictures(pictures: Sequence[Picture]) -> NDArray[np.bool_]:
    """Return which picture (column) may follow which (row) after a jump, (k, k)."""
    step = max(1, round((pictures[0].shape[0] * pictures[0].shape[1] / _SAMPLE_PX) ** 0.5))
    sample = np.stack([picture[::step, ::step].ravel() for picture in pictures]).astype(np.float32)
    count = len(sample)
    if count < 3:
        return np.zeros((count, count), bool)
    sample -= sample.mean(axis=0)
    products = sample @ sample.T
    squares = np.diag(products)
    distance = np.sqrt(np.maximum(squares[:, None] + squares - 2 * products, 0))
    successive = np.median(np.diag(distance, 1))
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) > 1
    return (distance <= _AS_UNLIKE * successive) & apart
