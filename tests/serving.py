"""A server that runs beside a test."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from conftest import PATIENCE_S

from finloop.show.web import bind_socket


@contextmanager
def serving(
    make_server: Callable[..., Any],
    ends_with: type[Exception] | None = None,
    host: str = "127.0.0.1",
) -> Iterator[tuple[str, Any]]:
    """Run a server in a thread; yield its address, and the server.

    make_server: takes a socket, its port, and a function to call when the server is up.
    ends_with: the error that ends it.
    """
    found = []
    with bind_socket(0, host) as listens:
        up, port = threading.Event(), listens.getsockname()[1]
        server = make_server(listens, port, up.set)

        def serve() -> None:
            try:
                server.serve_until_stopped()
            except Exception as error:
                found.append(type(error))

        runs = threading.Thread(target=serve)
        runs.start()
        assert up.wait(PATIENCE_S)
        try:
            yield f"{host}:{port}", server
        finally:
            server.should_exit = ends_with is None
            runs.join(PATIENCE_S)
            assert not runs.is_alive() and found == [ends_with] * (ends_with is not None), found
