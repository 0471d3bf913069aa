"""The periodized wavelet transform of curves (curve paper §2, Eqs. 2.1–2.12), batched.

Glossary: *n* points of a curve, a power of two; *levels* how often the transform halves; *scale* a
run of n / 2^m coefficients. One array of n holds the coefficients, coarse to fine (the order of
q_w, §3.2): the approximation c^M, the details d^M of the same scale, then d of each finer scale.

The filters are aligned as in PyWavelets' mode "periodization", so that coefficients agree; compared
with Eq. 2.8 this only renumbers them. A filter longer than a scale is folded round it (Eq. 2.7).
"""

from functools import cache
from math import comb

import numpy as np
import pywt

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel

CUBIC = "cubic"
"""The biorthogonal cubic B-spline wavelet of Fig. 2, which PyWavelets lacks: its bior3.* use the
quadratic spline, its bior4.4 uses no spline."""

LOSSLESS = 1e-13  # largest loss of filters that reconstruct a curve

_FREE = 1e-9  # relative size of singular values whose directions reduce no loss (from coif10 on)
_TOLERANCE = (
    1e-9  # largest loss of tabled filters (sym*, bior4.4, …); truncated dmey loses far more
)


# --- filters


@cache
def filter_bank(wavelet: str) -> Floats:
    """Return a wavelet's four filters (4, taps): analysis low, high, then synthesis low, high.

    wavelet: CUBIC or a discrete wavelet of PyWavelets, such as "db4". FinloopError if the wavelet
    is unknown, or its filters do not reconstruct a curve.
    """
    if wavelet == CUBIC:
        bank = _cubic_spline_filters()
    elif wavelet in pywt.wavelist(kind="discrete"):
        bank = np.array(pywt.Wavelet(wavelet).filter_bank)
    else:
        raise FinloopError(
            f"the wavelet {wavelet!r}",
            f"{CUBIC} or a discrete wavelet of PyWavelets",
            "choose db4, coif2, sym8, bior4.4, …: pywt.wavelist(kind='discrete') lists them",
        )
    if _reconstruction_loss(bank) < _TOLERANCE:
        bank = _make_lossless(bank)
    loss = _reconstruction_loss(bank)
    if loss > LOSSLESS:
        raise FinloopError(
            f"the filters of the wavelet {wavelet} lose {loss:.1g} of a curve",
            f"filters that reconstruct it to {LOSSLESS:g}",
            "choose another wavelet, such as db4, coif2 or sym8",
        )
    bank.setflags(write=False)
    return bank


def _cubic_spline_filters() -> Floats:
    """Return filters (4, taps) of the biorthogonal cubic spline with 4 + 4 vanishing moments."""
    # Low filters are cos⁴(ξ/2) and cos⁴(ξ/2) Σ_k C(3 + k, k) sin^2k(ξ/2), k = 0 … 3 (Cohen,
    # Daubechies and Feauveau 1992).
    spline = np.array([1, 4, 6, 4, 1]) / 16  # cos⁴(ξ/2)
    sine = np.array([-1, 2, -1]) / 4  # sin²(ξ/2)
    dual, sine_power = np.zeros(7), np.ones(1)
    for k in range(4):
        dual[3 - k : 4 + k] += comb(3 + k, k) * sine_power
        sine_power = np.convolve(sine_power, sine)
    low_filters = np.zeros((2, 12))
    low_filters[0, 1:] = np.sqrt(2) * np.convolve(spline, dual)
    low_filters[1, 3:8] = np.sqrt(2) * spline
    sign = (-1.0) ** np.arange(12)
    return np.stack([low_filters[0], -sign * low_filters[1], low_filters[1], sign * low_filters[0]])


def _make_lossless(bank: Floats) -> Floats:
    """Return the nearest filters (4, taps) that reconstruct a curve exactly.

    Σ_i s[i] a[taps − 1 − i + 2k] = δ_k0 for synthesis s and analysis a, by Newton steps of least
    norm. The filters of an orthogonal wavelet stay mirror images of each other. For a biorthogonal
    wavelet only the analysis changes, so the synthesis keeps its spline.
    """
    taps = bank.shape[1]
    orthogonal = np.allclose(bank[2], bank[0, ::-1], rtol=0, atol=_TOLERANCE)
    lag = 2 * np.arange(-(taps // 2 - 1), taps // 2)[:, None] + np.arange(taps)
    has_tap = (lag >= 0) & (lag < taps)
    unit = (np.arange(-(taps // 2 - 1), taps // 2) == 0).astype(float)
    dual, low = bank[0, ::-1].copy(), bank[2].copy()
    for _ in range(3):
        if orthogonal:
            low = dual
        factors = np.where(has_tap, low[lag * has_tap], 0)
        deviation = unit - factors @ dual
        if orthogonal:  # both factors move
            factors = factors + factors[::-1]
        dual = dual + np.linalg.lstsq(factors, deviation, rcond=_FREE)[0]
    if orthogonal:
        low = dual
    sign = (-1.0) ** np.arange(taps)
    return np.stack([dual[::-1], -sign * low, low, sign * dual[::-1]])


def _reconstruction_loss(bank: Floats) -> float:
    """Return how much of a signal four filters (4, taps) lose; 0 = they only delay it."""
    taps = bank.shape[1]
    parts = []
    for phase in (0, 1):  # even samples, odd samples
        total = np.zeros(2 * taps)
        for analysis, synthesis in ((bank[0], bank[2]), (bank[1], bank[3])):
            phase_taps = np.where(np.arange(taps) % 2 == phase, synthesis, 0)
            total[:-1] += np.convolve(phase_taps, analysis)
        total[taps - 1] -= 1  # the delayed signal itself; what is left is lost
        parts.append(np.abs(total).sum())
    return max(parts)


# --- the transform


def count_halvings(n: int) -> int:
    """Return how many times n points can be halved; FinloopError if n is no power of two."""
    if n < 2 or n & (n - 1):
        raise FinloopError(
            f"a curve of {n} points", "a power of two, at least 2", "resample it to 64, 128, 256 …"
        )
    return n.bit_length() - 1


def filters_for_transform(n: int, wavelet: str, levels: int) -> Floats:
    """Return a wavelet's filters (4, taps), if they can transform a curve of n points.

    FinloopError if n is no power of two, n cannot be halved `levels` times, or the wavelet is
    longer than the curve: then no coefficient would be local.
    """
    bank, most_levels = filter_bank(wavelet), count_halvings(n)
    if not 0 <= levels <= most_levels:
        raise FinloopError(
            f"{levels} levels for a curve of {n} points",
            f"0 to {most_levels} levels",
            "set fewer levels",
        )
    if levels and bank.shape[1] > n:
        raise FinloopError(
            f"the wavelet {wavelet} has {bank.shape[1]} taps, the curve {n} points",
            "a wavelet no longer than the curve",
            "resample the curve to more points, or use a shorter wavelet",
        )
    return bank


def scale_slices(n: int, levels: int) -> list[slice]:
    """Return which of n wavelet coefficients belong to each scale: levels + 1 slices.

    The approximation comes first, then the details from coarse to fine.
    """
    coarse = n >> levels
    return [slice(0, coarse), *(slice(coarse << m, coarse << m + 1) for m in range(levels))]


def wavelet_transform(points: Floats, wavelet: str, levels: int) -> Floats:
    """Return the wavelet coefficients (…, n, k) of curves of points (…, n, k) (Eq. 2.8).

    The transform runs along n; k is 2 for plane curves. The approximation comes first, then the
    details from coarse to fine. levels: how often the points are halved. FinloopError if n cannot
    be halved so often, or the wavelet is longer than the curve.
    """
    bank = filters_for_transform(points.shape[-2], wavelet, levels)
    coefficients = np.array(points, np.float64, order="C")
    # Written as Σ_i w[i] x[2n + i − before], the sum of Eq. 2.8 runs forward.
    _transform_in_place(coefficients.reshape(-1, *points.shape[-2:]), bank[:2, ::-1].copy(), levels)
    return coefficients


def inverse_transform(coefficients: Floats, wavelet: str, levels: int) -> Floats:
    """Return the points (…, n, k) of wavelet coefficients (…, n, k) (Eq. 2.9).

    This undoes `wavelet_transform` with the same wavelet and levels. FinloopError if n cannot be
    halved so often, or the wavelet is longer than the curve.
    """
    bank = filters_for_transform(coefficients.shape[-2], wavelet, levels)
    points = np.array(coefficients, np.float64, order="C")
    _invert_in_place(points.reshape(-1, *coefficients.shape[-2:]), bank[2:].copy(), levels)
    return points


@kernel
def _fill_periodically(padded, source, half, k, first):  # type: ignore[no-untyped-def]
    """Fill `padded` with rows of `source` from row `first` on, beginning again after its last row.

    source (half · k,): `half` rows of k numbers each.
    """
    start = (first % half) * k
    size = half * k
    for i in range(len(padded)):
        index = start + i
        while index >= size:
            index -= size
        padded[i] = source[index]


@kernel
def _transform_in_place(curves, filters, levels):  # type: ignore[no-untyped-def]
    """Replace curves (b, n, k) by their wavelet coefficients, with filters (2, taps).

    filters: low and high; levels: how often the points are halved. Even and odd samples (p = 0, 1)
    are stored separately, from sample `first` to `half + last` of the periodic curve. Every tap
    then adds one run of numbers to another, which compilers make fast for every k.
    """
    count, n, k = curves.shape
    taps = filters.shape[1]
    before = taps // 2 - 1
    first = -((before + 1) // 2)
    last = (taps - 1 - before) // 2
    split = np.empty((2, n // 2 * k))
    padded = np.empty((2, (n // 2 + last - first) * k))
    for c in range(count):
        curve = curves[c].reshape(-1)
        half = n
        for _ in range(levels):
            half //= 2
            size = half * k
            for r in range(half):
                for j in range(k):
                    split[0, r * k + j] = curve[2 * r * k + j]
                    split[1, r * k + j] = curve[(2 * r + 1) * k + j]
            for p in range(2):
                _fill_periodically(padded[p, : (half + last - first) * k], split[p], half, k, first)
            low, high = curve[:size], curve[size : 2 * size]
            low[:] = 0.0
            high[:] = 0.0
            for i in range(taps):
                p = (i - before) % 2
                start = ((i - before - p) // 2 - first) * k
                run = padded[p, start : start + size]
                a, b = filters[0, i], filters[1, i]
                for j in range(size):
                    low[j] += a * run[j]
                    high[j] += b * run[j]


@kernel
def _invert_in_place(curves, filters, levels):  # type: ignore[no-untyped-def]
    """Replace wavelet coefficients (b, n, k) by their curves, with filters (2, taps).

    This undoes `_transform_in_place`. `padded` holds the approximation (p = 0) and the details
    (p = 1) of a scale, continued periodically; `split` the even and odd points that they give.
    """
    count, n, k = curves.shape
    taps = filters.shape[1]
    before = taps // 2 - 1
    first = -(taps // 2)
    last = taps // 2
    split = np.empty((2, n // 2 * k))
    padded = np.empty((2, (n // 2 + last - first) * k))
    for c in range(count):
        curve = curves[c].reshape(-1)
        half = n >> levels
        for _ in range(levels):
            size = half * k
            for p in range(2):
                source = curve[p * size : (p + 1) * size]
                _fill_periodically(padded[p, : (half + last - first) * k], source, half, k, first)
            split[:, :size] = 0.0
            for i in range(taps):
                p = (i - before) % 2
                start = (-((i - before - p) // 2) - first) * k
                low, high = padded[0, start : start + size], padded[1, start : start + size]
                a, b = filters[0, i], filters[1, i]
                out = split[p]
                for j in range(size):
                    out[j] += a * low[j] + b * high[j]
            for r in range(half):
                for j in range(k):
                    curve[2 * r * k + j] = split[0, r * k + j]
                    curve[(2 * r + 1) * k + j] = split[1, r * k + j]
            half *= 2


def close_by_mirroring(points: Floats) -> Floats:
    """Append the reverse to open curves (…, n, k), which gives closed curves (…, 2n, k).

    A periodized transform joins the last point to the first: a jump in an open curve, which would
    pull its ends towards each other.
    """
    return np.concatenate([points, points[..., ::-1, :]], axis=-2)


def control_points(points: Floats, wavelet: str, level: int) -> Floats:
    """Return the control points (…, n / 2^level, k) of closed curves (…, n, k), a coarse version.

    They are the approximation coefficients of Eq. 2.11, divided by √2 for each level, the factor by
    which the filters scale a constant.
    """
    coarse = points.shape[-2] >> level
    return wavelet_transform(points, wavelet, level)[..., :coarse, :] / 2 ** (level / 2)


def curves_from_control(points: Floats, wavelet: str, level: int) -> Floats:
    """Return the smooth closed curves (…, n · 2^level, k) of control points (…, n, k).

    All details are 0; this inverts `control_points` for curves without details.
    """
    coarse = points.shape[-2]
    out = np.zeros((*points.shape[:-2], coarse << level, points.shape[-1]))
    out[..., :coarse, :] = points * 2 ** (level / 2)
    return inverse_transform(out, wavelet, level)


def drop_details(points: Floats, wavelet: str, level: int, closed: bool = True) -> Floats:
    """Rebuild curves (…, n, k) from 1/2^level as many control points (Fig. 2).

    closed: False mirrors open curves first. FinloopError if the points cannot be halved `level`
    times, or the wavelet is longer than the curve.
    """
    if not closed:
        return drop_details(close_by_mirroring(points), wavelet, level)[..., : points.shape[-2], :]
    return curves_from_control(control_points(points, wavelet, level), wavelet, level)
