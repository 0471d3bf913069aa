"""Contours of a gait as wavelet descriptors, and frames between two key frames (curve paper §4.2).

*coarse* is the number of coefficients in the approximation, whatever the number of points. So
scale m means the same for contours of 64 and of 256 points, and γ per scale fits both. An open
contour is mirrored, its points there and back: 2n points, 2 `coarse` coefficients in the
approximation.
"""

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.curve.wavelet import (
    back,
    close_by_mirroring,
    drop_details,
    forward,
    most_levels,
    scales,
)
from finloop.gait.clock import clock


def levels_of(n: int, coarse: int, closed: bool = True) -> int:
    """Levels of a transform of n points that leave `coarse` coefficients in the approximation.

    For an open contour `n` counts the points of its mirrored form, and 2 `coarse` are left.
    FinloopError if n is no power of two.
    """
    return max(0, most_levels(n) - most_levels(2 * coarse) + 1 - (0 if closed else 1))


def descriptor(points: Points, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Coefficients of contours (…, n, 2); of open ones (…, 2n, 2), mirrored.

    FinloopError as `curve.wavelet.check`.
    """
    points = points if closed else close_by_mirroring(points)
    return forward(points, wavelet, levels_of(points.shape[-2], coarse, closed))


def contour(coefficients: Points, n: int, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Contours (…, n, 2) from their coefficients: the inverse of `descriptor`."""
    levels = levels_of(coefficients.shape[-2], coarse, closed)
    return back(coefficients, wavelet, levels)[..., :n, :]


def scale_slices(n: int, coarse: int, closed: bool = True) -> list[slice]:
    """Slice of each scale in the n coefficients of `descriptor`, coarse to fine."""
    return scales(n, levels_of(n, coarse, closed))


def per_coefficient(gamma: tuple[float, ...], n: int, coarse: int, closed: bool = True) -> Points:
    """γ (n,) of each coefficient, from one per scale."""
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
    """Return frames (f, n, 2) between contours (n, 2): c(τ) = c_to + f(τ) (c_from − c_to).

    A single γ moves every coefficient, and so every point, alike: then no transform is needed.
    """
    if len(gamma) == 1:
        return end + clock(tau, gamma[0])[:, None, None] * (start - end)
    step = descriptor(start - end, wavelet, coarse, closed)
    weights = clock(tau[:, None], per_coefficient(gamma, len(step), coarse, closed))
    return end + contour(weights[..., None] * step, len(end), wavelet, coarse, closed)


def few_control(points: Points, control: int, wavelet: str, closed: bool = True) -> Points:
    """Contours (…, n, 2) rebuilt from `control` of their n control points (Fig. 14).

    FinloopError if n or control is no power of two, or control is above n.
    """
    if control < 1 or control & (control - 1):
        raise FinloopError(
            f"{control} control points", "a power of two", "ask for 4, 16 or 64 control points"
        )
    level = most_levels(points.shape[-2]) - most_levels(2 * control) + 1
    if level < 0:
        raise FinloopError(
            f"{control} control points of contours of {points.shape[-2]} points",
            "no more control points than points",
            "ask for fewer control points, or for more points",
        )
    return drop_details(points, wavelet, level, closed) if level else points
