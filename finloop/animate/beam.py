"""A beam search through the film, compiled: what every search has in common, wherever it leads.

Every candidate begins a way. A way is followed in legs, from loop end to loop end; after every leg
the best of all branches go on. `search.look` and `follow.look_along` say how a leg is swum, what it
costs, and when a way has come to its end.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import inside
from finloop.animate.film import Film
from finloop.animate.kinematics import wrap
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, kernel_part

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"), ("along", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"),
    ]
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, row, rot; px along the path, if there is
one), what it costs in ticks, the candidate that it began with (first), ticks that it took and that
have passed since its last jump."""


class Candidates(NamedTuple):
    """Rows (k,) that could be shown now.

    rots: by how much each would be turned; costs: ticks that showing it costs; since: ticks since
    the last jump when it is shown.
    """

    rows: Ints
    rots: Floats
    costs: Floats
    since: Ints


class Found(NamedTuple):
    """What becomes of each candidate (k,).

    value: cost of the best way, in ticks, infinite where all leave the tank or end; ticks: that it
    takes, or stays in the tank; over: whether it was given up for better ones.
    """

    value: Floats
    ticks: Floats
    over: Mask


class Beam(NamedTuple):
    """The best branches of a leg, (beam,) each: their totals, rising, and where in `ways` they are.

    A total is what a branch costs, and is expected to cost.
    over (candidates,): whether a branch of a candidate was given up for better ones.
    """

    totals: Floats
    order: Ints
    ways: NDArray[np.void]
    over: Mask


class Search(NamedTuple):
    """A beam search: the ways that are followed now, the branches after them, what was found."""

    ways: NDArray[np.void]
    beam: Beam
    found: Found


@kernel_part
def begin(film: Film, legal: Mask, candidates: Candidates, place, width: int):  # type: ignore[no-untyped-def]
    """The search of a beam of so many ways, and how many there are: one a candidate, where legal.

    place: x, y, along of the candidates.
    """
    count = candidates.rows.size
    found = Found(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.bool_))
    beam = Beam(np.empty(width), np.empty(width, np.int64), np.empty(width, WAY), found.over)
    search, n = Search(np.empty(max(width, count), WAY), beam, found), 0
    x, y, along = place
    for c in range(count):
        if film.rows[candidates.rows[c]].endless and inside(legal, x, y):
            way = search.ways[n]
            way.x, way.y, way.along, way.first, way.ticks = x, y, along, c, 0
            way.row, way.rot = candidates.rows[c], candidates.rots[c]
            way.cost, way.since = candidates.costs[c], candidates.since[c]
            n += 1
    return search, n


@kernel_part
def leads_on(film: Film, found: Found, way, ticks: int) -> bool:  # type: ignore[no-untyped-def]
    """Whether a way leads on after a leg of so many ticks, and need never stop."""
    way.ticks += ticks
    way.since += ticks
    if found.value[way.first] == np.inf:
        found.ticks[way.first] = max(found.ticks[way.first], way.ticks)
    return way.row >= 0 and film.rows[way.row].endless


@kernel_part
def ends(found: Found, way, value: float) -> bool:  # type: ignore[no-untyped-def]
    """A way has come to its end: whether it is the best of its candidate so far."""
    best = value < found.value[way.first]
    if best:
        found.value[way.first], found.ticks[way.first] = value, way.ticks
    return best


@kernel_part
def jumps_of(film: Film, row: int, may: bool):  # type: ignore[no-untyped-def]
    """The first jump from a row, and the one after the last; may: whether the fish may jump."""
    end = film.rows[row].end
    if may and end >= 0:
        return np.int64(film.start[end]), np.int64(film.start[end + 1])
    return np.int64(0), np.int64(0)


@kernel_part
def jump(film: Film, way, number: int, cost: float) -> None:  # type: ignore[no-untyped-def]
    """Take a way over a jump, which costs so many ticks."""
    row = film.to[number]
    if film.body:
        way.rot = wrap(film.rows[way.row].heading + way.rot - film.rows[row].heading)
    way.row, way.cost, way.since = row, way.cost + cost, 0


@kernel
def keep_best(beam, n, total, way):  # type: ignore[no-untyped-def]
    """Keep a further branch of this total if it is among the best.

    n: how many there were. Where in `beam.ways` it is, −1 if it is not; how many there are then.
    """
    slot, k = n, n
    if n == len(beam.order):
        k = n - 1
        if total >= beam.totals[k]:
            beam.over[way.first] = True
            return np.int64(-1), n
        slot = beam.order[k]
        beam.over[beam.ways[slot].first] = True
    while k > 0 and total < beam.totals[k - 1]:
        beam.totals[k], beam.order[k] = beam.totals[k - 1], beam.order[k - 1]
        k -= 1
    beam.totals[k], beam.order[k], beam.ways[slot] = total, slot, way
    return slot, max(n, slot + 1)


@kernel_part
def go_on(search: Search, n: int) -> int:
    """Follow the best branches of a leg, which are n, from now on: how many these are."""
    for s in range(n):
        search.ways[s] = search.beam.ways[search.beam.order[s]]
    if n == 0:
        for c in range(search.found.over.size):
            search.found.over[c] = search.found.over[c] and search.found.value[c] == np.inf
    return n
