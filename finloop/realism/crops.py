"""Crops: small pictures of one fish in film and animation alike, and what is measured in them.

A crop is a square of SIZE px around the fish's mass centre, headed right. Its pixels are the film's
own where the fish is up to FISH_PX long: a larger picture would add nothing, a smaller one would
smooth the grain and the fringe that may give the drawing away. A longer fish is reduced to that.

The still tank at the same place is subtracted, so that a crop does not show where the fish is: the
rest is the fish, and the light and the grain of a tank that lives. All is grey, as `extract` sees
it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask, Picture

SIZE = 96
"""Width of a crop, px."""
FISH_PX = 67.0
"""Body length in a crop, at most, px: 70 % of it. The rest shows the tank beside the fish."""

PICTURE_CHANNELS = (
    "contrast", "area", "sharpness", "edge", "fringe", "fine_grain", "middle_grain",
    "coarse_grain", "light", "picture_step",
)  # fmt: skip
"""contrast: of the fish with the tank, of the tank's light; area: body lengths²; sharpness: RMS
Laplacian in the fish; edge: mean gradient at its outline, fringe: mean difference from the tank 1
to 3 px beyond it, all three of the contrast; grain: SD of the tank beside the fish, in bands of 1,
2 and 4 px, of its light; light: of the tank, of the still tank's; picture_step: mean absolute
change from the crop before, of the tank's light."""

_BANDS_PX = 1.0, 2.0, 4.0  # SD of the Gaussians between which the bands of grain lie
_BESIDE_PX = 6  # from the fish to where the tank counts as empty
_CROWD = 0.25  # of a typical fish: a detached piece as large as this is another animal
_KERNEL = np.ones((3, 3), np.uint8)
Image = NDArray[np.float32]


class CropSeries(NamedTuple):
    """What is measured in the pictures of n ticks: numbers for each tick, and some of the crops.

    channels (n, 10): PICTURE_CHANNELS, NaN where a crop shows nothing to measure. crop_rows (m,):
    the ticks whose crops are kept; crops (m, 2, SIZE, SIZE) float16: those, and their changes from
    the tick before, as shares of the tank's light.
    """

    channels: Floats
    crop_rows: Ints
    crops: NDArray[np.float16]


def grey(frame: Picture) -> Picture:
    """Return a frame (h, w) or (h, w, 3) as grey levels (h, w)."""
    return frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)


def cut_square(
    picture: NDArray[Any], centre: tuple[float, float], heading_deg: float, scale: float,
    size_px: int,
) -> NDArray[Any]:  # fmt: skip
    """Return a square of a picture (h, w[, 3]), turned so that a heading points right, and scaled.

    centre: x, y px of the picture, the middle of the square; heading_deg: anticlockwise; size_px:
    side of the square. Beyond the picture its edge goes on.
    """
    transform = cv2.getRotationMatrix2D(centre, -heading_deg, scale)
    transform[:, 2] += (size_px - 1) / 2 - np.array(centre)
    return cv2.warpAffine(
        picture, transform, (size_px, size_px), flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip


@dataclass(frozen=True)
class CropCamera:
    """Cuts crops from frames of a film or an animation with the same still tank.

    tank (h, w) uint8: grey. threshold_grey: least difference of a fish from the tank. length_px,
    area_px: of a typical fish, in the frames.
    """

    tank: Picture
    threshold_grey: float
    length_px: float
    area_px: float

    @property
    def scale(self) -> float:
        """Return the size of a crop's picture relative to the frame: 1, or less."""
        return min(1.0, FISH_PX / self.length_px)

    def cut(self, frame: Picture, x_px: float, y_px: float, heading_deg: float) -> Image:
        """Return the crop (SIZE, SIZE) of a frame (h, w) or (h, w, 3) around a place, in grey.

        heading_deg, anticlockwise, points right in it. Beyond the frame its edge goes on.
        """
        half = int(SIZE / self.scale * 0.7072) + 6
        left, top = int(x_px) - half, int(y_px) - half
        height, width = frame.shape[:2]
        rows = slice(min(max(top, 0), height - 1), max(top + 2 * half, 1))
        columns = slice(min(max(left, 0), width - 1), max(left + 2 * half, 1))
        box = grey(np.ascontiguousarray(frame[rows, columns])).astype(np.float32)
        if self.scale < 1:  # what the smaller picture cannot show shall not alias
            box = cv2.GaussianBlur(box, (0, 0), 0.5 * np.sqrt(self.scale**-2 - 1))
        centre = x_px - columns.start, y_px - rows.start
        return np.asarray(cut_square(box, centre, heading_deg, self.scale, SIZE), np.float32)


def cut_crops(
    camera: CropCamera, frames: Iterable[Picture], table: pd.DataFrame
) -> NDArray[np.uint8]:
    """Return the crops (n, SIZE, SIZE) of n frames as they are seen, with their tank.

    table: columns x_px, y_px, heading_deg, a row per frame.
    """
    places = table[["x_px", "y_px", "heading_deg"]].to_numpy(float)
    crops = [camera.cut(frame, *place) for frame, place in zip(frames, places, strict=True)]
    return np.clip(np.rint(crops), 0, 255).astype(np.uint8)


def no_crops() -> NDArray[np.float16]:
    """Return an array of no crops and no changes, (0, 2, SIZE, SIZE)."""
    return np.zeros((0, 2, SIZE, SIZE), np.float16)


class CropMeter:
    """Measures the crops of one fish, tick by tick."""

    def __init__(self, camera: CropCamera) -> None:
        """Begin before the first tick."""
        self._camera = camera
        self._before: Image | None = None  # the crop of the tick before

    def measure(
        self, frame: Picture, x_px: float, y_px: float, heading_deg: float, alone: bool = False
    ) -> tuple[Floats, Image, Image | None]:
        """Return a tick's measures (10,), its crop, and the crop's change from the last tick.

        Call it in the order of ticks: at the first one there is no change. The measures are those
        of PICTURE_CHANNELS. All but the last are NaN if no fish can be measured; the last one is
        the change's, NaN without a change. Crops (SIZE, SIZE) lack the still tank and are shares of
        the tank's light. alone: whether a crop that seems to show another animal counts as one
        without a fish; that is one with a detached piece of a quarter of the typical size.
        """
        camera, place = self._camera, (x_px, y_px, heading_deg)
        crop, still = camera.cut(frame, *place), camera.cut(camera.tank, *place)
        light = max(float(np.median(still[::2, ::2])), 1.0)
        seen = (crop - still) / light
        change = None if self._before is None else seen - self._before
        self._before = seen
        channels = np.full(len(PICTURE_CHANNELS), np.nan)
        measured = _measure_fish(crop, still, camera, alone)
        if measured is not None:
            channels[:-1] = measured
        if change is not None:
            channels[-1] = np.abs(change).mean()
        return channels, seen, change


def _measure_fish(crop: Image, still: Image, camera: CropCamera, alone: bool) -> Floats | None:
    """Return all PICTURE_CHANNELS but the last (9,) of a crop, or None if it shows no fish.

    still: the still tank there. alone: also None if it shows another animal.
    """
    gain = float(np.median((crop / np.maximum(still, 1.0))[::2, ::2]))
    tank = np.maximum(gain * still, 1.0)
    lit = crop - gain * still  # the fish, and the grain
    above = (np.abs(lit) > camera.threshold_grey).astype(np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(above, connectivity=8)
    if count < 2:
        return None
    areas = facts[1:, cv2.CC_STAT_AREA]
    number = int(areas.argmax()) + 1
    if alone and count > 2 and np.sort(areas)[-2] > _CROWD * camera.area_px * camera.scale**2:
        return None
    fish = (labels == number).astype(np.uint8)
    inner, outer = cv2.erode(fish, _KERNEL), cv2.dilate(fish, _KERNEL)
    rim = cv2.dilate(fish, _KERNEL, iterations=3) > outer
    beside = (cv2.dilate(fish, np.ones((2 * _BESIDE_PX + 1,) * 2, np.uint8)) == 0) & (above == 0)
    if not inner.any() or beside.sum() < SIZE:
        return None
    is_fish, is_inner, outline = fish > 0, inner > 0, outer > inner
    contrast = float(lit[is_inner].mean())
    if abs(contrast) < 1.0:
        return None
    across, down = (cv2.Sobel(lit, -1, *order, scale=0.125) for order in ((1, 0), (0, 1)))
    gradient = np.hypot(across, down)
    bands = _grain(lit, beside)
    light = float(tank[beside].mean())
    return np.array([
        contrast / float(tank[is_inner].mean()),
        is_fish.sum() / (camera.length_px * camera.scale) ** 2,
        np.sqrt(np.square(cv2.Laplacian(lit, -1))[is_inner].mean()) / abs(contrast),
        gradient[outline].mean() / abs(contrast),
        lit[rim].mean() / contrast,
        *(band / light for band in bands),
        gain,
    ])  # fmt: skip


def _grain(lit: Image, beside: Mask) -> list[float]:
    """Return the SD of a crop (h, w) in the tank beside the fish, in three bands from fine on."""
    weight = beside.astype(np.float32)
    blurred, sds = lit * weight, list[float]()
    last = lit
    for sigma in _BANDS_PX:
        share = cv2.GaussianBlur(weight, (0, 0), sigma)
        smooth = cv2.GaussianBlur(blurred, (0, 0), sigma) / np.maximum(share, 1e-3)
        sds.append(float((last - smooth)[beside].std()))
        last = smooth
    return sds


class CropCollector:
    """Collects the channels of ticks and the crops of every few ticks."""

    def __init__(self, ticks: int) -> None:
        """Begin without any; ticks: their number n."""
        self._channels = np.full((ticks, len(PICTURE_CHANNELS)), np.nan)
        self._rows, self._crops = list[int](), list[NDArray[np.float16]]()

    def add(self, row: int, measured: tuple[Floats, Image, Image | None], keep: bool) -> None:
        """Add what `CropMeter.measure` returned for a tick; keep: whether its crop is kept.

        A crop without a change from the tick before, or of a tick that cannot be measured, is not.
        """
        channels, crop, change = measured
        self._channels[row] = channels
        if keep and change is not None and np.isfinite(channels).all():
            self._rows.append(row)
            self._crops.append(np.stack([crop, change]).astype(np.float16))

    def pictures(self) -> CropSeries:
        """Return all that was added, in the order of the rows."""
        order = np.argsort(self._rows, kind="stable") if self._rows else np.zeros(0, np.intp)
        rows = np.array(self._rows, np.int64)
        crops = np.stack(self._crops) if self._crops else no_crops()
        return CropSeries(self._channels, rows[order], crops[order])


def join_crop_series(parts: Sequence[CropSeries]) -> CropSeries:
    """Join the picture measurements of several animations to one, in their order.

    `crop_rows` are renumbered to the joined ticks.
    """
    before = np.cumsum([0, *(len(part.channels) for part in parts)])
    rows = [part.crop_rows + start for part, start in zip(parts, before[:-1], strict=True)]
    return CropSeries(
        np.concatenate([part.channels for part in parts]), np.concatenate(rows),
        np.concatenate([part.crops for part in parts]),
    )  # fmt: skip


def rows_with_company(rows: Ints, features: pd.DataFrame, camera: CropCamera) -> Mask:
    """Return a mask (n,) of film rows whose crops show a part of another tracked fish, too.

    features: columns of `FEATURES`, of the whole film.
    """
    points = features[
        ["head_x_px", "head_y_px", "x_px", "y_px", "tail_x_px", "tail_y_px"]
    ].to_numpy(float).reshape(-1, 3, 2)  # fmt: skip
    frame, heading = features["frame"].to_numpy(), np.radians(features["heading_deg"].to_numpy())
    by_frame = pd.Series(np.arange(len(frame))).groupby(frame).indices
    half_px = SIZE / 2 / camera.scale
    result = np.zeros(len(rows), bool)
    for number, row in enumerate(rows):
        others = by_frame[frame[row]]
        off = points[others[others != row]].reshape(-1, 2) - points[row, 1]
        cos, sin = np.cos(heading[row]), np.sin(heading[row])
        ahead, right = off[:, 0] * cos - off[:, 1] * sin, off[:, 0] * sin + off[:, 1] * cos
        result[number] = ((np.abs(ahead) < half_px) & (np.abs(right) < half_px)).any()
    return result
