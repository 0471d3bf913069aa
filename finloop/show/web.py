"""What every server shares: who may connect, its pages and WebSockets, and the port it listens on.

A page is served, and a WebSocket opened, only under the server's own address (`Host`), and a
WebSocket to a page only if that came from there (`Origin`): no other site that is open in the
browser can look in or steer. A server that other machines reach also requires a token.

A connection ends that neither asks for anything nor answers. There are few at a time, so that
silent ones take no file from the program; few are answered in a second, so that those that ask
without pause take no time from the fish.
"""

import asyncio
import contextlib
import errno
import gc
import hmac
import logging
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from finloop.base.errors import FinloopError
from finloop.show.limits import Budget
from finloop.show.page import make_content_policy

HOST = "127.0.0.1"
BUSY, STRANGER = 1013, 1008  # codes of closing a WebSocket
_BROKEN = 1002, 1007, 1009  # closed since a message was no message, no text, or too long
LARGEST = 64 * 1024  # bytes of a message; a larger one ends the connection
PATIENCE_S = 10.0
"""How long a connection may last before it is a WebSocket, and how long it may take to close."""
MOST_PLAIN = 32
"""Connections that are no WebSocket; one more, and the oldest ends."""
_REQUESTS, _REQUESTS_PER_S = 64, 32
"""Requests that are no messages of a WebSocket: at once, and in a second.

An answer takes up to 1 ms of the processor; to end a connection unheard takes a tenth of that."""
_PING_S = 20.0  # between two pings of a WebSocket; without an answer for as long, it ends
_ACCEPTED, _QUEUED = 8, 128  # new connections that are accepted at once, and that may wait
_SWITCH_S = 0.0005  # after which a thread that computes gives way to the server
GONE = WebSocketDisconnect, RuntimeError, OSError
"""The errors of sending to a client that has disconnected."""


@dataclass(frozen=True)
class AccessPolicy:
    """The rules by which a server decides who may connect to it.

    port: of the server. token: required of all that connect; None: only this machine may connect.
    With a token, any name of its machine reaches the server.
    """

    port: int
    token: str | None = None

    def _is_allowed(self, connection: HTTPConnection) -> bool:
        """Return whether a request is allowed: it names this server's address, or shows the token.

        Where a token is required, the request may name any one address.
        """
        hosts = connection.headers.getlist("host")
        if self.token is None:  # there must be one host, and it must be one of these
            return hosts in [[address] for address in self._addresses]
        claim = connection.query_params.get("token", "").encode()
        return len(hosts) == 1 and hmac.compare_digest(claim, self.token.encode())

    @property
    def _addresses(self) -> list[str]:
        """Return the addresses of the server on this machine."""
        return [f"{name}:{self.port}" for name in (HOST, "localhost")]

    async def accept_socket(self, connection: WebSocket, programs: bool = False) -> bool:
        """Accept or refuse a WebSocket; return whether it was accepted.

        It must come from a page of the server, and show the token if required. programs: whether a
        program, which sends no `Origin`, may connect, too.
        """
        origins = connection.headers.getlist("origin")
        addresses = [connection.headers.get("host", "")] if self.token else self._addresses
        from_page = origins in [[f"http://{address}"] for address in addresses]
        if self._is_allowed(connection) and (from_page or (programs and not origins)):
            await connection.accept()
            return True
        await connection.close(STRANGER)  # before it is accepted: the answer is 403
        return False

    def answer_request(self, request: Request, page: str) -> Response:
        """Return a page, or HTTP status 421 if the request has a foreign host or lacks the token.

        page: its HTML.
        """
        if not self._is_allowed(request):
            return PlainTextResponse("not this host, or no token", 421)
        host = request.headers["host"]
        sources = f"img-src blob: data:; connect-src ws://{host}; frame-ancestors 'none'"
        headers = {
            "Content-Security-Policy": make_content_policy(page, sources),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
        }
        return Response(page, media_type="text/html; charset=utf-8", headers=headers)


def bind_socket(port: int, host: str = HOST, kind: int = socket.SOCK_STREAM) -> socket.socket:
    """Return a socket that is bound to a port; port 0 takes a free one.

    host: address on which it can be reached, by default on this machine alone. kind: SOCK_STREAM or
    SOCK_DGRAM. FinloopError if the port is taken or not allowed, or this machine has no such
    address.
    """
    # Named so, asyncio sends small messages at once; else they wait 40 ms for the page's answer.
    protocol = socket.IPPROTO_TCP if kind == socket.SOCK_STREAM else socket.IPPROTO_UDP
    bound = socket.socket(socket.AF_INET, kind, protocol)
    if kind == socket.SOCK_STREAM:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((host, port))
    except (OSError, OverflowError) as error:
        bound.close()
        raise FinloopError(
            f"port {port} is not available ({getattr(error, 'strerror', None) or error})",
            "a port that no other program uses",
            "close the live tank that may be open, or take another port: --port 0 finds a free one",
        ) from error
    return bound


async def receive_messages(
    connection: WebSocket, rest_s: float = 0.0
) -> AsyncIterator[str | bytes | None]:
    """Yield the messages of a WebSocket until it closes; None for one that broke the protocol.

    rest_s: how long no further message is read after each. Meanwhile the system's buffers fill, and
    the sender has to wait.
    """
    while True:
        message = await connection.receive()
        if message["type"] == "websocket.disconnect":
            if message.get("code") in _BROKEN:
                yield None
            return
        text: str | None = message.get("text")
        yield message.get("bytes") if text is None else text
        await asyncio.sleep(rest_s)  # even with 0, other clients come first


async def cancel_task(task: "asyncio.Task[None]") -> None:
    """Cancel a task, and wait until it has ended."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


class SocketRoute(NamedTuple):
    """A WebSocket that a server offers, and who may connect to it.

    serve: serves one connection until it ends; most: the largest number of connections; programs:
    whether programs that are no pages may connect.
    """

    path: str
    serve: Callable[[WebSocket], Coroutine[Any, Any, None]]
    most: int
    programs: bool = False


class PlainConnection(H11Protocol):
    """A connection that asks for a page, or for a WebSocket and is none yet.

    requests: budget that all connections of a server share; each piece of data spends 1.
    """

    requests: Budget

    def data_received(self, data: bytes) -> None:
        """Handle data of a request; if too much comes, end the connection without reading it."""
        if self.requests.spend(1, self.loop.time()):
            super().data_received(data)
        else:
            self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin; end the oldest connection of this kind if there are too many."""
        self.begun_s = self.loop.time()
        super().connection_made(transport)
        plain = [
            other
            for other in self.connections
            if isinstance(other, PlainConnection) and not other.transport.is_closing()
        ]
        if len(plain) > MOST_PLAIN:
            min(plain, key=lambda other: other.begun_s).transport.abort()


class AppServer(uvicorn.Server):
    """Web server with pages, WebSockets and tasks beside them; an error of a task ends it."""

    def __init__(
        self, listens: socket.socket, policy: AccessPolicy, pages: Mapping[str, str],
        sockets: Sequence[SocketRoute], tasks: Callable[[], list[Coroutine[Any, Any, None]]],
        started: Callable[[], None],
    ) -> None:  # fmt: skip
        """Prepare the server; `serve_until_stopped` starts it.

        listens: the bound socket. pages: HTML by path. tasks: returns coroutines to run beside the
        server. started: called once the server can be reached.
        """
        self._listens, self._policy, self._tasks, self._on_start = listens, policy, tasks, started
        self._failure: BaseException | None = None
        self._waiting_since: dict[Any, float] = {}  # connections that will end, by the loop's clock
        self._has_no_file = False
        routes = [self._page_route(*page) for page in pages.items()]
        app = Starlette(
            routes=[*routes, *map(self._socket_route, sockets)], lifespan=self._run_tasks
        )
        requests = Budget(_REQUESTS, _REQUESTS_PER_S)
        paced_connection = type("PacedConnection", (PlainConnection,), {"requests": requests})
        super().__init__(uvicorn.Config(
            app, log_level="error", access_log=False, lifespan="on", server_header=False,
            http=paced_connection, ws="websockets-sansio", ws_max_size=LARGEST,
            ws_per_message_deflate=False, ws_ping_interval=_PING_S, ws_ping_timeout=_PING_S,
            timeout_graceful_shutdown=2, backlog=_ACCEPTED,
        ))  # fmt: skip
        logging.getLogger("uvicorn.error").addFilter(_is_about_server)

    def _page_route(self, path: str, page: str) -> Route:
        """Return the route that answers requests for a page (HTML) at a path such as "/show"."""

        async def answer_page_request(request: Request) -> Response:
            """Return the page, or a refusal."""
            return self._policy.answer_request(request, page)

        return Route(path, answer_page_request)

    def _socket_route(self, route: SocketRoute) -> WebSocketRoute:
        """Return the route that accepts WebSockets, up to the largest number of connections."""
        connections = set[WebSocket]()

        async def serve_connection(connection: WebSocket) -> None:
            """Serve an accepted WebSocket until it ends; refuse it if there are too many."""
            try:
                if not await self._policy.accept_socket(connection, route.programs):
                    return
                if len(connections) >= route.most:
                    await connection.close(BUSY, "too many")
                    return
            except GONE:
                return
            connections.add(connection)
            try:
                await route.serve(connection)
            finally:
                connections.discard(connection)

        return WebSocketRoute(route.path, serve_connection)

    @contextlib.asynccontextmanager
    async def _run_tasks(self, _: Starlette) -> AsyncIterator[None]:
        """Run the tasks until the server stops; meanwhile Python's own pauses are kept short."""
        gc.collect()
        gc.freeze()  # present objects are not scanned again, which takes time
        asyncio.get_running_loop().set_exception_handler(self.handle_loop_error)
        switch_interval_s = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        running = [asyncio.create_task(task) for task in self._tasks()]
        for task in running:
            task.add_done_callback(self._handle_task_end)
        yield
        for task in running:
            task.cancel()
        if running:
            await asyncio.wait(running)
        sys.setswitchinterval(switch_interval_s)
        gc.unfreeze()

    def _handle_task_end(self, task: "asyncio.Task[None]") -> None:
        """Stop the server if a task has ended with an error, which is kept to be raised."""
        if not task.cancelled() and task.exception() is not None:
            self._failure, self.should_exit = task.exception(), True

    def serve_until_stopped(self) -> None:
        """Serve until Ctrl-C (KeyboardInterrupt) or `should_exit`; raise the error of a task."""
        self.run([self._listens])
        if self._failure is not None:
            raise self._failure

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the server on bound sockets; call the function `started` if it can be reached."""
        await super().startup(sockets)
        if self.started:
            self._listens.listen(_QUEUED)  # more than are accepted at once may wait
            self._on_start()

    async def on_tick(self, counter: int) -> bool:
        """End connections that are overdue, ten times a second; return whether to stop."""
        self.end_overdue_connections(asyncio.get_running_loop().time())
        return await super().on_tick(counter)

    def end_overdue_connections(self, now_s: float) -> None:
        """End connections that did not become WebSockets in time, or whose peer lets none close.

        now_s: the time of any clock, but always of the same.
        """
        waiting = (
            connection
            for connection in self.server_state.connections
            if isinstance(connection, PlainConnection) or connection.transport.is_closing()
        )
        self._waiting_since = {
            connection: self._waiting_since.get(connection, now_s) for connection in waiting
        }
        for connection, since_s in self._waiting_since.items():
            if now_s - since_s >= PATIENCE_S:
                connection.transport.abort()

    def handle_loop_error(self, loop: asyncio.AbstractEventLoop, facts: dict[str, Any]) -> None:
        """Report an error that no task has caught; where all files are in use, report it once."""
        error = facts.get("exception")
        if not (isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE)):
            loop.default_exception_handler(facts)
        elif not self._has_no_file:
            self._has_no_file = True
            print(
                "finloop: as many files are open as the system permits; new pages have to wait"
                " (ulimit -n 4096, then start it again)",
                file=sys.stderr,
            )


def _is_about_server(record: logging.LogRecord) -> bool:
    """Return whether a log entry of uvicorn is about the server, not a client's invalid text."""
    return not (record.exc_info and isinstance(record.exc_info[1], UnicodeDecodeError))
