"""The cut-out store: every fish of every frame as a small picture with alpha, in one file.

It is an Arrow IPC file, mapped into memory on reading: opening is instant, access is random, and
only the cut-outs that are read are decompressed (zstd, each by itself). Any Arrow reader of any
language opens it. Pictures are (height, width, channels) uint8, channels = grey + alpha or RGB +
alpha, colour premultiplied by alpha.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_file
from finloop.io.record import remake_hint

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
BATCH = 256  # cut-outs per record batch
_CODEC = pa.Codec("zstd", compression_level=1)
Keys = NDArray[np.integer[Any]]


class CutoutWriter:
    """A new store of cut-outs; the file appears at `path` when the `with` block succeeds.

    sprites: whether they are sprites; the index then also has the columns sprite and orientation.
    """

    def __init__(self, path: Path, sprites: bool = False) -> None:
        self._path, self._schema = path, _SPRITES if sprites else _FILM
        self._rows: list[tuple[Any, ...]] = []

    def __enter__(self) -> "CutoutWriter":
        self._stack = ExitStack()
        part = self._stack.enter_context(whole_file(self._path))
        self._file = self._stack.enter_context(pa.ipc.new_file(str(part), self._schema))
        self._stack.push(self._flush)
        return self

    def write(self, cutout: Cutout) -> None:
        """Append one cut-out as the next row of the store."""
        pixels = np.ascontiguousarray(cutout.pixels)
        packed = _CODEC.compress(pixels, asbytes=True)
        key = cutout[5:] if self._schema is _SPRITES else ()
        self._append((*cutout[:4], *pixels.shape, *key, packed))

    def copy(self, store: "CutoutStore", rows: NDArray[np.intp], keys: Keys | None = None) -> None:
        """Append some rows of another store without decompressing their pixels.

        rows (k,): row numbers in that store. keys (k, 2): their new track_id and frame; None keeps
        the old.
        """
        index = store.index.to_numpy()[rows]
        if keys is not None:
            index[:, :2] = keys
        for row, of_row in zip(rows.tolist(), index.tolist(), strict=True):
            self._append((*of_row, store.pixel_buffer(row).to_pybytes()))

    def _append(self, row: tuple[Any, ...]) -> None:
        self._rows.append(row)
        if len(self._rows) >= BATCH:
            self._flush()

    def _flush(self, error: Any = None, *_: Any) -> None:
        if self._rows and error is None:
            columns = zip(*self._rows, strict=True)
            arrays = [pa.array(c, f.type) for c, f in zip(columns, self._schema, strict=True)]
            self._file.write_batch(pa.record_batch(arrays, schema=self._schema))
            self._rows = []

    def __exit__(self, *error: Any) -> bool | None:
        return self._stack.__exit__(*error)


def packed_size(cutout: Cutout) -> int:
    """Return the compressed size [bytes] of a cut-out's pixels in a store."""
    return len(_CODEC.compress(np.ascontiguousarray(cutout.pixels), asbytes=True))


@dataclass(frozen=True)
class CutoutStore:
    """An open store of cut-outs; `store[row]` loads one.

    index: a row per cut-out in the file's order: track_id, frame, x0_px, y0_px, height_px,
    width_px, channels. The store of `extract` is in the order (track_id, frame): a cut-out's number
    is its row in the table of tracks and in the feature table.
    """

    index: pd.DataFrame
    _pixels: pa.ChunkedArray

    def __len__(self) -> int:
        return len(self.index)

    def pixel_buffer(self, row: int) -> pa.Buffer:
        """Return the compressed (zstd) pixels of cut-out number `row` of the index."""
        return self._pixels[row].as_buffer()

    def __getitem__(self, row: int) -> Cutout:
        """Load cut-out number `row` of the index; FinloopError if it is damaged."""
        track_id, frame, x0, y0, *shape = self._places[row, :7].tolist()
        try:
            raw = _CODEC.decompress(self.pixel_buffer(row), decompressed_size=int(np.prod(shape)))
        except (OSError, pa.ArrowException) as error:
            came = f"cut-out {row} of the store is damaged ({error})"
            raise FinloopError(came, *remake_hint("extract")) from error
        pixels = np.frombuffer(raw, np.uint8).reshape(shape)
        return Cutout(track_id, frame, x0, y0, pixels, *self._places[row, 7:].tolist())

    @cached_property
    def _places(self) -> NDArray[np.integer[Any]]:
        """Return the index as one array, which is read much faster row by row."""
        return self.index.to_numpy()


@contextmanager
def open_cutouts(path: Path) -> Iterator[CutoutStore]:
    """Open the store of cut-outs at `path` and yield it; it is closed at the end of the block.

    FinloopError if the file is missing, damaged, or no cut-out store.
    """
    with ExitStack() as stack:
        try:
            source = stack.enter_context(pa.memory_map(str(path)))
            table = pa.ipc.open_file(source).read_all()
        except (OSError, pa.ArrowException) as error:
            came = f"{path} cannot be read as a cut-out store ({error})"
            raise FinloopError(came, *remake_hint("extract")) from error
        if not any(map(table.schema.equals, (_FILM, _SPRITES))):
            raise FinloopError(
                came=f"{path} has the columns {', '.join(table.column_names)}",
                wanted=", ".join(_FILM.names) + "; of sprites " + ", ".join(_KEY) + " too",
                do="make it again: `dvc repro --force extract`",
            )
        yield CutoutStore(table.drop_columns("pixels").to_pandas(), table.column("pixels"))
