"""Where the other fish of a tank will be, and whether a fish keeps clear of them, compiled.

A few discs that cover an outline of the film stand for the body. A fish knows what the others have
planned; after that they count as staying in place. Its plans meet none of them, and it stops only
where it can stay. So a fish that cannot swim on can stay in place, and no two bodies overlap. Two
things are left out: what joins bend and turn for some ticks, and the partner of a cross-fade.

A picture has a number: the row of a frame in the motion graph, or −1 − the number of a sprite.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from finloop.base.arrays import Floats, Ints, Reals
from finloop.base.kernel import kernel, leaf_kernel
from finloop.base.parallel import map_row_blocks

_DISCS = 6  # of a body, from tail to head: more cover it more tightly, and cost the search time
_TICKS = 64  # for which planned trajectories have memory at first; it grows
_EDGE_PX = 1.5  # added to radii: pixels of both bodies have corners


class Outlines(Protocol):
    """Outlines (n, p, 2) that are read in slices: an array, or one that stays in a file."""

    def __len__(self) -> int:
        """Return the number n of outlines."""

    def __getitem__(self, rows: slice, /) -> Reals:
        """Return the outlines of a slice of pictures."""


class Discs(NamedTuple):
    """The discs that together cover the body in every picture.

    table (n + s, k, 3): of n frames of the film, then of s sprites: px ahead of the mass centre and
    to its left, and the radius; frames: n; reach: px from the centre beyond which no disc reaches.
    """

    table: Floats
    frames: int
    reach: float


class Obstacles(NamedTuple):
    """The m other fish of a tank and their plans, as a fish knows them when it decides.

    start: the first tick that is known, as the deciding fish counts; places (n, m, 4): x, y px,
    heading in degrees and the number of the picture at every tick from then on; the last ones count
    for ever; discs: that cover the pictures; until: the last tick at which a search considers them;
    near_count: a search considers only the first `near_count` fish.
    """

    start: int
    places: Floats
    discs: Discs
    until: int = 0
    near_count: int = 0


NO_DISCS = Discs(np.zeros((0, _DISCS, 3)), 0, 0.0)
NO_OBSTACLES = Obstacles(0, np.zeros((1, 0, 4)), NO_DISCS)


class Plans:
    """What the fish of a tank have planned: the last trajectory of each, and its first tick.

    Fish are numbered from 0; a fish that has not planned yet is not there. A trajectory (n, 4) has
    the columns x, y px, heading in degrees, and number of the picture.
    """

    def __init__(self, fish_count: int) -> None:
        """Make memory for the plans of some fish, none of which has planned yet."""
        self._trajectories = np.zeros((fish_count, _TICKS, 4))
        self._begins, self._ticks = np.zeros(fish_count, np.int64), np.zeros(fish_count, np.int64)

    @classmethod
    def from_paths(cls, trajectories: Sequence[Floats], start_tick: int) -> "Plans":
        """Return the plans of fish whose trajectories (n, 4), one a fish, all begin at one tick."""
        plans = cls(len(trajectories))
        for number, trajectory in enumerate(trajectories):
            plans.store(number, start_tick, trajectory)
        return plans

    def store(self, fish: int, start_tick: int, trajectory: Floats) -> None:
        """Store what a fish plans from a tick on, in place of its earlier plan.

        trajectory (n, 4): x, y px, heading in degrees and number of the picture, n ≥ 1.
        """
        lacking = len(trajectory) - self._trajectories.shape[1]
        if lacking > 0:
            self._trajectories = np.pad(self._trajectories, [(0, 0), (0, lacking), (0, 0)])
        self._trajectories[fish, : len(trajectory)] = trajectory
        self._begins[fish], self._ticks[fish] = start_tick, len(trajectory)

    def places_of_others(self, fish: int, tick: int) -> Floats:
        """Return where all fish but `fish` will be from a tick on: (n, m, 4), m fish at n ticks.

        The columns are x, y px, heading in degrees and number of the picture. The last tick is
        that of the longest plan; a fish whose plan ends before stays where the plan ends. A fish
        that has not planned yet is left out.
        """
        return np.asarray(
            _places_of_others(self._trajectories, self._begins, self._ticks, fish, tick)
        )

    def fish_in_column(self, fish: int, column: int) -> int:
        """Return the number of the fish in column `column` of `places_of_others(fish, …)`."""
        planned = np.flatnonzero(self._ticks > 0)
        return int(planned[planned != fish][column])

    def has_planned(self, fish: int) -> bool:
        """Return whether a plan of fish number `fish` is stored."""
        return bool(self._ticks[fish])

    def pose_at(self, fish: int, tick: int) -> Floats:
        """Return what a fish's plan has at a tick, or at the nearest one that it has: (4,).

        These are x, y px, heading [°] and number of the picture.
        """
        row = min(max(tick - self._begins[fish], 0), self._ticks[fish] - 1)
        return np.asarray(self._trajectories[fish, row])


def make_obstacles(
    other_plans: Floats, start_tick: int, discs: Discs, ticks_after: int
) -> Obstacles:
    """Return the other fish of the tank as obstacles for a fish that decides at a tick.

    start_tick: at which the fish decides; other_plans (n, m, 4): x, y px, heading, picture of m
    others at n ticks; ticks_after: for how many ticks after their plans a search considers them. It
    considers all m, until `sort_near_first` leaves out those that are far away.
    """
    ticks, count = other_plans.shape[:2]
    last_tick = start_tick + ticks - 1 + ticks_after
    return Obstacles(start_tick, other_plans, discs, until=last_tick, near_count=count)


@kernel
def _places_of_others(
    trajectories: Floats, begins: Ints, ticks: Ints, fish: int, tick: int
) -> Floats:
    """Return where all fish but `fish` will be from `tick` on, as planned: (n, m, 4).

    See `Plans.places_of_others`. trajectories (fish, t, 4): of all fish; begins, ticks (fish,):
    first tick and duration of each, 0 long where a fish has not planned yet. Compiled, as every
    decision of every fish needs it.
    """
    others = [k for k in range(len(ticks)) if k != fish and ticks[k] > 0]
    count = 1
    for k in others:
        count = max(count, begins[k] + ticks[k] - tick)
    places = np.empty((count, len(others), 4))
    for m in range(len(others)):
        k = others[m]
        for t in range(count):
            row = min(max(tick + t - begins[k], 0), ticks[k] - 1)
            for c in range(4):
                places[t, m, c] = trajectories[k, row, c]
    return places


@kernel
def sort_near_first(obstacles: Obstacles, x: float, y: float, farthest_px: Floats) -> Obstacles:
    """Return obstacles sorted: first the fish that a fish at x, y px can meet during a search.

    farthest_px (t,): how far a fish moves in 0, 1, 2 … ticks at most; after these it goes on at
    their mean speed. `near_count` is set to the number of those fish.
    """
    known_ticks = len(farthest_px) - 1
    px_per_tick = farthest_px[known_ticks] / known_ticks
    ticks, count = obstacles.places.shape[:2]
    near_count, first_far, order = 0, count, np.empty(count, np.int64)
    for k in range(count):
        is_near = False
        for t in range(ticks):
            # For how many ticks the fish swims before the other's place at this tick ends: places
            # are one tick ahead of the fish; the last counts until the search ends.
            swim_ticks = 1 + (t if t < ticks - 1 else obstacles.until - obstacles.start)
            ticks_beyond = max(swim_ticks - known_ticks, 0)
            swims_px = farthest_px[swim_ticks - ticks_beyond] + ticks_beyond * px_per_tick
            dx, dy = obstacles.places[t, k, 0] - x, obstacles.places[t, k, 1] - y
            is_near = dx * dx + dy * dy < (2 * obstacles.discs.reach + swims_px) ** 2
            if is_near:
                break
        if is_near:
            order[near_count] = k
            near_count += 1
        else:
            first_far -= 1
            order[first_far] = k
    places = np.empty_like(obstacles.places)
    for t in range(ticks):
        for k in range(count):
            places[t, k] = obstacles.places[t, order[k]]
    return Obstacles(obstacles.start, places, obstacles.discs, obstacles.until, near_count)


def cover_with_discs(frame_outlines: Outlines, sprite_outlines: Sequence[Floats]) -> Discs:
    """Return the discs that cover outlines, of frames (n, p, 2) and then of sprites, (p, 2) each.

    Outlines are px ahead of and to the left of the mass centre.
    """
    frame_discs = map_row_blocks(
        lambda rows: _disc_table(frame_outlines[rows]), len(frame_outlines)
    )
    sprite_discs = [_disc_table(outline[None]) for outline in sprite_outlines]
    table = np.concatenate([*frame_discs, *sprite_discs])
    reach = np.hypot(table[..., 0], table[..., 1]) + table[..., 2]
    return Discs(table, len(frame_outlines), float(reach.max()))


def _disc_table(outlines: Reals) -> Floats:
    """Call the kernel `_cover_outlines` with outlines (n, p, 2) of any type; return its discs."""
    return np.asarray(_cover_outlines(np.ascontiguousarray(outlines, float)))


@kernel
def _cover_outlines(outlines: Reals) -> Floats:
    """Return the discs (n, k, 3) that cover outlines (n, p, 2), one for each slice of the length.

    A disc: px ahead of and to the left of the mass centre, and radius. The outline is cut across
    into k slices of equal length.
    """
    discs, extents = np.empty((len(outlines), _DISCS, 3)), np.empty((_DISCS, 2))
    for n in range(len(outlines)):
        outline = outlines[n]
        back = outline[:, 0].min()
        thickness = max(outline[:, 0].max() - back, 1e-9) / _DISCS  # of a slice, along the body
        extents[:, 0], extents[:, 1] = np.inf, -np.inf
        for p in range(len(outline)):
            before, point = outline[p - 1], outline[p]
            ahead = (before[0] - back) / thickness, (point[0] - back) / thickness
            _widen_slices(extents, ahead, (before[1], point[1]))
        for k in range(_DISCS):
            right, left = extents[k, 0], extents[k, 1]
            if right > left:  # no side of the outline is in the slice
                right, left = 0.0, 0.0
            discs[n, k, 0], discs[n, k, 1] = back + (k + 0.5) * thickness, (right + left) / 2
            discs[n, k, 2] = np.hypot(left - right, thickness) / 2 + _EDGE_PX
    return discs


@leaf_kernel
def _widen_slices(extents: Floats, ahead: tuple[float, float], left: tuple[float, float]) -> None:
    """Widen the slices of a body, in place, where one edge of its outline crosses them.

    extents (k, 2): least and most px to the left in each slice. ahead, left: pairs, one value per
    end of the edge; ahead in slices from the back, left in px.
    """
    back, front = min(ahead), max(ahead)
    for k in range(min(int(back), _DISCS - 1), min(int(front), _DISCS - 1) + 1):
        for end in range(2):  # where the side enters and leaves the slice
            share = float(end)
            if back < front:
                share = (min(max(float(k + end), back), front) - ahead[0]) / (ahead[1] - ahead[0])
            edge_left = left[0] + share * (left[1] - left[0])
            extents[k, 0] = min(extents[k, 0], edge_left)
            extents[k, 1] = max(extents[k, 1], edge_left)


@leaf_kernel
def is_clear_of_fish(
    obstacles: Obstacles, picture: int, x: float, y: float, heading: float, tick: int
) -> bool:
    """Return whether a picture at x, y px and a heading, degrees, meets no other fish at a tick."""
    return _is_clear_of_first(obstacles, obstacles.places.shape[1], picture, (x, y, heading), tick)


@leaf_kernel
def _is_clear_of_first(
    obstacles: Obstacles, count: int, picture: int, pose: tuple[float, float, float], tick: int
) -> bool:
    """Return whether a picture at a pose meets none of the first `count` fish at a tick.

    picture: its number; pose: x, y px, heading in degrees.
    """
    others, near_px2, (x, y, heading) = obstacles.places, 4.0 * obstacles.discs.reach**2, pose
    if count == 0:
        return True
    t = min(max(tick - obstacles.start, 0), others.shape[0] - 1)
    for k in range(count):
        dx, dy = others[t, k, 0] - x, others[t, k, 1] - y
        if dx * dx + dy * dy < near_px2:
            other, other_heading = int(others[t, k, 3]), others[t, k, 2]
            if _do_discs_overlap(obstacles.discs, picture, heading, other, other_heading, dx, dy):
                return False
    return True


@leaf_kernel
def is_clear_in_search(
    obstacles: Obstacles, picture: int, x: float, y: float, heading: float, tick: int
) -> bool:
    """Return whether a picture at x, y px and a heading meets no fish that a search considers.

    picture: its number; heading: degrees. Only the first `obstacles.near_count` fish count, and
    only from tick `obstacles.start` to `obstacles.until`; at other ticks the result is True.
    """
    pose, unknown = (x, y, heading), tick < obstacles.start or tick > obstacles.until
    return unknown or _is_clear_of_first(obstacles, obstacles.near_count, picture, pose, tick)


@leaf_kernel
def _do_discs_overlap(
    discs: Discs, picture: int, heading: float, other: int, other_heading: float, dx: float,
    dy: float,
) -> bool:  # fmt: skip
    """Return whether the discs of two pictures overlap, the other one dx, dy px (y down) away.

    picture, other: their numbers; heading, other_heading: degrees.
    """
    row, side, cos, sin = disc_orientation(discs, picture, heading)
    other_row, other_side, other_cos, other_sin = disc_orientation(discs, other, other_heading)
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
def disc_orientation(discs: Discs, picture: int, heading: float) -> tuple[int, float, float, float]:
    """Return where a picture's discs are in the table, and how to turn them: row, side, cos, sin.

    picture: a row of the film; `discs.frames` + row for its mirror image; −1 − s for sprite s,
    which stands in `discs.table` after the rows of the film. The side is −1 for a mirror image,
    whose left is right; else 1. cos, sin: of the heading, which is given in degrees.
    """
    table_row, side, angle = picture, 1.0, np.radians(heading)
    if picture < 0:
        table_row = discs.frames - 1 - picture
    elif picture >= discs.frames:
        table_row, side = picture - discs.frames, -1.0
    return table_row, side, np.cos(angle), np.sin(angle)


@leaf_kernel
def count_ticks_before_meeting(
    obstacles: Obstacles, pictures: Ints, trajectory: Floats, start_tick: int
) -> int:
    """Return how many ticks of a trajectory (n, 3) pass before it first meets another fish.

    The result is n if it meets none. pictures (n,): numbers of the pictures shown; trajectory: x, y
    px, heading in degrees at each tick from `start_tick` on.
    """
    for t in range(len(trajectory)):
        x, y, heading = trajectory[t, 0], trajectory[t, 1], trajectory[t, 2]
        if not is_clear_of_fish(obstacles, pictures[t], x, y, heading, start_tick + t):
            return t
    return len(trajectory)


@leaf_kernel
def can_stay(
    obstacles: Obstacles, picture: int, pose: tuple[float, float, float] | Floats, tick: int
) -> bool:
    """Return whether a picture can stay at a pose from a tick on and never meet another fish.

    picture: its number; pose: x, y px, heading in degrees. Walls are not tested.
    """
    # After their last known tick the others stay, too: no later one needs a test.
    last = max(obstacles.start + obstacles.places.shape[0] - 1, tick)
    while tick <= last and is_clear_of_fish(obstacles, picture, pose[0], pose[1], pose[2], tick):
        tick += 1
    return tick > last


@leaf_kernel
def count_lasting_ticks(
    obstacles: Obstacles, pictures: Ints, trajectory: Floats, start_tick: int
) -> int:
    """Return the most ticks of a trajectory (n, 3) after which a fish can stop, clear of others.

    pictures (n,): numbers of the pictures shown; trajectory: x, y px, heading in degrees at each
    tick from `start_tick` on.
    """
    ticks = count_ticks_before_meeting(obstacles, pictures, trajectory, start_tick)
    while ticks > 0 and not can_stay(
        obstacles, pictures[ticks - 1], trajectory[ticks - 1], start_tick + ticks - 1
    ):
        ticks -= 1
    return ticks
