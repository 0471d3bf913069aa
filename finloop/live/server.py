"""The server of the live tank: one page, one WebSocket, this machine only.

A page cannot make memory grow: only the last request of each kind is kept until the next frame, and
a page that is two frames behind gets no third.
"""

import asyncio
import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable

from starlette.websockets import WebSocket

from finloop.live.message import PageRequest, Seen, SetGoal, Step, parse_message
from finloop.live.view import View
from finloop.live.web import (
    GONE,
    AccessPolicy,
    AppServer,
    SocketRoute,
    cancel_task,
    receive_messages,
)

MOST_PAGES = 8
_FRAMES_HZ = 60.0  # the highest frame rate
_MOST_TICKS = 16  # the most ticks to catch up with at once; time beyond them is lost
_MOST_STEPS = 32  # the most single steps kept until the next frame
BEHIND = 2  # frames that a page may be behind
_OF_FISH = ("goal", "path", "rule", "drop")  # requests for one fish, or for all


class PageClient:
    """A connected page. At most one frame waits for it, the newest."""

    def __init__(self) -> None:
        self._newest: tuple[int, bytes] | None = None
        self._unseen: deque[int] = deque()  # frames that were sent and not yet drawn
        self._changed = asyncio.Event()

    def offer(self, number: int, frame: bytes) -> bool:
        """Store a new frame for the page; return whether the frame before was taken by then."""
        got, self._newest = self._newest is None, (number, frame)
        self._changed.set()
        return got

    def confirm(self, number: int) -> None:
        """Note that the page has drawn frame `number`, and any before; ignore one never sent."""
        while number in self._unseen:
            self._unseen.popleft()
            self._changed.set()

    async def next(self) -> bytes:
        """Return the newest frame, once there is a new one and the page is not behind."""
        while self._newest is None or len(self._unseen) >= BEHIND:
            self._changed.clear()
            await self._changed.wait()
        (number, frame), self._newest = self._newest, None
        self._unseen.append(number)
        return frame


class Host:
    """Runs the tank tick by tick while a page is connected, and offers its frames to pages."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.pages: set[PageClient] = set()
        self.frame_ms: float = 0.0
        self.requests: dict[tuple[object, ...], PageRequest] = {}
        self._steps = 0
        self._changed = asyncio.Event()

    def receive(self, page: PageClient, text: str | bytes | None) -> None:
        """Keep the request in a page's message until the next frame; count a bad message."""
        request = parse_message(text)
        if request is None:
            self.view.bad_messages += 1
            return
        if isinstance(request, Seen):
            page.confirm(request.frame)
            return
        if isinstance(request, Step):
            self._steps = min(self._steps + 1, _MOST_STEPS)
        else:
            fish = getattr(request, "fish", None) if request.do in _OF_FISH else None
            old = self.requests.pop((type(request), fish), None)
            if isinstance(old, SetGoal) and isinstance(request, SetGoal) and not old.drag:
                request = request.model_copy(update={"drag": False})  # a first goal counts at once
            self.requests[type(request), fish] = request
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
            rate = self.view.tank.world.motion.rate_hz * self.view.speed
            due = min(due + (now - clock) * rate, float(_MOST_TICKS))
            clock = now
            ticks = int(due) if self.view.runs else 0
            due -= ticks
            requests, steps = self.take()
            if ticks or requests or steps or not self.view.runs:
                frame = await asyncio.to_thread(self.frame, requests, steps, ticks)
                for page in self.pages:
                    self.view.dropped_frames += not page.offer(self.view.frame, frame)
            least = 1 / _FRAMES_HZ - (time.perf_counter() - now)
            await asyncio.sleep(max(least, 0.0))
            if self.view.runs:
                left = (1.0 - due) / rate - (time.perf_counter() - now)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), max(left, 0.0))

    def take(self) -> tuple[list[PageRequest], int]:
        """Return the requests since the last frame, and how many single ticks were requested."""
        requests, self.requests = list(self.requests.values()), {}
        steps, self._steps = self._steps, 0
        return requests, steps

    def frame(self, requests: list[PageRequest], steps: int, ticks: int) -> bytes:
        """Apply the requests, advance the tank, and return the next frame as bytes (`View.show`).

        steps: single ticks, after which the tank is paused; ticks: to advance by if it is not
        paused.
        """
        start = time.perf_counter()
        for request in [*requests, *[Step(do="step")] * steps]:
            self.view.grant(request)
        if self.view.runs:
            self.view.advance(ticks)
        frame = self.view.show(self.frame_ms)
        self.frame_ms = 1e3 * (time.perf_counter() - start)
        return frame

    async def serve_page(self, connection: WebSocket) -> None:
        """Pass frames to a page and its messages to the tank, until it disconnects."""

        async def send_frames() -> None:
            with contextlib.suppress(*GONE):
                while True:
                    await connection.send_bytes(await page.next())

        page = PageClient()
        self.pages.add(page)
        self._changed.set()
        sending = asyncio.create_task(send_frames())
        try:
            async for text in receive_messages(connection):
                self.receive(page, text)
        finally:
            self.pages.discard(page)
            await cancel_task(sending)


def tank_server(
    view: View, page: str, listens: socket.socket, started: Callable[[], None]
) -> AppServer:
    """Return the server of a live tank on a bound socket: its page at `/`, its WebSocket `/tank`.

    page: the HTML; started: called once the server can be reached.
    """
    host, policy = Host(view), AccessPolicy(listens.getsockname()[1])
    sockets = [SocketRoute("/tank", host.serve_page, MOST_PAGES)]
    return AppServer(listens, policy, {"/": page}, sockets, lambda: [host.run()], started)
