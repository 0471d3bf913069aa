"""Write the film's table of tracks and its cut-outs in one order, (track_id, frame).

Fish arrive frame by frame and are first written so. At the end of the film both files are copied
into the order in which every later stage numbers its rows: a row is a cut-out. Only a few thousand
rows are in memory at a time.
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
from finloop.io.cutouts import BATCH, CutoutWriter
from finloop.io.table import arrow_schema, arrow_table, parquet_coding

TRACKS_NAME, CUTOUTS_NAME = "tracks.parquet", "cutouts.arrow"
_LOT = 4096  # rows of the table in memory
Rows = NDArray[np.intp]
Write = Callable[[pd.DataFrame, Iterable[Cutout]], None]


@contextmanager
def film_writer(folder: Path, schema: Schema) -> Iterator[Write]:
    """Yield write(rows, cut-outs); at the end, sort both into tracks.parquet and cutouts.arrow.

    folder: where both files go, in the order (track_id, frame). schema: of the table of tracks. The
    rows of a track must come in the order of their frames; tracks may come in any order.
    """
    table, pictures = folder / "unsorted-tracks.arrow", folder / f"unsorted-{CUTOUTS_NAME}"
    tracks: list[NDArray[np.int32]] = []
    with (
        pa.ipc.new_file(str(table), arrow_schema(schema)) as rows,
        CutoutWriter(pictures) as cutouts,
    ):

        def write(lot: pd.DataFrame, of_lot: Iterable[Cutout]) -> None:
            rows.write_table(arrow_table(lot, schema, TRACKS_NAME))
            tracks.append(lot["track_id"].to_numpy(np.int32))
            for cutout in of_lot:
                cutouts.write(cutout)

        yield write
    order = np.argsort(np.concatenate([np.empty(0, np.int32), *tracks]), kind="stable")
    with (
        pa.memory_map(str(table)) as source,
        pq.ParquetWriter(
            folder / TRACKS_NAME, arrow_schema(schema), **parquet_coding(schema)
        ) as to,
    ):
        for lot in _in_order(source, order, _LOT):
            to.write_table(lot)
    with (
        pa.memory_map(str(pictures)) as source,
        pa.ipc.new_file(str(folder / CUTOUTS_NAME), pa.ipc.open_file(source).schema) as to,
    ):
        for lot in _in_order(source, order, BATCH):
            to.write_table(lot.combine_chunks())
    table.unlink()
    pictures.unlink()


def _in_order(source: pa.MemoryMappedFile, order: Rows, lot: int) -> Iterator[pa.Table]:
    """Yield the rows of an Arrow file in another order, `lot` at a time."""
    file = pa.ipc.open_file(source)
    batches = [file.get_batch(k) for k in range(file.num_record_batches)]
    start = np.cumsum([0, *(batch.num_rows for batch in batches)])
    for rows in np.split(order, range(lot, len(order), lot)) if len(order) else ():
        of_batch = np.searchsorted(start, rows, side="right") - 1
        parts = [
            batches[k].take(pa.array(rows[of_batch == k] - start[k])) for k in np.unique(of_batch)
        ]
        back = np.argsort(np.argsort(of_batch, kind="stable"))
        yield pa.Table.from_batches(parts).take(back)
