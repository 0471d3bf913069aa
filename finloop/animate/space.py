"""What a search goes through: the film and its jumps, the fish that decides, the weights."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.bounds import Bounds
from finloop.animate.brisk import brisk_of
from finloop.animate.company import ALONE, Company
from finloop.animate.film import Film
from finloop.animate.recent import NO_REPEAT, Repeat, again_cost
from finloop.animate.state import Waters
from finloop.base.arrays import Ints
from finloop.base.kernel import for_kernels, kernel, leaf_kernel

JUMP = np.dtype([("cost", "f8"), ("to", "i8")])
"""A jump: ticks that it costs, but for what was on screen just now; the row that it leads to."""


LEAD = np.dtype(
    [
        ("dx", "f8"), ("dy", "f8"), ("ahead", "f8"), ("left", "f8"), ("far", "f8"),
        ("half_ahead", "f8"), ("half_left", "f8"), ("half_far", "f8"), ("ticks", "i8"),
    ]
)  # fmt: skip
"""Where the film leads to from a row in some ticks, as filmed: px on the screen (dx, dy), px ahead
and to the left, px as the crow flies; and in half as many ticks."""


class Space(NamedTuple):
    """What is searched: the film, and what keeps a fish inside the tank.

    jumps (e,): those of the film, of dtype `JUMP`, at each loop end the cheapest first. Of a film
    that paths are followed through: run (n,): ticks that the film goes on from each row; leg (n,):
    ticks to the first loop end after a stride, or to where the film ends; leads (n,): of dtype
    `LEAD`.
    """

    film: Film
    jumps: NDArray[np.void]
    bounds: Bounds
    run: Ints
    leg: Ints
    leads: NDArray[np.void]


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
    room: px that a brisk fish needs ahead of it to turn aside; aside: ticks that it takes to turn
    back.
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
            memory=p.memory * delta,
            room=pace / np.radians(turning) + motion.body_length_px / 2, aside=180 / turning,
        )  # fmt: skip


def space_of(film: Film, bounds: Bounds, rules: Rules) -> Space:
    """The space of a search by some rules."""
    jumps = np.zeros(len(film.to), JUMP)
    _cheapest_first(film, rules, jumps)
    none = np.zeros(0, np.int64)
    return Space(film, jumps, bounds, none, none, np.zeros(0, LEAD))


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
