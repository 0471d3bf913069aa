"""Place a recorded track in the tank: scale its points, and move them inside."""

import numpy as np
import scipy

from finloop.base.arrays import Floats, Ints, Mask, Points
from finloop.base.errors import FinloopError
from finloop.retarget.settings import RetargetSettings
from finloop.retarget.track import Track

_CELLS = 240  # cells per side of the coarse map on which places are tried first
_CLEAR = 0.5  # body lengths; a point nearer to the wall costs up to 1
_ROUNDS = 12  # of halving, to find how much smaller a path has to be


def track_scale(track: Track, length_px: float, p: RetargetSettings) -> float:
    """Return how many px of the tank one px of a recorded track becomes.

    length_px: on this film's fish, the length of what `track.length_px` measures. FinloopError if
    the track has no length.
    """
    if p.scale != "auto":
        return float(p.scale)
    if not track.length_px:
        raise FinloopError(
            f"{track.name} has a single point, and so no body length",
            "head and tail of the animal, or the scale of its pixels in this tank",
            "name head and tail (retarget.body_keypoints), or set retarget.scale: the fish's body "
            "length divided by the animal's, both in px",
        )
    return length_px / track.length_px


def find_points_outside(points: Points, arena: Mask) -> Mask:
    """Return a mask (…) of the points (…, 2) px that lie outside the arena (h, w)."""
    column, row = np.moveaxis(_round_to_pixels(points), -1, 0)
    in_picture = (row >= 0) & (row < arena.shape[0]) & (column >= 0) & (column < arena.shape[1])
    inside = arena[np.where(in_picture, row, 0), np.where(in_picture, column, 0)]
    return ~(in_picture & inside)


def _round_to_pixels(points: Points) -> Ints:
    """Return the pixel (…, 2) that contains each point (…, 2) px."""
    return np.floor(points + 0.5).astype(np.int64)


def find_placement(
    bodies: Points, arena: Mask, length_px: float, p: RetargetSettings
) -> tuple[Floats, float]:
    """Return the shift (2,) px and the scaling that bring a path into the tank.

    bodies (T, k, 2) px: the drawn points of the animal, which keeps its size on a smaller path;
    arena (h, w): True inside; length_px: body length. The scaling is 1 unless the placement is
    "shrink"; placement "given" moves nothing. FinloopError if the path fits nowhere.
    """
    if p.placement == "given":
        return np.zeros(2), 1.0
    shift = find_shift_into(bodies, arena, length_px)
    if shift is not None:
        return shift, 1.0
    if p.placement == "fit":
        tank_px = np.argwhere(arena)[:, ::-1].astype(float)
        raise FinloopError(
            f"the path with the fish's body is {_format_size(bodies, length_px)} body lengths "
            f"large, the tank {_format_size(tank_px, length_px)}: the path fits nowhere",
            "a path that fits into the tank",
            "take a part of the track (retarget.start_s, end_s), a smaller path "
            "(retarget.placement=shrink), or let it leave the tank (retarget.placement=given)",
        )
    # Bisection: the largest path that fits, between a point and the whole path.
    fits, too_large = 0.0, 1.0
    best = find_shift_into(shrink_path(bodies, fits), arena, length_px)
    if best is None:
        raise FinloopError(
            "the fish does not fit into the tank, even if its path shrinks to a point",
            "a tank larger than the fish",
            "give the arena its real size (clip.arena), or let the fish leave the tank "
            "(retarget.placement=given)",
        )
    for _ in range(_ROUNDS):
        middle = (fits + too_large) / 2
        shift = find_shift_into(shrink_path(bodies, middle), arena, length_px)
        if shift is None:
            too_large = middle
        else:
            fits, best = middle, shift
    return best, fits


def shrink_path(bodies: Points, size: float) -> Points:
    """Return bodies (T, k, 2) of unchanged size on a path that is `size` times as large."""
    centres = bodies.mean(1, keepdims=True)
    return bodies + (size - 1) * (centres - centres.mean(0))


def _format_size(points: Points, length_px: float) -> str:
    """Return width and height of points (…, 2) px as a text, in body lengths."""
    wide, high = np.ptp(points.reshape(-1, 2), axis=0) / length_px
    return f"{wide:.1f} × {high:.1f}"


def find_shift_into(bodies: Points, arena: Mask, length_px: float) -> Floats | None:
    """Return the shift (x, y) in whole px that moves bodies (T, k, 2) into the arena; None if none.

    length_px: body length. Of the shifts that leave no point outside, the one with the points
    farthest from the walls is taken. Shifts by whole cells of a coarse map are tried first, and
    where none of them fits, every shift by whole px.
    """
    pixels = _round_to_pixels(bodies.reshape(-1, 2))
    # A point costs 1 at a wall, nothing `_CLEAR` body lengths away; the picture's edge is a wall.
    from_wall_px = scipy.ndimage.distance_transform_edt(np.pad(arena, 1))[1:-1, 1:-1]
    wall_cost = np.maximum(0.0, 1 - from_wall_px / (_CLEAR * length_px))
    coarse = -(-max(arena.shape) // _CELLS)  # side of a cell, rounded up
    for cell in sorted({coarse, 1}, reverse=True):
        shift = _find_shift_by_cells(pixels, arena, wall_cost, cell)
        if shift is not None:
            return shift
    return None


def _find_shift_by_cells(pixels: Ints, arena: Mask, wall_cost: Floats, cell: int) -> Floats | None:
    """Return the best shift (x, y) [px], in steps of a cell, of pixels into the arena, or None.

    cell: side of a cell, px; wall_cost (h, w): of each pixel, for being near a wall. Two
    correlations try all shifts at once: one counts the points outside, the other sums the cost. A
    cell that is partly outside counts as outside.
    """
    inside = _cut_into_cells(arena.astype(float), cell).min((1, 3)) > 0
    cells = pixels // cell
    first_cell = cells.min(0)
    column, row = (cells - first_cell).T
    rows, columns = row.max() + 1, column.max() + 1
    if rows > inside.shape[0] or columns > inside.shape[1]:
        return None
    points_in_cell = np.zeros((rows, columns))
    np.add.at(points_in_cell, (row, column), 1.0)
    is_used = (points_in_cell > 0).astype(float)
    fits = np.rint(scipy.signal.correlate(1.0 - inside, is_used, mode="valid")) == 0
    if not fits.any():
        return None
    cell_cost = _cut_into_cells(wall_cost, cell).mean((1, 3))
    cost = scipy.signal.correlate(cell_cost, points_in_cell, mode="valid")
    middle = (np.array(cost.shape) - 1) / 2
    from_middle = np.hypot(*(np.indices(cost.shape) - middle[:, None, None]))
    # Of shifts that cost the same, the one nearest to the middle of the tank.
    cost = np.maximum(cost, 0) + 1e-6 * len(pixels) * from_middle
    best = np.unravel_index(np.where(fits, cost, np.inf).argmin(), cost.shape)
    return cell * (np.array(best[::-1]) - first_cell).astype(float)


def _cut_into_cells(values: Floats, cell: int) -> Floats:
    """Return a map (h, w) as cells of `cell` px: (rows, cell, columns, cell), padded with 0."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % cell), (0, -width % cell)))
    return padded.reshape(padded.shape[0] // cell, cell, -1, cell)
