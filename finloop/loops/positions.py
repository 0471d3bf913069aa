"""Position table: the direction in which the fish swims between two ends of loops (Fig. 11).

Here y is up, unlike in the film's rows: quadrants count anticlockwise from the upper right.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Reals
from finloop.base.kernel import kernel
from finloop.features.current import through_water
from finloop.loops.graph import JUMP, Leg, LoopGraph

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"

Rows = NDArray[np.integer]


def quadrant(dx: Any, dy: Any) -> NDArray[np.int8]:
    """Return the quadrant (Fig. 11b): 1 upper right, 2 upper left, 3 lower left, 4 lower right.

    y is up. An axis belongs to the quadrant that follows it anticlockwise; no displacement is
    quadrant 1.
    """
    angle = np.degrees(np.arctan2(dy, dx)) % 360
    return (np.floor(angle / 90) % 4 + 1).astype(np.int8)


@kernel
def quadrant_of(dx, dy):  # type: ignore[no-untyped-def]
    """Return the `quadrant` of one displacement, y up, for kernels."""
    if (dx > 0 and dy >= 0) or (dx == 0 and dy == 0):
        return 1
    if dx <= 0 and dy > 0:
        return 2
    if dx < 0:
        return 3
    return 4


@kernel
def next_end(more, end, row, stride):  # type: ignore[no-untyped-def]
    """Return the first loop end at least `stride` rows after a row, or its track's last row.

    more (n,): whether a row is followed by another of its track; end (n,): −1 where there is none.
    """
    stop = row
    while more[stop] and (stop - row < stride or end[stop] < 0):
        stop += 1
    return stop


def displacement(x: Reals, y: Reals, a: Any, b: Any) -> tuple[Reals, Reals]:
    """Return an entry of the position table: from row a to row b, y up (rows have y down)."""
    return x[b] - x[a], y[a] - y[b]


def table_ends(ends: Rows, track_id: Rows) -> NDArray[np.int32]:
    """Return at most 26 ends for a table for people: those of the track with the most ends.

    If it has more, they are those nearest to moments spread evenly over the track.
    """
    tracks, count = np.unique(track_id[ends], return_counts=True)
    mine = ends[track_id[ends] == tracks[count.argmax()]]
    if len(mine) > len(LETTERS):
        moments = np.linspace(mine[0], mine[-1], len(LETTERS))
        mine = mine[np.unique(np.abs(mine[:, None] - moments).argmin(0))]
    return mine.astype(np.int32)


def position_table(ends: Rows, features: pd.DataFrame) -> pd.DataFrame:
    """Return Fig. 11c: a row and a column for each end, A, B …; the later one's quadrant, or "".

    `ends` : rising rows of the feature table. A cell of two tracks is empty.
    """
    x, y = through_water(features).T
    track = features["track_id"].to_numpy()[ends]
    later = (track[:, None] == track) & (ends[:, None] < ends)
    quadrants = quadrant(*displacement(x, y, ends[:, None], ends))
    names = list(LETTERS[: len(ends)])
    return pd.DataFrame(np.where(later, quadrants.astype("U1"), ""), names, names, dtype=object)


def routes_table(
    ways: Sequence[Sequence[Leg]], graph: LoopGraph, features: pd.DataFrame, step: float
) -> pd.DataFrame:
    """Return Fig. 10b: a row for each stretch of each route; ends that play on are not named.

    `jump_distance` is D of a jump, in median natural steps (`step`).
    """
    track, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    columns = ["route", "how", "from_track", "from_frame", "to_track", "to_frame", "frames"]
    rows = [
        (
            number, how, track[a], frame[a], track[b], frame[b], 0 if how == JUMP else b - a,
            _jump_distance(graph, a, b) / step if how == JUMP else None,
        )
        for number, way in enumerate(ways, start=1)
        for a, b, how in merge_legs(way)
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=[*columns, "jump_distance"])


def merge_legs(way: Sequence[Leg]) -> list[Leg]:
    """Merge successive legs of play of a route into one."""
    legs: list[Leg] = []
    for a, b, how in way:
        if legs and how != JUMP and legs[-1][2] == how:
            legs[-1] = legs[-1][0], b, how
        else:
            legs.append((a, b, how))
    return legs


def _jump_distance(graph: LoopGraph, a: int, b: int) -> float:
    end, to = np.searchsorted(graph.ends, [a, b])
    here = slice(graph.start[end], graph.start[end + 1])
    return float(graph.distance[here][graph.to[here] == to][0])


def far_ends(graph: LoopGraph) -> tuple[int, int]:
    """Return the last and the first end of the largest component, by index, to route between."""
    mine = np.flatnonzero(graph.component == 0)
    return int(mine[-1]), int(mine[0])
