"""Looking ahead along a path: a beam search whose ways are steered as the fish will be, compiled.

A way costs what each of its ticks costs, beside the path and late, and what its jumps cost. After
every leg the best are kept, by their costs so far and by where the film leads to in the next ticks.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.beam import Branch, begin, ends, go_on, jumps_of, keep_best, leads_on
from finloop.animate.bounds import fits
from finloop.animate.company import clear_ahead
from finloop.animate.decide import Ways, priced
from finloop.animate.film import Film, runs
from finloop.animate.recent import again_cost, last_on_screen
from finloop.animate.route import Route, asked_at, place
from finloop.animate.search import Here, Space, moved
from finloop.animate.state import Waters
from finloop.animate.steering import near, shifted, tick_cost, turn_to
from finloop.base.arrays import Floats, Ints
from finloop.base.axes import ahead_left
from finloop.base.kernel import finite_leaf, kernel, kernel_part, leaf_kernel

LEAD = np.dtype([("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("ticks", "i8")])
"""Where the film leads to from a row in some ticks, as filmed: px on the screen (dx, dy), px ahead
and to the left."""


class Footage(NamedTuple):
    """What a fish swims by. run (n,): ticks that the film goes on from each row; leads (n,): of
    dtype `LEAD`.
    """

    space: Space
    run: Ints
    leads: NDArray[np.void]

    @property
    def film(self) -> Film:
        """Its film."""
        return self.space.film


def reach_of(waters: Waters) -> int:
    """Ticks that a fish which follows a path looks ahead, to steer."""
    return max(2, waters.ticks(waters.settings.path_reach))


def footage_of(space: Space, reach: int) -> Footage:
    """What a fish swims by that looks `reach` ticks ahead."""
    rows = space.film.rows
    here = np.arange(len(rows))
    run = runs(rows["more"])
    leads = np.zeros(len(rows), LEAD)
    leads["ticks"] = np.minimum(run, reach)
    there = here + leads["ticks"]
    leads["dx"], leads["dy"] = (rows[axis][there] - rows[axis] for axis in "xy")
    offset = np.column_stack([leads["dx"], leads["dy"]])
    leads["ahead"], leads["left"] = ahead_left(offset, np.radians(rows["heading"])).T
    return Footage(space, run, leads)


@finite_leaf
def _leg(footage, route, way, most, here, by):  # type: ignore[no-untyped-def]
    """Play forward to the first loop end after a stride, at most `most` ticks, steered.

    here: where all ways began; by: rules, steering. `way` is moved on; its row is −1 where the film
    ends, leaves the tank or meets another fish. Returns the ticks that were played.
    """
    rules, steering = by
    rows = footage.space.film.rows
    angle = np.radians(way.rot)
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, along, row, rot, cost = way.x, way.y, way.along, way.row, way.rot, way.cost
    t, tick = 0, here.tick + way.ticks
    while True:
        at = rows[row]
        if not at.more:
            row = row if at.end >= 0 and t > 0 else -1
            break
        lead = footage.leads[row]
        leads = lead.dx * cos + lead.dy * sin, lead.dy * cos - lead.dx * sin
        turn = turn_to(route, (x, y, along), leads, lead.ticks, steering)
        small = np.radians(turn)
        cos, sin = cos - small * sin, sin + small * cos
        even = 1.5 - 0.5 * (cos * cos + sin * sin)
        cos, sin, rot = cos * even, sin * even, rot + turn
        x, y = x + at.dx * cos + at.dy * sin, y + at.dy * cos - at.dx * sin
        t, tick, row = t + 1, tick + 1, row + 1
        x, y, along, fx, fy, shift = shifted(route, (x, y, along), at.speed, tick, steering)
        heading = rows[row].heading + rot
        free = fits(footage.space.bounds, row, x, y, heading)
        if not (free and clear_ahead(here.company, row, x, y, heading, tick)):
            row = -1
            break
        used = turn / steering.turn, shift / max(steering.shift * at.speed, 1e-9)
        cost += tick_cost(route, (x, y, heading), (along, fx, fy), used, tick, steering)
        if t >= most or (t >= rules.stride and rows[row].end >= 0):
            break
    way.x, way.y, way.along, way.row, way.rot, way.cost = x, y, along, row, rot, cost
    return t


@kernel
def look_along(footage: Footage, ways: Ways, here: Here, along: float, route: Route, by):  # type: ignore[no-untyped-def]
    """Follow every way (k,) along the path through the film and its jumps: a beam search.

    by: `Rules`, `Steering`. Without times, what a way falls behind a brisk fish costs its `pace`.

    Returns
    -------
    terms (k, 3) : what each costs at once, of `decide.priced`; what becomes of it.
    """
    space, rules = footage.space, by[0]
    terms, candidates = priced(space.film, ways, here, rules)
    search, n = begin(space, candidates, here, along, rules.beam)
    while n:
        n = _legs(footage, search, n, here, along, (route, rules, by[1]))
        search = go_on(space, search, n)
    return terms, search.found


@leaf_kernel
def _legs(footage, search, n, here, begun, by):  # type: ignore[no-untyped-def]
    """Follow n ways for a leg: how many branches there are after it.

    begun: px along the path where all ways began; by: route, rules, steering.
    """
    route, rules, steering = by
    m = np.int64(0)  # not 0: for a literal `_branch` is compiled again
    end = np.inf if route.closed else route.step * (route.x.size - 1)
    for s in range(n):
        way = search.ways[s]
        most = max(rules.horizon - way.ticks, 1)
        ticks = _leg(footage, route, way, most, here, (rules, steering))
        if not leads_on(footage.space.film, search.found, way, ticks):
            continue
        behind = 0.0
        if not route.when.size:
            behind = steering.pace * (way.ticks - (way.along - begun) / rules.pace)
        if way.along >= end or way.ticks >= rules.horizon:
            ends(search.found, way, way.cost + behind)
        else:
            m = _branch(footage, way, s, (search.beam, m), here, (behind, route, rules, steering))
    return m


@kernel_part
def _branch(footage, way, s, kept, here, by):  # type: ignore[no-untyped-def]
    """Way s at a loop end: playing on, and every jump, where they are among the best.

    kept: the beam, and how many there were; by: what the way costs beside its `cost`, route, rules,
    steering. Returns how many there are.
    """
    (beam, n), (behind, route, rules, steering) = kept, by
    film, most = footage.space.film, beam.branches.size
    at = film.rows[way.row]
    tick, total = here.tick + way.ticks, way.cost + behind
    if n == most and total >= beam.branches[n - 1].total:
        beam.over[way.first] = True
        return n
    heading = at.heading + way.rot
    angle = np.radians(heading)
    cos, sin = np.cos(angle), np.sin(angle)
    if at.more and film.rows[way.row + 1].endless:
        off = _soon(footage.leads[way.row], way, cos, sin, tick, (route, steering))
        n = keep_best(beam, n, Branch(total + off, way.first, s, -1, 0.0))
    first, last = jumps_of(film, way.row, way.since >= rules.stay)
    for e in range(first, last):
        jump, worst = footage.space.jumps[e], np.inf
        if n == most:
            worst = beam.branches[n - 1].total
        if total + jump.cost >= worst:
            beam.over[way.first] = True
            break  # those that follow cost as much, or more
        if not film.body:
            angle = np.radians(film.rows[jump.to].heading + way.rot)
            cos, sin = np.cos(angle), np.sin(angle)
        off = _soon(footage.leads[jump.to], way, cos, sin, tick, (route, steering))
        if total + jump.cost + off >= worst:
            beam.over[way.first] = True
            continue
        ago = float(tick - last_on_screen(here.recent, jump.to, jump.to))
        cost = jump.cost + again_cost(ago, rules.again, rules.memory)
        n = keep_best(beam, n, Branch(total + cost + off, way.first, s, e, cost))
    return n


@finite_leaf
def _soon(lead, way, cos, sin, tick, by):  # type: ignore[no-untyped-def]
    """About what the next ticks cost, in ticks, if a row is played on from where a way has come to.

    By the place that it leads to, less what can be corrected on the way there. cos, sin: of the
    heading there.
    """
    route, steering = by
    x = way.x + lead.ahead * cos - lead.left * sin
    y = way.y - lead.ahead * sin - lead.left * cos
    far = np.sqrt(lead.ahead * lead.ahead + lead.left * lead.left)
    to = asked_at(route, tick + lead.ticks) if route.when.size else way.along + far
    to_x, to_y = place(route, to)
    off = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2)
    off -= far * np.radians(steering.turn) * lead.ticks / 2
    price = steering.late if route.when.size else steering.across
    return price * lead.ticks * near(max(off, 0.0) ** 2, steering.length_px**2)


@kernel
def onward(footage: Footage, begins: Floats, row: int, rot: float, ticks: int) -> Floats:
    """A way (k, 3) whose last place shows a row, and on by the film: (k + m, 3), m ≤ ticks."""
    k, more = len(begins), min(ticks, footage.run[row])
    way = np.empty((k + more, 3))
    for i in range(k):  # `way[:k] = begins` takes six seconds to compile
        for c in range(3):
            way[i, c] = begins[i, c]
    rows = footage.space.film.rows
    for t in range(1, more + 1):
        dx, dy = moved(rows[row + t].x - rows[row].x, rows[row + t].y - rows[row].y, rot)
        way[k + t - 1, 0], way[k + t - 1, 1] = begins[k - 1, 0] + dx, begins[k - 1, 1] + dy
        way[k + t - 1, 2] = rows[row + t].heading + rot
    return way


@leaf_kernel
def next_stop(footage: Footage, row: int, stride: int, most: int) -> int:
    """Ticks from a row to the first loop end after a stride, or to where the film ends."""
    last = min(footage.run[row], most)
    for t in range(min(stride, last), last + 1):
        if footage.space.film.rows[row + t].end >= 0:
            return t
    return last
