"""Groups of fish planned together in mode `matching`: overlaps, goals, rests, and planning time.

`python -m benchmarks.shoal FOLDER …` takes working copies with a finished pipeline, one per film
(default: the present folder), and writes benchmarks/shoal.csv. Eight fish swim for ten minutes in
the film's tank, each with a random goal every half minute; 64 fish, a third as large, swim for two
minutes, with a goal a minute. Groups for which the tank has no room are printed and left out. A
fish is still if it moves less than a twentieth of a body length in a second. Goals that lack time
count as not reached.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.company import summarize_distances
from benchmarks.matching import MODE, matching_data, replace_settings, settings_without_path
from benchmarks.pipeline import write_film_table
from finloop.animate.encounters import count_overlaps, fish_places, nearest_distances
from finloop.animate.places import random_goals
from finloop.animate.shoal import NoRoom, animate_group, make_tasks
from finloop.edit.build import build_edit_lists
from finloop.modes.matching import MatchingAnimator, matching_animator
from finloop.project import Project

SHOALS = ((8, 1.0, 600.0, 30.0), (64, 1 / 3, 120.0, 60.0))
"""Number of fish, their size as a share of a fish alone, duration in s, s per goal."""
WARM_UP = 20  # ticks that compile everything


def measure_group(animator: MatchingAnimator, seconds_per_goal: float) -> dict[str, object]:
    """Return overlaps, goals, distances, speeds and planning time of animated fish, as a row."""
    world, player = animator.world, animator.player
    p, rate, ticks = world.settings, world.motion.rate_hz, world.duration
    goal_count = p.fish * round(p.seconds / seconds_per_goal)
    goals = random_goals(world, goal_count, np.random.default_rng(1))
    animate_group(player, make_tasks(goals, p.fish, np.random.default_rng(0)), WARM_UP)
    tasks = make_tasks(goals, p.fish, np.random.default_rng(p.seed))
    start = time.process_time()
    swims = animate_group(player, tasks, ticks)
    planned = time.process_time()
    edit = build_edit_lists(swims, ticks, player.edit_inputs)
    listed = time.process_time()
    places, length = fish_places(edit), world.motion.body_length_px
    nearest_px = np.concatenate([nearest_distances(tick) for tick in places.transpose(1, 0, 2)])
    speeds = np.hypot(*np.diff(places, axis=1).transpose(2, 1, 0)) / length * rate
    return {
        "mode": MODE, "fish": p.fish, "overlap": p.overlap, "s": p.seconds,
        "overlapping_pairs": int(count_overlaps(edit, player).sum()),
        "goals_reached_pct": 100 * np.concatenate([swim.reached >= 0 for swim in swims]).mean(),
        **summarize_distances(nearest_px / length, speeds, rate),
        "planned_real_times": p.seconds / (planned - start),
        "with_edit_list_real_times": p.seconds / (listed - start),
    }  # fmt: skip


def film_rows(film_name: str) -> Iterator[dict[str, object]]:
    """Yield the rows of groups for the film in the present folder."""
    p = settings_without_path()
    with Project() as project:
        for fish, share, seconds, goal_s in SHOALS:
            size = share * project.film_assets.scaled.reel.scale
            changes = {"fish": fish, "fish_scale": size, "seconds": seconds, "overlap": False}
            group_settings = replace_settings(p, **changes)
            film_data = matching_data(project, group_settings)
            try:
                row = measure_group(matching_animator(film_data, group_settings), goal_s)
            except NoRoom as error:
                print(film_name, error.came, flush=True)
                continue
            print(row, flush=True)
            yield {"film": film_name, "size": size, **row}


if __name__ == "__main__":
    write_film_table(__file__, film_rows)
