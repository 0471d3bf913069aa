"""The nearest neighbours of vectors: exact for few vectors, nearly exact for very many.

Few vectors are compared with all others. Many are sorted into cells first (inverted file: Jégou et
al., Product quantization for nearest neighbor search, 2011), and so many nearby cells are searched
that the recall is `RECALL`.
"""

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
"""A rule: numbers of queries (k,) and their nearest vectors (k, l), −1 for none → arrays (k, …) of
chosen values, and a mask (k,): True where the vectors were enough."""


@dataclass(frozen=True)
class Nearest:
    """An index of m vectors of d numbers, which finds the nearest neighbours of other vectors.

    recall: the measured share of the 20 true nearest neighbours that the index finds; 1 = exact.
    """

    index: faiss.Index
    recall: float

    @classmethod
    def from_vectors(cls, vectors: Floats | Vectors, exact_limit: int = MOST) -> "Nearest":
        """Return an index of vectors (m, d), which is exact for at most `exact_limit` vectors."""
        vectors = np.ascontiguousarray(vectors, np.float32)
        m, d = vectors.shape
        if m <= exact_limit:
            flat = faiss.IndexFlatL2(d)
            flat.add(vectors)
            return cls(flat, 1.0)
        cells = round(4 * m**0.5)
        index = faiss.IndexIVFFlat(faiss.IndexFlatL2(d), d, cells)
        index.cp.max_points_per_centroid, index.cp.niter = _PER_CELL, _ROUNDS
        index.train(vectors)
        index.add(vectors)
        some = vectors[spread_rows(np.arange(m), _SAMPLE)]
        true = faiss.knn(some, vectors, _NEAREST + 1)[1]
        recall, index.nprobe = 0.0, 4
        while recall < RECALL and index.nprobe < cells:
            index.nprobe = min(3 * index.nprobe // 2, cells)
            near = index.search(some, _NEAREST + 1)[1]
            # Each vector's first neighbour is itself.
            shares = [
                np.isin(exact[1:], hits).mean() for exact, hits in zip(true, near, strict=True)
            ]
            recall = float(np.mean(shares))
        return cls(index, recall)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to restore the index in another process, for pickle."""
        return _unpickle, (faiss.serialize_index(self.index), self.recall)

    def search(self, queries: Floats | Vectors, count: int) -> Ints:
        """Return the numbers (k, count) of the vectors nearest to each query (k, d), nearest first.

        −1 stands where the index finds no further one.
        """
        if count == 0:
            return np.empty((len(queries), 0), np.int64)
        return self.index.search(np.ascontiguousarray(queries, np.float32), count)[1]

    def choose(
        self, queries: Floats | Vectors, count: int, choice: Choice, most: int | None = None
    ) -> tuple[NDArray[Any], ...]:
        """Apply a rule to the `count` nearest vectors of each query (k, d), or to more.

        If these vectors are not enough for the rule, it gets more, at most `most`, or all of the
        searched cells.
        """
        last = min(self.index.ntotal, self.index.ntotal if most is None else most)
        count = min(count, last)
        near = self.search(queries, count)
        values, enough = choice(np.arange(len(queries)), near)
        pending = np.flatnonzero(~enough & _may_have_more(near))
        while len(pending) and count < last:
            count = min(_MORE * count, last)
            near = self.search(queries[pending], count)
            more, enough = choice(pending, near)
            for array, update in zip(values, more, strict=True):
                array[pending] = update
            pending = pending[~enough & _may_have_more(near)]
        return values


def _may_have_more(near: Ints) -> Mask:
    """Return for which queries (k,) a search may find more vectors than those given (k, l)."""
    return near[:, -1] >= 0 if near.shape[1] else np.zeros(len(near), bool)


def assign_parts(n: int, stretch: int, most: int = MOST) -> Ints:
    """Divide a long film of n rows into parts of about `most` rows; return each row's part (n,).

    Stretches of `stretch` rows go to the parts in turn, so each part is spread over the film. In a
    film of hours a row's nearest rows are so near that all continue alike; within a part they
    continue in different ways, as in a short film.
    """
    return np.arange(n) // stretch % max(1, -(-n // most))


def _unpickle(index: NDArray[np.uint8], recall: float) -> Nearest:
    """Restore an index of nearest neighbours in another process, from its bytes.

    index: as FAISS writes it; recall: as in `Nearest`.
    """
    return Nearest(faiss.deserialize_index(index), recall)
