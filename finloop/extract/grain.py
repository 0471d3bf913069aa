"""Pictures of the empty tank in succession, from which an animation's tank gets its grain.

They are a video texture of the tank (fish paper §4.1 applied to what is not a fish): successive
frames in even light, in which animals are replaced by the tank as it is seen there at other times.
Grain is what changes from frame to frame: noise of the camera, blocks of the codec, slow drift.
"""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture
from finloop.base.light import BLACK, WHITE, undo_gain
from finloop.extract.background import relative_brightness

Pictures = NDArray[np.uint8]
_MOST, _BYTES = 128, 2**26  # pictures, and bytes of all of them
_FEWEST, _MOST_BYTES = 8, 2**28  # of large frames: with fewer pictures, the eye sees them again
_LEAST_GREY = 0.4  # SD over time; less is the rounding of grey levels
_MOST_HIDDEN = 0.5  # share of the tank that no picture shows; of more, the rest says too little
_RIM_BL = 0.15  # around an animal, for what is paler than the threshold: its shadow, its waves
_SPECK_PX2 = 20  # smaller patches are grain, not animals
_SLOW_PX = 8  # a cell of the slow part; finer is grain, with the blocks of a codec
_SLOW_SDS = 2.0  # standard deviations of the slow part up to which it is drift of the light


class TankPictures(NamedTuple):
    """The empty tank in successive pictures, (k, h, w[, 3]) uint8; k = 0 if there are none.

    grain_grey: SD over time of a pixel of the tank, the root mean square of all, in grey levels;
    covered (h, w): where an animal passed, and was replaced; lack: why there are no pictures, "" if
    there are.
    """

    pictures: Pictures
    grain_grey: float
    covered: NDArray[np.bool_]
    lack: str = ""


def choose_spans(
    segments: Sequence[tuple[int, int]], frame_shape: tuple[int, ...]
) -> list[tuple[int, int]]:
    """Return the spans (start, stop) of a film to make pictures of its empty tank from, best first.

    segments: the film's frame ranges without a cut; frame_shape: (h, w[, 3]). [] if the film is too
    short, or its frames are too large.
    """
    frame_bytes = int(np.prod(frame_shape))
    wanted = min(_MOST, max(_FEWEST, _BYTES // frame_bytes))
    if wanted * frame_bytes > _MOST_BYTES:
        return []
    spans = []
    for start, stop in sorted(segments, key=lambda ends: ends[0] - ends[1]):
        count = min(wanted, stop - start)
        if count >= _FEWEST:
            firsts = np.linspace(start, stop - count, 5)[[2, 1, 3]].astype(int).tolist()
            spans += [(first, first + count) for first in dict.fromkeys(firsts)]
    return spans[:3]


def empty_tank_pictures(
    frames: Iterable[Picture], background: Picture, threshold: float, length_px: float
) -> TankPictures:
    """Return successive frames in even light, without their animals.

    background: the empty tank, (h, w[, 3]) as the frames; threshold: least difference of an animal
    from it, grey levels; length_px: body length of an animal.
    """
    rim = max(2, round(_RIM_BL * length_px))
    even_frames, covers = [], []
    for frame in frames:
        shown = _find_animals(_even_light(frame, background, None), background, threshold, rim)
        shown |= _is_white(frame) & ~_is_white(background)
        even_frames.append(_even_light(frame, background, shown))
        covers.append(shown)
    if len(even_frames) < _FEWEST:
        return _no_pictures(background, f"there are only {len(even_frames)} frames of it")
    pictures, covered = np.stack(even_frames), np.stack(covers)
    hidden = np.asarray(covered.all(axis=0))
    if hidden.mean() > _MOST_HIDDEN:
        return _no_pictures(background, f"{hidden.mean():.0%} of it are hidden, or too bright")
    _fill_from_other_times(pictures, covered)
    _fill_hidden_places(pictures, hidden, background)
    _limit_slow_part(pictures, background)
    sample = pictures[:, ::4, ::4][:, ~hidden[::4, ::4]].astype(np.float32)
    grain_grey = float(np.sqrt(sample.var(axis=0).mean())) if sample.size else 0.0
    if grain_grey < _LEAST_GREY:
        return _no_pictures(background, f"it has no grain ({grain_grey:.2f} grey levels)")
    return TankPictures(pictures, grain_grey, np.asarray(covered.any(axis=0)))


def _no_pictures(background: Picture, lack: str) -> TankPictures:
    """Return the result for a film that shows no grain; lack: why."""
    shape = background.shape
    return TankPictures(np.empty((0, *shape), np.uint8), 0.0, np.zeros(shape[:2], bool), lack)


def _even_light(frame: Picture, background: Picture, covered: NDArray[np.bool_] | None) -> Picture:
    """Return a frame made as bright as the background; covered (h, w): pixels that do not count.

    Without `covered`, one gain by the median of pixels; with it a gain per channel, by sums over
    the others that are neither black nor white, if these are over 5 %.
    """
    gains = np.array([relative_brightness(frame, background)])
    if covered is not None:
        levels, tank = (_as_channels(picture[::2, ::2]) for picture in (frame, background))
        lit = ((tank > BLACK) & (tank < WHITE) & (levels < WHITE)).all(axis=2) & ~covered[::2, ::2]
        if lit.mean() > 0.05:
            gains = levels[lit].sum(axis=0, dtype=float) / tank[lit].sum(axis=0, dtype=float)
    return undo_gain(frame, gains)


def _is_white(picture: Picture) -> NDArray[np.bool_]:
    """Return where a picture saturates, (h, w): there the tank is not seen."""
    return np.asarray((_as_channels(picture) >= WHITE).any(axis=2))


def _as_channels(picture: Picture) -> Picture:
    """Return a picture as (h, w, channels)."""
    return picture if picture.ndim == 3 else picture[..., None]


def _find_animals(
    frame: Picture, background: Picture, threshold: float, rim: int
) -> NDArray[np.bool_]:
    """Return a mask (h, w) of all that is not the empty tank, with a rim [px] around it.

    It is what differs by more than half the threshold and holds a pixel beyond the threshold.
    """
    change = cv2.absdiff(frame, background)
    grey = change if change.ndim == 2 else change.max(axis=2)
    size = max(1, grey.shape[1] // 2), max(1, grey.shape[0] // 2)  # half as large: faster
    smooth = cv2.GaussianBlur(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    pale = (smooth > threshold / 2).astype(np.uint8)
    count, patch, stats, _ = cv2.connectedComponentsWithStats(pale)
    is_animal = np.zeros(count, np.uint8)
    is_animal[patch[smooth > threshold]] = 1
    is_animal[4 * stats[:, cv2.CC_STAT_AREA] < _SPECK_PX2] = 0
    reach = (rim + 1) // 2
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    mask = cv2.dilate(is_animal[patch], kernel)
    whole = cv2.resize(mask, grey.shape[::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(whole > 0)


def _fill_from_other_times(pictures: Pictures, covered: NDArray[np.bool_]) -> None:
    """Replace covered pixels, in place, by those of the nearest moments at which they are not.

    pictures (k, h, w[, 3]); covered (k, h, w). A covered stretch mirrors the time before it and the
    time after it, so that its grain moves; the moment at its end is taken where the mirrored one is
    covered, too. Pixels that are always covered stay as they are.
    """
    count = len(pictures)
    hidden = covered.all(axis=0)
    places = np.flatnonzero(covered.any(axis=0) & ~hidden)
    seen = ~covered.reshape(count, -1)[:, places]
    time = np.arange(count, dtype=np.int16)[:, None]
    before = np.maximum.accumulate(np.where(seen, time, np.int16(-count)))
    after = np.minimum.accumulate(np.where(seen, time, np.int16(2 * count))[::-1])[::-1]
    end = np.where(time - before <= after - time, before, after)
    mirrored = 2 * end - time
    inside = (mirrored >= 0) & (mirrored < count)
    is_seen = np.take_along_axis(seen, mirrored.clip(0, count - 1), axis=0)
    source = np.where(inside & is_seen, mirrored, end)
    flat = pictures.reshape(count, hidden.size, -1)
    flat[:, places] = flat[source, places]


def _fill_hidden_places(pictures: Pictures, hidden: NDArray[np.bool_], background: Picture) -> None:
    """Replace pixels that are always covered, in place: by the background with other grain.

    hidden (h, w): these pixels. The grain is that of the place mirrored left and right, or else up
    and down, or both; where all are hidden, the tank stands still.
    """
    for picture in pictures:
        picture[hidden] = background[hidden]
    if not hidden.any():
        return
    lacking, mean = hidden.copy(), pictures.mean(axis=0, dtype=np.float32)
    for axes in (1, 0, (0, 1)):
        usable = lacking & ~np.flip(hidden, axes)
        for picture in pictures:
            grain = np.flip(picture.astype(np.float32) - mean, axes)[usable]
            picture[usable] = np.clip(np.rint(background[usable] + grain), 0, 255)
        lacking &= ~usable


def _limit_slow_part(pictures: Pictures, background: Picture) -> None:
    """Take faint shadows and waves of animals out of pictures (k, h, w[, 3]), in place.

    They are where the slow part in space, the mean of cells around a place, differs from the
    background by far more than elsewhere. It is limited to two standard deviations, by the median
    absolute value.
    """
    height, width = background.shape[:2]
    size = max(1, width // _SLOW_PX), max(1, height // _SLOW_PX)
    reduced = partial(cv2.resize, dsize=size, interpolation=cv2.INTER_AREA)
    cells = [reduced(np.float32(picture)) - reduced(np.float32(background)) for picture in pictures]
    slow = np.stack([cv2.GaussianBlur(part, (0, 0), 1.0) for part in cells])
    limit = _SLOW_SDS * 1.4826 * float(np.median(np.abs(slow)))
    for picture, excess in zip(pictures, slow - slow.clip(-limit, limit), strict=True):
        smooth = cv2.resize(excess, (width, height), interpolation=cv2.INTER_LINEAR)
        picture[:] = np.clip(np.rint(picture - smooth), 0, 255)
