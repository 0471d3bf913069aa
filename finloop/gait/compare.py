"""Measure how much γ lowers the error: six clocks on frames held out of the fit (§4.2).

A clock says how much of the first key frame is left at each moment between two key frames. The
clocks, each for a contour and subcycle: "linear", γ = 0; "limb", "scale", "coefficient" and
"coordinate", named by what shares a γ; "free", any share that only falls, the same for all
coordinates (isotonic regression). "free" is the best that a shared clock can do, so it bounds
"linear" and "limb" alone: the others have clocks of their own for parts of a contour. All are
fitted to the frames that are not held out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Mask, Points
from finloop.base.errors import FinloopError
from finloop.gait.fit import (
    LEAST_MOTION,
    GaitContours,
    Subcycle,
    SubcycleKey,
    check_phases,
    fit_key_frames,
    sort_into_subcycles,
)
from finloop.gait.model import SHARINGS, Descriptor

CLOCKS = ("linear", *SHARINGS, "free")
LEAST_GAIN = 0.02
"""Least share of a scale's squared held-out error that a useful γ removes."""
LEAST_ERROR = 1e-4  # body lengths, RMS over a contour: what is smaller is not visible

_KEYS = ["contour", "subcycle", "scale"]
_WHOLE = -1  # in the column scale: all scales together


@dataclass(frozen=True)
class ClockComparison:
    """The errors of six CLOCKS in predicting contours of frames that were held out of the fit."""

    rms: dict[str, float]  # by clock: RMS distance of contours / body length
    by_contour: pd.DataFrame  # columns contour, subcycle, frames, and rms_<clock>
    # columns contour, subcycle, scale (0 = the coarsest), coefficients (number), gamma (fitted to
    # all frames), energy_share (of the motion between the keys), rms_linear, rms_scale,
    # gamma_buys_pct (% of the squared error that γ removes), verdict (buys, buys nothing, costs, or
    # not seen)
    by_scale: pd.DataFrame
    not_monotone: pd.DataFrame  # see `find_turning_coordinates`


def describe_doubtful_fit(film: GaitContours, rms: float) -> str:
    """Return a warning if a fit explains less than half of the motion's variance, else "".

    rms: error of the fit on held-out frames, body lengths.
    """
    shown = [points[np.isfinite(points).all(axis=(1, 2))] for points in film.contours.values()]
    moves = [(points - points.mean(axis=0)).reshape(-1, 2) for points in shown if len(points)]
    distances = np.hypot(*np.concatenate(moves).T)
    motion = float(np.sqrt((distances**2).mean())) / film.body_length
    if rms**2 < motion**2 / 2:
        return ""
    cure = "; if left and right do not repeat each other, as in a gallop, set gait.symmetry=none"
    return (
        f"frames left out of the fit are {100 * rms:.3g} % of the body length off, and contours "
        f"move by {100 * motion:.3g} %: the fit explains less than half of the motion"
        + (cure if film.symmetry == "swap" else "")
    )


def choose_held_out_frames(film: GaitContours) -> list[Mask]:
    """Return one mask (frames,) for each fit: the frames that are held out of it.

    In a film of two gait cycles or more that is one cycle for each fit, and an incomplete last one.
    In a shorter film it is every other frame: the even ones in one fit, the odd ones in another.
    Without symmetry it is a single frame, as half of them would leave too few in a subcycle.
    """
    frames = np.arange(len(film.phase))
    # A frame that ends a cycle to rounding belongs to the next one.
    cycle = np.floor(film.phase - film.phase[0] + 1e-9).astype(int)
    if film.cycles > 2 - 1e-6:
        return [cycle == number for number in np.unique(cycle)]
    if film.symmetry == "none":
        return [frames == number for number in frames]
    return [frames % 2 == half for half in range(2)]


def compare_clocks(
    film: GaitContours, *, split: float = 0.25, wavelet: str = "coif2", coarse: int = 4
) -> ClockComparison:
    """Return the errors of each of six CLOCKS on frames that it was not fitted to.

    A clock says how much of the first key frame is left at each moment between two key frames.
    Errors are RMS distances of contours, in body lengths.

    split: phase of key frame 2, in cycles; wavelet, coarse: of the `Descriptor`. FinloopError if no
    fit with frames held out succeeds, the film shows less than half a cycle, or its phase does not
    rise.
    """
    check_phases(film)
    descriptor = Descriptor(wavelet, coarse)
    table = _sum_held_out_errors(film, split, descriptor)
    is_whole = table["scale"] == _WHOLE
    contours = table[is_whole].drop(columns="scale").reset_index(drop=True)
    total = contours["frames"].sum()
    rms = {}
    for clock in CLOCKS:
        squares = contours.pop(f"squares_{clock}")
        rms[clock] = float(np.sqrt(squares.sum() / total)) / film.body_length
        contours[f"rms_{clock}"] = np.sqrt(squares / contours["frames"]) / film.body_length
    _, subcycles = fit_key_frames(film, split, descriptor)
    by_scale = _errors_by_scale(film, table[~is_whole].reset_index(drop=True), subcycles)
    return ClockComparison(
        rms, contours, by_scale, find_turning_coordinates(subcycles, film.body_length)
    )


def _sum_held_out_errors(film: GaitContours, split: float, descriptor: Descriptor) -> pd.DataFrame:
    """Return the held-out squared errors of all fits, summed by contour, subcycle and scale.

    Fits that fail are skipped; if all fail, the last FinloopError is raised. split: phase of key
    frame 2, in cycles; descriptor: how contours become coefficients.
    """
    rows: list[dict[str, Any]] = []
    problem: FinloopError | None = None
    for mask in choose_held_out_frames(film):
        try:
            rows += _held_out_errors(film, mask, split, descriptor)
        except FinloopError as error:
            problem = error
    if problem is not None and not rows:
        raise problem
    return pd.DataFrame(rows).groupby(_KEYS, sort=False).sum().reset_index()


def _held_out_errors(
    film: GaitContours, mask: Mask, split: float, descriptor: Descriptor
) -> list[dict[str, Any]]:
    """Return a row for each contour, subcycle and scale with the squared error of each clock.

    mask (frames,): frames held out; the clocks are fitted to all others. split: phase of key frame
    2, in cycles; descriptor: how contours become coefficients. A row has the columns of _KEYS, the
    number of held-out `frames`, and squares_<clock>: the squared error, summed over these frames
    and divided by the number of the contour's points, in the contours' unit squared. The scale
    _WHOLE stands for all scales together.
    """
    rows = []
    least_motion = LEAST_MOTION * film.body_length
    _, subcycles = fit_key_frames(_select_frames(film, ~mask), split, descriptor)
    held_out = sort_into_subcycles(_select_frames(film, mask), split, descriptor)
    for (name, letter), model in subcycles.items():
        tau, coefficients = held_out[name, letter].tau, held_out[name, letter].coefficients
        if not len(tau):
            continue
        point_count = len(model.end)
        start_share = _fit_free_clock(model, tau)[:, None, None]
        predictions = {
            "linear": model.predict(tau, np.zeros(1)),
            "free": model.end + start_share * (model.start - model.end),
        }
        for sharing in SHARINGS:
            gammas = model.fit_gammas(sharing, least_motion)
            predictions[sharing] = model.predict(tau, descriptor.spread_gammas(gammas, point_count))
        errors = {clock: coefficients - predictions[clock] for clock in CLOCKS}
        for scale, part in [(_WHOLE, slice(None)), *enumerate(model.scales)]:
            row = dict(zip(_KEYS, (name, letter, scale), strict=True)) | {"frames": len(tau)}
            for clock, error in errors.items():
                if scale == _WHOLE:  # distances of the contours' points, not of coefficients
                    error = descriptor.contours(error, point_count)
                row[f"squares_{clock}"] = float((error[:, part] ** 2).sum()) / point_count
            rows.append(row)
    return rows


def _select_frames(film: GaitContours, mask: Mask) -> GaitContours:
    """Return a film's contours and phases in only the frames of a mask (frames,)."""
    contours = {name: points[mask] for name, points in film.contours.items()}
    return replace(film, phase=film.phase[mask], contours=contours)


def _fit_free_clock(model: Subcycle, tau: Points) -> Points:
    """Return the best weights (s,) of the first key frame at times tau, of any falling course.

    tau: shares 0-1 of the subcycle's time. The weight may fall from 1 to 0 in any way (isotonic
    regression); it falls evenly in a subcycle without motion or samples.
    """
    change = (model.start - model.end).ravel()
    squared_change = float(change @ change)
    samples = model.samples
    if squared_change == 0 or not len(samples.tau):
        return 1 - tau
    order = np.argsort(samples.tau, kind="stable")
    from_end = (samples.coefficients - model.end).reshape(len(order), -1)
    shares = from_end[order] @ change / squared_change  # of the first key frame, in each film frame
    falling_shares = scipy.optimize.isotonic_regression(shares, increasing=False).x
    known_tau = np.concatenate([[0.0], samples.tau[order], [1.0]])
    known_shares = np.concatenate([[1.0], np.clip(falling_shares, 0, 1), [0.0]])
    return np.interp(tau, known_tau, known_shares)


def _errors_by_scale(
    film: GaitContours, table: pd.DataFrame, subcycles: dict[SubcycleKey, Subcycle]
) -> pd.DataFrame:
    """Return the table `ClockComparison.by_scale`: errors with and without γ by wavelet scale.

    table: columns of _KEYS, `frames`, and squares_<clock>, the squared error summed over them,
    divided by the number of points. subcycles: those fitted to all frames.
    """
    gammas, energy_shares, counts = [], [], []
    least_motion = LEAST_MOTION * film.body_length
    for name, letter, number in table[_KEYS].itertuples(index=False):
        model = subcycles[name, letter]
        change, scale = model.start - model.end, model.scales[number]
        gammas.append(model.fit_gammas("scale", least_motion)[number])
        energy = max((change**2).sum(), 1e-300)  # never divide by 0
        energy_shares.append(float((change[scale] ** 2).sum() / energy))
        counts.append(scale.stop - scale.start)
    linear, by_gamma = table["squares_linear"], table["squares_scale"]
    frames = table["frames"]
    rms_linear = np.sqrt(linear / frames) / film.body_length  # without γ
    gain = (linear - by_gamma) / linear.where(linear > 0)  # what γ removes; < 0: it adds
    verdict = np.select(
        [rms_linear < LEAST_ERROR, gain > LEAST_GAIN, gain < -LEAST_GAIN],
        ["not seen", "buys", "costs"],
        "buys nothing",
    )
    return table[_KEYS].assign(
        coefficients=counts,
        gamma=gammas,
        energy_share=energy_shares,
        rms_linear=rms_linear,
        rms_scale=np.sqrt(by_gamma / frames) / film.body_length,
        gamma_buys_pct=(100 * gain).fillna(0.0),
        verdict=verdict,
    )


def find_turning_coordinates(
    subcycles: Mapping[SubcycleKey, Subcycle], body_length: float
) -> pd.DataFrame:
    """Return a table of coordinates that overshoot a key frame, so that no γ from −1 to 1 fits.

    f(τ) of the model falls all the way only if |γ| ≤ 1. The γ that fits these coordinates best lies
    beyond, so that they pass a key frame visibly, by LEAST_ERROR or more, and return to it.
    subcycles: fitted to film; body_length: in the unit of the contours.

    A row is a coordinate, the farthest beyond a key first; the columns are contour, subcycle,
    coefficient (from 1), coordinate ("x" or "y"), gamma (which fits best), beyond_key_pct (how far
    it passes the key frame, RMS over the contour, % of body length), and left_pct (% of the squared
    distance from the straight course that this γ leaves).
    """
    tables = []
    for (name, letter), subcycle in subcycles.items():
        gamma = subcycle.fit_gammas("coordinate", LEAST_MOTION * body_length)
        size = np.maximum(np.abs(gamma), 1)
        overshoot = (size - 1) ** 2 / (4 * size)  # of f, below 0 or above 1
        distance = np.abs(subcycle.start - subcycle.end) / np.sqrt(len(gamma)) / body_length
        turns = overshoot * distance >= LEAST_ERROR
        rows, columns = np.nonzero(turns)
        samples = subcycle.samples
        left, straight = (
            ((samples.coefficients - subcycle.predict(samples.tau, gammas)) ** 2).sum(axis=0)[turns]
            for gammas in (gamma, np.zeros(1))
        )
        found = {
            "contour": name, "subcycle": letter, "coefficient": rows + 1,
            "coordinate": np.array(["x", "y"])[columns], "gamma": gamma[turns],
            "beyond_key_pct": 100 * (overshoot * distance)[turns],
            "left_pct": 100 * left / straight,
        }  # fmt: skip
        tables.append(pd.DataFrame(found))
    return pd.concat(tables).sort_values("beyond_key_pct", ascending=False, ignore_index=True)
