"""Writing the film's table of tracks and its cut-outs in one order, (track_id, frame).

Fish come frame by frame and are written so. When the film ends, both files are copied into the
order in which every later stage numbers its rows: a row is a cut-out. Only a few thousand rows are
in memory at a time.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.base.schema import Schema
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.io.table import table_writer

TRACKS_NAME, CUTOUTS_NAME = "tracks.parquet", "cutouts.arrow"
_LOT = 4096  # rows of the table in memory
Rows = NDArray[np.intp]
Write = Callable[[pd.DataFrame, Iterable[Cutout]], None]


@contextmanager
def film_writer(folder: Path, schema: Schema) -> Iterator[Write]:
    """Write `folder`/tracks.parquet and cutouts.arrow: yields write(rows, their cut-outs).

    The rows of a track come in the order of their frames, those of different tracks in any order.
    """
    table, pictures = folder / f"unsorted-{TRACKS_NAME}", folder / f"unsorted-{CUTOUTS_NAME}"
    tracks: list[NDArray[np.int32]] = []
    with table_writer(table, schema) as write_rows, CutoutWriter(pictures) as cutouts:

        def write(lot: pd.DataFrame, of_lot: Iterable[Cutout]) -> None:
            write_rows(lot)
            tracks.append(lot["track_id"].to_numpy(np.int32))
            for one in of_lot:
                cutouts.write(one)

        yield write
    order = np.argsort(np.concatenate([np.empty(0, np.int32), *tracks]), kind="stable")
    _copy_table(table, folder / TRACKS_NAME, order)
    with open_cutouts(pictures) as store, CutoutWriter(folder / CUTOUTS_NAME) as writer:
        writer.copy(store, order)
    table.unlink()
    pictures.unlink()


def _copy_table(source: Path, target: Path, order: Rows) -> None:
    """Write the rows of a Parquet file in another order."""
    with pq.ParquetFile(source) as file:
        sizes = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
        start = np.cumsum([0, *sizes])
        with pq.ParquetWriter(target, file.schema_arrow, compression="zstd") as writer:
            for rows in np.split(order, range(_LOT, len(order), _LOT)):
                group = np.searchsorted(start, rows, side="right") - 1
                parts = [
                    file.read_row_group(k).take(rows[group == k] - start[k])
                    for k in np.unique(group)
                ]
                back = np.argsort(np.argsort(group, kind="stable"))
                if parts:
                    writer.write_table(pa.concat_tables(parts).take(back))
