"""Stage `modes-matching`: goals, paths or rules become an animation of mode `matching`."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path
from typing import NamedTuple

import pandas as pd

from finloop.animate import encounters
from finloop.base.arrays import Ints
from finloop.edit.measures import average_measures
from finloop.edit.schema import CONSIDERED
from finloop.edit.stretch import Swim
from finloop.io.table import save_table
from finloop.modes.matching import NO_SPRITES, MatchingAnimator, MatchingData, matching_animator
from finloop.plan import path_measures
from finloop.plan.load_paths import load_lines
from finloop.plan.matching_settings import merge_settings
from finloop.plan.plan import option_table
from finloop.project import Project
from stages.animation import animate


def open_mode(project: Project, sprite_rows: Ints = NO_SPRITES) -> MatchingAnimator:
    """Return the animator of mode `matching`, with the results of the earlier stages.

    sprite_rows (s,): the row of each sprite, from which a fish of another mode continues.
    """
    common, own = project.settings("animate"), project.settings("matching")
    made = MatchingData(
        project.rate_hz, project.arena, project.film_reel, project.outlines, project.map_facts,
        project.steps, project.jumps, project.poses, project.forecast,
        load_lines(own, project.features), project.facts.mm_per_px, project.rule,
        project.background, sprite_rows,
    )  # fmt: skip
    return matching_animator(made, merge_settings(common, own))


class PathFollowing(NamedTuple):
    """How one fish followed its path.

    path: columns of `path_measures.PATH_ROWS`; left: of `path_measures.LEFT`; numbers: errors, name
    → number.
    """

    path: pd.DataFrame
    left: pd.DataFrame
    numbers: dict[str, float]


def follow_paths(swims: list[Swim], plans: MatchingAnimator) -> list[PathFollowing]:
    """Return how well each fish that has a path followed it; empty if no fish has one.

    swims: one per fish; plans: the animator with the paths.
    """
    world, every = plans.world, list[PathFollowing]()
    if not any(plans.paths):
        return every
    most = path_measures.swimming_limits(world.film, world)
    for fish, (path, swim) in enumerate(zip(plans.paths, swims, strict=False)):
        if path is not None:
            table = path_measures.path_table("matching", swim, path, world.duration, world)
            left = path_measures.find_departures(table, path, world, most)
            numbers = path_measures.path_metrics(table, left, path, world)
            every.append(PathFollowing(table.assign(fish=fish), left.assign(fish=fish), numbers))
    return every


def save_more(
    folder: Path, plans: MatchingAnimator, swims: list[Swim], edit: pd.DataFrame
) -> dict[str, float]:
    """Write considered.parquet and, for paths, path.parquet and left.parquet to `folder`.

    Returns errors from the paths and clearances between fish, name → number. edit: the edit list.
    """
    world = plans.world
    ticks, filmed = world.duration, world.film.filmed
    weighed = [option_table(one, ticks, filmed, fish) for fish, one in enumerate(swims)]
    save_table(folder / "considered.parquet", pd.concat(weighed), CONSIDERED)
    paths = follow_paths(swims, plans)
    if paths:
        path = pd.concat([one.path for one in paths], ignore_index=True)
        save_table(folder / "path.parquet", path, path_measures.PATH_ROWS)
        left = pd.concat([one.left for one in paths], ignore_index=True)
        save_table(folder / "left.parquet", left, path_measures.LEFT)
    numbers = average_measures([one.numbers for one in paths]) if paths else {}
    return numbers | encounters.measure_clearance(edit, plans.player)


def main() -> None:
    """Write data/animate/matching.parquet and the folder data/animate/matching/."""
    animate("matching", open_mode, save_more)


if __name__ == "__main__":
    run(main)
