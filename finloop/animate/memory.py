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
def last_on_screen(recent: Ints, first: int, last: int) -> int:
    """Return the last tick at which any of the rows first … last was on screen; NEVER for none.

    recent (m, 3): the memory.
    """
    low, high = 0, len(recent)
    while low < high:  # the first stretch that ends at `first` or later
        middle = (low + high) // 2
        if recent[middle, 1] < first:
            low = middle + 1
        else:
            high = middle
    tick = NEVER
    while low < len(recent) and recent[low, 0] <= last:
        tick = max(tick, recent[low, 2] + min(recent[low, 1], last) - recent[low, 0])
        low += 1
    return tick


@kernel
def remember_rows(recent: Ints, first: int, last: int, tick: int, since: float) -> Ints:
    """Return a memory with rows first … last added, shown one after the other from `tick` on.

    recent (m, 3): the memory so far. What was shown at tick `since` or before is forgotten.
    """
    kept = np.empty((len(recent) + 2, 3), np.int64)  # one stretch may be cut in two
    n, added = 0, False
    for k in range(len(recent) + 1):
        a, b, begun = last + 1, last, tick
        if k < len(recent):
            a, b, begun = recent[k, 0], recent[k, 1], recent[k, 2]
        if a < first and begun + min(b, first - 1) - a > since:
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
        if after <= b and begun + b - a > since:
            kept[n, 0], kept[n, 1], kept[n, 2] = after, b, begun + after - a
            n += 1
    return kept[:n].copy()
