"""Which rows of the film were on screen lately, compiled.

A memory holds stretches of film (m, 3), sorted by row and without overlaps: the first row, the last
row, and the tick at which the first was last on screen. So it grows with the jumps of the last
seconds, not with the film, and an index finds a row.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.kernel import kernel, leaf_kernel

NEVER = -(10**9)
"""The tick of a row that was never on screen."""
_MARK_BITS = 5  # a mark of `mark_rows` stands for 2⁵ rows: a leg sets few of 64 bits


class MemoryIndex(NamedTuple):
    """Where in a memory (m, 3) to look for a row: the rows are cut into b blocks of 2^k rows.

    first_row: of the first block; block_bits: k; starts (b + 1,): for each block the number of the
    first stretch that ends in it or after it, and at last m.
    """

    first_row: int
    block_bits: int
    starts: Ints


@kernel
def index_memory(memory: Ints) -> MemoryIndex:
    """Return an index of a memory, by which the stretch of film that holds a row is found fast.

    memory (m, 3): stretches that were on screen, by row: first row, last row, tick of the first.
    There are about two blocks of rows for each stretch.
    """
    count = len(memory)
    if count == 0:
        return MemoryIndex(0, 0, np.zeros(1, np.int64))
    first_row, block_bits = memory[0, 0], 0  # a block has 2^block_bits rows
    while (memory[count - 1, 1] - first_row) >> block_bits > 2 * count:
        block_bits += 1
    starts = np.empty(((memory[count - 1, 1] - first_row) >> block_bits) + 2, np.int64)
    stretch = 0
    for block in range(len(starts) - 1):
        while memory[stretch, 1] < first_row + (block << block_bits):
            stretch += 1
        starts[block] = stretch
    starts[-1] = count
    return MemoryIndex(first_row, block_bits, starts)


@leaf_kernel
def last_on_screen(memory: Ints, first: int, last: int) -> int:
    """Return the last tick at which any of the rows first … last was on screen; NEVER for none.

    memory (m, 3): stretches of film on screen: first row, last row, tick of the first.
    """
    return _last_tick_of_rows(memory, 0, len(memory), first, last)


@leaf_kernel
def find_last_on_screen(memory: Ints, index: MemoryIndex, first: int, last: int) -> int:
    """Return, by an index, the last tick at which a row of first … last was on screen; or NEVER.

    memory (m, 3): stretches of film that were on screen; index: from `index_memory`, by which a row
    is found more quickly than by `last_on_screen`.
    """
    # The stretch sought is that of the first row's block, or one after it.
    block = max(first - index.first_row, 0) >> index.block_bits
    if block + 1 >= len(index.starts):
        return NEVER
    return _last_tick_of_rows(memory, index.starts[block], index.starts[block + 1], first, last)


@leaf_kernel
def _last_tick_of_rows(memory: Ints, low: int, high: int, first: int, last: int) -> int:
    """Return the last tick at which a row of first … last was on screen; NEVER for none.

    memory (m, 3): stretches of film on screen: first row, last row, tick of the first; low, high:
    numbers of stretches between which the first one that ends at row `first` or later is sought, by
    bisection.
    """
    while low < high:
        middle = (low + high) // 2
        if memory[middle, 1] < first:
            low = middle + 1
        else:
            high = middle
    tick = NEVER
    while low < len(memory) and memory[low, 0] <= last:
        tick = max(tick, memory[low, 2] + min(memory[low, 1], last) - memory[low, 0])
        low += 1
    return tick


@leaf_kernel
def mark_rows(marks: int, first: int, last: int) -> int:
    """Add rows first … last to a set of rows that is kept as 64 bits; return the set.

    Each bit stands for 32 rows, and for those 2048, 4096 … rows farther on. A row whose bit is 0 is
    not in the set; a row whose bit is 1 may be in it. marks: the set.
    """
    for group in range(first >> _MARK_BITS, (last >> _MARK_BITS) + 1):
        marks |= 1 << (group & 63)
    return marks


@kernel
def remember_rows(memory: Ints, first: int, last: int, tick: int, forget_tick: float) -> Ints:
    """Return a memory (k, 3), sorted by row, with rows first … last, shown from `tick` on, added.

    memory (m, 3): stretches of film on screen: first row, last row, tick of the first. An older
    stretch gives way where they overlap. What was last shown at `forget_tick` or before is dropped.
    """
    kept = np.empty((len(memory) + 2, 3), np.int64)  # one stretch may be cut in two
    count, added = 0, False
    # Of each old stretch the rows below `first` are kept, then come the new rows in their place,
    # then the old rows above `last`. An empty stretch after the last one adds the new rows there.
    for k in range(len(memory) + 1):
        begin, end, begin_tick = last + 1, last, tick
        if k < len(memory):
            begin, end, begin_tick = memory[k, 0], memory[k, 1], memory[k, 2]
        if begin < first and begin_tick + min(end, first - 1) - begin > forget_tick:
            kept[count, 0], kept[count, 1], kept[count, 2] = begin, min(end, first - 1), begin_tick
            count += 1
        if not added and end >= first:
            added = True
            continues = count and kept[count - 1, 1] + 1 == first
            if continues and kept[count - 1, 2] + first - kept[count - 1, 0] == tick:
                kept[count - 1, 1] = last
            else:
                kept[count, 0], kept[count, 1], kept[count, 2] = first, last, tick
                count += 1
        rest = max(begin, last + 1)
        if rest <= end and begin_tick + end - begin > forget_tick:
            kept[count, 0], kept[count, 1], kept[count, 2] = rest, end, begin_tick + rest - begin
            count += 1
    return kept[:count].copy()
