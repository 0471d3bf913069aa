"""Looking ahead through the film: a beam search over its loops, compiled (Figs. 10, 11, 17)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import inside
from finloop.animate.film import Film
from finloop.animate.kinematics import Spot, bearing, touches, wrap
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import for_kernels, kernel

NEVER = -(10**9)
"""The tick at which a row was last on screen that never was."""

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"), ("total", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"),
    ]
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, row, rot), what its jumps cost, and with
time swum and left (total, both in ticks), the candidate that it began with (first), ticks that it
took and that have passed since its last jump."""


class Candidates(NamedTuple):
    """Rows (k,) that could be shown now.

    rots: by how much each would be turned; costs: ticks that showing it costs; since: ticks since
    the last jump when it is shown.
    """

    rows: Ints
    rots: Floats
    costs: Floats
    since: Ints


class Here(NamedTuple):
    """Where and when a candidate would be shown; last (n,): tick at which each row last was."""

    x: float
    y: float
    tick: int
    last: Ints


class Rules(NamedTuple):
    """How ways are followed and compared, times in ticks.

    pace [px/tick], turning [°/tick]: of a brisk fish; horizon: ways are followed so far; stride:
    loop ends sooner than this are passed by; stay: least time between two jumps; beam: ways
    followed at once; seam, jerk, again: ticks that a jump costs for a seam of one median step, for
    a change of speed by one body length/s, for a row just seen; memory: until a row is forgotten.
    """

    pace: float
    turning: float
    horizon: int
    stride: int
    stay: int
    beam: int
    seam: float
    jerk: float
    again: float
    memory: float


@kernel
def moved(dx: float, dy: float, rot: float):  # type: ignore[no-untyped-def]
    """A displacement on the screen (y down), turned anticlockwise as seen."""
    angle = np.radians(rot)
    cos, sin = np.cos(angle), np.sin(angle)
    return dx * cos + dy * sin, dy * cos - dx * sin


@kernel
def leg(rows, legal, way, aim, most, stride):  # type: ignore[no-untyped-def]
    """Play forward to the first loop end after `stride` ticks, at most `most` ticks.

    Returns where that is: x, y, row, −1 where the film ends or leaves the tank; the ticks that were
    played; whether the last one touches the aim.
    """
    x, y, row = way.x, way.y, way.row
    cos, sin = np.cos(np.radians(way.rot)), np.sin(np.radians(way.rot))
    for t in range(1, most + 1):
        at = rows[row]
        if not at.more:
            # The last picture of a track may still be exchanged for another.
            return x, y, (row if at.end >= 0 and t > 1 else -1), t - 1, False
        x, y = x + at.dx * cos + at.dy * sin, y + at.dy * cos - at.dx * sin
        row += 1
        at = rows[row]
        if not inside(legal, x, y):
            return x, y, -1, t, False
        # A fish that has reached its goal must be able to swim on.
        goes_on = at.more and rows[row + 1].endless
        if goes_on and not aim.free and touches(x, y, at.heading + way.rot, aim):
            return x, y, row, t, True
        if t >= stride and at.end >= 0:
            return x, y, row, t, False
    return x, y, row, most, False


@kernel
def remaining(x: float, y: float, heading: float, aim: Spot, rules: Rules):  # type: ignore[no-untyped-def]
    """About how many ticks it is to a point: way / pace + turn / turning; 0 for who wanders."""
    if aim.free:
        return 0.0
    far = np.hypot(aim.x - x, aim.y - y)
    error = abs(wrap(bearing(x, y, aim.x, aim.y) - heading))
    return far / rules.pace + error / rules.turning


@for_kernels
def again_cost(ago, again, memory):  # type: ignore[no-untyped-def]
    """Ticks that it costs to show what was on screen `ago` ticks before, numbers or an array.

    again: ticks that it costs at once; it costs less and less till `memory` ticks are over.
    """
    return again * np.maximum(0.0, 1.0 - ago / memory)


@for_kernels
def jump_cost(seam, faster, ago, rules):  # type: ignore[no-untyped-def]
    """Ticks that jumps cost: for the seam, the change of speed, for what was on screen just now.

    Numbers or arrays. seam in median steps, faster in body lengths/s; the row that is jumped to was
    on screen `ago` ticks before.
    """
    again = again_cost(ago, rules.again, rules.memory)
    return rules.seam * seam, rules.jerk * np.abs(faster), again


class Found(NamedTuple):
    """What becomes of each candidate (k,).

    value: cost of the best way, in ticks, infinite where all leave the tank or end; far: px to the
    aim after it, 0 if it is touched; error: of the heading there, degrees; ticks: that it takes, or
    stays in the tank; over: whether it was given up for better ones.
    """

    value: Floats
    far: Floats
    error: Floats
    ticks: Floats
    over: Mask


@kernel
def look(
    film: Film, legal: Mask, candidates: Candidates, here: Here, aim: Spot,
    rules: Rules,
) -> Found:  # fmt: skip
    """Follow every candidate through the film and its loops: a beam search.

    At loop ends ways are both kept to and left, as far as the horizon. A way costs its ticks, what
    its jumps cost, and what remains to the aim. After every leg the best `rules.beam` ways go on.
    """
    count = candidates.rows.size
    found = Found(
        np.full(count, np.inf), np.full(count, np.inf), np.full(count, 180.0), np.zeros(count),
        np.zeros(count, np.bool_),
    )  # fmt: skip
    room = rules.beam * 16 + count
    ways, branches = np.empty(room, WAY), np.empty(room, WAY)
    order = np.empty(rules.beam, np.int64)
    n = 0
    for c in range(count):
        if film.rows[candidates.rows[c]].endless and inside(legal, here.x, here.y):
            way = ways[n]
            way.x, way.y, way.first, way.ticks, way.total = here.x, here.y, c, 0, 0.0
            way.row, way.rot = candidates.rows[c], candidates.rots[c]
            way.cost, way.since = candidates.costs[c], candidates.since[c]
            n += 1
    while n:
        m = np.int64(0)  # not 0: for a literal `_branch` is compiled again
        for s in range(n):
            way = ways[s]
            most = max(rules.horizon - way.ticks, 1)
            way.x, way.y, way.row, ticks, touched = leg(
                film.rows, legal, way, aim, most, rules.stride
            )
            way.ticks += ticks
            way.since += ticks
            if found.value[way.first] == np.inf:
                found.ticks[way.first] = max(found.ticks[way.first], way.ticks)
            if way.row < 0 or not film.rows[way.row].endless:
                continue
            if touched or way.ticks >= rules.horizon:
                _finish(film, way, touched, found, aim, rules)
            else:
                m = _branch(film, way, branches, m, here, (aim, rules))
        n = _best(branches[:m], order, found.over)
        for s in range(n):
            ways[s] = branches[order[s]]
    for c in range(count):
        found.over[c] = found.over[c] and found.value[c] == np.inf
    return found


@kernel
def _finish(film, way, touched, found, aim, rules):  # type: ignore[no-untyped-def]
    """A way has come to the aim or to the horizon: keep it where it is its candidate's best."""
    heading = film.rows[way.row].heading + way.rot
    rest = 0.0 if touched else remaining(way.x, way.y, heading, aim, rules)
    first, value = way.first, way.ticks + way.cost + rest
    if value < found.value[first]:
        found.value[first], found.ticks[first] = value, way.ticks
        found.far[first], found.error[first] = 0.0, 0.0
        if not touched:
            off = bearing(way.x, way.y, aim.x, aim.y) - film.rows[way.row].heading - way.rot
            found.far[first] = np.hypot(aim.x - way.x, aim.y - way.y)
            found.error[first] = abs(wrap(off))


@kernel
def _branch(film, way, branches, m, here, towards):  # type: ignore[no-untyped-def]
    """At a loop end: append playing on, and every jump, to the m branches; how many there are."""
    aim, rules = towards
    at = film.rows[way.row]
    heading = at.heading + way.rot
    total = way.ticks + remaining(way.x, way.y, heading, aim, rules)
    if at.more and film.rows[way.row + 1].endless and m < branches.size:
        branches[m] = way
        branches[m].total = total + way.cost
        m += 1
    k = at.end
    if way.since < rules.stay or k < 0:
        return m
    for e in range(film.start[k], film.start[k + 1]):
        other = film.to[e]
        if m == branches.size:
            break
        if not (film.rows[other].more and film.rows[other + 1].endless):
            continue
        faster = film.rows[other].speed - at.speed
        ago = here.tick + way.ticks - here.last[other]
        seam, jerk, again = jump_cost(film.seam[e], faster, ago, rules)
        branch = branches[m]
        branch.x, branch.y, branch.row, branch.first = way.x, way.y, other, way.first
        branch.rot = wrap(heading - film.rows[other].heading) if film.body else way.rot
        branch.cost = way.cost + (seam + jerk + again)
        branch.total = total + branch.cost
        branch.ticks, branch.since = way.ticks, 0
        m += 1
    return m


@kernel
def _best(branches, order, over):  # type: ignore[no-untyped-def]
    """The numbers of the best branches, best first, into `order`; how many. The rest are over."""
    n = 0
    for m in range(len(branches)):
        total = branches[m].total
        if n < len(order):
            n += 1
        else:
            worse = m if total >= branches[order[n - 1]].total else order[n - 1]
            over[branches[worse].first] = True
            if worse == m:
                continue
        k = n - 1
        while k > 0 and total < branches[order[k - 1]].total:
            order[k] = order[k - 1]
            k -= 1
        order[k] = m
    return n


@kernel
def last_on_screen(recent: Ints, n: int) -> Ints:
    """The tick at which each row (n,) was last on screen; `recent` as `Fish` keeps it."""
    last = np.full(n, NEVER)
    for k in range(len(recent)):
        first, end, tick = recent[k]
        for row in range(first, end + 1):
            last[row] = tick + row - first
    return last


@kernel
def swim(film: Film, way: NDArray[np.void], goal: Spot, aim: Spot, rules: Rules):  # type: ignore[no-untyped-def]
    """Play from `way` (one row of dtype WAY) to the next loop end after a stride, or to a touch.

    Returns
    -------
    way (n, 3) : x, y, heading of each row that is shown; whether the last one touches the goal.
    """
    x, y, row, rot = way[0].x, way[0].y, way[0].row, way[0].rot
    out = np.empty((rules.horizon, 3))
    n = 0
    while True:
        at, next_row = film.rows[row], film.rows[row + 1]
        heading = at.heading + rot
        out[n, 0], out[n, 1], out[n, 2] = x, y, heading
        n += 1
        goes_on = at.more and next_row.endless and not goal.free
        touched = goes_on and touches(x, y, heading, goal)
        # The way was looked at no farther than the aim, and the horizon.
        stop = touched or (goes_on and touches(x, y, heading, aim)) or n >= rules.horizon
        stop = stop or (n >= rules.stride and next_row.end >= 0) or not next_row.more
        if stop:
            return out[:n], touched
        dx, dy = moved(at.dx, at.dy, rot)
        x, y, row = x + dx, y + dy, row + 1
