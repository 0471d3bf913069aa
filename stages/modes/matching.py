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

    sprite_rows (s,): the film's row of each sprite, at which a fish shown as that sprite continues.
    """
    common, matching = project.settings("animate"), project.settings("matching")
    data = MatchingData(
        project.film_assets, project.jumps, project.forecast_sampler,
        load_path_lines(matching, project.features), project.facts.mm_per_px, project.school_rule,
        sprite_rows,
    )  # fmt: skip
    return matching_animator(data, merge_settings(common, matching))


def save_matching_tables(
    folder: Path, animator: MatchingAnimator, swims: list[Swim], edit: pd.DataFrame
) -> dict[str, float]:
    """Write tables of decisions and of errors from given paths; return measures by name.

    The files are considered.parquet and, if there are paths, path.parquet and left.parquet (where a
    fish leaves its path). swims: one per fish. edit: the edit list. Return the clearances between
    fish and the errors from the paths, by name.
    """
    world = animator.world
    ticks, film_rows = world.duration, world.film.filmed_count
    candidates = [candidate_table(swim, ticks, film_rows, fish) for fish, swim in enumerate(swims)]
    save_table(folder / "considered.parquet", pd.concat(candidates), CONSIDERED)
    clearance = encounters.measure_clearance(edit, animator.player)
    all_paths = enumerate(animator.paths[: len(swims)])
    path_by_fish = {fish: path for fish, path in all_paths if path is not None}
    if not path_by_fish:
        return clearance
    limits = path_measures.swimming_limits(world.film, world)
    tables, departures, numbers = [], [], []
    for fish, path in path_by_fish.items():
        table = path_measures.path_table("matching", swims[fish], path, ticks, world)
        departed = path_measures.find_departures(table, path, world, limits)
        numbers.append(path_measures.path_metrics(table, departed, path, world))
        tables.append(table.assign(fish=fish))
        departures.append(departed.assign(fish=fish))
    for name, parts, schema in (
        ("path", tables, path_measures.PATH_ROWS),
        ("left", departures, path_measures.DEPARTURES),
    ):
        save_table(folder / f"{name}.parquet", pd.concat(parts, ignore_index=True), schema)
    return average_measures(numbers) | clearance


def main() -> None:
    """Plan the animation of mode `matching` and measure it; write data/animate/matching*."""
    write_animation("matching", open_mode, save_matching_tables)


if __name__ == "__main__":
    run(main)
