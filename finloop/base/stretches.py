"""Stretches of rows: samples spread over a long film, and the longest that is repeated."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


def spread_rows(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Choose at most `most` of the given row numbers (n,), evenly spaced and in their order."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int))]


def sample_stretches(
    track_ids: Sequence[int], longest: int, enough_rows: int, seed: int
) -> list[slice]:
    """Draw random stretches of tracks until they have `enough_rows` rows; return ascending slices.

    track_ids (rows,): the track of every row, in order. A track is one stretch; a track of more
    than `longest` rows is cut into several of equal length. All are returned if they have fewer
    than `enough_rows` rows.
    """
    stretches = []
    for start, stop in pairwise(np.flatnonzero(np.diff(track_ids, prepend=-1, append=-1))):
        parts = math.ceil((stop - start) / longest)
        cuts = np.linspace(start, stop, parts + 1).round().astype(int)
        stretches += [slice(int(a), int(b)) for a, b in pairwise(cuts)]
    sample, rows = [], 0
    for number in np.random.default_rng(seed).permutation(len(stretches)):
        if rows >= enough_rows:
            break
        sample.append(stretches[number])
        rows += stretches[number].stop - stretches[number].start
    return sorted(sample, key=lambda stretch: stretch.start)


def longest_repeated_run(numbers: NDArray[np.integer]) -> int:
    """Return the length of the longest run of numbers (n,) that occurs twice without overlap."""
    longest = 0
    for lag in range(1, len(numbers)):
        if len(numbers) - lag <= longest:
            break
        is_repeated = np.concatenate([[False], numbers[lag:] == numbers[:-lag], [False]])
        edges = np.flatnonzero(np.diff(is_repeated))  # where runs begin and end, in turn
        if edges.size:
            run_length = int((edges[1::2] - edges[::2]).max())
            longest = max(longest, min(lag, run_length))  # beyond `lag` both would overlap
    return longest
