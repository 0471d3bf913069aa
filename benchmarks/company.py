"""Collision avoidance of several fish in the live tank, and its costs.

`python -m benchmarks.company FOLDER …` takes working copies with a finished pipeline, one per film
(default: the present folder), and writes benchmarks/company.csv. Eight fish, or as many as the tank
holds, swim in the live tank for a minute of film, each from one random place to the next: with
collision avoidance, and with `matching.overlap=true`. Outlines are those of the pictures at the
planned heading, without the bends and turns of transitions. A fish is still if it moves less than a
twentieth of a body length in a second. The filmed animals have a row of their own.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import time
from collections.abc import Iterator
from itertools import combinations

import numpy as np
import pandas as pd

from benchmarks.matching import MODE, matching_data, replace_settings, settings_without_path
from benchmarks.pipeline import write_film_table
from finloop.animate.encounters import (
    distance_quantiles,
    do_outlines_overlap,
    film_nearest_distances,
    nearest_distances,
    outline_on_screen,
)
from finloop.distance.picture import typical_lengths_px
from finloop.live.tank import LiveTank
from finloop.modes.matching import MatchingAnimator, matching_animator
from finloop.project import Project

FISH, SECONDS, STILL = 8, 60.0, 0.05


def summarize_distances(
    distances: np.ndarray, speeds: np.ndarray, rate_hz: float
) -> dict[str, float]:
    """Return quantiles of distances, and how often and how long fish are still, by name.

    distances (k,): to the nearest fish, body lengths; speeds (ticks, n): body lengths/s, NaN
    unknown.
    """
    still = np.where(np.isnan(speeds), False, speeds < STILL)
    longest = run = np.zeros(still.shape[1], int)
    for tick in still:
        run = np.where(tick, run + 1, 0)
        longest = np.maximum(longest, run)
    return {
        **(distance_quantiles(distances) if len(distances) else {}),
        "still_pct": 100 * float(still.sum() / np.isfinite(speeds).sum()),
        "longest_still_s": float(longest.max() / rate_hz),
    }


def measure_animation(animator: MatchingAnimator) -> dict[str, object]:
    """Return overlaps, goals, distances and speeds of animated fish, as a row of the table."""
    world, player = animator.world, animator.player
    length, rate = world.motion.body_length_px, world.motion.rate_hz
    tank, rng = LiveTank({MODE: player}, MODE, FISH, 0), np.random.default_rng(1)
    y, x = np.nonzero(world.tank.legal)
    count, ticks = len(tank.fish), round(SECONDS * rate)
    places, distance_parts = np.empty((ticks, count, 2)), list[np.ndarray]()
    overlaps, reached, planning_s = 0, 0, 0.0
    for tick in range(ticks):
        for number, fish in enumerate(tank.fish):
            reached += fish.reached
            if fish.reached or fish.goal is None:
                place = rng.integers(len(x))
                tank.send_to_goal(number, float(x[place]), float(y[place]))
        start = time.process_time()
        tank.advance()
        planning_s += time.process_time() - start
        rows = [row for fish in tank.fish if (row := fish.row_at(tank.tick)) is not None]
        places[tick] = [(row.x_px, row.y_px) for row in rows]
        distance_parts += [nearest_distances(places[tick]) / length] if count > 1 else []
        outlines = [outline_on_screen(player, row) for row in rows]
        overlaps += sum(do_outlines_overlap(*pair) for pair in combinations(outlines, 2))
    speeds = np.hypot(*np.diff(places, axis=0).transpose(2, 0, 1)) / length * rate
    distances = np.concatenate([np.zeros(0), *distance_parts])
    return {
        "mode": MODE, "overlap": world.settings.overlap, "fish": count,
        "overlapping_pairs_per_1000_ticks": 1000 * overlaps / ticks,
        "goals_per_fish_min": reached / count / SECONDS * 60,
        **summarize_distances(distances, speeds, rate), "real_times": ticks / rate / planning_s,
    }  # fmt: skip


def measure_film(features: pd.DataFrame, rate_hz: float) -> dict[str, object]:
    """Return distances and speeds of the filmed animals, as a row of the table."""
    length = typical_lengths_px(features).to_numpy(float)
    places = features[["x_px", "y_px"]].to_numpy(float)
    speed = np.hypot(*np.diff(places, axis=0, append=np.nan).T) / length * rate_hz
    tracks = features["track_id"].to_numpy()
    speed[np.append(tracks[1:] != tracks[:-1], True)] = np.nan
    animals, nearest = features.groupby("frame").size().mean(), film_nearest_distances(features)
    distances = summarize_distances(nearest, speed[:, None], rate_hz)
    return {"mode": "film", "fish": animals, **distances}


def film_rows(film_name: str) -> Iterator[dict[str, object]]:
    """Yield the rows of the film in the present folder, animated and filmed."""
    p = settings_without_path()
    with Project() as project:
        film_data = matching_data(project, p)
        yield {"film": film_name, **measure_film(project.features, project.rate_hz)}
        for overlap in (False, True):
            animator = matching_animator(film_data, replace_settings(p, overlap=overlap))
            yield {"film": film_name, **measure_animation(animator)}


if __name__ == "__main__":
    write_film_table(__file__, film_rows)
