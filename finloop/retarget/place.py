"""Where a track is swum: its points at this film's scale, moved into the tank."""

import numpy as np
import scipy

from finloop.base.arrays import Floats, Mask, Points
from finloop.base.errors import FinloopError
from finloop.retarget.settings import Settings
from finloop.retarget.track import Track

_CELLS = 240  # places are tried on a map of so many cells a side
_CLEAR = 0.5  # body lengths from the wall that are kept if there is room
_OUTSIDE = 1e3  # times as much as a point at the wall costs one beyond it
_ROUNDS = 12  # of halving, to find how much smaller a way has to be


def scale_of(track: Track, length_px: float, p: Settings) -> float:
    """Px of the tank per px of the file; length_px: of this film's fish, of what `track` measures.

    FinloopError if the track says no length.
    """
    if p.scale != "auto":
        return float(p.scale)
    if not track.length_px:
        raise FinloopError(
            f"one point of {track.name} is given: it says no body length",
            "head and tail of the animal, or how large its px are in this tank",
            "name both (retarget.head, retarget.tail); or set retarget.scale: the body length of "
            "this film's fish by that of the tracked animal, both in px",
        )
    return length_px / track.length_px


def mirrored(points: Points, width_px: int) -> Points:
    """Points (…, 2) of a tank, left and right exchanged."""
    return np.stack([width_px - 1 - points[..., 0], points[..., 1]], -1)


def outside(points: Points, arena: Mask) -> Mask:
    """Which points (…, 2) are not in the arena (h, w)."""
    column, row = (np.round(points[..., axis]).astype(int) for axis in (0, 1))
    there = (row >= 0) & (row < arena.shape[0]) & (column >= 0) & (column < arena.shape[1])
    inside = arena[np.where(there, row, 0), np.where(there, column, 0)]
    return ~(there & inside)


def moved(bodies: Points, arena: Mask, length_px: float, p: Settings) -> tuple[Floats, float]:
    """By how much (2,) a way is moved, and how large it is drawn.

    bodies (T, k, 2) px: the drawn points of the animal; a smaller way keeps their size.
    FinloopError if they fit nowhere.
    """
    if p.place == "given":
        return np.zeros(2), 1.0
    shift = shift_into(bodies, arena, length_px)
    if shift is not None:
        return shift, 1.0
    if p.place == "fit":
        there = np.argwhere(arena)[:, ::-1].astype(float)
        raise FinloopError(
            f"the way is {_size(bodies, length_px)} body lengths large, body and all, the tank "
            f"{_size(there, length_px)}: nowhere in it the fish stays inside",
            "a way that fits into the tank",
            "a part of the track (retarget.start_s, end_s), a smaller way (retarget.place=shrink), "
            "or let it leave the tank (retarget.place=given)",
        )
    small, large = 0.0, 1.0
    best = shift_into(smaller(bodies, small), arena, length_px)
    if best is None:
        raise FinloopError(
            "the fish does not fit into the tank, however small its way",
            "a tank larger than the fish",
            "give the arena its real size (clip.arena), or retarget.place=given",
        )
    for _ in range(_ROUNDS):
        middle = (small + large) / 2
        shift = shift_into(smaller(bodies, middle), arena, length_px)
        small, large = (middle, large) if shift is not None else (small, middle)
        best = best if shift is None else shift
    return best, small


def smaller(bodies: Points, size: float) -> Points:
    """Points (T, k, 2) whose middles are nearer to the middle of all, `size` times as far."""
    centre = bodies.mean(1, keepdims=True)
    return bodies + (size - 1) * (centre - centre.mean(0))


def _size(points: Points, length_px: float) -> str:
    wide, high = np.ptp(points.reshape(-1, 2), axis=0) / length_px
    return f"{wide:.1f} × {high:.1f}"


def shift_into(bodies: Points, arena: Mask, length_px: float) -> Floats | None:
    """By how much (2,) points (T, k, 2) are moved into the arena, clear of its walls if possible.

    None if there is no such place on a map of `_CELLS` cells. All places are tried at once: the
    cost of each is a correlation.
    """
    depth = scipy.ndimage.distance_transform_edt(np.pad(arena, 1))[1:-1, 1:-1]
    cell = -(-max(arena.shape) // _CELLS)
    cost = np.where(arena, np.maximum(0.0, 1 - depth / (_CLEAR * length_px)), _OUTSIDE)
    rows, columns = -(-arena.shape[0] // cell), -(-arena.shape[1] // cell)
    padded = np.full((rows * cell, columns * cell), _OUTSIDE)
    padded[: arena.shape[0], : arena.shape[1]] = cost
    coarse = padded.reshape(rows, cell, columns, cell).mean((1, 3))
    points = bodies.reshape(-1, 2)
    low = np.floor(points.min(0) / cell)
    at = (np.floor(points / cell) - low).astype(int)
    wide, high = at.max(0) + 1
    if wide > columns or high > rows:
        return None
    shown = np.zeros((high, wide))
    np.add.at(shown, (at[:, 1], at[:, 0]), 1.0)
    total = scipy.signal.correlate(coarse, shown, mode="valid")
    middle = (np.array(total.shape) - 1) / 2
    row, column = np.indices(total.shape) - middle[:, None, None]
    total = np.maximum(total, 0) + 1e-6 * len(points) * np.hypot(row, column)
    for best in np.argsort(total, axis=None, kind="stable")[:9]:
        row_at, column_at = np.unravel_index(best, total.shape)
        shift = cell * (np.array([column_at, row_at]) - low)
        if not outside(points + shift, arena).any():
            return shift.astype(float)
    return None
