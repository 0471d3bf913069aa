"""Plan, draw and measure the animation of a mode, for the stages of all modes."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from finloop.animate import encounters, measures
from finloop.base.parallel import Workers, ordered_map
from finloop.edit.ghosts import measure_ghosts, tank_colour
from finloop.edit.measures import (
    average_measures,
    discontinuity_measures,
    longest_repeat,
    pose_measures,
    rhythm_measures,
    state_measures,
    step_measures,
)
from finloop.edit.pictures import drawn_step_distances, measure_discontinuities
from finloop.edit.schema import CUT, EDIT, split_by_fish
from finloop.edit.stretch import Swim
from finloop.io.atomic import whole_folder
from finloop.io.record import save_json, save_records
from finloop.io.table import save_table
from finloop.modes.animator import Animator
from finloop.modes.matching import NothingToUse
from finloop.modes.samples import sample_animations
from finloop.project import Project
from stages.cluster import open_workers
from stages.run import report_progress

OUT = Path("data/animate")
OpenMode = Callable[[Project], Any]  # returns an Animator
MeasureSeeds = Callable[[Sequence[int]], list[dict[str, float]]]
"""Returns the measures of one animation for each seed."""
SaveMore = Callable[[Path, Any, list[Swim], pd.DataFrame], dict[str, float]]
"""Writes further files of a mode to a folder, and returns further numbers by name.

It is called with the folder, the mode's animator, a swim per fish, and the edit list."""


def write_animation(mode: str, open_mode: OpenMode, save_more: SaveMore | None = None) -> None:
    """Plan the animation of a mode; write data/animate/<mode>.parquet and data/animate/<mode>/.

    The file is the edit list. The folder has the files of `_save_animation`, samples.parquet (short
    animations, which the stage `realism` compares with film) and trials.json (mean measures of
    animations to random goals). Where the film shows too little for the mode, the list is empty,
    and the folder has only reason.json.
    open_mode: returns the mode's animator. save_more: writes further files of the mode to the
    folder and returns further numbers by name.
    """
    # What this mode has imported, its workers need, too.
    loaded_modules = [name for name in sys.modules if name.startswith("finloop.")]
    with open_workers(loaded_modules) as pool, Project() as project:
        p = project.settings("animate")
        try:
            animator = open_mode(project)
        except NothingToUse as error:
            print(f"modes-{mode}: {error}", file=sys.stderr)
            with whole_folder(OUT / mode) as folder:
                save_json(folder / "reason.json", {"reason": str(error)})
            save_table(OUT / f"{mode}.parquet", EDIT.empty(), EDIT)
            return
        with whole_folder(OUT / mode) as folder:
            _report_size_and_tank(mode, animator, p)
            edit = _save_animation(folder, mode, animator, project, save_more)
            samples = sample_animations(animator, project.settings("realism").seconds, p)
            save_table(folder / "samples.parquet", samples, EDIT)
            measure: MeasureSeeds = partial(_open_and_measure_seeds, open_mode)
            if pool.is_alone:  # this process has opened the mode
                measure = partial(_measure_seeds, animator, project.features)
            numbers = _measure_trials(measure, mode, p.trials, pool)
            save_json(folder / "trials.json", _finite_numbers(numbers))
        save_table(OUT / f"{mode}.parquet", edit, EDIT)


def _report_size_and_tank(mode: str, animator: Animator, p: Any) -> None:
    """Print a note if fish are drawn smaller than filmed, or the tank's edge is unknown.

    p: the parameters `animate`.
    """
    scale, tank = animator.pictures.reel.scale, animator.player.world.tank
    if scale < 1 and p.fish_scale == "auto":
        print(
            f"modes-{mode}: the tank is too small for the fish to turn, so it is drawn at "
            f"{scale:.2g} of its size; film from farther away, or set animate.fish_scale",
            file=sys.stderr,
        )
    if p.tank == "auto" and tank.arena.all():
        print(
            f"modes-{mode}: the film is too short, or its animals stay too much in one place, to "
            "show where the tank ends, so the fish may be anywhere in the picture; if that shows "
            "more than the tank, give the tank (clip.arena), or set animate.tank=filmed",
            file=sys.stderr,
        )


def _save_animation(
    folder: Path, mode: str, animator: Animator, project: Project, save_more: SaveMore | None
) -> pd.DataFrame:
    """Plan the animation of a mode, and write its facts and measures to `folder`.

    The files are goals.json, drawn.json (the scale of the fish), measures.json, motion.parquet, and
    those of `save_more`. Return the edit list.
    """
    goals = animator.goals()
    animator.check_room(goals)
    swims, edit = animator.plan(goals)
    save_records(folder / "goals.json", goals)
    save_json(folder / "drawn.json", {"size": animator.pictures.reel.scale})
    steps = project.step_distances[["headed", "as_filmed"]].dropna()
    player = animator.player
    film_motion = measures.motion_of_film(project.features, player.world.motion)
    fish_edits, fish_measures = split_by_fish(edit), []
    for fish_edit, fish_goals in zip(fish_edits, animator.goals_by_fish(goals), strict=True):
        numbers = measures.measure_without_pictures(fish_edit, fish_goals, player, film_motion)
        numbers |= measure_pictures(fish_edit, animator, steps, project.rate_hz)
        ghosts = measure_ghosts(fish_edit, animator.pictures, tank_colour(project.background))
        numbers["ghosts_pct"] = 100 * float(ghosts.is_ghost.sum()) / len(fish_edit)
        fish_measures.append(numbers)
    numbers = average_measures(fish_measures)
    if save_more:
        numbers |= save_more(folder, animator, swims, edit)
    save_json(folder / "measures.json", _finite_numbers(numbers))
    motions = [measures.motion_of_edit(fish_edit, player) for fish_edit in fish_edits]
    speed, turn_rate = np.concatenate(motions, axis=1)  # of all fish, one after the other
    moves = measures.kinematics_table({mode: (speed, turn_rate)})
    save_table(folder / "motion.parquet", moves, measures.KINEMATICS)
    return edit


def _finite_numbers(numbers: dict[str, float]) -> dict[str, float]:
    """Return only those numbers that are finite."""
    return {name: float(value) for name, value in numbers.items() if np.isfinite(value)}


def measure_pictures(
    edit: pd.DataFrame, animator: Animator, steps: pd.DataFrame, rate_hz: float
) -> dict[str, float]:
    """Return measures of one fish's animation for which its pictures are compared, by name.

    edit: the fish's edit list. steps: distances between the film's successive pictures, columns
    headed (turned head right) and as_filmed.
    """
    pictures = animator.pictures
    joins, jumps = measure_discontinuities(edit, pictures)
    return {
        **step_measures(drawn_step_distances(edit, pictures), steps["as_filmed"].to_numpy(float)),
        **discontinuity_measures(joins, steps["headed"].to_numpy(float)),
        **pose_measures(edit, pictures.bodies.poses.shapes),
        **state_measures(edit),
        **rhythm_measures(edit, jumps, rate_hz),
        "longest_exact_repeat_s": longest_repeat(edit) / rate_hz,
    }


def _open_and_measure_seeds(open_mode: OpenMode, seeds: Sequence[int]) -> list[dict[str, float]]:
    """Open a mode, then do as `_measure_seeds`."""
    with Project() as project:
        return _measure_seeds(open_mode(project), project.features, seeds)


def _measure_seeds(
    animator: Any, features: pd.DataFrame, seeds: Sequence[int]
) -> list[dict[str, float]]:
    """Plan one animation to random goals for each seed; return the measures of each.

    They are planned without cross-fades. Their pictures are not measured, as that takes long.
    animator: of a mode. features: the rows of the film.
    """
    plain = replace(animator.player.join_rules, kind=CUT, fade=0)
    animator = replace(animator, player=replace(animator.player, join_rules=plain))
    player, rows = animator.player, []
    film_motion = measures.motion_of_film(features, player.world.motion)
    for seed in seeds:
        edit, goals = animator.trial(seed)
        fish_measures = [
            measures.measure_without_pictures(fish_edit, fish_goals, player, film_motion)
            for fish_edit, fish_goals in zip(split_by_fish(edit), goals, strict=True)
        ]
        rows.append(average_measures(fish_measures) | encounters.measure_clearance(edit, player))
    return rows


def _measure_trials(
    measure: MeasureSeeds, mode: str, trials: int, pool: Workers
) -> dict[str, float]:
    """Return the mean measures of `trials` animations to random goals, as `trials_<name>`.

    The result is empty without trials. Trial k has the seed k.
    """
    # A lot of seeds for each worker, as few lots as possible: to open the mode takes long.
    lot_size = max(1, -(-trials // pool.count))  # rounded up
    lots = [range(trials)[first : first + lot_size] for first in range(0, trials, lot_size)]
    trial_measures: list[dict[str, float]] = []
    with report_progress(f"modes-{mode}", trials, "trials") as advance:
        for lot_measures in ordered_map(measure, lots, pool):
            trial_measures += lot_measures
            advance(len(lot_measures))
    means = pd.DataFrame(trial_measures).mean().add_prefix("trials_")
    return means.to_dict() if trial_measures else {}
