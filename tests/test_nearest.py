"""Nearest neighbours: of few vectors exactly, of many hardly one is missed."""

import numpy as np
import pytest

from finloop.nearest import RECALL, Nearest


@pytest.fixture(scope="module")
def vectors() -> np.ndarray:
    """Walks in eight dimensions, as the frames of a film are."""
    steps = np.random.default_rng(0).normal(0, 1, (4000, 8))
    return (steps.cumsum(0) / 4).astype(np.float32)


def nearest(vectors, count):
    apart = ((vectors[:, None] - vectors[None]) ** 2).sum(-1)
    return np.argsort(apart, axis=1, kind="stable")[:, :count]


def test_of_few_vectors_every_neighbour_is_found(vectors):
    few = vectors[:500]
    made = Nearest.of(few)
    assert made.recall == 1
    assert (np.sort(made.search(few, 20), 1) == np.sort(nearest(few, 20), 1)).mean() > 0.999


def test_of_many_vectors_hardly_a_neighbour_is_missed(vectors):
    made = Nearest.of(vectors, most=1000)
    assert RECALL <= made.recall <= 1
    some = np.random.default_rng(1).choice(len(vectors), 200, replace=False)
    apart = ((vectors[some, None] - vectors[None]) ** 2).sum(-1)
    true = np.argsort(apart, axis=1)[:, 1:21]
    found = made.search(vectors[some], 21)
    shares = [np.isin(one, other).mean() for one, other in zip(true, found, strict=True)]
    assert np.mean(shares) > 0.98


def test_where_more_are_asked_for_than_there_are_the_rest_is_none(vectors):
    assert (Nearest.of(vectors[:5]).search(vectors[:1], 9)[0] >= 0).sum() == 5
