"""Contours of a gait as wavelet descriptors, and frames between two key frames (curve paper §4.2).

*coarse* is the number of coefficients in the approximation, at any number of points. So scale m
means the same for contours of 64 and of 256 points, and γ per scale fits both. An open contour is
mirrored: 2n points, 2 `coarse` coefficients in the approximation.
"""

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.curve.wavelet import (
    close_by_mirroring,
    drop_details,
    inverse_transform,
    most_levels,
    scales,
    wavelet_transform,
)
from finloop.gait.clock import clock


def levels_of(n: int, coarse: int, closed: bool = True) -> int:
    """Return how many halvings reduce n points to `coarse` approximation coefficients.

    For an open contour, n counts the mirrored points, and 2 `coarse` coefficients remain.
    FinloopError if n or `coarse` is no power of two.
    """
    return max(0, most_levels(n) - most_levels(2 * coarse) + 1 - (0 if closed else 1))


def descriptor(points: Points, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Return the wavelet coefficients of contours (…, n, 2): closed (…, n, 2), open (…, 2n, 2).

    coarse: number of coefficients in the approximation, a power of two.
    """
    points = points if closed else close_by_mirroring(points)
    return wavelet_transform(points, wavelet, levels_of(points.shape[-2], coarse, closed))


def contour(coefficients: Points, n: int, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Return contours (…, n, 2) from their wavelet coefficients: the inverse of `descriptor`."""
    levels = levels_of(coefficients.shape[-2], coarse, closed)
    return inverse_transform(coefficients, wavelet, levels)[..., :n, :]


def scale_slices(n: int, coarse: int, closed: bool = True) -> list[slice]:
    """Return the slice of each scale in the n coefficients of `descriptor`, coarse to fine.

    n: for an open contour, twice its points.
    """
    return scales(n, levels_of(n, coarse, closed))


def per_coefficient(gamma: tuple[float, ...], n: int, coarse: int, closed: bool = True) -> Points:
    """Return γ for each of n coefficients, (n,), from one γ per scale, coarse to fine.

    The last γ holds for all finer scales.
    """
    out = np.empty(n)
    for m, scale in enumerate(scale_slices(n, coarse, closed)):
        out[scale] = gamma[min(m, len(gamma) - 1)]
    return out


def interpolate_contours(
    start: Points,
    end: Points,
    tau: Points,
    gamma: tuple[float, ...],
    wavelet: str,
    coarse: int,
    closed: bool = True,
) -> Points:
    """Return frames (f, n, 2) between two contours (n, 2): c(τ) = c_to + f(τ) (c_from − c_to).

    tau (f,): shares 0-1 of the way; gamma: one γ per scale, coarse to fine, or a single one. A
    single γ moves every coefficient, and so every point, alike: no transform is needed.
    """
    if len(gamma) == 1:
        return end + clock(tau, gamma[0])[:, None, None] * (start - end)
    step = descriptor(start - end, wavelet, coarse, closed)
    weights = clock(tau[:, None], per_coefficient(gamma, len(step), coarse, closed))
    return end + contour(weights[..., None] * step, len(end), wavelet, coarse, closed)


def few_control(points: Points, control: int, wavelet: str, closed: bool = True) -> Points:
    """Return contours (…, n, 2) rebuilt from only `control` control points each (Fig. 14).

    FinloopError if n or `control` is no power of two, or `control` is above n.
    """
    if control < 1 or control & (control - 1):
        raise FinloopError(
            f"{control} control points", "a power of two", "set 4, 16 or 64 control points"
        )
    level = most_levels(points.shape[-2]) - most_levels(2 * control) + 1
    if level < 0:
        raise FinloopError(
            f"{control} control points for contours of {points.shape[-2]} points",
            "at most as many control points as points",
            "set fewer control points, or give the contours more points",
        )
    return drop_details(points, wavelet, level, closed) if level else points
