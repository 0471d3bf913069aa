"""The nearest neighbours of every row, mirror images too: where the film can go on."""

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.schema import Column, Schema, columns

JUMPS = Schema(
    *columns("int32", "row", "row", "to"),
    Column("mirrored", "bool", "1"),
    Column("seam", "float32", "natural step"),
)
"""In place of `row` the film can show the row `to`, mirrored or not, and go on from there. `seam`
says how far the two are from each other, in median steps from row to row: the larger of how far
they are in what they are compared by, and of the square of how far to the eye, drawn in one pose. A
mirrored `row` can be replaced in the same way: then what is mirrored is not, and the other way
round."""

_BLOCK = 256  # rows at a time


def nearest(
    values: Floats, track: Ints, count: int, least: int, mirror: bool = True
) -> pd.DataFrame:
    """The `count` nearest rows of every row, one a passage of film: row, to, mirrored, and how far.

    Of rows that follow one another only the nearest is kept. A row that less than `least` rows of
    its track follow is not jumped to, nor one within `least` rows of the same track.

    values (2, n, d): of rows [0] and mirror images [1]; track (n,): rising; mirror: whether mirror
    images are looked at.
    """
    n = len(track)
    targets = values[: 1 + mirror].reshape(-1, values.shape[-1])
    square = (targets**2).sum(-1)
    last = np.searchsorted(track, track, "right") - 1
    short = np.tile(last - np.arange(n) < least, 1 + mirror)
    tables = []
    for start in range(0, n, _BLOCK):
        rows = np.arange(start, min(start + _BLOCK, n))
        apart = square - 2 * values[0, rows] @ targets.T
        apart[:, short] = np.inf
        for row, line in zip(rows, apart, strict=True):
            near = np.arange(max(int(row) - least + 1, 0), min(int(row) + least, n))
            line[near[track[near] == track[row]]] = np.inf
        apart[~_minima(apart)] = np.inf
        most = min(count, apart.shape[1])
        chosen = np.sort(np.argpartition(apart, most - 1, axis=1)[:, :most], axis=1)
        finite = np.isfinite(np.take_along_axis(apart, chosen, 1))
        source, to = np.repeat(rows, finite.sum(1)), chosen[finite]
        far = np.linalg.norm(values[0, source] - targets[to], axis=-1)
        order = np.lexsort((to, far, source))
        tables.append((source[order], to[order], far[order]))
    source, to, far = (np.concatenate(column) for column in zip(*tables, strict=True))
    return pd.DataFrame({"row": source, "to": to % n, "mirrored": to >= n, "far": far})


def chosen(near: pd.DataFrame, seen: Floats, count: int) -> pd.DataFrame:
    """Jumps, columns of `JUMPS`: of every row the `count` with the least seams.

    What is seen counts squared: below a natural step it is hidden in the motion, above it shows the
    more. near: as `nearest` gives them; seen: (k,) natural steps.
    """
    table = near.assign(seam=np.maximum(near["far"], np.square(seen)))
    table = table.sort_values(["row", "seam", "to"]).groupby("row").head(count)
    kinds = {column.name: column.dtype for column in JUMPS.columns}
    return table[JUMPS.names].astype(kinds).reset_index(drop=True)


def _minima(apart: Floats) -> Mask:
    """Where a row of numbers (k, m) has a local minimum; of equal ones the first."""
    walls = np.full((len(apart), 1), np.inf)
    before, after = np.hstack([walls, apart[:, :-1]]), np.hstack([apart[:, 1:], walls])
    return (apart < before) & (apart <= after) & np.isfinite(apart)
