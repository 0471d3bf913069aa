"""A beam search through the film, compiled: candidates, ways, branches, what becomes of them.

Every candidate begins a way. A way is followed in legs, from loop end to loop end; after every leg
the best of all branches go on. `search.look` says how a leg is swum, what it costs, and when a way
has come to its end.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.bounds import fits
from finloop.animate.company import clear_ahead
from finloop.animate.film import Film
from finloop.animate.kinematics import wrap
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel_part, leaf_kernel

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"),
    ]
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, row, rot), what it costs in ticks, the
candidate that it began with (first), ticks that it took and that have passed since its last
jump."""


BRANCH = np.dtype([("total", "f8"), ("first", "i8"), ("way", "i8"), ("jump", "i8"), ("cost", "f8")])
"""A `Branch`."""


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


class Branch(NamedTuple):
    """A way that goes on: the candidate that it began with (first), and its number (way).

    total: what it costs, and is expected to cost; jump: number of the jump that it takes, −1 for
    none; cost: of that jump.
    """

    total: float
    first: int
    way: int
    jump: int
    cost: float


class Beam(NamedTuple):
    """The best branches of a leg (beam,), of dtype `BRANCH`, their totals rising.

    over (candidates,): whether a branch of a candidate was given up for better ones.
    """

    branches: NDArray[np.void]
    over: Mask


class Search(NamedTuple):
    """A beam search: the ways that are followed now, the branches after them, what was found.

    spare: room for the ways after these.
    """

    ways: NDArray[np.void]
    spare: NDArray[np.void]
    beam: Beam
    found: Found


@kernel_part
def begin(space, candidates: Candidates, here, width: int):  # type: ignore[no-untyped-def]
    """The search of a beam of so many ways, and how many there are: one a candidate, where it fits.

    space, here: of `search.Space`, `search.Here`.
    """
    film, count = space.film, candidates.rows.size
    found = Found(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.bool_))
    beam = Beam(np.empty(width, BRANCH), found.over)
    most = max(width, count)
    search, n = Search(np.empty(most, WAY), np.empty(most, WAY), beam, found), 0
    x, y = here.x, here.y
    for c in range(count):
        first = film.rows[candidates.rows[c]]
        heading = first.heading + candidates.rots[c]
        row = candidates.rows[c]
        free = fits(space.bounds, row, x, y, heading)
        free = free and clear_ahead(here.company, row, x, y, heading, here.tick)
        if first.endless and free:
            way = search.ways[n]
            way.x, way.y, way.first, way.ticks = x, y, c, 0
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


@leaf_kernel
def keep_best(beam: Beam, n: int, branch: Branch) -> int:
    """Keep a further branch if it is among the best: how many there are then; n: there were."""
    best, most = beam.branches, beam.branches.size
    k = n
    if n == most:
        k = n - 1
        if branch.total >= best[k].total:
            beam.over[branch.first] = True
            return n
        beam.over[best[k].first] = True
    while k > 0 and branch.total < best[k - 1].total:
        best[k] = best[k - 1]
        k -= 1
    at = best[k]
    at.total, at.first, at.way, at.jump, at.cost = branch
    return min(n + 1, most)


@kernel_part
def go_on(space, search: Search, n: int) -> Search:  # type: ignore[no-untyped-def]
    """Follow the best branches of a leg, which are n, from now on. space: of `search.Space`."""
    film, found = space.film, search.found
    for k in range(n):
        branch = search.beam.branches[k]
        way = search.spare[k]
        search.spare[k] = search.ways[branch.way]
        if branch.jump >= 0:
            row = space.jumps[branch.jump].to
            if film.body:
                way.rot = wrap(film.rows[way.row].heading + way.rot - film.rows[row].heading)
            way.row, way.cost, way.since = row, way.cost + branch.cost, 0
    if n == 0:
        for c in range(found.over.size):
            found.over[c] = found.over[c] and found.value[c] == np.inf
    return Search(search.spare, search.ways, search.beam, found)
