"""Mutations of files: bits flipped; parts cut, swapped, repeated, overwritten; numbers replaced."""

import re
import zlib
from collections.abc import Callable, Sequence

import numpy as np

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_WORDS = (
    b"1e999", b"-1e999", b"nan", b"NaN", b"inf", b"-1", b"0", b"99999999999", b"9" * 400, b"1e308",
    b"18446744073709551616", b"-9223372036854775809", b"2147483648", b"true", b"null", b'""', b"'",
    b"[", b"{", b"&a", b"*a", b"!!python/object/apply:os.system [id]", b"\x1b[2J", b"\0", b"\xff",
    b"\xe2\x80\xae", b"__import__('os').system('id')", b"${oc.env:HOME}", b"../../etc/passwd",
)  # fmt: skip
"""What takes the place of a number, or is inserted anywhere."""
_BYTES = (b"\0", b"\xff", b"\x7f", b"\x80", b"\x01")


def mutate(
    data: bytes, seed: tuple[int, ...], repair: Callable[[bytes], bytes] | None = None,
    own: Sequence[Mutation] = (),
) -> bytes:  # fmt: skip
    """Return a file's bytes with one to three mutations.

    seed: of the random choice. repair: makes checksums right again, so that the damage gets past
    them; used for half of all files. own: mutations of this kind of file, beside those of any.
    """
    rng, mutations = np.random.default_rng(seed), (*_MUTATIONS, *own)
    for _ in range(int(rng.integers(1, 4))):
        data = mutations[int(rng.integers(len(mutations)))](data, rng)
    return repair(data) if repair is not None and rng.random() < 0.5 else data


def _choose_range(data: bytes, rng: Rng) -> tuple[int, int]:
    """Return the begin and end of a part of a file: short parts are as frequent as long ones."""
    length = int(min(len(data), 2 ** rng.uniform(0, np.log2(len(data) + 2))))
    begin = int(rng.integers(len(data) - length + 1))
    return begin, begin + length


def _flip_bits(data: bytes, rng: Rng) -> bytes:
    """Flip 1 to 32 bits."""
    content = bytearray(data)
    for place in rng.integers(8 * len(data), size=int(2 ** rng.uniform(0, 5))) if data else ():
        content[place // 8] ^= 1 << int(place % 8)
    return bytes(content)


def _cut_end(data: bytes, rng: Rng) -> bytes:
    """Cut the file off."""
    return data[: int(rng.integers(len(data) + 1))]


def _delete(data: bytes, rng: Rng) -> bytes:
    """Delete a part."""
    begin, end = _choose_range(data, rng)
    return data[:begin] + data[end:]


def _repeat(data: bytes, rng: Rng) -> bytes:
    """Repeat a part up to 64 times, to at most a million bytes more."""
    begin, end = _choose_range(data, rng)
    times = int(min(2 ** rng.uniform(0, 6), 1 + 1e6 // max(1, end - begin)))
    return data[:begin] + data[begin:end] * times + data[begin:]


def _swap(data: bytes, rng: Rng) -> bytes:
    """Copy a part over another one."""
    begin, end = _choose_range(data, rng)
    place = int(rng.integers(len(data) + 1))
    return data[:place] + data[begin:end] + data[place + end - begin :]


def _overwrite(data: bytes, rng: Rng) -> bytes:
    """Overwrite 1, 2, 4 or 8 aligned bytes by the largest or smallest numbers."""
    size = int(2 ** rng.integers(4))
    begin = int(rng.integers(len(data) // size + 1)) * size
    filler = _BYTES[int(rng.integers(len(_BYTES)))]
    return data[:begin] + filler * size + data[begin + size :]


def _replace_number(data: bytes, rng: Rng) -> bytes:
    """Replace a number in a text by a hostile word; without a number insert one."""
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    begin = int(rng.integers(len(data) + 1))
    found = _NUMBER.search(data, begin) or _NUMBER.search(data)
    if found is None:
        return data[:begin] + word + data[begin:]
    return data[: found.start()] + word + data[found.end() :]


def _insert_word(data: bytes, rng: Rng) -> bytes:
    """Insert a hostile word, or thousands of it."""
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    begin, times = int(rng.integers(len(data) + 1)), int(2 ** rng.uniform(0, 13))
    return data[:begin] + word * times + data[begin:]


_MUTATIONS = (
    _flip_bits, _cut_end, _delete, _repeat, _swap, _overwrite, _overwrite, _replace_number,
    _insert_word,
)  # fmt: skip


def repair_png(data: bytes) -> bytes:
    """Return a PNG with right checksums of its chunks, as far as it has chunks."""
    content, place = bytearray(data), 8
    while place + 12 <= len(content):
        end = place + 8 + int.from_bytes(content[place : place + 4])
        if end + 4 > len(content):
            break
        content[end : end + 4] = zlib.crc32(content[place + 4 : end]).to_bytes(4)
        place = end + 4
    return bytes(content)
