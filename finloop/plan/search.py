"""Beam search through the motion graph for an objective, compiled.

Every candidate begins a way. The search follows all ways at once, leg by leg, from loop end to loop
end, where they go on or jump. After every leg it keeps the best of all branches, as far as the
horizon. The cost of a way is kept term by term (`finloop.edit.schema.TERMS`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.company import ALONE, Company, is_clear_in_search
from finloop.animate.kinematics import wrap
from finloop.animate.memory import (
    NEVER,
    find_last_on_screen,
    index_memory,
    last_on_screen,
    mark_rows,
)
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, kernel_part, leaf_kernel
from finloop.edit.schema import TERMS, VERDICTS
from finloop.plan.advance import advance_way_by_leg, set_way_rotation, turn_way_to_row
from finloop.plan.cost import REPEAT, SEAM, TIME, TO_COME, CostWeights, SearchCosts, repeat_cost
from finloop.plan.graph import MotionGraph, jump_range
from finloop.plan.objectives import (
    Objective,
    cost_of_time,
    estimate_cost_to_come,
    heading_vector,
    timed_targets,
)
from finloop.plan.search_graph import SearchGraph
from finloop.plan.walls import fits_in_tank

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cos", "f8"), ("sin", "f8"), ("along", "f8"),
        ("total", "f8"), ("terms", "f8", (len(TERMS),)),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("run", "i8"), ("shown", "i8"),
        ("leads", "?"),
    ],
    align=True,
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, px along a path, row, rot in degrees, and
the cosine and sine of rot); its cost in ticks (total), and of that each of `TERMS`; the candidate
that it began with (first); its ticks; its last run; marks of the rows that it has shown, from
`mark_rows`; whether it goes on after its leg."""

RUN = np.dtype([("row", "i8"), ("tick", "i8"), ("before", "i8")])
"""A run of film that a way shows: its first row, the tick of that, and the number of the run before
it, −1 for none."""

BRANCH = np.dtype([("first", "i8"), ("way", "i8"), ("jump", "i8"), ("repeat", "f8")])
"""A `Branch`, all fields but its total."""

_TANK, _OVER = map(VERDICTS.index, ("tank", "passed over"))


class SearchStart(NamedTuple):
    """Where and when a candidate would be shown, and what of the fish's past and company counts.

    x, y: px; recent (m, 3): stretches of film that were on screen, (first row, last row, tick of
    the first); company: the other fish; lag: ticks that every tick on the spot costs; along: px
    along its path.
    """

    x: float
    y: float
    tick: int
    recent: Ints
    company: Company = ALONE
    lag: float = 0.0
    along: float = 0.0


class Candidates(NamedTuple):
    """Rows (k,) that could be shown now.

    rots: degrees by which each would be turned; seams: discontinuities in natural steps; jumps:
    whether it is a jump, not the film's own next row; terms (k, t): ticks that showing each costs
    at once, by `TERMS`.
    """

    rows: Ints
    rots: Floats
    seams: Floats
    jumps: Mask
    terms: Floats


class Outcomes(NamedTuple):
    """What becomes of each candidate (k,) in the search.

    value: cost of the best branch from it, in ticks, infinite where all leave the tank or end;
    terms (k, t): that cost term by term; ticks: duration of the best branch, or its time in the
    tank; over: whether better branches displaced all of its own before any reached the end.
    """

    value: Floats
    terms: Floats
    ticks: Floats
    over: Mask

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """Return indices in `VERDICTS` (k,): good, passed over, or out of the tank."""
        lost = np.where(np.isinf(self.value), _TANK, 0)
        return np.where(self.over, _OVER, lost).astype(np.int8)


class Branch(NamedTuple):
    """One continuation of a way of the search after a leg.

    total: cost of the way so far and to come, ticks; first: the candidate that it began with; way:
    number of the way; jump: number of the jump that it takes, −1 for none; repeat: ticks that
    repeating rows costs.
    """

    total: float
    first: int
    way: int
    jump: int
    repeat: float


class Beam(NamedTuple):
    """The ways that the search follows at once, of dtype `WAY`, and the legs that led to them.

    ways, spare (w,): the present ones, and room for those after the next leg; branches (b,): the
    best after it, of dtype `BRANCH`; order (b,): their numbers, the cheapest first; totals (b,):
    their costs in that order; runs: of all ways, of dtype `RUN`; rows, parents (legs + 1, w): the
    row with which each way began each leg, and the number of the way before it.
    """

    ways: NDArray[np.void]
    spare: NDArray[np.void]
    branches: NDArray[np.void]
    order: Ints
    totals: Floats
    runs: NDArray[np.void]
    rows: Ints
    parents: Ints


class BestWay(NamedTuple):
    """The best way of the search so far that reached its end: cost in ticks, legs, its number."""

    value: float
    legs: int
    way: int


@kernel
def film_candidates(film: MotionGraph, row: int, rotation_deg: float) -> Candidates:
    """Return the rows that can be shown next and go on for ever: `row` itself, and its jumps.

    row: the film's next row; rotation_deg: by which it would be turned. The terms of their costs
    are 0 yet.
    """
    next_row = film.rows[row]
    plays_on = np.int64(next_row.has_next and film.rows[row + 1].recurrent)
    first, last = jump_range(film, row)
    n = plays_on + last - first
    shown = Candidates(
        np.empty(n, np.int64), np.empty(n), np.zeros(n), np.empty(n, np.bool_),
        np.zeros((n, len(TERMS))),
    )  # fmt: skip
    for k in range(n):
        jump = first + k - plays_on
        shown.rows[k], shown.jumps[k] = row, k >= plays_on
        if shown.jumps[k]:
            shown.rows[k], shown.seams[k] = film.to[jump], film.seam[jump]
        turned = next_row.heading + rotation_deg - film.rows[shown.rows[k]].heading
        shown.rots[k] = wrap(turned) if film.body else rotation_deg
    return shown


@kernel
def weigh_film_candidates(  # type: ignore[no-untyped-def]
    film: MotionGraph, row: int, rotation_deg: float, recent: Ints, tick: int, weights: CostWeights
):  # fmt: skip
    """Return the film's candidates to show next, with the costs of jumps and of repetition.

    row: the film's next row; rotation_deg: by which it would be turned; recent (m, 3): stretches of
    film that were on screen before `tick`. A candidate counts as repeated if its row, or a row
    within a stride after it, was.
    """
    candidates = film_candidates(film, row, rotation_deg)
    for k in range(candidates.rows.size):
        first = candidates.rows[k]
        ticks_ago = float(tick - last_on_screen(recent, first, first + weights.stride - 1))
        candidates.terms[k, REPEAT] = repeat_cost(ticks_ago, weights)
        if candidates.jumps[k]:
            candidates.terms[k, SEAM] = weights.seam * candidates.seams[k]
    return candidates


@kernel
def beam_search(
    graph: SearchGraph, candidates: Candidates, start: SearchStart, objective: Objective,
    weights: CostWeights, horizon_ticks: int,
) -> tuple[Outcomes, Ints]:  # fmt: skip
    """Return the outcome of every candidate (k,), and the rows of the best way, by beam search.

    Ways, each a sequence of rows, go through the film and its jumps for `horizon_ticks`. The rows
    (l,) are the first of each leg of the best way. Where no way leads on, they are those of the
    cheapest of the ways that came farthest.
    """
    route, most_ticks = objective.route, horizon_ticks
    due_points = timed_targets(route, start.tick, horizon_ticks + objective.steering.reach)
    costs = SearchCosts(weights, due_points, index_memory(start.recent))
    if route.when.size:  # not beyond its times
        most_ticks = max(min(most_ticks, route.begins + route.when.size - 1 - start.tick), 1)
    legs = most_ticks + 1  # each has a tick at least; only legs that begin use memory
    beam, outcomes, way_count = _start_beam(graph, candidates, start, (legs, weights.beam))
    best, leg = BestWay(np.inf, 0, 0), np.int64(0)
    while way_count and leg < legs:
        state = beam, way_count, outcomes, best
        branch_count, best = _follow_ways(graph, state, start, (leg, most_ticks), objective, costs)
        leg += 1
        if branch_count == 0 and best.legs == 0:
            way = np.argmin(beam.ways["total"][:way_count])
            best = BestWay(np.inf, leg - 1, beam.parents[leg - 1, way])  # type: ignore[arg-type]
        beam, way_count = start_next_leg(graph, beam, branch_count, leg, start.tick), branch_count  # type: ignore[arg-type]
    for candidate in range(outcomes.over.size):
        outcomes.over[candidate] = outcomes.over[candidate] and outcomes.value[candidate] == np.inf
    return outcomes, backtrack_rows(beam, best)


@kernel_part
def _start_beam(graph, candidates, start, sizes):  # type: ignore[no-untyped-def]
    """Return the first beam, the outcomes, and the number of ways: one a candidate that fits.

    A candidate fits if its row can play on for ever, inside the tank and clear of other fish.
    candidates: `Candidates`; sizes: most legs, most branches; start: `SearchStart`.
    """
    (most_legs, most_branches), count, way_count = sizes, candidates.rows.size, 0
    room = max(most_branches, count)
    beam = Beam(
        np.empty(room, WAY), np.empty(room, WAY), np.empty(most_branches, BRANCH),
        np.empty(most_branches, np.int64), np.empty(most_branches),
        np.empty((most_legs + 1) * room, RUN), np.empty((most_legs + 1, room), np.int64),
        np.empty((most_legs + 1, room), np.int64),
    )  # fmt: skip
    outcomes = Outcomes(
        np.full(count, np.inf), np.zeros((count, len(TERMS))), np.zeros(count),
        np.zeros(count, np.bool_),
    )  # fmt: skip
    for number in range(count):
        row, x, y, terms = candidates.rows[number], start.x, start.y, candidates.terms[number]
        first = graph.film.rows[row]
        heading = first.heading + candidates.rots[number]
        is_free = fits_in_tank(graph.bounds, row, x, y, heading)
        is_free = is_free and is_clear_in_search(start.company, row, x, y, heading, start.tick)
        if first.recurrent and is_free:
            way, run = beam.ways[way_count], beam.runs[way_count]
            way.x, way.y, way.along, way.first, way.run = x, y, start.along, number, way_count
            way.row, way.ticks, way.shown = row, 0, 0
            set_way_rotation(way, candidates.rots[number])
            for t in range(terms.size):
                way.terms[t] = terms[t]
            run.row, run.tick, run.before = row, start.tick, -1
            beam.rows[0, way_count] = row
            way_count += 1
    return beam, outcomes, way_count


@leaf_kernel
def _follow_ways(graph, state, start, leg_and_horizon, objective, costs):  # type: ignore[no-untyped-def]
    """Follow all ways of the beam for a leg; return the number of branches, and the `BestWay`.

    The beam, its ways and the outcomes are changed in place. state: the beam, its number of ways,
    `Outcomes`, `BestWay` so far; start: `SearchStart`; leg_and_horizon: number of the leg, ticks of
    the horizon; objective: `Objective`; costs: `SearchCosts`.
    """
    (beam, way_count, outcomes, best), (leg, most_ticks) = state, leg_and_horizon
    weights = costs.weights
    rows, branch_count = graph.film.rows, np.int64(0)
    for number in range(way_count):
        way = beam.ways[number]
        way.leads, is_done = advance_way_by_leg(
            graph, way, most_ticks - way.ticks, start, objective, weights
        )
        way.terms[TIME] = cost_of_time(way, start, objective, weights)
        way.terms[TO_COME] = 0.0
        if way.leads and not is_done:
            lead = graph.leads[way.row]
            direction = heading_vector(lead, way)
            way.terms[TO_COME] = estimate_cost_to_come(lead, way, direction, objective, costs)
        way.total = 0.0
        for t in range(way.terms.size):
            way.total += way.terms[t]
        if outcomes.value[way.first] == np.inf:
            outcomes.ticks[way.first] = max(outcomes.ticks[way.first], way.ticks)
        if not way.leads:
            continue
        if is_done or way.ticks >= most_ticks:
            way.leads = False
            if way.total < outcomes.value[way.first]:
                outcomes.value[way.first], outcomes.ticks[way.first] = way.total, way.ticks
                for t in range(way.terms.size):
                    outcomes.terms[way.first, t] = way.terms[t]
            if way.total < best.value:
                best = BestWay(way.total, leg + 1, number)
        elif rows[way.row].has_next and rows[way.row + 1].recurrent:
            repeat = 0.0  # on a path it would cost more than to leave the path
            if not objective.route.x.size:
                repeat = _repetition_cost(beam, way, way.row, start, costs)
            branch = Branch(way.total + repeat, way.first, number, -1, repeat)
            branch_count = insert_branch(beam, branch_count, branch, outcomes.over)
    for number in range(way_count):  # by now most jumps cost more than the best branches
        if beam.ways[number].leads:
            branch_count = _insert_jumps(
                graph, number, (beam, branch_count, outcomes), start, objective, costs
            )
    return branch_count, best


@leaf_kernel
def _insert_jumps(graph, way_number, state, start, objective, costs):  # type: ignore[no-untyped-def]
    """Add the jumps of a way after a leg to the branches, if among the best; return their number.

    way_number: of the way in the beam; state: the beam, its number of branches, `Outcomes`; start:
    `SearchStart`; objective: `Objective`; costs: `SearchCosts`. Candidates whose jumps are not
    among the best are marked in `Outcomes.over`.
    """
    (beam, branch_count, outcomes), film = state, graph.film
    way = beam.ways[way_number]
    first, last = jump_range(film, way.row)
    if first == last:
        return branch_count
    # A jump changes neither the place nor, if the body can be turned, the heading: the cost to come
    # to a goal is the same after all of them.
    same_cost = film.body and not objective.route.x.size
    direction, to_come = (1.0, 0.0), way.terms[TO_COME]
    if film.body and not same_cost:
        direction = heading_vector(graph.leads[way.row], way)
    past_cost, least_to_come = way.total - to_come, to_come if same_cost else 0.0
    for number in range(first, last):
        jump, worst = graph.jumps[number], np.inf
        if branch_count == beam.totals.size:
            worst = beam.totals[branch_count - 1]
        total = past_cost + jump.cost
        if total + least_to_come >= worst:
            outcomes.over[way.first] = True
            break  # those that follow cost as much, or more
        if not same_cost:
            lead = graph.leads[jump.to]
            if not film.body:
                direction = heading_vector(lead, way)
            to_come = estimate_cost_to_come(lead, way, direction, objective, costs)
        total += to_come
        if total >= worst:
            outcomes.over[way.first] = True
            continue
        repeat = _repetition_cost(beam, way, jump.to, start, costs)
        branch = Branch(total + repeat, way.first, way_number, number, repeat)
        branch_count = insert_branch(beam, branch_count, branch, outcomes.over)
    return branch_count


@leaf_kernel
def _repetition_cost(beam, way, row, start, costs):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of a row shown next by a way, if it was on screen not long ago.

    Before the search any row of its first stride counts, within the way the last row of that
    stride. beam: `Beam`; start: `SearchStart`; costs: `SearchCosts`.
    """
    tick, last_row = start.tick + way.ticks, row + costs.weights.stride - 1
    shown_tick = find_last_on_screen(start.recent, costs.memory, row, last_row)
    if way.shown & mark_rows(0, last_row, last_row):
        shown_tick = max(shown_tick, tick_row_shown(beam.runs, way.run, last_row, tick))
    return repeat_cost(float(tick - shown_tick), costs.weights)


@leaf_kernel
def tick_row_shown(runs, last_run, row, tick):  # type: ignore[no-untyped-def]
    """Return the last tick at which a way of the search showed a row; NEVER if it did not.

    runs: runs of film of all ways, dtype `RUN`; last_run: number of the way's last one; tick: the
    tick up to which the way has come.
    """
    while last_run >= 0:
        run = runs[last_run]
        if run.row <= row < run.row + tick - run.tick:
            return run.tick + row - run.row
        last_run, tick = run.before, run.tick
    return np.int64(NEVER)


@leaf_kernel
def insert_branch(beam: Beam, branch_count: int, branch: Branch, displaced: Mask) -> int:
    """Insert a branch if it is among the best; return how many branches there are then.

    beam: its branches are changed, `branch_count` of them filled; the costliest is replaced if
    there is no room. displaced (candidates,): set where a better branch displaces one of a
    candidate.
    """
    totals, order, place, number = beam.totals, beam.order, branch_count, branch_count
    if branch_count == totals.size:
        place = branch_count - 1
        number = order[place]
        if branch.total >= totals[place]:
            displaced[branch.first] = True
            return branch_count
        displaced[beam.branches[number].first] = True
    while place > 0 and branch.total < totals[place - 1]:
        totals[place], order[place] = totals[place - 1], order[place - 1]
        place -= 1
    totals[place], order[place], slot = branch.total, number, beam.branches[number]
    _, slot.first, slot.way, slot.jump, slot.repeat = branch
    return min(branch_count + 1, totals.size)


@kernel_part
def start_next_leg(graph, beam: Beam, branch_count: int, leg: int, start_tick: int) -> Beam:  # type: ignore[no-untyped-def]
    """Make the best branches the ways of the next leg; return the beam, its buffers swapped.

    branch_count: how many there are; leg: number of the leg that they begin; start_tick: at which
    the search began.
    """
    film, first_run = graph.film, leg * beam.ways.size
    for k in range(branch_count):
        branch, way = beam.branches[beam.order[k]], beam.spare[k]
        beam.spare[k] = beam.ways[branch.way]
        if branch.jump >= 0:
            jump, run = graph.jumps[branch.jump], beam.runs[first_run + k]
            if film.body:
                turn_way_to_row(graph, way, jump.to)
            run.row, run.tick, run.before = jump.to, start_tick + way.ticks, way.run
            way.row, way.run = jump.to, first_run + k
            way.terms[SEAM] += jump.cost
        way.terms[REPEAT] += branch.repeat
        beam.rows[leg, k], beam.parents[leg, k] = way.row, branch.way
    return Beam(
        beam.spare, beam.ways, beam.branches, beam.order, beam.totals, beam.runs, beam.rows,
        beam.parents,
    )  # fmt: skip


@kernel_part
def backtrack_rows(beam: Beam, best: BestWay) -> Ints:
    """Return the rows (l,) with which the best way began its legs, in the order of the legs."""
    rows, number = np.empty(best.legs, np.int64), best.way
    for leg in range(best.legs - 1, -1, -1):
        rows[leg] = beam.rows[leg, number]
        number = beam.parents[leg, number]
    return rows
