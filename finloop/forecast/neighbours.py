"""Rows in similar states: to which rows of the film a fish may go over (delay embedding).

Two rows are similar if their pasts are: their postures, and their speeds in units of their standard
deviations, at all lags, the longer ago the less (Takens 1981; Lorenz's analogues, 1969). And they
must look alike now: fins open or folded, light, skin, and what a change of posture leaves.

A fish that goes over to similar rows at random would end where the film is densest, in rest. So the
relation is made symmetric, and a step to a row with more neighbours is taken less often (Metropolis
1953): then, in the long run, all rows are visited alike, as in the film.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.errors import FinloopError
from finloop.base.schema import Schema, columns
from finloop.forecast.film import MOTION, FilmStates
from finloop.forecast.settings import Settings

NEIGHBOURS = Schema(*columns("int32", "1", "row", "neighbour"))
"""The graph of similar rows, sorted; each of its edges is there in both directions."""

_LOT = 512  # rows at a time
_DRAWN = 2  # times `count` rows of different passages are drawn for `count` that look alike
_NEAR = 8  # times as many nearest rows are looked at for these


def embedding(film: FilmStates, rows: Ints, fade: float) -> Floats:
    """The pasts (m, l d) of rows in which Euclidean distance says how similar they are.

    fade: in Δ; a state so long ago counts half.
    """
    unit = film.scale.copy()
    unit[:-MOTION] = np.sqrt((film.scale[:-MOTION] ** 2).sum())  # codes share one unit
    weight = 0.5 ** (film.lags / (fade * film.delta))
    return (film.past(rows) / unit * weight[:, None]).reshape(len(rows), -1)


ToTheEye = Callable[[Ints, Ints, Mask], Floats]
"""How far, in natural steps, rows (k,) and rows (k,), mirrored or not, are apart to the eye."""


def similar_rows(film: FilmStates, look: Reals, seen: ToTheEye, p: Settings) -> tuple[Ints, Ints]:
    """The graph of similar rows: those of row i are `to[start[i]:start[i + 1]]`, (m + 1,), (e,).

    At most `p.neighbours` of different passages, each at least Δ from the others and from the row
    itself, and so long that a posture is half forgotten; then whoever has a neighbour is its
    neighbour. Mirror images have the mirror images.
    look: (m, k) of all rows of the film, together of the deviation 1. The rows after neighbours,
    which a fish shows next, are at most `p.look` apart in it, and `p.seen` natural steps to the
    eye. FinloopError if no two rows are.
    """
    rows, n, m, count = film.rows, film.count, len(film.states), p.neighbours
    space, looks = (
        (one - one.mean(0)).astype(np.float32)
        for one in (embedding(film, rows, p.fade), np.asarray(look)[rows + 1])
    )
    square, looks_square = ((one**2).sum(1) for one in (space, looks))
    ours = rows[rows < n]
    near, passage = min(_NEAR * _DRAWN * count, len(rows) - 1), max(film.delta, round(film.memory))
    pairs: list[tuple[int, int]] = []
    for first in range(0, len(ours), _LOT):
        lot = slice(first, min(first + _LOT, len(ours)))
        apart = square - 2 * space[lot] @ space.T  # + what all of a row share
        unlike = looks_square[lot, None] + looks_square - 2 * looks[lot] @ looks.T > p.look**2
        apart[unlike] = np.inf
        best = np.argpartition(apart, near, axis=1)[:, :near]
        order = np.take_along_axis(best, np.take_along_axis(apart, best, 1).argsort(1), 1)
        alike = np.isfinite(np.take_along_axis(apart, order, 1)).sum(1)
        for row, others, most in zip(ours[lot].tolist(), rows[order], alike, strict=True):
            passages = _passages(row, others[:most].tolist(), _DRAWN * count, passage)
            pairs += ((row, other) for other in passages)
    there = np.array(pairs, np.int64).reshape(-1, 2)
    shown = there + 1
    there = there[seen(shown[:, 0], shown[:, 1] % n, shown[:, 1] >= n) <= p.seen]
    there = there[np.arange(len(there)) - np.searchsorted(there[:, 0], there[:, 0]) < count]
    if not len(there):
        raise FinloopError(
            "no two rows of the film are similar and look alike",
            f"some that are at most forecast.look={p.look} deviations and forecast.seen={p.seen} "
            "natural steps apart",
            "take a longer film, in which postures come back, or raise these, or "
            "animate.sprites=paper, which needs less",
        )
    image = (there + n) % m if m > n else there
    every = np.concatenate([there, image, there[:, ::-1], image[:, ::-1]])
    one, other = np.divmod(np.unique(every[:, 0] * m + every[:, 1]), m)
    return np.searchsorted(one, np.arange(m + 1)), other


def table(graph: tuple[Ints, Ints]) -> pd.DataFrame:
    """The table of `NEIGHBOURS`."""
    start, to = graph
    rows = np.repeat(np.arange(len(start) - 1), np.diff(start))
    return pd.DataFrame({"row": rows, "neighbour": to})


def from_table(edges: pd.DataFrame, rows: int) -> tuple[Ints, Ints]:
    """The graph that `table` gave, of so many rows; ValueError if it is of others."""
    one, other = (edges[name].to_numpy(np.int64) for name in NEIGHBOURS.names)
    if len(edges) and max(one.max(), other.max()) >= rows:
        raise ValueError(f"row {max(one.max(), other.max())} of {rows}")
    return np.searchsorted(one, np.arange(rows + 1)), other


def _passages(row: int, others: list[int], count: int, apart: int) -> list[int]:
    """The first `count` of other rows that are of different passages of the film."""
    chosen: list[int] = [row]
    for other in others:
        if all(abs(other - one) >= apart for one in chosen):
            chosen.append(other)
            if len(chosen) > count:
                break
    return chosen[1:]
