"""Filters of wavelets (Eqs. 2.1–2.2): PyWavelets' tables, made exact; the spline of Fig. 2."""

from functools import cache
from math import comb

import numpy as np
import pywt

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError

CUBIC = "cubic"
"""The biorthogonal cubic B-spline wavelet of Fig. 2, which PyWavelets lacks: its bior3.* use the
quadratic spline, its bior4.4 uses no spline."""

LOSSLESS = 1e-13  # largest loss of filters that reconstruct a curve

_FREE = 1e-9  # relative size of singular values whose directions reduce no loss (from coif10 on)
_TOLERANCE = (
    1e-9  # largest loss of tabled filters (sym*, bior4.4, …); truncated dmey loses far more
)


@cache
def filter_bank(wavelet: str) -> Floats:
    """Return a wavelet's four filters, one a row: analysis low, high, synthesis low, high.

    wavelet: CUBIC or a discrete wavelet of PyWavelets, such as "db4". The result is (4, taps), in
    PyWavelets' order. FinloopError if the wavelet is unknown, or its filters do not reconstruct a
    curve.
    """
    if wavelet == CUBIC:
        bank = _cubic_spline()
    elif wavelet in pywt.wavelist(kind="discrete"):
        bank = np.array(pywt.Wavelet(wavelet).filter_bank)
    else:
        raise FinloopError(
            f"the wavelet {wavelet!r}",
            f"{CUBIC} or a discrete wavelet of PyWavelets",
            "choose db4, coif2, sym8, bior4.4, …: pywt.wavelist(kind='discrete') lists them",
        )
    if _loss(bank) < _TOLERANCE:
        bank = _exact(bank)
    loss = _loss(bank)
    if loss > LOSSLESS:
        raise FinloopError(
            f"the filters of the wavelet {wavelet} lose {loss:.1g} of a curve",
            f"filters that reconstruct it to {LOSSLESS:g}",
            "choose another wavelet, such as db4, coif2 or sym8",
        )
    bank.setflags(write=False)
    return bank


def _cubic_spline() -> Floats:
    """Return Cohen–Daubechies–Feauveau filters of the cubic spline, 4 + 4 vanishing moments."""
    spline = np.array([1, 4, 6, 4, 1]) / 16  # cos⁴(ξ/2)
    sine = np.array([-1, 2, -1]) / 4  # sin²(ξ/2)
    dual, power = np.zeros(7), np.ones(1)
    for k in range(4):
        dual[3 - k : 4 + k] += comb(3 + k, k) * power
        power = np.convolve(power, sine)
    low = np.zeros((2, 12))
    low[0, 1:] = np.sqrt(2) * np.convolve(spline, dual)
    low[1, 3:8] = np.sqrt(2) * spline
    sign = (-1.0) ** np.arange(12)
    return np.stack([low[0], -sign * low[1], low[1], sign * low[0]])


def _exact(bank: Floats) -> Floats:
    """Return the nearest filters that reconstruct: Σ_i s[i] a[taps − 1 − i + 2k] = δ_k0.

    Newton steps of least norm. The filters of an orthogonal wavelet stay mirror images of each
    other. For a biorthogonal wavelet only the analysis changes, so the synthesis keeps its spline.
    """
    taps = bank.shape[1]
    orthogonal = np.allclose(bank[2], bank[0, ::-1], rtol=0, atol=_TOLERANCE)
    shift = 2 * np.arange(-(taps // 2 - 1), taps // 2)[:, None] + np.arange(taps)
    inside = (shift >= 0) & (shift < taps)
    unit = (np.arange(-(taps // 2 - 1), taps // 2) == 0).astype(float)
    dual, low = bank[0, ::-1].copy(), bank[2].copy()
    for _ in range(3):
        if orthogonal:
            low = dual
        slope = np.where(inside, low[shift * inside], 0)
        missing = unit - slope @ dual
        if orthogonal:  # both factors move
            slope = slope + slope[::-1]
        dual = dual + np.linalg.lstsq(slope, missing, rcond=_FREE)[0]
    if orthogonal:
        low = dual
    sign = (-1.0) ** np.arange(taps)
    return np.stack([dual[::-1], -sign * low, low, sign * dual[::-1]])


def _loss(bank: Floats) -> float:
    """Return how far analysis plus synthesis is from a pure delay, summed over both filters."""
    taps = bank.shape[1]
    parts = []
    for phase in (0, 1):  # even samples, odd samples
        total = np.zeros(2 * taps)
        for analysis, synthesis in ((bank[0], bank[2]), (bank[1], bank[3])):
            phase_taps = np.where(np.arange(taps) % 2 == phase, synthesis, 0)
            total[:-1] += np.convolve(phase_taps, analysis)
        total[taps - 1] -= 1
        parts.append(np.abs(total).sum())
    return max(parts)
