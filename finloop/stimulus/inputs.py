"""Messages of trackers by UDP and OSC, turned into the JSON texts of `finloop.stimulus.tracker`.

UDP: a datagram is one text. OSC: the address /finloop/animal with t, id, x, y and maybe heading, or
with one text; several messages may come as a bundle. An OSC float has 32 bits, too few for seconds
since 1970: send t as a double, or count from the tracker's start.

Other machines must show the token: in the JSON (of a list, in its first sighting), or as the first
argument of OSC. An invalid message becomes None, which is only counted.
"""

import asyncio
import hmac
import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

from pythonosc.osc_message import OscMessage, ParseError

from finloop.stimulus.tracker import LONGEST, MOST_AT_ONCE

ADDRESS = b"/finloop/animal\0"  # 16 bytes: OSC requires a multiple of 4
_FIELDS = ("t", "id", "x", "y", "heading")
_TAGS = frozenset(b"ifdhs")  # types of arguments; the library logs others that it does not know
_BUNDLE = b"#bundle\0"
_HEAD = len(_BUNDLE) + 8  # bytes of a bundle before its parts: the mark, a time

Hear = Callable[[str | None, str], None]
"""Takes a text, None if it is invalid, and its sender."""


def guard_input(hear: Hear, fail: Callable[[BaseException], None]) -> Hear:
    """Return `hear` with its errors passed to `fail`; asyncio would end the input silently."""

    def heard(text: str | None, source: str) -> None:
        try:
            hear(text, source)
        except Exception as error:
            fail(error)

    return heard


async def open_udp(sock: socket.socket, hear: Hear, token: str | None) -> asyncio.BaseTransport:
    """Pass JSON texts that arrive at a bound UDP socket to `hear`; closing the transport ends it.

    token: what each message must show; None: nothing.
    """
    return await _open(sock, lambda content: [json_of(content, token)], "udp", hear)


async def open_osc(sock: socket.socket, hear: Hear, token: str | None) -> asyncio.BaseTransport:
    """Pass OSC messages at a bound UDP socket to `hear` as JSON; closing the transport ends it.

    token: what each message must show; None: nothing.
    """
    return await _open(sock, lambda content: osc_of(content, token), "osc", hear)


async def _open(
    sock: socket.socket, texts: Callable[[bytes], list[str | None]], name: str, hear: Hear
) -> asyncio.BaseTransport:
    sock.setblocking(False)
    loop = asyncio.get_running_loop()
    made = await loop.create_datagram_endpoint(lambda: _Datagrams(texts, name, hear), sock=sock)
    return made[0]


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(
        self, texts: Callable[[bytes], list[str | None]], name: str, hear: Hear
    ) -> None:  # fmt: skip
        self._texts, self._name, self._hear = texts, name, hear

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        source = f"{self._name}://{addr[0]}:{addr[1]}"
        for text in self._texts(data):
            self._hear(text, source)


def json_of(content: bytes | str, token: str | None) -> str | None:
    """Return the JSON text of a datagram without its token; None if it or the token is invalid."""
    if len(content) > LONGEST:
        return None
    try:
        text = content if isinstance(content, str) else content.decode()
        if token is None:
            return text
        message = json.loads(text)
        items = message if isinstance(message, list) else [message]
        if not items or not all(isinstance(item, dict) for item in items):
            return None
        tokens = [item.pop("token", None) for item in items]
        return json.dumps(message) if _same(tokens[0], token) else None
    except (ValueError, RecursionError):
        return None


def _same(claim: Any, token: str) -> bool:
    """Return whether a claim is the token, in constant time."""
    text = claim if isinstance(claim, str) else ""
    return hmac.compare_digest(text.encode(), token.encode())


def osc_of(content: bytes, token: str | None) -> list[str | None]:
    """Return the JSON texts of an OSC packet, one a message, None for an invalid one.

    An invalid packet gives [None]. token: what each message must show; None: nothing.
    """
    parts = [content] if not content.startswith(_BUNDLE) else list(_parts(content))
    if len(content) > LONGEST or not 0 < len(parts) <= MOST_AT_ONCE:
        return [None]
    return [_text(part, token) for part in parts]


def _parts(bundle: bytes) -> Iterator[bytes]:
    """Yield the parts of a bundle, each preceded by its length.

    The library would log each part that it does not know, and descend into bundles of bundles.
    """
    at = _HEAD
    while at < len(bundle):
        begin = at + 4
        at = begin + int.from_bytes(bundle[at:begin])
        yield bundle[begin:at]


def _text(part: bytes, token: str | None) -> str | None:
    tags = part[len(ADDRESS) : part.find(b"\0", len(ADDRESS))]
    if not part.startswith(ADDRESS) or tags[:1] != b"," or not set(tags[1:]) <= _TAGS:
        return None
    try:
        arguments = list(OscMessage(part).params)
    except (ParseError, ValueError):
        return None
    if token is not None and not (arguments and _same(arguments.pop(0), token)):
        return None
    if len(arguments) == 1 and isinstance(arguments[0], str):
        return arguments[0]
    if len(arguments) not in (len(_FIELDS) - 1, len(_FIELDS)):
        return None
    return json.dumps(dict(zip(_FIELDS, arguments, strict=False)))
