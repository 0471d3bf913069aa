"""Whether a picture that is shown at a place is inside the tank, compiled.

Far from the walls every picture is, at every heading. Near them each disc of the body
(`finloop.animate.obstacles`) must be at least its radius from the wall. So a fish can swim along a
wall as near as the film's fish do, but cannot turn its side into it.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import Tank
from finloop.animate.obstacles import NO_DISCS, Discs, disc_orientation
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, leaf_kernel

_CELL_BITS = 4  # log₂ of the 16 px of a cell
_MARGIN_PX = 1.5  # of room beyond the edge of a disc; extraction drops silhouettes at the very edge
_PUSHES = 6  # steps in which a place is moved off the walls: a corner takes several


class Bounds(NamedTuple):
    """What keeps a fish inside the tank.

    roomy (h, w): where every picture fits, at every heading; roomy_cells: whether all pixels of a
    cell of 16 × 16 px are roomy; depth (h, w): how far the middle of each pixel is from the wall,
    px, < 0 outside; nearest (2, h, w): row and column of the roomy pixel nearest to each; discs: of
    the pictures; without any the fish keeps to where it is roomy.
    """

    roomy: Mask
    roomy_cells: Mask
    depth: NDArray[np.float32]
    nearest: NDArray[np.int32]
    discs: Discs


def tank_bounds(tank: Tank, discs: Discs = NO_DISCS) -> Bounds:
    """Return what keeps a fish inside a tank; without discs it keeps to `tank.legal`."""
    # How far pixels outside the arena are from it; beyond the picture all is outside.
    outside = np.pad((~tank.arena).astype(np.uint8), 1, constant_values=1)
    to_tank = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    # Cells of 16 × 16 px of which all pixels are roomy, that is where every picture fits.
    side = 1 << _CELL_BITS
    roomy = np.pad(tank.legal, [(0, -n % side) for n in tank.legal.shape], constant_values=True)
    cells = roomy.reshape(roomy.shape[0] // side, side, -1, side).all(axis=(1, 3))
    return Bounds(tank.legal, np.asarray(cells), tank.depth_px - to_tank, tank.nearest, discs)


@leaf_kernel
def _wall_distance(bounds, x: float, y: float) -> float:  # type: ignore[no-untyped-def]
    """Return how far a point x, y px is from the wall, px; < 0 outside the tank.

    bounds: `Bounds`. Beyond the picture the result falls by 1 with each px away from it.
    """
    height, width = bounds.depth.shape
    column, row = round(x), round(y)
    in_x, in_y = min(max(column, 0), width - 1), min(max(row, 0), height - 1)
    return float(bounds.depth[in_y, in_x]) - abs(column - in_x) - abs(row - in_y)


@leaf_kernel
def _worst_wall_overlap(bounds, picture: int, x: float, y: float, heading: float):  # type: ignore[no-untyped-def]
    """Return by how many px a picture comes too near to the wall, and x, y of its worst disc.

    Negative: there is room. A margin counts as wall. bounds: `Bounds`; picture: as in
    `disc_orientation`; x, y: its mass centre, px; heading: degrees.
    """
    number, side, cos, sin = disc_orientation(bounds.discs, picture, heading)
    table, worst_px, worst_x, worst_y = bounds.discs.table, -np.inf, x, y
    for i in range(table.shape[1]):
        ahead, left = table[number, i, 0], side * table[number, i, 1]
        disc_x, disc_y = x + ahead * cos - left * sin, y - ahead * sin - left * cos
        too_near_px = table[number, i, 2] + _MARGIN_PX - _wall_distance(bounds, disc_x, disc_y)
        if too_near_px > worst_px:
            worst_px, worst_x, worst_y = too_near_px, disc_x, disc_y
    return worst_px, worst_x, worst_y


@leaf_kernel
def fits_in_tank(bounds: Bounds, picture: int, x: float, y: float, heading: float) -> bool:
    """Return whether a picture at x, y px and a heading in degrees is inside the tank.

    picture: film row, or −1 − number of a sprite. At a roomy pixel every picture fits at every
    heading; elsewhere all discs of its body must be inside.
    """
    roomy, column, row = bounds.roomy, round(x), round(y)
    if not (0 <= row < roomy.shape[0] and 0 <= column < roomy.shape[1]):
        return False
    # The cells only save time: their table is small, so it is read before the pixel.
    cell_row, cell_column = row >> _CELL_BITS, column >> _CELL_BITS
    if bounds.roomy_cells[cell_row, cell_column] or roomy[row, column]:
        return True
    if bounds.discs.table.shape[0] == 0:  # without discs only roomy places count
        return False
    # From the head, which meets a wall first, until a disc is too near to the wall.
    number, side, cos, sin = disc_orientation(bounds.discs, picture, heading)
    table, depth = bounds.discs.table, bounds.depth
    for i in range(table.shape[1] - 1, -1, -1):
        ahead, left = table[number, i, 0], side * table[number, i, 1]
        column, row = round(x + ahead * cos - left * sin), round(y - ahead * sin - left * cos)
        if not (0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]):
            return False
        if table[number, i, 2] + _MARGIN_PX > depth[row, column]:
            return False
    return True


@leaf_kernel
def push_inside(bounds: Bounds, picture: int, x: float, y: float, heading: float):  # type: ignore[no-untyped-def]
    """Move a picture inside the tank; return its new x, y px, and whether it fits there.

    picture: film row, or −1 − number of a sprite; heading: degrees. Without discs of the body it
    moves to the nearest pixel at which every picture fits; with discs it is moved off the nearest
    wall up to _PUSHES times.
    """
    if fits_in_tank(bounds, picture, x, y, heading):
        return x, y, True
    if bounds.discs.table.shape[0] == 0:
        height, width = bounds.roomy.shape
        row, column = min(max(round(y), 0), height - 1), min(max(round(x), 0), width - 1)
        return float(bounds.nearest[1, row, column]), float(bounds.nearest[0, row, column]), True
    for _ in range(_PUSHES):
        too_near_px, disc_x, disc_y = _worst_wall_overlap(bounds, picture, x, y, heading)
        # The direction in which the distance from the wall grows, by central differences.
        inward_x = _wall_distance(bounds, disc_x + 1.0, disc_y) - _wall_distance(
            bounds, disc_x - 1.0, disc_y
        )
        inward_y = _wall_distance(bounds, disc_x, disc_y + 1.0) - _wall_distance(
            bounds, disc_x, disc_y - 1.0
        )
        slope = np.hypot(inward_x, inward_y)
        if slope < 1e-6:  # as far from one wall as from another
            break
        push_px = too_near_px + 0.5  # half a pixel more, as depths are those of whole pixels
        x, y = x + push_px * inward_x / slope, y + push_px * inward_y / slope
        if fits_in_tank(bounds, picture, x, y, heading):
            return x, y, True
    return x, y, False


@kernel
def keep_inside(bounds: Bounds, pictures: Ints, trajectory: Floats, most_px: float) -> Floats:
    """Move a trajectory (n, 3) off the walls tick by tick; return it up to where that fails.

    pictures (n,): film rows, or −1 − number of a sprite; trajectory: x, y px, heading; most_px: a
    tick that must move by more ends it. Later ticks move along with an earlier one.
    """
    inside = trajectory.copy()
    aside_x = aside_y = 0.0
    for t in range(len(trajectory)):
        x, y = trajectory[t, 0] + aside_x, trajectory[t, 1] + aside_y
        to_x, to_y, fits = push_inside(bounds, pictures[t], x, y, trajectory[t, 2])
        if not fits or np.hypot(to_x - x, to_y - y) > most_px:
            return inside[:t]
        aside_x, aside_y = to_x - trajectory[t, 0], to_y - trajectory[t, 1]
        inside[t, 0], inside[t, 1] = to_x, to_y
    return inside
