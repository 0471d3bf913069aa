"""Contours as wavelet descriptors for gaits, and the clock that moves them (curve paper §4.2).

*coarse* is the number of coefficients in the approximation, whatever the number of points: scale m
of contours of 64 and of 256 points then means the same, and γ per scale goes from one to another.
Open contours are taken there and back, 2n points, with twice `coarse` in the approximation.
"""

import numpy as np
from numpy.typing import NDArray

from finloop.curve.wavelet import back, forward, mirrored, most_levels, scales, truncated
from finloop.errors import FinloopError

Points = NDArray[np.float64]


def levels_of(n: int, coarse: int, closed: bool = True) -> int:
    """Levels of a transform of n points that leave `coarse` in the approximation.

    `n` counts an open contour's points there and back, and twice `coarse` are left of those.

    Raises
    ------
    FinloopError
        If n is no power of two.
    """
    return max(0, most_levels(n) - most_levels(2 * coarse) + 1 - (0 if closed else 1))


def descriptor(points: Points, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Coefficients of contours (…, n, 2), an open one there and back (…, 2n, 2).

    Raises
    ------
    FinloopError
        As `curve.wavelet.check`.
    """
    points = points if closed else mirrored(points)
    return forward(points, wavelet, levels_of(points.shape[-2], coarse, closed))


def contour(coefficients: Points, n: int, wavelet: str, coarse: int, closed: bool = True) -> Points:
    """Contours (…, n, 2) of `descriptor` coefficients, its inverse."""
    levels = levels_of(coefficients.shape[-2], coarse, closed)
    return back(coefficients, wavelet, levels)[..., :n, :]


def scale_slices(n: int, coarse: int, closed: bool = True) -> list[slice]:
    """Where each scale stands among the n coefficients of `descriptor`, coarse to fine."""
    return scales(n, levels_of(n, coarse, closed))


def per_coefficient(gamma: tuple[float, ...], n: int, coarse: int, closed: bool = True) -> Points:
    """γ (n,) of each coefficient, from one per scale."""
    out = np.empty(n)
    for m, where in enumerate(scale_slices(n, coarse, closed)):
        out[where] = gamma[min(m, len(gamma) - 1)]
    return out


def clock(tau: Points, gamma: float | Points) -> Points:
    """f(τ) = 1 − (1 + γ)τ + γτ²: from 1 at τ = 0 to 0 at τ = 1; γ = 0 is linear (§4.2).

    Monotone if |γ| ≤ 1: slow at its start for γ = −1, at its end for γ = 1.
    """
    return 1 - (1 + gamma) * tau + gamma * tau**2


def between(
    source: Points,
    to: Points,
    tau: Points,
    gamma: tuple[float, ...],
    wavelet: str,
    coarse: int,
    closed: bool = True,
) -> Points:
    """Frames (f, n, 2) between two contours (n, 2): c(τ) = c_to + f(τ) (c_from − c_to).

    One γ moves every coefficient alike and so every point: no transform is needed then.
    """
    if len(gamma) == 1:
        return to + clock(tau, gamma[0])[:, None, None] * (source - to)
    step = descriptor(source - to, wavelet, coarse, closed)
    weights = clock(tau[:, None], per_coefficient(gamma, len(step), coarse, closed))
    return to + contour(weights[..., None] * step, len(to), wavelet, coarse, closed)


def few_control(points: Points, control: int, wavelet: str, closed: bool = True) -> Points:
    """Contours (…, n, 2) rebuilt from `control` of their n control points (Fig. 14).

    Raises
    ------
    FinloopError
        If n or control is no power of two, or control is above n.
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
    return truncated(points, wavelet, level, closed) if level else points
