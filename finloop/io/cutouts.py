"""The cut-out store: every fish of every frame as a small picture with alpha, in one file.

It is an Arrow IPC file, mapped into memory on reading: opening is instant, access is random, and
only the cut-outs that are read are decompressed (zstd, each by itself). Pictures are (height,
width, channels) uint8, channels = grey + alpha or RGB + alpha, colour premultiplied by alpha.

A film's cut-outs and its table of tracks have one order, (track_id, frame): a row is a cut-out.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.schema import Schema
from finloop.io.atomic import whole_file
from finloop.io.checksums import check_file
from finloop.io.record import remake_hint
from finloop.io.table import arrow_schema, arrow_table, parquet_coding

TRACKS_NAME, CUTOUTS_NAME = "tracks.parquet", "cutouts.arrow"

_INDEX = {
    "track_id": (pa.int32(), "1"),
    "frame": (pa.int32(), "1"),
    "x0_px": (pa.int32(), "px"),
    "y0_px": (pa.int32(), "px"),
    "height_px": (pa.int16(), "px"),
    "width_px": (pa.int16(), "px"),
    "channels": (pa.int8(), "1"),
}
_KEY = {"sprite": (pa.int32(), "1"), "orientation": (pa.int8(), "1")}
_FILM, _SPRITES = (
    pa.schema(
        [pa.field(name, kind, False, {"unit": unit}) for name, (kind, unit) in index.items()]
        + [pa.field("pixels", pa.binary(), False, {"codec": "zstd"})]
    )
    for index in (_INDEX, _INDEX | _KEY)
)
_BATCH = 256  # cut-outs per record batch
_TABLE_BATCH = 4096  # rows of the table of tracks in memory
_CODEC = pa.Codec("zstd", compression_level=1)
Rows = NDArray[np.intp]
Write = Callable[[pd.DataFrame, Iterable[Cutout]], None]


class CutoutWriter:
    """Writes a new store of cut-outs, the pixels of each fish; the file appears when complete.

    sprites: whether each cut-out also has a sprite number and an orientation.
    """

    def __init__(self, path: Path, sprites: bool = False) -> None:
        """Prepare a writer of the store at `path`; nothing is written before the `with` block."""
        self._path, self._schema = path, _SPRITES if sprites else _FILM
        self._rows: list[tuple[Any, ...]] = []

    def __enter__(self) -> "CutoutWriter":
        """Open a temporary file beside the path and return this writer."""
        self._stack = ExitStack()
        part = self._stack.enter_context(whole_file(self._path))
        self._file = self._stack.enter_context(pa.ipc.new_file(str(part), self._schema))
        self._stack.push(self._flush)
        return self

    def write(self, cutout: Cutout) -> None:
        """Append one cut-out to the store: its place, and its pixels, compressed."""
        pixels = np.ascontiguousarray(cutout.pixels)
        packed = _CODEC.compress(pixels, asbytes=True)
        # Before the pixels: track, frame and place; after them, of sprites: number, orientation.
        key = cutout[5:] if self._schema is _SPRITES else ()
        self._keep_row((*cutout[:4], *pixels.shape, *key, packed))

    def copy_cutouts(
        self, store: "CutoutStore", rows: Rows, track_frames: NDArray[np.integer] | None = None
    ) -> None:
        """Append cut-outs of another store, without decompressing their pixels.

        rows (k,): which cut-outs of `store`. track_frames (k, 2): their new track_id and frame;
        None keeps the old.
        """
        index = store.index.to_numpy()[rows]
        if track_frames is not None:
            index[:, :2] = track_frames
        for row, entry in zip(rows.tolist(), index.tolist(), strict=True):
            self._keep_row((*entry, store.pixel_buffer(row).to_pybytes()))

    def _keep_row(self, row: tuple[Any, ...]) -> None:
        """Keep a row, its index columns and compressed pixels, for the next batch to write."""
        self._rows.append(row)
        if len(self._rows) >= _BATCH:
            self._flush()

    def _flush(self, error: Any = None, *_: Any) -> None:
        """Write the rows kept so far as one batch, unless the `with` block has failed.

        error: what ended the block; None if it goes on, or has succeeded.
        """
        if self._rows and error is None:
            columns = list(zip(*self._rows, strict=True))
            self._file.write_batch(pa.record_batch(columns, schema=self._schema))
            self._rows = []

    def __exit__(self, *error: Any) -> bool | None:
        """Write the rest and let the file appear at its path, or remove it after an error."""
        return self._stack.__exit__(*error)


def compressed_size(cutout: Cutout) -> int:
    """Return the size [bytes] that a cut-out's compressed pixels take in a store."""
    return len(_CODEC.compress(np.ascontiguousarray(cutout.pixels), asbytes=True))


@dataclass(frozen=True)
class CutoutStore:
    """An open store of cut-outs, the pixels of each fish with alpha; `store[row]` loads one.

    index: a row per cut-out: track_id, frame, x0_px, y0_px, height_px, width_px, channels. In the
    store of `extract` it is also the cut-out's row in the tables of tracks and features.
    """

    index: pd.DataFrame
    _pixels: pa.ChunkedArray

    def __len__(self) -> int:
        """Return the number of cut-outs in the store."""
        return len(self.index)

    def pixel_buffer(self, row: int) -> pa.Buffer:
        """Return the compressed (zstd) pixels of the cut-out in row `row` of the index."""
        return self._pixels[row].as_buffer()

    def __getitem__(self, row: int) -> Cutout:
        """Load the cut-out in row `row` of the index; FinloopError if it is damaged."""
        track_id, frame, x0, y0, *shape = self._index_values[row, :7].tolist()
        try:
            raw = _CODEC.decompress(self.pixel_buffer(row), decompressed_size=int(np.prod(shape)))
        except (OSError, pa.ArrowException) as error:
            came = f"cut-out {row} of the store is damaged ({error})"
            raise FinloopError(came, *remake_hint("extract")) from error
        pixels = np.frombuffer(raw, np.uint8).reshape(shape)
        return Cutout(track_id, frame, x0, y0, pixels, *self._index_values[row, 7:].tolist())

    @cached_property
    def _index_values(self) -> NDArray[np.integer[Any]]:
        """Return the index as an integer array, of which single rows can be read quickly."""
        return self.index.to_numpy()


@contextmanager
def open_cutouts(path: Path) -> Iterator[CutoutStore]:
    """Open a store of cut-outs for reading; close it when the block ends.

    FinloopError if the file is missing, damaged, or not a store of cut-outs (pixels of fish with
    alpha).
    """
    with ExitStack() as stack:
        try:
            source = stack.enter_context(pa.memory_map(str(check_file(path))))
            table = pa.ipc.open_file(source).read_all()
        except (OSError, pa.ArrowException) as error:
            came = f"{path} cannot be read as a cut-out store ({error})"
            raise FinloopError(came, *remake_hint("extract")) from error
        if not any(map(table.schema.equals, (_FILM, _SPRITES))):  # neither a film's nor sprites
            raise FinloopError(
                came=f"{path} has the columns {', '.join(table.column_names)}",
                wanted=", ".join(_FILM.names) + "; of sprites " + ", ".join(_KEY) + " too",
                do="make it again: `dvc repro --force extract`",
            )
        yield CutoutStore(table.drop_columns("pixels").to_pandas(), table.column("pixels"))


@contextmanager
def tracks_writer(folder: Path, schema: Schema) -> Iterator[Write]:
    """Yield a function that appends rows of the table of tracks, and a cut-out for each row.

    At the end of the block, both are sorted by track and written to `folder` as tracks.parquet and
    cutouts.arrow. schema: of the table of tracks. A track's rows must come in the order of their
    frames. Only a few thousand rows are in memory at a time.
    """
    unsorted_table = folder / "unsorted-tracks.arrow"
    unsorted_store = folder / f"unsorted-{CUTOUTS_NAME}"
    arrow, track_ids = arrow_schema(schema), [np.empty(0, np.int32)]
    with (
        pa.ipc.new_file(str(unsorted_table), arrow) as table,
        CutoutWriter(unsorted_store) as store,
    ):

        def write(rows: pd.DataFrame, cutouts: Iterable[Cutout]) -> None:
            """Append rows of the table of tracks, and one cut-out for each of them."""
            table.write_table(arrow_table(rows, schema, TRACKS_NAME))
            track_ids.append(rows["track_id"].to_numpy(np.int32))
            for cutout in cutouts:
                store.write(cutout)

        yield write
    order = np.argsort(np.concatenate(track_ids), kind="stable")
    with pq.ParquetWriter(folder / TRACKS_NAME, arrow, **parquet_coding(schema)) as sorted_table:
        for rows in _read_in_order(unsorted_table, order, _TABLE_BATCH):
            sorted_table.write_table(rows)
    with pa.ipc.new_file(str(folder / CUTOUTS_NAME), _FILM) as sorted_store:
        for rows in _read_in_order(unsorted_store, order, _BATCH):
            sorted_store.write_table(rows.combine_chunks())
    unsorted_table.unlink()
    unsorted_store.unlink()


def _read_in_order(path: Path, order: Rows, most_rows: int) -> Iterator[pa.Table]:
    """Yield the rows of an Arrow file in a given order, as tables of at most `most_rows` rows.

    order: row numbers of the file, in the wanted order.
    """
    with pa.memory_map(str(path)) as source:
        file = pa.ipc.open_file(source)
        batches = [file.get_batch(k) for k in range(file.num_record_batches)]
        batch_starts = np.cumsum([0, *(batch.num_rows for batch in batches)])
        for first in range(0, len(order), most_rows):
            rows = order[first : first + most_rows]
            # The number of the batch that holds each row.
            holder = np.searchsorted(batch_starts, rows, side="right") - 1
            taken = [
                batches[k].take(pa.array(rows[holder == k] - batch_starts[k]))
                for k in np.unique(holder)
            ]
            # Taken rows are sorted by batch; this inverse permutation restores the wanted order.
            restore = np.argsort(np.argsort(holder, kind="stable"))
            yield pa.Table.from_batches(taken).take(restore)
