"""The pages that are connected to a server, each with its queue of messages.

No page can make memory grow: one that takes nothing for some time is disconnected, and connects
again by itself.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import Field
from starlette.websockets import WebSocket

from finloop.show.feed import Feed
from finloop.show.message import StrictModel
from finloop.show.page import pack_message
from finloop.show.web import BUSY, GONE, cancel_task, receive_messages

_MOST_WAITING = 4096  # messages that wait for a page before it is disconnected


class TimeRequest(StrictModel):
    """A page's request for the server's time, and its report that it draws.

    sent: ms of the page's clock. frames: how many frames it has drawn.
    """

    do: Literal["ping"]
    sent: Annotated[float, Field(ge=-1e12, le=1e12)]
    frames: Annotated[int, Field(ge=0, le=2**53)]


class Page:
    """A connected page, with the queue of messages to it.

    is_open: whether it has got what a page needs first, and gets all messages from now on. frames:
    how many it has drawn.
    """

    def __init__(self, connection: WebSocket) -> None:
        """Begin with an empty queue; the page is not open yet."""
        self.connection, self.is_open, self.frames = connection, False, 0
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


AnyPage = TypeVar("AnyPage", bound=Page)


class Hub(Generic[AnyPage]):
    """The connected pages of a server: it handles their messages, and queues messages to all.

    pages: in the order in which they connected.
    """

    page_type: type[AnyPage]
    rest_s = 0.0
    """How long no further message of a page is read after each."""

    def __init__(self, feed: Feed, read_time: Callable[[], float] = time.perf_counter) -> None:
        """Begin without any page; feed: makes its messages; read_time: returns the server's s."""
        self.feed, self.read_time = feed, read_time
        self.pages: list[AnyPage] = []
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
        """Queue a message to all open pages; disconnect those whose queue is full."""
        for page in [page for page in self.pages if page.is_open]:
            if not page.send(content):
                self.remove_page(page)
                self.run_in_background(page.connection.close(BUSY, "too slow"))

    def remove_page(self, page: AnyPage) -> None:
        """Forget a page that has disconnected, if it is not forgotten yet."""
        if page in self.pages:
            self.pages.remove(page)
            self.handle_change()

    def answer_ping(self, page: AnyPage, request: TimeRequest) -> None:
        """Send a page the server's time."""
        pong = {"kind": "pong", "sent": request.sent, "now": self.read_time()}
        page.send(pack_message(pong))

    def handle_change(self) -> None:
        """Do nothing when a page has come or gone; subclasses handle it."""

    def handle_content(self, page: AnyPage, content: str | bytes | None) -> None:
        """Handle a message of a page; None stands for one that broke the protocol."""
        raise NotImplementedError

    async def serve_page(self, connection: WebSocket) -> None:
        """Serve a page until it disconnects: handle its messages, and send those to it."""
        page = self.page_type(connection)
        self.pages.append(page)
        self.handle_change()
        delivering = asyncio.create_task(page.deliver())
        try:
            async for content in receive_messages(connection, self.rest_s):
                self.handle_content(page, content)
        finally:
            self.remove_page(page)
            await cancel_task(delivering)
