"""The beam of a search through the film, compiled: ways, their branches, and how they came there.

Every candidate begins a way. All ways are followed at once, leg by leg, from loop end to loop end;
after every leg the best of all branches go on. `search` says how a leg is swum and what it costs.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.bounds import fits
from finloop.animate.company import clear_ahead
from finloop.animate.film import Film
from finloop.animate.kinematics import wrap
from finloop.animate.recent import NEVER
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel_part, leaf_kernel

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"), ("along", "f8"), ("total", "f8"),
        ("remains", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"), ("run", "i8"),
        ("leads", "?"),
    ],
    align=True,
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, px along a path, row, rot); what it costs
in ticks, and with what it takes or has fallen behind (total); about what is still to come if it is
played on (remains); the candidate that it began with (first); ticks that it took, and since its
last jump; its last run; whether it goes on after its leg."""

RUN = np.dtype([("row", "i8"), ("tick", "i8"), ("before", "i8")])
"""A run of film that a way shows: its first row, the tick of that, and the number of the run before
it, −1 for none."""

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
    """The ways that are followed, of dtype `WAY`, and how they came there.

    ways, spare (w,): now, and room for those after the next leg; branches (b,): the best after it,
    of dtype `BRANCH`, their totals rising; runs: of all ways, of dtype `RUN`; rows, parents
    (legs + 1, w): with which row each way began each leg, and the number of the way that it goes on
    from.
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
def begin(space, candidates: Candidates, here, along, sizes):  # type: ignore[no-untyped-def]
    """The beam, what is found so far, and how many ways there are: one a candidate that fits.

    space, here: of `space.Space`, `space.Here`; along: px along a path; sizes: legs, branches.
    """
    (legs, width), count, n = sizes, candidates.rows.size, 0
    most = max(width, count)
    beam = Beam(
        np.empty(most, WAY), np.empty(most, WAY), np.empty(width, BRANCH),
        np.empty((legs + 1) * most, RUN), np.empty((legs + 1, most), np.int64),
        np.zeros((legs + 1, most), np.int64),
    )  # fmt: skip
    found = Found(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.bool_))
    for c in range(count):
        row, x, y = candidates.rows[c], here.x, here.y
        first = space.film.rows[row]
        heading = first.heading + candidates.rots[c]
        free = fits(space.bounds, row, x, y, heading)
        free = free and clear_ahead(here.company, row, x, y, heading, here.tick)
        if first.endless and free:
            way, run = beam.ways[n], beam.runs[n]
            way.x, way.y, way.along, way.first, way.run = x, y, along, c, n
            way.row, way.rot, way.cost = row, candidates.rots[c], candidates.costs[c]
            way.ticks, way.since = 0, candidates.since[c]
            run.row, run.tick, run.before = row, here.tick, -1
            beam.rows[0, n] = row
            n += 1
    return beam, found, n


@leaf_kernel
def tick_row_shown(runs, run, row, tick):  # type: ignore[no-untyped-def]
    """Return the last tick at which a way by these runs showed a row; NEVER if it did not.

    run: the way's last one; tick: to which it has come.
    """
    while run >= 0:
        one = runs[run]
        if one.row <= row < one.row + tick - one.tick:
            return one.tick + row - one.row
        run, tick = one.before, one.tick
    return np.int64(NEVER)


@kernel_part
def jumps_of(film: Film, row: int, may: bool):  # type: ignore[no-untyped-def]
    """The first jump from a row, and the one after the last; may: whether the fish may jump."""
    end = film.rows[row].end
    if may and end >= 0:
        return np.int64(film.start[end]), np.int64(film.start[end + 1])
    return np.int64(0), np.int64(0)


@leaf_kernel
def keep(branches: NDArray[np.void], n: int, branch: Branch, over: Mask) -> int:
    """Insert a branch where it is among the best; return how many there are then.

    branches: changed in place, n of them filled, their totals rising; over (candidates,): whether a
    branch of a candidate was given up for better ones.
    """
    most = branches.size
    k = n
    if n == most:
        k = n - 1
        if branch.total >= branches[k].total:
            over[branch.first] = True
            return n
        over[branches[k].first] = True
    while k > 0 and branch.total < branches[k - 1].total:
        branches[k] = branches[k - 1]
        k -= 1
    at = branches[k]
    at.total, at.first, at.way, at.jump, at.cost = branch
    return min(n + 1, most)


@kernel_part
def start_next_leg(space, beam: Beam, n: int, leg: int, tick: int) -> Beam:  # type: ignore[no-untyped-def]
    """Return the beam in which the n best branches are the ways.

    leg: number of the leg that they begin; tick: at which the search began.
    """
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
def rows_of(beam: Beam, best: Best) -> Ints:
    """The rows (l,) with which a way begins its legs."""
    rows, way = np.empty(best.legs, np.int64), best.way
    for leg in range(best.legs - 1, -1, -1):
        rows[leg] = beam.rows[leg, way]
        way = beam.parents[leg, way]
    return rows
