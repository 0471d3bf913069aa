"""The motion graph as the search reads it: jumps sorted by cost, places ahead, and the walls."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints
from finloop.base.axes import to_body_axes
from finloop.base.kernel import kernel
from finloop.plan.cost import CostWeights
from finloop.plan.graph import MotionGraph, ticks_to_film_end
from finloop.plan.walls import Bounds

JUMP = np.dtype([("cost", "f8"), ("to", "i8")])
"""A jump: ticks that its seam costs; the row that it leads to."""
LEAD = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
        ("cos", "f8"), ("sin", "f8"),
    ]
)  # fmt: skip
"""Where the film leads from a row in some ticks, as filmed: px on the screen (dx, dy), px ahead and
to the left, px as the crow flies; and in half as many ticks; cosine and sine of its heading."""


class SearchGraph(NamedTuple):
    """The motion graph that is searched, and what keeps a fish inside the tank (bounds).

    jumps (e,): of dtype `JUMP`, those that replace one row together, the cheapest first; run (n,):
    ticks that the film plays on from each row; leg (n,): ticks to the first row with jumps at least
    a stride farther on, or to where the film ends; leads (n,): where the film leads from each row,
    of dtype `LEAD`.
    """

    film: MotionGraph
    jumps: NDArray[np.void]
    bounds: Bounds
    run: Ints
    leg: Ints
    leads: NDArray[np.void]


def search_graph(
    film: MotionGraph, bounds: Bounds, weights: CostWeights, lead_ticks: int
) -> SearchGraph:
    """Return the graph for a search through a film: jumps by cost, legs, and places ahead.

    bounds: what keeps a fish inside the tank; lead_ticks: how many ticks ahead the places lie.
    """
    rows = film.rows
    numbers, run = np.arange(len(rows)), ticks_to_film_end(rows["has_next"])
    # A jump leads on for a stride at least: branches of single ticks would cost least for a leg,
    # and crowd out all others.
    film = film.keep_jumps(run[film.to] >= weights.stride)
    jumps = np.zeros(len(film.to), JUMP)
    _sort_jumps(film, weights, jumps)
    # The last number, beyond all rows, is for rows without jumps farther on.
    jump_rows = np.append(np.flatnonzero(rows["jump_slot"] >= 0), 2 * len(rows))
    next_jump_rows = jump_rows[np.searchsorted(jump_rows, numbers + weights.stride)]
    leg = np.minimum(run, next_jump_rows - numbers)
    leads, headings = np.zeros(len(rows), LEAD), np.radians(rows["heading"])
    leads["ticks"] = np.minimum(run, lead_ticks)
    for prefix, ticks in (("", leads["ticks"]), ("half_", leads["ticks"] // 2)):
        offset = np.column_stack([rows[axis][numbers + ticks] - rows[axis] for axis in "xy"])
        leads[prefix + "ahead"], leads[prefix + "left"] = to_body_axes(offset, headings).T
        leads[prefix + "far"] = np.hypot(*offset.T)
        if not prefix:
            leads["dx"], leads["dy"] = offset.T
    leads["cos"], leads["sin"] = np.cos(headings), np.sin(headings)
    return SearchGraph(film, jumps, bounds, run, leg, leads)


@kernel
def _sort_jumps(film, weights, sorted_jumps):  # type: ignore[no-untyped-def]
    """Write the jumps (e,) of a film to `sorted_jumps`, those of each row from the cheapest on.

    Few leave one row, so each is inserted before those that cost more.
    """
    for row in range(len(film.rows)):
        film_row = film.rows[row]
        if film_row.jump_slot < 0:
            continue
        first = film.start[film_row.jump_slot]
        for e in range(first, film.start[film_row.jump_slot + 1]):
            to, place = film.to[e], e
            cost = weights.seam * film.seam[e]
            while place > first and sorted_jumps[place - 1].cost > cost:
                sorted_jumps[place] = sorted_jumps[place - 1]
                place -= 1
            sorted_jumps[place].cost, sorted_jumps[place].to = cost, to
