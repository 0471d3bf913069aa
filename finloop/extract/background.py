"""Find the empty tank, the film's noise, and the threshold between fish and tank (§2.1).

The paper subtracts a background; it explains neither the background nor the threshold. Here the
background is the median of frames spread over the clip; the noise level is the standard deviation
of the smoothed difference image where no fish is; the threshold is a multiple of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import cv2
import numpy as np
import skimage
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.light import BLACK, WHITE
from finloop.base.parallel import ALONE, Threads, ordered_map

_GRID = 16  # every 16th pixel in both directions suffices to measure the light
_LEAST_LIT = 0.2  # share of the picture; of less, on a black floor, animals are the most
_LEAST_SHOWN = 0.5  # share of these pixels; of less, the light has not changed by one gain
_SMOOTH = (3, 3)  # px, the Gaussian that smooths every difference image
_STRIP = 64  # rows
_NOISE_FRAMES = 8  # frames from which the noise is measured, some million pixels
# The floor around a ghost. On the trout, whose median shows it, the patched background gives the
# same fish with a smaller side of 60-180, a window of 31-61, a share of 0.02-0.3.
_SMALL = 120  # px, smaller side of the reduced picture in which all films are alike
_AROUND = 41  # px of the reduced picture: the window's side, a third of the smaller side
_AWAY = 0.1  # least share of a ghost that is floor in some frame; a stone never is
_ONE_SIDED = 0.9  # least share of changed pixels on one side of a one-sided polarity

Polarity = Literal["dark", "bright", "both", "auto"]
"""Whether fish are darker than the tank, brighter, or both (patterned skin)."""


@dataclass(frozen=True)
class Scene:
    """The empty tank of a clip, and how fish differ from it.

    background: (h, w) or (h, w, 3) uint8. polarity: whether fish are darker or brighter, never
    `auto`. noise: standard deviation of the smoothed difference image, grey levels. threshold:
    smallest difference of a fish, grey levels.

    Of a scene in the light of a frame, gains: how bright that is relative to the empty tank, per
    channel (1,) or (3,), None if it is unknown; even: the background in even light; grain: SD of a
    pixel of the tank, not smoothed, in even light, grey levels.
    """

    background: Picture
    polarity: Polarity
    noise: float
    threshold: float
    gains: Floats | None = None
    even: Picture | None = None
    grain: float = 0.0

    @cached_property
    def light_meter(self) -> "_LightMeter":
        """Return the meter of a frame's brightness relative to the background."""
        return _LightMeter(self.background)


class _LightMeter:
    """Measures how bright a frame is relative to the empty tank, on a grid of its bright pixels."""

    def __init__(self, background: Picture) -> None:
        """Select the pixels of the background that are bright enough to compare."""
        grid = background[::_GRID, ::_GRID].astype(np.float32)
        self._grid = grid.reshape(grid.shape[0] * grid.shape[1], -1)
        self._grey = ((self._grid > BLACK) & (self._grid < WHITE)).all(axis=1)
        self._lit = grid > BLACK
        self._levels = grid[self._lit]
        self._middle = float(np.median(self._levels)) if self._lit.any() else 0.0

    def measure(self, frame: Picture) -> float:
        """Return a frame's brightness divided by the background's, 1.0 if both are nearly equal."""
        return self.round_gain(self.measure_ratio(frame))

    def round_gain(self, gain: float) -> float:
        """Return a gain, or 1.0 if it changes the background by less than half a grey level."""
        return 1.0 if abs(gain - 1.0) * self._middle < 0.5 else gain

    def measure_ratio(self, frame: Picture) -> float:
        """Return the median ratio of a frame's pixels and the background's.

        It is 1.0 if the background has no bright pixel, or the frame is black there.
        """
        if not len(self._levels):
            return 1.0
        # The median of the ratios; np.median takes twice as long.
        middle = (len(self._levels) - 1) // 2, len(self._levels) // 2
        ratios = np.partition(frame[::_GRID, ::_GRID][self._lit] / self._levels, middle)
        gain = float(ratios[middle[0]] + ratios[middle[1]]) / 2
        return gain if gain > 0 else 1.0

    def measure_channels(self, frame: Picture, gain: float, threshold: float) -> Floats | None:
        """Return a frame's brightness divided by the background's, per channel: (1,) or (3,).

        It is a ratio of sums over pixels that show the tank: they differ from the background, made
        `gain` times as bright, by at most `threshold` grey levels. None, the light is unknown, if
        fewer than a fifth of the pixels are neither black nor white, or fewer than half of these
        show the tank.
        """
        tank = self._grid
        levels = frame[::_GRID, ::_GRID].reshape(tank.shape).astype(np.float32)
        lit = self._grey & (levels < WHITE).all(axis=1)
        count = np.count_nonzero(lit)
        if count < _LEAST_LIT * len(tank):
            return None
        tank, levels = tank[lit], levels[lit]
        # A light may change its colour. The first gains are only right to a grey level.
        gains = np.full(1, gain) if tank.shape[1] == 1 else np.median(levels / tank, axis=0)
        for _ in range(2):
            shown = (np.abs(levels - gains * tank) <= threshold).all(axis=1)
            if np.count_nonzero(shown) < _LEAST_SHOWN * count:
                return None
            gains = shown @ levels / (shown @ tank)
        return np.asarray(gains, np.float64)


def relative_brightness(frame: Picture, background: Picture) -> float:
    """Return a frame's brightness divided by a background's: the median ratio of pixels.

    It is exactly 1.0 if they differ by less than half a grey level, so nothing needs correction.
    """
    return _LightMeter(background).measure(frame)


def match_scene_to_light(scene: Scene, frame: Picture) -> Scene:
    """Return a scene whose background is as bright as a frame, with that light and its grain."""
    meter = scene.light_meter
    gain = meter.measure(frame)
    background = scale_brightness(scene.background, gain)
    gains = meter.measure_channels(frame, gain, scene.threshold)
    if gains is None:
        return replace(scene, background=background, gains=None)
    grid = np.s_[::_GRID, ::_GRID]
    residue = np.abs(frame[grid] / gains - scene.background[grid])
    in_tank = residue[residue <= scene.threshold]
    grain = float(np.sqrt(np.square(in_tank).mean())) if in_tank.size else scene.noise
    return replace(scene, background=background, gains=gains, even=scene.background, grain=grain)


def scale_brightness(picture: Picture, gain: float) -> Picture:
    """Return a picture made `gain` times as bright, 255 at most; itself if the gain is 1."""
    return picture if gain == 1.0 else cv2.convertScaleAbs(picture, alpha=gain)


def median_background(frames: Sequence[Picture], workers: Threads = ALONE) -> Picture:
    """Return the median picture (h, w[, 3]) of frames, all scaled to their mean brightness.

    frames: an odd number of pictures, all (h, w[, 3]).
    """
    meter = _LightMeter(frames[len(frames) // 2])
    brightness = np.array([meter.measure_ratio(frame) for frame in frames])
    gains = [meter.round_gain(gain) for gain in brightness.mean() / brightness]
    equally_bright = list(map(scale_brightness, frames, gains))
    # A strip of every frame at a time fits into the processor's cache.
    strips = [slice(top, top + _STRIP) for top in range(0, len(frames[0]), _STRIP)]
    medians = ordered_map(
        lambda strip: _median_picture([frame[strip] for frame in equally_bright]), strips, workers
    )
    return np.concatenate(list(medians))


def _median_picture(pictures: Sequence[Picture]) -> Picture:
    """Return the median of each pixel over an odd number of pictures of one size.

    They are found bit by bit, the highest first: a bit is set if at most half of the pictures are
    below the number with that bit. This is exact, and seven times as fast as sorting each pixel.
    """
    median = np.zeros_like(pictures[0])
    for bit in (128, 64, 32, 16, 8, 4, 2, 1):
        with_bit = median | np.uint8(bit)
        below = np.zeros(median.shape, np.min_scalar_type(len(pictures)))
        for picture in pictures:
            below += picture < with_bit
        np.copyto(median, with_bit, where=below <= len(pictures) // 2)
    return median


def flat_background(frames: Sequence[Picture]) -> Picture:
    """Return a background of one even tone, for a fish that hardly leaves its position.

    frames: (h, w[, 3]), as the background. Otsu's threshold divides the pixels of all frames in
    two; the larger part is the tank, and its median tone the background. FinloopError if all pixels
    are equal.
    """
    sample = np.stack([frame[::4, ::4] for frame in frames])
    grey = sample if sample.ndim == 3 else sample.max(axis=-1)
    if grey.min() == grey.max():
        raise FinloopError(
            f"every pixel of the clip has the value {grey.max()}",
            "a picture with a fish and a tank",
            "check the clip; it may be black or over-exposed",
        )
    above = grey > skimage.filters.threshold_otsu(grey)
    tank = above if above.mean() >= 0.5 else ~above
    return np.full(frames[0].shape, np.median(sample[tank], axis=0), np.uint8)


def background_without_ghosts(frames: Sequence[Picture], median: Picture, least: float) -> Picture:
    """Return the median picture (h, w[, 3]) with fish that hardly moved replaced by floor.

    frames, median: (h, w[, 3]), sample frames and their median. Such a *ghost* is a patch of the
    median that differs from its surroundings by more than `least` grey levels. In a tenth of its
    pixels or more, some frame differs by less than half of that: there the fish was away. The ghost
    takes the level of its surroundings. A stone is there in every frame, and stays.
    """
    height, width = median.shape[:2]
    reduction = max(1.0, min(height, width) / _SMALL)
    size = round(width / reduction), round(height / reduction)
    small = cv2.resize(median, size, interpolation=cv2.INTER_AREA)
    # the median of each pixel's surroundings, in which a narrow fish is a minority
    floor = cv2.medianBlur(small, _AROUND)
    floor = np.asarray(cv2.resize(floor, (width, height), interpolation=cv2.INTER_LINEAR))
    differs = _smooth_difference(median, floor) > least
    floor_seen = np.zeros_like(differs)
    for frame in frames:
        lit = scale_brightness(frame, 1 / relative_brightness(frame, median))
        floor_seen |= _smooth_difference(lit, floor) <= least / 2
    count, patch = cv2.connectedComponents(differs.astype(np.uint8))
    sizes = np.bincount(patch.ravel(), minlength=count)
    floor_share = np.bincount(patch[floor_seen], minlength=count) / sizes
    floor_share[0] = 0.0  # the part that does not differ
    ghost = (floor_share > _AWAY)[patch].astype(np.uint8)
    edge = 2 * round(reduction) + 1  # soft: a pixel of the reduced picture to each side
    ghost = cv2.dilate(ghost, np.ones((edge, edge), np.uint8)) > 0
    patched = median.copy()
    patched[ghost] = floor[ghost]
    return patched


def _smooth_difference(picture: Picture, other: Picture) -> Picture:
    """Return the smoothed absolute difference (h, w) of pictures; of RGB the largest channel."""
    change = cv2.absdiff(picture, other)
    grey = change if change.ndim == 2 else change.max(axis=-1)
    return np.asarray(cv2.GaussianBlur(grey, (5, 5), 1.5))


def difference_image(frame: Picture, scene: Scene) -> Picture:
    """Return how much each pixel of a frame differs from the tank, as a picture (h, w) uint8.

    The difference is in grey levels, smoothed over 3×3 px, of RGB the strongest channel. If fish
    are only darker than the tank, or only brighter, pixels that differ the other way are 0.
    """
    tank, polarity = scene.background, scene.polarity
    if frame.ndim == 2:
        return _grey_difference(frame, tank, int(polarity != "bright"), int(polarity != "dark"))
    if polarity == "dark":
        change = cv2.subtract(tank, frame)
    elif polarity == "bright":
        change = cv2.subtract(frame, tank)
    else:
        change = cv2.absdiff(frame, tank)
    red, green, blue = cv2.split(change)
    return cv2.GaussianBlur(cv2.max(cv2.max(red, green), blue), _SMOOTH, 0.85)


@kernel
def _grey_difference(frame, tank, darker, brighter):  # type: ignore[no-untyped-def]
    """Return the smoothed difference (h, w) of a grey frame from a grey tank, in one pass.

    darker: 1 if pixels darker than the tank count, else 0; brighter: likewise. Weights 1, 2, 1 in
    both directions are the Gaussian of 0.85 px, mirrored at the edges. Numbers have 16 bits, so
    many are processed at a time.
    """
    height, width = frame.shape
    result = np.empty((height, width), np.uint8)
    change = np.empty(width + 2, np.int16)
    rows = np.empty((3, width), np.int16)  # the last three rows, smoothed along x
    for y in range(-1, height + 1):
        source_row = min(abs(y), 2 * (height - 1) - y, height - 1)
        for x in range(width):
            darkening = np.int16(np.int16(tank[source_row, x]) - np.int16(frame[source_row, x]))
            change[x + 1] = max(np.int16(darker * darkening), np.int16(-brighter * darkening))
        change[0], change[width + 1] = change[2], change[width - 1]
        row = rows[y % 3]
        for x in range(width):
            row[x] = np.int16(change[x] + 2 * change[x + 1] + change[x + 2])
        if y > 0:
            above, middle = rows[(y - 2) % 3], rows[(y - 1) % 3]
            for x in range(width):
                total = np.int16(above[x] + 2 * middle[x] + row[x] + 8)
                result[y - 1, x] = total >> 4  # / 16, the sum of all weights; + 8 rounds
    return result


def measure_scene(
    frames: Sequence[Picture], background: Picture, polarity: Polarity, sigmas: float,
    least_threshold: float, workers: Threads = ALONE,
) -> Scene:  # fmt: skip
    """Return the scene that sample frames show: the film's noise, the threshold, the polarity.

    The noise is the 68.3 % quantile of the absolute smoothed difference, a standard deviation that
    ignores fish which cover less than a third of the tank. The threshold is `sigmas` times the
    noise, and at least `least_threshold` grey levels. polarity: `auto` is replaced by what the
    frames show.
    """
    sample = frames[:: max(1, len(frames) // _NOISE_FRAMES)]
    residue = np.stack(list(ordered_map(partial(_signed_difference, background), sample, workers)))
    noise = float(np.quantile(np.abs(residue), 0.6827))
    threshold = max(sigmas * noise, least_threshold)
    if polarity == "auto":
        dark, bright = int((residue < -threshold).sum()), int((residue > threshold).sum())
        polarity = "both"
        if dark >= _ONE_SIDED * (dark + bright):
            polarity = "dark"
        elif bright >= _ONE_SIDED * (dark + bright):
            polarity = "bright"
    return Scene(background, polarity, noise, threshold)


def _signed_difference(background: Picture, frame: Picture) -> NDArray[np.float32]:
    """Return frame minus tank at every second pixel, smoothed: > 0 where the frame is brighter.

    The result (h / 2, w / 2) is in grey levels. The tank is first made as bright as the frame. Of
    three colour channels the one that differs most counts.
    """
    change = frame.astype(np.float32) - relative_brightness(frame, background) * background.astype(
        np.float32
    )
    change = np.asarray(cv2.GaussianBlur(change, _SMOOTH, 0.85)[::2, ::2])
    if change.ndim == 2:
        return change
    strongest = np.abs(change).argmax(axis=-1, keepdims=True)
    return np.take_along_axis(change, strongest, axis=-1)[..., 0]
