"""Check a film: the quality of its light, camera and coding.

The normalised clip, as grey, is examined in runs of successive frames spread over it, so a long
film takes no longer than five hundred frames. Light and doubled pictures are measured in every
frame, while the clip is written (`ClipTally`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture
from finloop.base.schema import Column, Schema, columns
from finloop.clip.doubled import find_repeats, picture_change, subsample_grey
from finloop.clip.light import measure_gain, measure_light, undo_gain
from finloop.clip.shake import STILL, UNKNOWN, Shift, find_landmarks, measure_shift, undo_shift

CHECK_NAME, TANK_NAME = "check.parquet", "tank.png"  # beside the clip
RUNS, LENGTH = 8, 64  # number and length [frames] of the runs that are examined
PLAIN_LEVELS = 8  # least difference between the darkest and brightest pixel of a usable film
SAMPLES = 32  # most frames of a clip that are kept to compare them with the coded ones
_SAMPLES = 15  # frames whose median is the empty tank
_STRIP = 64  # rows
_TILES = 6  # tiles of the picture in both directions; the median tile gives the noise
_THIN = 3  # every 3rd pixel in both directions for noise and contrast
_EVERY = 4  # frames from one measurement of noise, fields and contrast to the next
_SIGMAS, _LEAST = 6.0, 15.0  # noises and grey levels from which a pixel is not tank
_BLACK, _WHITE = 1, 254  # grey levels; beyond them nothing was recorded
_FIELD_THIN = 4  # every 4th column tells the order of fields
_MOTION = 12  # least change [grey levels] from frame to frame of a moved pixel
_FEW = 50  # least number of moved pixels of a frame whose fields are judged

CHECK = Schema(
    Column("frame", "int32", "1"),
    Column("light", "float32", "1"),
    Column("change", "float32", "grey levels", nullable=True),
    *columns("float32", "px", "shift_x", "shift_y", "shift_apart", nullable=True),
    Column("field_order", "float32", "1", nullable=True),
    Column("noise", "float32", "grey levels", nullable=True),
)
"""Measures of every frame; NaN where a frame was not examined or lacks the feature."""


@dataclass(frozen=True)
class Quality:
    """Measures of a film's light, camera, coding and contrast; NaN for what it does not show."""

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

    @classmethod
    def from_metrics(cls, metrics: Mapping[str, float], prefix: str = "") -> "Quality":
        """Return the measures that metrics hold as prefix + name; NaN if one is missing."""
        return cls(*(metrics.get(prefix + entry.name, np.nan) for entry in fields(cls)))


@dataclass
class ClipTally:
    """Counts the frames of a clip, sums up their brightness, and keeps samples of them."""

    frames: int = 0
    brightness_sum: float = 0.0
    darkest: int = 255
    brightest: int = 0
    samples: dict[int, np.ndarray] = field(default_factory=dict)  # some frames, by number
    _stride: int = 1
    # (frames,) brightness relative to the first frame, where both show the tank
    lights: list[float] = field(default_factory=list)
    # (frames,) how much each frame differs from the one before [grey levels]; NaN for the first
    changes: list[float] = field(default_factory=list)
    _first: np.ndarray | None = None
    _last: np.ndarray | None = None

    def add_frame(self, frame: np.ndarray) -> None:
        """Measure the next frame (h, w[, 3]), and copy it if it is one of the spread samples.

        At most `SAMPLES` copies are kept.
        """
        self.brightness_sum += float(np.mean(cv2.mean(frame)[: 3 if frame.ndim == 3 else 1]))
        low, high, *_ = cv2.minMaxLoc(frame.reshape(frame.shape[0], -1))
        self.darkest, self.brightest = min(self.darkest, int(low)), max(self.brightest, int(high))
        here = subsample_grey(frame)
        self._first = here if self._first is None else self._first
        self.lights.append(float(measure_gain(here, self._first)[0]))
        self.changes.append(
            float("nan") if self._last is None else picture_change(self._last, here)
        )
        self._last = here
        if self.frames % self._stride == 0:
            self.samples[self.frames] = frame.copy()
            if len(self.samples) > SAMPLES:
                self._stride *= 2
                kept = [number for number in self.samples if number % self._stride == 0]
                self.samples = {number: self.samples[number] for number in kept}
        self.frames += 1

    @property
    def brightness_mean(self) -> float:
        """Return the mean grey level of all pixels of all frames, 0 … 255."""
        return self.brightness_sum / max(self.frames, 1)

    @property
    def is_plain(self) -> bool:
        """Return whether all pixels of all frames have about the same grey level."""
        return self.brightest - self.darkest < PLAIN_LEVELS


def psnr_db(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """Return the peak signal-to-noise ratio [dB] of pairs of pictures, such as filmed and coded.

    It is 10 log₁₀(255² / mean squared difference) of all pixels; infinite where nothing differs.
    """
    squares = pixels = 0.0
    for a, b in pairs:
        squares += float(np.square(cv2.absdiff(a, b).astype(np.float32)).sum(dtype=np.float64))
        pixels += a.size
    return 10 * np.log10(255**2 * pixels / squares) if squares else float("inf")


def choose_examined_runs(frames: int, key_frame_distance: int = 1) -> list[tuple[int, int]]:
    """Choose runs (start, stop) of successive frames, spread over a film, to be examined.

    A film of at most `RUNS` × `LENGTH` frames is a single run; a longer one has `RUNS` runs of
    `LENGTH` frames, which begin at key frames. frames: length of the film; stop is not included.
    key_frame_distance: frames from one key frame to the next.
    """
    if frames <= RUNS * LENGTH:
        return [(0, frames)]
    starts = (
        np.linspace(0, frames - LENGTH, RUNS).astype(int) // key_frame_distance * key_frame_distance
    )
    return [(int(start), int(start) + LENGTH) for start in starts]


def _empty_tank(frames: Sequence[Picture]) -> Picture:
    """Return the empty tank (h, w[, 3]): the median of frames, after light and shake are undone."""
    few = frames[:: -(-len(frames) // _SAMPLES)]
    gains = [measure_gain(frame, few[0]) for frame in few]
    usual = np.median(gains, axis=0)
    few = [undo_gain(frame, bright / usual) for frame, bright in zip(few, gains, strict=True)]
    landmarks = find_landmarks(_median_picture(few))
    shifts = [measure_shift(frame, landmarks) for frame in few]
    certain = np.array([shift for shift in shifts if shift is not UNKNOWN])
    if len(certain):
        middle = Shift(*np.median(certain, axis=0))
        few = [
            frame
            if shift is UNKNOWN
            else undo_shift(frame, Shift(shift.x - middle.x, shift.y - middle.y, shift.apart))
            for frame, shift in zip(few, shifts, strict=True)
        ]
    return _median_picture(few)


def _median_picture(frames: Sequence[Picture]) -> Picture:
    """Return the median of pictures of one size, a strip at a time to save memory."""
    middle = np.empty_like(frames[0])
    for top in range(0, len(middle), _STRIP):
        strip = np.stack([frame[top : top + _STRIP] for frame in frames])
        strip.partition(len(frames) // 2, axis=0)
        middle[top : top + _STRIP] = strip[len(frames) // 2]
    return middle


def check_film(
    read_frames: Callable[..., Iterator[Picture]],
    rate_hz: float,
    tally: ClipTally,
    key_frame_distance: int = 1,
) -> tuple[Quality, pd.DataFrame, Picture]:
    """Measure a film: return its quality, a table of measures per frame, and the empty tank.

    read_frames(start=, stop=): yields grey frames (h, w) uint8. rate_hz: frames per second. tally:
    the brightness of all frames. The table has the columns `CHECK`; the tank is a picture (h, w[,
    3]). key_frame_distance: frames from one key frame to the next.
    """
    whole = _empty_tank(list(tally.samples.values()))
    tank, landmarks, last = to_grey(whole), find_landmarks(whole), STILL
    rows: list[dict[str, float]] = []
    movers: list[tuple[float, float, float, float]] = []
    for start, stop in choose_examined_runs(tally.frames, key_frame_distance):
        before: Picture | None = None
        light_before = 1.0
        for frame, picture in enumerate(read_frames(start=start, stop=stop), start):
            here = picture.copy()  # the decoder reuses its memory
            bright = float(measure_gain(here, tank)[0])
            shift = measure_shift(here, landmarks, last)
            last = last if shift is UNKNOWN else shift
            row = {f"shift_{name}": value for name, value in shift._asdict().items()}
            if before is not None and frame % _EVERY == 1:
                row["field_order"] = measure_field_order(before, here)
                row["noise"] = _measure_noise(before, here, light_before / bright)
                steady = undo_shift(here, STILL if shift is UNKNOWN else shift, _THIN)
                movers.append(_measure_movers(steady, tank[::_THIN, ::_THIN], bright))
            rows.append({"frame": frame} | row)
            before, light_before = here, bright
    table = pd.DataFrame({"light": tally.lights, "change": tally.changes})
    table = table.join(pd.DataFrame(rows).set_index("frame")).rename_axis("frame").reset_index()
    table = table.reindex(columns=CHECK.names)
    quality = _summarize_quality(table, rate_hz, len(rows), np.array(movers).reshape(-1, 4))
    return quality, table, whole


def to_grey(picture: Picture) -> Picture:
    """Return a grey copy (h, w) uint8 of a picture, which is grey (h, w) or RGB (h, w, 3)."""
    return picture.copy() if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def measure_field_order(before: Picture, after: Picture) -> float:
    """Measure which field of interlaced film is earlier: above 0 the upper one, below 0 the lower.

    before, after: two successive grey frames. In interlaced film two fields, half a frame apart in
    time, are woven into one picture. The later field of a frame and the earlier one of the next are
    one step of time apart, the earlier and the later three. The number is the relative difference
    between two mean squares of what moved: lower field before against upper field after, and the
    reverse. Whole pictures give 0, interlaced ones up to ±0.8; NaN where too little moved.
    """
    last, here = (picture[:, ::_FIELD_THIN].astype(np.float64) for picture in (before, after))
    motion = np.abs(here - last) >= _MOTION
    rows = (len(last) - 1) // 2 * 2
    near = motion[:rows:2] | motion[1:rows:2] | motion[2 : rows + 1 : 2]
    if near.sum() < _FEW:
        return float("nan")
    # A row of the lower field lies between two of the upper: it is compared with their mean.
    upper = [(picture[:rows:2] + picture[2 : rows + 1 : 2]) / 2 for picture in (last, here)]
    lower = [picture[1:rows:2] for picture in (last, here)]
    if_upper = float(((lower[0] - upper[1])[near] ** 2).mean())
    if_lower = float(((upper[0] - lower[1])[near] ** 2).mean())
    whole = if_upper + if_lower
    return (if_lower - if_upper) / whole if whole else 0.0


def _measure_noise(before: Picture, after: Picture, gain: float) -> float:
    """Return the noise of two successive grey frames, as a standard deviation in grey levels.

    gain: brightness of the first frame divided by that of the second.
    """
    few = after[::_THIN, ::_THIN].astype(np.float32) * gain
    off = np.abs(few - before[::_THIN, ::_THIN])
    size = min(_TILES, off.shape[1]), min(_TILES, off.shape[0])
    tiles = cv2.resize(off, size, interpolation=cv2.INTER_AREA)
    # Of normal noise the mean difference of two values is 2/√π of its standard deviation.
    return float(np.median(tiles)) * np.pi**0.5 / 2


def _measure_movers(
    frame: Picture, tank: Picture, gain: float
) -> tuple[float, float, float, float]:
    """Return size, contrast, black and white pixels of what differs from the empty tank in a frame.

    frame, tank: grey (h, w); gain: brightness of the frame divided by that of the tank.
    """
    off = np.abs(frame / gain - tank)
    usual = _SIGMAS * 1.4826 * float(np.median(off))
    # Where the tank's median still holds an animal, it is the floor that differs.
    floor = np.abs(frame / gain - np.median(tank)) <= _LEAST
    away = (off > max(usual, _LEAST)) & ~floor
    level = frame[away]
    contrast = float(np.median(off[away])) if level.size else float("nan")
    return level.size, contrast, (level <= _BLACK).sum(), (level >= _WHITE).sum()


def _summarize_quality(
    table: pd.DataFrame, rate_hz: float, examined: int, movers: Floats
) -> Quality:
    """Return the quality of a film from the measures of its frames.

    table: columns `CHECK`; rate_hz: frames per second; examined: number of frames that were
    examined; movers: (n, 4), from `_measure_movers`.
    """
    lamp = measure_light(table["light"].to_numpy(np.float64), rate_hz)
    place = table[["shift_x", "shift_y"]].to_numpy(np.float64)
    places = place[np.isfinite(place[:, 0])]
    far = np.hypot(*(places - np.median(places, axis=0)).T) if len(places) else places[:, 0]
    known = 2 * len(places) >= examined  # else the floor has too few marks
    twice = find_repeats(table["change"].to_numpy(np.float64))
    pixels, contrast, black, white = movers.T
    medians = table[["shift_apart", "field_order", "noise"]].median()
    many = max(1.0, float(pixels.sum()))
    return Quality(
        **{f"light_{name}": value for name, value in lamp._asdict().items()},
        shake_px=float(np.mean(far**2)) ** 0.5 if known else float("nan"),
        shake_most_px=float(far.max()) if known else float("nan"),
        shake_apart_px=float(medians["shift_apart"]) if known else float("nan"),
        doubled_pct=100 * twice.share,
        doubled_rate=twice.rate,
        field_order=float(medians["field_order"]),
        noise_grey=float(medians["noise"]),
        contrast_grey=float(pd.Series(contrast).median()),
        animal_black_pct=100 * float(black.sum()) / many,
        animal_white_pct=100 * float(white.sum()) / many,
    )
