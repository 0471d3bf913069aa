"""Samples of a long film: rows and stretches spread over it."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


def spread(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most `most` of some rows (n,), spread evenly over them."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, most).astype(int))]


def stretches(track_ids: Sequence[int], longest: int, most: int, seed: int) -> list[slice]:
    """A sample of a film: whole tracks, at random, until there are `most` rows.

    track_ids (rows,): of every row, in order. A track longer than `longest` is cut into stretches
    of equal length first, so that all of a long film has a part.
    """
    edges = np.flatnonzero(np.diff(track_ids, prepend=-1, append=-1))
    every = []
    for start, stop in pairwise(edges):
        cuts = np.linspace(start, stop, -(-(stop - start) // longest) + 1).round().astype(int)
        every += [slice(int(a), int(b)) for a, b in pairwise(cuts)]
    sample, rows = [], 0
    for number in np.random.default_rng(seed).permutation(len(every)):
        if rows >= most:
            break
        sample.append(every[number])
        rows += every[number].stop - every[number].start
    return sorted(sample, key=lambda stretch: stretch.start)
