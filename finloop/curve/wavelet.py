"""Transform curves by periodized wavelets (curve paper §2, Eqs. 2.1–2.12), many at once.

Glossary: *n* points of a curve, a power of two; *levels* how often the transform halves; *scale* a
run of n / 2^m coefficients. One array of n holds the coefficients, coarse to fine (the order of
q_w, §3.2): the approximation c^M, the details d^M of the same scale, then d of each finer scale.

PyWavelets transforms, in its mode "periodization"; compared with Eq. 2.8 this only renumbers the
coefficients. A filter longer than a scale is folded round it (Eq. 2.7).
"""

from functools import cache
from math import comb

import numpy as np
import pywt

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError

CUBIC = "cubic"
"""The biorthogonal cubic B-spline wavelet of Fig. 2, which PyWavelets lacks: its bior3.* use the
quadratic spline, its bior4.4 uses no spline."""

_MODE = "periodization"  # of PyWavelets: curves are closed


# --- filters


@cache
def find_wavelet(name: str) -> pywt.Wavelet:
    """Return the wavelet of a name, with its filters.

    FinloopError if the name is unknown, or the wavelet's filters do not reconstruct a curve.
    """
    if name == CUBIC:
        return pywt.Wavelet(CUBIC, _cubic_spline_filters())
    if name not in pywt.wavelist(kind="discrete"):
        raise FinloopError(
            f"the wavelet {name!r}",
            f"{CUBIC} or a discrete wavelet of PyWavelets",
            "choose db4, coif2, sym8, bior4.4, …: pywt.wavelist(kind='discrete') lists them",
        )
    if name == "dmey":  # its infinite filters are cut off
        raise FinloopError(
            "the filters of the wavelet dmey lose 0.7 % of a curve",
            "filters that reconstruct it",
            "choose another wavelet, such as db4, coif2 or sym8",
        )
    return pywt.Wavelet(name)


def _cubic_spline_filters() -> Floats:
    """Return the filters (4, 12) of the biorthogonal cubic spline with 4 + 4 vanishing moments.

    Rows are analysis low and high, synthesis low and high. As functions of the frequency ξ the low
    filters are cos⁴(ξ/2) Σ_k C(3 + k, k) sin^2k(ξ/2), k = 0 … 3, for analysis and cos⁴(ξ/2) for
    synthesis, times √2 (Cohen, Daubechies and Feauveau 1992).
    """
    spline = np.array([1, 4, 6, 4, 1]) / 16  # cos⁴(ξ/2)
    sine = np.array([-1, 2, -1]) / 4  # sin²(ξ/2)
    dual, sine_power = np.zeros(7), np.ones(1)
    for k in range(4):
        dual[3 - k : 4 + k] += comb(3 + k, k) * sine_power
        sine_power = np.convolve(sine_power, sine)
    analysis_low, synthesis_low = np.zeros((2, 12))
    analysis_low[1:] = np.sqrt(2) * np.convolve(spline, dual)
    synthesis_low[3:8] = np.sqrt(2) * spline
    sign = (-1.0) ** np.arange(12)
    return np.stack([analysis_low, -sign * synthesis_low, synthesis_low, sign * analysis_low])


# --- the transform


def count_halvings(n: int) -> int:
    """Return how many times n points can be halved; FinloopError if n is no power of two."""
    if n < 2 or n & (n - 1):
        raise FinloopError(
            f"a curve of {n} points", "a power of two, at least 2", "resample it to 64, 128, 256 …"
        )
    return n.bit_length() - 1


def wavelet_for_transform(name: str, n: int, levels: int) -> pywt.Wavelet:
    """Return the wavelet of a name, if it can transform n points over so many levels.

    FinloopError if n is no power of two, n cannot be halved `levels` times, or the wavelet is
    longer than the curve: then no coefficient would be local.
    """
    wavelet, most_levels = find_wavelet(name), count_halvings(n)
    if not 0 <= levels <= most_levels:
        raise FinloopError(
            f"{levels} levels for a curve of {n} points",
            f"0 to {most_levels} levels",
            "set fewer levels",
        )
    if levels and wavelet.dec_len > n:
        raise FinloopError(
            f"the wavelet {name} has {wavelet.dec_len} taps, the curve {n} points",
            "a wavelet no longer than the curve",
            "resample the curve to more points, or use a shorter wavelet",
        )
    return wavelet


def scale_slices(n: int, levels: int) -> list[slice]:
    """Return the slice of each scale in n wavelet coefficients: levels + 1 of them.

    The approximation comes first, then the details from coarse to fine.
    """
    coarse = n >> levels
    return [slice(0, coarse), *(slice(coarse << m, coarse << (m + 1)) for m in range(levels))]


def wavelet_transform(points: Floats, wavelet: str, levels: int) -> Floats:
    """Return the wavelet coefficients (…, n, k) of closed curves (…, n, k) (Eq. 2.8).

    The transform runs along n; k is 2 for plane curves. The approximation comes first, then the
    details from coarse to fine. levels: how often the points are halved. FinloopError if n cannot
    be halved so often, or the wavelet is longer than the curve.
    """
    filters = wavelet_for_transform(wavelet, points.shape[-2], levels)
    approximation, scales = np.array(points, np.float64), list[Floats]()
    for _ in range(levels):
        approximation, details = pywt.dwt(approximation, filters, _MODE, axis=-2)
        scales.insert(0, details)
    return np.concatenate([approximation, *scales], axis=-2)


def inverse_transform(coefficients: Floats, wavelet: str, levels: int) -> Floats:
    """Return the points (…, n, k) that have given wavelet coefficients (…, n, k) (Eq. 2.9).

    This undoes `wavelet_transform` with the same wavelet and levels. FinloopError if n cannot be
    halved so often, or the wavelet is longer than the curve.
    """
    n = coefficients.shape[-2]
    filters = wavelet_for_transform(wavelet, n, levels)
    approximation, *scales = scale_slices(n, levels)
    points = np.array(coefficients[..., approximation, :], np.float64)
    for details in scales:
        points = pywt.idwt(points, coefficients[..., details, :], filters, _MODE, axis=-2)
    return points


def close_by_mirroring(points: Floats) -> Floats:
    """Return closed curves (…, 2n, k) that run along open ones (…, n, k) there and back.

    A periodized transform joins the last point to the first: a jump in an open curve, which would
    pull its ends towards each other.
    """
    return np.concatenate([points, points[..., ::-1, :]], axis=-2)


def control_points(points: Floats, wavelet: str, level: int) -> Floats:
    """Return the control points (…, n / 2^level, k), a coarse version, of closed curves (…, n, k).

    They are the approximation coefficients of Eq. 2.11, divided by √2 for each level, as the
    filters multiply a constant by that.
    """
    coefficients = wavelet_transform(points, wavelet, level)
    return coefficients[..., : points.shape[-2] >> level, :] / 2 ** (level / 2)


def curves_from_control(points: Floats, wavelet: str, level: int) -> Floats:
    """Return the smooth closed curves (…, n · 2^level, k) that control points (…, n, k) make.

    All their details are 0, so `control_points` returns the same control points.
    """
    coarse = points.shape[-2]
    coefficients = np.zeros((*points.shape[:-2], coarse << level, points.shape[-1]))
    coefficients[..., :coarse, :] = points * 2 ** (level / 2)
    return inverse_transform(coefficients, wavelet, level)


def drop_details(points: Floats, wavelet: str, level: int, closed: bool = True) -> Floats:
    """Return curves (…, n, k) without details, rebuilt from n / 2^level control points (Fig. 2).

    closed: whether the curves are closed; open ones are mirrored first. FinloopError if the points
    cannot be halved `level` times, or the wavelet is longer than the curve.
    """
    if not closed:
        return drop_details(close_by_mirroring(points), wavelet, level)[..., : points.shape[-2], :]
    return curves_from_control(control_points(points, wavelet, level), wavelet, level)
