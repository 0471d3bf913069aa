"""Looking ahead through the film for an objective: one beam search, compiled.

At loop ends ways are both kept to and left, as far as the horizon. A way costs what its jumps cost
and what is shown, the ticks that it takes or what it falls behind, and what is still to come.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.company import ALONE, Company, clear_ahead
from finloop.animate.kinematics import wrap
from finloop.animate.memory import NEVER, NO_REPEAT, Repeat, last_on_screen
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, kernel_part, leaf_kernel
from finloop.edit.schema import VERDICTS
from finloop.plan.advance import play_leg, swim_leg
from finloop.plan.cost import CostWeights, again_cost, jump_cost, longer_rest, times
from finloop.plan.graph import MotionGraph
from finloop.plan.objectives import (
    Objective,
    at_path_end,
    direction,
    estimate_next_cost,
    estimate_ticks_to_aim,
    timed_targets,
)
from finloop.plan.space import SearchGraph
from finloop.plan.walls import fits


class SearchStart(NamedTuple):
    """Where and when a candidate would be shown, and what of the fish that shows it matters.

    speed: in body lengths/s; since: ticks since its last jump; recent (m, 3): what was on screen,
    as `Fish` keeps it, and the repeat that this is; company: of `Fish`; rest: ticks for which the
    animal rests if the film plays on; slow: ticks that every tick on the spot costs (`Tempo`).
    """

    x: float
    y: float
    tick: int
    speed: float
    since: int
    recent: Ints
    repeat: Repeat = NO_REPEAT
    company: Company = ALONE
    rest: int = 0
    slow: float = 0.0


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


class Outcomes(NamedTuple):
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

    along: px along a path; sizes: legs, branches.
    """
    (legs, width), count, n = sizes, candidates.rows.size, 0
    most = max(width, count)
    beam = Beam(
        np.empty(most, WAY), np.empty(most, WAY), np.empty(width, BRANCH),
        np.empty((legs + 1) * most, RUN), np.empty((legs + 1, most), np.int64),
        np.zeros((legs + 1, most), np.int64),
    )  # fmt: skip
    found = Outcomes(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.bool_))
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
def jumps_of(film: MotionGraph, row: int, may: bool):  # type: ignore[no-untyped-def]
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


@kernel
def search(
    space: SearchGraph, candidates: Candidates, here: SearchStart, along: float,
    objective: Objective, rules: CostWeights,
) -> tuple[Outcomes, Ints]:  # fmt: skip
    """Follow every candidate (k,) through the film and its jumps, for `rules.horizon` ticks.

    along: how far along its path the fish is, px.

    Returns
    -------
    found : what becomes of each candidate; rows (l,) : with which the best way begins its legs.
    Where no way leads on, they are those of the cheapest of the ways that came farthest.
    """
    route = objective.route
    asked = timed_targets(route, here.tick, rules.horizon + objective.steering.reach)
    most = rules.horizon
    if route.when.size:  # not beyond its times
        most = max(min(most, route.begins + route.when.size - 1 - here.tick), 1)
    # A leg is shorter than a stride where the film ends, and after it comes a jump.
    legs = most // rules.stride + most // rules.stay + 3
    beam, found, n = begin(space, candidates, here, along, (legs, rules.beam))
    best, leg = Best(np.inf, 0, 0), np.int64(0)
    while n and leg < legs:
        state, at = (beam, n, found, best), (along, leg, most)
        m, best = _legs(space, state, here, at, objective, (rules, asked))
        leg += 1
        if m == 0 and best.legs == 0:
            way = np.argmin(beam.ways["cost"][:n])
            best = Best(np.inf, leg - 1, beam.parents[leg - 1, way])  # type: ignore[arg-type]
        beam, n = start_next_leg(space, beam, m, leg, here.tick), m  # type: ignore[arg-type]
    for c in range(found.over.size):
        found.over[c] = found.over[c] and found.value[c] == np.inf
    return found, rows_of(beam, best)


@leaf_kernel
def _legs(space, state, here, at, objective, by):  # type: ignore[no-untyped-def]
    """Follow all ways for a leg: how many branches there are after it, and the best that ended.

    state: the beam, how many ways, `Found`, `Best`; at: px along the path where all began, number
    of the leg, ticks that are looked at; by: rules; where the fish is asked to be.
    """
    (beam, n, found, best), (begun, leg, most), (rules, asked) = state, at, by
    route, rows, m = objective.route, space.film.rows, np.int64(0)
    for s in range(n):
        way = beam.ways[s]
        if route.x.size:
            soon = asked, objective.steering
            by_leg = rules, objective.steering
            way.leads = swim_leg(space, route, way, most - way.ticks, here, by_leg)
            ends = way.leads and at_path_end(route, way.along)
            way.total, way.remains = way.cost, 0.0
            if way.leads and not route.when.size:
                way.total += here.slow * (way.ticks - (way.along - begun) / rules.pace)
            if way.leads and not ends:
                turned = direction(rows[way.row], way)
                way.remains = estimate_next_cost(space.leads[way.row], way, turned, route, soon)
        else:
            left = max(most - way.ticks, 1)
            way.leads, ends = play_leg(space, way, left, here, objective.aim, rules)
            way.total, way.remains = way.cost + way.ticks, 0.0
            if way.leads and not ends:
                way.remains = estimate_ticks_to_aim(space, way, objective.aim, rules)
        if found.value[way.first] == np.inf:
            found.ticks[way.first] = max(found.ticks[way.first], way.ticks)
        if not way.leads:
            continue
        total = way.total + way.remains
        if ends or way.ticks >= most:
            way.leads = False
            if total < found.value[way.first]:
                found.value[way.first], found.ticks[way.first] = total, way.ticks
            if total < best.value:
                best = Best(total, leg + 1, s)
        elif rows[way.row].more and rows[way.row + 1].endless:
            m = keep(beam.branches, m, Branch(total, way.first, s, -1, 0.0), found.over)
    for s in range(n):  # by now all but few jumps are dearer than the best
        if beam.ways[s].leads:
            m = _jumps(space, s, (beam, m, found), here, objective, (rules, asked))
    return m, best


@leaf_kernel
def _jumps(space, s, kept, here, objective, by):  # type: ignore[no-untyped-def]
    """The jumps of way s after a leg that are among the best branches: how many there are then.

    kept: the beam, how many branches there were, `Found`; by: rules; where the fish is asked to be.
    """
    (beam, n, found), (rules, asked), film = kept, by, space.film
    route, way, branches = objective.route, beam.ways[s], beam.branches
    first, last = jumps_of(film, way.row, way.since >= rules.stay)
    if first == last:
        return n
    tick, turned = here.tick + way.ticks, direction(film.rows[way.row], way)
    # To a goal as much is to come from any row; along a path less or more, so that is added below.
    remains = 0.0 if route.x.size else way.remains
    for e in range(first, last):
        jump, worst = space.jumps[e], np.inf
        if n == branches.size:
            worst = branches[n - 1].total
        total = way.total + jump.cost + remains
        if total >= worst:
            found.over[way.first] = True
            break  # those that follow cost as much, or more
        shown = last_on_screen(here.recent, jump.to, jump.to)
        if route.x.size:
            if not film.body:
                turned = direction(film.rows[jump.to], way)
            soon = asked, objective.steering
            total += estimate_next_cost(space.leads[jump.to], way, turned, route, soon)
            if total >= worst:
                found.over[way.first] = True
                continue
            shown = max(shown, tick_row_shown(beam.runs, way.run, jump.to, tick))
        again = again_cost(float(tick - shown), rules.again, rules.memory)
        branch = Branch(total + again, way.first, s, e, jump.cost + again)
        n = keep(branches, n, branch, found.over)
    return n


_TANK, _OVER = map(VERDICTS.index, ("tank", "passed over"))


class Ways(NamedTuple):
    """Rows (k,) that could be shown now, by how much each would be turned, and its seam.

    seams: in median steps; jumps: whether it is one, and not the film's own next row.
    """

    rows: Ints
    rots: Floats
    seams: Floats
    jumps: Mask


@kernel
def ways_on(film: MotionGraph, row: int, rot: float, jumps: bool) -> Ways:
    """Rows that can be shown next and need never stop: the next one, and what it jumps to.

    row: the next one, which would be turned by `rot`; jumps: whether the fish may jump.
    """
    at = film.rows[row]
    own = np.int64(at.more and film.rows[row + 1].endless)
    first, last = jumps_of(film, row, jumps)
    n = own + last - first
    ways = Ways(np.empty(n, np.int64), np.empty(n), np.zeros(n), np.empty(n, np.bool_))
    for k in range(n):
        e = first + k - own
        ways.rows[k], ways.jumps[k] = row, k >= own
        if ways.jumps[k]:
            ways.rows[k], ways.seams[k] = film.to[e], film.seam[e]
        turned = at.heading + rot - film.rows[ways.rows[k]].heading
        ways.rots[k] = wrap(turned) if film.body else rot
    return ways


@kernel
def priced(
    film: MotionGraph, ways: Ways, here: SearchStart, rules: CostWeights
) -> tuple[Floats, Candidates]:
    """What showing each way (k,) costs at once.

    Playing on costs the last alone: it, or what follows within the shortest stay, was on screen
    just now.

    Returns
    -------
    terms (k, 3) : its seam, change of speed, repetition or longer rest, in ticks; the ways with
    what they cost.
    """
    n = ways.rows.size
    terms, costs, since = np.zeros((n, 3)), np.empty(n), np.empty(n, np.int64)
    for k in range(n):
        row = ways.rows[k]
        ago = float(here.tick - last_on_screen(here.recent, row, row + rules.stay - 1))
        faster = film.rows[row].speed - here.speed
        seam, jerk, again = jump_cost(ways.seams[k], faster, ago, rules)
        terms[k, 2] = again * times(here.repeat, here.recent, row, rules.stay)
        if ways.jumps[k]:
            terms[k, 0], terms[k, 1] = seam, jerk
            terms[k, 2] += longer_rest(here.rest, film.rows[row].rest)
        costs[k] = terms[k, 0] + terms[k, 1] + terms[k, 2]
        since[k] = 0 if ways.jumps[k] else here.since + 1
    return terms, Candidates(ways.rows, ways.rots, costs, since)


def weigh(
    space: SearchGraph,
    ways: Ways,
    here: SearchStart,
    objective: Objective,
    rules: CostWeights,
    along: float = 0.0,
) -> tuple[Floats, Outcomes, Ints]:
    """Look ahead from ways (k,); along: px along a path.

    Returns
    -------
    terms (k, 3) : what each costs at once, of `priced`; what becomes of it; the rows (l,) with
    which the best way begins its legs.
    """
    terms, candidates = priced(space.film, ways, here, rules)
    return terms, *search(space, candidates, here, along, objective, rules)


def verdicts(found: Outcomes) -> NDArray[np.int8]:
    """Return the number in `VERDICTS` of each way (k,): good, passed over, or out of the tank."""
    lost = np.where(np.isinf(found.value), _TANK, 0)
    return np.where(found.over, _OVER, lost).astype(np.int8)
