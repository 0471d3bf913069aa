"""Whether fish that swim by zones form groups like those of the film.

`python -m benchmarks.zones FOLDER …` takes working copies with a finished pipeline, one per film of
several fish (default: the present folder), and writes benchmarks/zones.csv. As many fish as the
film shows at once swim for a minute by the zones of the stage `calibrate` (`matching.rule=zones`),
and without a rule. Points swim for `CalibrateSettings.steps` steps by these zones, by the zones of
Couzin et al. 2002, and without zones. If installed, couzinswarm 0.0.3 runs with its own values in a
box of the tank's size, a body length deep. Numbers are Wasserstein distances to the film and to its
second half, which the fit of the zones did not use; `first_half` is the film's.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.matching import MODE, matching_data, replace_settings, settings_without_path
from benchmarks.pipeline import film_table
from finloop.calibrate.film import FilmGroup, build_film_group
from finloop.calibrate.rule import measure_steps_without_others, simulate_point_fish
from finloop.features.table import infer_delta_frames
from finloop.modes.matching import matching_animator
from finloop.project import Project
from finloop.social.measures import compare_groups, measure_group
from finloop.social.walls import Walls
from finloop.social.zones import COUZIN, NO_ZONES, Zones
from stages.calibrate import rows_of_first_film
from stages.settings import load_settings

SEEDS, SECONDS, MOST_FISH = 3, 60.0, 64
POINT_SEEDS = 10
STEPS, EVERY = 20_000, 20  # of couzinswarm


def simulated_points(film: FilmGroup, fitted: Zones) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the tables of simulated points that swim by zones."""
    p = load_settings("calibrate")
    for name, zones in (("zones", fitted), ("couzin", COUZIN), ("alone", NO_ZONES)):
        steps = measure_steps_without_others(film, film.rows_with_whole_steps(p.rows), zones)
        for seed in range(POINT_SEEDS):
            rng = np.random.default_rng(seed)
            yield f"points_{name}", simulate_point_fish(film, steps, zones, p, rng)


def couzinswarm_points(film: FilmGroup) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the table of couzinswarm, in px of a rectangular tank."""
    if find_spec("couzinswarm") is None:
        return
    from couzinswarm import Swarm

    np.random.seed(0)  # noqa: NPY002  (the package's generator)
    y, x = np.nonzero(film.walls.arena)
    length = film.walls.length
    box = np.ptp(x) / length, np.ptp(y) / length
    swarm = Swarm(number_of_fish=film.typical_fish_count, box_lengths=[*box, 1.0])
    places, directions = swarm.simulate(STEPS)
    places, directions = (one[:, STEPS // 10 :: EVERY, :2] for one in (places, directions))
    frame = np.tile(np.arange(places.shape[1]), film.typical_fish_count)
    heading = np.degrees(np.arctan2(directions[..., 1], directions[..., 0])).ravel()
    walls = Walls(np.ones((int(np.ptp(y)) + 1, int(np.ptp(x)) + 1), bool), length)
    yield "couzinswarm", measure_group(frame, length * places.reshape(-1, 2), heading, walls)


def film_rows(film_name: str) -> list[dict[str, object]]:
    """Return the comparison of all groups with the film in the present folder, as rows."""
    p = replace_settings(settings_without_path(), seconds=SECONDS, trials=0, follow_pairs=[])
    tables: dict[str, list[pd.DataFrame]] = {}
    with Project() as project:
        film_data, features = matching_data(project, p), project.features
        rows = rows_of_first_film(features, project.data / "clip")
        horizon = load_settings("calibrate").horizon
        film = build_film_group(rows, project.arena, infer_delta_frames(features), horizon)
        fish = min(film.typical_fish_count, MOST_FISH)
        tables["first_half"] = [film.measures_of_half(True)]
        for name, table in simulated_points(film, project.school_rule.zones):
            tables.setdefault(name, []).append(table)
        for name, table in couzinswarm_points(film):
            tables[name] = [table]
        for rule, name in (("zones", f"{MODE}_zones"), ("none", f"{MODE}_alone")):
            for seed in range(SEEDS):
                # At most one goal per fish: afterwards it wanders.
                q = replace_settings(p, fish=fish, rule=rule, seed=seed, goals=[[0.5, 0.5]])
                animator = matching_animator(film_data, q)
                edit = animator.plan(animator.goals())[1]
                places, headings = edit[["x_px", "y_px"]].to_numpy(float), edit["heading_deg"]
                table = measure_group(
                    edit["tick"].to_numpy(), places, headings.to_numpy(float), film.walls
                )
                tables.setdefault(name, []).append(table)
    films = {"film": film.table, "second_half": film.measures_of_half(False)}
    comparisons = [
        compare_groups(films, {name: table}).assign(run=run)
        for name, runs in tables.items()
        for run, table in enumerate(runs)
    ]
    return pd.concat(comparisons).assign(film=film_name).to_dict("records")


def main() -> None:
    """Print and write the table: mean and largest distance over the seeds."""
    by = ["film", "shoal", "beside", "measure"]
    table = film_table(film_rows).groupby(by, sort=False).agg(
        median=("median", "mean"), distance=("distance", "mean"), largest=("distance", "max")
    )  # fmt: skip
    print(table["distance"].unstack("measure").round(3).to_string())
    table.reset_index().to_csv(Path(__file__).with_suffix(".csv"), index=False, float_format="%.3g")


if __name__ == "__main__":
    main()
