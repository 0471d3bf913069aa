"""A classifier of film and animation, trained and tested block by block; its important channels.

Gradient-boosted trees over histograms (scikit-learn; Ke et al. 2017, LightGBM). Both kinds weigh
the same, however many windows they have.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from finloop.base.arrays import Mask
from finloop.realism.auc import Scores
from finloop.realism.settings import Settings
from finloop.realism.windows import CHANNELS, Windows, joined

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


class Answers(NamedTuple):
    """Held-out scores, of film windows first; `shuffled`: the same with one channel shuffled."""

    scores: Scores
    shuffled: dict[str, Scores]


@threadpool_limits.wrap(limits=1)  # of so little data threads are slower, and in each other's way
def answers(film: Windows, swum: Windows, p: Settings, channels: tuple[int, ...]) -> Answers:
    """The held-out scores of all windows, by classifiers that see these channels alone.

    A block whose classifier would have only one kind to learn from gives no scores (NaN).
    """
    both = joined([film, swum])
    animation = np.arange(len(both)) >= len(film)
    x = both.x[..., list(channels)]
    score = np.full(len(both), np.nan)
    shuffled = {CHANNELS[channel]: score.copy() for channel in channels}
    rng = np.random.default_rng(p.seed)
    for block in range(both.near.shape[1]):
        learn, test = ~both.near[:, block], both.block == block
        if not (test.any() and 0 < animation[learn].sum() < learn.sum()):
            continue
        model = fit(x[learn], animation[learn], p)
        score[test] = model.decision_function(_flat(x[test]))
        for place, channel in enumerate(channels):
            mixed = x[test].copy()
            mixed[..., place] = mixed[rng.permutation(len(mixed)), :, place]
            shuffled[CHANNELS[channel]][test] = model.decision_function(_flat(mixed))
    rest = animation, both.block, both.cluster
    return Answers(
        Scores(score, *rest), {name: Scores(values, *rest) for name, values in shuffled.items()}
    )


def fit(x: NDArray[np.float32], animation: Mask, p: Settings) -> "HistGradientBoostingClassifier":
    """A classifier of windows x (n, steps, channels)."""
    # Not at the top: the import takes a second, and plots do not need it.
    from sklearn.ensemble import HistGradientBoostingClassifier

    return HistGradientBoostingClassifier(
        max_iter=p.rounds,
        max_leaf_nodes=p.leaves,
        min_samples_leaf=p.leaf_windows,
        max_bins=p.bins,
        early_stopping=False,
        class_weight="balanced",
        random_state=p.seed,
    ).fit(_flat(x), animation)


def _flat(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return x.reshape(len(x), -1)
