"""Rows in similar states: the rows of the film that a fish may jump to (delay embedding).

Two rows are similar if their pasts are: their postures, and their speeds in units of their standard
deviations, at all lags, the longer ago the less (Takens 1981; Lorenz's analogues, 1969). And they
must look alike now: fins open or folded, light, skin, and what a change of posture leaves.

A fish that jumps to similar rows at random would end where the film is densest, in rest. So the
relation is made symmetric, and a step to a row with more neighbours is taken less often (Metropolis
1953): in the long run all rows are visited equally often, as in the film.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.nearest import MOST, Nearest, assign_parts
from finloop.forecast.film import MOTION, FilmStates
from finloop.forecast.settings import ForecastSettings

_BATCH = 512  # rows whose neighbours are sought at a time
_TURN = 4096  # successive rows whose neighbours are all in one part of a long film
_STRETCH = 20  # Δ, length of the stretches of film of which a part consists
_BLOCK = 50_000  # rows embedded at a time, to save memory
_SPARE = 2  # times `similar_frames`: rows of different passages, drawn to find so many alike
_NEAR = 8  # times that number: rows that look alike, examined to find as many passages
_MOST = 16_384  # nearest rows among which they are sought at most, fewer in a part of the film
_FEWEST = 2  # times the examined rows: nearest rows among which they are sought at least


VisibleDistance = Callable[[Ints, Ints, Mask], Floats]
"""The visible distance, in natural steps, of rows (k,) and rows (k,), mirrored or not."""


def build_similarity_graph(
    film: FilmStates, look: Reals, visible: VisibleDistance, p: ForecastSettings
) -> tuple[Ints, NDArray[np.int32]]:
    """Return which rows have similar pasts and look alike afterwards, as a sparse graph.

    It is start (m + 1,) and to (e,): the rows similar to row i are to[start[i]:start[i + 1]]. A row
    chooses at most `p.similar_frames`, not too near in time to itself and each other; then the
    relation is made symmetric, and mirror images get the mirror images. The rows after two similar
    ones differ by at most `p.max_look_difference` in light and skin (look (m, k), of total variance
    1), and by at most `p.max_discontinuity` in visible distance. FinloopError if no two rows are
    similar.
    """
    batches = _find_similar_pairs(film, look, p)
    alike = [_choose_alike_pairs(pairs, film.count, visible, p) for pairs in batches]
    pairs = np.concatenate([np.empty((0, 2), np.int64), *alike])
    if not len(pairs):
        raise FinloopError(
            "no two rows of the film are similar and look alike",
            f"some whose light and skin are at most {p.max_look_difference} deviations apart, at "
            f"most forecast.max_discontinuity={p.max_discontinuity} natural steps from each other",
            "take a longer film, in which poses repeat, or raise forecast.max_discontinuity, "
            "or leave the forecast out (matching.uses=[film])",
        )
    return _make_symmetric(pairs, film.count, len(film.states))


def _make_symmetric(
    similar_pairs: Ints, film_rows: int, all_rows: int
) -> tuple[Ints, NDArray[np.int32]]:
    """Make the relation of similar pairs (k, 2) symmetric, add mirror images; return the graph.

    film_rows: without mirror images; all_rows: with them. The graph is start (all_rows + 1,) and to
    (e,): the rows similar to row i are to[start[i]:start[i + 1]].
    """
    mirror_pairs = (similar_pairs + film_rows) % all_rows if all_rows > film_rows else similar_pairs
    edges_by_direction = []  # an edge from row i to row j is the number i · all_rows + j
    for pairs in (similar_pairs, mirror_pairs):
        for first, second in ((0, 1), (1, 0)):
            edges_by_direction.append(pairs[:, first] * all_rows + pairs[:, second])
    edges = np.concatenate(edges_by_direction)
    edges.sort()  # in place, as below: a million rows have 50 million edges
    edges = edges[np.append(True, edges[1:] != edges[:-1])]
    start = np.searchsorted(edges, np.arange(all_rows + 1) * all_rows)
    edges %= all_rows
    return start, edges.astype(np.int32)


def _embed_pasts(film: FilmStates, rows: Ints, fade_deltas: float) -> NDArray[np.float32]:
    """Return a vector (m, l d) of the past of each row (m,); near vectors mean similar pasts.

    fade_deltas: age, in units of Δ, at which a past state counts half.
    """
    unit = film.scale.copy()
    unit[:-MOTION] = np.sqrt((film.scale[:-MOTION] ** 2).sum())  # codes share one unit
    weight = 0.5 ** (film.lags / (fade_deltas * film.delta))

    def embed(batch: Ints) -> Floats:
        """Return the vectors (k, l d) of some rows (k,), before the mean is subtracted."""
        return (film.past(batch) / unit * weight[:, None]).reshape(len(batch), -1)

    batches = np.split(rows, range(_BLOCK, len(rows), _BLOCK))
    mean = sum(embed(batch).sum(0) for batch in batches) / len(rows)
    return np.concatenate([(embed(batch) - mean).astype(np.float32) for batch in batches])


def _find_similar_pairs(film: FilmStates, look: Reals, p: ForecastSettings) -> Iterator[Ints]:
    """Yield batches of pairs (k, 2) of similar rows: a row of the film, and a row similar to it.

    Two rows are similar if their pasts are near (`_embed_pasts`), and if the rows after them differ
    by at most `p.max_look_difference` in light and skin. look (m, c): light and skin of each row,
    as c numbers. Mirror images are among the m rows; only the second row of a pair can be one.

    First rows ascend. Each has up to twice `p.similar_frames` similar rows, the most similar first.
    They lie in different passages of the film, and none lies in the passage of the first row. A
    mirror image is another passage.

    A long film is divided into parts (`assign_parts`). The similar rows of one first row all come
    from one part. The next `_TURN` first rows take theirs from the next part.
    """
    rows = film.rows
    own_count = int((rows < film.count).sum())  # the first of `rows`; the rest are mirror images
    pasts, looks = _embed_pasts(film, rows, p.past_half_life_deltas), np.asarray(look)[rows + 1]
    looks = (looks - looks.mean(0)).astype(np.float32)
    part = assign_parts(film.count, _STRETCH * film.delta)[rows % film.count]
    parts = 1 + int(part.max())

    @lru_cache(1)
    def index_part(number: int) -> tuple[Ints, Nearest]:
        """Return the numbers in `rows` of one part of the film, and the index of their vectors."""
        members = np.flatnonzero(part == number)
        return members, Nearest.from_vectors(pasts[members], MOST if parts == 1 else len(members))

    apart_rows = max(film.delta, round(film.memory))
    examined = _NEAR * _SPARE * p.similar_frames
    most_near = max(_MOST // parts, _FEWEST * examined)
    for first in range(0, own_count, _BATCH):
        batch = np.arange(first, min(first + _BATCH, own_count))
        members, index = index_part(first // _TURN % parts)
        choose = partial(_choose_from_part, rows, batch, members, looks, apart_rows, p)
        similar = index.choose(pasts[batch], examined, choose, most_near)[0]
        query, rank = np.nonzero(similar >= 0)
        yield np.column_stack([rows[batch[query]], similar[query, rank]])


def _choose_from_part(
    rows: Ints, batch: Ints, members: Ints, looks: NDArray[np.float32], apart_rows: int,
    p: ForecastSettings, queries: Ints, near: Ints,
) -> tuple[tuple[Ints], Mask]:  # fmt: skip
    """Return similar rows (k, c) in one part of the film, and a mask (k,) of finished queries.

    Rows are −1 where there are none; they are chosen by `_choose_passages`. A query is finished if
    enough rows are found, or all examined. members: indices in `rows` of the part's rows; queries
    (k,): indices in `batch`; near (k, l): indices in `members`, the nearest first, −1 for none.
    """
    count = _SPARE * p.similar_frames
    candidates = np.where(near < 0, -1, members[near])
    return _choose_passages(
        rows, batch, looks, p.max_look_difference, queries, candidates, _NEAR * count, apart_rows,
        count,
    )  # fmt: skip


def _choose_alike_pairs(
    pairs: Ints, film_rows: int, visible: VisibleDistance, p: ForecastSettings
) -> Ints:
    """Return the pairs that look alike, at most `p.similar_frames` for each row.

    pairs (k, 2): a row and a similar one, by ascending row, each row's most similar first;
    film_rows: without mirror images.
    """
    row = np.unique(pairs[:, 0], return_inverse=True)[1]  # numbered without gaps
    rank = np.arange(len(pairs)) - np.searchsorted(row, row)  # of a pair among those of its row
    first = np.flatnonzero(rank < p.similar_frames)
    alike = np.zeros(len(pairs), bool)
    alike[first] = _visible_distances_after(pairs[first], film_rows, visible) <= p.max_discontinuity
    # The remaining pairs are drawn only for rows that lack neighbours.
    lacks = np.bincount(row[first], alike[first]) < p.similar_frames
    rest = np.flatnonzero((rank >= p.similar_frames) & lacks[row])
    alike[rest] = _visible_distances_after(pairs[rest], film_rows, visible) <= p.max_discontinuity
    pairs, row = pairs[alike], row[alike]
    return pairs[np.arange(len(pairs)) - np.searchsorted(row, row) < p.similar_frames]


def _visible_distances_after(pairs: Ints, film_rows: int, visible: VisibleDistance) -> Floats:
    """Return how different (k,) the rows after each pair of rows (k, 2) look in one pose."""
    row, neighbour = (pairs + 1).T
    return visible(row, neighbour % film_rows, neighbour >= film_rows)


@kernel
def _choose_passages(
    rows: Ints, batch: Ints, looks: NDArray[np.float32], most_apart: float, queries: Ints,
    near: Ints, most_examined: int, apart_rows: int, count: int,
) -> tuple[tuple[Ints], Mask]:  # fmt: skip
    """Return for each query its nearest rows that look alike, at most one of each film passage.

    The queries are the rows rows[batch[queries]]. The result is rows (k, count), −1 for none, and a
    mask (k,): True where `count` passages, or all the rows to be examined, are there. near (k, l):
    candidates as numbers into `rows`, the nearest first. looks (m, c): rows look alike where they
    are at most `most_apart` apart. most_examined: how many rows that look alike are examined before
    a query ends; apart_rows: fewest rows between two passages, and between one and the query.
    """
    choice, done = np.full((len(queries), count), -1), np.zeros(len(queries), np.bool_)
    for k in range(len(queries)):
        row, chosen, examined = batch[queries[k]], 0, 0
        for c in range(near.shape[1]):
            neighbour = near[k, c]
            if neighbour < 0 or chosen == count or examined == most_examined:
                break
            square_sum = 0.0
            for i in range(looks.shape[1]):
                square_sum += (looks[row, i] - looks[neighbour, i]) ** 2
            if square_sum > most_apart**2:
                continue
            examined += 1
            is_new = abs(rows[neighbour] - rows[row]) >= apart_rows
            for i in range(chosen):
                is_new = is_new and abs(rows[neighbour] - choice[k, i]) >= apart_rows
            if is_new:
                choice[k, chosen] = rows[neighbour]
                chosen += 1
        done[k] = chosen == count or examined == most_examined
    return (choice,), done
