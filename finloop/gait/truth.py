"""Compute the true γ of the drawn dog from its exact contours (curve paper §4.2)."""

import numpy as np

from finloop.drawn.dog.walk import NAMES, DogFilm, limb_contours_at
from finloop.gait.model import gamma_fraction, gamma_from_fractions

QUADRATURE = 401


def true_gamma(dog: DogFilm, n: int = 256) -> dict[str, dict[str, float]]:
    """Return the drawn dog's true gait parameters γ, by limb and subcycle ("A", "B").

    They are fitted by least squares to the exact contours, of n points, at QUADRATURE moments. They
    differ a little from γ of the foot's own motion (`foot_gammas`), as points move on arcs and the
    body bobs.
    """
    tau = np.linspace(0, 1, QUADRATURE)
    gammas = dict[str, dict[str, float]]()
    for name in NAMES:
        gammas[name] = {}
        for number, letter in enumerate("AB"):
            # The last moment, too, belongs to this quarter of the cycle: the foot lands in it.
            phase = (number + np.minimum(tau, 1 - 1e-12)) / 4
            contours = limb_contours_at(dog, name, phase, n).reshape(len(tau), -1)
            fraction = gamma_fraction(tau, contours, contours[0], contours[-1])
            gammas[name][letter] = gamma_from_fractions([fraction])
    return gammas
