"""Beam search through the motion graph for an objective, compiled.

Every candidate begins a branch, a sequence of film rows. The search extends all branches at once,
leg by leg: from one row with jumps to a later one, where each plays on or jumps. After every leg
it keeps the cheapest extensions, as far as the horizon. The cost of a branch is kept term by term
(`finloop.edit.schema.TERMS`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.kinematics import wrap
from finloop.animate.memory import (
    NEVER,
    MemoryIndex,
    find_last_on_screen,
    index_memory,
    last_on_screen,
    mark_rows,
)
from finloop.animate.obstacles import NO_OBSTACLES, Obstacles, is_clear_in_search
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, kernel_part, leaf_kernel
from finloop.edit.schema import TERMS, VERDICTS
from finloop.plan.advance import advance_branch_by_leg, set_branch_rotation, turn_branch_to_row
from finloop.plan.cost import REPEAT, SEAM, TIME, TO_COME, CostWeights, repeat_cost
from finloop.plan.graph import MotionGraph, jump_range, row_can_play_on
from finloop.plan.objectives import (
    Objective,
    cost_of_time,
    estimate_cost_to_come,
    heading_vector,
    points_due,
)
from finloop.plan.search_graph import SearchGraph
from finloop.plan.walls import fits_in_tank

BRANCH = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rotation_deg", "f8"), ("cos", "f8"), ("sin", "f8"),
        ("along_px", "f8"), ("cost", "f8"), ("terms", "f8", (len(TERMS),)),
        ("row", "i8"), ("candidate", "i8"), ("ticks", "i8"), ("last_run", "i8"), ("marks", "i8"),
        ("leads_on", "?"),
    ],
    align=True,
)  # fmt: skip
"""A branch of the search. At its end: x, y px; row, turned by rotation_deg, of which cos and sin
are the cosine and sine; along_px: px along a path. cost: in ticks, the sum of its `TERMS`;
candidate: number of the candidate it began with; ticks: its duration; last_run: number of its last
run in `Beam.runs`; marks: of the rows it has shown, from `mark_rows`; leads_on: whether it can go
on."""

RUN = np.dtype([("row", "i8"), ("tick", "i8"), ("before", "i8")])
"""A run of film that a branch shows: its first row, the tick at which that is shown, and the number
of the branch's run before it, −1 for none."""

EXTENSION = np.dtype([("candidate", "i8"), ("branch", "i8"), ("jump", "i8"), ("repeat", "f8")])
"""The fields of an `Extension`, without its cost."""

RANKED = np.dtype([("cost", "f8"), ("number", "i8")])
"""The cost of an extension in the beam, and its number there. Both are moved at once in sorting."""

_TANK, _PASSED_OVER = map(VERDICTS.index, ("tank", "passed over"))


class SearchStart(NamedTuple):
    """Where and when a candidate would be shown, what was on screen before, and the other fish.

    x, y: px; recent (m, 3): stretches of film that were on screen, (first row, last row, tick of
    the first); obstacles: the other fish; rest_cost: ticks that every tick on the spot costs;
    along_px: px along the fish's path.
    """

    x: float
    y: float
    tick: int
    recent: Ints
    obstacles: Obstacles = NO_OBSTACLES
    rest_cost: float = 0.0
    along_px: float = 0.0


class Candidates(NamedTuple):
    """Rows (k,) that could be shown next.

    rotations_deg: by which each would be turned; seams: discontinuities in natural steps (median
    steps of the film); jumps: whether it is a jump, not the film's own next row; terms (k, t):
    ticks that showing each costs at once, by `TERMS`.
    """

    rows: Ints
    rotations_deg: Floats
    seams: Floats
    jumps: Mask
    terms: Floats


class Search(NamedTuple):
    """What does not change during one search: graph, start, objective, weights, horizon.

    horizon: ticks that it looks ahead; due_points (t, 2): x, y px due on a route with times, at
    each tick from `start.tick` on; memory: the index of `start.recent`.
    """

    graph: SearchGraph
    start: SearchStart
    objective: Objective
    weights: CostWeights
    horizon: int
    due_points: Floats
    memory: MemoryIndex


class Outcomes(NamedTuple):
    """What the search found for each candidate (k,): cost of the best branch, terms, verdict.

    costs: of the best branch from it, in ticks, infinite where none reaches the end of the search;
    terms (k, t): that cost term by term; ticks: duration of the best branch, else of the longest;
    displaced: whether no branch from it reached the end as cheaper ones took its place in the beam;
    during the search, whether any extension of its branches was left out for cheaper ones.
    verdicts: indices in `VERDICTS`: good, passed over, or out of the tank.
    """

    costs: Floats
    terms: Floats
    ticks: Floats
    displaced: Mask
    verdicts: NDArray[np.int8]


class Extension(NamedTuple):
    """A branch of the search extended by playing on or by a jump, before its next leg.

    cost: so far and to come, ticks; candidate: number of the candidate that the branch began with;
    branch: its number in the beam; jump: number in `SearchGraph.jumps`, −1 for playing on; repeat:
    ticks that showing rows again costs.
    """

    cost: float
    candidate: int
    branch: int
    jump: int
    repeat: float


class Beam(NamedTuple):
    """The branches that the search follows at once, their extensions, and the legs behind them.

    branches (w,): of dtype `BRANCH`; spare (w,): room for those of the next leg; extensions (b,):
    the cheapest so far, of dtype `EXTENSION`; ranking (b,): the cheapest first, of dtype `RANKED`;
    runs: of all branches, of dtype `RUN`; rows, parents (legs + 1, w): the row with which each
    branch began each leg, and the number that the branch had in the leg before.
    """

    branches: NDArray[np.void]
    spare: NDArray[np.void]
    extensions: NDArray[np.void]
    ranking: NDArray[np.void]
    runs: NDArray[np.void]
    rows: Ints
    parents: Ints


class BestBranch(NamedTuple):
    """The cheapest branch that reached the end of the search: cost in ticks, legs, its number.

    legs: how many it has, 0 while there is no such branch; number: in the beam of its last leg.
    """

    cost: float
    legs: int
    number: int


def make_candidates(rows: Ints, rotations_deg: Floats, seams: Floats) -> Candidates:
    """Return the candidates that show these rows (k,), without costs.

    rotations_deg (k,): by which they would be turned; seams (k,): discontinuities, in natural
    steps; a candidate is a jump if it has one.
    """
    return Candidates(rows, rotations_deg, seams, seams > 0, np.zeros((len(rows), len(TERMS))))


@kernel
def film_candidates(film: MotionGraph, row: int, rotation_deg: float) -> Candidates:
    """Return the candidates at a row: itself, if the film can play on from it, and its jumps.

    row: the film's next row; rotation_deg: by which it would be turned. The terms of their costs
    are 0.
    """
    next_row = film.rows[row]
    plays_on = np.int64(row_can_play_on(film.rows, row))
    first_jump, end_jump = jump_range(film, row)
    n = plays_on + end_jump - first_jump
    candidates = Candidates(
        rows=np.empty(n, np.int64), rotations_deg=np.empty(n), seams=np.zeros(n),
        jumps=np.empty(n, np.bool_), terms=np.zeros((n, len(TERMS))),
    )  # fmt: skip
    for k in range(n):
        jump = first_jump + k - plays_on
        candidates.rows[k], candidates.jumps[k] = row, k >= plays_on
        if candidates.jumps[k]:
            candidates.rows[k], candidates.seams[k] = film.to[jump], film.seam[jump]
        turned = next_row.heading + rotation_deg - film.rows[candidates.rows[k]].heading
        candidates.rotations_deg[k] = wrap(turned) if film.jumps_keep_heading else rotation_deg
    return candidates


@kernel
def weigh_film_candidates(  # type: ignore[no-untyped-def]
    film: MotionGraph, row: int, rotation_deg: float, recent: Ints, tick: int, weights: CostWeights
):  # fmt: skip
    """Return the candidates at a row of the film, with the costs of jumps and of repetition.

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
    """Return the outcome of every candidate (k,), and the rows of the best branch, by beam search.

    Branches go through the film and its jumps for `horizon_ticks`, at most to the last time of a
    route. A branch that costs as much as a finished one of its candidate is dropped: what it has to
    come is estimated, so this may lose a cheaper one. The rows (l,) are the first of each leg of
    the best branch. Where no branch leads on, they are those of the cheapest of the branches that
    came farthest. If branches were left out, the search is then repeated with
    `CostWeights.retry_beam`.
    """
    route, most_ticks = objective.route, horizon_ticks
    due_points = points_due(route, start.tick, horizon_ticks + objective.steering.reach + 1)
    if route.when.size:
        most_ticks = max(min(most_ticks, route.begins + route.when.size - 1 - start.tick), 1)
    search = Search(
        graph, start, objective, weights, most_ticks, due_points, index_memory(start.recent)
    )
    beam_width = weights.beam
    while True:
        outcomes, rows = _follow_branches(search, candidates, beam_width)
        leads_on, was_narrow = False, False
        for k in range(outcomes.costs.size):
            leads_on = leads_on or outcomes.costs[k] < np.inf
            was_narrow = was_narrow or outcomes.displaced[k]
        if leads_on or not was_narrow or beam_width >= weights.retry_beam:
            return outcomes, rows
        beam_width = weights.retry_beam


@kernel_part
def _follow_branches(search, candidates, beam_width):  # type: ignore[no-untyped-def]
    """Return the outcome of every candidate (k,), and the rows of the best branch, of one search.

    search: `Search`; candidates: `Candidates`; beam_width: branches followed at once.
    """
    most_legs = search.horizon + 1  # each has a tick at least; only legs that begin use memory
    beam, outcomes, branch_count = _start_beam(search, candidates, beam_width, most_legs)
    best, leg = BestBranch(np.inf, 0, 0), np.int64(0)
    while branch_count and leg < most_legs:
        extension_count, best = _extend_branches(search, beam, branch_count, leg, outcomes, best)
        leg += 1
        if extension_count == 0 and best.legs == 0:  # no branch leads on: the cheapest of the last
            cheapest = np.argmin(beam.branches["cost"][:branch_count])
            best = BestBranch(np.inf, leg - 1, beam.parents[leg - 1, cheapest])
        beam = start_next_leg(search, beam, extension_count, leg)
        branch_count = extension_count
    for k in range(outcomes.displaced.size):  # not if a branch of the candidate reached the end
        outcomes.displaced[k] = outcomes.displaced[k] and outcomes.costs[k] == np.inf
        if outcomes.costs[k] == np.inf:
            outcomes.verdicts[k] = _PASSED_OVER if outcomes.displaced[k] else _TANK
    return outcomes, backtrack_rows(beam, best)


@kernel_part
def _start_beam(search, candidates, most_branches, most_legs):  # type: ignore[no-untyped-def]
    """Begin a branch with each candidate that fits; return the beam, outcomes, and branch count.

    A candidate fits if its row is inside the tank, clear of other fish, and the film can play on
    from it for ever. search: `Search`; candidates: `Candidates`; most_branches: followed at once;
    most_legs: legs for which the beam has memory.
    """
    graph, start = search.graph, search.start
    count, branch_count = candidates.rows.size, 0
    capacity = max(most_branches, count)
    beam = Beam(
        branches=np.empty(capacity, BRANCH), spare=np.empty(capacity, BRANCH),
        extensions=np.empty(most_branches, EXTENSION), ranking=np.empty(most_branches, RANKED),
        runs=np.empty((most_legs + 1) * capacity, RUN),
        rows=np.empty((most_legs + 1, capacity), np.int64),
        parents=np.empty((most_legs + 1, capacity), np.int64),
    )  # fmt: skip
    outcomes = Outcomes(
        costs=np.full(count, np.inf), terms=np.zeros((count, len(TERMS))), ticks=np.zeros(count),
        displaced=np.zeros(count, np.bool_), verdicts=np.zeros(count, np.int8),
    )  # fmt: skip
    # A branch of one run for each candidate that fits.
    for k in range(count):
        row, x, y, terms = candidates.rows[k], start.x, start.y, candidates.terms[k]
        film_row = graph.film.rows[row]
        heading = film_row.heading + candidates.rotations_deg[k]
        is_free = fits_in_tank(graph.bounds, row, x, y, heading)
        is_free = is_free and is_clear_in_search(start.obstacles, row, x, y, heading, start.tick)
        if film_row.recurrent and is_free:
            branch, run = beam.branches[branch_count], beam.runs[branch_count]
            branch.x, branch.y, branch.along_px, branch.row = x, y, start.along_px, row
            branch.candidate, branch.last_run, branch.ticks, branch.marks = k, branch_count, 0, 0
            set_branch_rotation(branch, candidates.rotations_deg[k])
            for t in range(terms.size):
                branch.terms[t] = terms[t]
            run.row, run.tick, run.before = row, start.tick, -1
            beam.rows[0, branch_count] = row
            branch_count += 1
    return beam, outcomes, branch_count


@leaf_kernel
def _extend_branches(search, beam, branch_count, leg, outcomes, best):  # type: ignore[no-untyped-def]
    """Advance all branches by a leg; return the number of their extensions, and the `BestBranch`.

    search: `Search`; beam: `Beam`, of which the first `branch_count` branches count; leg: its
    number; outcomes: `Outcomes`, by candidate; best: the `BestBranch` so far. Beam, branches and
    outcomes are changed in place. A branch that reaches the end of the search is compared with the
    best; any other that can go on leaves its extensions in the beam: playing on, and its jumps.
    """
    graph = search.graph
    extension_count = np.int64(0)
    for number in range(branch_count):
        branch = beam.branches[number]
        candidate = branch.candidate
        branch.leads_on, is_done = advance_branch_by_leg(search, branch)
        branch.terms[TIME] = cost_of_time(search, branch)
        branch.terms[TO_COME] = 0.0
        if branch.leads_on and not is_done:
            direction = heading_vector(graph.nodes[branch.row], branch)
            branch.terms[TO_COME] = estimate_cost_to_come(search, branch, branch.row, direction)
        branch.cost = 0.0
        for t in range(branch.terms.size):
            branch.cost += branch.terms[t]
        # No branch of the candidate has reached the end yet: note how long the longest is.
        if outcomes.costs[candidate] == np.inf:
            outcomes.ticks[candidate] = max(outcomes.ticks[candidate], branch.ticks)
        if not branch.leads_on:
            continue
        if is_done or branch.ticks >= search.horizon:  # at the end of the search
            branch.leads_on = False  # so it is not extended below
            if branch.cost < outcomes.costs[candidate]:
                outcomes.costs[candidate], outcomes.ticks[candidate] = branch.cost, branch.ticks
                for t in range(branch.terms.size):
                    outcomes.terms[candidate, t] = branch.terms[t]
            if branch.cost < best.cost:
                best = BestBranch(branch.cost, leg + 1, number)
        elif branch.cost >= outcomes.costs[candidate]:
            branch.leads_on = False  # a finished branch of its candidate costs less
        elif graph.nodes[branch.row].plays_on:
            repeat = 0.0  # on a path repetition is free: else a fish would rather leave the path
            if not search.objective.route.x.size:
                repeat = _repetition_cost(search, beam, branch, branch.row)
            no_jump = -1
            extension = Extension(branch.cost + repeat, candidate, number, no_jump, repeat)
            extension_count = insert_extension(beam, extension_count, extension, outcomes.displaced)
    for number in range(branch_count):  # by now most jumps cost more than the best extensions
        if beam.branches[number].leads_on:
            extension_count = _insert_jumps(search, beam, extension_count, number, outcomes)
    return extension_count, best


@leaf_kernel
def _insert_jumps(search, beam, extension_count, branch_number, outcomes):  # type: ignore[no-untyped-def]
    """Add a branch's jumps to the beam's extensions; return the new number of extensions.

    Only those that are among the cheapest are added; where one is not, the branch's candidate is
    marked in `Outcomes.displaced`. search: `Search`; extension_count: of the beam, which is changed
    in place; branch_number: in the beam.
    """
    graph, on_path = search.graph, search.objective.route.x.size > 0
    film, branch = graph.film, beam.branches[branch_number]
    node = graph.nodes[branch.row]
    first_jump, end_jump = np.int64(node.first_jump), np.int64(node.end_jump)
    if first_jump == end_jump:
        return extension_count
    # A jump keeps the place. Where it keeps the heading, too, and there is no route, the cost to
    # come does not change: it is known before the jump.
    keeps_to_come = film.jumps_keep_heading and not on_path
    direction, to_come = (1.0, 0.0), branch.terms[TO_COME]
    if film.jumps_keep_heading and not keeps_to_come:
        direction = heading_vector(node, branch)
    past_cost, least_to_come = branch.cost - to_come, to_come if keeps_to_come else 0.0
    for number in range(first_jump, end_jump):
        jump, highest_cost = graph.jumps[number], np.inf
        if extension_count == beam.ranking.size:
            highest_cost = beam.ranking[extension_count - 1].cost
        cost = past_cost + jump.cost
        if cost + least_to_come >= highest_cost:
            outcomes.displaced[branch.candidate] = True
            break  # those that follow cost as much, or more
        if not keeps_to_come:
            if not film.jumps_keep_heading:
                direction = heading_vector(graph.nodes[jump.to], branch)
            to_come = estimate_cost_to_come(search, branch, jump.to, direction)
        cost += to_come
        if cost >= highest_cost:
            outcomes.displaced[branch.candidate] = True
            continue
        repeat = _repetition_cost(search, beam, branch, jump.to)
        extension = Extension(cost + repeat, branch.candidate, branch_number, number, repeat)
        extension_count = insert_extension(beam, extension_count, extension, outcomes.displaced)
    return extension_count


@leaf_kernel
def _repetition_cost(search, beam, branch, row):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of repetition if a branch shows a row next.

    Of what was on screen before the search, any row of the stride from `row` on counts; of what the
    branch itself shows, the last row of that stride. search: `Search`.
    """
    start = search.start
    tick, last_row = start.tick + branch.ticks, row + search.weights.stride - 1
    shown_tick = find_last_on_screen(start.recent, search.memory, row, last_row)
    if branch.marks & mark_rows(0, last_row, last_row):  # perhaps shown: rows share marks
        shown_tick = max(shown_tick, tick_row_shown(beam.runs, branch.last_run, last_row, tick))
    return repeat_cost(float(tick - shown_tick), search.weights)


@leaf_kernel
def tick_row_shown(runs, last_run, row, tick):  # type: ignore[no-untyped-def]
    """Return the last tick at which a branch showed a row; NEVER if it did not.

    runs: of all branches, dtype `RUN`; last_run: number of the branch's last one; tick: one past
    the last tick of the branch.
    """
    while last_run >= 0:
        run = runs[last_run]
        if run.row <= row < run.row + tick - run.tick:
            return run.tick + row - run.row
        last_run, tick = run.before, run.tick
    return np.int64(NEVER)


@leaf_kernel
def insert_extension(beam: Beam, count: int, extension: Extension, displaced: Mask) -> int:
    """Insert an extension if it is among the cheapest; return the new number of extensions.

    The beam's extensions, of which `count` are filled, are changed in place; if all are, the
    costliest is replaced. displaced (k,): set True for the candidate of an extension that is left
    out.
    """
    ranking, place, number = beam.ranking, count, count
    if count == ranking.size:
        place = count - 1
        number = ranking[place].number
        if extension.cost >= ranking[place].cost:
            displaced[extension.candidate] = True
            return count
        displaced[beam.extensions[number].candidate] = True
    # Insertion sort: costlier extensions move one place on.
    while place > 0 and extension.cost < ranking[place - 1].cost:
        ranking[place] = ranking[place - 1]
        place -= 1
    ranking[place].cost, ranking[place].number = extension.cost, number
    kept = beam.extensions[number]
    kept.candidate, kept.branch = extension.candidate, extension.branch
    kept.jump, kept.repeat = extension.jump, extension.repeat
    return min(count + 1, ranking.size)


@kernel_part
def start_next_leg(search: Search, beam: Beam, extension_count: int, leg: int) -> Beam:
    """Turn the extensions into the branches of the next leg; return the beam with these.

    extension_count: how many of the beam's extensions are filled; leg: number of the next leg.
    """
    graph, film, first_run = search.graph, search.graph.film, leg * beam.branches.size
    for k in range(extension_count):
        extension, branch = beam.extensions[beam.ranking[k].number], beam.spare[k]
        beam.spare[k] = beam.branches[extension.branch]
        if extension.jump >= 0:
            jump, run = graph.jumps[extension.jump], beam.runs[first_run + k]
            if film.jumps_keep_heading:
                turn_branch_to_row(graph, branch, jump.to)
            tick = search.start.tick + branch.ticks
            run.row, run.tick, run.before = jump.to, tick, branch.last_run
            branch.row, branch.last_run = jump.to, first_run + k
            branch.terms[SEAM] += jump.cost
        branch.terms[REPEAT] += extension.repeat
        beam.rows[leg, k], beam.parents[leg, k] = branch.row, extension.branch
    return Beam(
        beam.spare, beam.branches, beam.extensions, beam.ranking, beam.runs, beam.rows, beam.parents
    )


@kernel_part
def backtrack_rows(beam: Beam, best: BestBranch) -> Ints:
    """Return the rows (l,) with which the best branch began its legs, in the order of the legs."""
    rows, number = np.empty(best.legs, np.int64), best.number
    for leg in range(best.legs - 1, -1, -1):
        rows[leg] = beam.rows[leg, number]
        number = beam.parents[leg, number]
    return rows
