"""Check a film: the quality of its light, camera and coding.

Some frames of the normalised clip, spread over it, are examined as grey pictures, so a long film
takes no longer than a short one. Light and doubled pictures are measured in every frame, while the
clip is written (`ClipTally`).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture
from finloop.base.light import undo_gain
from finloop.base.schema import Column, Schema, columns
from finloop.base.thin import thin_frame
from finloop.clip.doubled import find_repeats, picture_change
from finloop.clip.light import LightMeasures, measure_gain, measure_light
from finloop.clip.shake import (
    STILL,
    UNKNOWN,
    Shift,
    find_landmarks,
    measure_shift,
    to_grey,
    undo_shift,
)

CHECK_NAME, TANK_NAME = "check.parquet", "tank.png"  # beside the clip
EXAMINED = 96  # most frames of a clip that are examined
PLAIN_LEVELS = 8  # least difference between the darkest and brightest pixel of a usable film
SAMPLES = 32  # most frames of a clip that are kept to compare them with the coded ones
_TANK_SAMPLES = 15  # frames whose median is the empty tank
_STRIP = 16  # rows
_TILES = 6  # tiles of the picture in both directions; the median tile gives the noise
_THIN = 3  # every 3rd pixel in both directions for noise and contrast
_SIGMAS, _LEAST = 6.0, 15.0  # noises and grey levels from which a pixel is not tank
BLACK, WHITE = 1, 254  # grey levels; beyond them nothing was recorded
_FIELD_THIN = 4  # every 4th column tells the order of fields
_MOTION = 12  # least change [grey levels] from frame to frame of a moved pixel
_FEW = 50  # least number of moved pixels of a frame whose fields are judged

CHECK = Schema(
    Column("frame", "int32", "1"),
    Column("light", "float32", "1", nullable=True),
    Column("change", "float32", "grey levels", nullable=True),
    *columns("float32", "px", "shift_x", "shift_y", "shift_apart", nullable=True),
    Column("field_order", "float32", "1", nullable=True),
    Column("noise", "float32", "grey levels", nullable=True),
)
"""Measures of every frame; NaN where a frame was not examined or lacks the feature."""


@dataclass(frozen=True)
class Quality:
    """Measures of a film's light, camera, coding and contrast; a measure that is unknown is NaN."""

    light_flicker_pct: float  # of the mean, root mean square
    light_flicker_hz: float  # NaN: irregular
    light_drift_pct: float  # of the mean, from the darkest to the brightest moment
    shake_px: float  # root mean square distance of the camera from its usual place
    shake_most_px: float  # the largest distance
    shake_apart_px: float  # how far parts of the picture moved differently, median
    doubled_pct: float  # share of pictures that repeat the one before, where that is decidable
    doubled_rate: float  # pictures a frame, if a cadence predicts them; else NaN
    field_order: float  # 0: whole pictures; interlaced: above 0 the upper field is the earlier one
    noise_grey: float  # standard deviation of a pixel of the empty tank
    contrast_grey: float  # median difference of what moves from the empty tank
    animal_black_pct: float  # of the pixels of what moves: nothing was recorded
    animal_white_pct: float
    coding_quantiser: float = math.nan  # of H.264: 0 is without loss, 51 is worst; NaN: unknown

    @classmethod
    def from_metrics(cls, metrics: Mapping[str, float], prefix: str = "") -> "Quality":
        """Return the measures stored in metrics under prefix + name; NaN if one is missing."""
        return cls(*(metrics.get(prefix + entry.name, np.nan) for entry in fields(cls)))


@dataclass
class ClipTally:
    """Counts a clip's frames, sums up their brightness, and keeps copies of some of them."""

    frames: int = 0
    brightness_sum: float = 0.0
    darkest: int = 255
    brightest: int = 0
    samples: dict[int, np.ndarray] = field(default_factory=dict)  # some frames, by number
    _stride: int = 1  # frames from one sample to the next
    # (frames,) brightness relative to the first frame whose light is known; NaN: too dark, or white
    lights: list[float] = field(default_factory=list)
    # (frames,) how much each frame differs from the one before [grey levels]; NaN for the first
    changes: list[float] = field(default_factory=list)
    _first: np.ndarray | None = None
    _last: np.ndarray | None = None

    def add_frame(self, frame: np.ndarray) -> None:
        """Count and measure the next frame (h, w[, 3]); keep a copy if it is a sample.

        Only a grid of its pixels is measured (`thin_frame`); copies are whole.
        """
        thinned = thin_frame(frame)  # a copy: the caller may reuse the memory
        self.brightness_sum += float(np.mean(cv2.mean(thinned)[: 3 if frame.ndim == 3 else 1]))
        low, high, *_ = cv2.minMaxLoc(thinned.reshape(len(thinned), -1))
        self.darkest, self.brightest = min(self.darkest, int(low)), max(self.brightest, int(high))
        subsample = to_grey(thinned)
        if self._first is None and not np.isnan(measure_gain(subsample, subsample)[0]):
            self._first = subsample
        self.lights.append(
            float("nan") if self._first is None else float(measure_gain(subsample, self._first)[0])
        )
        self.changes.append(
            float("nan") if self._last is None else picture_change(self._last, subsample)
        )
        self._last = subsample
        if self.frames % self._stride == 0:
            self._add_sample(frame)
        self.frames += 1

    def _add_sample(self, frame: np.ndarray) -> None:
        """Keep a copy of a frame; of more than `SAMPLES` copies, drop every other one."""
        self.samples[self.frames] = frame.copy()
        if len(self.samples) > SAMPLES:
            self._stride *= 2
            remaining = [number for number in self.samples if number % self._stride == 0]
            self.samples = {number: self.samples[number] for number in remaining}

    @property
    def brightness_mean(self) -> float:
        """Return the mean grey level of the measured pixels of all frames, 0 … 255."""
        return self.brightness_sum / max(self.frames, 1)

    @property
    def is_plain(self) -> bool:
        """Return whether the measured pixels of all frames have about the same grey level."""
        return self.brightest - self.darkest < PLAIN_LEVELS


def psnr_db(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the peak signal-to-noise ratio [dB] of pairs of pictures, such as filmed and coded.

    It is 10 log₁₀(255² / mean squared difference) of all pixels; infinite if nothing differs.
    """
    squares = pixels = 0.0
    for a, b in pairs:
        squares += float(np.square(cv2.absdiff(a, b).astype(np.float32)).sum(dtype=np.float64))
        pixels += a.size
    return 10 * np.log10(255**2 * pixels / squares) if squares else float("inf")


def choose_examined_frames(frames: int, key_frame_distance: int = 1) -> list[int]:
    """Return which frames of a clip are examined: their numbers, ascending.

    All frames of a short clip; of a long one about `EXAMINED`, in runs of at least two successive
    frames, because noise and fields are measured between a frame and the next. Each run begins at
    another key frame, which decodes at once. frames: length of the clip. key_frame_distance: frames
    from one key frame to the next.
    """
    if frames <= EXAMINED:
        return list(range(frames))
    runs = min(EXAMINED // 2, frames // key_frame_distance)
    length = EXAMINED // runs
    starts = np.linspace(0, frames - length, runs).astype(int)
    starts = starts // key_frame_distance * key_frame_distance
    return [int(start) + k for start in starts for k in range(length)]


def _empty_tank(tally: ClipTally) -> Picture:
    """Return the tank without animals (h, w[, 3]): the median of frames without flicker and shake.

    It is as bright as the median of all frames.
    """
    numbers = list(tally.samples)[:: math.ceil(len(tally.samples) / _TANK_SAMPLES)]
    sample = [tally.samples[number] for number in numbers]
    # Gains are relative to the first sample, lights to the first frame; unknown ones count as 1.
    gains = [np.nan_to_num(measure_gain(frame, sample[0]), nan=1.0) for frame in sample]
    lights = np.nan_to_num(tally.lights, nan=1.0)
    # The gain of a frame with the median light.
    typical = np.median(gains / lights[numbers, None], axis=0) * np.median(lights)
    sample = [undo_gain(frame, gain / typical) for frame, gain in zip(sample, gains, strict=True)]
    return _median_picture(_undo_shake(sample))


def _undo_shake(frames: list[Picture]) -> list[Picture]:
    """Return frames moved back by the camera's shift; one whose shift is unknown does not move."""
    landmarks = find_landmarks(_median_picture(frames))
    shifts = [measure_shift(frame, landmarks) for frame in frames]
    certain = [shift for shift in shifts if shift is not UNKNOWN]
    middle = Shift(*np.median(certain, axis=0)) if certain else STILL
    return [
        frame if shift is UNKNOWN
        else undo_shift(frame, Shift(shift.x - middle.x, shift.y - middle.y, shift.apart))
        for frame, shift in zip(frames, shifts, strict=True)
    ]  # fmt: skip


def _median_picture(frames: Sequence[Picture]) -> Picture:
    """Return the median (h, w[, 3]) of each pixel over pictures of one size.

    Of an even number it is the upper one of the two in the middle. Neighbours that are out of order
    change places until the upper half is sorted: for so few pictures this is ten times as fast as a
    sort of each pixel. A strip of rows at a time stays in the processor's cache.
    """
    middle = np.empty_like(frames[0])
    rank = len(frames) // 2
    for top in range(0, len(middle), _STRIP):
        strips = [frame[top : top + _STRIP].copy() for frame in frames]
        lower = np.empty_like(strips[0])
        for end in range(len(strips) - 1, rank - 1, -1):  # the largest of the rest comes to `end`
            for k in range(end):
                np.minimum(strips[k], strips[k + 1], out=lower)
                np.maximum(strips[k], strips[k + 1], out=strips[k + 1])
                strips[k], lower = lower, strips[k]
        middle[top : top + _STRIP] = strips[rank]
    return middle


def check_film(
    read_frames: Callable[[Sequence[int]], Iterable[Picture]], rate_hz: float, tally: ClipTally,
    key_frame_distance: int = 1, starts: Sequence[int] = (0,),
) -> tuple[Quality, pd.DataFrame, Picture]:  # fmt: skip
    """Return the quality of a film, a table of measures per frame, and the empty tank (h, w[, 3]).

    read_frames(numbers): yields the grey frames (h, w) uint8 of these numbers, which ascend.
    rate_hz: frames per second. tally: brightness and samples of all frames. The table has the
    columns `CHECK`. key_frame_distance: frames from one key frame to the next. starts: where other
    stretches of the film begin, if it is a sample.
    """
    tank = _empty_tank(tally)
    numbers = choose_examined_frames(tally.frames, key_frame_distance)
    examined, moving = _examine_frames(zip(numbers, read_frames(numbers), strict=True), tank)
    table = pd.DataFrame({"light": tally.lights, "change": tally.changes})
    table = table.join(examined).rename_axis("frame").reset_index()
    table = table.reindex(columns=CHECK.names)
    light = measure_light(table["light"].to_numpy(np.float64), rate_hz, starts)
    return _summarize_quality(table, light, len(examined), moving), table, tank


def _examine_frames(
    frames: Iterable[tuple[int, Picture]], tank_picture: Picture
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return two tables: shift, fields and noise by frame, and measures of the moving pixels.

    The first table has a row for each frame; fields and noise are missing where `frames` lacks the
    frame before, against which they are measured. The second table has the columns
    `_MovingPixels`, and a row for each frame whose frame before is there. frames: pairs (number,
    grey picture); tank_picture: the empty tank (h, w[, 3]).
    """
    tank, landmarks, last_shift = to_grey(tank_picture), find_landmarks(tank_picture), STILL
    thinned_tank = tank[::_THIN, ::_THIN]
    floor_grey = float(np.median(thinned_tank))
    rows: list[dict[str, float]] = []
    moving: list[_MovingPixels] = []
    before: Picture | None = None
    gain_before = 1.0
    for number, picture in frames:
        grey = picture.copy()  # the decoder reuses its memory
        gain = float(np.nan_to_num(measure_gain(grey, tank)[0], nan=1.0))
        shift = measure_shift(grey, landmarks, last_shift)
        last_shift = last_shift if shift is UNKNOWN else shift
        row = {"frame": number} | {f"shift_{name}": px for name, px in shift._asdict().items()}
        if before is not None and rows[-1]["frame"] == number - 1:
            row["field_order"] = measure_field_order(before, grey)
            row["noise"] = _measure_noise(before, grey, gain_before / gain)
            steady = grey if shift is UNKNOWN else undo_shift(grey, shift)
            thinned = steady[::_THIN, ::_THIN]
            moving.append(_measure_moving_pixels(thinned, thinned_tank, floor_grey, gain))
        rows.append(row)
        before, gain_before = grey, gain
    examined = pd.DataFrame(rows).set_index("frame")
    return examined, pd.DataFrame(moving, columns=_MovingPixels._fields)


def measure_field_order(before: Picture, after: Picture) -> float:
    """Return a number above 0 if interlaced film's upper field is earlier, below 0 if the lower is.

    It is up to ±0.8, and 0 for whole pictures; NaN if too little moved. before, after: two
    successive grey frames (h, w). In interlaced film two fields, the even and the odd rows, are
    woven into one picture, though they were taken half a frame apart. From a frame's later field to
    the next frame's earlier field it is half a frame, from the earlier to the later it is one and a
    half: the pair that differs less tells the order.
    """
    pair = [picture[:, ::_FIELD_THIN].astype(np.float32) for picture in (before, after)]
    motion = np.abs(pair[1] - pair[0]) >= _MOTION
    rows = (len(motion) - 1) // 2 * 2
    moved = motion[:rows:2] | motion[1:rows:2] | motion[2 : rows + 1 : 2]
    if moved.sum() < _FEW:
        return float("nan")
    # A row of the lower field lies between two of the upper: it is compared with their mean.
    upper = [(picture[:rows:2] + picture[2 : rows + 1 : 2]) / 2 for picture in pair]
    lower = [picture[1:rows:2] for picture in pair]
    # From a field of the first frame to one of the second.
    lower_to_upper = float(((lower[0] - upper[1])[moved] ** 2).mean())
    upper_to_lower = float(((upper[0] - lower[1])[moved] ** 2).mean())
    total = lower_to_upper + upper_to_lower
    return (upper_to_lower - lower_to_upper) / total if total else 0.0


def _measure_noise(before: Picture, after: Picture, gain: float) -> float:
    """Return the noise of two successive grey frames, as a standard deviation in grey levels.

    before, after (h, w): the frames; gain: brightness of the first frame divided by that of the
    second. The median of 6 × 6 tiles counts, so that animals, which move in a few of them, do not.
    """
    equally_bright = after[::_THIN, ::_THIN].astype(np.float32) * gain
    difference = np.abs(equally_bright - before[::_THIN, ::_THIN])
    size = min(_TILES, difference.shape[1]), min(_TILES, difference.shape[0])
    tiles = cv2.resize(difference, size, interpolation=cv2.INTER_AREA)
    # Of normal noise the mean difference of two values is 2/√π of its standard deviation.
    return float(np.median(tiles)) * np.pi**0.5 / 2


class _MovingPixels(NamedTuple):
    """The pixels of a frame that differ from the empty tank, mostly those of animals."""

    number: float
    contrast: float  # their median difference from the tank, grey levels; NaN without any
    black: float  # how many are so dark that nothing was recorded
    white: float  # how many are so bright


def _measure_moving_pixels(
    frame: Picture, tank: Picture, floor_grey: float, gain: float
) -> _MovingPixels:
    """Return measures of the pixels in which a frame differs from the empty tank.

    frame, tank: grey (h, w); floor_grey: median level of the tank; gain: brightness of the frame
    divided by that of the tank.
    """
    evenly_lit = frame / np.float32(gain)
    difference = np.abs(evenly_lit - tank)
    # 1.4826: of normal noise the median absolute difference times this is the standard deviation
    noise_limit = _SIGMAS * 1.4826 * float(np.median(difference))
    # Where the tank's median still holds an animal, it is the floor that differs.
    floor = np.abs(evenly_lit - floor_grey) <= _LEAST
    moving = (difference > max(noise_limit, _LEAST)) & ~floor
    level = frame[moving]
    contrast = float(np.median(difference[moving])) if level.size else float("nan")
    black, white = int((level <= BLACK).sum()), int((level >= WHITE).sum())
    return _MovingPixels(level.size, contrast, black, white)


def measure_shake(shifts: Floats, examined: int) -> tuple[float, float, float]:
    """Return the camera's shake [px]: its root mean square, its largest shift, and its distortion.

    All NaN if most shifts are unknown. shifts (n, 3): as in `Shift`, NaN where unknown; examined:
    how many frames were measured.
    """
    known = shifts[np.isfinite(shifts[:, 0])]
    if 2 * len(known) < examined or not len(known):
        return math.nan, math.nan, math.nan
    distance = np.hypot(*(known[:, :2] - np.median(known[:, :2], axis=0)).T)
    mean_square = float(np.mean(distance**2))
    return mean_square**0.5, float(distance.max()), float(np.nanmedian(known[:, 2]))


def _summarize_quality(
    table: pd.DataFrame, light: LightMeasures, examined: int, moving: pd.DataFrame
) -> Quality:
    """Return the quality of a film, computed from the measures of its frames.

    table: columns `CHECK`; light: flicker and drift; examined: number of frames that were
    examined; moving: columns `_MovingPixels`, a row for each frame in which these were measured.
    """
    shake_px, most_px, apart_px = measure_shake(
        table[["shift_x", "shift_y", "shift_apart"]].to_numpy(np.float64), examined
    )
    repeats = find_repeats(table["change"].to_numpy(np.float64))
    medians = table[["field_order", "noise"]].median()
    pixel_sum = max(1.0, float(moving["number"].sum()))
    return Quality(
        **{f"light_{name}": value for name, value in light._asdict().items()},
        shake_px=shake_px,
        shake_most_px=most_px,
        shake_apart_px=apart_px,
        doubled_pct=100 * repeats.share,
        doubled_rate=repeats.rate,
        field_order=float(medians["field_order"]),
        noise_grey=float(medians["noise"]),
        contrast_grey=float(moving["contrast"].median()),
        animal_black_pct=100 * float(moving["black"].sum()) / pixel_sum,
        animal_white_pct=100 * float(moving["white"].sum()) / pixel_sum,
    )
