"""Where the other fish of a tank will be, and whether a fish keeps clear of them, compiled.

A few discs that hold an outline of the film stand for the body. A fish knows what the others have
planned; after that they count as staying in place. Its plans meet none of them, and it stops only
where it can stay. So a fish that finds no way on can stay in place, and no two bodies overlap. Two
things are left out: what joins bend and turn for some ticks, and the partner of a cross-fade.
"""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple, Protocol

import numpy as np

from finloop.base.arrays import Floats, Ints, Reals
from finloop.base.kernel import kernel, leaf_kernel

_DISCS = 6
_TICKS = 64  # initial room for planned ways; it grows
_LOT = 10_000  # outlines at a time
_EDGE_PX = 1.5  # of a pixel's corner beyond its middle, of both bodies


class Hulls(Protocol):
    """Outlines (n, p, 2) that are read in slices: an array, or one that stays in a file."""

    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> Reals: ...


class Discs(NamedTuple):
    """The discs that hold the body in every picture.

    table (n + s, k, 3): of n frames of the film, then of s sprites: px ahead of the mass centre and
    to its left, and the radius; frames: n; reach: px from the centre beyond which no disc reaches.
    The number of a picture is its row of the motion graph, or −1 − the number of a sprite.
    """

    table: Floats
    frames: int
    reach: float


class Company(NamedTuple):
    """The m other fish of a tank, as a fish knows them when it decides.

    start: the first tick that is known, as the deciding fish counts; places (n, m, 4): x, y px,
    heading in degrees and the number of the picture at every tick from then on; the last ones count
    for ever; until: the last tick at which a search considers them; near: a search considers the
    first `near` fish.
    """

    start: int
    places: Floats
    discs: Discs
    until: int = 0
    near: int = 0


NO_DISCS = Discs(np.zeros((0, _DISCS, 3)), 0, 0.0)
ALONE = Company(0, np.zeros((1, 0, 4)), NO_DISCS)


class Plans:
    """What the fish of a tank have planned: the last way of each, and the tick at which it begins.

    Fish are numbered from 0; a fish that has not planned yet is not there.
    """

    def __init__(self, fish: int) -> None:
        self._ways = np.zeros((fish, _TICKS, 4))
        self._begins, self._ticks = np.zeros(fish, np.int64), np.zeros(fish, np.int64)

    @classmethod
    def from_paths(cls, ways: Sequence[Floats], start: int) -> "Plans":
        """Return the plans of fish whose ways (n, 4) all begin at tick `start`.

        ways: one a fish; x, y px, heading and picture at every tick, as in `Company`.
        """
        plans = cls(len(ways))
        for number, way in enumerate(ways):
            plans.put(number, start, way)
        return plans

    def put(self, number: int, begins: int, way: Floats) -> None:
        """Store the way of a fish that begins at tick `begins`, in place of its last one.

        way (n, 4), n ≥ 1: x, y px, heading and picture at every tick, as in `Company`.
        """
        more = len(way) - self._ways.shape[1]
        if more > 0:
            self._ways = np.pad(self._ways, [(0, 0), (0, more), (0, 0)])
        self._ways[number, : len(way)] = way
        self._begins[number], self._ticks[number] = begins, len(way)

    def others(self, number: int, tick: int) -> Floats:
        """Return the ways of all fish but `number` from a tick on, side by side.

        (n, m, 4): x, y px, heading and picture of m fish at n ticks, as in `Company`.
        """
        return np.asarray(_places(self._ways, self._begins, self._ticks, number, tick))

    def number(self, own: int, other: int) -> int:
        """Return the number of the fish in column `other` of what fish `own` is shown."""
        there = np.flatnonzero(self._ticks > 0)
        return int(there[there != own][other])

    def has(self, number: int) -> bool:
        """Return whether a fish has planned anything yet."""
        return bool(self._ticks[number])

    def place_at(self, number: int, tick: int) -> Floats:
        """Return x, y px, heading and picture (4,) of a fish at a tick."""
        row = min(max(tick - self._begins[number], 0), self._ticks[number] - 1)
        return np.asarray(self._ways[number, row])


def company_of(others: Floats, start: int, discs: Discs, stays: int) -> Company:
    """Return the company that a fish knows at tick `start`.

    others (n, m, 4): from `Plans.others`; stays: for how many ticks after their plans a search
    considers them.
    """
    ticks, count = others.shape[:2]
    return Company(start, others, discs, start + ticks - 1 + stays, count)


@kernel
def _places(ways, begins, ticks, own, tick):  # type: ignore[no-untyped-def]
    count, most = 0, 1
    for k in range(len(ticks)):
        if k != own and ticks[k] > 0:
            count += 1
            most = max(most, begins[k] + ticks[k] - tick)
    places, m = np.empty((most, count, 4)), 0
    for k in range(len(ticks)):
        if k != own and ticks[k] > 0:
            for t in range(most):
                row = min(max(tick + t - begins[k], 0), ticks[k] - 1)
                for c in range(4):
                    places[t, m, c] = ways[k, row, c]
            m += 1
    return places


@kernel
def near_first(company: Company, x: float, y: float, farthest: Floats) -> Company:
    """Return the company with those fish first that a fish at x, y px can meet during a search.

    farthest (t,): px that a fish moves in 0, 1, 2 … ticks at most; after these it goes on at their
    mean speed. `near` is set to the number of those fish.
    """
    known = len(farthest) - 1
    pace = farthest[known] / known
    ticks, count = company.places.shape[:2]
    first, last, order = 0, count, np.empty(count, np.int64)
    for k in range(count):
        near = False
        for t in range(ticks):
            later = t if t < ticks - 1 else company.until - company.start
            far = np.hypot(company.places[t, k, 0] - x, company.places[t, k, 1] - y)
            more = max(later + 1 - known, 0)
            comes = farthest[later + 1 - more] + more * pace
            near = near or far < 2 * company.discs.reach + comes
        if near:
            order[first] = k
            first += 1
        else:
            last -= 1
            order[last] = k
    places = np.empty_like(company.places)
    for t in range(ticks):
        for k in range(count):
            places[t, k] = company.places[t, order[k]]
    return Company(company.start, places, company.discs, company.until, first)


def discs_of(frame_hulls: Hulls, sprite_hulls: Sequence[Floats]) -> Discs:
    """Return the discs that hold outlines, of frames (n, p, 2) and then of sprites, (p, 2) each.

    Outlines are px ahead of and to the left of the mass centre.
    """
    lots = (frame_hulls[first : first + _LOT] for first in range(0, len(frame_hulls), _LOT))
    every = chain(lots, (np.asarray(hull)[None] for hull in sprite_hulls))
    table = np.concatenate([_discs(np.ascontiguousarray(lot, float)) for lot in every])
    reach = np.hypot(table[..., 0], table[..., 1]) + table[..., 2]
    return Discs(table, len(frame_hulls), float(reach.max()))


@kernel
def _discs(hulls):  # type: ignore[no-untyped-def]
    """Return discs (n, k, 3) that hold outlines (n, p, 2), for equal parts of their length."""
    discs, wide = np.empty((len(hulls), _DISCS, 3)), np.empty((_DISCS, 2))
    for n in range(len(hulls)):
        hull = hulls[n]
        back = hull[:, 0].min()
        part = max(hull[:, 0].max() - back, 1e-9) / _DISCS
        wide[:, 0], wide[:, 1] = np.inf, -np.inf
        for p in range(len(hull)):
            last, point = hull[p - 1], hull[p]
            ahead = (last[0] - back) / part, (point[0] - back) / part
            _widen(wide, ahead, (last[1], point[1]))
        for k in range(_DISCS):
            low, high = wide[k, 0], wide[k, 1]
            if low > high:
                low, high = 0.0, 0.0
            discs[n, k, 0], discs[n, k, 1] = back + (k + 0.5) * part, (low + high) / 2
            discs[n, k, 2] = np.hypot(high - low, part) / 2 + _EDGE_PX
    return discs


@leaf_kernel
def _widen(wide, ahead, left):  # type: ignore[no-untyped-def]
    """Widen the parts (k, 2), lowest and highest left, to hold a side of an outline.

    ahead, left: of its two ends, the former in parts.
    """
    near, far = min(ahead), max(ahead)
    for k in range(min(int(near), _DISCS - 1), min(int(far), _DISCS - 1) + 1):
        for end in range(2):
            share = float(end)
            if near < far:
                share = (min(max(float(k + end), near), far) - ahead[0]) / (ahead[1] - ahead[0])
            at = left[0] + share * (left[1] - left[0])
            wide[k, 0], wide[k, 1] = min(wide[k, 0], at), max(wide[k, 1], at)


@leaf_kernel
def clear(company: Company, picture: int, x: float, y: float, heading: float, tick: int) -> bool:
    """Return whether a picture at x, y px and a heading in degrees meets no other fish at a tick.

    picture: its number as in `Discs`.
    """
    return _clear(company, company.places.shape[1], picture, (x, y, heading), tick)


@leaf_kernel
def _clear(company, count, picture, place, tick):  # type: ignore[no-untyped-def]
    """Return whether a picture at a place (x, y, heading) meets none of the first `count` fish."""
    others, near, (x, y, heading) = company.places, 4.0 * company.discs.reach**2, place
    if count == 0:
        return True
    t = min(max(tick - company.start, 0), others.shape[0] - 1)
    for k in range(count):
        dx, dy = others[t, k, 0] - x, others[t, k, 1] - y
        if dx * dx + dy * dy < near:
            second = int(others[t, k, 3]), others[t, k, 2]
            if _meet(company.discs, (picture, heading), second, dx, dy):
                return False
    return True


@leaf_kernel
def clear_ahead(company, picture, x, y, heading, tick):  # type: ignore[no-untyped-def]
    """Return whether a picture at a place meets none of the fish that a search considers at a tick.

    Only the first `near` fish count, and only from tick `start` to `until` of the company;
    otherwise True.
    """
    unknown = tick < company.start or tick > company.until
    return unknown or _clear(company, company.near, picture, (x, y, heading), tick)


@leaf_kernel
def _meet(discs, first, second, dx, dy):  # type: ignore[no-untyped-def]
    """Return whether the discs of two pictures overlap, the second dx, dy px (y down) away.

    first, second: number, heading.
    """
    a, side, cos, sin = disc_orientation(discs, first)
    b, other_side, other_cos, other_sin = disc_orientation(discs, second)
    table = discs.table
    for i in range(table.shape[1]):
        ahead, left = table[a, i, 0], side * table[a, i, 1]
        x, y = dx - (ahead * cos - left * sin), dy + ahead * sin + left * cos
        for j in range(table.shape[1]):
            ahead, left = table[b, j, 0], other_side * table[b, j, 1]
            far_x = x + ahead * other_cos - left * other_sin
            far_y = y - (ahead * other_sin + left * other_cos)
            apart = table[a, i, 2] + table[b, j, 2]
            if far_x * far_x + far_y * far_y < apart * apart:
                return True
    return False


@leaf_kernel
def disc_orientation(discs, one):  # type: ignore[no-untyped-def]
    """Return how the discs of a picture lie: table row, side, cosine and sine of the heading.

    one: number of the picture, and heading in degrees. The side is −1 for a mirror image, whose
    left is right; else 1.
    """
    number, angle = one[0], np.radians(one[1])
    side = 1.0
    if number < 0:
        number = discs.frames - 1 - number
    elif number >= discs.frames:
        number, side = number - discs.frames, -1.0
    return number, side, np.cos(angle), np.sin(angle)


@leaf_kernel
def clear_ticks(company: Company, numbers: Ints, way: Floats, tick: int) -> int:
    """Return how many ticks of a way (n, 3), begun at tick `tick`, meet no other fish.

    numbers (n,): of its pictures, as in `Discs`; way: x, y px, heading.
    """
    for t in range(len(way)):
        if not clear(company, numbers[t], way[t, 0], way[t, 1], way[t, 2], tick + t):
            return t
    return len(way)


@leaf_kernel
def can_stay(company: Company, picture: int, place, tick: int) -> bool:  # type: ignore[no-untyped-def]
    """Return whether a picture that stays at a place meets no other fish from tick `tick` on.

    picture: its number as in `Discs`; place: x, y px, heading.
    """
    last = max(company.start + company.places.shape[0] - 1, tick)
    while tick <= last and clear(company, picture, place[0], place[1], place[2], tick):
        tick += 1
    return tick > last


@leaf_kernel
def lasting_ticks(company: Company, numbers: Ints, way: Floats, tick: int) -> int:
    """Return how many ticks of a way (n, 3) a fish can swim and then stay, clear of all others.

    numbers (n,): of its pictures, as in `Discs`; tick: at which the way begins.
    """
    n = clear_ticks(company, numbers, way, tick)
    while n > 0 and not can_stay(company, numbers[n - 1], way[n - 1], tick + n - 1):
        n -= 1
    return n
