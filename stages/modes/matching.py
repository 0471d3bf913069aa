"""Stage `modes-matching`: goals, paths or rules become an animation of mode `matching`."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

import pandas as pd

from finloop.animate import encounters
from finloop.base.arrays import Ints
from finloop.edit.measures import average_measures
from finloop.edit.schema import CONSIDERED
from finloop.edit.stretch import Swim
from finloop.io.table import save_table
from finloop.modes.matching import NO_SPRITES, MatchingAnimator, MatchingData, matching_animator
from finloop.plan import path_measures
from finloop.plan.load_paths import load_path_lines
from finloop.plan.matching_settings import merge_settings
from finloop.plan.plan import candidate_table
from finloop.project import Project
from stages.animation import write_animation


def open_mode(project: Project, sprite_rows: Ints = NO_SPRITES) -> MatchingAnimator:
    """Return the animator of mode `matching`, with the results of earlier stages.

    sprite_rows (s,): the film's row of each sprite, from which a fish of another mode continues.
    """
    common, own = project.settings("animate"), project.settings("matching")
    data = MatchingData(
        project.rate_hz, project.arena, project.film_reel, project.outlines, project.map_facts,
        project.step_distances, project.jumps, project.poses, project.forecast_sampler,
        load_path_lines(own, project.features), project.facts.mm_per_px, project.school_rule,
        project.background, sprite_rows,
    )  # fmt: skip
    return matching_animator(data, merge_settings(common, own))


def save_matching_tables(
    folder: Path, plans: MatchingAnimator, swims: list[Swim], edit: pd.DataFrame
) -> dict[str, float]:
    """Write considered.parquet and, for paths, path.parquet and left.parquet to `folder`.

    plans: the animator. swims: one per fish. edit: the edit list. Returns errors from the paths and
    clearances between fish, by name.
    """
    world = plans.world
    ticks, filmed = world.duration, world.film.filmed
    weighed = [candidate_table(swim, ticks, filmed, fish) for fish, swim in enumerate(swims)]
    save_table(folder / "considered.parquet", pd.concat(weighed), CONSIDERED)
    clearance = encounters.measure_clearance(edit, plans.player)
    pairs = enumerate(plans.paths[: len(swims)])
    follows = {fish: path for fish, path in pairs if path is not None}
    if not follows:
        return clearance
    most = path_measures.swimming_limits(world.film, world)
    tables, departures, numbers = [], [], []
    for fish, path in follows.items():
        table = path_measures.path_table("matching", swims[fish], path, ticks, world)
        left = path_measures.find_departures(table, path, world, most)
        numbers.append(path_measures.path_metrics(table, left, path, world))
        tables.append(table.assign(fish=fish))
        departures.append(left.assign(fish=fish))
    for name, parts, schema in (
        ("path", tables, path_measures.PATH_ROWS),
        ("left", departures, path_measures.LEFT),
    ):
        save_table(folder / f"{name}.parquet", pd.concat(parts, ignore_index=True), schema)
    return average_measures(numbers) | clearance


def main() -> None:
    """Plan the animation of mode `matching`; write it to data/animate/."""
    write_animation("matching", open_mode, save_matching_tables)


if __name__ == "__main__":
    run(main)
