"""Video loops: pairs of similar frames between which the film can jump (fish paper §4.1).

A loop (a, b) is two rows of the feature table, a < b. It allows two jumps: from row a − 1 to b
instead of a, and from row b − 1 to a instead of b. The cost of a jump is D(a, b), the distance of
the film's next frame from the frame that replaces it.

Glossary: D the distance of Eq. 5; *filtered* D the mean of D along the diagonal, which is small
only if two fish also move alike; *step* the median of D between consecutive frames.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.schema import Column, Schema, columns
from finloop.features.table import delta_of
from finloop.loops.graph import rank_groups
from finloop.loops.settings import LoopsSettings
from finloop.loops.travel import improper


class NoLoops(FinloopError):
    """The film has no loops; the message names the parameter that would give some."""


LOOPS = Schema(
    Column("loop", "int32", "1"),
    *columns("int32", "row", "a", "b"),
    *columns("float32", "1", "distance", "filtered"),
    Column("length_s", "float64", "s", nullable=True),
    Column("group", "int32", "1"),
)

Rows = NDArray[np.integer]


class SparseMap(NamedTuple):
    """The sparse distance map: row i holds columns `j[start[i]:start[i + 1]]`, rising, all > i."""

    start: Ints
    j: NDArray[np.int32]
    distance: NDArray[np.float32]


@dataclass(frozen=True)
class PairCounts:
    """The number of pairs of frames that pass each test; improper: of minima that are no loops."""

    pairs: int
    below_threshold: int
    minima: int
    improper: int


def as_map(table: pd.DataFrame, rows: int) -> SparseMap:
    """Return a table of pairs as a sparse map with `rows` rows (the number of feature rows).

    table: columns i, j (feature rows), distance; sorted by i, then by j.
    """
    start = np.searchsorted(table["i"].to_numpy(), np.arange(rows + 1))
    return SparseMap(start, table["j"].to_numpy(np.int32), table["distance"].to_numpy(np.float32))


def find(
    pairs: SparseMap, features: pd.DataFrame, rate_hz: float, step: float, settings: LoopsSettings
) -> tuple[pd.DataFrame, PairCounts]:
    """Return a film's video loops (§4.1, Figs. 8, 12, 13), best first, and each test's counts.

    pairs: D of the rows that may be compared (Eq. 6); rate_hz: frames per second; step: the median
    natural step, in the unit of D. NoLoops if there is none; its message names the parameter that
    would give some.

    The loops have the columns of `LOOPS` and are sorted by filtered distance.
    """
    loops, counts = candidates(pairs, features, settings.distance_threshold * step, settings)
    loops = loops[~loops["improper"]].reset_index(drop=True)
    if loops.empty:
        raise _none(pairs, features, step, settings)
    loops = loops[keep_best(loops["a"].to_numpy(), loops["b"].to_numpy(), settings.most_per_end)]
    loops = loops.reset_index(drop=True)
    track = features["track_id"].to_numpy()
    a, b = loops["a"].to_numpy(), loops["b"].to_numpy()
    loops["loop"] = np.arange(len(loops))
    loops["length_s"] = np.where(track[a] == track[b], (b - a) / rate_hz, np.nan)
    loops["group"] = groups(a, b, track)
    return loops[LOOPS.names], counts


def least_frames(delta: int, settings: LoopsSettings) -> int:
    """Return the least number of frames between two ends of a loop in one track.

    delta: Δ in frames.
    """
    return max(1, round(settings.min_length_deltas * delta))


def candidates(
    pairs: SparseMap, features: pd.DataFrame, limit: float, settings: LoopsSettings
) -> tuple[pd.DataFrame, PairCounts]:
    """Return all local minima of filtered D up to `limit`, the best first, and each test's counts.

    Columns: a, b (feature rows, a < b), distance, filtered, improper (Fig. 13: whether the pair is
    no loop).
    """
    track = features["track_id"].to_numpy(np.int32)
    value = filter_diagonals(pairs, track, settings.compared_neighbour_frames, limit)
    delta = delta_of(features)
    radius, least = max(1, round(settings.apart * delta)), least_frames(delta, settings)
    at, a = minima(pairs, value, track, radius, least)
    b = pairs.j[at]
    bad = improper(a, b, features, settings.improper_angle_deg)
    table = pd.DataFrame(
        {"a": a, "b": b, "distance": pairs.distance[at], "filtered": value[at], "improper": bad}
    )
    counts = PairCounts(len(pairs.j), int(np.isfinite(value).sum()), len(at), int(bad.sum()))
    return table.sort_values(["filtered", "a", "b"], ignore_index=True), counts


def weights(n: int) -> Floats:
    """Return the binomial weights (2n + 1,) of the pairs along a diagonal; their sum is 1."""
    return scipy.special.comb(2 * n, np.arange(2 * n + 1)) / 4.0**n


def filter_diagonals(
    pairs: SparseMap, track: NDArray[np.int32], dynamics: int, limit: float
) -> NDArray[np.float32]:
    """Return the filtered D of every stored pair: Σ w_k D(a+k, b+k), k = −n … n (§4.1).

    track: track number of every feature row; dynamics: n. The value is inf where it exceeds
    `limit`, where one of the pairs along the diagonal is not in the map, or where one lies beyond
    the end of either track.
    """
    return _filter_diagonals(pairs, track, weights(dynamics), limit)


@kernel
def _column(j: NDArray[np.int32], low: int, high: int, least: int) -> int:
    """Return the first place in j[low:high], rising, that holds `least` or more."""
    while low < high:
        middle = (low + high) // 2
        if j[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def _filter_diagonals(
    pairs: SparseMap, track: NDArray[np.int32], weight: Floats, limit: float
) -> NDArray[np.float32]:
    start, j, distance = pairs
    n, rows = len(weight) // 2, len(track)
    value = np.full(len(j), np.inf, np.float32)
    for a in range(n, rows - n):
        if track[a - n] != track[a] or track[a + n] != track[a]:
            continue
        for p in range(start[a], start[a + 1]):
            b = j[p]
            if b + n >= rows or track[b - n] != track[b] or track[b + n] != track[b]:
                continue
            total = weight[n] * distance[p]
            for k in range(-n, n + 1):
                if k == 0 or total > limit:
                    continue
                end = start[a + k + 1]
                q = _column(j, start[a + k], end, b + k)
                if q == end or j[q] != b + k:
                    total = np.inf
                else:
                    total += weight[k + n] * distance[q]
            if total <= limit:
                value[p] = total
    return value


def minima(
    pairs: SparseMap, value: NDArray[np.float32], track: NDArray[np.int32], radius: int, least: int
) -> tuple[Ints, NDArray[np.int32]]:
    """Return the places (k,) in `pairs.j`, and the rows a (k,), of the local minima of `value`.

    value: filtered D of every pair. Each is the smallest within `radius` frames along a and along
    b, inside the two tracks; the first of equal ones that are as near (a film that repeats). In one
    track b is at least `least` frames after a; nearer pairs are no loops, but they count in the
    comparison: a pair on a slope down to them is no minimum.
    """
    places = np.flatnonzero(_minima(pairs, value, track, radius, least))
    rows = np.searchsorted(pairs.start, places, side="right") - 1
    return places, rows.astype(np.int32)


@kernel
def _minima(pairs, value, track, radius, least):  # type: ignore[no-untyped-def]
    """Return whether each pair is such a minimum."""
    start, j = pairs.start, pairs.j
    minimum = np.zeros(len(j), np.bool_)
    for a in range(len(track)):
        for p in range(start[a], start[a + 1]):
            b = j[p]
            if np.isinf(value[p]) or (track[a] == track[b] and b - a < least):
                continue
            smallest = True
            for row in range(max(0, a - radius), min(len(track), a + radius + 1)):
                if track[row] != track[a]:
                    continue
                for q in range(_column(j, start[row], start[row + 1], b - radius), start[row + 1]):
                    if j[q] > b + radius:
                        break
                    less = value[q] < value[p] or (value[q] == value[p] and minimum[q])
                    if less and track[j[q]] == track[b]:
                        smallest = False
                        break
                if not smallest:
                    break
            minimum[p] = smallest
    return minimum


def keep_best(a: Rows, b: Rows, most: int) -> Mask:
    """Return which loops (n,) to keep so that no frame is an end of more than `most` loops.

    a, b (n,): the loops' ends (feature rows), the best loop first.
    """
    return _keep_best(a, b, np.zeros(b.max() + 1, np.int32), most)


@kernel
def _keep_best(a, b, count, most):  # type: ignore[no-untyped-def]
    keep = np.zeros(len(a), np.bool_)
    for p in range(len(a)):
        if count[a[p]] < most and count[b[p]] < most:
            keep[p] = True
            count[a[p]] += 1
            count[b[p]] += 1
    return keep


def groups(a: Rows, b: Rows, track: Rows) -> NDArray[np.int32]:
    """Return the number (n,) of each loop's overlapping group (Fig. 12); 0 has the most loops.

    a, b (n,): the loops' ends, feature rows; track: track number of every feature row. A loop
    within a track covers the film between its ends; one across tracks only its two ends. Loops that
    cover the same film are of one group, and so on from loop to loop.
    """
    n = len(a)
    within = track[a] == track[b]
    low = np.r_[a, b]
    high = np.r_[np.where(within, b, a), b]
    order = np.lexsort((-high, low))
    reach = np.maximum.accumulate(high[order])
    parts = np.r_[0, np.cumsum(low[order][1:] > reach[:-1])]
    part = np.empty(2 * n, np.int64)
    part[order] = parts
    size = int(parts[-1]) + 1
    overlaps = coo_array((np.ones(n, np.int8), (part[:n], part[n:])), (size, size))
    _, name = connected_components(overlaps, directed=False)
    return rank_groups(name[part[:n]])


def _none(
    pairs: SparseMap, features: pd.DataFrame, step: float, settings: LoopsSettings
) -> NoLoops:
    goal = "at least one pair of similar frames between which the film can jump"
    track = features["track_id"].to_numpy()
    longest = int(np.unique(track, return_counts=True)[1].max())
    least = least_frames(delta_of(features), settings)
    if len(np.unique(track)) == 1 and longest <= least:
        return NoLoops(
            f"one track of {longest} frames, and the ends of a loop are at least {least} apart "
            f"(loops.min_length_deltas {settings.min_length_deltas:g} Δ)",
            goal,
            "take a longer clip, or a smaller loops.min_length_deltas",
        )
    if len(pairs.j) == 0:
        return NoLoops(
            "no video loops: the distance map holds no pair of frames at all",
            goal,
            "let more be compared: a greater distance.max_distance_steps or "
            "distance.motion_area_threshold, or distance.frame_of_reference=body; or take a longer "
            "clip",
        )
    any_far, _ = candidates(pairs, features, np.inf, settings)
    any_far = any_far[~any_far["improper"]]
    if len(any_far):
        enough = np.ceil(100 * any_far["filtered"].iloc[0] / step) / 100
        return NoLoops(
            f"no video loops with loops.distance_threshold {settings.distance_threshold:g} "
            "(median natural steps)",
            goal,
            f"loops.distance_threshold={enough:g} would have given the first; natural steps are 1",
        )
    return NoLoops(
        f"no video loops at any threshold: of {len(pairs.j)} pairs of similar frames none passes "
        f"loops.min_length_deltas {settings.min_length_deltas:g}, "
        f"loops.compared_neighbour_frames {settings.compared_neighbour_frames}, "
        f"loops.improper_angle_deg {settings.improper_angle_deg:g}",
        goal,
        "a smaller loops.min_length_deltas, loops.compared_neighbour_frames=0, "
        "loops.improper_angle_deg=180, a greater distance.max_distance_steps; or take a "
        "longer clip",
    )
