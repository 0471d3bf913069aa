"""What a search goes through: the graph of the film, and what keeps a fish in the tank."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints
from finloop.base.axes import ahead_left
from finloop.base.kernel import kernel
from finloop.plan.cost import (
    CostWeights,
    jump_cost,
    longer_rest,
)
from finloop.plan.graph import MotionGraph, runs
from finloop.plan.walls import Bounds
from finloop.plan.world import FilmWorld

JUMP = np.dtype([("cost", "f8"), ("to", "i8")])
"""A jump: ticks that it costs, but for what was on screen just now; the row that it leads to."""
LEAD = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
    ]
)  # fmt: skip
"""Where the film leads to from a row in some ticks, as filmed: px on the screen (dx, dy), px ahead
and to the left, px as the crow flies; and in half as many ticks."""


class SearchGraph(NamedTuple):
    """What is searched: the film, and what keeps a fish inside the tank.

    jumps (e,): those of the film, of dtype `JUMP`, at each loop end the cheapest first. Of a film
    that paths are followed through: run (n,): ticks that the film goes on from each row; leg (n,):
    ticks to the first loop end after a stride, or to where the film ends; leads (n,): of dtype
    `LEAD`.
    """

    film: MotionGraph
    jumps: NDArray[np.void]
    bounds: Bounds
    run: Ints
    leg: Ints
    leads: NDArray[np.void]


def search_graph(film: MotionGraph, bounds: Bounds, rules: CostWeights) -> SearchGraph:
    """The space of a search by some rules."""
    jumps = np.zeros(len(film.to), JUMP)
    _cheapest_first(film, rules, jumps)
    none = np.zeros(0, np.int64)
    return SearchGraph(film, jumps, bounds, none, none, np.zeros(0, LEAD))


@kernel
def _cheapest_first(film, rules, jumps):  # type: ignore[no-untyped-def]
    """Write the jumps (e,) of a film, at each loop end in the order of their costs.

    Few are at one end: each is moved forward past those that cost more.
    """
    for row in range(len(film.rows)):
        at = film.rows[row]
        if at.end < 0:
            continue
        first = film.start[at.end]
        for e in range(first, film.start[at.end + 1]):
            to, place = film.to[e], e
            faster = film.rows[to].speed - at.speed
            seam, jerk, _ = jump_cost(film.seam[e], faster, np.inf, rules)
            cost = seam + jerk + longer_rest(at.rest, film.rows[to].rest)
            while place > first and jumps[place - 1].cost > cost:
                jumps[place] = jumps[place - 1]
                place -= 1
            jumps[place].cost, jumps[place].to = cost, to


def reach_of(waters: FilmWorld) -> int:
    """Ticks that a fish which follows a path looks ahead, to steer."""
    return max(2, waters.ticks(waters.settings.path_reach))


def footage_of(space: SearchGraph, reach: int, stride: int) -> SearchGraph:
    """Return the space of a search along paths, `reach` ticks ahead, with jumps after a stride."""
    rows = space.film.rows
    here, run = np.arange(len(rows)), runs(rows["more"])
    ends = np.append(np.flatnonzero(rows["end"] >= 0), 2 * len(rows))
    leg = np.minimum(run, ends[np.searchsorted(ends, here + stride)] - here)
    leads = np.zeros(len(rows), LEAD)
    leads["ticks"] = np.minimum(run, reach)
    for part, ticks in (("", leads["ticks"]), ("half_", leads["ticks"] // 2)):
        offset = np.column_stack([rows[axis][here + ticks] - rows[axis] for axis in "xy"])
        leads[part + "ahead"], leads[part + "left"] = ahead_left(
            offset, np.radians(rows["heading"])
        ).T
        leads[part + "far"] = np.hypot(*offset.T)
        if not part:
            leads["dx"], leads["dy"] = offset.T
    return space._replace(run=run, leg=leg, leads=leads)
