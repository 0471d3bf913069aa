"""The best set of joins between tracks, and how probable each join is."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats

_NEVER = -1e6  # log weight of a join that cannot be
_DRAWS = 200  # a probability is a share of so many


class Joins(NamedTuple):
    """For each track (n,) the one before it, −1 for none, and the probability of that."""

    before: NDArray[np.intp]
    probability: Floats


def best(log_ratio: Floats, strangers: float, least: float, rng: np.random.Generator) -> Joins:
    """The set of joins that is most probable as a whole; every track has at most one on each side.

    log_ratio (n, n): of a join from track a to track b, −∞ where it cannot be. strangers: how often
    an animal comes or goes. A join less probable than `least` is left out.

    The probability of a join is its share of the best sets when all scores are disturbed by noise
    (perturb and maximise: Papandreou and Yuille, Perturb-and-MAP random fields, ICCV 2011). Noise
    of a join is the mean of two Gumbel variables, one for each of its tracks.
    """
    n = len(log_ratio)
    alone = np.full((2, n), np.log(strangers))
    before = _set(log_ratio, alone)
    times = np.zeros(n)
    for _ in range(_DRAWS):
        noise = rng.gumbel(size=(2, n, n)).mean(0)
        times += before == _set(log_ratio + noise, alone + rng.gumbel(size=(2, n)))
    probability = np.where(before >= 0, times / _DRAWS, 1.0)
    sure = probability >= least
    return Joins(np.where(sure, before, -1), np.where(sure, probability, 1.0))


def _set(score: Floats, alone: Floats) -> NDArray[np.intp]:
    """The track before each (n,), −1 for none, in the set of joins with the highest score.

    alone (2, n): score of an end, and of a start, without a join.
    """
    n = len(score)
    weight = np.full((n, 2 * n), _NEVER)
    weight[:, :n] = np.maximum(score - alone[1], _NEVER)
    weight[np.arange(n), n + np.arange(n)] = alone[0]
    ends, starts = scipy.optimize.linear_sum_assignment(weight, maximize=True)
    before = np.full(n, -1)
    joined = starts < n
    before[starts[joined]] = ends[joined]
    return before
