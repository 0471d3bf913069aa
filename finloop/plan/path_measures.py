"""How well a fish followed a path: its error, where it left the path and why, the corrections."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.paths import Path
from finloop.animate.route import (
    Route,
    due_along,
    find_nearest_on_route,
    nearest_search_start,
    point_along,
)
from finloop.base.arrays import Floats, Mask
from finloop.base.schema import Column, Schema, columns
from finloop.edit.schema import PATH
from finloop.edit.stretch import Swim
from finloop.features.table import wrap_deg
from finloop.plan.graph import MotionGraph, ticks_to_film_end
from finloop.plan.world import FilmWorld

PATH_ROWS = Schema(
    Column("fish", "int16", "1"),
    Column("mode", "string", "1"),
    Column("tick", "int32", "1"),
    Column("time_s", "float64", "s"),
    Column("along_px", "float64", "px"),
    *columns("float64", "px", "asked_x_px", "asked_y_px", "x_px", "y_px"),
    Column("across", "float64", "body length"),
    Column("late", "float64", "body length", nullable=True),
    Column("heading_error_deg", "float64", "deg", nullable=True),
    Column("turned_deg", "float64", "deg"),
    Column("shifted_px", "float64", "px"),
)
"""How a fish followed a path, a row a tick: the point of the path nearest to it (asked), and its
place; its distance from the path (across) and, if the path has times, from the place due at that
time (late); if it has headings, the heading error; and the corrections of the film's motion."""
DEPARTURES = Schema(
    Column("fish", "int16", "1"),
    Column("mode", "string", "1"),
    *columns("float64", "s", "from_s", "to_s"),
    *columns("float64", "px", "along_px", "asked_x_px", "asked_y_px"),
    Column("most", "float64", "body length"),
    Column("why", "string", "1"),
)
"""Where a fish left its path: from when to when, how far at most, and where that was. `why`:
"wall", the fish's centre cannot be there; "sharp", the path bends more than nine of ten bends of
the film; "fast", it needs more than the film's highest speed; "" none of these."""
_BEND = 0.9  # quantile of the film's bends; a path that bends more is called sharp
_AT_WALL = 0.1  # body lengths by which a path is moved off a wall, that make the wall the cause


def path_table(
    mode: str, animation: Swim, path: Path, ticks: int, world: FilmWorld
) -> pd.DataFrame:
    """Return how a fish followed a path, a row for each of the first `ticks` ticks (`PATH_ROWS`).

    mode: its name, for the table; animation: of the fish, of which only the stretches along a path
    count; path: as requested (`asked`), by which the fish is measured, and as steered.
    """
    ticks = min(ticks, len(path.asked.when)) if path.asked.is_timed else ticks
    named = zip(animation.stretches, animation.names, strict=True)
    stretches = [stretch for stretch, name in named if name == PATH]
    empty = np.zeros((0, 3))  # for a fish that follows no path
    trajectory = np.concatenate([empty, *(stretch.trajectory for stretch in stretches)])[:ticks]
    steer = [np.zeros((len(s.trajectory), 2)) if s.steer is None else s.steer for s in stretches]
    corrections = np.concatenate([empty[:, :2], *steer])[:ticks]
    route, length = path.asked, world.motion.body_length_px
    nearest, due_places = _nearest_and_due_points(route, trajectory)
    error_deg = np.full(len(trajectory), np.nan)
    if len(route.heading) and len(trajectory):
        place = np.minimum((nearest[:, 0] / route.step).astype(int), len(route.heading) - 1)
        error_deg = np.asarray(wrap_deg(trajectory[:, 2] - route.heading[place]), float)
    return pd.DataFrame({
        "fish": 0, "mode": mode, "tick": np.arange(len(trajectory)),
        "time_s": np.arange(len(trajectory)) / world.motion.rate_hz, "along_px": nearest[:, 0],
        "asked_x_px": nearest[:, 1], "asked_y_px": nearest[:, 2],
        "x_px": trajectory[:, 0], "y_px": trajectory[:, 1],
        "across": np.hypot(*(nearest[:, 1:] - trajectory[:, :2]).T) / length,
        "late": np.hypot(*(due_places - trajectory[:, :2]).T) / length,
        "heading_error_deg": error_deg,
        "turned_deg": corrections[:, 0], "shifted_px": corrections[:, 1],
    })  # fmt: skip


def _nearest_and_due_points(route: Route, trajectory: Floats) -> tuple[Floats, Floats]:
    """Return the point of a route nearest to a fish at each tick, and the point due then.

    trajectory (t, 3): x, y px, heading, from the route's first tick on. The nearest are (t, 3): px
    along the route, and x, y px; those due (t, 2): x, y px, NaN on a route without times.
    """
    nearest, due_places = np.empty((len(trajectory), 3)), np.full((len(trajectory), 2), np.nan)
    along_px = 0.0
    for number, (x, y, _) in enumerate(trajectory):
        tick = number + route.begins
        search_start = nearest_search_start(route, along_px, tick)
        nearest[number] = find_nearest_on_route(route, x, y, search_start)
        along_px = nearest[number, 0]
        if route.is_timed:
            due_places[number] = point_along(route, due_along(route, tick))
    return nearest, due_places


def path_metrics(
    followed: pd.DataFrame, departures: pd.DataFrame, path: Path, world: FilmWorld
) -> dict[str, float]:
    """Return how well a fish followed its path, as measures by name; {} if there is no tick.

    Errors are in body lengths and degrees. followed: columns of `PATH_ROWS`; departures: columns of
    `DEPARTURES`. Of the corrections, `path_turn_corrected_pct` is the RMS of the turns over Δ, as a
    percentage of the spread of the film's turns; `path_way_corrected_pct` is the px by which the
    fish was shifted, as a percentage of all px that it covered.
    """
    motion, across = world.motion, followed["across"].to_numpy()
    if not len(followed):
        return {}
    turn_sum = np.cumsum(followed["turned_deg"].to_numpy())
    turned_in_delta = turn_sum[motion.delta :] - turn_sum[: -motion.delta]
    steps = float(np.hypot(np.diff(followed["x_px"]), np.diff(followed["y_px"])).sum())
    ticks_off_path = sum(
        round((end_s - begin_s) * motion.rate_hz) + 1
        for begin_s, end_s in zip(departures["from_s"], departures["to_s"], strict=True)
    )
    metrics = {
        "path_length_body_lengths": path.asked.length / motion.body_length_px,
        "path_covered_pct": 100 * float(followed["along_px"].iloc[-1]) / path.asked.length,
        "path_across_rms_body_lengths": root_mean_square(across),
        "path_across_p95_body_lengths": float(np.quantile(across, 0.95)),
        "path_across_most_body_lengths": float(across.max()),
        "path_left_pct": 100 * ticks_off_path / len(followed),
        "path_turn_corrected_pct": 100
        * root_mean_square(turned_in_delta)
        / max(world.turn_spread_deg, 1e-9),
        "path_way_corrected_pct": 100 * float(followed["shifted_px"].sum()) / max(steps, 1e-9),
    }
    if path.asked.is_timed:
        late = followed["late"].to_numpy()
        metrics["path_late_rms_body_lengths"] = root_mean_square(late)
        metrics["path_late_p95_body_lengths"] = float(np.quantile(late, 0.95))
    if len(path.asked.heading):
        metrics["path_heading_error_rms_deg"] = root_mean_square(
            followed["heading_error_deg"].to_numpy()
        )
    return metrics


def root_mean_square(values: Floats) -> float:
    """Return the root mean square of values (k,); 0 if there are none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


class SwimmingLimits(NamedTuple):
    """What the film's fish hardly exceed: bend, radians per body length; speed, body lengths/s."""

    bend: float
    speed: float


def swimming_limits(film: MotionGraph, world: FilmWorld) -> SwimmingLimits:
    """Return the sharpest bend (a high quantile) and the highest speed of the film's fish."""
    motion = world.motion
    bend = film_bend(film, motion.delta, motion.body_length_px, _BEND)
    return SwimmingLimits(bend, world.fastest_bl_s)


def find_departures(
    followed: pd.DataFrame, path: Path, world: FilmWorld, limits: SwimmingLimits
) -> pd.DataFrame:
    """Return where a fish left its path by more than `path_max_offset_bl`, columns of `DEPARTURES`.

    followed: columns of `PATH_ROWS`; limits: of the film's fish. On a path with times, places far
    from the one due at that time count, too. Each row has the cause of the departure.
    """
    rate = world.motion.rate_hz
    distance_bl = followed["across"].to_numpy()
    if path.asked.is_timed:
        distance_bl = np.fmax(distance_bl, followed["late"].to_numpy())
    is_off = distance_bl > world.settings.path_max_offset_bl
    # The first tick off the path, the first back on it, and so on.
    changes = np.flatnonzero(np.diff(is_off, prepend=0, append=0))
    rows = []
    for first, stop in changes.reshape(-1, 2):
        worst = followed.iloc[first + int(np.argmax(distance_bl[first:stop]))]
        rows.append((
            worst["fish"], worst["mode"], first / rate, (stop - 1) / rate, worst["along_px"],
            worst["asked_x_px"], worst["asked_y_px"], distance_bl[first:stop].max(),
            _cause_of_departure(followed.iloc[first], followed.iloc[stop - 1], path, world, limits),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=DEPARTURES.names).astype(DEPARTURES.pandas_dtypes)


def _cause_of_departure(
    first: pd.Series, last: pd.Series, path: Path, world: FilmWorld, limits: SwimmingLimits
) -> str:
    """Return what makes a part of a path impossible to follow: "wall", "fast", "sharp", or "".

    The first that applies counts; "fast" only on a path with times. first, last: rows of
    `PATH_ROWS` at which the part begins and ends; the part is taken with a body length before and
    after. limits: of the film's fish.
    """
    length, asked = world.motion.body_length_px, path.asked
    places_px = np.arange(first["along_px"] - length, last["along_px"] + length, 0.1 * length)
    end_px = np.inf if asked.closed else asked.length
    places_px = places_px[(places_px >= 0) & (places_px <= end_px)]
    if _shifts_off_walls(places_px, path).max(initial=0.0) > _AT_WALL * length:
        return "wall"
    if asked.is_timed:
        # In so many ticks the fastest fish swims a body length.
        ticks_before = round(world.motion.rate_hz / max(limits.speed, 1e-9))
        due_px = asked.when[max(first["tick"] - ticks_before, 0) : last["tick"] + 2]
        delta = min(world.motion.delta, max(len(due_px) - 1, 1))
        speeds = (due_px[delta:] - due_px[:-delta]) / delta * world.motion.rate_hz / length
        if speeds.max(initial=0.0) > limits.speed:
            return "fast"
    return "sharp" if _mark_sharp_bends(places_px, asked, length, limits.bend).any() else ""


def _shifts_off_walls(along_px: Floats, path: Path) -> Floats:
    """Return how far, px (n,), the requested path was moved off walls at `along_px` (n,)."""
    steered, asked = (_points_along(route, along_px) for route in path)
    return np.hypot(*(steered - asked).T)


def _points_along(route: Route, along_px: Floats) -> Floats:
    """Return the points (n, 2), x, y px, at distances `along_px` (n,) along a route."""
    return np.array([point_along(route, float(px)) for px in along_px]).reshape(-1, 2)


def _mark_sharp_bends(along_px: Floats, route: Route, length_px: float, bend: float) -> Mask:
    """Return which places (n,) of a path lie in a bend sharper than `bend`.

    along_px (n,): the places; bend: radians per body length; length_px: body length. A bend is
    measured from a quarter of a body length before a place to a quarter after it.
    """
    step_px = 0.25 * length_px
    points = [_points_along(route, along_px + k * step_px) for k in (-1, 0, 1)]
    direction, next_direction = (
        _directions_deg(after - before) for before, after in pairwise(points)
    )
    turn = np.abs(np.radians(wrap_deg(next_direction - direction)))
    return np.asarray(turn * length_px / step_px > bend)


def _directions_deg(steps_px: Floats) -> Floats:
    """Return the directions (n,), degrees anticlockwise, of steps (n, 2) px, y down."""
    return np.degrees(np.arctan2(-steps_px[:, 1], steps_px[:, 0]))


def film_bend(film: MotionGraph, delta: int, length_px: float, quantile: float) -> float:
    """Return a quantile of how sharply the film's fish turn over Δ, radians per body length.

    A bend is the turn from one Δ to the next, divided by the distance. delta: Δ in ticks;
    length_px: body length; quantile: 0-1. The result is 0 where the film is too short, or no fish
    moves.
    """
    rows = film.rows[: film.filmed_count]
    first = np.flatnonzero(ticks_to_film_end(rows["has_next"]) >= 2 * delta)
    if not len(first):
        return 0.0
    points = [np.column_stack([rows["x"], rows["y"]])[first + k * delta] for k in range(3)]
    step, next_step = (after - before for before, after in pairwise(points))
    turn_deg = np.abs(wrap_deg(_directions_deg(next_step) - _directions_deg(step)))
    far_px = np.hypot(*step.T) + np.hypot(*next_step.T)
    moves: Mask = far_px >= 0.2 * length_px  # the direction of a resting fish is noise
    if not moves.any():
        return 0.0
    # The turn lies between the middles of the two steps: half of the distance.
    return float(np.quantile(np.radians(turn_deg[moves]) * 2 * length_px / far_px[moves], quantile))
