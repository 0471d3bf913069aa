"""The server of the live tank: one page, one WebSocket, this machine only.

A page is served, and a WebSocket opened, only under the tank's own address (`Host`), and a
WebSocket only to a page that came from there (`Origin`): no other site that is open in the browser
can look in or steer. Whatever a page sends, memory stays as it is: of each kind of wish only the
last is kept till the next frame, and a page that is behind with two frames gets no third.
"""

import asyncio
import base64
import contextlib
import hashlib
import re
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable

import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from finloop.base.errors import FinloopError
from finloop.live.message import Seen, SetGoal, Step, Wish, parsed
from finloop.live.view import View

HOST = "127.0.0.1"
MOST_PAGES = 8
_FRAMES_HZ = 60.0  # are shown at most
_MOST_TICKS = 16  # are caught up with at once; beyond that time is lost
_MOST_STEPS = 32  # are kept till the next frame
BEHIND = 2  # frames that a page may be behind
_OF_FISH = ("goal", "path", "rule", "drop")  # wishes of one fish, or of all
_LARGEST = 64 * 1024  # bytes of a message; one still larger ends the connection
_BUSY, _STRANGER = 1013, 1008  # codes of closing a WebSocket
_MALFORMED = 1002, 1007, 1009  # closed since a message was no message, no text, or too long


class Page:
    """A page that looks on. It holds one frame at most, the newest."""

    def __init__(self) -> None:
        self._newest: tuple[int, bytes] | None = None
        self._away: deque[int] = deque()  # frames that were sent and not yet seen
        self._changed = asyncio.Event()

    def offer(self, number: int, frame: bytes) -> bool:
        """Here is a new frame; whether the page got the one before."""
        got, self._newest = self._newest is None, (number, frame)
        self._changed.set()
        return got

    def saw(self, number: int) -> None:
        """The page has drawn this frame, and any before; one it was not sent counts for nothing."""
        while number in self._away:
            self._away.popleft()
            self._changed.set()

    async def next(self) -> bytes:
        """The newest frame, when there is one and the page is not behind."""
        while self._newest is None or len(self._away) >= BEHIND:
            self._changed.clear()
            await self._changed.wait()
        (number, frame), self._newest = self._newest, None
        self._away.append(number)
        return frame


class Host:
    """Runs the tank while anyone looks on."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.pages: set[Page] = set()
        self.frame_ms: float = 0.0
        self.wishes: dict[tuple[object, ...], Wish] = {}
        self._steps = 0
        self._changed = asyncio.Event()

    def hear(self, page: Page, text: str | bytes | None) -> None:
        """A message of a page."""
        wish = parsed(text)
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
                wish = wish.model_copy(update={"drag": False})  # a first one counts at once
            self.wishes[key] = wish
        self._changed.set()

    def join(self, page: Page) -> None:
        """One more looks on."""
        self.pages.add(page)
        self._changed.set()

    async def run(self) -> None:
        """Tick by tick, until cancelled."""
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
        """What is wished since last time, and how many single ticks."""
        wishes, self.wishes = list(self.wishes.values()), {}
        steps, self._steps = self._steps, 0
        return wishes, steps

    def frame(self, wishes: list[Wish], steps: int, ticks: int) -> bytes:
        """Grant the wishes, let the ticks pass, and draw."""
        start = time.perf_counter()
        for wish in wishes:
            self.view.grant(wish)
        for _ in range(steps):
            self.view.grant(Step(do="step"))
        if self.view.runs:
            self.view.on(ticks)
        frame = self.view.show(self.frame_ms)
        self.frame_ms = 1e3 * (time.perf_counter() - start)
        return frame


def app(
    view: View, page: str, port: int, ended: Callable[["asyncio.Task[None]"], None]
) -> Starlette:
    """The application. page: the HTML; port: that it is reached by; ended: called at the end."""
    hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
    host = Host(view)
    headers = {
        "Content-Security-Policy": _policy(page, hosts),
        "Cache-Control": "no-store",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
    }

    def known(connection: HTTPConnection) -> bool:
        return connection.headers.getlist("host") in [[name] for name in hosts]

    async def show_page(request: Request) -> Response:
        if not known(request):
            return PlainTextResponse("not this host", 421)
        return Response(page, media_type="text/html", headers=headers)

    async def socket_of(connection: WebSocket) -> None:
        origins = connection.headers.getlist("origin")
        if not known(connection) or origins not in [[f"http://{name}"] for name in hosts]:
            await connection.close(_STRANGER)  # before it is accepted: the answer is 403
            return
        await connection.accept()
        if len(host.pages) >= MOST_PAGES:
            await connection.close(_BUSY, "too many pages")
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
    """Frames to a page and its messages to the host, until it goes."""
    page = Page()
    host.join(page)
    sends = asyncio.create_task(_send(connection, page))
    try:
        while True:
            message = await connection.receive()
            if message["type"] == "websocket.disconnect":
                host.view.counts.bad += message.get("code") in _MALFORMED
                break
            host.hear(page, message.get("text"))
            await asyncio.sleep(0)  # a page that floods waits for the others
    finally:
        host.pages.discard(page)
        sends.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sends


async def _send(connection: WebSocket, page: Page) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        while True:
            await connection.send_bytes(await page.next())


def _policy(page: str, hosts: set[str]) -> str:
    """Nothing but the page's own script and style, its pictures, and the socket."""

    def digests(tag: str) -> str:
        texts = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        codes = (base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in texts)
        return " ".join(f"'sha256-{code}'" for code in codes)

    sockets = " ".join(sorted(f"ws://{name}" for name in hosts))
    return (
        f"default-src 'none'; script-src {digests('script')}; style-src {digests('style')}; "
        f"img-src blob: data:; connect-src {sockets}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )


def bound(port: int) -> socket.socket:
    """A socket of this machine alone; port 0: any that is free.

    FinloopError if the port is taken or not allowed.
    """
    one = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        one.bind((HOST, port))
    except (OSError, OverflowError) as error:
        one.close()
        raise FinloopError(
            f"port {port} cannot be had ({getattr(error, 'strerror', None) or error})",
            "a free port: perhaps another live tank is open",
            "end that one, or take another port: make play S='--port 0' finds a free one",
        ) from error
    return one


class Server(uvicorn.Server):
    """Serves the tank on a socket; started: called when it can be reached."""

    def __init__(
        self, view: View, page: str, listens: socket.socket, started: Callable[[], None]
    ) -> None:
        made = app(view, page, listens.getsockname()[1], self._ended)
        self._listens, self._tell = listens, started
        self._failure: BaseException | None = None
        super().__init__(
            uvicorn.Config(
                made, log_level="warning", access_log=False, lifespan="on", server_header=False,
                ws="websockets-sansio", ws_max_size=_LARGEST, ws_per_message_deflate=False,
                timeout_graceful_shutdown=2,
            )
        )  # fmt: skip

    def serve_on(self) -> None:
        """Serve until Ctrl-C (KeyboardInterrupt), `should_exit`, or an error of the tank itself."""
        self.run([self._listens])
        if self._failure is not None:
            raise self._failure

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and say so."""
        await super().startup(sockets)
        if self.started:
            self._tell()

    def _ended(self, task: "asyncio.Task[None]") -> None:
        if not task.cancelled():
            self._failure, self.should_exit = task.exception(), True
