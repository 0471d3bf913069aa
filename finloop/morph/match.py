"""Corresponding points of two curves: start point and direction (curve paper §4.1).

Both curves have n points of equal arc length. The second curve is renumbered so that its points lie
nearest to those of the first, least Σ ‖a_i − b_i‖². The candidates are all start points (n if
closed, 1 if open), in both directions unless both curves are closed and simple. Both curves are
centred on their mean, so their position does not matter.
"""

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, area, resample_curve
from finloop.morph.folds import is_simple


def match_curves(a: Curve, b: Curve, n: int) -> tuple[Floats, Floats]:
    """Return points (n, 2) of both curves at equal distances along them, matched row by row.

    The order of a is kept, b is renumbered. FinloopError if one is closed and the other open.
    """
    if a.closed != b.closed:
        kinds = ["closed" if curve.closed else "open" for curve in (a, b)]
        raise FinloopError(
            f"a curve that is {kinds[0]} and one that is {kinds[1]}",
            "two closed curves or two open ones",
            "close the open curve, open the closed curve, or omit the pair",
        )
    first, second = resample_curve(a, n).points, resample_curve(b, n).points
    if a.closed:
        return first, best_start(first, second)
    return first, min((second, second[::-1]), key=lambda points: _far(first, points))


def best_start(first: Floats, second: Floats) -> Floats:
    """Return a closed polygon (n, 2) renumbered to lie nearest to another, row by row.

    The result is `second` or its reverse, from its best start point on; positions do not matter.
    """
    fits = [(misfit(first, points), points) for points in _directions(first, second)]
    far, points = min(fits, key=lambda fit: fit[0].min())
    return np.roll(points, -int(far.argmin()), axis=0)


def _directions(first: Floats, second: Floats) -> tuple[Floats, ...]:
    """Return the directions to try: if simple curves turn opposite ways, the morph folds."""
    if not (is_simple(first) and is_simple(second)):
        return second, second[::-1]
    return (second if area(Curve(first, True)) * area(Curve(second, True)) > 0 else second[::-1],)


def misfit(first: Floats, second: Floats) -> Floats:
    """Return, for each start point s, how badly polygon b fits a: Σ_i ‖a_i − b_{i+s}‖².

    first, second (n, 2): closed polygons a, b, which are centred first. The result is (n,).
    """
    a, b = ((points - points.mean(axis=0)) @ [1, 1j] for points in (first, second))
    product = np.fft.ifft(np.fft.fft(b) * np.fft.fft(a).conj()).real
    return (abs(a) ** 2).sum() + (abs(b) ** 2).sum() - 2 * product


def _far(first: Floats, second: Floats) -> float:
    return float(((first - first.mean(axis=0) - second + second.mean(axis=0)) ** 2).sum())
