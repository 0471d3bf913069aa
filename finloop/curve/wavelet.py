"""The periodized wavelet transform of curves (curve paper §2, Eqs. 2.1–2.12), batched.

Glossary: *n* points of a curve, a power of two; *levels* how often the transform halves; *scale* a
run of n / 2^m coefficients. Coefficients stand in one array of n, coarse to fine (the order of
q_w, §3.2): the approximation c^M, the details d^M of the same scale, then d of each finer one.

The filters stand where PyWavelets' mode "periodization" puts them, so that coefficients compare;
against Eq. 2.8 that only renumbers them. A filter longer than a scale is folded round it (Eq. 2.7).
"""

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.curve.filters import filter_bank


def most_levels(n: int) -> int:
    """How often n points can be halved. FinloopError if n is no power of two."""
    if n < 2 or n & (n - 1):
        raise FinloopError(
            f"a curve of {n} points", "a power of two, at least 2", "resample it to 64, 128, 256 …"
        )
    return n.bit_length() - 1


def check(n: int, wavelet: str, levels: int) -> Floats:
    """The filters, if they can take n points `levels` times.

    FinloopError if n is no power of two or cannot be halved so often, or the wavelet is longer than
    the curve: then no coefficient would be local.
    """
    bank, most = filter_bank(wavelet), most_levels(n)
    if not 0 <= levels <= most:
        raise FinloopError(
            f"{levels} levels of a curve of {n} points", f"0 to {most} levels", "ask for fewer"
        )
    if levels and bank.shape[1] > n:
        raise FinloopError(
            f"the wavelet {wavelet} has {bank.shape[1]} taps, the curve {n} points",
            "a wavelet no longer than the curve",
            "resample the curve to more points, or take a shorter wavelet",
        )
    return bank


def scales(n: int, levels: int) -> list[slice]:
    """Where the approximation, then each scale of details stands among n coefficients."""
    coarse = n >> levels
    return [slice(0, coarse), *(slice(coarse << m, coarse << m + 1) for m in range(levels))]


def forward(points: Floats, wavelet: str, levels: int) -> Floats:
    """Eq. 2.8: coefficients of points (…, n, k), along n; k is 2 for curves.

    FinloopError as `check`.
    """
    bank = check(points.shape[-2], wavelet, levels)
    out = np.array(points, np.float64, order="C")
    # Written as Σ_i w[i] x[2n + i − before], the sum of Eq. 2.8 runs forward.
    _analyse(out.reshape(-1, *points.shape[-2:]), bank[:2, ::-1].copy(), levels)
    return out


def back(coefficients: Floats, wavelet: str, levels: int) -> Floats:
    """Eq. 2.9, the inverse of `forward`. FinloopError as `check`."""
    bank = check(coefficients.shape[-2], wavelet, levels)
    out = np.array(coefficients, np.float64, order="C")
    _synthesise(out.reshape(-1, *coefficients.shape[-2:]), bank[2:].copy(), levels)
    return out


@kernel
def _spread(padded, source, half, k, first):  # type: ignore[no-untyped-def]
    """Fill `padded` with rows of `source` (half · k,) from row `first` on, periodically."""
    start = (first % half) * k
    size = half * k
    for i in range(len(padded)):
        index = start + i
        while index >= size:
            index -= size
        padded[i] = source[index]


@kernel
def _analyse(curves, filters, levels):  # type: ignore[no-untyped-def]
    """`forward` in place, curves (b, n, k), filters (2, taps).

    Even and odd samples are kept apart: every tap then adds one run of numbers to another, which
    compilers make fast whatever k is.
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
                _spread(padded[p, : (half + last - first) * k], split[p], half, k, first)
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
def _synthesise(curves, filters, levels):  # type: ignore[no-untyped-def]
    """`back` in place, curves (b, n, k), filters (2, taps)."""
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
                _spread(padded[p, : (half + last - first) * k], source, half, k, first)
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
    """Run an open curve (…, n, k) there and back, (…, 2n, k): closed, and without a jump.

    A periodized transform joins the last point to the first. Of an open curve that join is a jump,
    and coarse scales would draw the ends towards each other.
    """
    return np.concatenate([points, points[..., ::-1, :]], axis=-2)


def control(points: Floats, wavelet: str, level: int) -> Floats:
    """The n / 2^level approximation coefficients of (…, n, k) as control points of the plane.

    In the unit of the points: a coefficient of Eq. 2.11 divided by √2 a level, what the filters
    make of a constant.
    """
    coarse = points.shape[-2] >> level
    return forward(points, wavelet, level)[..., :coarse, :] / 2 ** (level / 2)


def from_control(points: Floats, wavelet: str, level: int) -> Floats:
    """The curve (…, n · 2^level, k) of control points (…, n, k): the details are 0."""
    coarse = points.shape[-2]
    out = np.zeros((*points.shape[:-2], coarse << level, points.shape[-1]))
    out[..., :coarse, :] = points * 2 ** (level / 2)
    return back(out, wavelet, level)


def drop_details(points: Floats, wavelet: str, level: int, closed: bool = True) -> Floats:
    """Rebuild curves (…, n, k) from 1/2^level of their samples (Fig. 2), without the details.

    Open curves are `close_by_mirroring` for it. FinloopError as `check`.
    """
    if not closed:
        return drop_details(close_by_mirroring(points), wavelet, level)[..., : points.shape[-2], :]
    return from_control(control(points, wavelet, level), wavelet, level)
