"""The ways of a search along a path: those that are followed, and how they came there, compiled.

All ways are followed at once, leg by leg. After every leg the best of their branches go on.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.beam import BRANCH
from finloop.animate.bounds import fits
from finloop.animate.company import clear_ahead
from finloop.animate.kinematics import wrap
from finloop.animate.recent import NEVER
from finloop.base.arrays import Ints
from finloop.base.kernel import kernel_part, leaf_kernel

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"), ("along", "f8"), ("total", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"), ("run", "i8"),
        ("leads", "?"),
    ],
    align=True,
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, px along the path, row, rot); what it
costs in ticks, and with what it has fallen behind (total); the candidate that it began with; ticks
that it took, and since its last jump; its last run; whether it goes on after its leg."""

RUN = np.dtype([("row", "i8"), ("tick", "i8"), ("before", "i8")])
"""A run of film that a way shows: its first row, the tick of that, and the number of the run before
it, −1 for none."""


class Beam(NamedTuple):
    """The ways that are followed, of dtype `WAY`, and how they came there.

    ways, spare (w,): now, and room for those after the next leg; branches (w,): the best after it,
    a heap, the dearest first; runs: of all ways, of dtype `RUN`; rows, parents (legs + 1, w): with
    which row each way began each leg, and the number of the way that it goes on from.
    """

    ways: NDArray[np.void]
    spare: NDArray[np.void]
    branches: NDArray[np.void]
    runs: NDArray[np.void]
    rows: Ints
    parents: Ints


class Best(NamedTuple):
    """The best way so far that has come to its end: its value, legs, and number among the ways."""

    value: float
    legs: int
    way: int


@kernel_part
def begin_ways(footage, candidates, here, along, sizes):  # type: ignore[no-untyped-def]
    """The ways that begin, one a candidate where it fits, and how many. sizes: legs, beam."""
    (legs, width), count, n = sizes, candidates.rows.size, 0
    most = max(width, count)
    beam = Beam(
        np.empty(most, WAY), np.empty(most, WAY), np.empty(width, BRANCH),
        np.empty((legs + 1) * most, RUN), np.empty((legs + 1, most), np.int64),
        np.zeros((legs + 1, most), np.int64),
    )  # fmt: skip
    for c in range(count):
        row, x, y = candidates.rows[c], here.x, here.y
        first = footage.space.film.rows[row]
        heading = first.heading + candidates.rots[c]
        free = fits(footage.space.bounds, row, x, y, heading)
        free = free and clear_ahead(here.company, row, x, y, heading, here.tick)
        if first.endless and free:
            way, run = beam.ways[n], beam.runs[n]
            way.x, way.y, way.along, way.first, way.run = x, y, along, c, n
            way.row, way.rot, way.cost = row, candidates.rots[c], candidates.costs[c]
            way.ticks, way.since = 0, candidates.since[c]
            run.row, run.tick, run.before = row, here.tick, -1
            beam.rows[0, n] = row
            n += 1
    return beam, n


@leaf_kernel
def shown_at(runs, run, row, tick):  # type: ignore[no-untyped-def]
    """The tick at which a way that has come to a tick by its runs has shown a row, if it has."""
    while run >= 0:
        one = runs[run]
        if one.row <= row < one.row + tick - one.tick:
            return one.tick + row - one.row
        run, tick = one.before, one.tick
    return np.int64(NEVER)


@leaf_kernel
def keep(branches, n, branch, over):  # type: ignore[no-untyped-def]
    """Keep a branch if it is among the best, in a heap whose dearest is first: how many there are.

    n: there were.
    """
    k, most = n, branches.size
    if n == most:
        over[branch.first if branch.total >= branches[0].total else branches[0].first] = True
        if branch.total >= branches[0].total:
            return n
        k, child = 0, 1
        while child < n:
            if child + 1 < n and branches[child + 1].total > branches[child].total:
                child += 1
            if branches[child].total <= branch.total:
                break
            branches[k] = branches[child]
            k, child = child, 2 * child + 1
    else:
        n += 1
        while k > 0 and branches[(k - 1) // 2].total < branch.total:
            branches[k] = branches[(k - 1) // 2]
            k = (k - 1) // 2
    at = branches[k]
    at.total, at.first, at.way, at.jump, at.cost = branch
    return n


@kernel_part
def go_on(space, beam, n, leg, tick):  # type: ignore[no-untyped-def]
    """Follow the n best branches of a leg from now on. leg: of the next one; tick: of the first."""
    film, runs = space.film, leg * beam.ways.size
    for k in range(n):
        branch, way = beam.branches[k], beam.spare[k]
        beam.spare[k] = beam.ways[branch.way]
        if branch.jump >= 0:
            row, run = space.jumps[branch.jump].to, beam.runs[runs + k]
            if film.body:
                way.rot = wrap(film.rows[way.row].heading + way.rot - film.rows[row].heading)
            run.row, run.tick, run.before = row, tick + way.ticks, way.run
            way.row, way.cost, way.since, way.run = row, way.cost + branch.cost, 0, runs + k
        beam.rows[leg, k], beam.parents[leg, k] = way.row, branch.way
    return Beam(beam.spare, beam.ways, beam.branches, beam.runs, beam.rows, beam.parents)


@kernel_part
def rows_of(beam, best):  # type: ignore[no-untyped-def]
    """The rows (l,) with which a way begins its legs."""
    rows, way = np.empty(best.legs, np.int64), best.way
    for leg in range(best.legs - 1, -1, -1):
        rows[leg] = beam.rows[leg, way]
        way = beam.parents[leg, way]
    return rows
