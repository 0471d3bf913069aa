"""The distance between the distributions of two samples."""

import numpy as np

from finloop.base.arrays import Floats


def wasserstein_distance(a: Floats, b: Floats) -> float:
    """Return the Wasserstein distance of samples a (n,) and b (m,), ∫ |F_a(x) − F_b(x)| dx.

    F(x) is the share of a sample that is at most x. The result has the unit of the samples. This
    replaces `scipy.stats`, which takes 0.6 s to import.
    """
    values = np.sort(np.concatenate([a, b]), kind="stable")
    share_a = np.searchsorted(np.sort(a), values[:-1], side="right") / len(a)
    share_b = np.searchsorted(np.sort(b), values[:-1], side="right") / len(b)
    return float(np.sum(np.abs(share_a - share_b) * np.diff(values)))
