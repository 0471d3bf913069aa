"""Ablation of the planner of mode `matching`: it runs without one part after the other.

`python -m benchmarks.ablation [--seeds 10] FOLDER …` takes working copies with a finished pipeline,
one per film (default: the present folder), and writes benchmarks/ablation.csv: goals reached and
the time to a goal, discontinuities, steps, rests, repeats, motion compared with the film, and the
distance from two paths, with standard deviations over the seeds. The column `changes` names what
differs from the whole planner by more than twice the standard error of the difference.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
from contextlib import chdir
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from benchmarks.matching import matching_data, replace_settings
from finloop.animate import measures
from finloop.animate.paths import lay_path
from finloop.animate.shoal import animate_fish
from finloop.base.errors import FinloopError
from finloop.base.line import TANK, Line
from finloop.base.parallel import Processes, ordered_map
from finloop.edit.schema import split_by_fish
from finloop.modes.matching import MatchingAnimator, matching_animator
from finloop.plan.matching_settings import merge_settings
from finloop.plan.path_measures import find_departures, path_metrics, path_table, swimming_limits
from finloop.project import Project
from stages.animation import measure_pictures

PARTS: dict[str, dict[str, Any]] = {
    "whole": {},
    "no cost of seams": {"discontinuity_cost": 0.0},
    "no cost of repeats": {"repeat_cost": 0.0},
    "no cost of rare steps": {"rarity_weight": 0.0},
    "no cost of lagging": {"rest_cost": 0.0, "path_rest_cost": 0.0},
    "no random choice": {"choice_noise": 1e-6},
    "no predictions": {"uses": ("film",)},
    "predictions alone": {"uses": ("forecast",)},
    "a new plan after every stride": {"replan_interval_deltas": 0.75, "path_commit": 0.75},
    "a beam of 24": {"beam": 24},
    "a look half as far ahead": {"look_ahead_deltas": 7.5},
    "no correction on paths": {"path_max_correction_ratio": 0.0},
    "no cost of correction": {"path_correction_cost": 0.0},
}
"""The parts, and the parameters and constants that remove each."""
GOALS, SECONDS, TRIALS = 3, 60.0, 2
MEASURES = {
    "goals_reached_pct": "goals", "time_to_goal_median_s": "time_s", "seam_ratio_p95": "seams",
    "steps_above_film_p995_pct": "steps_pct", "stuck_pct": "stuck_pct",
    "longest_exact_repeat_s": "repeat_s", "shown_film_pct": "film_pct",
    "speed_kinematic_distance_sd": "speed_sd", "turn_rate_kinematic_distance_sd": "turns_sd",
    "frames_outside": "outside",
}  # fmt: skip


def named_paths() -> dict[str, Line]:
    """Return a circle without times and an eight with times, in shares of the tank."""
    angle = np.linspace(0, 2 * np.pi, 300)
    circle = Line(
        "circle", 0.5 + 0.3 * np.cos(angle), 0.5 + 0.25 * np.sin(angle), TANK, closed=True
    )
    eight = Line(
        "eight", 0.5 + 0.3 * np.cos(angle), 0.5 + 0.25 * np.sin(2 * angle), TANK,
        time_s=30 * angle / angle[-1],
    )  # fmt: skip
    return {"circle": circle, "eight": eight}


def measure_seed(part_and_seed: tuple[str, int]) -> dict[str, float] | str:
    """Return measures of an animation by name, planned without one part of the planner.

    The film is that of the present folder. part_and_seed: name of the part, and the seed of the
    animation. If planning fails, the result is the reason.
    """
    try:
        return _measure_without(*part_and_seed)
    except FinloopError as error:
        return error.came


def _measure_without(part: str, seed: int) -> dict[str, float]:
    """Return the measures of the film in the present folder without a part, with a seed."""
    cv2.setNumThreads(1)
    with Project() as project:
        usual = merge_settings(project.settings("animate"), project.settings("matching"))
        fixed = {"path": None, "seed": seed, "seconds": SECONDS, "trial_goals": GOALS}
        p = replace_settings(usual, **fixed | PARTS[part])
        animator = matching_animator(matching_data(project, p), p)
        film = measures.motion_of_film(project.features, animator.world.motion)
        steps = project.step_distances[["headed", "as_filmed"]].dropna()
        trials = []
        for number in range(TRIALS):
            edit, goals = animator.trial(number)
            for fish_edit, fish_goals in zip(split_by_fish(edit), goals, strict=True):
                trials.append(
                    measures.measure_without_pictures(fish_edit, fish_goals, animator.player, film)
                )
        sample = animator.sample(7000 + seed, SECONDS)
        measures_by_key = dict(pd.DataFrame(trials).mean())
        measures_by_key |= measures.measure_without_pictures(sample, [], animator.player, film)
        measures_by_key |= measure_pictures(sample, animator, steps, project.rate_hz)
        row = {name: float(measures_by_key.get(key, np.nan)) for key, name in MEASURES.items()}
        return row | path_deviations(animator, seed)


def path_deviations(animator: MatchingAnimator, seed: int) -> dict[str, float]:
    """Return the RMS distances of a fish from two paths, in body lengths."""
    world, ticks, deviations = animator.world, round(30 * animator.world.motion.rate_hz), {}
    for name, line in named_paths().items():
        path = lay_path(line, world.tank, world.motion, None)
        record = animate_fish(animator.player, [], ticks, np.random.default_rng(seed), path.route)
        table = path_table("matching", record, path, ticks, world)
        departures = find_departures(table, path, world, swimming_limits(world.film, world))
        metrics = path_metrics(table, departures, path, world)
        deviations[f"{name}_lengths"] = metrics["path_across_rms_body_lengths"]
    return deviations


def ablate_film(film_name: str, seed_count: int) -> pd.DataFrame:
    """Return a row for each removed part, for the film in the present folder."""
    jobs = [(part, seed) for part in PARTS for seed in range(seed_count)]
    results = list(ordered_map(measure_seed, jobs, Processes(2)))
    rows, whole = [], pd.DataFrame()
    for number, part in enumerate(PARTS):
        of_part = results[number * seed_count : (number + 1) * seed_count]
        if failures := [result for result in of_part if isinstance(result, str)]:
            rows.append({"film": film_name, "without": part, "changes": failures[0]})
            continue
        table = pd.DataFrame(of_part)
        whole = table if part == "whole" else whole
        standard_error = np.sqrt((table.var() + whole.var()) / seed_count).fillna(0)
        differs = (table.mean() - whole.mean()).abs() > 2 * standard_error + 1e-9
        rows.append(
            {"film": film_name, "without": part, **table.mean().round(3)}
            | {f"{name}_sd": value for name, value in table.std().round(3).items()}
            | {"changes": " ".join(table.columns[differs])}
        )
    return pd.DataFrame(rows)


def main() -> None:
    """Measure the films without one part after the other; write benchmarks/ablation.csv."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("folders", nargs="*", default=["."])
    given = parser.parse_args()
    parts = []
    for folder in given.folders:
        with chdir(folder):
            parts.append(ablate_film(Path.cwd().name, given.seeds))
        table = pd.concat(parts)
        table.to_csv(Path(__file__).with_suffix(".csv"), index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
