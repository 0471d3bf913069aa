"""Looking ahead through the film towards a place: a beam search, compiled (Figs. 10, 11, 17)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.beam import (
    Branch,
    Candidates,
    Found,
    begin,
    ends,
    go_on,
    jumps_of,
    keep_best,
    leads_on,
)
from finloop.animate.bounds import Bounds, beyond, fits
from finloop.animate.brisk import brisk_of
from finloop.animate.company import ALONE, Company, clear_ahead
from finloop.animate.film import Film
from finloop.animate.kinematics import Spot, bearing, touches, wrap
from finloop.animate.recent import NO_REPEAT, Repeat, again_cost, last_on_screen
from finloop.animate.state import Waters
from finloop.base.arrays import Floats, Ints
from finloop.base.kernel import for_kernels, kernel, kernel_part, leaf_kernel

JUMP = np.dtype([("cost", "f8"), ("to", "i8")])
"""A jump: ticks that it costs, but for what was on screen just now; the row that it leads to."""


class Space(NamedTuple):
    """What is searched: the film, and what keeps a fish inside the tank.

    jumps (e,): those of the film, of dtype `JUMP`, at each loop end the cheapest first.
    """

    film: Film
    jumps: NDArray[np.void]
    bounds: Bounds


class Here(NamedTuple):
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


class Rules(NamedTuple):
    """How ways are followed and compared, times in ticks.

    pace [px/tick], turning [°/tick]: of a brisk fish; horizon: ways are followed so far; stride:
    loop ends sooner than this are passed by; stay: least time between two jumps; beam: ways
    followed at once; seam, jerk, again: ticks that a jump costs for a seam of one median step, for
    a change of speed by one body length/s, for a row just seen; memory: until a row is forgotten;
    error: degrees off the goal at which a way may end heading, third test of Fig. 19; room: px that
    a brisk fish needs ahead of it to turn aside; aside: ticks that it takes to turn back.
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
    room: float = np.inf
    aside: float = 0.0

    @classmethod
    def of(cls, waters: Waters, ahead: float, stride: float, beam: int, again: float) -> "Rules":
        """The rules of some waters; ahead, stride, again: times in Δ."""
        motion, p = waters.motion, waters.settings
        swims, delta = waters.film.speed[waters.film.more], motion.delta
        brisk = brisk_of(swims, p) if len(swims) else 1.0
        pace = brisk * motion.body_length_px / motion.rate_hz
        turning = float(np.median(motion.turns.angle_deg / motion.turns.ticks))
        return cls(
            pace=pace, turning=turning,
            horizon=max(2, waters.ticks(ahead)), stride=max(1, waters.ticks(stride)),
            stay=max(1, waters.ticks(p.stay)), beam=beam, seam=p.seam * delta,
            jerk=p.jerk * delta**2 / motion.rate_hz, again=again * delta,
            memory=p.memory * delta, error=p.most_error_deg,
            room=pace / np.radians(turning) + motion.body_length_px / 2, aside=180 / turning,
        )  # fmt: skip


def space_of(film: Film, bounds: Bounds, rules: Rules) -> Space:
    """The space of a search by some rules."""
    jumps = np.zeros(len(film.to), JUMP)
    _cheapest_first(film, rules, jumps)
    return Space(film, jumps, bounds)


@kernel
def _cheapest_first(film, rules, jumps):  # type: ignore[no-untyped-def]
    """Write the jumps (e,) of a film, at each loop end in the order of their costs.

    Few are at one end: each is moved forward past those that cost more.
    """
    for row in range(len(film.rows)):
        at = film.rows[row]
        if at.end < 0:
            continue
        first = film.start[at.end]
        for e in range(first, film.start[at.end + 1]):
            to, place = film.to[e], e
            faster = film.rows[to].speed - at.speed
            seam, jerk, _ = jump_cost(film.seam[e], faster, np.inf, rules)
            cost = seam + jerk + longer_rest(at.rest, film.rows[to].rest)
            while place > first and jumps[place - 1].cost > cost:
                jumps[place] = jumps[place - 1]
                place -= 1
            jumps[place].cost, jumps[place].to = cost, to


@leaf_kernel
def moved(dx: float, dy: float, rot: float):  # type: ignore[no-untyped-def]
    """A displacement on the screen (y down), turned anticlockwise as seen."""
    angle = np.radians(rot)
    cos, sin = np.cos(angle), np.sin(angle)
    return dx * cos + dy * sin, dy * cos - dx * sin


@kernel_part
def _leg(space, way, aim, here, ticks):  # type: ignore[no-untyped-def]
    """Play forward to the first loop end after a stride, at most for so long. ticks: stride, most.

    `way` is moved on; its row is −1 where the film ends, leaves the tank or meets another fish.
    Returns the ticks that were played, and whether the last one touches the aim.
    """
    stride, most = ticks
    rows, tick = space.film.rows, here.tick + way.ticks
    x, y, row = way.x, way.y, way.row
    cos, sin = np.cos(np.radians(way.rot)), np.sin(np.radians(way.rot))
    t, touched = 0, False
    while t < most:
        at = rows[row]
        if not at.more:
            # The last picture of a track may still be exchanged for another.
            row = row if at.end >= 0 and t > 0 else -1
            break
        x, y = x + at.dx * cos + at.dy * sin, y + at.dy * cos - at.dx * sin
        t, row = t + 1, row + 1
        at = rows[row]
        heading = at.heading + way.rot
        free = fits(space.bounds, row, x, y, heading)
        if not (free and clear_ahead(here.company, row, x, y, heading, tick + t)):
            row = -1
            break
        # A fish that has reached its goal must be able to swim on.
        touched = not aim.free and touches(x, y, heading, aim)
        touched = touched and at.more and rows[row + 1].endless
        if touched or (t >= stride and at.end >= 0):
            break
    way.x, way.y, way.row = x, y, row
    return t, touched


@leaf_kernel
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


@leaf_kernel
def longer_rest(own: int, other: int) -> int:
    """Ticks that a jump costs by which it makes a rest longer: so many.

    own, other: for how long the animal rests if the film plays on, and after the jump. Jumps within
    rests are seen least. Were they free, fish would rest far longer than the film's animal.
    """
    return max(other - own, 0) if own > 0 else 0


class Ends(NamedTuple):
    """Where the best way of each candidate (k,) ends.

    far: px to the aim, 0 if it is touched; error: of the heading, degrees.
    """

    far: Floats
    error: Floats


@kernel
def look(
    space: Space, candidates: Candidates, here: Here, aim: Spot, rules: Rules
) -> tuple[Found, Ends]:
    """Follow every candidate (k,) through the film and its loops: a beam search.

    At loop ends ways are both kept to and left, as far as the horizon. A way costs its ticks, what
    its jumps cost, what its first leg shows, and what remains to the aim.
    """
    count = candidates.rows.size
    ends_at = Ends(np.full(count, np.inf), np.full(count, 180.0))
    search, n = begin(space, candidates, here, rules.beam)
    while n:
        n = _legs(space, search, n, here, (aim, rules, ends_at))
        search = go_on(space, search, n)
    return search.found, ends_at


@leaf_kernel
def _legs(space, search, n, here, towards):  # type: ignore[no-untyped-def]
    """Follow n ways for a leg: how many branches there are after it.

    towards: the aim, `Rules`, `Ends`.
    """
    (aim, rules, ends_at), film = towards, space.film
    m = np.int64(0)  # not 0: for a literal `_branch` is compiled again
    for s in range(n):
        way = search.ways[s]
        most, shown = max(rules.horizon - way.ticks, 1), way.row
        ticks, touched = _leg(space, way, aim, here, (rules.stride, most))
        if not leads_on(film, search.found, way, ticks):
            continue
        way.cost += here.slow * (film.rows[way.row].slow - film.rows[shown].slow)
        if way.ticks == ticks:  # the first leg; the next ones are decided anew
            way.cost += film.rows[way.row].dear - film.rows[shown].dear
        if touched or way.ticks >= rules.horizon:
            _finish(space, way, touched, (search.found, ends_at), aim, rules)
        else:
            m = _branch(space, way, s, (search.beam, m), here, (aim, rules))
    return m


@leaf_kernel
def _remains(space, way, aim, rules):  # type: ignore[no-untyped-def]
    """About how many ticks remain to the aim from where a way has come to, and off a wall ahead."""
    heading = space.film.rows[way.row].heading + way.rot
    aside = rules.aside * beyond(space.bounds, way.x, way.y, heading, rules.room)
    return remaining(way.x, way.y, heading, aim, rules) + aside


@leaf_kernel
def _finish(space, way, touched, results, aim, rules):  # type: ignore[no-untyped-def]
    """A way has come to the aim or to the horizon. results: `Found`, `Ends`."""
    found, ends_at = results
    rest = 0.0 if touched else _remains(space, way, aim, rules)
    if ends(found, way, way.ticks + way.cost + rest):
        ends_at.far[way.first], ends_at.error[way.first] = 0.0, 0.0
        if not touched:
            heading = space.film.rows[way.row].heading + way.rot
            off = bearing(way.x, way.y, aim.x, aim.y) - heading
            ends_at.far[way.first] = np.hypot(aim.x - way.x, aim.y - way.y)
            ends_at.error[way.first] = abs(wrap(off))


@kernel_part
def _branch(space, way, s, kept, here, towards):  # type: ignore[no-untyped-def]
    """Way s at a loop end: playing on, and every jump, where they are among the best.

    kept: the beam, and how many there were; returns how many there are.
    """
    (beam, n), (aim, rules), film = kept, towards, space.film
    most = beam.branches.size
    at = film.rows[way.row]
    total = way.ticks + _remains(space, way, aim, rules)
    plays = at.more and film.rows[way.row + 1].endless
    first, last = jumps_of(film, way.row, way.since >= rules.stay)
    if n == most and total + way.cost >= beam.branches[n - 1].total:
        beam.over[way.first] |= plays or first < last
        return n
    if plays:
        n = keep_best(beam, n, Branch(total + way.cost, way.first, s, -1, 0.0))
    for e in range(first, last):
        jump = space.jumps[e]
        if n == most and total + (way.cost + jump.cost) >= beam.branches[n - 1].total:
            beam.over[way.first] = True
            break  # those that follow cost as much, or more
        ago = float(here.tick + way.ticks - last_on_screen(here.recent, jump.to, jump.to))
        cost = jump.cost + again_cost(ago, rules.again, rules.memory)
        n = keep_best(beam, n, Branch(total + (way.cost + cost), way.first, s, e, cost))
    return n
