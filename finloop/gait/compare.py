"""How much γ lowers the error: four clocks on frames held out of the fit (curve paper §4.2).

A clock says how much of the first key frame is left at each moment between two key frames. The
clocks, from the most to the least constrained: "linear", γ = 0; "gamma", one γ for each contour and
subcycle; "gamma_scale", one γ for each scale too; "free", any share that only falls, for each
contour and subcycle (isotonic regression), the best possible clock. All are fitted to the frames
that are not held out.
"""

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
    fit_all_gammas,
    fit_key_frames,
    sort_into_subcycles,
)
from finloop.gait.model import Descriptor

CLOCKS = ("linear", "gamma", "gamma_scale", "free")
LEAST_GAIN = 0.02
"""Least share of a scale's squared held-out error that a useful γ removes."""
LEAST_ERROR = 1e-4  # body lengths: a smaller held-out error (RMS) of a scale is not visible

_KEYS = ["contour", "subcycle", "scale"]
_WHOLE = -1  # in the column scale: all scales together


@dataclass(frozen=True)
class ClockComparison:
    """How well the four CLOCKS predict the contours of frames held out of the fit."""

    rms: dict[str, float]  # by clock: RMS distance of contours / body length
    by_contour: pd.DataFrame  # columns contour, subcycle, frames, and rms_<clock>
    # columns contour, subcycle, scale (0 = the coarsest), coefficients (number), gamma (fitted to
    # all frames), energy_share (of the motion between the keys), rms_linear, rms_gamma_scale,
    # gamma_buys_pct (% of the squared error that γ removes), verdict (buys, buys nothing, costs, or
    # not seen)
    by_scale: pd.DataFrame


def choose_held_out_frames(film: GaitContours) -> list[Mask]:
    """Return a mask (frames,) for each fit: which frames of a film are held out of it.

    In a film of two gait cycles or more that is one cycle for each fit, and an incomplete last one.
    In a shorter film it is every other frame: the even ones in one fit, the odd ones in another.
    """
    frames = np.arange(len(film.phase))
    # A frame that ends a cycle to rounding belongs to the next one.
    cycle = np.floor(film.phase - film.phase[0] + 1e-9).astype(int)
    if film.cycles > 2 - 1e-6:
        return [cycle == number for number in np.unique(cycle)]
    return [frames % 2 == half for half in range(2)]


def compare_clocks(
    film: GaitContours, *, split: float = 0.25, wavelet: str = "coif2", coarse: int = 4
) -> ClockComparison:
    """Return the errors of a gait on frames that it was not fitted to, by each of four CLOCKS.

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
        squares = contours.pop(clock)
        rms[clock] = float(np.sqrt(squares.sum() / total)) / film.body_length
        contours[f"rms_{clock}"] = np.sqrt(squares / contours["frames"]) / film.body_length
    _, subcycles = fit_key_frames(film, split, descriptor)
    by_scale = _errors_by_scale(film, table[~is_whole].reset_index(drop=True), subcycles)
    return ClockComparison(rms, contours, by_scale)


def _sum_held_out_errors(film: GaitContours, split: float, descriptor: Descriptor) -> pd.DataFrame:
    """Return the rows of `_held_out_errors`, squared errors and `frames` summed over all fits.

    Fits that fail are skipped; if all fail, the last FinloopError is raised.
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
    """Return a table row for each contour, subcycle and scale: the clocks' squared errors.

    mask (frames,): frames held out; the clocks are fitted to all others. split: phase of key frame
    2, in cycles; descriptor: how contours become coefficients. A row has the columns of _KEYS, the
    number of held-out `frames`, and by clock the squared error, summed over these frames and
    divided by the number of the contour's points, in the contours' unit squared. The scale _WHOLE
    stands for all scales together.
    """
    rows = []
    least_motion = LEAST_MOTION * film.body_length
    _, subcycles = fit_key_frames(_select_frames(film, ~mask), split, descriptor)
    one_gamma = fit_all_gammas(subcycles, per_scale=False, least_motion=least_motion)
    scale_gammas = fit_all_gammas(subcycles, per_scale=True, least_motion=least_motion)
    held_out = sort_into_subcycles(_select_frames(film, mask), split, descriptor)
    for (name, letter), model in subcycles.items():
        tau, coefficients = held_out[name, letter].tau, held_out[name, letter].coefficients
        if not len(tau):
            continue
        point_count = len(model.end)
        gammas = descriptor.spread_gammas(scale_gammas[name][letter], point_count)
        start_share = _fit_free_clock(model, tau)[:, None, None]  # no γ can do better
        predictions = {
            "linear": model.predict(tau, np.zeros(1)),
            "gamma": model.predict(tau, np.array(one_gamma[name][letter])),
            "gamma_scale": model.predict(tau, gammas),
            "free": model.end + start_share * (model.start - model.end),
        }
        errors = {clock: coefficients - predictions[clock] for clock in CLOCKS}
        for scale, part in [(_WHOLE, slice(None)), *enumerate(model.scales)]:
            row = dict(zip(_KEYS, (name, letter, scale), strict=True)) | {"frames": len(tau)}
            for clock, error in errors.items():
                if scale == _WHOLE:  # distances of the contours' points, not of coefficients
                    error = descriptor.contours(error, point_count)
                row[clock] = float((error[:, part] ** 2).sum()) / point_count
            rows.append(row)
    return rows


def _select_frames(film: GaitContours, mask: Mask) -> GaitContours:
    """Return a film's contours and phases in the frames of a mask (frames,) only."""
    contours = {name: points[mask] for name, points in film.contours.items()}
    return replace(film, phase=film.phase[mask], contours=contours)


def _fit_free_clock(model: Subcycle, tau: Points) -> Points:
    """Return the weights (s,) of the first key frame at tau (s,) that fit `model.samples` best.

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

    table: columns of _KEYS, `frames`, and by clock the squared error summed over them, divided by
    the number of points. subcycles: those fitted to all frames.
    """
    gammas, energy_shares, counts = [], [], []
    least_motion = LEAST_MOTION * film.body_length
    for name, letter, number in table[_KEYS].itertuples(index=False):
        model = subcycles[name, letter]
        change, scale = model.start - model.end, model.scales[number]
        gammas.append(model.fit_gammas(per_scale=True, least_motion=least_motion)[number])
        energy = max((change**2).sum(), 1e-300)  # never divide by 0
        energy_shares.append(float((change[scale] ** 2).sum() / energy))
        counts.append(scale.stop - scale.start)
    linear, gamma_scale, frames = table["linear"], table["gamma_scale"], table["frames"]
    rms_linear = np.sqrt(linear / frames) / film.body_length  # without γ
    gain = (linear - gamma_scale) / linear.where(linear > 0)  # what γ removes; < 0: it adds
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
        rms_gamma_scale=np.sqrt(gamma_scale / frames) / film.body_length,
        gamma_buys_pct=(100 * gain).fillna(0.0),
        verdict=verdict,
    )
