"""Stage `animate`: goals become an edit list a mode, with the measures of how good each is."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import gc
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate import encounters, measures, path_measures
from finloop.animate.planner import Material, Planner, planner
from finloop.animate.settings import Settings
from finloop.animate.swim import Player, considered
from finloop.base.parallel import Workers, ordered_map
from finloop.edit.pictures import drawn_steps, seams
from finloop.edit.schema import CONSIDERED, CUT, EDIT, LOOPS, Goal, by_fish
from finloop.edit.stretch import Swim
from finloop.given_path import given_lines
from finloop.io.atomic import whole_folder
from finloop.io.record import save_json, save_records
from finloop.io.table import load_table, save_csv, save_table
from finloop.project import Project
from finloop.social.measures import SHOAL, beside, halves, shoal_table
from stages.cluster import workers
from stages.settings import load

OUT, REPORT = Path("data/animate"), Path("reports/animate")

WORKERS_NEED = ["finloop.animate.planner", "finloop.animate.measures", "finloop.project"]
Swum = tuple[np.ndarray, np.ndarray]
"""Speed and turn rate of everything that swam."""

Measures = dict[str, dict[str, float]]
"""Of every mode, by name."""


def material(project: Project, p: Settings) -> Material:
    """Return what the stages before have made, and the path that is asked for."""
    return Material(
        project.rate_hz, project.arena, project.reel, project.outlines, project.model,
        project.map_facts, project.steps, project.loops, project.jumps, project.gateways,
        project.poses, project.forecast, given_lines(p, project.features), project.facts.mm_per_px,
        project.rule, project.background,
    )  # fmt: skip


def bring(project: Project, p: Settings) -> Planner:
    """Return everything that plans, from what the stages before have made."""
    plans = planner(material(project, p), p)
    project.forget("steps", "loops", "jumps", "gateways", "look")  # the planner has them as arrays
    return plans


def trials_of(p: Settings, seeds: Sequence[int]) -> dict[str, list[dict[str, float]]]:
    """The measures of animations to random goals, by mode; none looks at a picture.

    Every fish has goals of its own.
    For its own process, which brings together what plans once: of a film of hours that takes long.
    """
    with Project() as project:
        plans, features = bring(project, p), project.features
        film_motion = measures.motion_of_film(features, plans.waters.motion)

        def measured(player: Player, seed: int) -> dict[str, float]:
            edit, goals = plans.trial(player, seed)
            each = zip(by_fish(edit), goals, strict=True)
            rows = [measures.of_plan(*one, player, film_motion) for one in each]
            return measures.averaged(rows) | encounters.of_shoal(edit, player)

        plain = {
            mode: replace(player, joins=replace(player.joins, kind=CUT, fade=0))
            for mode, player in plans.players.items()
        }
        return {mode: [measured(one, seed) for seed in seeds] for mode, one in plain.items()}


def trials(p: Settings, crew: Workers) -> Measures:
    """The measures of further animations of every mode, on average."""
    most = -(-p.trials // crew.count)
    lots = [range(p.trials)[first : first + most] for first in range(0, p.trials, max(most, 1))]
    numbers: dict[str, list[dict[str, float]]] = {}
    with progress("animate", p.trials, "trials") as advance:
        results = ordered_map(partial(trials_of, p), lots, crew)
        for seeds, measured in zip(lots, results, strict=True):
            for mode, some in measured.items():
                numbers[mode] = numbers.get(mode, []) + some
            advance(len(seeds))
    return {
        mode: pd.DataFrame(every).mean().add_prefix("trials_").to_dict()
        for mode, every in numbers.items()
    }


class Followed(NamedTuple):
    """How a path was followed: tables of `path_measures`, and numbers."""

    swum: pd.DataFrame
    left: pd.DataFrame
    numbers: dict[str, float]


def followed(mode: str, swims: Sequence[Swim], plans: Planner) -> list[Followed]:
    """How the path of each fish that has one was followed in a mode."""
    waters, every = plans.waters, list[Followed]()
    if not any(plans.paths):
        return every
    most = path_measures.limits(waters.film, waters)
    spread = plans.players[mode].follower.spread
    for fish, (path, swim) in enumerate(zip(plans.paths, swims, strict=False)):
        if path is not None:
            table = path_measures.swum_path(mode, swim, path, waters.duration, waters)
            left = path_measures.where_left(table, path, waters, most)
            numbers = path_measures.of_path(table, left, path, spread, waters)
            every.append(Followed(table.assign(fish=fish), left.assign(fish=fish), numbers))
    return every


def animation(
    folder: Path,
    mode: str,
    goals: list[Goal],
    plans: Planner,
    steps: pd.DataFrame,
    film_motion: Swum,
) -> tuple[dict[str, float], pd.DataFrame, list[Followed]]:
    """Make the edit list of a mode: its measures, itself, and how paths were followed.

    steps: columns of `STEPS`.
    """
    player, ticks, filmed = plans.players[mode], plans.waters.duration, plans.waters.film.filmed
    swum, edit = plans.plan(mode, goals)
    save_table(folder / f"{mode}.parquet", edit, EDIT)
    weighed = [considered(one, ticks, filmed, fish) for fish, one in enumerate(swum)]
    save_table(folder / f"{mode}_considered.parquet", pd.concat(weighed), CONSIDERED)
    paths = followed(mode, swum, plans)
    each = zip(by_fish(edit), [task.goals for task in plans.tasks(goals)], strict=True)
    rows = [
        measures.of_plan(one, own, player, film_motion) | of_pictures(one, plans, steps)
        for one, own in each
    ]
    numbers = measures.averaged([one.numbers for one in paths]) if paths else {}
    numbers |= measures.averaged(rows) | encounters.of_shoal(edit, player)
    return numbers, edit, paths


def of_pictures(edit: pd.DataFrame, plans: Planner, steps: pd.DataFrame) -> dict[str, float]:
    """The measures of one fish that need pictures. steps: columns of `STEPS`."""
    pictures, rate = plans.pictures, plans.waters.motion.rate_hz
    joins, jumps = seams(edit, pictures)
    return {
        **measures.of_steps(drawn_steps(edit, pictures), steps["as_filmed"].to_numpy(float)),
        **measures.of_seams(joins, steps["step"].to_numpy(float)),
        **measures.of_poses(edit, pictures.bodies.poses.shapes),
        **measures.of_states(edit),
        **measures.of_rhythm(edit, jumps, rate),
        "longest_exact_repeat_s": measures.longest_repeat(edit) / rate,
    }


def company(folder: Path, plans: Planner) -> pd.DataFrame:
    """How far the fish of every mode are from those of the film, as `measures.beside` has it.

    Beside them stands its first half, to which zones are fitted; nothing of one fish.
    """
    waters = plans.waters
    if waters.settings.fish == 1:
        return beside({}, {})
    film = load_table(Path("data/calibrate/film.parquet"), SHOAL)
    first, second = halves(film)
    shoals = {"first_half": first}
    for mode in plans.players:
        edit = load_table(folder / f"{mode}.parquet", EDIT, ["tick", "x_px", "y_px", "heading_deg"])
        places = edit[["x_px", "y_px"]].to_numpy(float)
        heading = edit["heading_deg"].to_numpy(float)
        shoals[mode] = shoal_table(edit["tick"].to_numpy(), places, heading, waters.walls)
    return beside({"film": film, "second_half": second}, shoals)


def animations(p: Settings) -> tuple[Measures, dict[str, float]]:
    """Make data/animate/: the measures of every mode, and of the film."""
    numbers: Measures = {}
    moved: dict[str, Swum] = {}
    paths: list[Followed] = []
    with Project() as project, whole_folder(OUT) as folder:
        steps = project.steps[["step", "as_filmed"]].dropna()
        plans, features = bring(project, p), project.features
        waters, size = plans.waters, plans.pictures.reel.size
        if size < 1 and p.size == "auto":
            print(
                f"animate: where the fish may be it could hardly turn at its own size, so it is "
                f"drawn at {size:.2g} of it; film from farther away, or set animate.size",
                file=sys.stderr,
            )
        if p.tank == "auto" and waters.tank.arena.all():
            print(
                "animate: the film is too short, or its animals keep too much to one place, to "
                "show where the tank ends, so that the fish may be anywhere in the picture; where "
                "that shows more than the tank, give it (clip.arena), or take animate.tank=filmed",
                file=sys.stderr,
            )
        goals = plans.goals()
        plans.check_room(goals)
        save_records(folder / "goals.json", goals)
        save_json(folder / "drawn.json", {"size": size})
        swum = measures.motion_of_film(features, waters.motion)
        for mode, player in plans.players.items():
            numbers[mode], edit, followed_ = animation(folder, mode, goals, plans, steps, swum)
            paths += followed_
            each = [measures.motion_of_edit(one, player) for one in by_fish(edit)]
            speed, turn_rate = np.concatenate(each, axis=1)
            moved[mode] = speed, turn_rate
        film_numbers = measures.of_film(
            features, swum, steps["as_filmed"].to_numpy(float), waters.motion
        ) | (encounters.of_film(features) if p.fish > 1 else {})
        film_numbers["drawn_size"] = size
        moves = measures.kinematics({measures.FILM_MOTION: swum} | moved)
        save_table(folder / "kinematics.parquet", moves, measures.KINEMATICS)
        save_csv(REPORT / "company.csv", company(folder, plans), decimals=3)
        if paths:
            every = pd.concat([one.swum for one in paths], ignore_index=True)
            save_table(folder / "path.parquet", every, path_measures.SWUM)
    left = pd.concat([path_measures.LEFT.empty(), *(one.left for one in paths)], ignore_index=True)
    save_csv(REPORT / "left.csv", left, decimals=3)
    return numbers, film_numbers


def main() -> None:
    """Make data/animate/, reports/animate/."""
    p: Settings = load("animate")
    with workers(WORKERS_NEED) as crew:
        numbers, film_numbers = animations(p)
        gc.collect()  # a planner refers to itself; workers now bring together their own
        for mode, averages in trials(p, crew).items():
            numbers[mode] |= averages
    if LOOPS not in numbers:
        print(
            "animate: the film has no loops to go on by: no mode `loops`, and `hybrid` is the "
            "network mode alone (the stage `loops` says what would give some)",
            file=sys.stderr,
        )
    side_by_side = measures.table(numbers, film_numbers)
    save_csv(REPORT / "measures.csv", side_by_side, decimals=3)
    every = numbers | {"film": film_numbers}
    metrics = {f"{mode}_{name}": value for mode in every for name, value in every[mode].items()}
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
