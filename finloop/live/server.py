"""The server of the live tank: one page, one WebSocket, this machine only.

`finloop.live.door` decides who may connect. A page cannot make memory grow: only the last request
of each kind is kept until the next frame, and a page that is two frames behind gets no third.
"""

import asyncio
import contextlib
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from finloop.live.door import BUSY, MALFORMED, AppServer, Door
from finloop.live.message import Seen, SetGoal, Step, Wish, parse_message
from finloop.live.view import View

MOST_PAGES = 8
_FRAMES_HZ = 60.0  # the highest frame rate
_MOST_TICKS = 16  # the most ticks to catch up with at once; time beyond them is lost
_MOST_STEPS = 32  # the most single steps kept until the next frame
BEHIND = 2  # frames that a page may be behind
_OF_FISH = ("goal", "path", "rule", "drop")  # wishes of one fish, or of all


class PageClient:
    """A connected page. At most one frame waits for it, the newest."""

    def __init__(self) -> None:
        self._newest: tuple[int, bytes] | None = None
        self._away: deque[int] = deque()  # frames that were sent and not yet seen
        self._changed = asyncio.Event()

    def offer(self, number: int, frame: bytes) -> bool:
        """Store a new frame for the page; return whether the frame before was taken by then."""
        got, self._newest = self._newest is None, (number, frame)
        self._changed.set()
        return got

    def saw(self, number: int) -> None:
        """Note that the page has drawn frame `number`, and any before; ignore one never sent."""
        while number in self._away:
            self._away.popleft()
            self._changed.set()

    async def next(self) -> bytes:
        """Return the newest frame, once there is a new one and the page is not behind."""
        while self._newest is None or len(self._away) >= BEHIND:
            self._changed.clear()
            await self._changed.wait()
        (number, frame), self._newest = self._newest, None
        self._away.append(number)
        return frame


class Host:
    """Runs the tank tick by tick while a page is connected, and offers its frames to pages."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.pages: set[PageClient] = set()
        self.frame_ms: float = 0.0
        self.wishes: dict[tuple[object, ...], Wish] = {}
        self._steps = 0
        self._changed = asyncio.Event()

    def hear(self, page: PageClient, text: str | bytes | None) -> None:
        """Keep the request in a page's message until the next frame; count a bad message."""
        wish = parse_message(text)
        if wish is None:
            self.view.counts.bad += 1
            return
        if isinstance(wish, Seen):
            page.saw(wish.frame)
            return
        if isinstance(wish, Step):
            self._steps = min(self._steps + 1, _MOST_STEPS)
        else:
            key = type(wish), getattr(wish, "fish", None) if wish.do in _OF_FISH else None
            old = self.wishes.pop(key, None)
            if isinstance(old, SetGoal) and isinstance(wish, SetGoal) and not old.drag:
                wish = wish.model_copy(update={"drag": False})  # a first goal counts at once
            self.wishes[key] = wish
        self._changed.set()

    def join(self, page: PageClient) -> None:
        """Add a connected page, and wake the tank."""
        self.pages.add(page)
        self._changed.set()

    async def run(self) -> None:
        """Run the tank tick by tick, and offer each frame to all pages, until cancelled."""
        clock, due = time.perf_counter(), 0.0
        while True:
            if not self.pages or not (self.view.runs or self._changed.is_set()):
                await self._changed.wait()
                clock, due = time.perf_counter(), 0.0
                if not self.pages:
                    self._changed.clear()
                    continue
            self._changed.clear()
            now = time.perf_counter()
            rate = self.view.tank.rate_hz * self.view.speed
            due = min(due + (now - clock) * rate, float(_MOST_TICKS))
            clock = now
            ticks = int(due) if self.view.runs else 0
            due -= ticks
            wishes, steps = self.take()
            if ticks or wishes or steps or not self.view.runs:
                frame = await asyncio.to_thread(self.frame, wishes, steps, ticks)
                for page in self.pages:
                    self.view.counts.dropped += not page.offer(self.view.frame, frame)
            least = 1 / _FRAMES_HZ - (time.perf_counter() - now)
            await asyncio.sleep(max(least, 0.0))
            if self.view.runs:
                left = (1.0 - due) / rate - (time.perf_counter() - now)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), max(left, 0.0))

    def take(self) -> tuple[list[Wish], int]:
        """Return the requests since the last frame, and how many single ticks were requested."""
        wishes, self.wishes = list(self.wishes.values()), {}
        steps, self._steps = self._steps, 0
        return wishes, steps

    def frame(self, wishes: list[Wish], steps: int, ticks: int) -> bytes:
        """Apply the requests, advance the tank, and return the next frame as bytes (`View.show`).

        wishes: the requests; steps: single ticks, after which the tank is paused; ticks: to advance
        by if it is not paused.
        """
        start = time.perf_counter()
        for wish in wishes:
            self.view.grant(wish)
        for _ in range(steps):
            self.view.grant(Step(do="step"))
        if self.view.runs:
            self.view.advance(ticks)
        frame = self.view.show(self.frame_ms)
        self.frame_ms = 1e3 * (time.perf_counter() - start)
        return frame


def app(
    view: View, page: str, port: int, ended: Callable[["asyncio.Task[None]"], None]
) -> Starlette:
    """Return the web application of the live tank: its page at `/`, its WebSocket at `/tank`.

    page: the HTML; port: of the server; ended: called with the task that runs the tank when it
    ends.
    """
    door, host = Door(port), Host(view)

    async def show_page(request: Request) -> Response:
        return door.page(request, page)

    async def socket_of(connection: WebSocket) -> None:
        if not await door.opens(connection):
            return
        if len(host.pages) >= MOST_PAGES:
            await connection.close(BUSY, "too many pages")
            return
        await _attend(host, connection)

    @contextlib.asynccontextmanager
    async def lives(_: Starlette) -> AsyncIterator[None]:
        runs = asyncio.create_task(host.run())
        runs.add_done_callback(ended)
        yield
        runs.cancel()
        await asyncio.wait([runs])

    made = Starlette(
        routes=[Route("/", show_page), WebSocketRoute("/tank", socket_of)], lifespan=lives
    )
    made.state.host = host
    return made


async def _attend(host: Host, connection: WebSocket) -> None:
    """Pass frames to a page and its messages to the host, until it disconnects."""
    page = PageClient()
    host.join(page)
    sends = asyncio.create_task(_send(connection, page))
    try:
        while True:
            message = await connection.receive()
            if message["type"] == "websocket.disconnect":
                host.view.counts.bad += message.get("code") in MALFORMED
                break
            host.hear(page, message.get("text"))
            await asyncio.sleep(0)  # a page that floods waits for the others
    finally:
        host.pages.discard(page)
        sends.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sends


async def _send(connection: WebSocket, page: PageClient) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        while True:
            await connection.send_bytes(await page.next())


class Server(AppServer):
    """Serves a live tank on a socket (listens); page: the HTML.

    started: called once the server can be reached.
    """

    def __init__(
        self, view: View, page: str, listens: socket.socket, started: Callable[[], None]
    ) -> None:
        made = app(view, page, listens.getsockname()[1], self._handle_task_end)
        super().__init__(made, listens, started)

    def _handle_task_end(self, task: "asyncio.Task[None]") -> None:
        if not task.cancelled():
            self.fail(task.exception())
