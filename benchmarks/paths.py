"""How closely a fish follows a path, and the speed of planning.

`python -m benchmarks.paths FOLDER …` takes working copies with a finished pipeline, one per film
(default: the present folder), and writes benchmarks/paths.csv. There are twenty smooth paths: a
figure of eight, a spiral, a rounded square, a wave; ten random splines that bend at most as much as
90 % of the bends of the film's fish; six stretches of its tracks, planned without that part of the
film. Each is followed at the fish's own speed, then with times: the tracks' own, the others at the
film's median speed.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy

from benchmarks.matching import MODE, matching_data, replace_settings, settings_without_path
from benchmarks.pipeline import film_table
from finloop.animate.paths import lay_path
from finloop.animate.shoal import animate_fish
from finloop.base.line import PX, TRACK, Line
from finloop.edit.stretch import Swim
from finloop.features.line import track_as_path
from finloop.modes.matching import MatchingAnimator, MatchingData, matching_animator
from finloop.plan.path_measures import find_departures, path_metrics, path_table, swimming_limits
from finloop.project import Project

SECONDS, TRACK_S, TRACKS, SPLINES = 30.0, 10.0, 6, 10
TRIES, KNOTS = 20_000, 6
WALL = 0.15  # body lengths: clearance of the paths from places that centres must avoid


def path_shapes(animator: MatchingAnimator, rng: np.random.Generator) -> Iterator[tuple[str, Line]]:
    """Yield fourteen paths in the free middle of the tank, px."""
    world = animator.world
    length = world.motion.body_length_px
    depth = scipy.ndimage.distance_transform_edt(world.tank.legal)
    y, x = map(float, np.unravel_index(depth.argmax(), depth.shape))
    r = float(depth.max()) - WALL * length
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    turn = np.linspace(0, 6 * np.pi, 1200)
    wide = r * (0.2 + 0.8 * turn / turn[-1])
    side = 0.86 * r
    corner = [np.sign(f(t)) * np.sqrt(np.abs(f(t))) for f in (np.cos, np.sin)]
    along = np.linspace(-1, 1, 400)
    for name, across, down, closed in (
        ("eight", r * np.sin(t), 0.6 * r * np.sin(2 * t), True),
        ("spiral", wide * np.cos(turn), wide * np.sin(turn), False),
        ("square", side * corner[0], side * corner[1], True),
        ("wave", 0.9 * r * along, 0.3 * r * np.sin(2 * np.pi * along), False),
    ):
        yield name, Line(name, x + across, y + down, PX, closed=closed)
    bend = swimming_limits(world.film, world).bend / length
    free = depth > WALL * length
    for number in range(SPLINES):
        yield f"spline {number}", random_spline(f"spline {number}", free, bend, rng)


def random_spline(
    name: str, free_area: np.ndarray, most_bend: float, rng: np.random.Generator
) -> Line:
    """Return a random cubic spline within a free area, of curvature at most `most_bend` [1/px]."""
    rows, columns = np.nonzero(free_area)
    for number in range(TRIES):
        knots = max(3, KNOTS - number * KNOTS // TRIES)
        picks = rng.integers(len(rows), size=knots)
        nodes = np.column_stack([columns[picks], rows[picks]]).astype(float)
        chord = np.hypot(*np.diff(nodes, axis=0).T)
        if chord.min() < 1:
            continue
        curve = scipy.interpolate.CubicSpline(np.append(0, np.cumsum(np.sqrt(chord))), nodes)
        parameter = np.linspace(0, curve.x[-1], 600)
        (x, y), (dx, dy), (ddx, ddy) = (curve(parameter, order).T for order in range(3))
        curvature = np.abs(dx * ddy - dy * ddx) / np.maximum(np.hypot(dx, dy), 1e-9) ** 3
        column, row = np.round(x).astype(int), np.round(y).astype(int)
        is_inside = (
            (column >= 0) & (row >= 0) & (column < free_area.shape[1]) & (row < free_area.shape[0])
        )
        if is_inside.all() and free_area[row, column].all() and curvature.max() <= most_bend:
            return Line(name, x, y, PX)
    raise RuntimeError(f"no spline bends less than {most_bend} per px")


def longest_tracks(
    film_data: MatchingData, animator: MatchingAnimator, count: int = TRACKS
) -> Iterator[tuple[str, Line]]:
    """Yield the longest stretches of tracks within the tank, the liveliest first among equals."""
    features, legal = film_data.assets.scaled.reel.features, animator.world.tank.legal
    most_frames = round(TRACK_S * animator.world.motion.rate_hz)
    stretches = []
    for number in features["track_id"].unique().tolist():
        line = track_as_path(features, f"{TRACK}{number}")
        is_free = legal[np.round(line.y).astype(int), np.round(line.x).astype(int)]
        for first, stop in np.flatnonzero(np.diff(is_free, prepend=0, append=0)).reshape(-1, 2):
            for begin in range(first, stop - most_frames // 3, most_frames):
                part = slice(begin, min(begin + most_frames, stop))
                length = float(np.hypot(np.diff(line.x[part]), np.diff(line.y[part])).sum())
                stretches.append((part.stop - part.start, length, int(number), int(begin), part))
    for *_, number, begin, part in sorted(stretches, reverse=True, key=lambda stretch: stretch[:4])[
        :count
    ]:
        line, name = track_as_path(features, f"{TRACK}{number}"), f"track {number}, {begin}"
        yield name, cut_line(line, part)._replace(name=name)


def cut_line(line: Line, part: slice) -> Line:
    """Return a part of a line that a track makes."""
    assert line.time_s is not None and line.heading_deg is not None and line.rows is not None
    return line._replace(
        x=line.x[part], y=line.y[part], time_s=line.time_s[part],
        heading_deg=line.heading_deg[part], rows=line.rows[part],
    )  # fmt: skip


def add_times(line: Line, speed_px: float) -> Line:
    """Return the line with times [s], at a constant speed [px/s]."""
    x, y = line.x, line.y
    if line.closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
    distance = np.append(0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    return line._replace(x=x, y=y, time_s=distance / speed_px, closed=False)


def count_ticks_on_path(swim: Swim) -> int:
    """Return for how many ticks a fish swims its path: stretches without a name are wandering."""
    stretches = zip(swim.stretches, swim.names, strict=True)
    return sum(len(stretch.trajectory) for stretch, name in stretches if name)


def measure_path(
    film_name: str, name: str, line: Line, animator: MatchingAnimator
) -> dict[str, object]:
    """Let a fish follow a path; return a row of the table."""
    world = animator.world
    path = lay_path(line, world.tank, world.motion, None)
    ticks = round(SECONDS * world.motion.rate_hz)
    if path.route.is_timed:
        ticks = min(ticks, len(path.route.when))
    player = animator.player
    record = animate_fish(player, [], ticks, np.random.default_rng(0), path.route)
    played = count_ticks_on_path(record)
    begin = time.process_time()  # time of the path alone: after an open path the fish wanders
    animate_fish(player, [], played, np.random.default_rng(0), path.route)
    planning_s = time.process_time() - begin
    table = path_table(MODE, record, path, ticks, world)
    departures = find_departures(table, path, world, swimming_limits(world.film, world))
    metrics = path_metrics(table, departures, path, world)
    jumps = [
        stretch.decision.seam
        for stretch, name_of_stretch in zip(record.stretches, record.names, strict=True)
        if name_of_stretch and stretch.begins_with_transition
    ]
    return {
        "film": film_name, "path": name, "timed": path.route.is_timed, "mode": MODE,
        **{key.removeprefix("path_"): value for key, value in metrics.items()},
        "seconds": len(table) / world.motion.rate_hz,
        "jumps_per_s": len(jumps) / max(played, 1) * world.motion.rate_hz,
        "seam_median": float(np.nanmedian(jumps)) if np.isfinite(jumps).any() else np.nan,
        "real_times": played / world.motion.rate_hz / planning_s,
    }  # fmt: skip


def film_rows(film_name: str) -> Iterator[dict[str, object]]:
    """Yield the rows of all paths for the film in the present folder."""
    p = replace_settings(settings_without_path(), path_own_frames=False)
    with Project() as project:
        film_data = matching_data(project, p)
        animator = matching_animator(film_data, p)
        motion = animator.world.motion
        speeds = animator.world.film.speed[animator.world.film.has_next]
        speed_px = float(np.median(speeds)) * motion.body_length_px
        for name, line in path_shapes(animator, np.random.default_rng(0)):
            yield measure_path(film_name, name, line, animator)
            yield measure_path(film_name, name, add_times(line, speed_px), animator)
        for name, line in longest_tracks(film_data, animator):
            animator_without = matching_animator(film_data._replace(lines=[line]), p)
            untimed = line._replace(time_s=None, heading_deg=None)
            yield measure_path(film_name, name, untimed, animator_without)
            yield measure_path(film_name, name, line, animator_without)


def main() -> None:
    """Print and write the table of all paths."""
    table = film_table(film_rows)
    columns = [
        "across_rms_body_lengths", "late_rms_body_lengths", "turn_corrected_pct",
        "way_corrected_pct", "left_pct", "covered_pct", "jumps_per_s", "real_times",
    ]  # fmt: skip
    groups = table.groupby(["film", "timed", "mode"], sort=False)
    whole = groups[columns].mean().join(groups["across_rms_body_lengths"].max().rename("worst"))
    print(whole.round(3).to_string())
    table.to_csv(Path(__file__).with_suffix(".csv"), index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
