"""Make limb contours from regions traced in each frame of a film (curve paper §4.2).

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

from finloop.base.arrays import Complex, Floats, Ints, Mask
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
from finloop.gait.settings import Symmetry

BODY = "body"
SMOOTH_PX = 1.0  # SD of the Gaussian that smooths a mask
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


def region_contour(mask: Mask) -> Region:
    """Return the outline [px] of the largest part of a mask (h, w), closed and clockwise.

    Return EMPTY if fewer than LEAST_PX pixels are set, BORDER if the region touches the border of
    the picture. A Gaussian of SMOOTH_PX smooths the mask, and the contour runs at half height. This
    removes pixel steps; a corner of radius r shrinks by about SMOOTH_PX² / 2r. Pixel centres are
    whole numbers.
    """
    if int(mask.sum()) < LEAST_PX:
        return EMPTY
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        return BORDER
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    pad = int(np.ceil(4 * SMOOTH_PX)) + 1  # the Gaussian ends within the window
    window = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.float32)
    window = cv2.GaussianBlur(np.pad(window, pad), (0, 0), SMOOTH_PX)
    curves = []
    for ring in skimage.measure.find_contours(window, 0.5):  # (row, column), first point repeated
        curve = Curve(ring[:-1, ::-1].copy(), closed=True)
        if len(curve.points) > 3:
            curves.append(curve)
    if not curves:
        return EMPTY
    largest = orient_clockwise(max(curves, key=lambda curve: abs(signed_area(curve))))
    corner = np.array([columns[0] - pad, rows[0] - pad])
    return Curve(largest.points + corner, closed=True)


def check_traced_contour(curve: Curve, width: float, height: float) -> Region:
    """Return a traced contour unchanged, or BORDER if it leaves a picture of width × height px."""
    inside = (curve.points > 0).all() and (curve.points < [width, height]).all()
    return curve if inside else BORDER


def limb_contours(
    frames: Sequence[Mapping[str, Region | None]],
    n: int,
    smooth_frames: float | None = None,
    first: int = 0,
    symmetry: Symmetry = "swap",
) -> Limbs:
    """Return the contours of all limbs in all frames, n points each, px relative to the body.

    frames: contours by id for each frame, None where missing; the id "body" gives the place of the
    body, without it the mean of the limbs does. smooth_frames: frames of a cycle, over which the
    body's track is smoothed, None = the body moves straight. first: number of the first frame, for
    messages. symmetry: of the animal. FinloopError if there is no limb, or if one is missing in
    most frames.
    """
    names = list(dict.fromkeys(name for frame in frames for name in frame))
    limb_names = [name for name in names if name != BODY]
    if not limb_names:
        raise FinloopError(
            f"regions of {len(frames)} frames, without a limb",
            "a region for each limb, such as fore_left, fore_right, hind_left and hind_right",
            "trace each limb under its own id",
        )
    regions = {name: [frame.get(name) or MISSING for frame in frames] for name in names}
    _refuse_rare_regions(regions, first)
    notes = _describe_doubtful_regions(regions, first, symmetry)
    place_names = [BODY] if BODY in regions else names  # their mean is the place of the body
    track = _mean_centres([regions[name] for name in place_names])
    course = smooth_track(track, smooth_frames)  # of the body in the picture
    points = dict[str, Floats]()
    for name in limb_names:
        if name not in points:
            # A limb and its partner together: their points correspond too.
            pair = list(dict.fromkeys((name, opposite_limb(name, names))))
            contours = match_contours([region for limb in pair for region in regions[limb]], n)
            for limb, limb_points in zip(pair, np.split(contours, len(pair)), strict=True):
                points[limb] = limb_points - course[:, None]
    points = {name: points[name] for name in limb_names}  # in the order of the film
    length_px = _median_contour_width([regions[name] for name in place_names])
    return Limbs(points, course, length_px, notes)


def _mean_centres(regions: Sequence[Sequence[Region]]) -> Floats:
    """Return the mean (frames, 2) [px] of several regions' mass centres in each frame.

    regions: for each id, one for each frame. Gaps in the path of a region are filled.
    """
    centres = []
    for frames in regions:
        places = [
            area_centroids(region.points) if isinstance(region, Curve) else (np.nan, np.nan)
            for region in frames
        ]
        centres.append(fill_gaps(np.array(places)))
    return np.asarray(np.mean(centres, axis=0))


def match_contours(regions: Sequence[Region], n: int) -> Floats:
    """Return a limb's contours (frames, n, 2) in px, numbered so that point i is one body point.

    regions: one for each frame; NaN where a frame has no contour. Points lie at equal distances
    along a contour. Point 0 is the hip or the shoulder: the top of the limb's mean shape, turned
    and moved onto each contour.
    """
    shown, fine_contours = list[int](), list[Complex]()
    for frame, region in enumerate(regions):
        if isinstance(region, Curve):
            shown.append(frame)
            # FINE points for each of the n, as the hip may lie between two of these.
            fine = resample_curve(orient_clockwise(region), n * FINE)
            fine_contours.append(fine.points @ np.array([1, 1j]))
    contours = np.stack(fine_contours)
    numbered = np.full((len(regions), n, 2), np.nan)
    for frame, contour, hip in zip(shown, contours, _find_hips(contours), strict=True):
        ring = np.roll(contour, -hip)[::FINE]
        numbered[frame] = np.column_stack([ring.real, ring.imag])
    return numbered


def _find_hips(contours: Complex) -> Ints:
    """Return the vertex at the hip of each contour, (frames,): the top of the limb's mean shape.

    contours (frames, m): points x + iy, y down, clockwise. The mean shape lies on a contour as it
    fits best, turned and moved: with the greatest |Σ a̅ b| of centred contours a, b, by FFT. No
    turn is more than 90° from the mean turn, as many limbs look much the same upside down.
    """
    centred = contours - contours.mean(axis=1, keepdims=True)
    spectra = np.fft.fft(centred, axis=1)
    # The mean shape depends on the starts, which contour point lies on its point 0, and these on
    # it: they are found in turn, beginning with the first contour as the mean.
    mean_shape = centred[0]
    # The first limb, turned by this, hangs straight down from its top: i points down.
    mean_turn = -1j / complex(mean_shape[mean_shape.imag.argmin()])
    for _ in range(ROUNDS):
        fits = np.fft.ifft(spectra * np.fft.fft(mean_shape).conj(), axis=1)
        upright = (fits * mean_turn.conjugate()).real > 0
        starts = np.where(upright, np.abs(fits), 0).argmax(axis=1)
        turns = np.exp(1j * np.angle([fit[s] for fit, s in zip(fits, starts, strict=True)]))
        rings = [np.roll(ring, -start) for ring, start in zip(centred, starts, strict=True)]
        mean_shape = (np.stack(rings) / turns[:, None]).mean(axis=0)
        mean_turn = complex(turns.mean())
    return (starts + int(mean_shape.imag.argmin())) % contours.shape[1]


def smooth_track(track: Floats, window: float | None) -> Floats:
    """Return a track (frames, k), smoothed by a moving mean over a cycle of `window` frames.

    Within half a window of the ends, the means continue in a straight line. The whole track becomes
    one straight line if it is shorter than two windows, or `window` is None. Its slope is then that
    between frames a cycle apart, so that the line does not rise with the body within the cycle; a
    single cycle has no such frames, and the body stays at its mean place. Without a window, the
    line is the one that fits best.
    """
    time = np.arange(len(track), dtype=float)
    if window is None:
        return _evaluate_fitted_line(time, track, time)
    if len(track) < 2 * window:
        cycle = round(window)
        steps = (track[cycle:] - track[: max(0, len(track) - cycle)]) / cycle
        slope = steps.mean(axis=0) if len(steps) else np.zeros(track.shape[1])
        return np.asarray(track.mean(axis=0) + (time - time.mean())[:, None] * slope)
    half = int(np.ceil(window / 2))
    # The share of each frame's time within the window.
    weight = np.clip(window / 2 + 0.5 - np.abs(np.arange(-half, half + 1)), 0, 1)
    means = np.column_stack(
        [np.convolve(values, weight / weight.sum(), "valid") for values in track.T]
    )
    inner, count = time[half : len(track) - half], round(window)  # the times of the means
    before = _evaluate_fitted_line(inner[:count], means[:count], time[:half])
    after = _evaluate_fitted_line(inner[-count:], means[-count:], time[len(track) - half :])
    return np.concatenate([before, means, after])


def _evaluate_fitted_line(time: Floats, values: Floats, wanted_time: Floats) -> Floats:
    """Return values (w, k) at `wanted_time` (w,) of the line fitted to values (m, k) at `time`."""
    basis, wanted = (np.column_stack([np.ones(len(x)), x]) for x in (time, wanted_time))
    return np.asarray(wanted @ np.linalg.lstsq(basis, values, rcond=None)[0])


def _median_contour_width(regions: Sequence[Sequence[Region]]) -> float:
    """Return the width [px] of all regions together, as the median over frames.

    regions: for each id, one for each frame. Only the frames with the most contours count.
    """
    widths_by_count = dict[int, list[float]]()  # by the number of contours in a frame
    for regions_of_frame in zip(*regions, strict=True):
        x = [region.points[:, 0] for region in regions_of_frame if isinstance(region, Curve)]
        if x:
            widths_by_count.setdefault(len(x), []).append(float(np.ptp(np.concatenate(x))))
    return float(np.median(widths_by_count[max(widths_by_count)]))


def _describe_doubtful_regions(
    regions: Mapping[str, Sequence[Region]], first: int, symmetry: Symmetry
) -> tuple[str, ...]:
    """Return warnings on limbs without a side, and on missing or small regions.

    regions: by id, one for each frame, no `Curve` where the frame lacks it; first: number of the
    first frame; symmetry: without one, a limb needs no side.
    """
    notes = []
    for name, frames in regions.items():
        gaps = _describe_gaps(frames, first)
        no_side = name != BODY and "left" not in name and "right" not in name
        if no_side and symmetry != "none":
            notes.append(
                f"{name} has no side, left or right: it is assumed to move alike in both halves of"
                " the cycle"
            )
        if gaps:
            notes.append(f"{name} is left out of frames {gaps}")
        area = np.abs(
            [signed_area(region) if isinstance(region, Curve) else np.nan for region in frames]
        )
        small = first + np.flatnonzero(area < HIDDEN * np.nanmedian(area))
        if small.size:
            notes.append(
                f"{name} is smaller than usual in frames {_format_frame_numbers(small.tolist())}:"
                " if something hides a part of it there, trace it whole or omit it"
            )
    return tuple(notes)


def _refuse_rare_regions(regions: Mapping[str, Sequence[Region]], first: int) -> None:
    """Raise FinloopError if a region is shown in less than LEAST_SHARE of the frames.

    regions: by id, one for each frame, no `Curve` where the frame lacks it; first: number of the
    first frame. The message asks whether a similar id was meant.
    """
    usual_names = sorted(
        name
        for name, frames in regions.items()
        if sum(isinstance(region, Curve) for region in frames) >= LEAST_SHARE * len(frames)
    )
    rare, hints = [], []
    for name, frames in regions.items():
        if name not in usual_names:
            rare.append(f"{name!r} in frames {_describe_gaps(frames, first)}")
            hints += difflib.get_close_matches(name, usual_names, n=1, cutoff=0.8)
    if rare:
        alike = f" (is it {' or '.join(sorted(set(hints)))}?)" if hints else ""
        raise FinloopError(
            f"regions that most frames lack: {', '.join(rare)}{alike}",
            "the same ids in all frames, each complete in at least half of them",
            "give a limb one name in all frames, and draw masks white on black; trace it in the"
            " other frames, or omit it in all",
        )


def _describe_gaps(regions: Sequence[Region], first: int) -> str:
    """Return a text on frames without a contour, and why: "3-7: empty"; "" if there are none.

    regions: of one limb, one for each frame; first: number of the first frame.
    """
    gaps = []
    for why in (MISSING, EMPTY, BORDER):
        if numbers := [number for number, region in enumerate(regions, first) if region == why]:
            gaps.append(f"{_format_frame_numbers(numbers)}: {why}")
    return "; ".join(gaps)


def _format_frame_numbers(numbers: Sequence[int]) -> str:
    """Return ascending frame numbers as text, with runs such as "3-7".

    The text names at most 8 runs, then says how many more there are.
    """
    starts = [i for i in range(1, len(numbers)) if numbers[i] != numbers[i - 1] + 1]
    runs = [(numbers[a], numbers[b - 1]) for a, b in pairwise([0, *starts, len(numbers)])]
    words = [f"{first}-{last}" if last > first else f"{first}" for first, last in runs[:8]]
    return ", ".join(words) + (f" and {len(runs) - 8} more runs" if len(runs) > 8 else "")
