"""How well scores distinguish two kinds of windows: ROC curve, area, and interval.

The area (AUC) is the probability that an animation window has a higher score than a film window
(ties count one half): 1/2 = not at all. Each block has a classifier of its own, and scores of two
classifiers are not compared: A = Σ_k w_k A_k, where A_k is the area of block k and w_k its share of
all pairs.

The interval is that of Obuchowski (1997), "Nonparametric analysis of clustered ROC curve data",
Biometrics 53: DeLong's components, summed by cluster, because windows that overlap or follow each
other are not independent. It takes the classifiers as given. But every two blocks test each other's
classifier: chance that both share counts in both areas, which doubles the variance where the truth
is 1/2. (For a linear classifier A − 1/2 ∝ Σ_k Σ_(j≠k) d_k d_j, where d are the chance deviations of
blocks; simulated processes agree, `test_realism.py`.) So the error is √2 that of Obuchowski. The
interval is computed on the scale of log(A / (1 − A)), so that it stays between 0 and 1 (Pepe 2003,
"The Statistical Evaluation of Medical Tests", §5.2).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Floats, Ints, Mask

_Z = 1.959964  # normal deviate of a 95 % interval
_INFLATION = 2.0  # of the variance, where every two blocks test each other's classifier


class Auc(NamedTuple):
    """How well a classifier distinguishes film and animation: the area under its ROC curve.

    low, high: the ends of the 95 % interval of that area, `value`.
    """

    value: float
    low: float
    high: float


class Scores(NamedTuple):
    """A classifier's held-out scores of n windows; a higher score is more like animation.

    animation (n,): True for animation, False for film. block (n,): number of the classifier that
    gave the score. cluster (n,): windows with the same number are not independent. NaN scores do
    not count.
    """

    score: Floats
    animation: Mask
    block: Ints
    cluster: Ints

    @property
    def pair_count(self) -> int:
        """Return the number of pairs of a film window and an animation window."""
        return int(self.animation.sum()) * int((~self.animation).sum())

    def split_by_block(self) -> Iterator["Scores"]:
        """Yield the scores, without NaN, of each block with both film and animation windows."""
        for number in np.unique(self.block):
            in_block = (self.block == number) & np.isfinite(self.score)
            block_scores = Scores(*(column[in_block] for column in self))
            if 0 < block_scores.animation.sum() < len(block_scores.animation):
                yield block_scores


def compute_auc(scores: Scores) -> Auc:
    """Return the area under the ROC curve, with its 95 % interval (method: see the module's text).

    An area of 0.5: film and animation are not distinguishable. It is the mean of the blocks' areas,
    weighted by their pairs of a film and an animation window. Deviations of the windows of one
    cluster are summed before they are squared, as they are not independent. At least one block must
    contain both film and animation windows.
    """
    blocks = list(scores.split_by_block())
    areas, deviations = zip(*map(_measure_area, blocks), strict=True)
    pairs = np.array([block.pair_count for block in blocks])
    weights = pairs / pairs.sum()
    value = float(weights @ areas)
    # The standard error, from the sums of the clusters over all blocks.
    weighted = [weight * by_cluster for weight, by_cluster in zip(weights, deviations, strict=True)]
    sums = pd.concat(weighted).groupby(level=0).sum().to_numpy()
    # Where every two blocks test each other's classifier, the variance is larger: inflation.
    clusters, inflation = max(len(sums), 2), _INFLATION if len(areas) > 1 else 1.0
    error = float(np.sqrt(inflation * clusters / (clusters - 1) * (sums**2).sum()))
    if not 0.0 < value < 1.0:  # its logarithm of odds is infinite: no interval
        return Auc(value, value, value)
    half_width = _Z * error / (value * (1 - value))  # on the scale of the logarithm of odds
    ends = scipy.special.logit(value) + np.array([-half_width, half_width])
    low, high = scipy.special.expit(ends)
    return Auc(value, float(low), float(high))


def _measure_area(block: Scores) -> tuple[float, pd.Series]:
    """Return a block's area under the ROC curve, and the deviations of its windows by cluster.

    Deviations are summed by cluster. A window's deviation is DeLong's component minus the area,
    divided by the number of windows of its kind. The component is the share of the window's pairs
    in which the animation scores higher.
    """
    film, animation = block.score[~block.animation], block.score[block.animation]
    above_share = np.empty(len(block.score))
    above_share[block.animation] = _share_below(animation, film)
    above_share[~block.animation] = 1.0 - _share_below(film, animation)
    area = float(above_share[block.animation].mean())
    count = np.where(block.animation, len(animation), len(film))
    return area, pd.Series((above_share - area) / count).groupby(block.cluster).sum()


def _share_below(values: Floats, others: Floats) -> Floats:
    """Return for each of n values the share of m others that are below it; ties count one half."""
    ordered = np.sort(others)
    twice = np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right")
    return twice / (2 * len(others))


def compute_roc(scores: Scores, points: int = 51) -> pd.DataFrame:
    """Return the ROC curve as a table of `points` rows: the weighted mean of the blocks' curves.

    A block's weight is its number of pairs of a film and an animation window. Columns, both 0 … 1:
    false_alarms, the share of film windows classified as animation; hits, the share of animation
    windows recognised. At least one block must contain both kinds of windows.
    """
    alarms, blocks, curves = np.linspace(0, 1, points), list(scores.split_by_block()), []
    for block in blocks:
        film, animation = np.sort(block.score[~block.animation]), block.score[block.animation]
        thresholds = np.unique(block.score)[::-1]
        alarm_share = 1 - np.searchsorted(film, thresholds, "left") / len(film)
        hit_share = 1 - np.searchsorted(np.sort(animation), thresholds, "left") / len(animation)
        curves.append(np.interp(alarms, np.r_[0, alarm_share], np.r_[0, hit_share]))
    pairs = [block.pair_count for block in blocks]
    return pd.DataFrame({"false_alarms": alarms, "hits": np.average(curves, 0, weights=pairs)})
