"""Looking ahead through the film: a beam search over its loops, compiled (Figs. 10, 11, 17)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import inside
from finloop.animate.film import Film
from finloop.animate.kinematics import Spot, bearing, touches, wrap
from finloop.animate.recent import again_cost, last_on_screen
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import for_kernels, kernel

WAY = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("rot", "f8"), ("cost", "f8"),
        ("row", "i8"), ("first", "i8"), ("ticks", "i8"), ("since", "i8"),
    ]
)  # fmt: skip
"""A way that is followed: where it has come to (x, y px, row, rot), what its jumps cost in ticks,
the candidate that it began with (first), ticks that it took and that have passed since its last
jump."""


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
    """Where and when a candidate would be shown, and what of the fish that shows it matters.

    speed: in body lengths/s; since: ticks since its last jump; recent (m, 3): what was on screen,
    as `Fish` keeps it.
    """

    x: float
    y: float
    tick: int
    speed: float
    since: int
    recent: Ints


class Rules(NamedTuple):
    """How ways are followed and compared, times in ticks.

    pace [px/tick], turning [°/tick]: of a brisk fish; horizon: ways are followed so far; stride:
    loop ends sooner than this are passed by; stay: least time between two jumps; beam: ways
    followed at once; seam, jerk, again: ticks that a jump costs for a seam of one median step, for
    a change of speed by one body length/s, for a row just seen; memory: until a row is forgotten;
    error: degrees off the goal at which a way may end heading, third test of Fig. 19.
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
    error: float


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
        touched = not aim.free and touches(x, y, at.heading + way.rot, aim)
        if touched and at.more and rows[row + 1].endless:
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
    its jumps cost, what its first leg shows, and what remains to the aim. After every leg the best
    `rules.beam` ways go on.
    """
    count = candidates.rows.size
    found = Found(
        np.full(count, np.inf), np.full(count, np.inf), np.full(count, 180.0), np.zeros(count),
        np.zeros(count, np.bool_),
    )  # fmt: skip
    ways = np.empty(max(rules.beam, count), WAY)
    beam = Beam(
        np.empty(rules.beam), np.empty(rules.beam, np.int64), np.empty(rules.beam, WAY), found.over
    )
    n = 0
    for c in range(count):
        if film.rows[candidates.rows[c]].endless and inside(legal, here.x, here.y):
            way = ways[n]
            way.x, way.y, way.first, way.ticks = here.x, here.y, c, 0
            way.row, way.rot = candidates.rows[c], candidates.rots[c]
            way.cost, way.since = candidates.costs[c], candidates.since[c]
            n += 1
    while n:
        m = np.int64(0)  # not 0: for a literal `_branch` is compiled again
        for s in range(n):
            way = ways[s]
            most, shown = max(rules.horizon - way.ticks, 1), way.row
            way.x, way.y, way.row, ticks, touched = leg(
                film.rows, legal, way, aim, most, rules.stride
            )
            way.ticks += ticks
            way.since += ticks
            if found.value[way.first] == np.inf:
                found.ticks[way.first] = max(found.ticks[way.first], way.ticks)
            if way.row < 0 or not film.rows[way.row].endless:
                continue
            if way.ticks == ticks:  # the first leg; the next ones are decided anew
                way.cost += film.rows[way.row].dear - film.rows[shown].dear
            if touched or way.ticks >= rules.horizon:
                _finish(film, way, touched, found, aim, rules)
            else:
                m = _branch(film, way, beam, m, here, (aim, rules))
        n = int(m)
        for s in range(n):
            ways[s] = beam.ways[beam.order[s]]
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


class Beam(NamedTuple):
    """The best branches of a leg, (beam,) each: their totals, rising, and where in `ways` they are.

    A total counts ticks swum and left, and what the jumps cost.
    over (candidates,): whether a branch of a candidate was given up for better ones.
    """

    totals: Floats
    order: Ints
    ways: NDArray[np.void]
    over: Mask


@kernel
def _branch(film, way, beam, n, here, towards):  # type: ignore[no-untyped-def]
    """At a loop end: playing on, and every jump, where they are among the best; how many these are.

    n: how many there were.
    """
    aim, rules = towards
    at = film.rows[way.row]
    heading = at.heading + way.rot
    total = way.ticks + remaining(way.x, way.y, heading, aim, rules)
    plays = at.more and film.rows[way.row + 1].endless
    first, last = np.int64(0), np.int64(0)
    if way.since >= rules.stay and at.end >= 0:
        first, last = np.int64(film.start[at.end]), np.int64(film.start[at.end + 1])
    if n == len(beam.order) and total + way.cost >= beam.totals[n - 1]:
        beam.over[way.first] |= plays or first < last
        return n
    if plays:
        slot, n = keep_best(beam, n, total + way.cost, way.first)
        beam.ways[slot] = way
    for e in range(first, last):
        worst = beam.totals[n - 1] if n == len(beam.order) else np.inf
        # Most jumps are too dear for their seam, or their change of speed, alone.
        seam, _, _ = jump_cost(film.seam[e], 0.0, np.inf, rules)
        if total + (way.cost + seam) >= worst:
            beam.over[way.first] = True
            continue
        other = film.to[e]
        there = film.rows[other]
        faster = there.speed - at.speed
        seam, jerk, _ = jump_cost(film.seam[e], faster, np.inf, rules)
        if total + (way.cost + (seam + jerk)) >= worst:
            beam.over[way.first] = True
            continue
        ago = float(here.tick + way.ticks - last_on_screen(here.recent, other, other))
        seam, jerk, again = jump_cost(film.seam[e], faster, ago, rules)
        cost = way.cost + (seam + jerk + again)
        slot, n = keep_best(beam, n, total + cost, way.first)
        if slot >= 0:
            branch = beam.ways[slot]
            branch.x, branch.y, branch.row, branch.first = way.x, way.y, other, way.first
            branch.rot = wrap(heading - there.heading) if film.body else way.rot
            branch.cost, branch.ticks, branch.since = cost, way.ticks, 0
    return n


@kernel
def keep_best(beam, n, total, first):  # type: ignore[no-untyped-def]
    """Where among the n best a further branch of this total is kept, −1 if it is not; the new n."""
    slot, k = n, n
    if n == len(beam.order):
        k = n - 1
        if total >= beam.totals[k]:
            beam.over[first] = True
            return np.int64(-1), n
        slot = beam.order[k]
        beam.over[beam.ways[slot].first] = True
    while k > 0 and total < beam.totals[k - 1]:
        beam.totals[k], beam.order[k] = beam.totals[k - 1], beam.order[k - 1]
        k -= 1
    beam.totals[k], beam.order[k] = total, slot
    return slot, max(n, slot + 1)
