"""A summary of a session in plain text: what a paper has to report."""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from finloop.base.arrays import Floats
from finloop.stimulus.drawn import FIELDS
from finloop.stimulus.log import SESSION
from finloop.stimulus.replay import Record


def table_of(record: Record) -> pd.DataFrame:
    """Return a session's log as a table in its order, without the rows and columns of fish."""
    names = [name for name in SESSION.names if name not in (*FIELDS, "posture", "fish")]
    parts = [
        part.filter(pc.not_equal(part["kind"], "fish"))
        for part in record.file.iter_batches(columns=names)
    ]
    return pa.Table.from_batches(parts).to_pandas() if parts else pd.DataFrame(columns=names)


def tick_errors_ms(table: pd.DataFrame) -> Floats:
    """Return how much later (n,), ms, each tick was planned than it should have been.

    Ticks that were planned again are left out, and the first ones, which are sent at once.
    table: from `table_of`.
    """
    starts = _texts(table[table["kind"] == "trial"])
    early = {one["number"]: one["early_s"] for one in starts if one["what"] == "start"}
    ticks = table[(table["kind"] == "tick") & table["verdict"].isna()]
    wanted = ticks["intended_s"] - ticks["trial"].map(early)
    first = ticks.groupby("trial")["time_s"].transform("min")
    errors = 1e3 * (ticks["time_s"] - wanted)
    return errors[wanted > first].to_numpy(float)  # the first ones are sent at once


def reactions_ms(table: pd.DataFrame, rate_hz: float) -> tuple[Floats, Floats]:
    """Return the times, ms, from an input to its tick planned again (n,), and to its frame (m,).

    The frame is the first that shows the tick; m ≤ n, as some are never shown. table: from
    `table_of`; rate_hz: ticks per second.
    """
    heard = table["time_s"].where(table["kind"] == "input").ffill()
    anew = (table["kind"] == "tick") & (table["verdict"] == "anew")
    arrived = heard[anew].to_numpy(float)
    planned = table.loc[anew, "time_s"].to_numpy(float) - arrived
    frames = table[table["kind"] == "frame"]
    shows = table.loc[anew, "intended_s"].to_numpy(float) - 1 / rate_hz
    at = np.maximum(
        np.searchsorted(frames["seq"], table.loc[anew, "seq"]),
        np.searchsorted(frames["intended_s"], shows, "right"),
    )
    known = at < len(frames)
    drawn = frames["drawn_s"].to_numpy(float)[at[known]] - arrived[known]
    return 1e3 * planned, 1e3 * drawn


def summary(record: Record, recovered: bool = False) -> str:
    """Return a session's summary as Markdown. recovered: whether the session was broken off."""
    table, header = table_of(record), record.header
    parts = {
        "Trials": _trials(table),
        "Display": _display(table),
        "Timing": _timing(table, header["rate_hz"]),
        "Live animals": _inputs(table),
        "Events": _events(table),
        "Software": (f"- {name} {version}" for name, version in header["software"].items()),
    }
    lines = [f"# {header['protocol']['name']}", "", *_head(record, table, recovered)]
    for name, part in parts.items():
        lines += ["", f"## {name}", "", *part]
    return "\n".join(lines) + "\n"


def _texts(rows: pd.DataFrame) -> list[dict[str, Any]]:
    return [json.loads(text) for text in rows["text"]]


def _head(record: Record, table: pd.DataFrame, recovered: bool) -> Iterator[str]:
    header = record.header
    digest = hashlib.sha256(table["digest"][table["kind"] == "tick"].astype("int64").to_numpy())
    yield f"- begun {header['begun']}, finloop {header['finloop']}, file `{record.path.name}`"
    yield f"- seed {header['protocol']['seed']}; {header['protocol']['fish']} fish, "
    yield f"  film {header['film']}"
    yield f"- all planned ticks: SHA-256 {digest.hexdigest()[:16]}"
    if header.get("dry"):
        yield "- **a dry run: nothing was displayed**"
    if recovered:
        yield "- **recovered from its journal: the session did not end as it should**"


def _trials(table: pd.DataFrame) -> Iterator[str]:
    yield "| trial | condition | block | repeat | seed | from s | lasted s | ended | dropped |"
    yield "|---|---|---|---|---|---|---|---|---|"
    rows = table[table["kind"] == "trial"]
    frames = table[table["kind"] == "frame"]
    dropped = frames.groupby("trial")["dropped"].sum()
    begun: dict[int, tuple[float, dict[str, Any]]] = {}
    for time_s, facts in zip(rows["time_s"], _texts(rows), strict=True):
        number = facts["number"]
        if facts["what"] == "start":
            begun[number] = time_s, facts
            continue
        begin, _ = begun.pop(number, (time_s, facts))
        yield _trial(facts, begin, f"{time_s - begin:.2f}", dropped.get(number, 0))
    for begin, facts in begun.values():
        yield _trial(facts | {"what": "never"}, begin, "?", dropped.get(facts["number"], 0))


def _trial(facts: dict[str, Any], begin: float, lasted: str, dropped: float) -> str:
    cells = [facts[name] for name in ("number", "condition", "block", "repeat", "seed")]
    cells += [f"{begin:.2f}", lasted, facts["what"], int(dropped)]
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _display(table: pd.DataFrame) -> Iterator[str]:
    events = _texts(table[table["kind"] == "event"])
    shown = [one for one in events if one["what"] == "display"]
    if not shown:
        yield "none"
    for one in shown:
        calibration = one.get("calibration") or {}
        scale = calibration.get("px_per_mm")
        yield f"- {one['name']}: {one['width']} × {one['height']} px, {one['renderer']}"
        yield "  " + (
            f"calibrated: {scale or '?'} px per mm, {calibration.get('refresh_hz', 0):.2f} Hz, "
            f"gamma {'table' if calibration.get('gamma') else 'as it is'}, corners "
            f"{'warped' if calibration.get('corners') else 'as they are'}"
            if one["calibrated"] else "**not calibrated**"
        )  # fmt: skip


def _timing(table: pd.DataFrame, rate_hz: float) -> Iterator[str]:
    frames = table[table["kind"] == "frame"]
    if len(frames):
        trial = frames[frames["trial"].notna()]
        gaps = 1e3 * frames["time_s"].diff().dropna()
        off = 1e3 * (trial["time_s"] - trial["intended_s"])
        yield f"- {len(frames)} displayed frames, every {gaps.median():.2f} ms (median)"
        yield f"- dropped in trials: {int(trial['dropped'].sum())} of {len(trial)} frames"
        period = trial["intended_s"].diff() / (trial["dropped"] + 1)
        late = (trial["drawn_s"] > trial["intended_s"] + period) & (trial["number"].diff() == 1)
        yield f"- drawn after the next frame was due: {int(late.sum())} frames"
        yield f"- shown against intended: SD {off.std():.2f} ms"
        yield _spread("drawn after the browser began the frame", 1e3 * (
            frames["drawn_s"] - frames["time_s"]).to_numpy(float))  # fmt: skip
    errors = tick_errors_ms(table)
    if len(errors):
        yield f"- ticks planned against the clock: SD {errors.std():.3f} ms ({len(errors)} ticks)"
    planned, drawn = reactions_ms(table, rate_hz)
    if len(planned):
        yield _spread("input to planned reaction", planned)
    if len(drawn):
        yield _spread("input to drawn frame", drawn)


def _spread(name: str, values: Floats) -> str:
    median, most = np.percentile(values, [50, 99])
    return f"- {name}: median {median:.2f} ms, 99th percentile {most:.2f} ms ({len(values)})"


def _inputs(table: pd.DataFrame) -> Iterator[str]:
    rows = table[table["kind"] == "input"]
    if not len(rows):
        yield "none"
        return
    verdicts = rows["verdict"].fillna("").str.split().explode().value_counts()
    yield f"- messages {len(rows)}, from {', '.join(sorted(rows['source'].unique())[:20])}"
    yield "- positions: " + ", ".join(f"{name} {count}" for name, count in verdicts.items())


def _events(table: pd.DataFrame) -> Iterator[str]:
    rows = table[table["kind"] == "event"]
    for time_s, facts in zip(rows["time_s"], _texts(rows), strict=True):
        more = ", ".join(
            f"{name} {value}" for name, value in facts.items()
            if name not in ("what", "calibration", "agent")
        )  # fmt: skip
        yield f"- {time_s:.2f} s: {facts['what']}" + (f" ({more})" if more else "")
