"""Which rows of the film were on screen just now, compiled.

A memory holds stretches of film (m, 3), sorted by row and without overlaps: the first row, the last
row, and the tick at which the first was last on screen. So it grows with the jumps of the last
seconds, not with the film, and a binary search finds a row.
"""

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.kernel import kernel, leaf_kernel

NEVER = -(10**9)
"""The tick of a row that was never on screen."""


@leaf_kernel
def last_on_screen(memory: Ints, first: int, last: int) -> int:
    """Return the last tick at which any of the rows first … last was on screen; NEVER for none.

    memory (m, 3): stretches of film that were on screen.
    """
    low, high = 0, len(memory)
    while low < high:  # the first stretch that ends at `first` or later
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


@kernel
def remember_rows(memory: Ints, first: int, last: int, tick: int, forget_tick: float) -> Ints:
    """Return a memory with rows first … last added, shown one after the other from `tick` on.

    memory (m, 3): stretches of film that were on screen. What was shown at `forget_tick` or before
    is forgotten.
    """
    kept = np.empty((len(memory) + 2, 3), np.int64)  # one stretch may be cut in two
    n, added = 0, False
    for k in range(len(memory) + 1):
        a, b, begun = last + 1, last, tick
        if k < len(memory):
            a, b, begun = memory[k, 0], memory[k, 1], memory[k, 2]
        if a < first and begun + min(b, first - 1) - a > forget_tick:
            kept[n, 0], kept[n, 1], kept[n, 2] = a, min(b, first - 1), begun
            n += 1
        if not added and b >= first:
            added = True
            if (
                n
                and kept[n - 1, 1] + 1 == first
                and kept[n - 1, 2] + first - kept[n - 1, 0] == tick
            ):
                kept[n - 1, 1] = last
            else:
                kept[n, 0], kept[n, 1], kept[n, 2] = first, last, tick
                n += 1
        after = max(a, last + 1)
        if after <= b and begun + b - a > forget_tick:
            kept[n, 0], kept[n, 1], kept[n, 2] = after, b, begun + after - a
            n += 1
    return kept[:n].copy()
