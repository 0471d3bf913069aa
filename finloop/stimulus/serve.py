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
from finloop.show.hub import Hub, Page, TimeRequest
from finloop.show.limits import PAGE_MESSAGES, PAGE_MESSAGES_PER_S, Budget
from finloop.show.message import StrictModel, parse_json
from finloop.show.page import build_display_page, build_experimenter_page
from finloop.show.web import (
    BUSY,
    LARGEST,
    AccessPolicy,
    AppServer,
    SocketRoute,
    receive_messages,
)
from finloop.stimulus.desk import KeyPress, serve_experimenter
from finloop.stimulus.display import DisplayCalibration, PixelRatio, Pixels, save_display
from finloop.stimulus.log import parse_frame_records
from finloop.stimulus.replay import DisplayedFrame
from finloop.stimulus.session import RealClock, Session

MOST_PAGES, MOST_TRACKERS = 8, 64
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


class DisplayPage(Page):
    """A connected display page.

    facts: its last message about itself, None until it is ready.
    """

    def __init__(self, connection: WebSocket) -> None:
        """Begin with an empty queue; the page is not ready yet."""
        super().__init__(connection)
        self.is_hidden = False
        self.facts: DisplayReady | None = None
        self.budget = Budget(PAGE_MESSAGES, PAGE_MESSAGES_PER_S)


class DisplayHub(Hub[DisplayPage]):
    """Server of display pages: it answers their messages and sends messages to all of them.

    The page that came first is the display; the others mirror it, and their records of displayed
    frames are ignored. A page that connects again keeps its place, by its identity.
    A session, a replay and a calibration have subclasses.
    """

    page_type = DisplayPage

    @property
    def display(self) -> DisplayPage | None:
        """The display: the page that has been ready for longest; None if there is none."""
        return next((page for page in self.pages if page.is_open), None)

    def _register(self, page: DisplayPage, facts: DisplayReady) -> None:
        """Note that a page is ready; it replaces an earlier connection of the same page."""
        if page not in self.pages:  # it was too slow
            return
        if not page.is_open:
            self.pages.remove(page)
            self.pages.append(page)
        for other in self.pages:
            if other is not page and other.facts and other.facts.page == facts.page:
                self.pages.remove(page)
                self.pages[self.pages.index(other)] = page
                self.run_in_background(other.connection.close(BUSY, "connected again"))
                break
        page.facts, page.is_open = facts, True
        self.handle_change()

    def handle_message(self, page: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a display page that is ready or asks for the time; note its size.

        Any other message is ignored. message: None stands for an invalid one.
        """
        match message:
            case DisplayReady():
                for content in self.feed.opening_messages():
                    page.send(content)
                self._register(page, message)
            case DisplayResized() if page.facts:
                size = message.model_dump(exclude={"do"})
                page.facts = page.facts.model_copy(update=size)
                self.handle_change()
            case TimeRequest():
                self.answer_ping(page, message)

    def store_calibration(self, calibration: DisplayCalibration, path: Path) -> None:
        """Write a display's calibration to a file; pages that connect from now on get it, too."""
        save_display(path, calibration)
        self.feed.facts["display"] = calibration.model_dump(mode="json")

    def handle_frames(self, content: bytes) -> None:
        """Ignore a page's records of displayed frames; subclasses handle them."""

    def handle_content(self, page: DisplayPage, content: str | bytes | None) -> None:
        """Handle a page's message, as far as it may send any, or its records of frames."""
        if not isinstance(content, bytes):
            may_count = page.budget.spend(1, self.read_time())
            self.handle_message(page, parse_display_message(content) if may_count else None)
        elif self.display is page:  # the others are mirrors
            self.handle_frames(content)


class SessionHub(DisplayHub):
    """Server of a running session's display pages and trackers."""

    def __init__(
        self, session: Session, name: str, store: Path,
        check_screen: Callable[[], tuple[str, bool] | None] = lambda: None,
    ) -> None:  # fmt: skip
        """Begin without any page; name: of the display; store: the file for its calibration.

        check_screen: returns how much of the tank the display shows as it is calibrated now.
        """
        super().__init__(session.feed, session.clock.read_time)
        self.session, self._name, self._store = session, name, store
        self._check_screen = check_screen
        session.screen = check_screen()
        self._programs: set[WebSocket] = set()

    def handle_message(self, page: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page, and pass it to the session; None: an invalid one.

        A calibration is stored, unless a trial runs or waits for its start.
        """
        super().handle_message(page, message)
        match message:
            case None:
                self.session.counts.bad += 1
            case TimeRequest():
                if message.frames > page.frames and self.display is page:
                    self.session.note_frame()
                page.frames = message.frames
            case KeyPress() if self.display is page:  # a mirror starts no trial
                self.session.press_key(message.key)
            case CalibrationMessage():
                if self.session.phase in ("running", "waiting"):
                    what = "a calibration while a trial runs or waits is refused"
                else:
                    what = "the display was calibrated"
                    self.store_calibration(message.display, self._store)
                    self.session.screen = self._check_screen()
                    self.handle_change()
                self.session.report_outside_event(what)
            case VisibilityMessage():
                page.is_hidden = message.on
                if self.display is page:
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
        self.session.set_display(facts, sum(page.is_open for page in self.pages))

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

    def handle_message(self, page: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page; store a calibration that it holds."""
        super().handle_message(page, message)
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

    def handle_message(self, page: DisplayPage, message: DisplayMessage | None) -> None:
        """Answer a message of a display page; the first ready display begins the replay."""
        super().handle_message(page, message)
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
        SocketRoute("/display", hub.serve_page, MOST_PAGES),
        SocketRoute("/animals", hub.serve_tracker, MOST_TRACKERS, programs=True),
    ]
    pages = {"/": build_experimenter_page(), "/show": build_display_page()}
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

    sockets = [SocketRoute("/display", hub.serve_page, most=1)]
    pages = {"/": build_display_page()}
    server = AppServer(
        listens, policy, pages, sockets, tasks=lambda: [run_replay_and_stop()], started=started
    )
    return server
