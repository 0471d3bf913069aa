"""The experimenter's desk: the status that its page gets ten times a second, and its requests."""

import asyncio
import contextlib
import json
from collections import deque
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter
from starlette.websockets import WebSocket

from finloop.show.drawn import ALPHA, HEADING, PICTURE, SIZE, X, Y
from finloop.show.limits import PAGE_MESSAGES, PAGE_MESSAGES_PER_S, Budget
from finloop.show.message import StrictModel, parse_json
from finloop.show.web import GONE, LARGEST, cancel_task, receive_messages
from finloop.stimulus.listing import list_requirements
from finloop.stimulus.session import Session

_STATUS_INTERVAL_S = 0.1


class SessionCommand(StrictModel):
    """A request to start, to stop after this trial, to abort now, or to skip this trial."""

    do: Literal["start", "stop", "abort", "skip"]


class NoteRequest(StrictModel):
    """A request to write a text of the experimenter into the log."""

    do: Literal["note"]
    text: Annotated[str, Field(min_length=1, max_length=2000)]


class KeyPress(StrictModel):
    """A page's message that a key was pressed: at the display, or on the experimenter's page."""

    do: Literal["key"]
    key: Annotated[str, Field(min_length=1, max_length=40)]


_REQUEST: TypeAdapter[SessionCommand | NoteRequest | KeyPress] = TypeAdapter(
    Annotated[SessionCommand | NoteRequest | KeyPress, Field(discriminator="do")]
)


def handle_request(session: Session, text: str | bytes | None) -> bool:
    """Carry out a request (JSON text) of the experimenter's page; return whether it was valid."""
    request = parse_json(_REQUEST, text, LARGEST)
    match request:
        case SessionCommand():
            getattr(session, request.do)()  # start, stop, abort or skip
        case NoteRequest():
            session.log_outside_event("note", text=request.text)
        case KeyPress():
            session.press_key(request.key)
    return request is not None


def session_status(session: Session, with_constants: bool = True) -> dict[str, Any]:
    """Return the state of a session for the experimenter's page, as values that JSON can hold.

    Keys: latency: median and 99th percentile, ms. fish: of each that is shown, x, y px, heading
    rad, size px, opacity. animals: of each, id, x, y px, heading rad, s since its last message.
    trial: its index, −1 before the first. done: how each trial ended, by its number.
    with_constants: whether to add what never changes in a session.
    """
    counts, now = session.counts, session.clock.read_time()
    start = session.protocol.start_key or session.protocol.start_message or "auto"
    # A fish that is absent has the picture −1.
    shown = () if session.shown is None else session.shown[session.shown[:, PICTURE] >= 0]
    status: dict[str, Any] = {
        "phase": session.phase, "now": round(now, 2), "trial": session.trial_index,
        "left_s": session.remaining_s(now), "done": session.done, "start": start,
        "display": session.display, "displays": session.displays,
        "draws": session.is_display_drawing(), "stopping": session.stopping,
        "screen": session.screen,
        "frames": counts.frames, "dropped": counts.dropped, "late": counts.late,
        "latency": {
            name: _percentiles(getattr(counts, name))
            for name in ("planned_ms", "drawn_ms", "tick_ms")
        },
        "fish": [
            [round(float(value), 2) for value in fish[[X, Y, HEADING, SIZE, ALPHA]]]
            for fish in shown
        ],
        "animals": [
            [
                animal.id, round(animal.x, 1), round(animal.y, 1),
                None if animal.heading_rad is None else round(animal.heading_rad, 2),
                round(now - animal.heard_s, 2),
            ]
            for animal in session.animals.recent_animals(now)
        ],
        "heard": dict(counts.verdicts), "messages": list(session.messages),
    }  # fmt: skip
    if with_constants:
        status |= {
            "demands": list(list_requirements(session.protocol)),
            "calibrated": session.protocol.display.calibrated, "gap_s": session.animals.gap_s,
            "mm_per_px": session.context.mm_per_px, "protocol": session.protocol.name,
            "seed": session.protocol.seed, "file": session.name,
            "tank": [session.context.tank.width, session.context.tank.height], "link": session.link,
            "trials": [[trial.number, trial.block, trial.repeat, trial.condition, trial.seconds]
                       for trial in session.trials],
        }  # fmt: skip
    return status


def _percentiles(values: deque[float]) -> list[float] | None:
    """Return the median and the 99th percentile of values, rounded; None if there are none."""
    if not values:
        return None
    return [round(float(value), 2) for value in np.percentile(np.array(values), [50, 99])]


async def serve_experimenter(session: Session, connection: WebSocket) -> None:
    """Serve an experimenter's page until it disconnects: handle requests, send the status."""

    async def send_status() -> None:
        """Send the status ten times a second, with the constants the first time."""
        with contextlib.suppress(*GONE):
            is_first = True
            while True:
                status = session_status(session, with_constants=is_first)
                await connection.send_text(json.dumps(status))
                is_first = False
                await asyncio.sleep(_STATUS_INTERVAL_S)

    sending = asyncio.create_task(send_status())
    budget = Budget(PAGE_MESSAGES, PAGE_MESSAGES_PER_S)
    try:
        async for text in receive_messages(connection):
            may_count = budget.spend(1, session.clock.read_time())
            if not (may_count and handle_request(session, text)):
                session.counts.bad += 1
    finally:
        await cancel_task(sending)
