"""The nearest neighbours of vectors: exact for few vectors, nearly exact for very many.

Few vectors are compared with all others. Many are sorted into cells first (inverted file: Jégou et
al., Product quantization for nearest neighbor search, 2011), and so many nearby cells are searched
that the recall is `RECALL`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import faiss
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.stretches import spread_rows

MOST = 20_000  # vectors compared with all; 12 s of one core at 25,000 of 33 numbers, 3 s in cells
RECALL = 0.99  # the least, of the `_NEAREST` nearest
_NEAREST, _SAMPLE = 20, 1000  # neighbours, and vectors, of the exact search that measures recall
_PER_CELL = 64  # vectors that train each cell; faiss warns below 39, takes 256 at most
_ROUNDS = 4  # of k-means; ten rounds find less than 1 % more neighbours in as many cells
_MORE = 4  # factor on the number of examined vectors where they are not enough
Vectors = NDArray[np.float32]
Choice = Callable[[Ints, Ints], tuple[tuple[NDArray[Any], ...], Mask]]
"""A function of the numbers of queries (j,) and of the vectors nearest to each (j, l), −1 for none.
It returns arrays (j, …) of chosen values, and a mask (j,): True where the l vectors were enough."""


@dataclass(frozen=True)
class Nearest:
    """An index of m vectors of d numbers, which finds the nearest neighbours of other vectors.

    recall: the measured share of the 20 true nearest neighbours that the index finds; 1 = exact.
    """

    index: faiss.Index
    recall: float

    @classmethod
    def from_vectors(cls, vectors: Floats | Vectors, exact_limit: int = MOST) -> "Nearest":
        """Return an index of vectors (m, d), which is exact for at most `exact_limit` vectors.

        For more, vectors lie in cells, by place, and a search examines the nearest cells: so many
        that it finds the share `RECALL` of the true nearest neighbours of a sample of the vectors.
        """
        vectors = np.ascontiguousarray(vectors, np.float32)
        m, d = vectors.shape
        if m <= exact_limit:
            flat = faiss.IndexFlatL2(d)
            flat.add(vectors)
            return cls(flat, recall=1.0)
        cells = round(4 * m**0.5)
        index = faiss.IndexIVFFlat(faiss.IndexFlatL2(d), d, cells)
        index.cp.max_points_per_centroid, index.cp.niter = _PER_CELL, _ROUNDS
        index.train(vectors)
        index.add(vectors)
        # Raise nprobe, the number of cells that a search examines, until the recall suffices.
        sample = vectors[spread_rows(np.arange(m), _SAMPLE)]
        true = faiss.knn(sample, vectors, _NEAREST + 1)[1][:, 1:]  # the first neighbour is itself
        recall, index.nprobe = 0.0, 4
        while recall < RECALL and index.nprobe < cells:
            index.nprobe = min(3 * index.nprobe // 2, cells)
            found = index.search(sample, _NEAREST + 1)[1]
            shares = [np.isin(*lists).mean() for lists in zip(true, found, strict=True)]
            recall = float(np.mean(shares))
        return cls(index, recall)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return a function and its arguments that restore the index elsewhere, as pickle asks."""
        return _unpickle, (faiss.serialize_index(self.index), self.recall)

    def search(self, queries: Floats | Vectors, count: int) -> Ints:
        """Return the numbers (k, count) of the vectors nearest to each query (k, d), nearest first.

        The number is −1 where the index finds no further vector.
        """
        if count == 0:
            return np.empty((len(queries), 0), np.int64)
        return self.index.search(np.ascontiguousarray(queries, np.float32), count)[1]

    def choose(
        self, queries: Floats | Vectors, count: int, choice: Choice, most: int | None = None
    ) -> tuple[NDArray[Any], ...]:
        """Let a rule choose among the nearest vectors of each query (k, d); return its arrays.

        choice: the rule, a function of query numbers (j,) and of the numbers (j, l) of the vectors
        nearest to each. It returns its arrays (j, …), and a mask (j,): for which queries the l
        vectors were enough. It is first given the `count` nearest vectors of each query. A query
        for which they are not enough gets four times as many, again and again, up to `most` (None:
        all vectors of the searched cells).
        """
        limit = min(self.index.ntotal, self.index.ntotal if most is None else most)
        count = min(count, limit)
        near = self.search(queries, count)
        values, enough = choice(np.arange(len(queries)), near)
        pending = np.flatnonzero(~enough & _may_have_more(near))  # queries that need more vectors
        while len(pending) and count < limit:
            count = min(_MORE * count, limit)
            near = self.search(queries[pending], count)
            updates, enough = choice(pending, near)
            for array, update in zip(values, updates, strict=True):
                array[pending] = update
            pending = pending[~enough & _may_have_more(near)]
        return values


def _may_have_more(near: Ints) -> Mask:
    """Return a mask (k,) of the queries for which a wider search may find more vectors.

    near (k, l): the vectors found; the last one is −1 where the index found fewer than l.
    """
    return near[:, -1] >= 0 if near.shape[1] else np.zeros(len(near), bool)


def assign_parts(n: int, stretch: int, most: int = MOST) -> Ints:
    """Divide a long film of n rows into parts of about `most` rows; return part numbers (n,).

    Stretches of `stretch` rows go to the parts in turn, so each part is spread over the film. In a
    film of hours a row's nearest rows are so near that all continue alike; within a part they
    continue in different ways, as in a short film.
    """
    parts = max(1, math.ceil(n / most))
    return np.arange(n) // stretch % parts


def _unpickle(index: NDArray[np.uint8], recall: float) -> Nearest:
    """Restore an index of nearest neighbours from the bytes that FAISS wrote, and its recall."""
    return Nearest(faiss.deserialize_index(index), recall)
