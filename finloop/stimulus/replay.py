"""Replay of a session from its file: every frame as it was drawn, every tick as planned."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from finloop.base.errors import FinloopError
from finloop.io.journal import read_header
from finloop.stimulus.animals import TAKEN, LiveAnimals
from finloop.stimulus.drawn import FIELDS, States
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

    def open_file(self) -> pq.ParquetFile:
        """Open the session's Parquet file and return it."""
        return pq.ParquetFile(self.path)

    def read_rows(self, *kinds: str) -> Iterator[dict[str, Any]]:
        """Yield the log's rows of some kinds ("trial" …) in order, by column, without states."""
        names = [name for name in SESSION.names if name not in (*FIELDS, "posture")]
        for batch in self.open_file().iter_batches(columns=names):
            rows = batch.filter(pc.is_in(batch["kind"], pa.array(kinds)))
            yield from rows.to_pylist()


def open_session_record(path: Path) -> SessionRecord:
    """Open a session's Parquet file and read its header.

    FinloopError if the file is no session, cut off, or of another version.
    """
    try:
        file = pq.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        advice = "make it whole from its journal: python -m stages.stimulus recover <name>.journal"
        came = f"{path} cannot be read ({str(error).splitlines()[0]})"
        raise FinloopError(came, _WANTED, advice) from error
    text = read_header(file.schema_arrow.metadata)
    if text is None or file.schema_arrow.names != SESSION.names:
        raise FinloopError(f"{path} is no session", _WANTED, "name another file")
    header = json.loads(text)
    if header.get("format") != FORMAT:
        raise FinloopError(
            f"{path} is a session of format {header.get('format')}, made by finloop "
            f"{header.get('finloop')}",
            f"one of format {FORMAT}",
            "show it again with the version of finloop that made it",
        )
    return SessionRecord(path, header)


class DisplayedFrame(NamedTuple):
    """A displayed frame: its number, when it was shown, and the states (fish, F) of its fish.

    shown_s: session time. digest: of its pixels.
    """

    number: int
    shown_s: float
    digest: int
    states: States


def read_displayed_frames(record: SessionRecord) -> Iterator[DisplayedFrame]:
    """Yield every displayed frame of a session, with the states of its fish."""
    columns = ["kind", "time_s", "number", "digest", "fish", *FIELDS, "posture"]
    frames: list[tuple[int, float, int]] = []  # number, time and digest of the last batch's frames
    states_of_frame: dict[int, list[States]] = {}
    # The fish of a frame are in its own batch or in the next one, which after the last is None.
    for batch in chain(record.open_file().iter_batches(columns=columns), [None]):
        if batch is not None:
            for number, state in _fish_states(batch):
                states_of_frame.setdefault(number, []).append(state)
        for frame in frames:
            states = states_of_frame.pop(frame[0], [])
            yield DisplayedFrame(*frame, np.stack(states) if states else _NO_FISH)
        if batch is not None:
            rows = batch.filter(pc.equal(batch["kind"], "frame"))
            values = [rows[name].to_pylist() for name in ("number", "time_s", "digest")]
            frames = list(zip(*values, strict=True))


def _fish_states(batch: pa.RecordBatch) -> Iterator[tuple[int, States]]:
    """Yield (number of its frame, state (F,)) of each fish in a batch of the log's rows."""
    rows = batch.filter(pc.equal(batch["kind"], "fish"))
    if not rows.num_rows:
        return
    fields = np.column_stack([rows[name].to_numpy(zero_copy_only=False) for name in FIELDS])
    posture = rows["posture"].flatten().to_numpy().reshape(len(fields), -1)
    states = np.concatenate([fields, posture], axis=1).astype(np.float32)
    yield from zip(rows["number"].to_pylist(), states, strict=True)


# --- planned again


class ReplanResult(NamedTuple):
    """How many ticks of a session were planned again, and how many of them differ from its log."""

    ticks: int
    different: int


def replan_session(record: SessionRecord, scene: TrialContext, protocol: Protocol) -> ReplanResult:
    """Plan a session again from its logged inputs; return how many ticks differ from its log.

    scene: of the same film and parameters; protocol: the one in the session's header.
    """
    animals = LiveAnimals(protocol.animals, scene.tank, scene.mm_per_px)
    motions: dict[str, States] = {}
    reaction: ReactiveMotion | None = None
    known: States | None = None  # states of a motion that is known beforehand
    replanned: States | None = None  # the last tick, planned again as an animal had moved
    ticks = different = 0
    for row in record.read_rows("trial", "tick", "input"):
        if row["kind"] == "trial":
            facts = json.loads(row["text"])
            if facts["what"] == "start":
                trial = Trial(**{key: facts[key] for key in Trial._fields})
                setup = TrialSetup.from_protocol(protocol, trial)
                reaction = known = None
                if setup.condition.motion.rule is not None:
                    reaction = ReactiveMotion(scene, setup, animals)
                else:
                    motion = motions[trial.condition] = plan_motion(scene, setup, motions)
                    known = setup.apply_look_and_fade(motion, scene.rate_hz)
            elif reaction is not None:
                if (planned := reaction.planned_states) is not None:
                    motions[facts["condition"]] = planned
                reaction = None
        elif row["kind"] == "input":
            if row["verdict"] != "malformed":
                verdicts = animals.receive_message(row["text"], row["source"], row["time_s"])
                if reaction is not None and not set(TAKEN).isdisjoint(verdicts):
                    replanned = reaction.replan_tick(row["time_s"])
        else:  # a tick
            if known is not None:
                states: States | None = known[row["number"]]
            elif row["verdict"] == "anew":
                states, replanned = replanned, None
            else:
                states = None if reaction is None else reaction.plan_tick(row["time_s"])
            ticks += 1
            different += states is None or digest_states(states) != row["digest"]
    return ReplanResult(ticks, different)
