"""The tank: where the centre of a fish may be, how to swim round a wall, what is in sight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock

import cv2
import numpy as np
import scipy
import skimage
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Picture, Reals
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel, leaf_kernel
from finloop.base.parallel import map_row_blocks
from finloop.edit.schema import Goal

_SIGHT_STEP_PX = 2.0  # step along a line of sight
_LEAST_FILMED = 0.25
"""Share of the picture that animals fill at least. Trout in a current: 0.10, sunfish 0.37, mouse
0.45."""
_COMPLETE = 2 / 3
"""Share of the filmed area that half of the outlines fill at least, where more film would hardly
show more. Carp of 20 s: 0.52, of 60 s 0.79, mouse 0.91."""
_ALIKE = 0.5
"""Share of the floor beyond that looks the same at least. Pieces of the carp: 0.86-0.91, mouse
0.16-0.36."""
_MOST_REACH = 0.5  # of the distance from wall to middle: a fish that reaches farther cannot turn
_PATH_LOCK = Lock()
_CELLS = 200  # cells a side, at most, of the map on which a path round a thick wall is sought
_CELLS_TO_WALL = 6  # cells, at most, from a legal pixel to the wall: with 3, arcs block the sight


@dataclass(frozen=True)
class Tank:
    """Where animals can be, and where their centre can be.

    arena (h, w): where animals can be; legal (h, w): where the centre of a fish can be, so that no
    part of it leaves the arena; nearest (2, h, w): row and column of the legal pixel nearest to
    each pixel.
    """

    arena: Mask
    legal: Mask
    nearest: NDArray[np.int32]

    @cached_property
    def depth_px(self) -> NDArray[np.float32]:
        """Return how far (h, w), px, each pixel is from the nearest one outside the arena."""
        return _depth_px(self.arena)

    @property
    def box_px(self) -> tuple[int, int, int, int]:
        """Return the box around the tank's pixels, px: left, top, right, bottom."""
        rows, columns = (np.flatnonzero(self.arena.any(axis)) for axis in (1, 0))
        return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])

    def nearest_legal_point(self, x: float, y: float) -> tuple[float, float]:
        """Return x, y px if the fish's centre may be there, else the nearest pixel where it may."""
        row, column = self._nearest_pixel(x, y)
        if self.legal[row, column]:
            return x, y
        return float(self.nearest[1, row, column]), float(self.nearest[0, row, column])

    def _nearest_pixel(self, x: float, y: float) -> tuple[int, int]:
        """Return row and column of the pixel of the picture nearest to a point x, y px."""
        height, width = self.legal.shape
        return min(max(round(y), 0), height - 1), min(max(round(x), 0), width - 1)

    def waypoint(self, x: float, y: float, to_x: float, to_y: float) -> tuple[float, float]:
        """Return the point x, y px to swim straight to: the target if in sight, else a waypoint.

        x, y, to_x, to_y: px of the fish and of the target. The waypoint is the farthest in sight of
        the shortest path round the walls, on a coarse map.
        """
        if self.can_swim_straight(x, y, to_x, to_y):
            return to_x, to_y
        cell, paths = self._coarse_map
        start, end = (
            tuple(side // cell for side in self._nearest_pixel(*self.nearest_legal_point(*place)))
            for place in ((x, y), (to_x, to_y))
        )
        with _PATH_LOCK:  # a search keeps its state in `paths`, which threads share
            paths.find_costs([start], [end])
            cells = np.array(paths.traceback(end))  # (row, column), from the fish to the target
        # Of each cell the legal pixel nearest to its middle.
        rows, columns = np.minimum(cells * cell + cell // 2, np.array(self.legal.shape) - 1).T
        points = self.nearest[::-1, rows, columns].T.astype(float)
        points[-1] = to_x, to_y
        way_x, way_y = points[_farthest_in_sight(self.legal, self.arena, x, y, points)]
        return float(way_x), float(way_y)

    @cached_property
    def _coarse_map(self) -> tuple[int, skimage.graph.MCP_Geometric]:
        """Return the coarse map of the tank: size of a cell, px, and solver of shortest paths.

        A path may enter every cell that has a legal pixel, so each of these can be reached. Where
        it can, it keeps to cells of legal pixels alone: a fish at a wall has no room to turn. Cells
        are at most 200 a side, or more where walls are so thin that larger ones would bridge them.
        """
        to_wall_px = float(self.depth_px[self.legal].min())
        wanted = max(math.ceil(max(self.legal.shape) / _CELLS), int(to_wall_px / _CELLS_TO_WALL))
        # Legal pixels on both sides of a wall are twice `to_wall_px` apart: too far for cells that
        # touch.
        cell = max(1, min(wanted, int(to_wall_px / math.sqrt(2))))
        padded = np.pad(self.legal, [(0, -side % cell) for side in self.legal.shape])
        blocks = padded.reshape(len(padded) // cell, cell, -1, cell)
        # Along a wall only for want of room, and through it only if nothing else leads there.
        cost = np.where(blocks.all(axis=(1, 3)), 1.0, np.where(blocks.any(axis=(1, 3)), 10.0, 1e6))
        return cell, skimage.graph.MCP_Geometric(cost)

    def can_swim_straight(self, x: float, y: float, to_x: float, to_y: float) -> bool:
        """Return whether no wall is on the straight line from (x, y) px to (to_x, to_y) px."""
        return bool(is_line_legal(self.legal, self.arena, x, y, to_x, to_y))

    def random_point(self, rng: np.random.Generator) -> tuple[float, float]:
        """Return a random pixel x, y where the fish's centre may be; all are equally likely."""
        height, width = self.legal.shape
        while True:
            row, column = int(rng.integers(height)), int(rng.integers(width))
            if self.legal[row, column]:
                return float(column), float(row)


@leaf_kernel
def is_legal_point(legal: Mask, x: float, y: float) -> bool:
    """Return whether a point x, y px lies on a pixel of `legal` (h, w), where a fish may be."""
    column, row = round(x), round(y)
    return 0 <= row < legal.shape[0] and 0 <= column < legal.shape[1] and bool(legal[row, column])


def are_points_inside(mask: Mask, x: Floats, y: Floats) -> Mask:
    """Return which points x, y px (…) lie on a true pixel of a picture's mask (h, w), as (…)."""
    column, row = np.round(x).astype(int), np.round(y).astype(int)
    inside = (row >= 0) & (row < mask.shape[0]) & (column >= 0) & (column < mask.shape[1])
    inside[inside] = mask[row[inside], column[inside]]
    return np.asarray(inside)


@leaf_kernel
def is_line_legal(legal: Mask, arena: Mask, x: float, y: float, to_x: float, to_y: float) -> bool:
    """Return whether a fish can swim straight between two points, px, without leaving `legal`.

    legal (h, w): where its centre may be; arena (h, w): the tank. The line may begin beside a wall:
    up to the first legal point it need only be in the arena.
    """
    distance = np.hypot(to_x - x, to_y - y)
    steps, was_legal = int(distance / _SIGHT_STEP_PX) + 1, False
    for i in range(steps + 1):
        share = i / steps
        point_x, point_y = x + share * (to_x - x), y + share * (to_y - y)
        is_legal = is_legal_point(legal, point_x, point_y)
        if not is_legal and (was_legal or not is_legal_point(arena, point_x, point_y)):
            return False
        was_legal = was_legal or is_legal
    return was_legal


@kernel
def _farthest_in_sight(legal: Mask, arena: Mask, x: float, y: float, points: Floats) -> int:
    """Return the index of the last point to which a fish at x, y px can swim straight.

    It is the second point at least, as the first is beside the fish. legal, arena (h, w); points
    (n, 2): x, y px.
    """
    number = len(points) - 1
    while number > 1 and not is_line_legal(
        legal, arena, x, y, points[number, 0], points[number, 1]
    ):
        number -= 1
    return number


def make_tank(arena: Mask, reach_px: float) -> Tank:
    """Return the tank of a fish that reaches up to `reach_px` from its centre.

    arena (h, w): true where animals can be. Of separate pools the largest is taken. FinloopError if
    such a fish does not fit in.
    """
    pool, pool_count = scipy.ndimage.label(_legal_centres(arena, reach_px))
    if pool_count == 0:
        rows, columns = (int(arena.any(axis).sum()) for axis in (1, 0))
        raise FinloopError(
            f"the tank ({columns} × {rows} px) is smaller than the fish, which reaches "
            f"{reach_px:.0f} px from its centre",
            f"a tank at least {2 * reach_px + 4:.0f} px wide everywhere",
            "give the arena its real size (clip.arena), or draw fish smaller (animate.fish_scale)",
        )
    legal = pool == 1 + np.argmax(np.bincount(pool.ravel())[1:])
    nearest = scipy.ndimage.distance_transform_edt(
        ~legal, return_distances=False, return_indices=True
    )
    return Tank(arena, legal, nearest.astype(np.int32))


def _depth_px(arena: Mask) -> NDArray[np.float32]:
    """Return how far (h, w), px, each pixel of an arena is from the nearest one outside."""
    padded = np.pad(arena.astype(np.uint8), 1)  # beyond the picture is outside
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(depth[1:-1, 1:-1], np.float32)


@dataclass(frozen=True)
class FilmHulls:
    """Convex hulls, as corners in whole px, of all outlines of a film and of those of its halves.

    outlines_px (n, k, 2): x, y as filmed. The hulls are computed at their first use, as the modes
    of one film share them.
    """

    outlines_px: Reals

    @cached_property
    def whole_film(self) -> NDArray[np.int32]:
        """Return the corners (c, 1, 2), px, of the convex hull of all outlines."""
        hulls = self.halves or [_convex_hull(self.outlines_px)]
        return np.asarray(cv2.convexHull(np.concatenate(hulls)), np.int32)

    @cached_property
    def halves(self) -> list[NDArray[np.int32]]:
        """Return the corners of the hulls of both halves of the outlines; [] for one outline."""
        half = len(self.outlines_px) // 2
        parts = (self.outlines_px[:half], self.outlines_px[half:]) if half else ()
        return [_convex_hull(part) for part in parts]

    @property
    def show_whole_tank(self) -> bool:
        """Return whether the film shows all of the tank: half of it fills nearly as much area.

        The mean area of the two halves is compared with that of the whole. If False, a longer film
        would show more of the tank, or the film has a single outline.
        """
        half_areas = [cv2.contourArea(hull) for hull in self.halves]
        return len(half_areas) > 0 and bool(
            np.mean(half_areas) >= _COMPLETE * cv2.contourArea(self.whole_film)
        )


def is_floor_alike_beyond(floor: Picture, filmed_area: Mask) -> bool:
    """Return whether the floor looks the same beyond the area where animals were filmed.

    floor: (h, w) or (h, w, 3), without animals; filmed_area (h, w). It looks the same if at least
    half of the grey values beyond are within the range (5-95 %) of those in the area, widened by
    that range on either side. False if nothing is beyond.
    """
    if filmed_area.all():
        return False
    grey = floor if floor.ndim == 2 else floor.mean(axis=2)
    low, high = np.quantile(grey[filmed_area], [0.05, 0.95])
    beyond = grey[~filmed_area]
    # The range low … high, widened by high − low on either side.
    alike = (beyond >= 2 * low - high) & (beyond <= 2 * high - low)
    return bool(alike.mean() >= _ALIKE)


def _convex_hull(outlines_px: Reals) -> NDArray[np.int32]:
    """Return the corners (c, 1, 2), whole px, of the convex hull of all outlines (n, k, 2) px.

    OpenCV gets only the outermost points of each row of pixels, which is quicker.
    """
    corners = map_row_blocks(
        lambda rows: _row_extremes(np.asarray(outlines_px[rows]).reshape(-1, 2)), len(outlines_px)
    )
    return np.asarray(cv2.convexHull(np.concatenate(corners)), np.int32)


@kernel
def _row_extremes(points: Reals) -> NDArray[np.int32]:
    """Return the leftmost and rightmost point, (k, 2) px, of each row of pixels that has points.

    points (n, 2): x, y px, which are rounded to whole px. Only such points can be corners of their
    convex hull. Computing it from all points instead takes 15 s for a million outlines.
    """
    first_row, last_row = np.inf, -np.inf
    for i in range(len(points)):
        first_row, last_row = min(first_row, points[i, 1]), max(last_row, points[i, 1])
    first_row = np.rint(first_row)
    ends = np.empty((int(np.rint(last_row) - first_row) + 1, 2))
    ends[:, 0], ends[:, 1] = np.inf, -np.inf
    for i in range(len(points)):
        x, row = np.rint(points[i, 0]), int(np.rint(points[i, 1]) - first_row)
        ends[row, 0], ends[row, 1] = min(ends[row, 0], x), max(ends[row, 1], x)
    filled = np.flatnonzero(ends[:, 0] <= ends[:, 1])
    corners = np.empty((2 * len(filled), 2), np.int32)
    for i in range(len(filled)):
        for side in range(2):
            corners[2 * i + side, 0] = ends[filled[i], side]
            corners[2 * i + side, 1] = first_row + filled[i]
    return corners


def tank_area(
    arena: Mask, hulls: FilmHulls, tank_setting: str, floor: Picture | None = None
) -> Mask:
    """Return the mask (h, w) of where a fish may be: the arena, or where animals were filmed.

    hulls: of the film's outlines; floor: the empty tank, None if unknown.
    tank_setting: "arena", "filmed" (the part where animals were filmed) or "auto". "auto" is the
    arena in three cases: it is less than the whole picture, that is, it was given; the animals
    filled less than a quarter of the picture, as in a current; or the film is too short (see
    `FilmHulls.show_whole_tank`), and the floor is known and looks the same beyond. Otherwise "auto"
    is the filmed part, as there may be no floor elsewhere.
    """
    if tank_setting == "arena" or (tank_setting == "auto" and not arena.all()):
        return arena
    in_hull = np.zeros(arena.shape, np.uint8)
    cv2.fillConvexPoly(in_hull, hulls.whole_film, 1)
    filmed = arena & in_hull.astype(bool)
    if tank_setting == "filmed":
        return filmed
    if filmed.mean() < _LEAST_FILMED:
        return arena
    if floor is None or hulls.show_whole_tank:
        return filmed
    return arena if is_floor_alike_beyond(floor, filmed) else filmed


def choose_fish_area(
    arena: Mask, hulls: FilmHulls, reach_px: float, tank_setting: str, floor: Picture | None = None
) -> Mask:
    """Return where a fish may be (h, w): `tank_area`, or the arena if "auto" leaves it no room.

    It has no room if it does not fit in: it reaches `reach_px` from its centre. hulls: of the
    film's outlines; tank_setting: "arena", "filmed" or "auto"; floor: the empty tank, None if
    unknown.
    """
    area = tank_area(arena, hulls, tank_setting, floor)
    return arena if tank_setting == "auto" and not _legal_centres(area, reach_px).any() else area


def scale_that_fits(area: Mask, reach_px: float) -> float:
    """Return the scale, drawn / filmed size, at most 1, at which a fish can turn in an area (h, w).

    reach_px: how far the fish as filmed reaches from its centre. The scale is 1, or less where the
    fish would reach farther than half of the distance from the wall to the area's middle.
    """
    return min(1.0, _MOST_REACH * float(_depth_px(area).max()) / reach_px)


def _legal_centres(arena: Mask, reach_px: float) -> Mask:
    """Return where the fish's centre may be (h, w): over `reach_px` from outside the arena."""
    return np.asarray(_depth_px(arena) > reach_px + 1)


def goal_name(number: int) -> str:
    """Return the name of goal number 0, 1, 2 …: A, B … Z, A2, B2 … ."""
    rounds, letter = divmod(number, 26)
    return chr(ord("A") + letter) + (str(rounds + 1) if rounds else "")


def place_goals(
    given_goals: Sequence[Sequence[float]], unit: str, tank: Tank, touch_px: float
) -> list[Goal]:
    """Return the goals of the parameters in px of the clip; FinloopError if any is bad.

    given_goals: [x, y] each; unit: "px", or "tank" for shares of the tank's width and height, from
    its upper left corner. A fish touches what is within `touch_px` of a legal centre. FinloopError,
    which names all, if there are no goals, or one is not x, y or cannot be reached.
    """
    left, top, right, bottom = tank.box_px
    wanted = f"one or more goals inside the tank, which is {left}-{right} × {top}-{bottom} px"
    if not given_goals:
        raise FinloopError(
            "animate.goals is empty", wanted, "name some: animate.goals=[[0.2,0.3],[0.8,0.7]]"
        )
    goals, problems = [], []
    for number, pair in enumerate(given_goals):
        name = goal_name(number)
        if len(pair) != 2:
            problems.append(f"{name}: {pair} is not x, y")
            continue
        x, y = map(float, pair)
        if unit == "tank":
            x, y = _goal_from_shares(x, y, tank, touch_px)
        goals.append(Goal(name, x, y))
        if not is_legal_point(tank.arena, x, y):
            problems.append(f"{name}: ({x:.0f}, {y:.0f}) px is outside the tank")
        elif _distance_to_legal(tank, x, y) > touch_px:
            problems.append(f"{name}: ({x:.0f}, {y:.0f}) px lies where the fish does not fit in")
    if problems:
        raise FinloopError(
            "animate.goals cannot be reached:\n    " + "\n    ".join(problems),
            wanted,
            "move the goals (animate.goals, animate.goal_unit), or raise animate.goal_radius_bl",
        )
    return goals


def _goal_from_shares(
    share_x: float, share_y: float, tank: Tank, touch_px: float
) -> tuple[float, float]:
    """Return x, y px of a goal in shares of the tank's width and height, moved into reach.

    Shares of 0-1 may lie outside the tank, as in the corner of a round one, or more than `touch_px`
    from a legal centre: then they are moved to the nearest legal centre. Shares below 0 or above 1
    are not moved.
    """
    left, top, right, bottom = tank.box_px
    x, y = left + share_x * (right - left), top + share_y * (bottom - top)
    in_reach = is_legal_point(tank.arena, x, y) and _distance_to_legal(tank, x, y) <= touch_px
    may_move = 0 <= share_x <= 1 and 0 <= share_y <= 1
    return tank.nearest_legal_point(x, y) if may_move and not in_reach else (x, y)


def _distance_to_legal(tank: Tank, x: float, y: float) -> float:
    """Return how many px a point x, y is from the nearest place where the fish's centre may be."""
    legal_x, legal_y = tank.nearest_legal_point(x, y)
    return float(np.hypot(legal_x - x, legal_y - y))
