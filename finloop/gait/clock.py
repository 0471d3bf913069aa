"""The clock f(τ) of a subcycle and its γ by least squares (curve paper §4.2, Fig. 11).

Between the key frames c_from and c_to of a subcycle the model is

    c(τ) = c_to + f(τ) d,   d = c_from − c_to,   f(τ) = 1 − (1 + γ)τ + γτ² = (1 − τ) − γ τ(1 − τ).

The model is linear in γ, so least squares over frames y has a closed form:

    γ = −Σ τ(1 − τ) ⟨d, y − c_to − (1 − τ) d⟩ / Σ τ²(1 − τ)² ‖d‖²
"""

from collections.abc import Iterable

import numpy as np

from finloop.base.arrays import Points


def clock(tau: Points, gamma: float | Points) -> Points:
    """Return how much of the first key frame is left at tau, f(τ) = 1 − (1 + γ)τ + γτ² (§4.2).

    tau: shares 0-1 of a subcycle. f falls from 1 at τ = 0 to 0 at τ = 1; γ = 0 is linear. It is
    monotone if |γ| ≤ 1: slow at its start for γ = −1, at its end for γ = 1.
    """
    return 1 - (1 + gamma) * tau + gamma * tau**2


def gamma_sums(tau: Points, frames: Points, start: Points, end: Points) -> tuple[float, float]:
    """Return the numerator and denominator of γ by least squares, for frames of one subcycle.

    tau (s,): shares 0-1 of the subcycle; frames (s, k): their coordinates; start, end (k,): of the
    key frames.
    """
    way = start - end
    bow = tau * (1 - tau)
    rest = (frames - end) @ way - (1 - tau) * float(way @ way)
    return -float(bow @ rest), float(bow @ bow) * float(way @ way)


def gamma_fit(sums: Iterable[tuple[float, float]]) -> float:
    """Return the γ that fits one or more sets of frames together, from their `gamma_sums`.

    Sets that move more count more. γ is 0 if nothing moves, or no frame lies between the keys.
    """
    above, below = np.sum([*sums], axis=0)
    return float(above / below) if below > 0 else 0.0
