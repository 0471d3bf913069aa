"""The server of the live tank: one page, one WebSocket, this machine only.

A page cannot make memory grow: only the last request of each kind is kept until the next frame, and
a page that is two frames behind gets no third. Nor can it take the processor from the fish: after
each of its messages there is a rest.
"""

import asyncio
import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable

from starlette.websockets import WebSocket

from finloop.live.message import AdvanceTick, FrameDrawn, PageRequest, SetGoal, parse_message
from finloop.live.view import TankView
from finloop.show.page import read_page_file
from finloop.show.web import (
    GONE,
    LARGEST,
    AccessPolicy,
    AppServer,
    SocketRoute,
    cancel_task,
    receive_messages,
)

MOST_PAGES = 8
REST_S = 0.001
"""No further message of a page is read for so long: 1000 a second.

At 60 frames/s a page sends at most 120: each frame that it drew, and a goal while it is dragged."""
_FRAMES_HZ = 60.0  # the highest frame rate
_MOST_TICKS = 16  # the most ticks to catch up with at once; time beyond them is lost
_MOST_STEPS = 32  # the most single steps kept until the next frame
BEHIND = 2  # frames that were sent to a page and not drawn yet, at most
_FOR_FISH = ("goal", "path", "rule", "drop")  # requests for one fish, or for all


class PageClient:
    """A connected page; at most one frame waits for it, the newest."""

    def __init__(self) -> None:
        """Begin without a frame."""
        self._newest: tuple[int, bytes] | None = None
        self._unseen: deque[int] = deque()  # frames that were sent and not yet drawn
        self._changed = asyncio.Event()

    def offer_frame(self, number: int, frame: bytes) -> bool:
        """Store a new frame for the page; return whether the frame before had been sent.

        A frame that was not sent yet is replaced.
        """
        was_sent, self._newest = self._newest is None, (number, frame)
        self._changed.set()
        return was_sent

    def confirm_frame(self, number: int) -> None:
        """Note that the page has drawn a frame and so all earlier ones; ignore an unknown frame."""
        while number in self._unseen:
            self._unseen.popleft()
            self._changed.set()

    async def next_frame(self) -> bytes:
        """Return the next frame; wait until there is a new one and the page is not behind."""
        while self._newest is None or len(self._unseen) >= BEHIND:
            self._changed.clear()
            await self._changed.wait()
        (number, frame), self._newest = self._newest, None
        self._unseen.append(number)
        return frame


class TankHost:
    """Runner of a live tank: it advances the tank and makes frames while a page is connected."""

    def __init__(self, view: TankView) -> None:
        """Begin without pages; view: the tank as it is shown."""
        self.view = view
        self.pages: set[PageClient] = set()
        self.frame_ms: float = 0.0
        self.requests: dict[tuple[object, ...], PageRequest] = {}
        self._steps = 0
        self._changed = asyncio.Event()

    def store_request(self, page: PageClient, text: str | bytes | None) -> None:
        """Store the request in a page's message for the next frame; count an invalid message.

        Only the last request of each kind is kept; of requests for a goal, a path, a rule, or to
        wander, the last for each fish. Single steps are counted. A drawn frame is noted at once.
        """
        request = parse_message(text)
        if request is None:
            self.view.bad_messages += 1
            return
        if isinstance(request, FrameDrawn):
            page.confirm_frame(request.frame)
            return
        if isinstance(request, AdvanceTick):
            self._steps = min(self._steps + 1, _MOST_STEPS)
        else:
            fish = getattr(request, "fish", None) if request.do in _FOR_FISH else None
            old = self.requests.pop((type(request), fish), None)
            if isinstance(old, SetGoal) and isinstance(request, SetGoal) and not old.drag:
                # The goal before was not dragged: it counts at once, and so must this one.
                request = request.model_copy(update={"drag": False})
            self.requests[type(request), fish] = request
        self._changed.set()

    async def run_tank(self) -> None:
        """Advance the tank in real time, and offer each frame to all pages, until cancelled."""
        last, due_ticks = time.perf_counter(), 0.0
        while True:
            # Without a page, or while the tank is paused, wait for a page or a request.
            if not self.pages or not (self.view.is_running or self._changed.is_set()):
                await self._changed.wait()
                last, due_ticks = time.perf_counter(), 0.0
                if not self.pages:
                    self._changed.clear()
                    continue
            self._changed.clear()
            # Make a frame of the ticks that have become due, or because of requests.
            now = time.perf_counter()
            rate = self.view.tank.world.motion.rate_hz * self.view.speed
            due_ticks = min(due_ticks + (now - last) * rate, float(_MOST_TICKS))
            last = now
            ticks = int(due_ticks) if self.view.is_running else 0
            due_ticks -= ticks
            requests, steps = self.take_requests()
            if ticks or requests or steps or not self.view.is_running:
                frame = await asyncio.to_thread(self.make_frame, requests, steps, ticks)
                for page in self.pages:
                    self.view.dropped_frames += not page.offer_frame(self.view.frame, frame)
            # Wait for the highest frame rate first, then for the next tick or a request.
            frame_left_s = 1 / _FRAMES_HZ - (time.perf_counter() - now)
            await asyncio.sleep(max(frame_left_s, 0.0))
            if self.view.is_running:
                tick_left_s = (1.0 - due_ticks) / rate - (time.perf_counter() - now)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), max(tick_left_s, 0.0))

    def take_requests(self) -> tuple[list[PageRequest], int]:
        """Return the stored requests and the number of requested single ticks; forget both."""
        requests, self.requests = list(self.requests.values()), {}
        steps, self._steps = self._steps, 0
        return requests, steps

    def make_frame(self, requests: list[PageRequest], steps: int, ticks: int) -> bytes:
        """Carry out requests, advance the tank, and return the next frame, bytes for the page.

        steps: how many single ticks were requested; after one the tank is paused. ticks: how far to
        advance if it is not paused.
        """
        start = time.perf_counter()
        for request in [*requests, *[AdvanceTick(do="step")] * steps]:
            self.view.handle_request(request)
        if self.view.is_running:
            self.view.advance(ticks)
        frame = self.view.render_frame(self.frame_ms)
        self.frame_ms = 1e3 * (time.perf_counter() - start)
        return frame

    async def serve_page(self, connection: WebSocket) -> None:
        """Serve a page until it disconnects: send it frames, and store its requests."""

        async def send_frames() -> None:
            """Send each new frame to the page until it disconnects."""
            with contextlib.suppress(*GONE):
                while True:
                    await connection.send_bytes(await page.next_frame())

        page = PageClient()
        self.pages.add(page)
        self._changed.set()
        sending = asyncio.create_task(send_frames())
        try:
            async for text in receive_messages(connection, REST_S):
                self.store_request(page, text)
        finally:
            self.pages.discard(page)
            await cancel_task(sending)


def create_tank_server(
    view: TankView, listens: socket.socket, started: Callable[[], None]
) -> AppServer:
    """Return the web server of a live tank: its page at `/`, its WebSocket at `/tank`.

    listens: the bound socket. started: called once the server can be reached.
    """
    host, policy = TankHost(view), AccessPolicy(listens.getsockname()[1])
    # What a page sent too fast waits in a small buffer: its rest is soon read after it has left.
    listens.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, LARGEST)
    sockets = [SocketRoute("/tank", host.serve_page, MOST_PAGES)]
    pages = {"/": read_page_file("play.html")}
    return AppServer(
        listens, policy, pages, sockets, tasks=lambda: [host.run_tank()], started=started
    )
