"""Triggers: messages that begin a trial, and messages to other devices."""

import socket
from collections.abc import Callable
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import Field, ValidationError

from finloop.live.message import Message

LONGEST = 1000  # bytes of an incoming trigger


class _Trigger(Message):
    """A device begins a trial."""

    do: Literal["trigger"]
    name: Annotated[str, Field(max_length=80)]
    token: Annotated[str, Field(max_length=200)] = ""


def trigger_of(text: str | bytes | None) -> str | None:
    """Return the name in a message {"do": "trigger", "name": …}; None for any other text."""
    if text is None or len(text) > LONGEST:
        return None
    try:
        return _Trigger.model_validate_json(text).name
    except (ValidationError, UnicodeError):
        return None


class Outlet:
    """Sends triggers by UDP, or through `say` to all connected programs."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, to: str, text: str) -> str | None:
        """Send a text to udp://host:port, or `socket`; return what went wrong, if anything."""
        if to == "socket":
            self._say(text)
            return None
        parts = urlsplit(to)
        try:
            self._socket.sendto(text.encode(), (parts.hostname, parts.port))
        except OSError as error:
            return str(error)
        return None

    def close(self) -> None:
        """Close the UDP socket."""
        self._socket.close()
