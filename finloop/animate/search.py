"""Looking ahead through the film for an objective: a beam search, compiled (Figs. 10, 11, 17).

At loop ends ways are both kept to and left, as far as the horizon. A way costs what its jumps cost
and what is shown, the ticks that it takes or what it falls behind, and what is still to come.
"""

import numpy as np

from finloop.animate.beam import (
    Best,
    Branch,
    Candidates,
    Found,
    begin,
    jumps_of,
    keep,
    rows_of,
    start_next_leg,
    tick_row_shown,
)
from finloop.animate.objectives import (
    Objective,
    at_path_end,
    direction,
    estimate_next_cost,
    estimate_ticks_to_aim,
    play_leg,
    swim_leg,
    timed_targets,
)
from finloop.animate.recent import again_cost, last_on_screen
from finloop.animate.space import Here, Rules, Space
from finloop.base.arrays import Ints
from finloop.base.kernel import kernel, leaf_kernel


@kernel
def search(
    space: Space, candidates: Candidates, here: Here, along: float, objective: Objective,
    rules: Rules,
) -> tuple[Found, Ints]:  # fmt: skip
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
