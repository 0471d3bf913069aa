"""The log of a session: every displayed frame, every fish in it, every tick, input and event.

One table, a row an entry; `kind` is its kind:

- frame: a displayed frame. number, time_s: when the browser showed it, intended_s, drawn_s, seq: of
  the last rows of ticks that it had, dropped: frames missed before it, digest: of its pixels.
- fish: a fish in the frame `number`: fish, and the state that it was drawn from: nulls, and a
  posture of zeros, where it was not drawn, as before its first tick.
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
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from finloop.base.schema import ANY, Column, Schema, columns
from finloop.io.journal import Journal
from finloop.show.drawn import FIELDS, PICTURE, States

FORMAT = 1
"""Version of the log; this program reads no other."""

MOST_SHOWN = 64  # fish in a frame
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


class FrameFacts(NamedTuple):
    """Facts about a displayed frame, as the page reports them: eight numbers.

    number: of the frame. intended_s, time_s, drawn_s: session times when it was due, when the
    browser showed it, and when it was drawn. seq: number of the last message with states that the
    page had. dropped: frames missed before it. fish_count: how many fish it shows. digest: of its
    pixels, 0 if they were not read.
    """

    number: float
    intended_s: float
    time_s: float
    drawn_s: float
    seq: float
    dropped: float
    fish_count: float
    digest: float


class _LoggedFrame(NamedTuple):
    """A displayed frame in the log: number of its trial, facts, and states (fish, fields)."""

    trial: int | None
    facts: FrameFacts
    states: States


class Log:
    """Log of a session: it collects entries and writes them to a journal; any thread may add them.

    trial: number of the trial that entries belong to; None between trials.
    """

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """Create the journal's file, with a header of JSON values; FinloopError if it exists."""
        self._journal = Journal(path, SESSION, json.dumps(header))
        self._entries: list[dict[str, Any]] = []
        self._frames: list[_LoggedFrame] = []
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self.trial: int | None = None

    def add_entry(self, kind: str, time_s: float, **values: Any) -> None:
        """Add an entry of a tick, an input, a trial or an event, with the present trial's number.

        time_s: session time. values: columns of `SESSION` by name.
        """
        with self._lock:
            self._entries.append({"kind": kind, "time_s": time_s, "trial": self.trial, **values})

    def add_frame(self, facts: FrameFacts, states: States, trial: int | None) -> None:
        """Add a displayed frame, the states (fish, fields) of its fish, and its trial's number."""
        with self._lock:
            self._frames.append(_LoggedFrame(trial, facts, states))

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

    def _frame_rows(self, frames: list[_LoggedFrame]) -> pa.RecordBatch:
        """Return a record batch with one row of the log for each displayed frame."""
        facts = np.array([frame.facts for frame in frames]).T
        values = dict(zip(FrameFacts._fields, facts, strict=True))
        del values["fish_count"]
        trials = [frame.trial for frame in frames]
        return self._build_batch(len(frames), kind="frame", trial=trials, **values)

    def _fish_rows(self, frames: list[_LoggedFrame]) -> list[pa.RecordBatch]:
        """Return the rows of the log for the fish in displayed frames: one record batch or none."""
        frames = [frame for frame in frames if len(frame.states)]
        if not frames:
            return []
        counts = [len(frame.states) for frame in frames]
        states = np.concatenate([frame.states for frame in frames])
        is_absent, posture = states[:, PICTURE] < 0, states[:, len(FIELDS) :]
        list_starts = np.arange(len(states) + 1, dtype=np.int32) * posture.shape[1]
        return [self._build_batch(
            len(states), kind="fish",
            time_s=np.repeat([frame.facts.time_s for frame in frames], counts),
            number=np.repeat([frame.facts.number for frame in frames], counts),
            trial=[frame.trial for frame in frames for _ in frame.states],
            fish=np.concatenate([np.arange(count) for count in counts]),
            posture=pa.ListArray.from_arrays(list_starts, posture.ravel()),
            **{  # the posture is left over
                name: pa.array(values, mask=is_absent)
                for name, values in zip(FIELDS, states.T, strict=False)
            },
        )]  # fmt: skip

    def _build_batch(self, rows: int, kind: str, **values: Any) -> pa.RecordBatch:
        """Return log entries of one kind as a record batch; columns without values are empty."""
        schema, given = self._journal.schema, {"kind": [kind] * rows, **values}
        arrays = [
            pa.array(given[field.name]).cast(field.type)
            if field.name in given else pa.nulls(rows, field.type)
            for field in schema
        ]  # fmt: skip
        return pa.RecordBatch.from_arrays(arrays, schema=schema)


def parse_frame_records(message: bytes, width: int) -> list[tuple[FrameFacts, States]]:
    """Return the displayed frames in a page's message: facts, and the states (fish, width) of fish.

    width: how many values the state of a fish has. ValueError if the message holds no such records.
    """
    frames, offset = [], 0
    while offset < len(message):
        numbers = np.frombuffer(message, "<f8", len(FrameFacts._fields), offset)
        offset += numbers.nbytes
        facts = FrameFacts(*numbers.tolist())
        is_count = facts.fish_count in range(MOST_SHOWN + 1)
        whole_numbers = (facts.number, facts.seq, facts.dropped, facts.digest)
        is_whole = all(value.is_integer() for value in whole_numbers)
        # So the columns of the log hold them; NaN is refused, too.
        is_in_range = all(abs(value) < 2**53 for value in facts) and abs(facts.dropped) < 2**31
        if not (is_count and is_whole and is_in_range):
            raise ValueError("no record of a frame")
        fish = int(facts.fish_count)
        states = np.frombuffer(message, "<f4", fish * width, offset).reshape(fish, width)
        if not np.isfinite(states).all():
            raise ValueError("no state of a fish")
        offset += -(-states.nbytes // 8) * 8  # the next record begins at a multiple of 8 bytes
        frames.append((facts, states))
    return frames


def digest_states(states: States) -> int:
    """Return a hash of the states of fish: a whole number of 62 bits, equal for equal states."""
    digest = hashlib.blake2b(np.ascontiguousarray(states, "<f4").tobytes(), digest_size=8)
    return int.from_bytes(digest.digest(), "little") >> 2
