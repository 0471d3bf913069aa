"""Limits for files of strangers: what a file may unpack to.

A small file can declare, or unpack to, more than any memory holds. The size that it declares is
checked before anything is decoded; what it unpacks to is limited while it is decoded.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TypeVar

from rich.filesize import decimal

from finloop.base.errors import FinloopError
from finloop.base.limited_process import LimitedProcess, LimitExceededError

A = TypeVar("A")
B = TypeVar("B")

MOST_BYTES = 2**28
"""What any file may unpack to: a picture of 89 million pixels in colour, 11 million keypoints."""
MOST_RATIO = 100
"""Larger content may have so many times the size of its file. Films and tracks reach 50."""
DEFLATE_RATIO = 1032
"""No file that is deflated unpacks to more times its size."""
_SECONDS, _SECONDS_BYTES = 8, 10**8  # of the processor, for each so many bytes of a file
_LIBRARIES_BYTES = 2**31  # what a process takes before it reads anything
_COPIES = 4  # of the content that a reader has at once, while it converts


def refuse_bomb(
    name: object, declared: int, packed: int, do: str, most_ratio: int = MOST_RATIO
) -> None:
    """Raise FinloopError if a file declares far more content than its size can hold.

    name: of the file or of its part, for the message. declared: bytes of the unpacked content.
    packed: bytes of the file. do: what to do about it. most_ratio: of content larger than any file
    may have.
    """
    if declared > _largest_content(packed, most_ratio):
        raise FinloopError(
            f"{name} declares {decimal(declared)} of content, in a file of {decimal(packed)}",
            f"content of at most {decimal(MOST_BYTES)}, or {most_ratio:,} times the file's size",
            do,
        )


def _largest_content(packed: int, most_ratio: int = MOST_RATIO) -> int:
    """Return how many bytes a file of a size in bytes may unpack to."""
    return max(MOST_BYTES, most_ratio * packed)


@contextmanager
def limit_memory(packed: int) -> Iterator[None]:
    """Let a block take only as much memory as a file of `packed` bytes may need; then MemoryError.

    This stops content that unpacks to more than the file declares. Linux alone can do so: on other
    systems the block runs without a limit. The limit holds for all threads of the process.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    wanted = taken + _COPIES * _largest_content(packed)
    others = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([wanted, *others]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def call_aside(function: Callable[[A], B], argument: A, packed: int) -> B:
    """Return function(argument), called in another process that reads a file of `packed` bytes.

    For libraries that a damaged file can send into an endless loop, or crash: then only that
    process ends. function: of a module, by its name. ValueError if that process ends, or takes too
    much time.
    """
    parts = -(-max(1, packed) // _SECONDS_BYTES)
    try:
        return _reading_process(parts).call(function, argument)
    except LimitExceededError as error:
        raise ValueError(
            f"reading it takes more than {parts * _SECONDS} s, or ends the process that reads it"
        ) from error


@cache
def _reading_process(parts: int) -> LimitedProcess:
    """Return the process that reads files of so many parts; it starts with the first file."""
    memory = _LIBRARIES_BYTES + _COPIES * _largest_content(parts * _SECONDS_BYTES)
    return LimitedProcess(parts * _SECONDS, memory >> 20)
