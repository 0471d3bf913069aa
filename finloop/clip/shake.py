"""Measure and undo the shake of the camera: each frame's shift against the empty tank, in pixels.

A shift is (right, down): the tank at p appears in the frame at p + shift. It is the shift that
makes the frame most like the tank at many marks, places where the tank has edges: least squares
with weights that leave out animals (Gauss-Newton; Lucas and Kanade 1981, with Tukey's weights).
"""

import math
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Ints, Picture
from finloop.base.kernel import finite_kernel, kernel

_ENOUGH = 500  # px; least side of the reduced picture in which marks are compared
_TILES = 6  # tiles of the picture in both directions; marks are spread over them
_POINTS = 60  # most marks in a tile
_MARGIN = 12  # px along the border without marks
_STEEP = 0.75  # least slope of a mark [grey levels a px]
_LESS = 4  # reduction of the picture for the search of a large shift
_NEAR = 1.5  # grey levels at the marks; a better fit needs no phase correlation
_FEWEST_MARKS = 12  # that show a shift
_ROUNDS = 12  # most rounds of Gauss-Newton
_STILL = 2e-3  # px; a smaller step is the last
_TUKEY = 4.685  # sigmas beyond which a mark has no weight
_SURE = 0.1  # px; a shift that is less certain is unknown
_REACH = 4  # px; of Lanczos' kernel
_BEST = 0.33  # share of the tiles, those with most edges, that must not decide alone


class Landmarks(NamedTuple):
    """Pixels at steep edges of the empty tank, by which the shift of a frame is measured.

    Pixels are those of the reduced picture, each of `reduction` × `reduction` pixels of the film.
    """

    x: Ints  # (marks,) px, as all but the last two
    y: Ints
    level: Floats  # grey level
    slope_right: Floats  # change of the level to the right, grey levels per px
    slope_down: Floats
    tile: Ints  # number of the mark's tile
    # Weight, such that no tile counts for more than the median one: the edges of an animal that
    # stays are the strongest, but in few tiles.
    trust: Floats
    small: np.ndarray  # the picture, another `_LESS` times smaller, float32
    reduction: int


class Shift(NamedTuple):
    """The camera's shift in one frame: the tank appears x px farther right and y px lower."""

    x: float
    y: float
    apart: float  # by how much parts of the picture moved differently (a turn, a zoom)


class _Fit(NamedTuple):
    """How well a frame, shifted back by a guess, fits the grey levels of the empty tank."""

    # (4,) gain × (guess − shift) to the right and down, the gain of the light, and an added level
    coefficients: Floats
    residual: Floats  # (marks,) grey levels left over
    weight: Floats  # (marks,) less where the residual is large, 0 on animals
    sigma: float  # usual residual, grey levels


STILL = Shift(0.0, 0.0, 0.0)
UNKNOWN = Shift(float("nan"), float("nan"), float("nan"))


def to_grey(picture: Picture) -> Picture:
    """Return the grey levels (h, w) uint8 of a picture, which is grey (h, w) or RGB (h, w, 3)."""
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def _smooth_grey(picture: Picture) -> tuple[Picture, int]:
    """Return a picture (h, w[, 3]) as grey, reduced and smoothed, and the factor of reduction.

    The factor is the largest whole number that leaves both sides `_ENOUGH` px.
    """
    height, width = picture.shape[:2]
    reduction = max(1, min(height, width) // _ENOUGH)
    grey = to_grey(picture)[: height // reduction * reduction, : width // reduction * reduction]
    size = width // reduction, height // reduction
    reduced = grey if reduction == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(reduced, (7, 7), 1.2)), reduction


def _shrink_picture(picture: Picture) -> np.ndarray:
    """Return a grey picture (h, w), `_LESS` times smaller, as float32."""
    size = tuple(max(1, side // _LESS) for side in picture.shape[::-1])
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def find_landmarks(tank: Picture) -> Landmarks:
    """Return the steepest edges of the empty tank (h, w[, 3]), at most 60 in each of 36 tiles."""
    grey, reduction = _smooth_grey(tank)
    level = grey.astype(np.float64)
    down, right = (np.asarray(parts) for parts in np.gradient(level))
    steepness: Floats = np.asarray(np.hypot(right, down))
    rim = min(_MARGIN, *(side // 4 for side in grey.shape))
    rows, columns = (np.linspace(rim, side - rim, _TILES + 1).astype(int) for side in grey.shape)
    x, y, tile = [], [], []
    for number in range(_TILES**2):
        row, column = divmod(number, _TILES)
        top, left = rows[row], columns[column]
        patch = steepness[top : rows[row + 1], left : columns[column + 1]]
        if not patch.size:
            continue
        best = np.argsort(patch, axis=None, kind="stable")[-_POINTS:]
        place = np.stack(np.unravel_index(best[patch.ravel()[best] >= _STEEP], patch.shape))
        y.append(place[0] + top)
        x.append(place[1] + left)
        tile.append(np.full(place.shape[1], number))
    xs, ys, tiles = (np.concatenate([np.empty(0, int), *parts]) for parts in (x, y, tile))
    trust = _trust_marks(tiles, steepness[ys, xs])
    return Landmarks(
        xs, ys, level[ys, xs], right[ys, xs], down[ys, xs], tiles, trust, _shrink_picture(grey),
        reduction,
    )  # fmt: skip


def _trust_marks(tile: Ints, steepness: Floats) -> Floats:
    """Return weights (marks,) of landmarks: below 1 in a tile with unusually many edges.

    An animal may stay there. tile, steepness (marks,): each mark's tile and slope.
    """
    edges = np.bincount(tile, steepness**2, _TILES**2)
    median_edges = float(np.median(edges[edges > 0])) if len(tile) else 1.0
    return np.minimum(1.0, median_edges / edges[tile])


def measure_shift(frame: Picture, tank: Landmarks, last: Shift = STILL) -> Shift:
    """Return the shift [px] of a frame against the empty tank; `UNKNOWN` if too little shows it.

    tank: its landmarks; last: shift of the frame before, where the search begins.
    """
    if len(tank.x) < _FEWEST_MARKS:
        return UNKNOWN
    smooth, _ = _smooth_grey(frame)
    place = _choose_start(smooth, tank, last)
    # To first order a frame's levels at the marks, moved by `place`, are gain · level + added +
    # gain · slope · (place − shift). Each round fits this, and moves `place` nearer to the shift.
    ones = np.ones(len(tank.level))
    design = np.stack([tank.slope_right, tank.slope_down, tank.level, ones], axis=1)
    weight = tank.trust
    for _ in range(_ROUNDS):
        fit = _fit_robustly(design, _sample_marks(smooth, tank, place), tank.trust, weight)
        gain, weight = max(0.2, fit.coefficients[2]), fit.weight
        # Far from the shift the slopes mislead, so a step is at most 1.5 px.
        move = np.clip(-fit.coefficients[:2] / gain, -1.5, 1.5)
        place = place + move
        if np.hypot(*move) < _STILL:
            break
    return _judge_shift(place, fit, tank)


def _fit_robustly(design: Floats, level: Floats, trust: Floats, weight: Floats) -> _Fit:
    """Return a fit of grey levels (marks,) by the columns of design (marks, 4), without outliers.

    level (marks,): of each landmark. A mark's weight is its trust (marks,) times Tukey's biweight
    of its residual, which leaves out animals. weight (marks,): the weights to begin with.
    """
    for _ in range(2):  # the weights depend on the fit
        gram = (design * weight[:, None]).T @ design + 1e-9 * np.eye(4)
        coefficients = np.asarray(np.linalg.solve(gram, design.T @ (weight * level)), float)
        residual = level - design @ coefficients
        sigma = max(0.3, 1.4826 * float(np.median(np.abs(residual))))
        weight = trust * np.maximum(0.0, 1 - (residual / (_TUKEY * sigma)) ** 2) ** 2
    return _Fit(coefficients, residual, weight, sigma)


def _choose_start(picture: Picture, tank: Landmarks, last: Shift) -> Floats:
    """Return the best of three guesses of a frame's shift (2,) [px], where the search begins.

    The guesses are no shift, the shift of the frame before, and a phase correlation. picture: the
    frame, grey and smoothed.
    """

    def misfit(place: Floats) -> float:
        """Return how much the frame, shifted back by (2,) px, differs from the tank, in grey."""
        value = _sample_marks(picture, tank, place)
        light = float(np.median(value)) / max(1.0, float(np.median(tank.level)))
        return float(np.median(np.abs(value - light * tank.level)))

    starts = [np.zeros(2)]
    if np.isfinite(last.x):
        starts.append(np.array([last.x, last.y]) / tank.reduction)
    misfits = [misfit(place) for place in starts]
    if min(misfits) > _NEAR and min(tank.small.shape) >= 16:
        small = _shrink_picture(picture)
        window = _hanning_window(small.shape)
        starts.append(_LESS * np.array(cv2.phaseCorrelate(tank.small, small, window)[0]))
        misfits.append(misfit(starts[-1]))
    return starts[int(np.argmin(misfits))]


@cache
def _hanning_window(shape: tuple[int, ...]) -> np.ndarray:
    """Return a Hanning window of a shape (h, w), float32: it fades to 0 at the border."""
    return cv2.createHanningWindow(shape[::-1], cv2.CV_32F)


def _sample_marks(picture: Picture, tank: Landmarks, shift_px: Floats) -> Floats:
    """Return the grey levels (marks,) of a frame at the landmarks, after a shift of (2,) px.

    tank: its landmarks; interpolation is bilinear.
    """
    return _interpolate_levels(picture, tank.x + shift_px[0], tank.y + shift_px[1])


@kernel
def _interpolate_levels(picture: Picture, x: Floats, y: Floats) -> Floats:
    """Return the levels (n,) of a grey picture (h, w) at the places x, y (n,) px, bilinearly.

    A place outside the picture has the level of the nearest place inside it.
    """
    height, width = picture.shape
    levels = np.empty(len(x))
    for k in range(len(x)):
        right, down = min(max(x[k], 0.0), width - 1.001), min(max(y[k], 0.0), height - 1.001)
        left, top = int(right), int(down)
        u, v = right - left, down - top
        above = picture[top, left] * (1 - u) + picture[top, left + 1] * u
        below = picture[top + 1, left] * (1 - u) + picture[top + 1, left + 1] * u
        levels[k] = above * (1 - v) + below * v
    return levels


def _judge_shift(shift_px: Floats, fit: _Fit, tank: Landmarks) -> Shift:
    """Return a fitted shift, with how far tiles disagree; `UNKNOWN` if it is not trustworthy.

    `apart` is the median distance [px] of the tiles' own shifts from the whole picture's, to the
    right or down, whichever is larger. shift_px: (2,), in the reduced picture; fit: of the frame
    after that shift; tank: its landmarks.
    """
    # The tank's edges must stand out from what the fit leaves over, else it found something else.
    weight = fit.weight + 1e-9
    mean_level = np.average(tank.level, weights=weight)
    contrast = np.average((tank.level - mean_level) ** 2, weights=weight) ** 0.5
    if fit.coefficients[2] * contrast < fit.sigma:
        return UNKNOWN
    apart, sure = [], _SURE / tank.reduction
    for slope in (tank.slope_right, tank.slope_down):
        # By tile, as in least squares: push / information is how far its marks alone would move the
        # shift, and sigma² / information the variance of that.
        information = np.bincount(tank.tile, fit.weight * slope**2, _TILES**2)
        push = np.bincount(tank.tile, fit.weight * slope * fit.residual, _TILES**2)
        # Without the tiles that know most, the standard deviation shall be at most `sure`.
        without_best = np.sort(information)[: round((1 - _BEST) * len(information))].sum()
        if without_best * sure**2 < fit.sigma**2:
            return UNKNOWN
        # Only tiles with a standard deviation below 2 `sure` count for `apart`.
        certain = information * (2 * sure) ** 2 > fit.sigma**2
        if certain.any():
            apart.append(float(np.median(np.abs(push[certain] / information[certain]))))
    right_px, down_px = (float(px) * tank.reduction for px in shift_px)
    return Shift(right_px, down_px, tank.reduction * max(apart, default=float("nan")))


def undo_shift(frame: Picture, shift: Shift, gains: Floats | None = None) -> Picture:
    """Return a frame (h, w[, 3]) moved back by the camera's shift; border pixels are repeated.

    gains: (1,) or (3,) by which each channel is divided, too; None or NaN: by nothing. All pixels
    are moved by the same part of a pixel, so two filters, one for the rows and one for the columns,
    do it (`_lanczos_weights`): 25 times as fast as a general warp.
    """
    height, width, channels = (*frame.shape, 1)[:3]
    right, down = math.floor(shift.x), math.floor(shift.y)
    factors = np.ones(channels) if gains is None else 1 / np.nan_to_num(gains, nan=1.0)
    moved = np.empty((height, width * channels), np.uint8)
    # For read-only frames numba would compile once more.
    levels = np.require(frame, requirements=("C", "W")).reshape(height, -1)
    _filter_rows_and_columns(
        levels, down - _REACH + 1, right - _REACH + 1, _lanczos_weights(shift.y - down),
        _lanczos_weights(shift.x - right), channels, np.tile(factors, width).astype(np.float32),
        moved,
    )  # fmt: skip
    return moved.reshape(frame.shape)


@finite_kernel
def _filter_rows_and_columns(
    levels: Picture, top: int, left: int, down: np.ndarray, right: np.ndarray, channels: int,
    factors: np.ndarray, moved: Picture,
) -> None:  # fmt: skip
    """Write weighted sums of 8 × 8 neighbouring levels to `moved`, rounded and clipped.

    levels, moved (h, w · channels): uint8, the channels of a pixel side by side. A level is summed
    from those of the rows top … top + 7 below it, weighed by `down`, and there of the pixels
    left … left + 7 beside it, weighed by `right`; beyond the border pixels are repeated. factors
    (w · channels): by which each sum is multiplied.
    """
    last, size = len(moved) - 1, moved.shape[1]
    border = channels * max(-left, left + 7)  # repeated levels at either end of a row
    row = np.empty(size + 2 * border, np.float32)
    inside = row[border : border + size]
    beside = row[border + left * channels :]
    pixels = (
        beside, beside[channels:], beside[2 * channels :], beside[3 * channels :],
        beside[4 * channels :], beside[5 * channels :], beside[6 * channels :],
        beside[7 * channels :],
    )  # fmt: skip
    sums = np.empty(size, np.float32)
    for y in range(len(moved)):
        k = y + top
        rows = (
            levels[min(max(k, 0), last)], levels[min(max(k + 1, 0), last)],
            levels[min(max(k + 2, 0), last)], levels[min(max(k + 3, 0), last)],
            levels[min(max(k + 4, 0), last)], levels[min(max(k + 5, 0), last)],
            levels[min(max(k + 6, 0), last)], levels[min(max(k + 7, 0), last)],
        )  # fmt: skip
        _weigh_rows(inside, down, rows)
        for x in range(border):
            row[x] = inside[x % channels]
            row[border + size + x] = inside[size - channels + x % channels]
        _weigh_rows(sums, right, pixels)
        for x in range(size):
            level = sums[x] * factors[x] + np.float32(0.5)
            moved[y, x] = np.uint8(min(max(level, np.float32(0)), np.float32(255)))


@finite_kernel
def _weigh_rows(sums: np.ndarray, weights: np.ndarray, rows: tuple[np.ndarray, ...]) -> None:
    """Write to sums (n,) the sum of eight rows of levels, each times its weight (8,).

    The eight terms are written out, because a loop over them takes twice as long. A row has n
    levels or more.
    """
    a, b, c, d, e, f, g, h = rows
    for x in range(len(sums)):
        sums[x] = (
            weights[0] * a[x] + weights[1] * b[x] + weights[2] * c[x] + weights[3] * d[x]
            + weights[4] * e[x] + weights[5] * f[x] + weights[6] * g[x] + weights[7] * h[x]
        )  # fmt: skip


def _lanczos_weights(fraction: float) -> np.ndarray:
    """Return the weights (8,) of pixels −3 … 4 that interpolate at 0 ≤ fraction < 1 [px].

    They are Lanczos' kernel sinc(x) · sinc(x / 4), normalised to a sum of 1.
    """
    x = np.arange(1 - _REACH, 1 + _REACH) - fraction
    weights = np.sinc(x) * np.sinc(x / _REACH)
    return np.asarray(weights / weights.sum(), np.float32)
