"""Limb contours of film from regions traced in each frame (curve paper §4.2, "trace the contours").

Regions are masks or traced contours by id in each frame. Here they become contours of n points of
equal arc length in the body frame; point i corresponds to point i of all other frames. The paper
does not define this correspondence. Here every frame is turned and moved onto one mean shape of the
limb, and its contour begins where it fits that shape best. The mean shape is the same for the whole
film, so nothing drifts.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import skimage

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.curve.contour import (
    Curve,
    area_centroids,
    orient_clockwise,
    resample_curve,
    signed_area,
)
from finloop.gait.model import opposite_limb
from finloop.gait.period import fill_gaps

BODY = "body"
SMOOTH_PX = 1.0
LEAST_PX = 12  # a smaller region counts as empty
LEAST_SHARE = 0.5  # least share of the frames that show a limb
FINE = 16  # samples between two points in the search for the start
HIDDEN = 0.75  # share of its median area: a smaller region is probably partly hidden
ROUNDS = 4  # alternations between mean shape and starts

MISSING, EMPTY, BORDER = "not there", "empty", "touches the border of the picture"
Region = Curve | str  # a contour, or why a frame has none: MISSING, EMPTY or BORDER


@dataclass(frozen=True)
class Limbs:
    """Contours of an animal's limbs relative to the body, px: x right, y down, the body at 0."""

    points: dict[str, Floats]  # by id, (frames, n, 2); NaN in frames that lack the limb
    course: Floats  # smoothed place of the body in the picture, (frames, 2)
    # width of the body's region, or of all limbs together without one
    length_px: float
    notes: tuple[str, ...]  # sentences about omitted regions


def region_contour(mask: Mask, smooth_px: float = SMOOTH_PX) -> Region:
    """Return the outline of the largest part of a mask (h, w): closed, clockwise, in px.

    The result is EMPTY or BORDER where there is no whole region. A Gaussian of SD `smooth_px`
    smooths the mask, and the contour runs at half height. This removes pixel steps; a corner of
    radius r shrinks by about smooth_px² / 2r. Pixel centres are whole numbers.
    """
    if int(mask.sum()) < LEAST_PX:
        return EMPTY
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        return BORDER
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    pad = int(np.ceil(4 * smooth_px)) + 1
    part = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.float32)
    part = np.pad(part, pad)
    if smooth_px > 0:
        part = cv2.GaussianBlur(part, (0, 0), smooth_px)
    curves = [
        Curve(ring[:-1, ::-1].copy(), True) for ring in skimage.measure.find_contours(part, 0.5)
    ]
    curves = [curve for curve in curves if len(curve.points) > 3]
    if not curves:
        return EMPTY
    largest = orient_clockwise(max(curves, key=lambda curve: abs(signed_area(curve))))
    return Curve(largest.points + np.array([columns[0] - pad, rows[0] - pad]), True)


def check_traced_contour(curve: Curve, width: float, height: float) -> Region:
    """Return a traced contour; BORDER in its place if it leaves the picture (both in px)."""
    inside = (curve.points > 0).all() and (curve.points < [width, height]).all()
    return curve if inside else BORDER


def limb_contours(
    frames: Sequence[Mapping[str, Region | None]],
    n: int,
    smooth_frames: float | None = None,
    first: int = 0,
) -> Limbs:
    """Return the contours of all limbs in all frames, n points each, relative to the body.

    frames: contours by id for each frame, None where missing; the id "body" gives the place of the
    body, without it the mean of the limbs does. smooth_frames: frames of a cycle, over which the
    body's track is smoothed, None = the body moves straight. first: number of the first frame, for
    messages. FinloopError if there is no limb, or less than half of the frames show a limb.
    """
    names = list(dict.fromkeys(name for frame in frames for name in frame))
    if not [name for name in names if name != BODY]:
        raise FinloopError(
            f"regions of {len(frames)} frames, without a limb",
            "a region for each limb, such as fore_left, fore_right, hind_left and hind_right",
            "trace each limb under its own id",
        )
    regions = {name: [frame.get(name) or MISSING for frame in frames] for name in names}
    notes = _check_missing_regions(regions, first)
    where = [BODY] if BODY in regions else names
    centres = {
        name: np.array(
            [
                area_centroids(region.points) if isinstance(region, Curve) else (np.nan, np.nan)
                for region in regions[name]
            ]
        )
        for name in where
    }
    course = smooth_track(
        np.mean([fill_gaps(centres[name]) for name in where], axis=0), smooth_frames
    )
    points = dict[str, Floats]()
    for name in names:
        if name != BODY and name not in points:
            # A limb and its partner together: their points correspond too.
            pair = dict.fromkeys((name, opposite_limb(name, names)))
            both = match_contours([region for each in pair for region in regions[each]], n)
            for each, of in zip(pair, np.split(both, len(pair)), strict=True):
                points[each] = of - course[:, None]
    points = {name: points[name] for name in names if name != BODY}
    return Limbs(points, course, _median_contour_width([regions[name] for name in where]), notes)


def match_contours(regions: Sequence[Region], n: int) -> Floats:
    """Renumber the contours of all frames so that point i is the same place of the limb in each.

    Return (frames, n, 2), px; NaN where a frame has no contour. Points lie at equal distances along
    a contour. Each contour starts where, turned and moved, it fits the mean shape best: the
    greatest |Σ a̅ b| of centred contours a, b as complex numbers, by FFT. The start may lie between
    two points. Point 0 is the uppermost of the mean shape: the hip or the shoulder.
    """
    curves = [orient_clockwise(region) if isinstance(region, Curve) else None for region in regions]
    there = [k for k, curve in enumerate(curves) if curve is not None]
    out = np.full((len(curves), n, 2), np.nan)
    fine = np.stack(
        [resample_curve(curve, n * FINE).points @ [1, 1j] for curve in curves if curve is not None]
    )
    centred = fine - fine.mean(axis=1, keepdims=True)
    spectra = np.fft.fft(centred, axis=1)
    mean = centred[0]
    for _ in range(ROUNDS):
        fits = np.fft.ifft(spectra * np.fft.fft(mean).conj(), axis=1)
        starts = np.abs(fits).argmax(axis=1)
        aligned = np.stack(
            [
                np.roll(shape, -start) * np.exp(-1j * np.angle(fit[start]))
                for shape, start, fit in zip(centred, starts, fits, strict=True)
            ]
        )
        mean = aligned.mean(axis=0)
    top = int(mean.imag.argmin())
    for k, shape, start in zip(there, fine, starts, strict=True):
        ring = np.roll(shape, -start - top)[::FINE]
        out[k] = np.column_stack([ring.real, ring.imag])
    return out


def smooth_track(track: Floats, window: float | None) -> Floats:
    """Smooth a track (frames, k) by the mean over `window` frames; None = a straight line.

    Within half a window of the ends, the means continue in a straight line. A track shorter than
    two windows becomes one straight line.
    """
    time = np.arange(len(track), dtype=float)
    if window is None or len(track) < 2 * window:
        return _fit_line(time, track, time)
    half = int(np.ceil(window / 2))
    # The share of each frame's time within the window.
    weight = np.clip(window / 2 + 0.5 - np.abs(np.arange(-half, half + 1)), 0, 1)
    means = np.column_stack(
        [np.convolve(values, weight / weight.sum(), "valid") for values in track.T]
    )
    inner, some = time[half : len(track) - half], round(window)
    before = _fit_line(inner[:some], means[:some], time[:half])
    after = _fit_line(inner[-some:], means[-some:], time[len(track) - half :])
    return np.concatenate([before, means, after])


def _fit_line(time: Floats, values: Floats, times: Floats) -> Floats:
    """Fit a straight line to values (m, k) at `time` (m,); return its values at `times`."""
    basis, there = (np.column_stack([np.ones(len(x)), x]) for x in (time, times))
    return np.asarray(there @ np.linalg.lstsq(basis, values, rcond=None)[0])


def _median_contour_width(regions: Sequence[Sequence[Region]]) -> float:
    """Return the median width [px] of all limbs together, in the frames that show most limbs."""
    frames = zip(*regions, strict=True)
    contours = [[each.points for each in frame if isinstance(each, Curve)] for frame in frames]
    most = max(len(frame) for frame in contours)
    return float(np.median([np.ptp(np.concatenate(f)[:, 0]) for f in contours if len(f) == most]))


def _check_missing_regions(regions: Mapping[str, Sequence[Region]], first: int) -> tuple[str, ...]:
    """Return notes on frames that lack a limb; FinloopError if too many frames lack it.

    regions: by id, one for each frame; first: number of the first frame.
    """
    notes, wrong, hints = [], [], []
    often = {
        name
        for name, frames in regions.items()
        if sum(isinstance(region, Curve) for region in frames) >= LEAST_SHARE * len(frames)
    }
    for name, frames in regions.items():
        lacking = {
            why: [
                k for k, each in enumerate(frames, first) if isinstance(each, str) and each == why
            ]
            for why in (MISSING, EMPTY, BORDER)
        }
        gaps = [f"{_format_frame_numbers(which)}: {why}" for why, which in lacking.items() if which]
        if name not in often:
            wrong.append(f"{name!r} in frames {'; '.join(gaps)}")
            hints += difflib.get_close_matches(name, sorted(often), 1, 0.8)
            continue
        if name != BODY and "left" not in name and "right" not in name:
            notes.append(
                f"{name} has no side, left or right: it is assumed to move alike in both halves of"
                " the cycle"
            )
        if gaps:
            notes.append(f"{name} is left out of frames {'; '.join(gaps)}")
        size = np.array(
            [signed_area(region) if isinstance(region, Curve) else np.nan for region in frames]
        )
        if small := np.flatnonzero(np.abs(size) < HIDDEN * np.nanmedian(np.abs(size))).tolist():
            which = _format_frame_numbers([first + k for k in small])
            notes.append(
                f"{name} is smaller than usual in frames {which}:"
                " if something hides a part of it there, trace it whole or omit it"
            )
    if wrong:
        alike = f" (is it {' or '.join(sorted(set(hints)))}?)" if hints else ""
        raise FinloopError(
            f"regions that most frames lack: {', '.join(wrong)}{alike}",
            "the same ids in all frames, each complete in at least half of them",
            "give a limb one name in all frames, and draw masks white on black; trace it in the"
            " other frames, or omit it in all",
        )
    return tuple(notes)


def _format_frame_numbers(numbers: Sequence[int]) -> str:
    """Return frame numbers as text, with a run of them as "3-7"."""
    cuts = [
        0,
        *(i for i in range(1, len(numbers)) if numbers[i] != numbers[i - 1] + 1),
        len(numbers),
    ]
    runs = [(numbers[a], numbers[b - 1]) for a, b in pairwise(cuts)]
    words = [f"{a}-{b}" if b > a else f"{a}" for a, b in runs[:8]]
    return ", ".join(words) + (f" and {len(runs) - 8} more runs" if len(runs) > 8 else "")
