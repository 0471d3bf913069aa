"""A journal: a table that grows while it is written, and survives a power failure.

It is an Arrow stream. Each part is on the disk when `append` returns, so after a failure everything
up to the last `append` can be read. `read_journal` stops at a part that was cut off. The process
that writes a journal, or recovers one, holds it (`hold_journal`).
"""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from finloop.base.errors import FinloopError
from finloop.base.schema import Schema
from finloop.io.atomic import whole_file
from finloop.io.table import arrow_schema, parquet_coding

_HEADER = b"finloop"  # the key of the header in the file's metadata


class Journal:
    """A table in a file that grows by appending; appended rows are on the disk at once.

    header: a text kept with the table, such as the settings of a session.
    """

    def __init__(self, path: Path, schema: Schema, header: str) -> None:
        """Create the file with its header; FinloopError if there is a file at `path` already."""
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._file = path.open("xb")
        except FileExistsError as error:
            raise FinloopError(
                f"{path} exists already",
                "a name that is free: no file is overwritten",
                "take another folder (--out), or recover that file first",
            ) from error
        self.schema = arrow_schema(schema).with_metadata({_HEADER: header.encode()})
        self._writer = pa.ipc.new_stream(self._file, self.schema)
        self._sync()

    def append(self, parts: list[pa.RecordBatch]) -> None:
        """Append record batches of rows; return when they are on the disk."""
        for part in parts:
            self._writer.write_batch(part)
        self._sync()

    def _sync(self) -> None:
        """Wait until all written bytes are on the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """End the journal and close its file; do nothing if it is closed."""
        if not self._file.closed:
            self._writer.close()
            self._sync()
            self._file.close()


@contextmanager
def hold_journal(path: Path) -> Iterator[None]:
    """Hold a journal for one process until the block ends, or until the process does.

    FinloopError if another process holds it, or if the file cannot be opened. Where the system or
    the folder knows no locks, nothing is held.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("r+b"))
        except OSError as error:
            raise _unreadable_error(path, error) from error
        if sys.platform != "win32":
            import fcntl

            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise FinloopError(
                    f"{path} is in use: its session runs, or is being recovered",
                    "the journal of a session that was cut off",
                    "end the session in its own terminal (Ctrl-C): it then writes its file itself",
                ) from error
            except OSError:  # a network folder without locks
                pass
        yield


@contextmanager
def read_journal(path: Path) -> Iterator[tuple[pa.Schema, Iterator[pa.RecordBatch]]]:
    """Open a journal; yield its Arrow schema, and its record batches up to where it was cut off.

    FinloopError if not even its beginning can be read.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("rb"))
            reader = stack.enter_context(pa.ipc.open_stream(file))
        except (OSError, pa.ArrowException, MemoryError) as error:
            raise _unreadable_error(path, error) from error
        yield reader.schema, _read_intact_batches(reader)


def _unreadable_error(path: Path, error: Exception) -> FinloopError:
    """Return the error for a file that is no journal, or cannot be opened."""
    return FinloopError(
        f"{path} cannot be read ({str(error).partition(chr(10))[0]})",
        "the journal of a session",
        "name another .journal file: one cut off at its start holds no rows to recover",
    )


def _read_intact_batches(reader: pa.RecordBatchStreamReader) -> Iterator[pa.RecordBatch]:
    """Yield the record batches of a journal up to the first that is cut off or damaged."""
    while True:
        try:
            part = reader.read_next_batch()
            part.validate(full=True)
        # MemoryError: a damaged part declares a size that no memory holds.
        except (StopIteration, OSError, pa.ArrowException, MemoryError):
            return
        yield part


def save_journal(journal: Path, path: Path, schema: Schema) -> int:
    """Convert a journal to the Parquet file `path`, whole or not at all; return its row count."""
    rows, coding = 0, parquet_coding(schema)
    with (
        read_journal(journal) as (arrow, parts),
        whole_file(path) as new_path,
        pq.ParquetWriter(new_path, arrow, **coding) as file,
    ):
        for part in parts:
            file.write_batch(part)
            rows += part.num_rows
    return rows


def read_header(metadata: Mapping[bytes, bytes] | None) -> str | None:
    """Return the header text of a journal from its Arrow schema's metadata; None if it has none."""
    text = (metadata or {}).get(_HEADER)
    return None if text is None else text.decode()
