"""Replay of a session from its file: every frame as it was drawn, every tick as planned."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.io.journal import header_text
from finloop.stimulus.animals import LiveAnimals
from finloop.stimulus.course import (
    Reaction,
    States,
    TrialContext,
    collect_motion,
    cue_of,
    plan_motion,
    repeat_motion,
)
from finloop.stimulus.drawn import FIELDS
from finloop.stimulus.log import FORMAT, SESSION, digest_of
from finloop.stimulus.order import Trial
from finloop.stimulus.protocol import Protocol

_WANTED = "the .parquet file of a session, whole, of this version"


@dataclass(frozen=True)
class Record:
    """A session's Parquet file, and its header: what was known when the session began."""

    path: Path
    header: dict[str, Any]

    @property
    def file(self) -> pq.ParquetFile:
        """Open the session's Parquet file once more and return it."""
        return pq.ParquetFile(self.path)

    def rows(self, *kinds: str) -> Iterator[dict[str, Any]]:
        """Yield all rows of these kinds in the log's order, as dicts without the states of fish."""
        names = [name for name in SESSION.names if name not in (*FIELDS, "posture")]
        for part in self.file.iter_batches(columns=names):
            kept = part.filter(pc.is_in(part["kind"], pa.array(kinds)))
            yield from kept.to_pylist()


def open_record(path: Path) -> Record:
    """Open a session's Parquet file. FinloopError if it is none, cut off, or of another version."""
    try:
        file = pq.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        do = "make it whole from its journal: python -m stages.stimulus recover <name>.journal"
        raise FinloopError(
            f"{path} cannot be read ({str(error).splitlines()[0]})", _WANTED, do
        ) from error
    text = header_text(file.schema_arrow.metadata)
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
    return Record(path, header)


class Frame(NamedTuple):
    """A displayed frame: number, session time (s) when shown, digest of its pixels, its fish.

    states: (fish, F).
    """

    number: int
    shown_s: float
    digest: int
    states: States


def frames_of(record: Record) -> Iterator[Frame]:
    """Yield every displayed frame of a session, with the states of its fish."""
    columns = ["kind", "time_s", "number", "digest", "fish", *FIELDS, "posture"]
    heads: list[tuple[int, float, int]] = []
    fish: dict[int, list[NDArray[np.float32]]] = {}
    for part in record.file.iter_batches(columns=columns):
        for number, state in _fish(part):
            fish.setdefault(number, []).append(state)
        for head in heads:  # the fish of a frame are in its own part, or in the next one
            yield _make_frame(*head, fish)
        frame = part.filter(pc.equal(part["kind"], "frame"))
        values = [frame[name].to_pylist() for name in ("number", "time_s", "digest")]
        heads = list(zip(*values, strict=True))
    for head in heads:
        yield _make_frame(*head, fish)


def _fish(part: pa.RecordBatch) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield the states (F,) of fish in a part of the table, with the numbers of their frames."""
    rows = part.filter(pc.equal(part["kind"], "fish"))
    if not rows.num_rows:
        return
    fields = np.column_stack([rows[name].to_numpy(zero_copy_only=False) for name in FIELDS])
    posture = rows["posture"].flatten().to_numpy().reshape(len(fields), -1)
    states = np.concatenate([fields, posture], axis=1).astype(np.float32)
    yield from zip(rows["number"].to_pylist(), states, strict=True)


def _make_frame(number: int, shown: float, digest: int, fish: dict[int, Any]) -> Frame:
    states = fish.pop(number, [])
    made = np.stack(states) if states else np.zeros((0, len(FIELDS)), np.float32)
    return Frame(number, shown, digest, made)


class ReplanResult(NamedTuple):
    """The result of planning a session again: how many ticks were planned, and how many differ."""

    ticks: int
    different: int


def plan_again(record: Record, scene: TrialContext, plan: Protocol) -> ReplanResult:
    """Plan a session again from its logged inputs; return how many ticks differ from the log's.

    scene: of the same film and parameters; plan: the protocol in the session's header.
    """
    again = _Again(scene, plan)
    for row in record.rows("trial", "tick", "input"):
        again.take(row)
    return ReplanResult(again.ticks, again.different)


class _Again:
    def __init__(self, scene: TrialContext, plan: Protocol) -> None:
        self.ticks = self.different = 0
        self._scene, self._plan = scene, plan
        self._animals = LiveAnimals(plan.animals, scene.tank, scene.mm_per_px)
        self._reaction: Reaction | None = None
        self._motions: dict[str, States] = {}
        self._states: States | None = None  # states of a motion that is known beforehand
        self._anew: States | None = None
        self._condition = ""

    def take(self, row: dict[str, Any]) -> None:
        if row["kind"] == "trial":
            facts = json.loads(row["text"])
            if facts["what"] == "start":
                self._begin(facts)
            else:
                self._end()
        elif row["kind"] == "input":
            if row["verdict"] != "malformed":
                heard = self._animals.hear(row["text"], row["source"], row["time_s"])
                if self._reaction is not None and any(one.is_present for one in heard):
                    self._anew = self._reaction.react(row["time_s"])
        else:
            self._compare(row)

    def _begin(self, facts: dict[str, Any]) -> None:
        name = self._condition = facts["condition"]
        cue = cue_of(self._plan, Trial(**{key: facts[key] for key in Trial._fields}))
        condition = cue.condition
        self._reaction = self._states = None
        if condition.motion.rule is not None:
            self._reaction = Reaction(self._scene, cue, facts["seed"], self._animals)
            return
        source = condition.motion.again
        motion = (
            plan_motion(self._scene, cue, facts["seed"])
            if source is None else repeat_motion(self._scene, cue, self._motions[source])
        )  # fmt: skip
        self._motions[name], self._states = motion, cue.apply_look_and_fade(motion, self._scene)

    def _end(self) -> None:
        if self._reaction is not None and self._reaction.states:
            self._motions[self._condition] = collect_motion(self._reaction.states)
        self._reaction = None

    def _compare(self, row: dict[str, Any]) -> None:
        states = None
        if self._states is not None:
            states = self._states[row["number"]]
        elif row["verdict"] == "anew":
            states, self._anew = self._anew, None
        elif self._reaction is not None:
            states = self._reaction.tick(row["time_s"])
        self.ticks += 1
        self.different += states is None or digest_of(states) != row["digest"]
