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
_BUNDLE_HEAD = len(_BUNDLE) + 8  # bytes of a bundle before its messages: the mark, a time

Receive = Callable[[str | None, str], None]
"""Takes a text, None if it is invalid, and its sender."""


async def receive_datagrams(
    sock: socket.socket, kind: str, receive: Receive, token: str | None
) -> None:
    """Pass on the messages that arrive at a bound UDP socket, until cancelled; raise its errors.

    kind: "udp" for JSON texts, "osc" for OSC. token: what each message must show; None: nothing.
    """
    failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    class DatagramHandler(asyncio.DatagramProtocol):
        """Handler of arriving datagrams; it stops the receiving if `receive` raises an error."""

        def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
            """Pass the texts of one datagram to `receive`: None for each that cannot be read.

            addr: host and port of its sender.
            """
            is_osc = kind == "osc"
            texts = parse_osc_packet(data, token) if is_osc else [parse_datagram(data, token)]
            try:
                for text in texts:
                    receive(text, f"{kind}://{addr[0]}:{addr[1]}")
            except Exception as error:  # asyncio would only log it; `failed` ends the input
                if not failed.done():
                    failed.set_exception(error)

    sock.setblocking(False)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(DatagramHandler, sock=sock)
    try:
        await failed
    finally:
        transport.close()


def parse_datagram(content: bytes, token: str | None) -> str | None:
    """Return the JSON text of a datagram without its token; None if text or token is invalid.

    token: the password that its first object must hold under `token`; None: no password.
    """
    if len(content) > LONGEST:
        return None
    try:
        text = content.decode()
        if token is None:
            return text
        message = json.loads(text)
        items = message if isinstance(message, list) else [message]
        if not items or not all(isinstance(item, dict) for item in items):
            return None
        tokens = [item.pop("token", None) for item in items]  # no password is passed on
        return json.dumps(message) if _equals_token(tokens[0], token) else None
    except (ValueError, RecursionError):
        return None


def _equals_token(claim: Any, token: str) -> bool:
    """Return whether a value is the token; the comparison takes constant time for safety."""
    text = claim if isinstance(claim, str) else ""
    return hmac.compare_digest(text.encode(), token.encode())


def parse_osc_packet(content: bytes, token: str | None) -> list[str | None]:
    """Return the JSON texts of an OSC packet, one for each message, None for an invalid message.

    An invalid packet gives [None]. token: the password that must be each message's first argument;
    None: no password.
    """
    parts = [content] if not content.startswith(_BUNDLE) else list(_split_bundle(content))
    if len(content) > LONGEST or not 0 < len(parts) <= MOST_AT_ONCE:
        return [None]
    return [_parse_osc_message(part, token) for part in parts]


def _split_bundle(bundle: bytes) -> Iterator[bytes]:
    """Yield the messages of an OSC bundle, each of which follows its length in the bundle.

    The OSC library would log each part that it does not know, and open bundles within bundles.
    """
    end = _BUNDLE_HEAD
    while end < len(bundle):
        begin = end + 4  # bytes of the length
        end = begin + int.from_bytes(bundle[end:begin])
        yield bundle[begin:end]


def _parse_osc_message(part: bytes, token: str | None) -> str | None:
    """Return the JSON text of one OSC message; None if the message or its token is invalid.

    Its arguments are t, id, x, y and maybe heading, or one JSON text; a token comes first.
    """
    tags = part[len(ADDRESS) : part.find(b"\0", len(ADDRESS))]  # "," and the arguments' types
    if not part.startswith(ADDRESS) or tags[:1] != b"," or not set(tags[1:]) <= _TAGS:
        return None
    try:
        arguments = list(OscMessage(part).params)
    except (ParseError, ValueError):
        return None
    if token is not None and not (arguments and _equals_token(arguments.pop(0), token)):
        return None
    if len(arguments) == 1 and isinstance(arguments[0], str):
        return arguments[0]
    if len(arguments) not in (len(_FIELDS) - 1, len(_FIELDS)):
        return None
    return json.dumps(dict(zip(_FIELDS, arguments, strict=False)))
