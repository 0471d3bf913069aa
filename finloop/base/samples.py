"""How far two samples of numbers are apart."""

import numpy as np

from finloop.base.arrays import Floats


def wasserstein_distance(a: Floats, b: Floats) -> float:
    """Return the Wasserstein distance of two samples (n,), (m,): the area between their CDFs.

    `scipy.stats` has the same, and takes 0.6 s to import, in every process of a dozen stages.
    """
    values = np.sort(np.concatenate([a, b]), kind="stable")
    below = (np.searchsorted(np.sort(one), values[:-1], side="right") / len(one) for one in (a, b))
    share, other = below
    return float(np.sum(np.abs(share - other) * np.diff(values)))
