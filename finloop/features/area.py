"""Measure the motion area: how much a fish is bent (fish paper §2.2, Fig. 2).

Six control points on the backbone - head end, 1/6, 1/3, 1/2, 5/6, tail end - make a closed uniform
cubic B-spline. The area it encloses grows with the bend. A straight fish encloses nothing.

The area is exact, not counted in pixels. By Green's theorem it is ½∮(x dy − y dx); with
x = Σ xᵢ B(t − i) it becomes a sum over pairs of control points, and B vanishes four knots away:

    area = ½ Σᵢ Σₖ₌₁..₃ gₖ (pᵢ × pᵢ₊ₖ),   gₖ = 2 ∫ B(t) B′(t − k) dt,   p × q = pₓ q_y − p_y qₓ
"""

import numpy as np
import scipy

from finloop.base.arrays import Floats, Reals

CONTROL_ARCS = np.array([0, 1 / 6, 1 / 3, 1 / 2, 5 / 6, 1])
"""Where the control points lie on the backbone, as shares of its length (§2.2)."""


_G = np.array([245, 56, 1]) / 360  # gₖ for k = 1, 2, 3


def control_points(backbone: Reals) -> Floats:
    """Return the six control points (rows, 6, 2) of backbones (rows, n, 2), from head to tail.

    They lie at the shares `CONTROL_ARCS` of the length; the n points must be evenly spaced.
    """
    return interpolate_lines(backbone, CONTROL_ARCS * (backbone.shape[1] - 1))


def interpolate_lines(lines: Reals, places: Floats) -> Floats:
    """Return the points (rows, k, 2) of lines (rows, n, 2) at k positions, counted in points.

    places (k,): counted in points, 0 … n − 1; 2.5 is half way between points 2 and 3.
    """
    before = np.minimum(places.astype(int), lines.shape[1] - 2)
    share = (places - before)[:, None]
    return (1 - share) * lines[:, before] + share * lines[:, before + 1]


def signed_spline_area(control: Reals) -> Floats:
    """Return the signed area (rows,) [px²] that closed cubic B-splines enclose.

    control: (rows, m, 2) px, the control points of uniform splines. Positive where the curve runs
    anticlockwise as seen on screen (y down). For a fish, whose points run from head to tail, that
    is a bend to its right; see `measure_bend`.
    """
    x, y = control[..., 0], control[..., 1]
    total = np.zeros(control.shape[:-2])
    for k, g in enumerate(_G, start=1):  # the sum of the module's docstring; B-spline weights gₖ
        total += g * (x * np.roll(y, -k, -1) - y * np.roll(x, -k, -1)).sum(-1)
    return -0.5 * total


def closed_spline_points(control: Reals, points_per_knot: int = 16) -> Floats:
    """Return points (m · points_per_knot, 2) along a closed cubic B-spline.

    control (m, 2): its control points, in the unit of the result.
    """
    m = len(control)
    # Uniform knots; the first three control points again at the end close the curve.
    spline = scipy.interpolate.BSpline(np.arange(m + 7.0), np.vstack([control, control[:3]]), 3)
    return spline(np.linspace(3, m + 3, m * points_per_knot, endpoint=False))


def measure_bend(backbone: Reals, length_px: Reals) -> Floats:
    """Return how much each fish is bent (rows,), in squared body lengths, + = to its left.

    This is the signed motion area: the area enclosed by the spline of six points on the backbone;
    `motion_area` of the feature table is its absolute value. backbone: (rows, n, 2) px, from head
    to tail; length_px: (rows,), body lengths.
    """
    return -signed_spline_area(control_points(backbone)) / length_px**2
