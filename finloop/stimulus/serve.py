"""The server of a session: pages for the display and the experimenter, inputs of trackers.

- `/` and WebSocket `/experimenter`: the experimenter's page (its messages: `desk`).
- `/show` and WebSocket `/display`: the display's page (its messages: `feed`).
- WebSocket `/animals`: messages of trackers; triggers are sent there, too.

`finloop.live.door` decides who may connect. No client can make memory grow: a page that takes
nothing for some seconds is disconnected, and reconnects by itself.
"""

import asyncio
import contextlib
import gc
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from finloop.live.door import BUSY, MALFORMED, Door
from finloop.live.message import Message
from finloop.stimulus.display import DisplayCalibration
from finloop.stimulus.feed import Feed, message

MOST_PAGES, MOST_TRACKERS = 8, 64
_WAITING = 4096  # messages that wait for a page before it is disconnected
_SWITCH_S = 0.0005  # after which a thread that writes the log gives way


Pixels = Annotated[int, Field(ge=1, le=100_000)]
Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]


class Ready(Message):
    """A page's message that a display has connected.

    width, height: px of its window; ratio: device px per CSS px; renderer, agent: its graphics
    hardware and its browser.
    """

    do: Literal["ready"]
    width: Pixels
    height: Pixels
    ratio: Annotated[float, Field(gt=0, le=20)]
    renderer: Annotated[str, Field(max_length=400)]
    agent: Annotated[str, Field(max_length=400)]


class Ping(Message):
    """A page's request for the session's time. sent: ms of the page's clock."""

    do: Literal["ping"]
    sent: Number


class DisplayKeyPress(Message):
    """A page's message that a key was pressed at the display."""

    do: Literal["key"]
    key: Annotated[str, Field(min_length=1, max_length=40)]


class CalibrationMessage(Message):
    """A page's message with the display's new calibration, to be stored."""

    do: Literal["display"]
    display: DisplayCalibration


class Hidden(Message):
    """A page's message that it is now hidden behind another (`on`), or visible again."""

    do: Literal["hidden"]
    on: bool


_SAID: TypeAdapter[Any] = TypeAdapter(
    Annotated[
        Ready | Ping | DisplayKeyPress | CalibrationMessage | Hidden, Field(discriminator="do")
    ]
)


class Screen:
    """A display page that is connected, and the queue of messages to it."""

    def __init__(self, connection: WebSocket) -> None:
        self.connection, self.ready = connection, False
        self.waiting: asyncio.Queue[bytes | str] = asyncio.Queue(_WAITING)

    def send(self, content: bytes | str) -> bool:
        """Queue a message to the page; return whether there was room for it."""
        with contextlib.suppress(asyncio.QueueFull):
            self.waiting.put_nowait(content)
            return True
        return False

    async def deliver(self) -> None:
        """Send the queued messages until the page disconnects."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
            while True:
                content = await self.waiting.get()
                if isinstance(content, str):
                    await self.connection.send_text(content)
                else:
                    await self.connection.send_bytes(content)


class DisplayHub:
    """Takes the messages of display pages; the session, or a replay, overrides what it needs.

    The page that came first is the display; the others mirror it, and their records of displayed
    frames are ignored.
    """

    feed: Feed

    def __init__(self) -> None:
        self.screens: list[Screen] = []
        self._beside: set[asyncio.Task[None]] = set()

    def beside(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a task without waiting for it."""
        task = asyncio.ensure_future(work)
        self._beside.add(task)  # else it might be garbage-collected
        task.add_done_callback(self._beside.discard)

    def session_time(self) -> float:
        """Return the present session time, s."""
        return time.perf_counter()

    def send(self, content: bytes) -> None:
        """Send a message to all display pages; disconnect those that are stuck."""
        for screen in [one for one in self.screens if one.ready]:
            if not screen.send(content):
                self.screens.remove(screen)
                self.beside(_end(screen.connection))

    def handle_message(self, screen: Screen, wish: Any) -> None:
        """Answer a parsed message of a display page, or pass it to the method for its kind."""
        match wish:
            case Ready():
                for content in self.feed.begin():
                    screen.send(content)
                screen.ready = True
                self.came(wish)
            case Ping():
                screen.send(message("pong", sent=wish.sent, now=self.session_time()))
            case DisplayKeyPress():
                self.key(wish.key)
            case CalibrationMessage():
                self.store_calibration(wish.display)
            case Hidden():
                self.set_hidden(wish.on)

    def came(self, ready: Ready) -> None:
        """Handle a display that has connected. ready: what its page reports."""

    def handle_disconnect(self) -> None:
        """Handle a display that has disconnected."""

    def key(self, key: str) -> None:
        """Handle a key press at the display. key: its name in the browser."""

    def store_calibration(self, display: DisplayCalibration) -> None:
        """Store a calibration of the display."""

    def set_hidden(self, on: bool) -> None:
        """Note that a page is hidden, or visible again."""

    def frames(self, content: bytes) -> None:
        """Take a page's records of displayed frames (see `finloop.stimulus.log.frames_of`)."""

    def bad(self) -> None:
        """Count an invalid message of a page."""


async def attend(stage: DisplayHub, connection: WebSocket) -> None:
    """Serve a display page until it disconnects: pass on its messages and those to it."""
    screen = Screen(connection)
    stage.screens.append(screen)
    delivers = asyncio.create_task(screen.deliver())
    try:
        while True:
            content = await connection.receive()
            if content["type"] == "websocket.disconnect":
                if content.get("code") in MALFORMED:
                    stage.bad()
                break
            if content.get("bytes") is not None:
                if stage.screens[:1] == [screen]:  # the others are mirrors
                    stage.frames(content["bytes"])
            else:
                wish = parse_message(content.get("text"))
                if wish is None:
                    stage.bad()
                else:
                    stage.handle_message(screen, wish)
            await asyncio.sleep(0)  # a page that floods waits for the others
    finally:
        if screen in stage.screens:
            stage.screens.remove(screen)
        if screen.ready:
            stage.handle_disconnect()
        await cancel_task(delivers)


def parse_message(text: str | None) -> Any:
    """Return the message in a display page's JSON text; None where it is invalid."""
    try:
        return _SAID.validate_json(text or "")
    except (ValidationError, UnicodeError):
        return None


async def cancel_task(task: "asyncio.Task[None]") -> None:
    """Cancel a task, and wait until it has ended."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def _end(connection: WebSocket) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await connection.close(BUSY, "too slow")


Handler = Callable[[WebSocket], Coroutine[Any, Any, None]]


def app(
    door: Door, pages: dict[str, str], sockets: dict[str, tuple[Handler, int, bool]],
    tasks: Callable[[], list[Coroutine[Any, Any, None]]], fail: Callable[[Any], None],
) -> Starlette:  # fmt: skip
    """Return a web application of pages, WebSockets and tasks that run beside them.

    pages: HTML by path; sockets: by path the handler of a WebSocket, the largest number of
    connections, and whether programs that are no pages may open one; tasks: returns what runs
    beside; fail: called with the error that ended a task.
    """
    open_now = dict.fromkeys(sockets, 0)

    def page_of(path: str) -> Route:
        async def answer(request: Request) -> Response:
            return door.page(request, pages[path])

        return Route(path, answer)

    def socket_of(path: str) -> WebSocketRoute:
        attends, most, programs = sockets[path]

        async def answer(connection: WebSocket) -> None:
            if not await door.opens(connection, programs):
                return
            if open_now[path] >= most:
                await connection.close(BUSY, "too many")
                return
            open_now[path] += 1
            try:
                await attends(connection)
            finally:
                open_now[path] -= 1

        return WebSocketRoute(path, answer)

    def done(task: "asyncio.Task[None]") -> None:
        if not task.cancelled() and task.exception() is not None:
            fail(task.exception())

    @contextlib.asynccontextmanager
    async def lives(_: Starlette) -> AsyncIterator[None]:
        gc.collect()
        gc.freeze()  # present objects are not scanned again, which takes time
        switches = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        running = [asyncio.create_task(one) for one in tasks()]
        for task in running:
            task.add_done_callback(done)
        yield
        for task in running:
            task.cancel()
        if running:
            await asyncio.wait(running)
        sys.setswitchinterval(switches)
        gc.unfreeze()

    routes = [*map(page_of, pages), *map(socket_of, sockets)]
    return Starlette(routes=routes, lifespan=lives)
