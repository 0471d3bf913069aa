"""Looking ahead along a path: a beam search whose ways are steered as the fish will be, compiled.

All ways are followed at once, in legs of a stride or more, to the next loop end. A stride is one
step: where the film leads in it, turned and shifted as its ticks would be, one by one. After a leg
a way may play on, and take any jump; the best of these branches go on, by what they cost so far and
by where the film leads next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.beam import Branch, Found, jumps_of
from finloop.animate.bounds import fits
from finloop.animate.company import clear_ahead
from finloop.animate.decide import Ways, priced
from finloop.animate.film import Film, runs
from finloop.animate.path_ways import Best, begin_ways, go_on, keep, rows_of, shown_at
from finloop.animate.recent import again_cost, last_on_screen
from finloop.animate.route import Route, asked_at, place
from finloop.animate.search import Here, Space, moved
from finloop.animate.state import Waters
from finloop.animate.steering import most_turn, near, shifted, tick_cost, turn_to
from finloop.base.arrays import Floats, Ints
from finloop.base.axes import ahead_left
from finloop.base.kernel import finite_leaf, kernel, kernel_part, leaf_kernel

LEAD = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
    ]
)  # fmt: skip
"""Where the film leads to from a row in some ticks, as filmed: px on the screen (dx, dy), px ahead
and to the left, px as the crow flies; and in half as many ticks."""


class Footage(NamedTuple):
    """What a fish swims by.

    run (n,): ticks that the film goes on from each row; leg (n,): ticks to the first loop end after
    a stride, or to where the film ends; leads (n,): of dtype `LEAD`.
    """

    space: Space
    run: Ints
    leg: Ints
    leads: NDArray[np.void]

    @property
    def film(self) -> Film:
        """Its film."""
        return self.space.film


def reach_of(waters: Waters) -> int:
    """Ticks that a fish which follows a path looks ahead, to steer."""
    return max(2, waters.ticks(waters.settings.path_reach))


def footage_of(space: Space, reach: int, stride: int) -> Footage:
    """What a fish swims by that looks `reach` ticks ahead, and jumps after a stride at least."""
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
    return Footage(space, run, leg, leads)


@kernel
def look_along(footage: Footage, ways: Ways, here: Here, along: float, route: Route, by):  # type: ignore[no-untyped-def]
    """Follow every way (k,) along the path through the film and its jumps: a beam search.

    by: `Rules`, `Steering`. Without times, what a way falls behind a brisk fish costs `here.slow`.

    Returns
    -------
    terms (k, 3) : what each costs at once, of `decide.priced`; what becomes of it; the rows (l,)
    with which the best way begins its legs, or that which leads farthest.
    """
    rules, steering = by
    terms, candidates = priced(footage.space.film, ways, here, rules)
    count = candidates.rows.size
    found = Found(np.full(count, np.inf), np.zeros(count), np.zeros(count, np.bool_))
    asked = _asked(route, here.tick, rules.horizon + steering.reach)
    most = rules.horizon
    if route.when.size:  # not beyond its times
        most = max(min(most, route.begins + route.when.size - 1 - here.tick), 1)
    # A leg is shorter than a stride where the film ends, and after it comes a jump.
    legs = most // rules.stride + most // rules.stay + 3
    beam, n = begin_ways(footage, candidates, here, along, (legs, rules.beam))
    best, leg = Best(np.inf, 0, 0), np.int64(0)
    while n and leg < legs:
        search, at = (beam, n, found, best), (along, leg, most)
        m, best = _legs(footage, search, here, at, route, (by, asked))
        leg += 1
        if m == 0 and best.legs == 0:  # nobody leads on: the cheapest of those that came so far
            way = np.argmin(beam.ways["cost"][:n])
            best = Best(np.inf, leg - 1, beam.parents[leg - 1, way])  # type: ignore[arg-type]
        beam, n = go_on(footage.space, beam, m, leg, here.tick), m
    for c in range(count):
        found.over[c] = found.over[c] and found.value[c] == np.inf
    return terms, found, rows_of(beam, best)


@kernel_part
def _asked(route, tick, ticks):  # type: ignore[no-untyped-def]
    """Where a path with times asks the fish to be (n, 2) from a tick on; of others, nothing."""
    count = ticks + 1 if route.when.size else 0
    asked = np.empty((count, 2))
    for t in range(count):
        asked[t, 0], asked[t, 1] = place(route, asked_at(route, tick + t))
    return asked


@finite_leaf
def _stride(footage, route, way, ticks, here, by):  # type: ignore[no-untyped-def]
    """Swim so many ticks in one step: whether they can be swum. by: rules, steering.

    `way` is moved on.
    """
    rows, row, steering = footage.space.film.rows, way.row, by[1]
    at, after, lead = rows[row], rows[row + ticks], footage.leads[row]
    angle = np.radians(way.rot)
    cos, sin = np.cos(angle), np.sin(angle)
    leads = lead.dx * cos + lead.dy * sin, lead.dy * cos - lead.dx * sin
    speed, tick = (at.speed + after.speed) / 2, here.tick + way.ticks + ticks
    most = most_turn(speed, steering)
    turn = turn_to(route, (way.x, way.y, way.along), leads, lead.ticks, most, steering)
    dx, dy = moved(after.x - at.x, after.y - at.y, way.rot + turn * ticks / 2)
    begun = way.x + dx, way.y + dy, way.along
    x, y, along, fx, fy, shift = shifted(route, begun, speed, (tick, ticks), steering)
    rot = way.rot + turn * ticks
    heading = after.heading + rot
    if not fits(footage.space.bounds, row + ticks, x, y, heading):
        return False
    if not clear_ahead(here.company, row + ticks, x, y, heading, tick):
        return False
    used = turn / steering.turn, shift / max(steering.shift * speed * ticks, 1e-9)
    cost = tick_cost(route, (x, y, heading), (along, fx, fy), used, tick, steering)
    way.x, way.y, way.along, way.rot, way.cost = x, y, along, rot, way.cost + cost * ticks
    way.row, way.since, way.ticks = row + ticks, way.since + ticks, way.ticks + ticks
    return True


@leaf_kernel
def _leg(footage, route, way, most, here, by):  # type: ignore[no-untyped-def]
    """Swim a leg, so many ticks at most: whether it leads on. by: rules, steering.

    `way` is moved on.
    """
    rows, left = footage.space.film.rows, min(footage.leg[way.row], most)
    if left == 0:
        return False
    while left > 0:
        ticks = min(by[0].stride, left)
        if not _stride(footage, route, way, ticks, here, by):
            return False
        left -= ticks
    return rows[way.row].endless


@leaf_kernel
def _legs(footage, search, here, at, route, by):  # type: ignore[no-untyped-def]
    """Follow all ways for a leg: how many branches there are after it, and the best that ended.

    search: the beam, how many ways, `Found`, `Best`; at: px along the path where all began, number
    of the leg, ticks that are looked at; by: rules and steering, where the fish is asked to be.
    """
    (beam, n, found, best), (begun, leg, most), ((rules, steering), asked) = search, at, by
    end = np.inf if route.closed or route.when.size else route.step * (route.x.size - 1)
    m, rows, soon = np.int64(0), footage.space.film.rows, (asked, steering)
    for s in range(n):
        way = beam.ways[s]
        way.leads = _leg(footage, route, way, most - way.ticks, here, by[0])
        if not way.leads:
            continue
        found.ticks[way.first] = max(found.ticks[way.first], way.ticks)
        way.total = way.cost
        if not route.when.size:
            way.total += here.slow * (way.ticks - (way.along - begun) / rules.pace)
        at, done = rows[way.row], way.along >= end
        total = way.total
        if not done:
            total += _soon(footage.leads[way.row], way, _turned(at, way), route, soon)
        if done or way.ticks >= most:
            way.leads = False
            found.value[way.first] = min(found.value[way.first], total)
            if total < best.value:
                best = Best(total, leg + 1, s)
        elif at.more and rows[way.row + 1].endless:
            m = keep(beam.branches, m, Branch(total, way.first, s, -1, 0.0), found.over)
    for s in range(n):  # by now all but few jumps are dearer than the best
        if beam.ways[s].leads:
            m = _jumps(footage, s, (beam, m, found), here, route, (rules, soon))
    return m, best


@kernel_part
def _jumps(footage, s, kept, here, route, by):  # type: ignore[no-untyped-def]
    """The jumps of way s after a leg that are among the best branches: how many there are then.

    kept: the beam, how many branches there were, `Found`; by: rules; where the fish is asked to be,
    steering.
    """
    (beam, n, found), (rules, soon), film = kept, by, footage.space.film
    way, branches = beam.ways[s], beam.branches
    first, last = jumps_of(film, way.row, way.since >= rules.stay)
    tick, turned = here.tick + way.ticks, _turned(film.rows[way.row], way)
    for e in range(first, last):
        jump, worst = footage.space.jumps[e], np.inf
        if n == branches.size:
            worst = branches[0].total
        total = way.total + jump.cost
        if total >= worst:
            found.over[way.first] = True
            break  # those that follow cost as much, or more
        if not film.body:
            turned = _turned(film.rows[jump.to], way)
        total += _soon(footage.leads[jump.to], way, turned, route, soon)
        if total >= worst:
            found.over[way.first] = True
            continue
        shown = last_on_screen(here.recent, jump.to, jump.to)
        shown = max(shown, shown_at(beam.runs, way.run, jump.to, tick))
        again = again_cost(float(tick - shown), rules.again, rules.memory)
        branch = Branch(total + again, way.first, s, e, jump.cost + again)
        n = keep(branches, n, branch, found.over)
    return n


@finite_leaf
def _turned(at, way):  # type: ignore[no-untyped-def]
    """The cosine and sine of the heading of a way that shows a row."""
    angle = np.radians(at.heading + way.rot)
    return np.cos(angle), np.sin(angle)


@finite_leaf
def _soon(lead, way, turned, route, by):  # type: ignore[no-untyped-def]
    """About what the next ticks cost, in ticks, if a row is played on from where a way has come to.

    By the places that it leads to, less what can be corrected on the way there: by Simpson's rule.
    turned: of the heading there; by: where the fish is asked to be, steering.
    """
    half, steering = lead.ticks // 2, by[1]
    middle = _off(way, (lead.half_ahead, lead.half_left, lead.half_far, half), turned, route, by)
    end = _off(way, (lead.ahead, lead.left, lead.far, lead.ticks), turned, route, by)
    price = steering.late if route.when.size else steering.across
    return price * lead.ticks * (4.0 * middle + end) / 6.0


@finite_leaf
def _off(way, lead, turned, route, by):  # type: ignore[no-untyped-def]
    """How far off the path a lead comes, less what can be corrected, as `near` counts it.

    lead: px ahead, to the left, as the crow flies, and ticks.
    """
    (ahead, left, far, ticks), (cos, sin), (asked, steering) = lead, turned, by
    x, y = way.x + ahead * cos - left * sin, way.y - ahead * sin - left * cos
    if route.when.size:
        to_x, to_y = asked[way.ticks + ticks, 0], asked[way.ticks + ticks, 1]
    else:
        to_x, to_y = place(route, way.along + far)
    off = np.sqrt((x - to_x) ** 2 + (y - to_y) ** 2) - far * np.radians(steering.turn) * ticks / 2
    return near(max(off, 0.0) ** 2, steering.length_px**2)


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
