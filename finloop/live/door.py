"""Access control of the servers: who may connect, what a page may do, and the socket itself.

A page is served, and a WebSocket opened, only under the server's own address (`Host`), and a
WebSocket to a page only if that came from there (`Origin`): no other site that is open in the
browser can look in or steer. A server that other machines reach also requires a token.
"""

import base64
import hashlib
import hmac
import logging
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass

import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.websockets import WebSocket

from finloop.base.errors import FinloopError

HOST = "127.0.0.1"
BUSY, STRANGER = 1013, 1008  # codes of closing a WebSocket
MALFORMED = 1002, 1007, 1009  # closed since a message was no message, no text, or too long
_LARGEST = 64 * 1024  # bytes of a message; a larger one ends the connection


@dataclass(frozen=True)
class Door:
    """Decides who may connect to a server. port: of the server.

    token: required of all that connect; None: only this machine may connect. With a token, any name
    of its machine reaches the server.
    """

    port: int
    token: str | None = None

    @property
    def _names(self) -> list[str]:
        return [f"{name}:{self.port}" for name in (HOST, "localhost")]

    def knows(self, connection: HTTPConnection) -> bool:
        """Return whether a request names the server's own address, and the token if required."""
        hosts = connection.headers.getlist("host")
        if self.token is None:
            return hosts in [[name] for name in self._names]
        shown = connection.query_params.get("token", "").encode()
        return len(hosts) == 1 and hmac.compare_digest(shown, self.token.encode())

    async def opens(self, connection: WebSocket, program: bool = False) -> bool:
        """Accept or refuse a WebSocket, and return whether it was accepted.

        It must come from a page of the server. program: whether a program, which sends no `Origin`,
        may connect, too.
        """
        origins = connection.headers.getlist("origin")
        names = [connection.headers.get("host", "")] if self.token else self._names
        own = origins in [[f"http://{name}"] for name in names]
        if self.knows(connection) and (own or (program and not origins)):
            await connection.accept()
            return True
        await connection.close(STRANGER)  # before it is accepted: the answer is 403
        return False

    def page(self, request: Request, text: str) -> Response:
        """Return the response with a page, or a refusal (421); text: the HTML."""
        if not self.knows(request):
            return PlainTextResponse("not this host, or no token", 421)
        headers = {
            "Content-Security-Policy": _policy(text, request.headers["host"]),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
        }
        return Response(text, media_type="text/html; charset=utf-8", headers=headers)


def _policy(page: str, host: str) -> str:
    """Return a policy for the page's own script and style, its pictures, and the socket alone."""

    def digests(tag: str) -> str:
        texts = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        codes = (base64.b64encode(hashlib.sha256(t.encode()).digest()).decode() for t in texts)
        return " ".join(f"'sha256-{code}'" for code in codes)

    return (
        f"default-src 'none'; script-src {digests('script')}; style-src {digests('style')}; "
        f"img-src blob: data:; connect-src ws://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )


def bind_socket(port: int, host: str = HOST, kind: int = socket.SOCK_STREAM) -> socket.socket:
    """Return a socket bound to a port, by default for this machine alone; port 0 takes a free one.

    kind: SOCK_STREAM or SOCK_DGRAM. FinloopError if the port is taken or not allowed, or this
    machine has no address `host`.
    """
    # Named so, asyncio sends small messages at once; else they wait 40 ms for the page's answer.
    protocol = socket.IPPROTO_TCP if kind == socket.SOCK_STREAM else socket.IPPROTO_UDP
    one = socket.socket(socket.AF_INET, kind, protocol)
    if kind == socket.SOCK_STREAM:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        one.bind((host, port))
    except (OSError, OverflowError) as error:
        one.close()
        raise FinloopError(
            f"port {port} is not available ({getattr(error, 'strerror', None) or error})",
            "a free port: perhaps another live tank is open",
            "end that tank, or take another port: --port 0 finds a free one",
        ) from error
    return one


def _is_ours(record: logging.LogRecord) -> bool:
    """Return whether an entry of uvicorn's log is about the server, not a client's bad text."""
    return not (record.exc_info and isinstance(record.exc_info[1], UnicodeDecodeError))


class AppServer(uvicorn.Server):
    """Serves an application on a socket (listens); started: called once it can be reached.

    `fail` ends it: `serve_on` raises the error then.
    """

    def __init__(self, app: Starlette, listens: socket.socket, started: Callable[[], None]) -> None:
        self._listens, self._tell = listens, started
        self._failure: BaseException | None = None
        super().__init__(
            uvicorn.Config(
                app, log_level="warning", access_log=False, lifespan="on", server_header=False,
                ws="websockets-sansio", ws_max_size=_LARGEST, ws_per_message_deflate=False,
                timeout_graceful_shutdown=2,
            )
        )  # fmt: skip
        logging.getLogger("uvicorn.error").addFilter(_is_ours)

    def serve_on(self) -> None:
        """Serve until Ctrl-C (KeyboardInterrupt), `should_exit`, or `fail`; raise its error."""
        self.run([self._listens])
        if self._failure is not None:
            raise self._failure

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the server, and call `started` if it can be reached."""
        await super().startup(sockets)
        if self.started:
            self._tell()

    def fail(self, error: BaseException | None) -> None:
        """End the server, and let `serve_on` raise the error; None: end without an error."""
        self._failure, self.should_exit = error, True
