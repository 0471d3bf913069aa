"""From a given line to a path that fish can follow, in px of the clip.

A *grain* is 0.05 body lengths. Detail finer than that, such as the tremble of a track or of a
hand, is left out. Where the fish's centre may not be, the path is steered to the nearest place
where it may be. Errors are measured against the requested path.
"""

from typing import NamedTuple

import numpy as np
import scipy

from finloop.animate.arena import Tank, are_points_inside
from finloop.animate.motion import MotionStatistics
from finloop.animate.route import Route
from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.line import MM, TANK, Line

_GRAIN = 0.05  # body lengths; finer detail, as of a trembling hand, is left out
_STEP = 0.1  # body lengths between the points of the steered path: fewer are quicker to search
_FINE_STEP = 0.02  # body lengths between the points of the requested path, for exact errors
_AHEAD = 0.5  # body lengths of path in which the point nearest to a fish is sought: > a tick's swim


class Path(NamedTuple):
    """A path as the fish is steered (route), and as requested (asked), at the same px along it."""

    route: Route
    asked: Route


class _PathPoints(NamedTuple):
    """The points (n,) of a path without fine detail: x, y px; headings in degrees, if given.

    along_px (n,): px along the path; closed: whether the last point is the first again; due_px
    (t,): px along it that are due at each tick, empty without times.
    """

    x: Floats
    y: Floats
    heading_deg: Floats | None
    along_px: Floats
    closed: bool
    due_px: Floats


def lay_path(line: Line, tank: Tank, motion: MotionStatistics, mm_per_px: float | None) -> Path:
    """Return a given line as a path in the tank, px of the clip: to steer by, and as requested.

    `Path.route` is the path to steer by, moved to where the fish's centre may be; `Path.asked` is
    the requested one, with finer steps, against which errors are measured. mm_per_px: scale of the
    film, None if unknown. Detail finer than 0.05 body lengths is left out. Without times, a line
    that ends where it began is closed. FinloopError if it leaves the arena, is hardly longer than a
    point, or is in mm and the scale is not known.
    """
    length = motion.body_length_px
    x, y = _line_in_px(line, tank, mm_per_px)
    _refuse_line_outside(line, tank, x, y)
    points = _leave_out_detail(line, x, y, _GRAIN * length, motion.rate_hz)
    if points.along_px[-1] < 2 * _STEP * length:
        raise FinloopError(
            f"{line.name} is {points.along_px[-1] / length:.2f} body lengths long",
            f"a path of at least {2 * _STEP:g} body lengths",
            "draw a longer path, or correct its unit (matching.path_unit)",
        )
    route, asked = (_resample_path(points, step_bl, length) for step_bl in (_STEP, _FINE_STEP))
    return Path(_move_off_walls(route, tank, _GRAIN * length), asked)


def _leave_out_detail(
    line: Line, x: Floats, y: Floats, grain: float, rate_hz: float
) -> _PathPoints:
    """Return the points of a line without detail finer than `grain` px.

    x, y (n,): the line's points, px. A closed line returns to its first point; a line without times
    is closed, too, if it ends within a grain of its beginning. rate_hz: ticks per second.
    """
    heading = line.heading_deg
    ends_at_start = np.hypot(x[-1] - x[0], y[-1] - y[0]) <= grain
    closed = line.closed or (line.time_s is None and bool(ends_at_start))
    if closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
        heading = None if heading is None else np.append(heading, heading[0])
    starts = _grain_starts(x, y, grain)
    x, y = _grain_means(x, starts), _grain_means(y, starts)
    if heading is not None:
        heading = _grain_means(np.unwrap(heading, period=360), starts)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    due_px = np.zeros(0)  # without times
    if line.time_s is not None:
        time_s = _grain_means(line.time_s - line.time_s[0], starts)
        ticks = np.arange(int(time_s[-1] * rate_hz + 1e-6) + 1)
        due_px = np.interp(ticks / rate_hz, time_s, along)
    return _PathPoints(x, y, heading, along, closed, due_px)


def _resample_path(points: _PathPoints, step_bl: float, length_px: float) -> Route:
    """Return a path as a route whose points are equally far apart, about `step_bl` body lengths.

    length_px: a body length.
    """
    given_px = points.along_px
    steps = max(2 + points.closed, round(given_px[-1] / (step_bl * length_px)))
    even_px = np.linspace(0.0, given_px[-1], steps + 1)
    step = float(even_px[1])
    if points.closed:
        even_px = even_px[:-1]  # the last place is the first again
    heading = np.zeros(0)  # not given
    if points.heading_deg is not None:
        heading = np.interp(even_px, given_px, points.heading_deg)
    x, y = (np.interp(even_px, given_px, places) for places in (points.x, points.y))
    return Route(
        x, y, heading=heading, step=step, closed=points.closed, when=points.due_px, begins=1,
        ahead=max(2, round(_AHEAD / step_bl)),
    )  # fmt: skip


def _line_in_px(line: Line, tank: Tank, mm_per_px: float | None) -> tuple[Floats, Floats]:
    """Return x and y (n,), px, of a given line; FinloopError if it is in mm without a scale."""
    if line.unit == TANK:
        left, top, right, bottom = tank.box_px
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
    inside = are_points_inside(tank.arena, x, y)
    if inside.all():
        return
    first = int(np.argmin(inside))
    left, top, right, bottom = tank.box_px
    raise FinloopError(
        f"{line.name}: {np.count_nonzero(~inside)} of {len(x)} places are outside the tank, first "
        f"({x[first]:.0f}, {y[first]:.0f}) px",
        f"a path inside the tank, which is {left}-{right} × {top}-{bottom} px",
        "move or scale the path, or correct its unit (matching.path_unit)",
    )


@kernel
def _grain_starts(x: Floats, y: Floats, grain_px: float) -> Ints:
    """Return the indices (k,) of points of a line that are at least `grain_px` apart, from 0 on.

    x, y (n,): all points, px. Each next index is that of the first point so far from the one
    before.
    """
    starts = np.empty(x.size, np.int64)
    starts[0], count = 0, 1
    for i in range(1, x.size):
        last = starts[count - 1]
        if np.hypot(x[i] - x[last], y[i] - y[last]) >= grain_px:
            starts[count], count = i, count + 1
    return starts[:count]


def _grain_means(values: Floats, starts: Ints) -> Floats:
    """Smooth values along a line: return the first, the mean over each grain, the last (k + 2,).

    values (n,): of a line's points; starts (k,): number of the first point of each grain. The means
    tremble less than the values.
    """
    means = np.add.reduceat(values, starts) / np.diff(starts, append=len(values))
    return np.concatenate([values[:1], means, values[-1:]])


def _move_off_walls(route: Route, tank: Tank, margin_px: float) -> Route:
    """Return a route whose points are moved to where the centre may be, `margin_px` off walls.

    In a tank too narrow for the margin, they are moved to where the centre may be at all.
    """
    free = scipy.ndimage.distance_transform_edt(tank.legal) > margin_px
    if not free.any():
        free = tank.legal
    nearest = scipy.ndimage.distance_transform_edt(
        ~free, return_distances=False, return_indices=True
    )
    # Places that are free already keep their fractions of a px.
    row, column = (np.round(coordinate).astype(int) for coordinate in (route.y, route.x))
    is_free = free[row, column]
    near_row, near_column = nearest[:, row, column]
    return route._replace(
        x=np.where(is_free, route.x, near_column), y=np.where(is_free, route.y, near_row)
    )
