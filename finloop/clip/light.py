"""The light of a film: the brightness of each frame against the empty tank, flicker and drift."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.light import BLACK, WHITE

_PIXELS = 1500  # pixels of a frame that are compared, to find the tank
_MANY = 12_000  # pixels of the tank whose sum tells the light
_LEAST_LIT = 0.2  # share of the picture; of less, on a black floor, animals are the most
_ROUNDS = 3  # rounds of leaving out pixels that are not tank
_SIGMAS = 3.0  # standard deviations of the difference from which a pixel is an animal
_SLOW_S = 3.0  # s; slower changes are drift
_WINDOW = 256  # frames of a spectrum
_FINER = 8  # the spectrum's bins between two that are independent
_PEAK = 0.5  # least share of the flicker's power in one peak that gives it a frequency

Levels = NDArray[np.float32]


def measure_gain(frame: Picture, tank: Picture) -> Floats:
    """Return a frame's brightness divided by that of the empty tank, per channel: (1,) or (3,).

    It is a ratio of sums over the pixels that show the tank in both pictures, where the tank is
    neither black nor white, and the frame is not white; NaN if these are less than a fifth.
    frame, tank: (h, w[, 3]).
    """
    frame_levels, tank_levels = _sample_pixels(frame, _PIXELS), _sample_pixels(tank, _PIXELS)
    lit = _find_lit(frame_levels, tank_levels)
    if lit.mean() < _LEAST_LIT:
        return np.full(tank_levels.shape[1], np.nan)
    frame_levels, tank_levels = frame_levels[lit], tank_levels[lit]
    gain = np.median(frame_levels / tank_levels, axis=0)
    for _ in range(_ROUNDS):  # leave out the pixels that an animal covers
        difference = np.abs(frame_levels - gain * tank_levels).max(axis=1)
        # 1.4826 × the median absolute value is the standard deviation of normal noise.
        limit = max(1.0, _SIGMAS * 1.4826 * float(np.median(difference)))
        is_tank = difference <= limit
        gain = frame_levels[is_tank].sum(axis=0) / tank_levels[is_tank].sum(axis=0)
    # The last time of many more pixels: the grain of a few is more than what light changes.
    frame_levels, tank_levels = _sample_pixels(frame, _MANY), _sample_pixels(tank, _MANY)
    is_tank = _find_lit(frame_levels, tank_levels)
    is_tank &= (np.abs(frame_levels - np.float32(gain) * tank_levels) <= limit).all(axis=1)
    gain = (is_tank @ frame_levels) / np.maximum(is_tank @ tank_levels, 1)
    return np.where(gain > 0, gain, 1.0).astype(np.float64)


def _find_lit(frame_levels: Levels, tank_levels: Levels) -> Mask:
    """Return a mask (n,): where the tank is neither black nor white, and the frame is not white."""
    lit = (tank_levels > BLACK) & (tank_levels < WHITE) & (frame_levels < WHITE)
    return np.asarray(lit.all(axis=1))


def _sample_pixels(picture: Picture, count: int) -> Levels:
    """Return about `count` evenly spread pixels of a picture, (n, channels)."""
    step = max(1, round((picture.shape[0] * picture.shape[1] / count) ** 0.5))
    sample = picture[::step, ::step].astype(np.float32)
    return sample.reshape(sample.shape[0] * sample.shape[1], -1)


class LightMeasures(NamedTuple):
    """Flicker and drift of a film's light, in per cent of its mean brightness; NaN if unknown."""

    flicker_pct: float  # root mean square of the fast part over the mean, in the median second
    flicker_hz: float  # NaN where the flicker has no single frequency
    drift_pct: float  # range of the slow part, darkest to brightest moment, over the mean


def smooth_light(brightness: Floats, rate_hz: float) -> Floats:
    """Return the brightness (frames,) averaged over three seconds around each frame."""
    half_window = min(round(_SLOW_S * rate_hz / 2), (len(brightness) - 1) // 2)
    padded = np.pad(brightness, half_window, mode="reflect") if half_window else brightness
    width = 2 * half_window + 1
    return np.convolve(padded, np.full(width, 1 / width), mode="valid")


def measure_light(
    brightness: Floats, rate_hz: float, starts: Sequence[int] = (0,)
) -> LightMeasures:
    """Measure flicker and drift from the brightness (frames,) of successive frames, in any unit.

    rate_hz: frames per second. Changes slower than three seconds are drift, the rest is flicker.
    NaN where the brightness of most frames is unknown (NaN). starts: where other stretches of the
    film begin; flicker is then that of the median stretch, without a frequency, and drift the range
    of the stretches' means.
    """
    if len(starts) > 1:
        stretches = np.split(brightness, starts[1:])
        measures = np.array([measure_light(stretch, rate_hz) for stretch in stretches])
        known = np.flatnonzero(np.isfinite(measures[:, 0]))
        if 2 * len(known) < len(stretches):
            return LightMeasures(np.nan, np.nan, np.nan)
        means = np.array([np.nanmean(stretches[k]) for k in known])
        drift = 100 * float(np.ptp(means) / means.mean())
        return LightMeasures(float(np.median(measures[known, 0])), np.nan, drift)
    known = np.flatnonzero(np.isfinite(brightness))
    if 2 * len(known) < len(brightness):
        return LightMeasures(np.nan, np.nan, np.nan)
    brightness = np.interp(np.arange(len(brightness)), known, brightness[known])
    mean = float(brightness.mean())
    slow = smooth_light(brightness, rate_hz)
    fast = brightness - slow
    second = max(2, round(rate_hz))
    parts = [fast[k : k + second] for k in range(0, len(fast), second)]
    flicker = float(np.median([np.mean(part**2) for part in parts])) ** 0.5
    low, high = np.quantile(slow, (0.01, 0.99))
    return LightMeasures(
        flicker_pct=100 * flicker / mean,
        flicker_hz=_peak_frequency(fast, rate_hz),
        drift_pct=100 * float(high - low) / mean,
    )


def _peak_frequency(flicker: Floats, rate_hz: float) -> float:
    """Return the frequency [Hz] with most power in flicker (frames,); NaN without a clear peak."""
    length = min(len(flicker), _WINDOW)
    starts = range(0, len(flicker) - length + 1, length)
    window, size = np.hanning(length), _FINER * length
    waves = np.stack([np.fft.rfft(flicker[k : k + length] * window, size) for k in starts])
    power = (np.abs(waves) ** 2).sum(axis=0)
    peak = int(np.argmax(power))
    peak_power = power[max(0, peak - 2 * _FINER) : peak + 2 * _FINER + 1].sum()
    if peak_power < _PEAK * power.sum() or not power.any():
        return float("nan")
    return peak * rate_hz / size
