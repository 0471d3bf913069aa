"""Nearest neighbours: of few vectors exactly, of many hardly one is missed."""

import pickle

import numpy as np
import pytest

from finloop.base.nearest import RECALL, Nearest, assign_parts


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
    made = Nearest.from_vectors(few)
    assert made.recall == 1
    assert (np.sort(made.search(few, 20), 1) == np.sort(nearest(few, 20), 1)).mean() > 0.999


def test_of_many_vectors_hardly_a_neighbour_is_missed(vectors):
    made = Nearest.from_vectors(vectors, exact_limit=1000)
    assert RECALL <= made.recall <= 1
    some = np.random.default_rng(1).choice(len(vectors), 200, replace=False)
    apart = ((vectors[some, None] - vectors[None]) ** 2).sum(-1)
    true = np.argsort(apart, axis=1)[:, 1:21]
    found = made.search(vectors[some], 21)
    shares = [np.isin(one, other).mean() for one, other in zip(true, found, strict=True)]
    assert np.mean(shares) > 0.98


@pytest.mark.parametrize("most", [1000, 10_000])
def test_another_process_finds_the_same(vectors, most):
    made = Nearest.from_vectors(vectors, most)
    sent = pickle.loads(pickle.dumps(made))
    assert sent.recall == made.recall
    assert (sent.search(vectors, 20) == made.search(vectors, 20)).all()


@pytest.mark.parametrize(("n", "parts"), [(1, 1), (100, 1), (101, 2), (950, 10)])
def test_the_parts_of_a_film_are_stretches_spread_over_it(n, parts):
    made = assign_parts(n, 10, most=100)
    assert set(made) == set(range(parts))
    assert np.bincount(made).max() <= 100 + 10
    edges = np.flatnonzero(np.diff(made)) + 1
    assert (edges % 10 == 0).all() and (parts == 1 or len(edges) == (n - 1) // 10)


def test_where_more_are_asked_for_than_there_are_the_rest_is_none(vectors):
    assert (Nearest.from_vectors(vectors[:5]).search(vectors[:1], 9)[0] >= 0).sum() == 5
    nothing = Nearest.from_vectors(vectors[:0])
    (chosen,) = nothing.choose(vectors[:2], 8, lambda some, near: ((near,), some < 0))
    assert chosen.shape == (2, 0)


@pytest.mark.parametrize("most", [None, 100])
def test_so_many_nearest_are_looked_at_as_are_needed_for_a_choice(vectors, most):
    """Of each vector the three nearest of a kind; `most`: among so many."""
    few, sizes = vectors[:500], []
    kind = np.random.default_rng(2).random(500) < 0.1
    kind[200:] &= np.arange(200, 500) < 260  # far away there are none for long

    def choice(queries, near):
        sizes.append(near.shape)
        chosen = np.full((len(queries), 3), -1)
        for one, others in zip(chosen, near, strict=True):
            some = others[kind[others]][:3]
            one[: len(some)] = some
        return (chosen,), chosen[:, -1] >= 0

    index = Nearest.from_vectors(few)
    (chosen,) = index.choose(few, 8, choice, most)
    counts, looked_at = zip(*sizes, strict=True)
    assert list(looked_at) == ([8, 32, 100] if most else [8, 32, 128, 500])
    assert counts[0] == 500 > counts[1] > counts[-1] > 0
    for one, others in zip(chosen, index.search(few, most or 500), strict=True):
        some = others[kind[others]][:3]
        assert list(one) == [*some, *[-1] * (3 - len(some))]
