"""The server of the live tank: one page, one WebSocket, this machine only.

It sends pictures and states of the fish; the page draws them at the rate of its display, on the way
from the last tick but one to the last. Of the requests only the last of each kind is kept until the
next tick. Nor can a page take the processor from the fish: after each of its messages is a rest.
"""

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable

from starlette.websockets import WebSocket

from finloop.live.message import AdvanceTick, PageRequest, SetGoal, parse_message
from finloop.live.view import TankView
from finloop.show.hub import Hub, Page, TimeRequest
from finloop.show.page import build_tank_page
from finloop.show.web import LARGEST, AccessPolicy, AppServer, SocketRoute

MOST_PAGES = 8
_FRAMES_HZ = 60.0  # the highest rate of messages
_MOST_TICKS = 16  # the most ticks to catch up with at once; time beyond them is lost
_MOST_STEPS = 32  # the most single steps kept until the next frame
_FOR_FISH = ("goal", "path", "rule", "drop")  # requests for one fish, or for all
_SENDING_S = 0.01
"""The time for planning and sending a tick, after which pages begin to show it."""


class TankHub(Hub[Page]):
    """Runner of a live tank: it advances the tank and sends each tick to the connected pages."""

    page_type = Page
    rest_s = 0.001  # 1000 messages a second; at 60 frames/s a page sends a goal for each

    def __init__(self, view: TankView) -> None:
        """Begin without pages; view: the tank as it is shown."""
        super().__init__(view.feed)
        self.view = view
        self.tick_ms: float = 0.0
        self.requests: dict[tuple[object, ...], PageRequest] = {}
        self._steps = 0
        self._changed = asyncio.Event()

    def handle_content(self, page: Page, content: str | bytes | None) -> None:
        """Store the request in a page's message for the next frame; count an invalid message.

        Only the last request of each kind is kept; of requests for a goal, a path, a rule, or to
        wander, the last for each fish. Single steps are counted. A ping is answered at once.
        """
        request = parse_message(content)
        if request is None:
            self.view.bad_messages += 1
            return
        if isinstance(request, TimeRequest):
            page.frames = request.frames
            self.answer_ping(page, request)
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
        """Advance the tank in real time, and send each tick to all pages, until cancelled."""
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
            # Send the ticks that have become due, or what requests have changed.
            now = time.perf_counter()
            rate = self.view.tank.world.motion.rate_hz * self.view.speed
            due_ticks = min(due_ticks + (now - last) * rate, float(_MOST_TICKS))
            last = now
            ticks = int(due_ticks) if self.view.is_running else 0
            due_ticks -= ticks
            requests, steps = self.take_requests()
            newcomers = [page for page in self.pages if not page.is_open]
            if newcomers:
                opening = await asyncio.to_thread(self.view.opening_messages)
                for page in newcomers:
                    page.is_open = all(map(page.send, opening))
            if ticks or requests or steps or newcomers or not self.view.is_running:
                # The page goes on to this tick until the next is due.
                due_s = now - due_ticks / rate + max(1 / rate, 1 / _FRAMES_HZ) + _SENDING_S
                for content in await asyncio.to_thread(
                    self.make_frame, requests, steps, ticks, due_s
                ):
                    self.send(content)
            # Wait for the highest rate first, then for the next tick or a request.
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

    def make_frame(
        self, requests: list[PageRequest], steps: int, ticks: int, due_s: float = 0.0
    ) -> list[bytes]:
        """Carry out requests, advance the tank, and return the messages that show it to pages.

        steps: how many single ticks were requested; after one the tank is paused. ticks: how far to
        advance if it is not paused. due_s: server's time at which the last tick is reached.
        """
        start = time.perf_counter()
        for request in [*requests, *[AdvanceTick(do="step")] * steps]:
            self.view.handle_request(request)
        if self.view.is_running:
            self.view.advance(ticks)
        messages = self.view.frame_messages(due_s, self.tick_ms)
        self.tick_ms = 1e3 * (time.perf_counter() - start)
        return messages

    async def serve_page(self, connection: WebSocket) -> None:
        """Serve a page until it disconnects; let the tank go on for it."""
        self._changed.set()
        await super().serve_page(connection)


def create_tank_server(
    view: TankView, listens: socket.socket, started: Callable[[], None]
) -> AppServer:
    """Return the web server of a live tank: its page at `/`, its WebSocket at `/tank`.

    listens: the bound socket. started: called once the server can be reached.
    """
    hub, policy = TankHub(view), AccessPolicy(listens.getsockname()[1])
    # What a page sent too fast waits in a small buffer: its rest is soon read after it has left.
    listens.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, LARGEST)
    sockets = [SocketRoute("/tank", hub.serve_page, MOST_PAGES)]
    pages = {"/": build_tank_page()}
    return AppServer(
        listens, policy, pages, sockets, tasks=lambda: [hub.run_tank()], started=started
    )
