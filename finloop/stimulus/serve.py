"""The server of a session: pages for the display and the experimenter, inputs of trackers.

- `/` and WebSocket `/experimenter`: the experimenter's page (its messages: `desk`).
- `/show` and WebSocket `/display`: the display's page (its messages: `feed`).
- WebSocket `/animals`: messages of trackers; triggers are sent there, too.

No client can make memory grow: a page that takes nothing for some seconds is disconnected, and
reconnects by itself. A replay, or a calibration, has a server with the display's page alone.
"""

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import Field, TypeAdapter
from starlette.websockets import WebSocket

from finloop.show.drawn import POSTURE
from finloop.show.feed import Feed
from finloop.show.limits import PAGE_MESSAGES, PAGE_MESSAGES_PER_S, Budget
from finloop.show.message import StrictModel, parse_json
from finloop.show.page import build_display_page, pack_message, read_page_file
from finloop.show.web import (
    BUSY,
    GONE,
    LARGEST,
    AccessPolicy,
    AppServer,
    SocketRoute,
    cancel_task,
    receive_messages,
)
from finloop.stimulus.desk import KeyPress, serve_experimenter
from finloop.stimulus.display import DisplayCalibration, PixelRatio, Pixels, save_display
from finloop.stimulus.log import parse_frame_records
from finloop.stimulus.replay import DisplayedFrame
from finloop.stimulus.session import RealClock, Session

MOST_PAGES, MOST_TRACKERS = 8, 64
_MOST_WAITING = 4096  # messages that wait for a page before it is disconnected
_MOST_UNDRAWN = 8  # frames of a quick replay that are sent before the page has drawn them
_SAVE_S = 0.5  # time between two writings of the log


class DisplayReady(StrictModel):
    """A page's message that it is ready to show a stimulus, with facts about its display.

    page: its identity, made when the page was loaded. width, height: px of its window; ratio:
    device px per CSS px; renderer, agent: its graphics hardware and its browser.
    """

    do: Literal["ready"]
    page: Annotated[str, Field(min_length=1, max_length=40)]
    width: Pixels
    height: Pixels
    ratio: PixelRatio
    renderer: Annotated[str, Field(max_length=400)]
    agent: Annotated[str, Field(max_length=400)]


class DisplayResized(StrictModel):
    """A page's message that its window has another size; the values are as in `DisplayReady`."""

    do: Literal["resized"]
    width: Pixels
    height: Pixels
    ratio: PixelRatio


class TimeRequest(StrictModel):
    """A page's request for the session's time, and its report that it draws.

    sent: ms of the page's clock. frames: how many frames it has drawn.
    """

    do: Literal["ping"]
    sent: Annotated[float, Field(ge=-1e12, le=1e12)]
    frames: Annotated[int, Field(ge=0, le=2**53)]


class CalibrationMessage(StrictModel):
    """A page's message with the display's new calibration, to be stored."""

    do: Literal["display"]
    display: DisplayCalibration


class VisibilityMessage(StrictModel):
    """A page's message that another window hides it (`on`), or that it is visible again."""

    do: Literal["hidden"]
    on: bool


DisplayMessage = (
    DisplayReady | DisplayResized | TimeRequest | KeyPress | CalibrationMessage | VisibilityMessage
)
_MESSAGE: TypeAdapter[DisplayMessage] = TypeAdapter(
    Annotated[DisplayMessage, Field(discriminator="do")]
)


def parse_display_message(text: str | None) -> DisplayMessage | None:
    """Return the message in a display page's JSON text; None if the text is invalid."""
    return parse_json(_MESSAGE, text, LARGEST)


class DisplayPage:
    """A connected display page, with the queue of messages to it.

    facts: its last message about itself, None until it is ready. frames: how many it has drawn.
    """

    def __init__(self, connection: WebSocket) -> None:
        """Begin with an empty queue; the page is not ready yet."""
        self.connection, self.frames, self.is_hidden = connection, 0, False
        self.facts: DisplayReady | None = None
        self.waiting: asyncio.Queue[bytes] = asyncio.Queue(_MOST_WAITING)

    def send(self, content: bytes) -> bool:
        """Queue a message to the page; return whether there was room for it."""
        try:
            self.waiting.put_nowait(content)
        except asyncio.QueueFull:
            return False
        return True

    async def deliver(self) -> None:
        """Send queued messages to the page, one after the other, until it disconnects."""
        with contextlib.suppress(*GONE):
            while True:
                await self.connection.send_bytes(await self.waiting.get())


class DisplayHub:
    """Server of display pages: it answers their messages and sends messages to all of them.

    The page that came first is the display; the others mirror it, and their records of displayed
    frames are ignored. A page that connects again keeps its place, by its identity.
    A session, a replay and a calibration have subclasses.
    """

    def __init__(self, feed: Feed, read_time: Callable[[], float] = time.perf_counter) -> None:
        """Begin without any page; feed: makes its messages; read_time: returns session time, s."""
        self.feed, self._read_time = feed, read_time
        self.screens: list[DisplayPage] = []
        self._background: set[asyncio.Task[None]] = set()

    def run_in_background(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a coroutine and return at once; ignore the errors of a client that has left."""

        async def suppress_gone() -> None:
            """Run the coroutine; suppress the errors of a client that has left."""
            with contextlib.suppress(*GONE):
                await work

        task = asyncio.ensure_future(suppress_gone())
        self._background.add(task)  # else it might be garbage-collected
        task.add_done_callback(self._background.discard)

    def send(self, content: bytes) -> None:
        """Queue a message to all display pages; disconnect those whose queue is full."""
        for screen in [screen for screen in self.screens if screen.facts]:
            if not screen.send(content):
                self._remove(screen)
                self.run_in_background(screen.connection.close(BUSY, "too slow"))

    @property
    def display(self) -> DisplayPage | None:
        """The display: the page that has been ready for longest; None if there is none."""
        return next((screen for screen in self.screens if screen.facts), None)

    def _register(self, screen: DisplayPage, facts: DisplayReady) -> None:
        """Note that a page is ready; it replaces an earlier connection of the same page."""
        if screen not in self.screens:  # it was too slow
            return
        if screen.facts is None:
            self.screens.remove(screen)
            self.screens.append(screen)
        for other in self.screens:
            if other is not screen and other.facts and other.facts.page == facts.page:
                self.screens.remove(screen)
                self.screens[self.screens.index(other)] = screen
                self.run_in_background(other.connection.close(BUSY, "connected again"))
                break
        screen.facts = facts
        self.handle_change()

    def _remove(self, screen: DisplayPage) -> None:
        """Forget a page that has disconnected, if it is not forgotten yet."""
        if screen in self.screens:
            self.screens.remove(screen)
            self.handle_change()

    def handle_message(self, screen: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a display page that is ready or asks for the time; note its size.

        Any other message is ignored. message: None stands for an invalid one.
        """
        match message:
            case DisplayReady():
                for content in self.feed.opening_messages():
                    screen.send(content)
                self._register(screen, message)
            case DisplayResized() if screen.facts:
                size = message.model_dump(exclude={"do"})
                screen.facts = screen.facts.model_copy(update=size)
                self.handle_change()
            case TimeRequest():
                pong = {"kind": "pong", "sent": message.sent, "now": self._read_time()}
                screen.send(pack_message(pong))

    def store_calibration(self, calibration: DisplayCalibration, path: Path) -> None:
        """Write a display's calibration to a file; pages that connect from now on get it, too."""
        save_display(path, calibration)
        self.feed.facts["display"] = calibration.model_dump(mode="json")

    def handle_frames(self, content: bytes) -> None:
        """Ignore a page's records of displayed frames; subclasses handle them."""

    def handle_change(self) -> None:
        """Do nothing when a page has come, has gone or has another size; subclasses handle it."""

    async def serve_display(self, connection: WebSocket) -> None:
        """Serve a display page until it disconnects: handle its messages, and send those to it."""
        screen = DisplayPage(connection)
        self.screens.append(screen)
        delivering = asyncio.create_task(screen.deliver())
        budget = Budget(PAGE_MESSAGES, PAGE_MESSAGES_PER_S)
        try:
            async for content in receive_messages(connection):
                if not isinstance(content, bytes):
                    may_count = budget.spend(1, self._read_time())
                    message = parse_display_message(content) if may_count else None
                    self.handle_message(screen, message)
                elif self.display is screen:  # the others are mirrors
                    self.handle_frames(content)
        finally:
            self._remove(screen)
            await cancel_task(delivering)


class SessionHub(DisplayHub):
    """Server of a running session's display pages and trackers."""

    def __init__(self, session: Session, name: str, store: Path) -> None:
        """Begin without any page; name: of the display; store: the file for its calibration."""
        super().__init__(session.feed, session.clock.read_time)
        self.session, self._name, self._store = session, name, store
        self._programs: set[WebSocket] = set()

    def handle_message(self, screen: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page, and pass it to the session; None: an invalid one.

        A calibration is stored, unless a trial runs or waits for its start.
        """
        super().handle_message(screen, message)
        match message:
            case None:
                self.session.counts.bad += 1
            case TimeRequest():
                if message.frames > screen.frames and self.display is screen:
                    self.session.note_frame()
                screen.frames = message.frames
            case KeyPress():
                self.session.press_key(message.key)
            case CalibrationMessage():
                if self.session.phase in ("running", "waiting"):
                    what = "a calibration while a trial runs or waits is refused"
                else:
                    what = "the display was calibrated"
                    self.store_calibration(message.display, self._store)
                    self.handle_change()
                self.session.report_outside_event(what)
            case VisibilityMessage():
                screen.is_hidden = message.on
                if self.display is screen:
                    self.session.set_hidden(message.on)

    def handle_frames(self, content: bytes) -> None:
        """Pass a page's records of displayed frames to the session."""
        self.session.record_frames(content)

    def handle_change(self) -> None:
        """Tell the session which page is its display, and how many pages there are."""
        display, calibration = self.display, self.feed.facts.get("display")
        facts = None if display is None or display.facts is None else {
            "name": self._name, **display.facts.model_dump(exclude={"do"}),
            "calibrated": bool(calibration),
            "refresh_hz": calibration["refresh_hz"] if calibration else None,
            "calibration": calibration, "hidden": display.is_hidden,
        }  # fmt: skip
        self.session.set_display(facts, sum(screen.facts is not None for screen in self.screens))

    async def serve_tracker(self, connection: WebSocket) -> None:
        """Serve a tracker until it disconnects: pass its messages to the session."""
        client = connection.client
        source = f"ws://{client.host}:{client.port}" if client else "ws"
        self._programs.add(connection)
        try:
            async for content in receive_messages(connection):
                if content is not None:
                    self.session.receive_message(content, source)
        finally:
            self._programs.discard(connection)

    def send_trigger(self, to: str, text: str) -> str | None:
        """Send a trigger's text to its receiver; return what went wrong, None if nothing did.

        to: udp://host:port, or `socket` for all programs that are connected at /animals.
        """
        if to == "socket":
            for connection in self._programs:
                self.run_in_background(connection.send_text(text))
            return None
        parts = urlsplit(to)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.setblocking(False)
            try:
                out.sendto(text.encode(), (parts.hostname, parts.port))
            except OSError as error:
                return str(error)
        return None


class CalibrationHub(DisplayHub):
    """Server of a display that is calibrated without a session."""

    def __init__(self, feed: Feed, store: Path, done: Callable[[], None]) -> None:
        """Begin without any page; done: called when the calibration is in the file `store`."""
        super().__init__(feed)
        self._store, self._done = store, done

    def handle_message(self, screen: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page; store a calibration that it holds."""
        super().handle_message(screen, message)
        if isinstance(message, CalibrationMessage):
            self.store_calibration(message.display, self._store)
            self._done()


class ReplayHub(DisplayHub):
    """Server that replays a session's frames and compares what is drawn with the session's log.

    shown, compared: how many frames were drawn again, and had their pixels compared; different:
    numbers of the frames whose states or pixels differ from the log's.
    """

    def __init__(self, feed: Feed, frames: Iterator[DisplayedFrame], quick: bool) -> None:
        """Begin without any page; frames: the session's; quick: show them as fast as possible."""
        super().__init__(feed)
        self._frames, self._quick = frames, quick
        self._waiting: dict[int, DisplayedFrame] = {}  # for being drawn, by number
        self._connected, self._drawn = asyncio.Event(), asyncio.Event()
        self.shown, self.compared = 0, 0
        self.different: list[int] = []

    def handle_message(self, screen: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page; the first ready display begins the replay."""
        super().handle_message(screen, message)
        if isinstance(message, DisplayReady):
            self._connected.set()

    def handle_frames(self, content: bytes) -> None:
        """Compare a page's records of the frames that it drew again with the session's log.

        They are counted in `shown`, those with a digest of their pixels on both sides in
        `compared`; `different` gets the numbers of those that differ. A digest of 0 means that no
        pixels were read. An invalid message is ignored.
        """
        with contextlib.suppress(ValueError):
            for facts, states in parse_frame_records(content, POSTURE + self.feed.facts["posture"]):
                number, digest = int(facts.number), int(facts.digest)
                frame = self._waiting.pop(number, None)
                if frame is None:
                    continue
                has_digests = bool(frame.digest and digest)
                self.shown += 1
                self.compared += has_digests
                is_changed = frame.states.tobytes() != states.tobytes()
                if is_changed or (has_digests and frame.digest != digest):
                    self.different.append(number)
            self._drawn.set()

    async def run_replay(self) -> None:
        """Send all frames once a display is ready; return when all are drawn, or 10 s after."""
        await self._connected.wait()
        async for frame in self._pace_frames():
            if self._quick:
                await self._wait_until_drawn(fewer_than=_MOST_UNDRAWN)
            self._waiting[frame.number] = frame
            for content in self.feed.frame_messages(frame.number, frame.states):
                self.send(content)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._wait_until_drawn(fewer_than=1), 10)

    async def _wait_until_drawn(self, fewer_than: int) -> None:
        """Wait until fewer than a number of the sent frames are still to be drawn."""
        while len(self._waiting) >= fewer_than:
            self._drawn.clear()
            await self._drawn.wait()

    async def _pace_frames(self) -> AsyncIterator[DisplayedFrame]:
        """Yield the frames at the times of the session, or without waits if `quick`."""
        clock, first_shown_s = RealClock(), None
        for frame in self._frames:
            first_shown_s = frame.shown_s if first_shown_s is None else first_shown_s
            if not self._quick:
                await clock.wait_until(frame.shown_s - first_shown_s)
            yield frame


# --- servers


def create_session_server(
    listens: socket.socket, policy: AccessPolicy, hub: SessionHub,
    inputs: Callable[[], list[Coroutine[Any, Any, None]]], started: Callable[[], None],
) -> AppServer:  # fmt: skip
    """Return the web server of a session: both pages, the trackers' WebSocket, and all its tasks.

    listens: the bound socket. policy: who may connect. hub: serves displays and trackers. inputs:
    returns tasks that receive trackers' messages by other ways. started: called once the server can
    be reached.
    """
    session = hub.session

    async def save_log() -> None:
        """Write the log to the disk twice a second, and watch the computer's clock."""
        while True:
            await asyncio.sleep(_SAVE_S)
            session.check_wall_clock(time.time())
            await asyncio.to_thread(session.log.write_entries)

    sockets = [
        SocketRoute("/experimenter", partial(serve_experimenter, session), MOST_PAGES),
        SocketRoute("/display", hub.serve_display, MOST_PAGES),
        SocketRoute("/animals", hub.serve_tracker, MOST_TRACKERS, programs=True),
    ]
    pages = {"/": read_page_file("experimenter.html"), "/show": build_display_page()}
    return AppServer(
        listens, policy, pages, sockets, started=started,
        tasks=lambda: [session.run_trials(), save_log(), *inputs()],
    )  # fmt: skip


def create_display_server(
    listens: socket.socket, policy: AccessPolicy, hub: CalibrationHub | ReplayHub,
    started: Callable[[], None],
) -> AppServer:  # fmt: skip
    """Return the web server of a replay or a calibration; it has the display's page alone.

    It ends after a replay. listens: the bound socket. policy: who may connect. hub: serves the
    display. started: called once the server can be reached.
    """

    async def run_replay_and_stop() -> None:
        """Run the replay, if the hub has one, and stop the server."""
        if isinstance(hub, ReplayHub):
            await hub.run_replay()
            server.should_exit = True

    sockets = [SocketRoute("/display", hub.serve_display, most=1)]
    pages = {"/": build_display_page()}
    server = AppServer(
        listens, policy, pages, sockets, tasks=lambda: [run_replay_and_stop()], started=started
    )
    return server
