"""Position table: the direction in which the fish swims between two ends of loops (Fig. 11).

Here y is up, unlike in the film's rows: quadrants count anticlockwise from the upper right.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.kernel import kernel
from finloop.features.current import places_through_water
from finloop.loops.graph import JUMP, PLAY, Leg, LoopGraph

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"

Rows = NDArray[np.integer]


@kernel
def quadrant_of_displacement(dx: float, dy: float) -> int:
    """Return the quadrant, 1 … 4, into which a displacement points (Fig. 11b).

    1 upper right, 2 upper left, 3 lower left, 4 lower right. dx, dy: in any unit, y up. An axis
    belongs to the quadrant that follows it anticlockwise; no displacement is quadrant 1.
    """
    if (dx > 0 and dy >= 0) or (dx == 0 and dy == 0):
        return 1
    if dx <= 0 and dy > 0:
        return 2
    if dx < 0:
        return 3
    return 4


def choose_table_ends(ends: Rows, track_id: Rows) -> NDArray[np.int32]:
    """Return at most 26 loop ends (feature rows) for a printed table, spread evenly in time.

    All are of the track that has most of them. track_id (n,): of every row.
    """
    tracks, count = np.unique(track_id[ends], return_counts=True)
    track_ends = ends[track_id[ends] == tracks[count.argmax()]]
    if len(track_ends) > len(LETTERS):
        moments = np.linspace(track_ends[0], track_ends[-1], len(LETTERS))
        track_ends = track_ends[np.unique(np.abs(track_ends[:, None] - moments).argmin(0))]
    return track_ends.astype(np.int32)


def position_table(ends: Rows, features: pd.DataFrame) -> pd.DataFrame:
    """Return the position table (Fig. 11c): in which quadrant each loop end lies from another one.

    ends: ascending feature rows at which the film can jump. Rows and columns are named A, B …. A
    cell is the column's quadrant as seen from the row; "" unless the column is later in the same
    track.
    """
    x, y = places_through_water(features)[ends].T
    track = features["track_id"].to_numpy()[ends]
    later = (track[:, None] == track) & (ends[:, None] < ends)
    quadrants = np.vectorize(quadrant_of_displacement, "b")(x - x[:, None], y[:, None] - y)
    names = list(LETTERS[: len(ends)])
    return pd.DataFrame(np.where(later, quadrants.astype("U1"), ""), names, names, dtype=object)


def route_table(
    routes: Sequence[Sequence[Leg]], graph: LoopGraph, features: pd.DataFrame, step_median: float
) -> pd.DataFrame:
    """Return routes as a table (Fig. 10b): a row for each stretch of film and for each jump.

    routes: from `find_routes`; step_median: the median step of the film. `jump_distance` is the
    picture distance D of a jump (Eq. 5) in median steps. Loop ends at which the film plays on have
    no row.
    """
    track, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    columns = ["route", "how", "from_track", "from_frame", "to_track", "to_frame", "frames"]
    rows: list[tuple[Any, ...]] = []
    for number, route in enumerate(routes, start=1):
        for a, b, kind in merge_play_legs(route):
            frames, distance = b - a, None
            if kind == JUMP:
                end, to = np.searchsorted(graph.ends, [a, b])
                jump = graph.start[end] + np.flatnonzero(graph.jump_targets(end) == to)[0]
                frames, distance = 0, float(graph.distance[jump]) / step_median
            rows.append((number, kind, track[a], frame[a], track[b], frame[b], frames, distance))
    return pd.DataFrame(rows, columns=[*columns, "jump_distance"])


def merge_play_legs(route: Sequence[Leg]) -> list[Leg]:
    """Return a route with successive stretches of film joined, so that film and jumps alternate."""
    legs: list[Leg] = []
    for leg in route:
        if legs and leg.kind == legs[-1].kind == PLAY:
            legs[-1] = legs[-1]._replace(to_row=leg.to_row)
        else:
            legs.append(leg)
    return legs
