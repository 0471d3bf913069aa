"""What an animal looks like, and whether two tracks look like one animal.

An animal is known by numbers of some of its pictures: its length, area, contrast and widths along
the body, and principal components of the picture itself, headed right. Which of them tell animals
apart is learnt from the film: two parts of one track are one animal, two tracks that have a frame
in common are two.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.linear_model import LogisticRegression

from finloop.base.arrays import Floats, Mask

_FOLDS = 2  # what tells animals apart is tried on tracks that it was not learnt from
_PARTS = 3  # of a track: the first and the last are compared, the middle lies between them
_LEAST = 8  # pairs of one animal, and of two, by which alike and unlike are told
# Of the spread within tracks so much is taken to be the same in all directions; 0.01 makes the same
# animals of the zebrafish, 0.2 two more.
_SHRUNK = 0.05


def described(measures: Floats, pictures: NDArray[np.float32], components: int) -> Floats:
    """Numbers (rows, d) by which an animal is known, of spread 1; the components have it together.

    measures (rows, m); pictures (rows, pixels).
    """
    count = min(components, *(side - 1 for side in pictures.shape))
    if count < 1:
        return _spread(measures)
    few = PCA(count, svd_solver="arpack", random_state=0)
    shown = few.fit_transform(pictures.astype(float))
    return np.hstack([_spread(measures), shown / max(float(shown.std()), 1e-12)])


def _spread(values: Floats) -> Floats:
    return (values - values.mean(0)) / np.maximum(values.std(0), 1e-9)


def log_ratios(tracks: Sequence[Floats], overlap: Mask) -> Floats:
    """For every pair (n, n) of tracks the log ratio of looking like one animal against two.

    tracks: of each the numbers (k, d) of its pictures, in the order of time. overlap (n, n):
    whether two tracks have a frame in common. All zeros where the film has too few pairs to learn
    from. No pair is surer than as many pairs as there are can make it.
    """
    n = len(tracks)
    long = np.array([i for i in range(n) if len(tracks[i]) >= 2 * _PARTS])
    one_animal, two = list[float](), list[float]()
    for fold in range(_FOLDS):
        tried = long[fold::_FOLDS].tolist()
        first, last = _ends(tracks, _tells(tracks, np.setdiff1d(long, tried)))
        one_animal += [_apart(first[i], last[i]) for i in tried]
        two += [_apart(first[a], last[b]) for a, b in combinations(tried, 2) if overlap[a, b]]
    if min(len(one_animal), len(two)) < _LEAST:
        return np.zeros((n, n))
    told = LogisticRegression(class_weight="balanced").fit(
        np.concatenate([one_animal, two])[:, None],
        np.repeat([1, 0], [len(one_animal), len(two)]),
    )
    slope, offset = float(told.coef_[0, 0]), float(told.intercept_[0])
    if slope >= 0:  # what is farther apart would be more alike: nothing was learnt
        return np.zeros((n, n))
    first, last = _ends(tracks, _tells(tracks, long))
    apart = np.array([[_apart(a, b) for b in first] for a in last])
    most = float(np.log(min(len(one_animal), len(two))))
    return np.clip(slope * apart + offset, -most, most)


def _tells(tracks: Sequence[Floats], learnt: NDArray[np.intp]) -> LinearDiscriminantAnalysis | None:
    """The directions that tell these tracks from one another; None of fewer than two tracks."""
    if len(learnt) < 2:
        return None
    label = np.repeat(learnt, [len(tracks[i]) for i in learnt])
    tells = LinearDiscriminantAnalysis(solver="eigen", shrinkage=_SHRUNK)
    return tells.fit(np.concatenate([tracks[i] for i in learnt]), label)


def _ends(
    tracks: Sequence[Floats], tells: LinearDiscriminantAnalysis | None
) -> tuple[list[Floats], list[Floats]]:
    """The mean of each track's first part, and of its last, in what tells animals apart."""
    codes = [one if tells is None else tells.transform(one) for one in tracks]
    part = [max(1, len(one) // _PARTS) for one in codes]
    return (
        [one[:k].mean(0) for one, k in zip(codes, part, strict=True)],
        [one[-k:].mean(0) for one, k in zip(codes, part, strict=True)],
    )


def _apart(a: Floats, b: Floats) -> float:
    return float(np.linalg.norm(a - b))
