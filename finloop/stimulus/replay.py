"""Replay of a session from its file: every frame as it was drawn, every tick as planned."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from finloop.base.errors import FinloopError
from finloop.io.journal import read_header
from finloop.show.drawn import FIELDS, PICTURE, States
from finloop.stimulus.animals import TAKEN, LiveAnimals
from finloop.stimulus.log import FORMAT, SESSION, digest_states
from finloop.stimulus.motion import ReactiveMotion, TrialContext, TrialSetup, plan_motion
from finloop.stimulus.order import Trial
from finloop.stimulus.protocol import Protocol

_NO_FISH = np.zeros((0, len(FIELDS)), np.float32)
_WANTED = "the .parquet file of a session, whole, of this version"


@dataclass(frozen=True)
class SessionRecord:
    """A session's Parquet file, with its header: what was known when the session began."""

    path: Path
    header: dict[str, Any]

    def read_batches(self, columns: list[str]) -> Iterator[pa.RecordBatch]:
        """Yield the log's rows in order, with some columns; FinloopError at a damaged page."""
        try:
            with pq.ParquetFile(self.path, page_checksum_verification=True) as file:
                yield from file.iter_batches(columns=columns)
        except (OSError, pa.ArrowException) as error:
            raise _unreadable_error(self.path, error) from error

    def read_rows(self, *kinds: str) -> Iterator[dict[str, Any]]:
        """Yield the log's rows of some kinds ("trial" …) in order, by column, without states."""
        names = [name for name in SESSION.names if name not in (*FIELDS, "posture")]
        for batch in self.read_batches(names):
            rows = batch.filter(pc.is_in(batch["kind"], pa.array(kinds)))
            yield from rows.to_pylist()


def open_session_record(path: Path) -> SessionRecord:
    """Return the record of a session: its Parquet file, with the header that is read from it.

    FinloopError if the file is no session, cut off, or of another version.
    """
    try:
        file = pq.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        raise _unreadable_error(path, error) from error
    text = read_header(file.schema_arrow.metadata)
    if text is None or file.schema_arrow.names != SESSION.names:
        raise FinloopError(f"{path} is no session", _WANTED, "name another file")
    try:
        header = dict(json.loads(text))
    except (TypeError, ValueError, RecursionError) as error:
        raise _unreadable_error(path, error) from error
    if header.get("format") != FORMAT:
        raise FinloopError(
            f"{path} is a session of format {header.get('format')}, made by finloop "
            f"{header.get('finloop')}",
            f"one of format {FORMAT}",
            "show it again with the version of finloop that made it",
        )
    return SessionRecord(path, header)


def _unreadable_error(path: Path, error: Exception) -> FinloopError:
    """Return the error for a damaged file of a session."""
    why = next(iter(str(error).splitlines()), type(error).__name__)
    advice = "recover it from its journal: python -m stages.stimulus recover <name>.journal"
    return FinloopError(f"{path} cannot be read ({why})", _WANTED, advice)


class DisplayedFrame(NamedTuple):
    """A displayed frame: its number, when it was shown, and the states (fish, fields) of its fish.

    shown_s: session time. digest: of its pixels.
    """

    number: int
    shown_s: float
    digest: int
    states: States


def read_displayed_frames(record: SessionRecord) -> Iterator[DisplayedFrame]:
    """Yield every displayed frame of a session, with the states of its fish."""
    columns = ["kind", "time_s", "number", "digest", "fish", *FIELDS, "posture"]
    states_of_frame: dict[int, list[States]] = {}

    def complete_frame(number: int, shown_s: float, digest: int) -> DisplayedFrame:
        """Return a frame with the states of its fish, all of which have been read."""
        states = states_of_frame.pop(number, [])
        return DisplayedFrame(number, shown_s, digest, np.stack(states) if states else _NO_FISH)

    # The fish of a frame are in its own batch of rows or in the next one: so frames wait for that.
    waiting: list[tuple[int, float, int]] = []  # number, time and digest of the last batch's frames
    for batch in record.read_batches(columns):
        for number, state in _fish_states(batch):
            states_of_frame.setdefault(number, []).append(state)
        yield from starmap(complete_frame, waiting)
        rows = batch.filter(pc.equal(batch["kind"], "frame"))
        values = [rows[name].to_pylist() for name in ("number", "time_s", "digest")]
        waiting = list(zip(*values, strict=True))
    yield from starmap(complete_frame, waiting)


def _fish_states(batch: pa.RecordBatch) -> Iterator[tuple[int, States]]:
    """Yield (number of its frame, state (fields,)) of each fish in a batch of the log's rows."""
    rows = batch.filter(pc.equal(batch["kind"], "fish"))
    if not rows.num_rows:
        return
    is_absent = rows["picture"].is_null().to_numpy(zero_copy_only=False)
    fields = np.column_stack(
        [rows[name].fill_null(0).to_numpy(zero_copy_only=False) for name in FIELDS]
    )
    fields[is_absent, PICTURE] = -1  # so the page has it for a fish that is not drawn
    posture = rows["posture"].flatten().to_numpy().reshape(len(fields), -1)
    states = np.concatenate([fields, posture], axis=1).astype(np.float32)
    yield from zip(rows["number"].to_pylist(), states, strict=True)


# --- planned again


class ReplanResult(NamedTuple):
    """How many ticks of a session were planned again, and how many of them differ from its log."""

    ticks: int
    different: int


def replan_session(
    record: SessionRecord, context: TrialContext, protocol: Protocol
) -> ReplanResult:
    """Plan a session again from its logged inputs; return its ticks, and how many differ.

    context: what all its trials share, of the same film and parameters; protocol: the one in the
    session's header.
    """
    planner = _SessionPlanner(context, protocol)
    ticks = different = 0
    for row in record.read_rows("trial", "tick", "input"):
        match row["kind"]:
            case "trial":
                planner.handle_trial(json.loads(row["text"]))
            case "input":
                planner.handle_input(row)
            case _:
                states = planner.plan_tick(row)
                ticks += 1
                different += states is None or digest_states(states) != row["digest"]
    return ReplanResult(ticks, different)


class _SessionPlanner:
    """Planner of a logged session: it is given the log's rows in order, and plans the ticks."""

    def __init__(self, context: TrialContext, protocol: Protocol) -> None:
        """Begin without a trial and without animals."""
        self._context, self._protocol = context, protocol
        self._animals = LiveAnimals(protocol.animals, context.tank, context.mm_per_px)
        self._motions: dict[str, States] = {}  # of the latest trial of each condition
        # Of the present trial: its states if they are known beforehand, or the fish that react.
        self._known: States | None = None
        self._reaction: ReactiveMotion | None = None
        self._replanned: States | None = None  # the last tick, planned again as an animal had moved

    def handle_trial(self, facts: dict[str, Any]) -> None:
        """Begin or end a trial, as a row of the log says; plan its motion if it ignores animals.

        facts: content of that row. A motion that reacts to animals is planned tick by tick, later.
        """
        if facts["what"] == "start":
            trial = Trial(**{key: facts[key] for key in Trial._fields})
            setup = TrialSetup.from_protocol(self._protocol, trial)
            self._reaction = self._known = None
            if setup.condition.motion.rule is not None:
                self._reaction = ReactiveMotion(self._context, setup, self._animals)
                return
            motion = plan_motion(self._context, setup, self._motions)
            self._motions[trial.condition] = motion
            self._known = setup.apply_look_and_fade(motion, self._context.rate_hz)
        elif self._reaction is not None:
            if (states := self._reaction.planned_states) is not None:
                self._motions[facts["condition"]] = states
            self._reaction = None

    def handle_input(self, row: dict[str, Any]) -> None:
        """Handle a tracker's message, a row of the log; if fish react, plan the last tick again."""
        if row["verdict"] == "malformed":
            return
        verdicts = self._animals.receive_message(row["text"], row["source"], row["time_s"])
        is_stored = not set(TAKEN).isdisjoint(verdicts)  # at least one sighting was not refused
        if self._reaction is not None and is_stored:
            self._replanned = self._reaction.replan_tick(row["time_s"])

    def plan_tick(self, row: dict[str, Any]) -> States | None:
        """Return the states (fish, fields) of the tick in a log's row; None if there are none.

        A row with the verdict "anew" gets the states that the last input had planned again.
        """
        if self._known is not None:
            return self._known[row["number"]]
        if row["verdict"] == "anew":  # replanned by the last input (`handle_input`)
            states, self._replanned = self._replanned, None  # for this row only
            return states
        return None if self._reaction is None else self._reaction.plan_tick(row["time_s"])
