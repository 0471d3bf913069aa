"""Check a film: the quality of its light, camera and coding.

The normalised clip, as grey, is examined in runs of successive frames spread over it, so a long
film takes no longer than five hundred frames. Light and doubled pictures are measured in every
frame, while the clip is written (`quality.Tally`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture
from finloop.base.schema import Column, Schema, columns
from finloop.clip.doubled import find_repeats
from finloop.clip.fields import field_order
from finloop.clip.light import gain, measure_light, undo_gain
from finloop.clip.shake import STILL, UNKNOWN, Shift, find_landmarks, measure_shift, undo_shift

CHECK_NAME, TANK_NAME = "check.parquet", "tank.png"  # beside the clip
RUNS, LENGTH = 8, 64  # number and length [frames] of the runs that are examined
_SAMPLES = 15  # frames whose median is the still tank
_STRIP = 64  # rows
_TILES = 6  # tiles of the picture in both directions; the median tile gives the noise
_THIN = 3  # every 3rd pixel in both directions for noise and contrast
_EVERY = 4  # frames from one measurement of noise, fields and contrast to the next
_SIGMAS, _LEAST = 6.0, 15.0  # noises and grey levels from which a pixel is not tank
_BLACK, _WHITE = 1, 254  # grey levels; beyond them nothing was recorded

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
    noise_grey: float  # standard deviation of a pixel of the still tank
    contrast_grey: float  # median difference of what moves from the still tank
    animal_black_pct: float  # of the pixels of what moves: nothing was recorded
    animal_white_pct: float

    @classmethod
    def from_metrics(cls, numbers: Mapping[str, float], prefix: str = "") -> "Quality":
        """Return the measures stored in `numbers` under `prefix` + name; NaN if one is missing."""
        return cls(
            **{entry.name: numbers.get(prefix + entry.name, np.nan) for entry in fields(cls)}
        )


class GreyReader(Protocol):
    """Streams the frames start … stop − 1 of a clip, grey."""

    def __call__(self, *, start: int, stop: int) -> Iterator[Picture]:
        """Yield these frames, (h, w) uint8."""


class Clip(NamedTuple):
    """A clip to check.

    read: streams its frames, grey; rate_hz: frames per second; samples: some frames spread over it;
    lights, changes (frames,): each frame's brightness, and its change from the frame before, as
    `finloop.clip.quality.Tally` gathers them.
    """

    read: GreyReader
    rate_hz: float
    samples: Sequence[Picture]
    lights: Sequence[float]
    changes: Sequence[float]

    @property
    def frames(self) -> int:
        """Return the clip's number of frames."""
        return len(self.changes)


def spread_runs(frames: int, stride: int = 1) -> list[tuple[int, int]]:
    """Return the runs (start, stop) of successive frames, spread over a film, that are examined.

    Frame `stop` is not in the run. A film of at most `RUNS` × `LENGTH` frames is a single run; a
    longer one has `RUNS` runs of `LENGTH` frames, which begin at multiples of `stride`.
    """
    if frames <= RUNS * LENGTH:
        return [(0, frames)]
    starts = np.linspace(0, frames - LENGTH, RUNS).astype(int) // stride * stride
    return [(int(start), int(start) + LENGTH) for start in starts]


def still_tank(samples: Sequence[Picture]) -> Picture:
    """Return the picture (h, w[, 3]) of the still tank: the median of frames brought to one light.

    Each of at most `_SAMPLES` frames is first brought to the median light of all, and moved to
    their median place.
    """
    few = samples[:: -(-len(samples) // _SAMPLES)]
    gains = [gain(frame, few[0]) for frame in few]
    usual = np.median(gains, axis=0)
    few = [undo_gain(frame, of / usual) for frame, of in zip(few, gains, strict=True)]
    first = find_landmarks(_median(few))
    shifts = [measure_shift(frame, first) for frame in few]
    certain = np.array([offset for offset in shifts if offset is not UNKNOWN])
    if len(certain):
        middle = Shift(*np.median(certain, axis=0))
        few = [
            frame if by is UNKNOWN else undo_shift(frame, by.beside(middle))
            for frame, by in zip(few, shifts, strict=True)
        ]
    return _median(few)


def _median(frames: Sequence[Picture]) -> Picture:
    middle = np.empty_like(frames[0])
    for top in range(0, len(middle), _STRIP):
        strip = np.stack([frame[top : top + _STRIP] for frame in frames])
        strip.partition(len(frames) // 2, axis=0)
        middle[top : top + _STRIP] = strip[len(frames) // 2]
    return middle


def check(clip: Clip, stride: int = 1) -> tuple[Quality, pd.DataFrame, Picture]:
    """Measure a clip: return its quality, the measures of each frame, and the still tank's picture.

    The table has a row per frame and the columns `CHECK`; the picture is (h, w[, 3]). stride:
    frames from one key frame of the clip to the next.
    """
    whole = still_tank(clip.samples)
    tank, of, last = grey(whole), find_landmarks(whole), STILL
    rows: list[dict[str, float]] = []
    movers: list[tuple[float, float, float, float]] = []
    for start, stop in spread_runs(clip.frames, stride):
        before: Picture | None = None
        light_before = 1.0
        for frame, picture in enumerate(clip.read(start=start, stop=stop), start):
            here = picture.copy()  # the decoder reuses its memory
            bright = float(gain(here, tank)[0])
            place = measure_shift(here, of, last)
            last = last if place is UNKNOWN else place
            row = {f"shift_{name}": value for name, value in place._asdict().items()}
            if before is not None and frame % _EVERY == 1:
                row |= _against(before, here, light_before / bright)
                steady = undo_shift(here, STILL if place is UNKNOWN else place, _THIN)
                movers.append(_movers(steady, tank[::_THIN, ::_THIN], bright))
            rows.append({"frame": frame} | row)
            before, light_before = here, bright
    table = pd.DataFrame({"light": clip.lights, "change": clip.changes})
    table = table.join(pd.DataFrame(rows).set_index("frame")).rename_axis("frame").reset_index()
    table = table.reindex(columns=CHECK.names)
    return _quality(table, clip, len(rows), np.array(movers).reshape(-1, 4)), table, whole


def grey(picture: Picture) -> Picture:
    """Return a grey copy (h, w) uint8 of a picture, which is grey (h, w) or RGB (h, w, 3)."""
    return picture.copy() if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def _against(before: Picture, here: Picture, brighter: float) -> dict[str, float]:
    """Measure two grey frames; `brighter`: the light of the first over the second's."""
    few = here[::_THIN, ::_THIN].astype(np.float32) * brighter
    off = np.abs(few - before[::_THIN, ::_THIN])
    size = min(_TILES, off.shape[1]), min(_TILES, off.shape[0])
    tiles = cv2.resize(off, size, interpolation=cv2.INTER_AREA)
    return {
        "field_order": field_order(before, here),
        # Of normal noise the mean difference of two values is 2/√π of its standard deviation.
        "noise": float(np.median(tiles)) * np.pi**0.5 / 2,
    }


def _movers(here: Picture, tank: Picture, bright: float) -> tuple[float, float, float, float]:
    """Measure the moving pixels of a grey frame: count, median contrast, black ones, white ones.

    here, tank: every `_THIN`-th pixel in both directions.
    """
    off = np.abs(here / bright - tank)
    usual = _SIGMAS * 1.4826 * float(np.median(off))
    # Where the tank's median still holds an animal, it is the floor that differs.
    floor = np.abs(here / bright - np.median(tank)) <= _LEAST
    away = (off > max(usual, _LEAST)) & ~floor
    level = here[away]
    contrast = float(np.median(off[away])) if level.size else float("nan")
    return level.size, contrast, (level <= _BLACK).sum(), (level >= _WHITE).sum()


def _quality(table: pd.DataFrame, clip: Clip, looked: int, movers: Floats) -> Quality:
    """Summarise the measures of all frames; `looked`: the number of examined frames."""
    lamp = measure_light(np.array(clip.lights), clip.rate_hz)
    place = table[["shift_x", "shift_y"]].to_numpy(np.float64)
    places = place[np.isfinite(place[:, 0])]
    far = np.hypot(*(places - np.median(places, axis=0)).T) if len(places) else places[:, 0]
    still = 2 * len(places) >= looked  # else the floor has too few marks
    twice = find_repeats(np.array(clip.changes))
    pixels, contrast, black, white = movers.T
    many = max(1.0, float(pixels.sum()))
    return Quality(
        **{f"light_{name}": value for name, value in lamp._asdict().items()},
        shake_px=float(np.mean(far**2)) ** 0.5 if still else float("nan"),
        shake_most_px=float(far.max()) if still else float("nan"),
        shake_apart_px=_median_of(table["shift_apart"]) if still else float("nan"),
        doubled_pct=100 * twice.share,
        doubled_rate=twice.rate,
        field_order=_median_of(table["field_order"]),
        noise_grey=_median_of(table["noise"]),
        contrast_grey=_median_of(pd.Series(contrast)),
        animal_black_pct=100 * float(black.sum()) / many,
        animal_white_pct=100 * float(white.sum()) / many,
    )


def _median_of(values: pd.Series) -> float:
    """Return the median, ignoring NaN; NaN of nothing."""
    return float(values.median())
