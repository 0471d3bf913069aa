"""Two of the paper's morphs: linear (curve paper Eq. 4.1, Fig. 4) and physical (Fig. 5).

Neither checks whether a frame meets itself: `morph.folds.folds` does.
"""

import numpy as np

from finloop.base.arrays import Points
from finloop.curve.contour import Curve
from finloop.curve.dynamics import Material, Problem, solve
from finloop.curve.wavelet import close_by_mirroring, control_points, curves_from_control
from finloop.morph.match import match_curves

FADE = 0.25
"""Final share of the time, in which the remaining motion fades out: the last frame is b."""


def linear(
    a: Curve, b: Curve, frames: int, points: int, level: int | None = None, wavelet: str = "coif2"
) -> Points:
    """Return frames (frames, points, 2) of the linear morph from a to b (Eq. 4.1), ends included.

    A(τ) = (1 − τ) Aˢ + τ Aᵈ, with A the points of both curves. With a level, A are the control
    points for 1/2^level of the points, so the ends are coarse versions of the curves, and `points`
    is a power of two. FinloopError if one curve is open and the other closed, or, with a level, as
    in `curve.wavelet.check_transform`.
    """
    ends = np.stack(match_curves(a, b, points))
    tau = np.linspace(0, 1, frames)[:, None, None]
    if level is None:
        return (1 - tau) * ends[0] + tau * ends[1]
    coarse = control_points(ends if a.closed else close_by_mirroring(ends), wavelet, level)
    return curves_from_control((1 - tau) * coarse[0] + tau * coarse[1], wavelet, level)[:, :points]


def physical(
    a: Curve, b: Curve, frames: int, points: int, elastic: float, damping: float, mass: float
) -> Points:
    """Return frames (frames, points, 2) of b, bent into the shape of a and released (Fig. 5).

    The last frame is b. The motion is ρ ü + c u̇ + K u = 0 (Eq. 3.3) in a time of 1, ρ = mass, c =
    damping, K of e₀ = elastic. Mode m of a closed curve swings m √(e₀/ρ) times, of an open curve
    half as often. With little damping the curve overshoots, with much it creeps, without mass it
    does not swing.

    Stiffness does not depend on position, so the mean of the points moves as the slowest mode does.
    FinloopError if one curve is open and the other closed, `points` is no power of two, or mass and
    damping are both 0.
    """
    shape, rest = match_curves(a, b, points)
    offset = shape - rest
    place = offset.mean(axis=0)
    offset = offset - place if a.closed else close_by_mirroring(offset - place)
    slowest = np.cos(2 * np.pi * (np.arange(len(offset)) + 0.5) / len(offset))
    material = Material(mass, elastic, damping / mass if mass > 0 else damping, 0.0)
    times = np.linspace(0, 1, frames)
    start = np.column_stack([offset, slowest])
    modes = solve(Problem(np.zeros_like(start), start, material, times)).displacement
    course = modes[:, 0, 2] / slowest[0]
    swing = modes[:, :points, :2] + course[:, None, None] * place
    fade = np.clip((1 - times) / FADE, 0, 1)
    return rest + (fade**2 * (3 - 2 * fade))[:, None, None] * swing
