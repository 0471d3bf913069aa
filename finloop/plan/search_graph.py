"""The motion graph as the search reads it: legs of film, where they lead next, and the walls."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints
from finloop.base.axes import to_body_axes
from finloop.plan.cost import CostWeights
from finloop.plan.graph import MotionGraph, ticks_to_film_end
from finloop.plan.walls import Bounds

JUMP = np.dtype([("cost", "f8"), ("to", "i8")])
"""A jump: ticks that its seam costs; the row that it leads to. Together they are read faster."""
PREVIEW = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
        ("cos", "f8"), ("sin", "f8"),
    ]
)  # fmt: skip
"""Where the film leads from a row in the next ticks, as filmed: dx, dy, px on the screen; ahead,
left, px along and across the row's heading; far, px as the crow flies; the same three in half as
many ticks; cos, sin: of the row's heading."""


class SearchGraph(NamedTuple):
    """The motion graph that is searched, and what keeps a fish inside the tank (bounds).

    jumps (e,): of dtype `JUMP`, those that replace one row together, the cheapest first; run (n,):
    ticks that the film plays on from each row; leg (n,): ticks to the first row with jumps at least
    a stride farther on, or to where the film ends; previews (n,): where the film leads from each
    row, of dtype `PREVIEW`.
    """

    film: MotionGraph
    jumps: NDArray[np.void]
    bounds: Bounds
    run: Ints
    leg: Ints
    previews: NDArray[np.void]


def search_graph(
    film: MotionGraph, bounds: Bounds, weights: CostWeights, preview_ticks: int
) -> SearchGraph:
    """Return the graph for a search through a film: its jumps, legs, and previews.

    bounds: what keeps a fish inside the tank; preview_ticks: how many ticks ahead previews look.
    """
    rows = film.rows
    numbers, run = np.arange(len(rows)), ticks_to_film_end(rows["has_next"])
    # A jump leads on for a stride at least: branches of single ticks would cost least for a leg,
    # and crowd out all others.
    film = film.keep_jumps(run[film.to] >= weights.stride)
    jumps = np.zeros(len(film.to), JUMP)
    jumps["cost"], jumps["to"] = weights.seam * film.seam, film.to
    # The last number, beyond all rows, is for rows without jumps farther on.
    jump_rows = np.append(np.flatnonzero(rows["jump_slot"] >= 0), 2 * len(rows))
    next_jump_rows = jump_rows[np.searchsorted(jump_rows, numbers + weights.stride)]
    leg = np.minimum(run, next_jump_rows - numbers)
    previews, headings = np.zeros(len(rows), PREVIEW), np.radians(rows["heading"])
    previews["ticks"] = np.minimum(run, preview_ticks)
    for prefix, ticks in (("", previews["ticks"]), ("half_", previews["ticks"] // 2)):
        offset = np.column_stack([rows[axis][numbers + ticks] - rows[axis] for axis in "xy"])
        previews[prefix + "ahead"], previews[prefix + "left"] = to_body_axes(offset, headings).T
        previews[prefix + "far"] = np.hypot(*offset.T)
        if not prefix:
            previews["dx"], previews["dy"] = offset.T
    previews["cos"], previews["sin"] = np.cos(headings), np.sin(headings)
    return SearchGraph(film, jumps, bounds, run, leg, previews)
