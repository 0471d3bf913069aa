"""Corresponding points of two curves: start point and direction (curve paper §4.1).

Both curves have n points of equal arc length. The second curve is renumbered so that its points lie
nearest to those of the first, least Σ ‖a_i − b_i‖². The candidates are all start points (n if
closed, 1 if open), in both directions unless both curves are closed and simple. Both curves are
centred on their mean, so their position does not matter.
"""

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, resample_curve, signed_area
from finloop.morph.folds import is_simple


def match_curves(a: Curve, b: Curve, n: int) -> tuple[Floats, Floats]:
    """Return two curves as n points at equal distances, (n, 2) each; rows correspond.

    The order of a is kept. b is renumbered, and perhaps reversed, so that the points lie nearest to
    those of a. FinloopError if one is closed and the other open.
    """
    if a.closed != b.closed:
        kinds = ["closed" if curve.closed else "open" for curve in (a, b)]
        raise FinloopError(
            f"a curve that is {kinds[0]} and one that is {kinds[1]}",
            "two closed curves or two open ones",
            "close the open curve, open the closed curve, or omit the pair",
        )
    first, second = resample_curve(a, n).points, resample_curve(b, n).points
    directions = [second, second[::-1]]
    if not a.closed:
        centred = first - first.mean(axis=0)

        def misfit(points: Floats) -> float:
            """Return the summed squared distances of curve b's points from a's, about the means."""
            return float(((centred - points + points.mean(axis=0)) ** 2).sum())

        return first, min(directions, key=misfit)
    if is_simple(first) and is_simple(second):  # if they turned opposite ways, the morph would fold
        areas = [signed_area(Curve(points, closed=True)) for points in (first, second)]
        opposite = areas[0] * areas[1] <= 0
        directions = directions[1:] if opposite else directions[:1]
    misfits = [misfit_by_start(first, points) for points in directions]
    best = int(np.argmin([misfit.min() for misfit in misfits]))
    start = int(misfits[best].argmin())
    return first, np.roll(directions[best], -start, axis=0)


def misfit_by_start(first: Floats, second: Floats) -> Floats:
    """Return how badly polygon b fits a from each of its points s on: Σ_i ‖a_i − b_{i+s}‖², (n,).

    first, second (n, 2): closed polygons a, b, which are centred first.
    """
    a, b = ((points - points.mean(axis=0)) @ [1, 1j] for points in (first, second))
    product = np.fft.ifft(np.fft.fft(b) * np.fft.fft(a).conj()).real
    return (abs(a) ** 2).sum() + (abs(b) ** 2).sum() - 2 * product
