"""The motion graph as the search reads it: legs of film, where they lead next, and the walls."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints, Mask
from finloop.base.kernel import kernel
from finloop.plan.cost import CostWeights
from finloop.plan.graph import MotionGraph, jump_range, row_can_play_on, ticks_to_film_end
from finloop.plan.walls import Bounds

JUMP = np.dtype([("cost", "f4"), ("to", "i4")])
"""A jump: ticks that its seam costs; the row that it leads to. Together they are read faster."""
NODE = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("heading", "f8"), ("cos", "f8"), ("sin", "f8"),
        ("rarity_sum", "f8"), ("lag_sum", "f8"), ("speed", "f8"),
        ("leg", "i4"), ("first_jump", "i4"), ("end_jump", "i4"), ("recurrent", "?"),
        ("plays_on", "?"),
    ],
    align=True,
)  # fmt: skip
"""What the search reads of a row, together, as memory is slow: fields of `ROW`; cos, sin: of its
heading; leg: ticks to the first row with jumps after at least a stride, or to where the film ends;
first_jump, end_jump: numbers of the jumps that can replace it, the last one past them; plays_on:
whether the film can play on for ever after showing it."""
PREVIEW = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
    ]
)  # fmt: skip
"""Where the film leads from a row in the next ticks, as filmed: dx, dy, px on the screen; ahead,
left, px along and across the row's heading; far, px as the crow flies; the same three in half as
many ticks."""


class SearchGraph(NamedTuple):
    """The motion graph that is searched, and what keeps a fish inside the tank (bounds).

    jumps (e,): of dtype `JUMP`, those that replace one row together, the cheapest first; run (n,):
    ticks that the film plays on from each row; nodes (n,): what the search reads of each row, of
    dtype `NODE`; previews (n,): where the film leads from each row, of dtype `PREVIEW`.
    """

    film: MotionGraph
    jumps: NDArray[np.void]
    bounds: Bounds
    run: Ints
    nodes: NDArray[np.void]
    previews: NDArray[np.void]


def search_graph(
    film: MotionGraph, bounds: Bounds, weights: CostWeights, preview_ticks: int
) -> SearchGraph:
    """Return the graph for a search through a film: its jumps, legs, and previews.

    A leg is what a branch plays before it may jump again. bounds: what keeps a fish
    inside the tank; preview_ticks: how many ticks ahead previews look.
    """
    run = ticks_to_film_end(film.rows["has_next"])
    # Jumps to where the film ends within a stride are dropped: branches with so short legs cost
    # least after each leg, and would crowd out all others of the beam.
    film = film.keep_jumps_to(run >= weights.stride)
    jumps = np.zeros(len(film.to), JUMP)
    jumps["cost"], jumps["to"] = weights.seam * film.seam, film.to
    nodes = _make_nodes(film, _leg_ticks(film.rows["jump_slot"] >= 0, run, weights.stride))
    previews = _make_previews(film.rows, nodes, np.minimum(run, preview_ticks))
    return SearchGraph(film, jumps, bounds, run, nodes, previews)


def _leg_ticks(is_jump_row: Mask, run: Ints, stride: int) -> Ints:
    """Return the ticks (n,) played from each row to the first jump, or to the end of the film.

    Jumps less than `stride` ticks away do not count. is_jump_row (n,): whether jumps can replace
    the row; run (n,): ticks to where the film ends.
    """
    rows = np.arange(len(run))
    # The last number, beyond all rows, is for rows without jumps farther on.
    jump_rows = np.append(np.flatnonzero(is_jump_row), 2 * len(run))
    next_jump_rows = jump_rows[np.searchsorted(jump_rows, rows + stride)]
    return np.minimum(run, next_jump_rows - rows)


@kernel
def _make_nodes(film: MotionGraph, leg_ticks: Ints) -> NDArray[np.void]:
    """Return a structured array (n,) of dtype `NODE`: what the search reads of each film row.

    leg_ticks (n,): ticks played from each row to the first row with jumps, or to the end of the
    film (`_leg_ticks`).
    """
    nodes = np.empty(len(film.rows), NODE)
    for row in range(len(nodes)):
        node, film_row = nodes[row], film.rows[row]
        heading_rad, node.leg = np.radians(film_row.heading), leg_ticks[row]
        node.x, node.y, node.heading = film_row.x, film_row.y, film_row.heading
        node.cos, node.sin, node.speed = np.cos(heading_rad), np.sin(heading_rad), film_row.speed
        node.rarity_sum, node.lag_sum = film_row.rarity_sum, film_row.lag_sum
        node.recurrent, node.plays_on = film_row.recurrent, row_can_play_on(film.rows, row)
        node.first_jump, node.end_jump = jump_range(film, row)
    return nodes


@kernel
def _make_previews(rows, nodes, ticks):  # type: ignore[no-untyped-def]
    """Return where the film leads from each row (n,) in `ticks` (n,), of dtype `PREVIEW`.

    rows (n,): of dtype `ROW`; nodes (n,): of dtype `NODE`.
    """
    previews = np.empty(len(rows), PREVIEW)
    for row in range(len(rows)):
        here, there, halfway = rows[row], rows[row + ticks[row]], rows[row + ticks[row] // 2]
        cos, sin = nodes[row].cos, nodes[row].sin
        dx, dy = there.x - here.x, there.y - here.y
        half_dx, half_dy = halfway.x - here.x, halfway.y - here.y
        preview = previews[row]
        preview.ticks, preview.dx, preview.dy = ticks[row], dx, dy
        preview.far = np.hypot(dx, dy)
        preview.ahead, preview.left = dx * cos - dy * sin, -dx * sin - dy * cos
        preview.half_ahead = half_dx * cos - half_dy * sin
        preview.half_left = -half_dx * sin - half_dy * cos
        preview.half_far = np.hypot(half_dx, half_dy)
    return previews
