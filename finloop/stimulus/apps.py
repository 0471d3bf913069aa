"""The web applications of a stimulus: a session, a replay, a calibration."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Coroutine
from typing import Any

from starlette.applications import Starlette

from finloop.live.door import Door
from finloop.stimulus.desk import attend as attend_desk
from finloop.stimulus.page import display_page, experimenter_page
from finloop.stimulus.serve import MOST_PAGES, MOST_TRACKERS, app, attend
from finloop.stimulus.session import Session
from finloop.stimulus.show import CalibrationHub, Replay, SessionHub

Tasks = list[Coroutine[Any, Any, None]]


def session_app(
    door: Door, room: SessionHub, inputs: Callable[[], Tasks], fail: Callable[[Any], None]
) -> Starlette:
    """Return the web application of a session: both pages, the trackers' WebSocket, all its tasks.

    inputs: returns tasks that receive trackers' messages; fail: called with a task's error.
    """
    session = room.session
    sockets = {
        "/experimenter": (lambda one: attend_desk(session, one), MOST_PAGES, False),
        "/display": (lambda one: attend(room, one), MOST_PAGES, False),
        "/animals": (room.track, MOST_TRACKERS, True),
    }
    pages = {"/": experimenter_page(), "/show": display_page()}
    return app(
        door, pages, sockets, lambda: [session.run(), save_log_regularly(session), *inputs()], fail
    )


def replay_app(
    door: Door, room: Replay, ends: Callable[[], None], fail: Callable[[Any], None]
) -> Starlette:
    """Return the web application of a replay, on one display.

    ends: called when all frames have been drawn; fail: called with a task's error.
    """

    async def until_all_is_drawn() -> None:
        await room.ended.wait()
        ends()

    sockets = {"/display": (lambda one: attend(room, one), 1, False)}
    return app(
        door, {"/": display_page()}, sockets, lambda: [room.run(), until_all_is_drawn()], fail
    )


def calibration_app(door: Door, room: CalibrationHub, fail: Callable[[Any], None]) -> Starlette:
    """Return the web application of a calibration, for one display. fail: takes a task's error."""
    sockets = {"/display": (lambda one: attend(room, one), 1, False)}
    return app(door, {"/": display_page()}, sockets, list, fail)


async def save_log_regularly(session: Session, every_s: float = 0.5) -> None:
    """Write the log to disk and check the computer's clock every `every_s`, until cancelled."""
    with contextlib.suppress(asyncio.CancelledError):
        while True:
            await asyncio.sleep(every_s)
            session.look(time.time())
            await asyncio.to_thread(session.log.keep)
