"""Corresponding points of two curves: start point and direction (curve paper §4.1).

Both curves have n points of equal arc length. The second curve is renumbered so that its points lie
nearest to those of the first, least Σ ‖a_i − b_i‖². The candidates are all start points (n if
closed, 1 if open), in both directions unless both curves are closed and simple. Both curves are
centred on their mean, so their position does not matter.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, resample_curve, signed_area
from finloop.curve.wavelet import drop_details, find_wavelet
from finloop.morph.folds import is_simple

LEAST_CONTROL = 4
"""Fewest control points of a contour: fewer make a point or a line of it."""


class Resolution(NamedTuple):
    """How coarse contours are: each is rebuilt from 1/2^level of its points (Eq. 2.11, Fig. 2).

    At level 0 contours keep all their points. wavelet: of the control points, and of the stiffness.
    """

    level: int = 0
    wavelet: str = "coif2"

    def reduce_curves(self, points: Floats, closed: bool) -> Floats:
        """Return curves (…, n, 2) at this resolution; FinloopError if n points have no such one."""
        self.check(points.shape[-2])
        return drop_details(points, self.wavelet, self.level, closed) if self.level else points

    def check(self, points: int) -> None:
        """Raise FinloopError if there is no such wavelet, or no such level of so many points."""
        find_wavelet(self.wavelet)
        if self.level and (self.level < 0 or points >> self.level < LEAST_CONTROL):
            most = max(0, (points // LEAST_CONTROL).bit_length() - 1)
            raise FinloopError(
                f"level {self.level} of contours of {points} points",
                f"0 to {most}: a contour needs {LEAST_CONTROL} control points",
                "set a lower level, or more points",
            )


FULL = Resolution()
"""All points of a contour."""


def match_curves(
    a: Curve, b: Curve, n: int, resolution: Resolution = FULL
) -> tuple[Floats, Floats]:
    """Return two curves as n points at equal distances, (n, 2) each; rows correspond.

    The order of a is kept. b is renumbered, and perhaps reversed, so that the points lie nearest to
    those of a. Then both lose the details that `resolution` leaves out. FinloopError if one curve
    is closed and the other open, or the resolution does not exist for n points.
    """
    first, second = resolution.reduce_curves(np.stack(_number_points_alike(a, b, n)), a.closed)
    return first, second


def _number_points_alike(a: Curve, b: Curve, n: int) -> tuple[Floats, Floats]:
    """Return two curves as n points at equal distances, (n, 2) each, those of b renumbered."""
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
