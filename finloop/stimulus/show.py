"""A session, a replay, or a calibration behind the pages of `finloop.stimulus.serve`."""

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from finloop.stimulus.display import DisplayCalibration, save_display
from finloop.stimulus.drawn import POSTURE
from finloop.stimulus.feed import Feed
from finloop.stimulus.log import FRAME_FIELDS, frames_of
from finloop.stimulus.replay import Frame
from finloop.stimulus.serve import DisplayHub, Ready
from finloop.stimulus.session import Session

_AHEAD = 8  # frames of a replay that are sent before the page has drawn them


class RealClock:
    """Seconds since its creation. A wait ends within a tenth of a millisecond of its time."""

    def __init__(self) -> None:
        self._zero = time.perf_counter()

    def read_time(self) -> float:
        """Return the present time, s."""
        return time.perf_counter() - self._zero

    async def until(self, time_s: float) -> None:
        """Wait until a time, s since the clock's creation."""
        while (left := time_s - self.read_time()) > 0:
            # The loop's own timer may be a millisecond late: wait for the rest step by step.
            await asyncio.sleep(left - 0.0015 if left > 0.002 else 0)


class SessionHub(DisplayHub):
    """Connects a session with its display pages and its trackers.

    name: of the display; store: the file that its calibration is written to.
    """

    def __init__(self, session: Session, name: str, store: Path) -> None:
        super().__init__()
        self.session, self.feed, self._name, self._store = session, session.feed, name, store
        self._listeners: set[WebSocket] = set()

    def session_time(self) -> float:
        """Return the present session time, s."""
        return self.session.clock.read_time()

    def came(self, ready: Ready) -> None:
        """Tell the session that a display has connected, and what is known of it."""
        known = self.feed.facts.get("display")
        facts = {
            "name": self._name, **ready.model_dump(exclude={"do"}), "calibrated": bool(known),
            "refresh_hz": known["refresh_hz"] if known else None, "calibration": known,
        }  # fmt: skip
        self.session.display_came(facts)

    def handle_disconnect(self) -> None:
        """Tell the session that a display has disconnected."""
        self.session.display_left()

    def key(self, key: str) -> None:
        """Tell the session that a key was pressed at the display."""
        self.session.key(key)

    def store_calibration(self, display: DisplayCalibration) -> None:
        """Store and apply a calibration, but refuse it while a session is waiting or running."""
        if self.session.phase in ("running", "waiting"):
            self.session.trouble("a calibration in the middle of a session is refused")
            return
        save_display(self._store, display)
        self.feed.facts["display"] = display.model_dump(mode="json")
        self.session.trouble("the display was calibrated")

    def set_hidden(self, on: bool) -> None:
        """Note that the page is hidden, or visible again."""
        self.session.set_hidden(on)

    def frames(self, content: bytes) -> None:
        """Pass a page's records of displayed frames to the session."""
        self.session.frames(content)

    def bad(self) -> None:
        """Count an invalid message of a page."""
        self.session.numbers.bad += 1

    async def track(self, connection: WebSocket) -> None:
        """Serve a tracker at the WebSocket /animals until it disconnects: pass its messages on."""
        client = connection.client
        source = f"ws://{client.host}:{client.port}" if client else "ws"
        self._listeners.add(connection)
        try:
            while True:
                content = await connection.receive()
                if content["type"] == "websocket.disconnect":
                    break
                self.session.hear(content.get("text") or content.get("bytes"), source)
                await asyncio.sleep(0)  # a tracker that floods waits for the others
        finally:
            self._listeners.discard(connection)

    def tell(self, text: str) -> None:
        """Send a trigger's text to all programs connected to /animals."""
        for connection in self._listeners:
            self.beside(_say(connection, text))


async def _say(connection: WebSocket, text: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await connection.send_text(text)


class CalibrationHub(DisplayHub):
    """Calibrates a display without a session.

    store: the file that the calibration is written to; done: called when it is stored.
    """

    def __init__(self, feed: Feed, store: Path, done: Callable[[], None]) -> None:
        super().__init__()
        self.feed, self._store, self._done = feed, store, done

    def store_calibration(self, display: DisplayCalibration) -> None:
        """Store a calibration of the display, and report that it is done."""
        save_display(self._store, display)
        self.feed.facts["display"] = display.model_dump(mode="json")
        self._done()


class Replay(DisplayHub):
    """Replays a session's frames on a display, and compares what is drawn with the session's log.

    quick: as fast as the page draws, not at the rate of the session. shown, compared: how many
    frames were drawn again, and had their pixels compared; different: numbers of the frames whose
    states or pixels differ from the log's; ended: set when all frames are drawn.
    """

    def __init__(self, feed: Feed, frames: Iterator[Frame], quick: bool) -> None:
        super().__init__()
        self.feed, self._frames, self._quick = feed, frames, quick
        self._wanted: dict[int, Frame] = {}
        self._there, self._drawn = asyncio.Event(), asyncio.Event()
        self.shown, self.compared = 0, 0
        self.different: list[int] = []
        self.ended = asyncio.Event()

    def came(self, ready: Ready) -> None:
        """Begin the replay, as a display has connected."""
        self._there.set()

    def frames(self, content: bytes) -> None:
        """Compare a page's records of frames that were drawn again with the session's."""
        try:
            width = POSTURE + self.feed.facts["posture"]
            for facts, states in frames_of(content, width):
                self._compare(int(facts[0]), int(facts[FRAME_FIELDS - 1]), states.tobytes())
        except ValueError:
            return
        self._drawn.set()

    def _compare(self, number: int, digest: int, states: bytes) -> None:
        frame = self._wanted.pop(number, None)
        if frame is None:
            return
        self.shown += 1
        if frame.digest and digest:
            self.compared += 1
        if (frame.digest and digest and frame.digest != digest) or frame.states.tobytes() != states:
            self.different.append(number)

    async def run(self) -> None:
        """Send all frames once a display has connected; set `ended` when drawn, or 10 s later."""
        await self._there.wait()
        async for frame in self._pace_frames():
            while len(self._wanted) >= _AHEAD and self._quick:
                self._drawn.clear()
                await self._drawn.wait()
            self._wanted[frame.number] = frame
            for content in self.feed.frame(frame.number, frame.states):
                self.send(content)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._all_drawn(), 10)
        self.ended.set()

    async def _all_drawn(self) -> None:
        while self._wanted:
            self._drawn.clear()
            await self._drawn.wait()

    async def _pace_frames(self) -> AsyncIterator[Frame]:
        clock, first = RealClock(), None
        for frame in self._frames:
            first = frame.shown_s if first is None else first
            if not self._quick:
                await clock.until(frame.shown_s - first)
            yield frame


def repeat_messages(messages: list[tuple[float, str]]) -> Iterator[tuple[float, str]]:
    """Yield a track's messages (arrival in s, JSON text) for ever, a second between rounds."""
    begin = 0.0
    while messages:
        for due, text in messages:
            message = json.loads(text)
            yield begin + due, json.dumps(message | {"t": begin + message["t"]})
        begin += messages[-1][0] + 1.0


class DryClock:
    """The clock of a dry run: a wait ends at once, and the time is the one waited for.

    messages: of trackers, each with its session time (s); hear: takes text and sender of each, at
    its time.
    """

    def __init__(self, messages: Iterable[tuple[float, str]] = ()) -> None:
        self._now, self._messages = 0.0, iter(messages)
        self._next = next(self._messages, None)
        self.hear: Callable[[str, str], Any] = lambda text, source: None

    def read_time(self) -> float:
        """Return the present time, s."""
        return self._now

    async def until(self, time_s: float) -> None:
        """Pass on the messages that are due until a time, s, and set the clock to it."""
        while self._next is not None and self._next[0] <= time_s:
            due, text = self._next
            self._next = next(self._messages, None)
            self._now = max(self._now, due)
            self.hear(text, "recorded")
        self._now = max(self._now, time_s)
        await asyncio.sleep(0)
