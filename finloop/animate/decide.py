"""A decision in the film: which ways there are, what each costs, which stay in the tank."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.animate.beam import Candidates, Found, jumps_of
from finloop.animate.film import Film
from finloop.animate.kinematics import rotate, touches, wrap
from finloop.animate.objectives import Objective
from finloop.animate.recent import last_on_screen, times
from finloop.animate.search import search
from finloop.animate.space import Here, Rules, Space, jump_cost, longer_rest
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, leaf_kernel
from finloop.edit.schema import VERDICTS
from finloop.loops.positions import next_end

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
def ways_on(film: Film, row: int, rot: float, jumps: bool) -> Ways:
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
def priced(film: Film, ways: Ways, here: Here, rules: Rules) -> tuple[Floats, Candidates]:
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
    space: Space, ways: Ways, here: Here, objective: Objective, rules: Rules, along: float = 0.0
) -> tuple[Floats, Found, Ints]:
    """Look ahead from ways (k,); along: px along a path.

    Returns
    -------
    terms (k, 3) : what each costs at once, of `priced`; what becomes of it; the rows (l,) with
    which the best way begins its legs.
    """
    terms, candidates = priced(space.film, ways, here, rules)
    return terms, *search(space, candidates, here, along, objective, rules)


def verdicts(found: Found) -> NDArray[np.int8]:
    """Return the number in `VERDICTS` of each way (k,): good, passed over, or out of the tank."""
    lost = np.where(np.isinf(found.value), _TANK, 0)
    return np.where(found.over, _OVER, lost).astype(np.int8)


@leaf_kernel
def arrival(film: Film, x: float, y: float, row: int, rot: float) -> tuple[float, float]:
    """Where a fish at x, y that shows a row is at the next tick."""
    dx, dy = rotate(film.rows[row].dx, film.rows[row].dy, rot)
    return x + dx, y + dy


@kernel
def play(film: Film, start: tuple[float, float, float], row: int, towards, rules: Rules):  # type: ignore[no-untyped-def]
    """Play from a row to the next loop end after a stride, or to a touch.

    start: x, y, and by how much the row is turned; towards: the goal, and the aim on the way there.

    Returns
    -------
    way (n, 3) : x, y, heading of each row that is shown; whether the last one touches the goal; px
    on the screen (dx, dy) that the film leads to by its next loop end (Fig. 11).
    """
    (x, y, rot), (goal, aim) = start, towards
    stop = next_end(film.rows["more"], film.rows["end"], row, rules.stride)
    leads = rotate(film.rows[stop].x - film.rows[row].x, film.rows[stop].y - film.rows[row].y, rot)
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
        stops = touched or (goes_on and touches(x, y, heading, aim)) or n >= rules.horizon
        stops = stops or (n >= rules.stride and next_row.end >= 0) or not next_row.more
        if stops:
            return out[:n], touched, leads
        dx, dy = rotate(at.dx, at.dy, rot)
        x, y, row = x + dx, y + dy, row + 1
