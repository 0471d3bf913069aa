"""A summary of a session in Markdown: what a paper has to report.

Names, notes and messages come from anybody: they are shown as they are, and never count as markup.
"""

import hashlib
import html
import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from finloop.base.arrays import Floats
from finloop.show.drawn import FIELDS
from finloop.stimulus.animals import Verdict
from finloop.stimulus.log import SESSION
from finloop.stimulus.replay import SessionRecord


def load_log_table(record: SessionRecord) -> pd.DataFrame:
    """Return a session's log as a table, without the rows and columns about single fish."""
    names = [name for name in SESSION.names if name not in (*FIELDS, "posture", "fish")]
    batches = [
        batch.filter(pc.not_equal(batch["kind"], "fish")) for batch in record.read_batches(names)
    ]
    return pa.Table.from_batches(batches).to_pandas() if batches else pd.DataFrame(columns=names)


def measure_tick_errors_ms(table: pd.DataFrame) -> Floats:
    """Return how many ms (n,) too late each tick was planned.

    A tick should be planned `early_s` (of its trial) before `intended_s`, when it is to be shown.
    table: the session's log. Left out are ticks that were planned again, and the first ticks of a
    trial, which are sent at once, as they should be planned before it begins.
    """
    trials = _parse_texts(table[table["kind"] == "trial"])
    early_s = {trial["number"]: trial["early_s"] for trial in trials if trial["what"] == "start"}
    # Only ticks that were planned again have a verdict.
    ticks = table[(table["kind"] == "tick") & table["verdict"].isna()]
    due_s = ticks["intended_s"] - ticks["trial"].map(early_s)
    trial_begins_s = ticks.groupby("trial")["time_s"].transform("min")
    errors_ms = 1e3 * (ticks["time_s"] - due_s)
    return errors_ms[due_s > trial_begins_s].to_numpy(float)


def measure_reactions_ms(table: pd.DataFrame, rate_hz: float) -> tuple[Floats, Floats]:
    """Return the delays [ms] from a tracker's messages to the planned and to the drawn reactions.

    Both times begin when the message arrives. The first (n,) lasts until a tick is planned anew,
    the second (m,) until a frame that shows the new plan is drawn; m ≤ n, as some are never shown.
    table: the session's log, in order of time; its `seq` is the number of a tick's plan, and of the
    last plan that a frame knew. rate_hz: ticks/s.
    """
    # Only a message makes a tick be planned anew, so one has arrived before each of these.
    last_input_s = table["time_s"].where(table["kind"] == "input").ffill()
    is_replanned = (table["kind"] == "tick") & (table["verdict"] == "anew")
    replanned = table[is_replanned]
    arrived_s = last_input_s[is_replanned].to_numpy(float)
    planned_s = replanned["time_s"].to_numpy(float) - arrived_s
    frames = table[table["kind"] == "frame"]
    # The first frame that both knew the new plan, and was due after the tick before, shows it.
    tick_before_s = replanned["intended_s"].to_numpy(float) - 1 / rate_hz
    knows_plan_from = np.searchsorted(frames["seq"], replanned["seq"])
    is_due_from = np.searchsorted(frames["intended_s"], tick_before_s, "right")
    first_frame = np.maximum(knows_plan_from, is_due_from)  # its place in `frames`
    is_shown = first_frame < len(frames)
    drawn_s = frames["drawn_s"].to_numpy(float)[first_frame[is_shown]] - arrived_s[is_shown]
    return 1e3 * planned_s, 1e3 * drawn_s


def summarise_session(record: SessionRecord, recovered: bool = False) -> str:
    """Return a summary of a session as Markdown: trials, display, timing, animals and events.

    recovered: whether the session was broken off and its log recovered.
    """
    table, header = load_log_table(record), record.header
    digest = hashlib.sha256(table["digest"][table["kind"] == "tick"].astype("int64").to_numpy())
    lines = [
        f"# {_escape_text(header['protocol']['name'])}",
        "",
        f"- begun {header['begun']}, finloop {header['finloop']}, "
        f"file {_escape_text(record.path.name)}",
        f"- seed {header['protocol']['seed']}; {header['protocol']['fish']} fish, ",
        f"  film {_escape_text(header['film'])}",
        f"- all planned ticks: SHA-256 {digest.hexdigest()[:16]}",
    ]
    if header.get("dry"):
        lines.append("- **a dry run: nothing was displayed**")
    if recovered:
        lines.append("- **recovered from its journal: the session did not end as it should**")
    sections = {
        "Trials": _trial_lines(table),
        "Display": _display_lines(table),
        "Timing": _timing_lines(table, header["rate_hz"]),
        "Live animals": _animal_lines(table),
        "Events": _event_lines(table),
        "Software": (f"- {name} {version}" for name, version in header["software"].items()),
    }
    for name, section in sections.items():
        lines += ["", f"## {name}", "", *section]
    return "\n".join(lines) + "\n"


def _escape_text(value: object) -> str:
    """Return a value as Markdown that shows its text on one line, without markup or HTML."""
    printable = "".join(letter if letter.isprintable() else " " for letter in str(value))
    text = html.escape(" ".join(printable.split()), quote=False)
    return re.sub(r"([\\`*_\[\]|])", r"\\\1", text)


def _parse_texts(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the JSON values in the column `text` of some rows of the log."""
    return [json.loads(text) for text in rows["text"]]


def _trial_lines(table: pd.DataFrame) -> Iterator[str]:
    """Yield the lines of a Markdown table of the trials; table: the session's log."""
    yield "| trial | condition | block | repeat | seed | from s | lasted s | ended | dropped |"
    yield "|---|---|---|---|---|---|---|---|---|"
    rows, frames = table[table["kind"] == "trial"], table[table["kind"] == "frame"]
    dropped = frames.groupby("trial")["dropped"].sum()

    def trial_line(facts: dict[str, Any], begin: float, lasted: str, ended: str) -> str:
        """Return the line of a trial: when it began (session time), how long it lasted, its end."""
        cells = [facts[name] for name in ("number", "condition", "block", "repeat", "seed")]
        cells += [f"{begin:.2f}", lasted, ended, int(dropped.get(facts["number"], 0))]
        return "| " + " | ".join(map(_escape_text, cells)) + " |"

    begun: dict[int, tuple[float, dict[str, Any]]] = {}
    for time_s, facts in zip(rows["time_s"], _parse_texts(rows), strict=True):
        if facts["what"] == "start":
            begun[facts["number"]] = time_s, facts
        else:
            begin, _ = begun.pop(facts["number"], (time_s, facts))
            yield trial_line(facts, begin, f"{time_s - begin:.2f}", facts["what"])
    for begin, facts in begun.values():
        yield trial_line(facts, begin, lasted="?", ended="never")


def _display_lines(table: pd.DataFrame) -> Iterator[str]:
    """Yield lines about the displays of a session and their calibration; table: its log."""
    events = _parse_texts(table[table["kind"] == "event"])
    displays = {  # the last facts about each page
        event.get("page"): event for event in events if event["what"] == "display"
    }
    if not displays:
        yield "none"
    for display in displays.values():
        calibration = display.get("calibration") or {}
        size = f"{display['width']} × {display['height']} px"
        yield f"- {_escape_text(display['name'])}: {size}, {_escape_text(display['renderer'])}"
        if not display["calibrated"]:
            yield "  **not calibrated**"
            continue
        px_per_mm = calibration.get("px_per_mm") or "?"
        gamma = "table" if calibration.get("gamma") else "as it is"
        corners = "warped" if calibration.get("corners") else "as they are"
        yield (
            f"  calibrated: {px_per_mm} px per mm, {calibration.get('refresh_hz', 0):.2f} Hz, "
            f"gamma {gamma}, corners {corners}"
        )


def _timing_lines(table: pd.DataFrame, rate_hz: float) -> Iterator[str]:
    """Yield lines about delays and dropped frames; table: the log; rate_hz: ticks per second."""
    frames = table[table["kind"] == "frame"]
    if len(frames):
        in_trials = frames[frames["trial"].notna()]
        intervals_ms = 1e3 * frames["time_s"].diff().dropna()
        delays_ms = 1e3 * (in_trials["time_s"] - in_trials["intended_s"])
        yield f"- {len(frames)} displayed frames, every {intervals_ms.median():.2f} ms (median)"
        yield f"- dropped in trials: {int(in_trials['dropped'].sum())} of {len(in_trials)} frames"
        period_s = in_trials["intended_s"].diff() / (in_trials["dropped"] + 1)
        is_late = in_trials["drawn_s"] > in_trials["intended_s"] + period_s
        is_late &= in_trials["number"].diff() == 1  # else the period is unknown
        yield f"- drawn after the next frame was due: {int(is_late.sum())} frames"
        yield f"- shown against intended: SD {delays_ms.std():.2f} ms"
        drawing_ms = 1e3 * (frames["drawn_s"] - frames["time_s"]).to_numpy(float)
        yield _percentile_line("drawn after the browser began the frame", drawing_ms)
    errors = measure_tick_errors_ms(table)
    if len(errors):
        yield f"- ticks planned against the clock: SD {errors.std():.3f} ms ({len(errors)} ticks)"
    planned, drawn = measure_reactions_ms(table, rate_hz)
    if len(planned):
        yield _percentile_line("input to planned reaction", planned)
    if len(drawn):
        yield _percentile_line("input to drawn frame", drawn)


def _percentile_line(name: str, values_ms: Floats) -> str:
    """Return a line with the median and the 99th percentile of some times [ms]."""
    median, high = np.percentile(values_ms, [50, 99])
    return f"- {name}: median {median:.2f} ms, 99th percentile {high:.2f} ms ({len(values_ms)})"


def _animal_lines(table: pd.DataFrame) -> Iterator[str]:
    """Yield lines about the trackers' messages and the verdicts on them; table: a session's log."""
    rows = table[table["kind"] == "input"]
    unwritten = Counter[str]()
    for event in _parse_texts(table[table["kind"] == "event"]):
        if event.pop("what") == "not written":
            unwritten.update({key: n for key, n in event.items() if key in get_args(Verdict)})
    if not len(rows) and not unwritten:
        yield "none"
        return
    verdicts = Counter(" ".join(rows["verdict"].fillna("")).split()) + unwritten
    sources = ", ".join(map(_escape_text, sorted(rows["source"].unique())[:20]))
    yield f"- messages {len(rows)}, from {sources}"
    yield "- positions: " + ", ".join(f"{name} {count}" for name, count in verdicts.most_common())
    if unwritten:
        yield f"- of these only counted, and not in the log: {unwritten.total()}"


def _event_lines(table: pd.DataFrame) -> Iterator[str]:
    """Yield a line for each event of a session, with its time and facts; table: the log."""
    rows = table[table["kind"] == "event"]
    for time_s, facts in zip(rows["time_s"], _parse_texts(rows), strict=True):
        details = ", ".join(
            f"{name} {_escape_text(value)}"
            for name, value in facts.items()
            if name not in ("what", "calibration", "agent", "page")
        )
        yield f"- {time_s:.2f} s: {_escape_text(facts['what'])}" + f" ({details})" * bool(details)
