"""The exact phase of key 1 in a walk: where the feet turn round (curve paper §4.2, Fig. 9).

The fundamental of a walk gives its period well, but not the phase at which the feet turn: a foot on
the ground moves evenly, a lifted foot does not. In a gait of four subcycles every foot moves along
four parabolas joined at the keys. So the keys are where four parabolas fit all feet best.
"""

from collections.abc import Mapping

import numpy as np
import scipy

from finloop.base.arrays import Floats
from finloop.gait.model import subcycle

FOOT = 16  # the lowest 1/FOOT of a limb's contour is its foot
REACH = 0.06  # cycles: half width of the search for key 1
STEPS = 61


def foot_positions(limbs: Mapping[str, Floats]) -> Floats:
    """Return how far ahead each foot is, (frames, limbs): x, in the unit of the contours, or NaN.

    limbs: contours (frames, n, 2) by id, x ahead and y down. A foot is the lowest 1/FOOT of the
    points.
    """
    return np.stack([_foot(points) for points in limbs.values()], axis=1)


def _foot(points: Floats) -> Floats:
    low = np.argsort(-np.nanmean(points[..., 1], axis=0), kind="stable")
    return points[:, low[: max(1, len(low) // FOOT)], 0].mean(axis=1)


def align_phase(phase: Floats, ahead: Floats, split: float) -> Floats:
    """Return the phase (frames,), shifted and stretched so that the feet turn round at the keys.

    phase: in cycles; ahead (frames, k): how far ahead k feet are; split: phase of key 2. Least
    squares over the shift, at most about REACH, and the stretch. Rows with NaN are ignored.
    """
    whole = np.isfinite(ahead).all(axis=1)
    if whole.sum() < 12:  # the fit has eight numbers per foot
        return phase
    phases, way = phase[whole], ahead[whole] - ahead[whole].mean(axis=0)
    middle = float(phases.mean())

    def off(change: Floats) -> float:
        return _fit_residual(phases - change[0] + change[1] * (phases - middle), way, split)

    moves = np.linspace(-REACH, REACH, STEPS)
    first = float(moves[np.argmin([off(np.array([move, 0.0])) for move in moves])])
    best = scipy.optimize.minimize(
        off,
        (first, 0.0),
        method="Nelder-Mead",
        options={
            "initial_simplex": [(first, 0.0), (first + 0.004, 0.0), (first, 0.003)],
            "xatol": 1e-5,
            "fatol": 1e-12 * float((way**2).sum()),
        },
    ).x
    return phase - best[0] + best[1] * (phase - middle)


def _fit_residual(phase: Floats, way: Floats, split: float) -> float:
    """Return the squared residual of four parabolas, joined at the keys, fitted to (frames, k)."""
    which, tau = subcycle(phase, split)
    terms, row = np.zeros((len(phase), 8)), np.arange(len(phase))
    terms[row, which] = 1 - tau
    terms[row, (which + 1) % 4] = tau
    terms[row, 4 + which] = tau * (1 - tau)
    left = way - terms @ np.linalg.lstsq(terms, way, rcond=None)[0]
    return float((left**2).sum())
