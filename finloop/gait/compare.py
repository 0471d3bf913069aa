"""How much γ lowers the error: four clocks on frames held out of the fit (curve paper §4.2).

The clocks of a blend between two keys, from the most to the least constrained: "linear", γ = 0;
"gamma", one γ for each contour and subcycle; "gamma_scale", one γ for each scale too; "free", any
monotone f for each contour and subcycle (isotonic regression), the best possible clock.
"""

from collections.abc import Iterator
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
    check_phases,
    correct_key_frames,
    fit_all_gammas,
    sort_into_subcycles,
)
from finloop.gait.model import contour_from_descriptor, gamma_per_coefficient

CLOCKS = ("linear", "gamma", "gamma_scale", "free")
LEAST_GAIN = 0.02
"""Least share of a scale's squared held-out error that a useful γ removes."""
LEAST_ERROR = 1e-4  # body lengths: a smaller held-out error (RMS) of a scale is not visible

_KEYS = ["contour", "subcycle", "scale"]
_WHOLE = -1  # in the column scale: all scales together


@dataclass(frozen=True)
class ClockComparison:
    """How well four clocks predict the contours of frames held out of the fit.

    A clock says how much of the first key frame is left at each moment between two key frames.
    """

    scheme: str  # what is held out at a time: "cycles" or "every other frame"
    rms: dict[str, float]  # by clock: RMS distance of contours / body length
    by_contour: pd.DataFrame  # columns contour, subcycle, frames, and rms_<clock>
    # columns contour, subcycle, scale (0 = the approximation), coefficients, gamma (fitted to all
    # frames), energy_share (of the motion between the keys), rms_linear, rms_gamma_scale,
    # gamma_buys_pct (of the squared error), verdict
    by_scale: pd.DataFrame


def choose_held_out_frames(film: GaitContours) -> tuple[str, list[Mask]]:
    """Choose which frames of a film are held out of each fit: name of the scheme, masks (frames,).

    A film of two cycles or more holds out one cycle at a time; an incomplete last cycle has a mask
    of its own. A shorter film holds out every other frame.
    """
    frames = np.arange(len(film.phase))
    # A frame that ends a cycle to rounding belongs to the next one.
    cycle = np.floor(film.phase - film.phase[0] + 1e-9).astype(int)
    if film.cycles > 2 - 1e-6:
        return "cycles", [cycle == number for number in np.unique(cycle)]
    return "every other frame", [frames % 2 == half for half in range(2)]


def compare_clocks(
    film: GaitContours, *, split: float = 0.25, wavelet: str = "coif2", coarse: int = 4
) -> ClockComparison:
    """Measure how well each of the four CLOCKS predicts frames that it was not fitted to.

    split: phase of key 2, in cycles; wavelet: of the descriptor; coarse: coefficients of its
    coarsest scale. Frames to hold out are skipped if the others cannot be fitted; if all are, the
    last error is raised. FinloopError as in `gait.fit.fit_gait`.
    """
    check_phases(film)
    scheme, masks = choose_held_out_frames(film)
    rows: list[dict[str, Any]] = []
    problem: FinloopError | None = None
    for mask in masks:
        try:
            rows += list(_held_out_errors(film, mask, split, wavelet, coarse))
        except FinloopError as error:
            problem = error
    if problem is not None and not rows:
        raise problem
    _, subcycles = correct_key_frames(film, split, wavelet, coarse)
    table = pd.DataFrame(rows).groupby(_KEYS, sort=False).sum().reset_index()
    contours = table[table["scale"] == _WHOLE].drop(columns="scale").reset_index(drop=True)
    total = contours["frames"].sum()
    rms = {c: float(np.sqrt(contours[c].sum() / total)) / film.body_length for c in CLOCKS}
    for c in CLOCKS:
        contours[f"rms_{c}"] = np.sqrt(contours.pop(c) / contours["frames"]) / film.body_length
    scales = table[table["scale"] != _WHOLE].reset_index(drop=True)
    return ClockComparison(scheme, rms, contours, _errors_by_scale(film, scales, subcycles))


def _held_out_errors(
    film: GaitContours, mask: Mask, split: float, wavelet: str, coarse: int
) -> Iterator[dict[str, Any]]:
    """Yield a table row for each contour, subcycle and scale: the clocks' summed squared errors.

    mask (frames,): frames held out of the fit; split, wavelet, coarse as in `compare_clocks`. The
    scale _WHOLE stands for all scales together.
    """
    still = LEAST_MOTION * film.body_length
    _, subcycles = correct_key_frames(_select_frames(film, ~mask), split, wavelet, coarse)
    per_limb, per_scale = (fit_all_gammas(subcycles, per, still) for per in (False, True))
    tests = sort_into_subcycles(_select_frames(film, mask), split, wavelet, coarse)
    for (name, sub), model in subcycles.items():
        test = tests[name][sub]
        if not len(test.tau):
            continue
        size, letter = len(model.end), "AB"[sub]
        spread = gamma_per_coefficient(per_scale[name][letter], size, coarse)
        f = _fit_free_clock(model, test.tau)[:, None, None]
        predictions = {
            "linear": model.predict(test.tau, np.zeros(1)),
            "gamma": model.predict(test.tau, np.array(per_limb[name][letter])),
            "gamma_scale": model.predict(test.tau, spread),
            "free": model.end + f * (model.start - model.end),
        }
        errors = {clock: test.coefficients - frames for clock, frames in predictions.items()}
        parts = {
            _WHOLE: {c: contour_from_descriptor(errors[c], size, wavelet, coarse) for c in CLOCKS}
        }
        for number, scale in enumerate(model.scales):
            parts[number] = {c: errors[c][:, scale] for c in CLOCKS}
        for number, part in parts.items():
            squares = {c: float((part[c] ** 2).sum()) / size for c in CLOCKS}
            keys = dict(zip(_KEYS, (name, letter, number), strict=True))
            yield keys | {"frames": len(test.tau)} | squares


def _select_frames(film: GaitContours, mask: Mask) -> GaitContours:
    """Return a film's contours and phases in the frames of a mask (frames,) only."""
    contours = {name: points[mask] for name, points in film.contours.items()}
    return replace(film, phase=film.phase[mask], contours=contours)


def _fit_free_clock(model: Subcycle, tau: Points) -> Points:
    """Fit how the first key frame's share falls in a subcycle, in any way: values (s,) at tau (s,).

    tau: shares 0-1 of the subcycle. The fit is an isotonic regression, the best clock possible.
    """
    change = (model.start - model.end).ravel()
    norm = float(change @ change)
    samples = model.samples
    if norm == 0 or not len(samples.tau):
        return 1 - tau
    order = np.argsort(samples.tau, kind="stable")
    flat = (samples.coefficients - model.end).reshape(len(order), -1)
    falling = scipy.optimize.isotonic_regression(flat[order] @ change / norm, increasing=False).x
    nodes = np.concatenate([[0.0], samples.tau[order], [1.0]])
    return np.interp(tau, nodes, np.concatenate([[1.0], np.clip(falling, 0, 1), [0.0]]))


def _errors_by_scale(
    film: GaitContours, table: pd.DataFrame, subcycles: dict[tuple[str, int], Subcycle]
) -> pd.DataFrame:
    """Summarise squared errors by wavelet scale: the table `ClockComparison.by_scale`.

    subcycles: those fitted to all frames, by contour id and 0 for A, 1 for B.
    """
    gammas, share, count = [], [], []
    for name, letter, m in table[_KEYS].itertuples(index=False):
        model = subcycles[name, "AB".index(letter)]
        change, scale = model.start - model.end, model.scales[m]
        gammas.append(model.gammas(True, LEAST_MOTION * film.body_length)[m])
        share.append(float((change[scale] ** 2).sum() / max((change**2).sum(), 1e-300)))
        count.append(scale.stop - scale.start)
    linear, gamma_scale, frames = table["linear"], table["gamma_scale"], table["frames"]
    rms_linear = np.sqrt(linear / frames) / film.body_length
    gain = (linear - gamma_scale) / linear.where(linear > 0)
    verdict = np.select(
        [rms_linear < LEAST_ERROR, gain > LEAST_GAIN, gain < -LEAST_GAIN],
        ["not seen", "buys", "costs"],
        "buys nothing",
    )
    return table[_KEYS].assign(
        coefficients=count,
        gamma=gammas,
        energy_share=share,
        rms_linear=rms_linear,
        rms_gamma_scale=np.sqrt(gamma_scale / frames) / film.body_length,
        gamma_buys_pct=(100 * gain).fillna(0.0),
        verdict=verdict,
    )
