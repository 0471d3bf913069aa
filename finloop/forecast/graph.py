"""The graph of similar rows as a table."""

import numpy as np
import pandas as pd

from finloop.base.arrays import Ints
from finloop.base.schema import Schema, columns

NEIGHBOURS = Schema(*columns("int32", "1", "row", "neighbour"))
"""The graph of similar rows, sorted; each of its edges is there in both directions."""


def table(graph: tuple[Ints, Ints]) -> pd.DataFrame:
    """The table of `NEIGHBOURS`."""
    start, to = graph
    rows = np.repeat(np.arange(len(start) - 1), np.diff(start))
    return pd.DataFrame({"row": rows, "neighbour": to})


def from_table(edges: pd.DataFrame, rows: int) -> tuple[Ints, Ints]:
    """The graph of a table that `table` made; ValueError if it names more rows than `rows`."""
    row, neighbour = (edges[name].to_numpy(np.int64) for name in NEIGHBOURS.names)
    if len(edges) and max(row.max(), neighbour.max()) >= rows:
        raise ValueError(f"row {max(row.max(), neighbour.max())} of {rows}")
    return np.searchsorted(row, np.arange(rows + 1)), neighbour
