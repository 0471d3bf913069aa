"""The true γ of the drawn dog, from its exact contours (curve paper §4.2)."""

import numpy as np

from finloop.drawn.dog.walk import NAMES, DogFilm, limb_contours_at
from finloop.gait.model import gamma_fraction, gamma_from_fractions

QUADRATURE = 401


def true_gamma(dog: DogFilm, n: int = 256) -> dict[str, dict[str, float]]:
    """Return the true gait parameters γ of the drawn dog, by limb and subcycle ("A", "B").

    n: points of a contour. It is the least-squares γ of the exact contours. It differs a little
    from the γ of the foot's clock (`gammas`), as points move on arcs and the body bobs.
    """
    tau = np.linspace(0, 1, QUADRATURE)
    out = dict[str, dict[str, float]]()
    for name in NAMES:
        out[name] = {}
        for which, label in enumerate("AB"):
            # The last phase belongs to this quarter: the foot lands in it.
            phase = (which + np.minimum(tau, 1 - 1e-12)) / 4
            c = limb_contours_at(dog, name, phase, n).reshape(len(tau), -1)
            out[name][label] = gamma_from_fractions([gamma_fraction(tau, c, c[0], c[-1])])
    return out
