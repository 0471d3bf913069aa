"""A classifier of film and animation, trained and tested block by block; its important channels.

Gradient-boosted trees over histograms (scikit-learn; Ke et al. 2017, LightGBM). Both kinds have the
same weight, whatever their number of windows.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from finloop.base.arrays import Mask
from finloop.realism.auc import Scores
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import Windows, join_windows


class HeldOutScores(NamedTuple):
    """Scores of windows that the classifier has not learnt from; film windows come first.

    shuffled: channel name → the scores after that channel was shuffled among the tested windows.
    """

    scores: Scores
    shuffled: dict[str, Scores]


def score_held_out_windows(
    film: Windows, animation: Windows, p: RealismSettings, channels: tuple[int, ...],
    share: float = 1.0,
) -> HeldOutScores:  # fmt: skip
    """Train a classifier per block of time; return the scores of the windows in the block.

    Each learns from windows that are not near its block. channels: indices of the windows' channels
    to use. share: of their numbers, that each branch of a tree may use; with less than 1 one number
    that distinguishes all that is learnt from does not hide the others. A block whose classifier
    would see only film or only animation gives NaN.
    """
    both = join_windows([film, animation])
    is_animation = np.arange(len(both)) >= len(film)
    x = both.x[..., list(channels)]
    score = np.full(len(both), np.nan)  # of windows that no classifier tests
    shuffled = {both.channels[channel]: score.copy() for channel in channels}
    rng = np.random.default_rng(p.seed)
    for learn, test in learnable_blocks(both, is_animation):
        binned = _bin_values(x, learn, p.bins)
        with threadpool_limits(limits=1):  # with so little data, threads are slower
            model = _make_classifier(p, share).fit(_join_steps(binned[learn]), is_animation[learn])
            score[test] = model.decision_function(_join_steps(binned[test]))
            # The scores without the information of one channel at a time.
            for column, channel in enumerate(channels):
                mixed = binned[test].copy()
                mixed[..., column] = mixed[rng.permutation(len(mixed)), :, column]
                shuffled[both.channels[channel]][test] = model.decision_function(_join_steps(mixed))
    labels = is_animation, both.block, both.cluster
    return HeldOutScores(
        Scores(score, *labels), {name: Scores(values, *labels) for name, values in shuffled.items()}
    )


def learnable_blocks(both: Windows, is_animation: Mask) -> Iterator[tuple[Mask, Mask]]:
    """Yield two masks (n,) for each block: windows to learn from, and windows to test.

    A block that tests none, or would learn from only film or only animation, is left out.
    """
    for block in range(both.near.shape[1]):
        learn, test = ~both.near[:, block], both.block == block
        if test.any() and 0 < is_animation[learn].sum() < learn.sum():
            yield learn, test


def _make_classifier(p: RealismSettings, share: float) -> Any:
    """Return a classifier of scikit-learn that has not learnt yet.

    share: how many of a window's numbers each branch of a tree may choose from, 0 … 1.
    """
    # Not at the top: the import takes a second, and plots do not need it.
    from sklearn.ensemble import HistGradientBoostingClassifier

    return HistGradientBoostingClassifier(
        max_iter=p.classifier_trees, max_leaf_nodes=p.leaves, min_samples_leaf=p.leaf_windows,
        max_bins=p.bins, early_stopping=False, class_weight="balanced", random_state=p.seed,
        max_features=share,
    )  # fmt: skip


def _bin_values(windows: NDArray[np.float32], learnt_from: Mask, bins: int) -> NDArray[np.float32]:
    """Return the bin number of each value of windows (n, steps, channels), as float32.

    Quantiles of the windows that are `learnt_from` (n,) separate the bins of each step and channel,
    as in scikit-learn, but without weights, which took 22 of the stage's 48 s.
    """
    values = _join_steps(windows)
    edges = np.quantile(values[learnt_from], np.arange(1, bins) / bins, axis=0)
    columns = [
        np.searchsorted(np.unique(edge), value)
        for edge, value in zip(edges.T, values.T, strict=True)
    ]
    return np.stack(columns, axis=1).astype(np.float32).reshape(windows.shape)


def _join_steps(windows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return windows (n, steps, channels) as one row of numbers each: (n, steps · channels)."""
    return windows.reshape(len(windows), -1)
