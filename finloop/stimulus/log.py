"""The log of a session: every displayed frame, every fish in it, every tick, input and event.

One table, a row an entry; `kind` is its kind:

- frame: a displayed frame. number, time_s: when the browser showed it, intended_s, drawn_s, seq: of
  the last rows of ticks that it had, dropped: frames missed before it, digest: of its pixels.
- fish: a fish in the frame `number`: fish, and the state that it was drawn from.
- tick: the ticks as planned. number, time_s: when planned, intended_s: when due, seq, digest: of
  the planned states. A tick that was planned again, as an animal had moved, has another row.
- input: a message of a tracker. time_s: its arrival, source, text: all of it, verdict.
- trial: the beginning or end of a trial; text: which, as JSON.
- event: anything else; text: what, as JSON.

Entries are written to a journal at least every half second, and made a Parquet file at the end.
"""

import hashlib
import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from finloop.base.arrays import Floats
from finloop.base.schema import ANY, Column, Schema, columns
from finloop.io.journal import Journal
from finloop.stimulus.drawn import FIELDS, States
from finloop.stimulus.tracker import LONGEST

FORMAT = 1
"""Version of the log; this program reads no other."""

FRAME_FIELDS = 8  # values of a record of a displayed frame, float64
SESSION = Schema(
    Column("kind", "string", "1"),
    Column("time_s", "float64", "s"),
    Column("trial", "int32", "1", nullable=True),
    Column("number", "int64", "1", nullable=True),
    Column("intended_s", "float64", "s", nullable=True),
    Column("drawn_s", "float64", "s", nullable=True),
    Column("seq", "int64", "1", nullable=True),
    Column("dropped", "int32", "1", nullable=True),
    Column("digest", "int64", "1", nullable=True),
    Column("fish", "int16", "1", nullable=True),
    *columns("float32", "1", *FIELDS, nullable=True),
    Column("posture", "float32", "1", nullable=True, length=ANY),
    *columns("string", "1", "source", "text", "verdict", nullable=True),
)


class Log:
    """Log of a session: it collects entries and writes them to a journal; any thread may add them.

    trial: number of the trial that entries belong to; None between trials.
    """

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """Create the journal's file, with a header of JSON values; FinloopError if it exists."""
        self._journal = Journal(path, SESSION, json.dumps(header))
        self._entries: list[dict[str, Any]] = []
        self._frames: list[tuple[int | None, Floats, States]] = []
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self.trial: int | None = None

    def add_entry(self, kind: str, time_s: float, **values: Any) -> None:
        """Add an entry of a tick, an input, a trial or an event, with the present trial's number.

        kind: one of these four words. time_s: session time. values: columns of `SESSION` by name.
        """
        with self._lock:
            self._entries.append({"kind": kind, "time_s": time_s, "trial": self.trial, **values})

    def add_event(self, time_s: float, what: str, **facts: Any) -> None:
        """Add an event: what happened at a session time [s], and facts that JSON can hold."""
        self.add_entry("event", time_s, text=json.dumps({"what": what, **facts}))

    def add_input(self, time_s: float, source: str, text: str, verdict: str) -> None:
        """Add a tracker's message: its arrival (session time [s]), sender, text and verdict."""
        self.add_entry("input", time_s, source=source, text=text[:LONGEST], verdict=verdict)

    def add_frame(self, facts: Floats, drawn: States) -> None:
        """Add a displayed frame: eight numbers about it, and the states (fish, F) of its fish.

        facts (8,): number of the frame, times when it was due, shown and drawn (s), number of the
        last message it had, frames dropped before it, count of fish, digest of its pixels.
        """
        with self._lock:
            self._frames.append((self.trial, facts, drawn))

    def write_entries(self) -> None:
        """Write all new entries to the disk; call it in a thread, as a disk may be slow."""
        with self._writing:
            with self._lock:  # others add entries to new lists while these are written
                entries, self._entries = self._entries, []
                frames, self._frames = self._frames, []
            batches = []
            if entries:
                table = pa.Table.from_pylist(entries, schema=self._journal.schema)
                batches += table.combine_chunks().to_batches()
            if frames:
                batches += [self._frame_rows(frames), *self._fish_rows(frames)]
            if batches:
                self._journal.append(batches)

    def close(self) -> None:
        """Write all remaining entries, and close the journal."""
        self.write_entries()
        self._journal.close()

    def _frame_rows(self, frames: list[tuple[int | None, Floats, States]]) -> pa.RecordBatch:
        """Return the log's rows of displayed frames as a record batch.

        frames: of each, its trial's number, and the arguments of `add_frame`.
        """
        number, intended, shown, drawn, seq, dropped, _fish, digest = np.stack(
            [facts for _, facts, _ in frames]
        ).T
        return self._build_batch(
            len(frames), kind="frame", trial=[trial for trial, _, _ in frames], time_s=shown,
            number=number, intended_s=intended, drawn_s=drawn, seq=seq, dropped=dropped,
            digest=digest,
        )  # fmt: skip

    def _fish_rows(self, frames: list[tuple[int | None, Floats, States]]) -> list[pa.RecordBatch]:
        """Return the log's rows of the fish in displayed frames: one record batch, or none.

        frames: of each, its trial's number, its numbers (8,) and the states (fish, F) of its fish.
        """
        counts = [len(drawn) for _, _, drawn in frames]
        if not sum(counts):
            return []
        facts = np.stack([facts for _, facts, _ in frames]).repeat(counts, axis=0)
        numbers, times_s = facts[:, 0], facts[:, 2]  # of the frame in which each fish is
        drawn = np.concatenate([drawn for _, _, drawn in frames if len(drawn)])
        posture = drawn[:, len(FIELDS) :]
        list_starts = np.arange(len(drawn) + 1, dtype=np.int32) * posture.shape[1]
        return [self._build_batch(
            len(drawn), kind="fish", time_s=times_s, number=numbers,
            trial=[trial for trial, _, drawn in frames for _ in drawn],
            fish=np.concatenate([np.arange(count) for count in counts]),
            posture=pa.ListArray.from_arrays(list_starts, posture.ravel()),
            **dict(zip(FIELDS, drawn.T, strict=False)),  # the posture is left over
        )]  # fmt: skip

    def _build_batch(self, rows: int, kind: str, **values: Any) -> pa.RecordBatch:
        """Return log entries of one kind as a record batch; columns without values are empty.

        rows: how many entries. values: each column's, (rows,), by the column's name.
        """
        schema, arrays = self._journal.schema, []
        for field in schema:
            column = {"kind": [kind] * rows, **values}.get(field.name)
            if isinstance(column, np.ndarray):
                column = pa.array(np.ascontiguousarray(column))
            if column is None:
                arrays.append(pa.nulls(rows, field.type))
            elif isinstance(column, pa.Array):
                arrays.append(column.cast(field.type))
            else:
                arrays.append(pa.array(column, field.type))
        return pa.RecordBatch.from_arrays(arrays, schema=schema)


def parse_frame_records(message: bytes, width: int) -> list[tuple[Floats, States]]:
    """Return the displayed frames in a page's message: numbers (8,) and states (fish, width) each.

    The numbers are those of `Log.add_frame`. width: how many values the state of a fish has.
    ValueError if the message holds no such records.
    """
    frames, offset = [], 0
    while offset < len(message):
        facts = np.frombuffer(message, "<f8", FRAME_FIELDS, offset)
        offset += facts.nbytes
        fish = facts[6]
        if not (0 <= fish <= 64 and fish == int(fish) and np.isfinite(facts).all()):
            raise ValueError("no record of a frame")
        drawn = np.frombuffer(message, "<f4", int(fish) * width, offset)
        drawn = drawn.reshape(int(fish), width)
        if not np.isfinite(drawn).all():
            raise ValueError("no state of a fish")
        offset += -(-drawn.nbytes // 8) * 8  # the next record begins at a multiple of 8 bytes
        frames.append((facts, drawn))
    return frames


def digest_states(states: States) -> int:
    """Return a hash of the states of fish: a whole number of 62 bits, equal for equal states."""
    digest = hashlib.blake2b(np.ascontiguousarray(states, "<f4").tobytes(), digest_size=8)
    return int.from_bytes(digest.digest(), "little") >> 2
