"""From a given line to a path that fish can follow, in px of the clip.

Detail finer than a grain, such as the tremble of a track or of a hand, is left out. Where the
fish's centre may not be, the path is steered to the nearest place where it may be. Errors are
measured against the requested path.
"""

from typing import NamedTuple

import numpy as np
import scipy

from finloop.animate.arena import Tank
from finloop.animate.motion import MotionStatistics
from finloop.animate.route import Route
from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.line import MM, TANK, Line

_GRAIN = 0.05  # body lengths; finer detail is left out; also the centre's distance from walls
_STEP = 0.1  # body lengths between the places of the steered path
_FINE = 0.02  # ... and of the requested path
_AHEAD = 0.5  # body lengths along the path within which a foot moves on in a tick


class Path(NamedTuple):
    """A path as the fish is steered (route), and as requested (asked), at the same px along it."""

    route: Route
    asked: Route


def lay_path(line: Line, tank: Tank, motion: MotionStatistics, mm_per_px: float | None) -> Path:
    """Return the path in px of the clip that a given line makes in the tank.

    mm_per_px: scale of the film, None if unknown. Without times, a line that ends where it began is
    closed. FinloopError if it leaves the arena, is hardly longer than a point, or is in mm and the
    scale is not known.
    """
    length = motion.body_length_px
    x, y = _line_in_px(line, tank, mm_per_px)
    _refuse_line_outside(line, tank, x, y)
    grain, heading = _GRAIN * length, line.heading_deg
    returns = np.hypot(x[-1] - x[0], y[-1] - y[0]) <= grain
    closed = line.closed or (line.time_s is None and bool(returns))
    if closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
        heading = None if heading is None else np.append(heading, heading[0])
    starts = _grain_starts(x, y, grain)
    x, y = _grain_means(x, starts), _grain_means(y, starts)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    if along[-1] < 2 * _STEP * length:
        raise FinloopError(
            f"{line.name} is {along[-1] / length:.2f} body lengths long",
            f"a path of at least {2 * _STEP:g} body lengths",
            "draw a longer path, or correct its unit (matching.path_unit)",
        )
    when = np.zeros(0)
    if line.time_s is not None:
        time = _grain_means(line.time_s - line.time_s[0], starts)
        ticks = np.arange(int(time[-1] * motion.rate_hz + 1e-6) + 1)
        when = np.interp(ticks / motion.rate_hz, time, along)
    turned = (
        np.zeros(0) if heading is None else _grain_means(np.unwrap(heading, period=360), starts)
    )
    made = []
    for share in (_STEP, _FINE):
        count = max(2 + closed, round(along[-1] / (share * length)))
        at = np.linspace(0.0, along[-1], count + 1)
        step = float(at[1])
        at = at[: len(at) - closed]
        made.append(
            Route(
                np.interp(at, along, x), np.interp(at, along, y),
                np.interp(at, along, turned) if len(turned) else turned, step, closed,
                when, 1, max(2, round(_AHEAD / share)),
            )
        )  # fmt: skip
    route, asked = made
    return Path(_move_off_walls(route, tank, grain), asked)


def _line_in_px(line: Line, tank: Tank, mm_per_px: float | None) -> tuple[Floats, Floats]:
    """Return x and y (n,), px, of a given line; FinloopError if it is in mm without a scale."""
    if line.unit == TANK:
        rows, columns = (np.flatnonzero(tank.arena.any(axis)) for axis in (1, 0))
        left, top, right, bottom = columns[0], rows[0], columns[-1], rows[-1]
        return left + line.x * (right - left), top + line.y * (bottom - top)
    if line.unit == MM:
        if mm_per_px is None:
            raise FinloopError(
                f"{line.name} is in mm, and the film's scale is not known",
                "clip.mm_per_px, the size of a pixel",
                "measure a ruler in the picture, or give the path in px or in shares of the tank",
            )
        return line.x / mm_per_px, line.y / mm_per_px
    return line.x, line.y


def _refuse_line_outside(line: Line, tank: Tank, x: Floats, y: Floats) -> None:
    """Raise FinloopError if a point x, y (n,), px, of a line is outside the tank."""
    height, width = tank.arena.shape
    column, row = np.round(x), np.round(y)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    inside[inside] = tank.arena[row[inside].astype(int), column[inside].astype(int)]
    if inside.all():
        return
    first = int(np.argmin(inside))
    rows, columns = (np.flatnonzero(tank.arena.any(axis)) for axis in (1, 0))
    raise FinloopError(
        f"{line.name}: {np.count_nonzero(~inside)} of {len(x)} places are outside the tank, first "
        f"({x[first]:.0f}, {y[first]:.0f}) px",
        f"a path inside the tank, which is {columns[0]}-{columns[-1]} × {rows[0]}-{rows[-1]} px",
        "move or scale the path, or correct its unit (matching.path_unit)",
    )


@kernel
def _grain_starts(x: Floats, y: Floats, grain_px: float) -> Ints:
    """Return the first point of every grain, `grain_px` from the first point of the grain before.

    x, y (n,): px of a line's points.
    """
    starts = np.empty(x.size, np.int64)
    starts[0], n = 0, 1
    for i in range(1, x.size):
        last = starts[n - 1]
        if np.hypot(x[i] - x[last], y[i] - y[last]) >= grain_px:
            starts[n], n = i, n + 1
    return starts[:n]


def _grain_means(values: Floats, starts: Ints) -> Floats:
    """Return the first value, the means of all grains, which tremble less, and the last value.

    values (n,): of a line's points; starts: from `_grain_starts`.
    """
    means = np.add.reduceat(values, starts) / np.diff(starts, append=len(values))
    return np.concatenate([values[:1], means, values[-1:]])


def _move_off_walls(route: Route, tank: Tank, margin_px: float) -> Route:
    """Return a route with places moved to where the centre may be, `margin_px` off walls."""
    free = scipy.ndimage.distance_transform_edt(tank.legal) > margin_px
    if not free.any():
        free = tank.legal
    nearest = scipy.ndimage.distance_transform_edt(
        ~free, return_distances=False, return_indices=True
    )
    row, column = (np.round(side).astype(int) for side in (route.y, route.x))
    legal = free[row, column]
    near_row, near_column = nearest[:, row, column]
    return route._replace(
        x=np.where(legal, route.x, near_column), y=np.where(legal, route.y, near_row)
    )
