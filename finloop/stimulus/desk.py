"""The experimenter's desk: the status that its page gets ten times a second, and its requests."""

import asyncio
import contextlib
import json
import math
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from finloop.live.message import Message
from finloop.stimulus.drawn import ALPHA, HEADING, PICTURE, SIZE, X, Y
from finloop.stimulus.listing import demands
from finloop.stimulus.numbers import percentiles
from finloop.stimulus.serve import cancel_task
from finloop.stimulus.session import Session

_EVERY_S = 0.1


class Button(Message):
    """A request to start, to stop after this trial, to abort now, or to skip this trial."""

    do: Literal["start", "stop", "abort", "skip"]


class Note(Message):
    """A request to write a text of the experimenter into the log."""

    do: Literal["note"]
    text: Annotated[str, Field(min_length=1, max_length=2000)]


class DeskKeyPress(Message):
    """A message that a key was pressed on the experimenter's page."""

    do: Literal["key"]
    key: Annotated[str, Field(min_length=1, max_length=40)]


_ASKED: TypeAdapter[Any] = TypeAdapter(
    Annotated[Button | Note | DeskKeyPress, Field(discriminator="do")]
)


def handle_request(session: Session, text: str | None) -> bool:
    """Carry out a request of the experimenter's page, a JSON text; return whether it was valid."""
    try:
        asked = _ASKED.validate_json(text or "")
    except (ValidationError, UnicodeError):
        return False
    match asked:
        case Button():
            getattr(session, asked.do)()
        case Note():
            session.note(asked.text)
        case DeskKeyPress():
            session.key(asked.key)
    return True


def session_status(session: Session, whole: bool = True) -> dict[str, Any]:
    """Return the facts of a session that the experimenter's page shows, ready for JSON.

    whole: whether to add what never changes in a session.
    """
    numbers, now = session.numbers, session.clock.read_time()
    waits = session.plan.start_key or session.plan.start_message
    status: dict[str, Any] = {
        "phase": session.phase, "now": round(now, 2), "trial": session.at,
        "left_s": session.left_s(now), "done": session.done, "start": waits or "auto",
        "display": session.display, "displays": session.displays, "stopping": session.stopping,
        "frames": numbers.frames, "dropped": numbers.dropped, "late": numbers.late,
        "latency": {
            name: None if math.isnan((pair := percentiles(values))[0])
            else [round(part, 2) for part in pair]
            for name, values in (
                ("planned_ms", numbers.planned), ("drawn_ms", numbers.drawn),
                ("tick_ms", numbers.ticks),
            )
        },
        "fish": _fish(session), "animals": _animals(session, now), "heard": dict(numbers.heard),
        "messages": list(session.messages),
    }  # fmt: skip
    if whole:
        status |= {
            "demands": list(demands(session.plan)),
            "calibrated": session.plan.display.calibrated, "gap_s": session.animals.gap_s,
            "mm_per_px": session.scene.mm_per_px, "protocol": session.plan.name,
            "seed": session.plan.seed, "file": session.name,
            "tank": [session.scene.tank.width, session.scene.tank.height], "link": session.link,
            "trials": [[one.number, one.block, one.repeat, one.condition, one.seconds]
                       for one in session.trials],
        }  # fmt: skip
    return status


def _fish(session: Session) -> list[list[float]]:
    if session.shown is None:
        return []
    seen = session.shown[session.shown[:, PICTURE] >= 0]
    return [
        [round(float(part), 2) for part in row] for row in seen[:, [X, Y, HEADING, SIZE, ALPHA]]
    ]


def _animals(session: Session, now: float) -> list[list[Any]]:
    return [
        [
            one.id,
            round(one.x, 1),
            round(one.y, 1),
            None if one.heading_rad is None else round(one.heading_rad, 2),
            round(now - one.heard_s, 2),
        ]
        for one in session.animals.recent_animals(now)
    ]


async def attend(session: Session, connection: WebSocket) -> None:
    """Serve an experimenter's page until it disconnects: take requests, send the status."""
    tells = asyncio.create_task(_tell(session, connection))
    try:
        while True:
            content = await connection.receive()
            if content["type"] == "websocket.disconnect":
                break
            if not handle_request(session, content.get("text")):
                session.numbers.bad += 1
            await asyncio.sleep(0)
    finally:
        await cancel_task(tells)


async def _tell(session: Session, connection: WebSocket) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        whole = True
        while True:
            await connection.send_text(json.dumps(session_status(session, whole)))
            whole = False
            await asyncio.sleep(_EVERY_S)
