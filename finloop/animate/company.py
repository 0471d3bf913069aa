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

_DISCS = 6  # of a body, from tail to head
_TICKS = 64  # initial room for planned trajectories; it grows
_LOT = 10_000  # outlines at a time
_EDGE_PX = 1.5  # added to radii: pixels of both bodies have corners


class Hulls(Protocol):
    """Outlines (n, p, 2) that are read in slices: an array, or one that stays in a file."""

    def __len__(self) -> int:
        """Return the number n of outlines."""
        ...

    def __getitem__(self, rows: slice, /) -> Reals:
        """Return the outlines of a slice of pictures."""
        ...


class Discs(NamedTuple):
    """The discs that together cover the body in every picture.

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
    for ever; discs: that cover the pictures; until: the last tick at which a search considers them;
    near: a search considers the first `near` fish.
    """

    start: int
    places: Floats
    discs: Discs
    until: int = 0
    near: int = 0


NO_DISCS = Discs(np.zeros((0, _DISCS, 3)), 0, 0.0)
ALONE = Company(0, np.zeros((1, 0, 4)), NO_DISCS)


class Plans:
    """What the fish of a tank have planned: the last trajectory of each, and its first tick.

    Fish are numbered from 0; a fish that has not planned yet is not there.
    """

    def __init__(self, fish_count: int) -> None:
        """Make room for the plans of some fish, none of which has planned yet."""
        self._ways = np.zeros((fish_count, _TICKS, 4))
        self._begins, self._ticks = np.zeros(fish_count, np.int64), np.zeros(fish_count, np.int64)

    @classmethod
    def from_paths(cls, trajectories: Sequence[Floats], start_tick: int) -> "Plans":
        """Return the plans of fish whose trajectories (n, 4) all begin at one tick.

        trajectories: one a fish; x, y px, heading in degrees, and picture: film row, or −1 − number
        of a sprite.
        """
        plans = cls(len(trajectories))
        for number, trajectory in enumerate(trajectories):
            plans.put(number, start_tick, trajectory)
        return plans

    def put(self, fish: int, start_tick: int, trajectory: Floats) -> None:
        """Store the trajectory of a fish from a tick on, in place of its last one.

        trajectory (n, 4), n ≥ 1: x, y px, heading in degrees, and picture: film row, or −1 − number
        of a sprite.
        """
        lacking = len(trajectory) - self._ways.shape[1]
        if lacking > 0:
            self._ways = np.pad(self._ways, [(0, 0), (0, lacking), (0, 0)])
        self._ways[fish, : len(trajectory)] = trajectory
        self._begins[fish], self._ticks[fish] = start_tick, len(trajectory)

    def others(self, fish: int, tick: int) -> Floats:
        """Return where all fish but one will be from a tick on: (n, m, 4), m fish at n ticks.

        Columns: x, y px, heading in degrees, and picture: film row, or −1 − number of a sprite.
        """
        return np.asarray(_places_of_others(self._ways, self._begins, self._ticks, fish, tick))

    def fish_in_column(self, fish: int, column: int) -> int:
        """Return the number of the fish in a column of `others`, called for another fish.

        fish: for which `others` was called. Fish that have not planned have no column.
        """
        planned = np.flatnonzero(self._ticks > 0)
        return int(planned[planned != fish][column])

    def has_planned(self, fish: int) -> bool:
        """Return whether a fish has planned anything yet."""
        return bool(self._ticks[fish])

    def pose_at(self, fish: int, tick: int) -> Floats:
        """Return x, y px, heading in degrees and picture (4,) of a fish at a tick."""
        row = min(max(tick - self._begins[fish], 0), self._ticks[fish] - 1)
        return np.asarray(self._ways[fish, row])


def make_company(other_plans: Floats, start_tick: int, discs: Discs, ticks_after: int) -> Company:
    """Return the company of other fish as a fish that decides at a tick knows it.

    start_tick: at which the fish decides; other_plans (n, m, 4): x, y px, heading, picture of m
    others at n ticks; ticks_after: for how many ticks after their plans a search considers them.
    """
    ticks, count = other_plans.shape[:2]
    return Company(start_tick, other_plans, discs, start_tick + ticks - 1 + ticks_after, count)


@kernel
def _places_of_others(trajectories, first_ticks, lengths, fish, tick):  # type: ignore[no-untyped-def]
    """Return where all fish but `fish` will be from a tick on (n, m, 4), compiled.

    Columns: x, y px, heading, picture; n ends with the last plan. trajectories (fish, t, 4): of
    all; first_ticks, lengths (fish,): of each trajectory, 0 long if there is none.
    """
    other_count, most_ticks = 0, 1
    for k in range(len(lengths)):
        if k != fish and lengths[k] > 0:
            other_count += 1
            most_ticks = max(most_ticks, first_ticks[k] + lengths[k] - tick)
    places, other = np.empty((most_ticks, other_count, 4)), 0
    for k in range(len(lengths)):
        if k != fish and lengths[k] > 0:
            for t in range(most_ticks):
                row = min(max(tick + t - first_ticks[k], 0), lengths[k] - 1)
                for c in range(4):
                    places[t, other, c] = trajectories[k, row, c]
            other += 1
    return places


@kernel
def sort_near_first(company: Company, x: float, y: float, farthest: Floats) -> Company:
    """Return the company with those fish first that a fish at x, y px can meet during a search.

    farthest (t,): px that a fish moves in 0, 1, 2 … ticks at most; after these it goes on at their
    mean speed. `near` is set to the number of those fish.
    """
    known_ticks = len(farthest) - 1
    px_per_tick = farthest[known_ticks] / known_ticks
    ticks, count = company.places.shape[:2]
    near_count, far_begin, order = 0, count, np.empty(count, np.int64)
    for k in range(count):
        is_near = False
        for t in range(ticks):
            wait_ticks = t if t < ticks - 1 else company.until - company.start
            distance = np.hypot(company.places[t, k, 0] - x, company.places[t, k, 1] - y)
            ticks_beyond = max(wait_ticks + 1 - known_ticks, 0)
            swims_px = farthest[wait_ticks + 1 - ticks_beyond] + ticks_beyond * px_per_tick
            is_near = is_near or distance < 2 * company.discs.reach + swims_px
        if is_near:
            order[near_count] = k
            near_count += 1
        else:
            far_begin -= 1
            order[far_begin] = k
    places = np.empty_like(company.places)
    for t in range(ticks):
        for k in range(count):
            places[t, k] = company.places[t, order[k]]
    return Company(company.start, places, company.discs, company.until, near_count)


def cover_with_discs(frame_hulls: Hulls, sprite_hulls: Sequence[Floats]) -> Discs:
    """Return the discs that cover outlines, of frames (n, p, 2) and then of sprites, (p, 2) each.

    Outlines are px ahead of and to the left of the mass centre.
    """
    frames = (frame_hulls[first : first + _LOT] for first in range(0, len(frame_hulls), _LOT))
    batches = chain(frames, (np.asarray(hull)[None] for hull in sprite_hulls))
    table = np.concatenate([_disc_table(np.ascontiguousarray(batch, float)) for batch in batches])
    reach = np.hypot(table[..., 0], table[..., 1]) + table[..., 2]
    return Discs(table, len(frame_hulls), float(reach.max()))


@kernel
def _disc_table(hulls):  # type: ignore[no-untyped-def]
    """Return the discs (n, k, 3) that cover outlines (n, p, 2), one for each part of the length.

    A disc: px ahead of and to the left of the mass centre, and radius. The outline is cut across
    into k parts of equal length.
    """
    discs, extents = np.empty((len(hulls), _DISCS, 3)), np.empty((_DISCS, 2))
    for n in range(len(hulls)):
        hull = hulls[n]
        back = hull[:, 0].min()
        part = max(hull[:, 0].max() - back, 1e-9) / _DISCS
        extents[:, 0], extents[:, 1] = np.inf, -np.inf
        for p in range(len(hull)):
            before, point = hull[p - 1], hull[p]
            ahead = (before[0] - back) / part, (point[0] - back) / part
            _widen_parts(extents, ahead, (before[1], point[1]))
        for k in range(_DISCS):
            right, left = extents[k, 0], extents[k, 1]
            if right > left:
                right, left = 0.0, 0.0
            discs[n, k, 0], discs[n, k, 1] = back + (k + 0.5) * part, (right + left) / 2
            discs[n, k, 2] = np.hypot(left - right, part) / 2 + _EDGE_PX
    return discs


@leaf_kernel
def _widen_parts(parts, ahead, left):  # type: ignore[no-untyped-def]
    """Widen the parts (k, 2) of a body so that they hold one side of its outline.

    parts: lowest and highest px to the left, changed in place; ahead, left: of the side's two ends;
    ahead in lengths of a part, left in px.
    """
    back, front = min(ahead), max(ahead)
    for k in range(min(int(back), _DISCS - 1), min(int(front), _DISCS - 1) + 1):
        for end in range(2):
            share = float(end)
            if back < front:
                share = (min(max(float(k + end), back), front) - ahead[0]) / (ahead[1] - ahead[0])
            edge_left = left[0] + share * (left[1] - left[0])
            parts[k, 0], parts[k, 1] = min(parts[k, 0], edge_left), max(parts[k, 1], edge_left)


@leaf_kernel
def is_clear_of_fish(
    company: Company, picture: int, x: float, y: float, heading: float, tick: int
) -> bool:
    """Return whether a picture at x, y px and a heading in degrees meets no other fish at a tick.

    picture: film row, or −1 − number of a sprite.
    """
    return _is_clear_of_first(company, company.places.shape[1], picture, (x, y, heading), tick)


@leaf_kernel
def _is_clear_of_first(company, count, picture, pose, tick):  # type: ignore[no-untyped-def]
    """Return whether a picture at a pose (x, y, heading) meets none of the first `count` fish.

    company: `Company`; picture: film row, or −1 − number of a sprite; tick: at which they are
    there.
    """
    others, near_px2, (x, y, heading) = company.places, 4.0 * company.discs.reach**2, pose
    if count == 0:
        return True
    t = min(max(tick - company.start, 0), others.shape[0] - 1)
    for k in range(count):
        dx, dy = others[t, k, 0] - x, others[t, k, 1] - y
        if dx * dx + dy * dy < near_px2:
            second = int(others[t, k, 3]), others[t, k, 2]
            if _do_discs_overlap(company.discs, (picture, heading), second, dx, dy):
                return False
    return True


@leaf_kernel
def is_clear_in_search(company, picture, x, y, heading, tick):  # type: ignore[no-untyped-def]
    """Return whether a picture at x, y px and a heading meets no fish that a search considers.

    picture: film row, or −1 − number of a sprite; heading: degrees. Only the first `company.near`
    fish count, and only from tick `company.start` to `company.until`; otherwise True.
    """
    unknown = tick < company.start or tick > company.until
    return unknown or _is_clear_of_first(company, company.near, picture, (x, y, heading), tick)


@leaf_kernel
def _do_discs_overlap(discs, first, second, dx, dy):  # type: ignore[no-untyped-def]
    """Return whether the discs of two pictures overlap, the second dx, dy px (y down) away.

    first, second: film row, or −1 − number of a sprite, heading in degrees.
    """
    row, side, cos, sin = disc_orientation(discs, first)
    other_row, other_side, other_cos, other_sin = disc_orientation(discs, second)
    table = discs.table
    for i in range(table.shape[1]):
        ahead, left = table[row, i, 0], side * table[row, i, 1]
        x, y = dx - (ahead * cos - left * sin), dy + ahead * sin + left * cos
        for j in range(table.shape[1]):
            ahead, left = table[other_row, j, 0], other_side * table[other_row, j, 1]
            between_x = x + ahead * other_cos - left * other_sin
            between_y = y - (ahead * other_sin + left * other_cos)
            radii = table[row, i, 2] + table[other_row, j, 2]
            if between_x * between_x + between_y * between_y < radii * radii:
                return True
    return False


@leaf_kernel
def disc_orientation(discs, picture_and_heading):  # type: ignore[no-untyped-def]
    """Return how the discs of a picture lie: table row, side, cosine and sine of the heading.

    picture_and_heading: film row, or −1 − number of a sprite, and heading in degrees. The side is
    −1 for a mirror image, whose left is right; else 1.
    """
    number, angle = picture_and_heading[0], np.radians(picture_and_heading[1])
    side = 1.0
    if number < 0:
        number = discs.frames - 1 - number
    elif number >= discs.frames:
        number, side = number - discs.frames, -1.0
    return number, side, np.cos(angle), np.sin(angle)


@leaf_kernel
def count_clear_ticks(company: Company, pictures: Ints, trajectory: Floats, start_tick: int) -> int:
    """Return how many ticks of a trajectory (n, 3), begun at a tick, meet no other fish.

    pictures (n,): film rows, or −1 − number of a sprite; trajectory: x, y px, heading from
    `start_tick` on.
    """
    for t in range(len(trajectory)):
        x, y, heading = trajectory[t, 0], trajectory[t, 1], trajectory[t, 2]
        if not is_clear_of_fish(company, pictures[t], x, y, heading, start_tick + t):
            return t
    return len(trajectory)


@leaf_kernel
def can_stay(company: Company, picture: int, pose, tick: int) -> bool:  # type: ignore[no-untyped-def]
    """Return whether a picture that stays at a pose meets no other fish from a tick on.

    picture: film row, or −1 − number of a sprite; pose: x, y px, heading.
    """
    last = max(company.start + company.places.shape[0] - 1, tick)
    while tick <= last and is_clear_of_fish(company, picture, pose[0], pose[1], pose[2], tick):
        tick += 1
    return tick > last


@leaf_kernel
def count_lasting_ticks(
    company: Company, pictures: Ints, trajectory: Floats, start_tick: int
) -> int:
    """Return how many ticks of a trajectory (n, 3) a fish can swim, and then stay, clear of others.

    pictures (n,): film rows, or −1 − number of a sprite; trajectory: x, y px, heading from
    `start_tick` on.
    """
    ticks = count_clear_ticks(company, pictures, trajectory, start_tick)
    while ticks > 0 and not can_stay(
        company, pictures[ticks - 1], trajectory[ticks - 1], start_tick + ticks - 1
    ):
        ticks -= 1
    return ticks
