"""Describe the appearance of animals, and rate whether two tracks look like one animal.

A picture's descriptor holds the animal's length, area, contrast and widths along the body, and
principal components of the picture itself, headed right. The directions that distinguish animals
are learnt from the film: two parts of one track are one animal, two tracks with a frame in common
are two.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.stretches import spread_rows
from finloop.identity.joins import TrackPairs, Tracks

# scikit-learn is imported where it is used: the import takes a second, and plots do not need it.
if TYPE_CHECKING:
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

_FOLDS = 2  # discriminant directions are tested on other tracks than they were learnt from
_PARTS = 3  # parts of a track: the first and the last are compared
_LEAST = 8  # least pairs of one animal, and of two, to learn from
# Shrinkage: the share of the spread within tracks that is equal in all directions. 0.01 gives the
# same zebrafish, 0.2 two more.
_SHRUNK = 0.05
# Of a longer film: most pictures for the components, and most tracks for the discriminant
# directions; both are spread over it.
_PICTURES, _TRACKS = 10_000, 1_000
_BLOCK = 2_000  # pictures held at once


def appearance_descriptors(
    measures: Floats, read_pictures: Callable[[Tracks], NDArray[np.float32]], most_components: int
) -> Floats:
    """Return numbers (rows, d) that describe the animal's looks in each row.

    They are the measures of the body, each scaled to a standard deviation of 1, and principal
    components of the picture, scaled together to 1. measures (rows, m): any units; read_pictures:
    returns the pictures (k, pixels) of k row numbers; most_components: their largest number.
    """
    rows = np.arange(len(measures))
    sample = read_pictures(spread_rows(rows, _PICTURES)).astype(float)
    count = min(most_components, *(side - 1 for side in sample.shape))
    if count < 1:
        return _standardise(measures)
    from sklearn.decomposition import PCA

    pca = PCA(count, svd_solver="arpack", random_state=0).fit(sample)
    del sample
    blocks = np.split(rows, range(_BLOCK, len(rows), _BLOCK))
    codes = np.concatenate([pca.transform(read_pictures(block).astype(float)) for block in blocks])
    return np.hstack([_standardise(measures), codes / max(float(codes.std()), 1e-12)])


def _standardise(values: Floats) -> Floats:
    """Return values (n, m) shifted and scaled to a mean of 0 and a standard deviation of 1."""
    return (values - values.mean(0)) / np.maximum(values.std(0), 1e-9)


def appearance_log_ratios(
    tracks: Sequence[Floats], at_once: TrackPairs, pairs: TrackPairs
) -> Floats:
    """Return log(P(one animal) / P(two)) of each pair of tracks, (e,), by their looks.

    tracks: the descriptors (k, d) of each track's pictures, in the order of time; at_once: pairs of
    tracks with a frame in common, certainly two animals; pairs: those to rate. The ratio is that of
    a logistic regression of the distance between two descriptors, learnt from the film. All zeros
    if the film has too few pairs to learn from.
    """
    long_tracks = np.array([i for i in range(len(tracks)) if len(tracks[i]) >= 2 * _PARTS], np.intp)
    one_animal, two_animals = _example_distances(tracks, long_tracks, at_once)
    fewest = min(len(one_animal), len(two_animals))
    if fewest < _LEAST:
        return np.zeros(len(pairs.a))
    # A track of two animals that touch is far from itself; a single one would flatten the curve.
    farthest = float(np.median(two_animals))
    from sklearn.linear_model import LogisticRegression

    regression = LogisticRegression(class_weight="balanced").fit(
        np.minimum(np.concatenate([one_animal, two_animals]), farthest)[:, None],
        np.repeat([1, 0], [len(one_animal), len(two_animals)]),
    )
    slope, offset = float(regression.coef_[0, 0]), float(regression.intercept_[0])
    if slope >= 0:  # farther apart would mean more alike: nothing was learnt
        return np.zeros(len(pairs.a))
    first, last = _mean_descriptors_at_ends(tracks, _find_discriminant(tracks, long_tracks))
    limit = float(np.log(fewest))  # so many examples show no greater certainty
    distance = np.linalg.norm(last[pairs.a] - first[pairs.b], axis=1)
    return np.clip(slope * np.minimum(distance, farthest) + offset, -limit, limit)


def _example_distances(
    tracks: Sequence[Floats], long_tracks: Tracks, at_once: TrackPairs
) -> tuple[Floats, Floats]:
    """Return distances of looks for examples: of one animal (k,), and of two animals (l,).

    One animal: the first and the last part of each long track. Two: the first part of one long
    track and the last part of another, for the pairs `at_once`, which have a frame in common.
    Distances are measured along discriminant directions that were learnt from other tracks.
    long_tracks: numbers of those with enough pictures.
    """
    one_animal, two_animals = list[Floats](), list[Floats]()
    for fold in range(_FOLDS):
        test = np.zeros(len(tracks), bool)
        test[long_tracks[fold::_FOLDS]] = True
        directions = _find_discriminant(tracks, long_tracks[~test[long_tracks]])
        first, last = _mean_descriptors_at_ends(tracks, directions)
        one_animal.append(np.linalg.norm(first[test] - last[test], axis=1))
        both_in_test = test[at_once.a] & test[at_once.b]
        a, b = at_once.a[both_in_test], at_once.b[both_in_test]
        two_animals.append(np.linalg.norm(first[a] - last[b], axis=1))
    return np.concatenate(one_animal), np.concatenate(two_animals)


def _find_discriminant(
    tracks: Sequence[Floats], numbers: Tracks
) -> "LinearDiscriminantAnalysis | None":
    """Return the directions of descriptors that distinguish tracks best; None for under two tracks.

    tracks: descriptors (k, d) of each; numbers: of those to learn from.
    """
    if len(numbers) < 2:
        return None
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    numbers = spread_rows(numbers, _TRACKS)
    label = np.repeat(numbers, [len(tracks[i]) for i in numbers])
    directions = LinearDiscriminantAnalysis(solver="eigen", shrinkage=_SHRUNK)
    return directions.fit(np.concatenate([tracks[i] for i in numbers]), label)


def _mean_descriptors_at_ends(
    tracks: Sequence[Floats], directions: "LinearDiscriminantAnalysis | None"
) -> tuple[Floats, Floats]:
    """Return the mean descriptors (n, c) of each track's first and last part.

    tracks: descriptors (k, d) of each of n tracks, in the order of its frames. directions: c
    discriminant directions onto which they are projected; None leaves them as they are, c = d.
    """
    part = [max(1, len(track) // _PARTS) for track in tracks]
    first = np.array([track[:k].mean(0) for track, k in zip(tracks, part, strict=True)])
    last = np.array([track[-k:].mean(0) for track, k in zip(tracks, part, strict=True)])
    if directions is None:
        return first, last
    # The directions are linear: the mean of codes is the code of the mean.
    return directions.transform(first), directions.transform(last)
