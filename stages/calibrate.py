"""Stage `calibrate`: fit the zones of a school to one half of the film, test them on the other."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.calibrate.film import FilmGroup, build_film_group
from finloop.calibrate.rule import (
    explain_missing_fit,
    fit_school_rule,
    measure_steps_without_others,
    simulate_point_fish,
)
from finloop.calibrate.settings import CalibrateSettings
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import whole_folder
from finloop.io.record import save_json
from finloop.io.several import load_readable_films
from finloop.io.table import save_csv, save_table
from finloop.project import Project
from finloop.social.measures import SCHOOL, compare_groups
from finloop.social.rule import SOCIAL_STEPS, SchoolRule
from finloop.social.zones import NO_ZONES, Zones
from stages.settings import load_settings

OUT, REPORT = Path("data/calibrate"), Path("reports/calibrate")


def rows_of_first_film(features: pd.DataFrame, clip: Path) -> pd.DataFrame:
    """Return the feature rows of the first of several films; of a single film all rows.

    clip: folder of the clip. It knows the walls of the first film alone.
    """
    parts = load_readable_films(clip)
    return features[features["frame"] < parts[0].stop] if parts else features


def _simulate(film: FilmGroup, zones: Zones, p: CalibrateSettings) -> dict[str, pd.DataFrame]:
    """Simulate groups of fish with the film's zones and without zones; return their measures.

    The tables of measures, columns of `SCHOOL`, have the names "zones" and "alone".
    """
    rows, tables = film.rows_with_whole_steps(p.rows), {}
    for name, group_zones in (("zones", zones), ("alone", NO_ZONES)):
        steps = measure_steps_without_others(film, rows, group_zones)
        rng = np.random.default_rng(p.seed)
        tables[name] = simulate_point_fish(film, steps, group_zones, p, rng)
    return tables


def _save_rule(folder: Path, rule: SchoolRule) -> None:
    """Write the rule of a film's fish groups to zones.json and steps.parquet in `folder`.

    `Project.school_rule` loads it. rule: the zones, in which fish repel, align with and attract
    each other; and the fish's own steps, which last `horizon` frames each. A step of a simulated
    fish is drawn at random from the `alike` filmed steps that were taken in the most similar
    situation.
    """
    steps = rule.steps
    save_json(folder / "zones.json", {
        "zones": asdict(rule.zones), "horizon_frames": rule.horizon, "alike": rule.similar_steps,
        "forward": steps.move_per_pull, "onward": steps.turn_per_pull,
    })  # fmt: skip
    save_table(folder / "steps.parquet", steps.to_table(), SOCIAL_STEPS)


def main() -> None:
    """Fit the zones in which the film's fish repel, align with and attract each other.

    data/calibrate/ gets the rule, the film's and simulated fish's measures and their comparison,
    reports/calibrate/ the metrics. With too few fish, no zone is fitted and nothing simulated.
    """
    p: CalibrateSettings = load_settings("calibrate")
    project = Project()
    features = project.features
    rows = rows_of_first_film(features, project.data / "clip")
    film = build_film_group(rows, project.arena, infer_delta_frames(features), p.horizon)
    rule, fit = fit_school_rule(film, p)
    numbers: dict[str, float] = {"fitted": int(fit is not None), "fish": film.typical_fish_count}
    if fit is None:
        print(f"calibrate: {explain_missing_fit(film)}", file=sys.stderr)
    else:
        numbers["explained_pct"] = 100 * fit.explained
        numbers["explained_held_out_pct"] = 100 * fit.explained_held_out
        numbers["own_direction"] = fit.direction_weight  # weight of a fish's present direction
    with whole_folder(OUT) as folder:
        _save_rule(folder, rule)
        save_table(folder / "film.parquet", film.table, SCHOOL)
        simulated = _simulate(film, rule.zones, p) if fit else {}
        for name, table in simulated.items():
            save_table(folder / f"{name}.parquet", table, SCHOOL)
        films = {"film": film.table, "second_half": film.measures_of_half(first=False)}
        table = compare_groups(
            films, {"first_half": film.measures_of_half(first=True), **simulated}
        )
        # Not in reports/, which is in git: points that act on each other amplify rounding, so they
        # swim differently on another processor, as with another seed.
        save_csv(folder / "company.csv", table, decimals=3)
    for row in table[table["shoal"] == "first_half"].itertuples():
        numbers[f"{row.shoal}_{row.measure}_to_{row.beside}"] = row.distance
    numbers |= {"horizon_s": film.horizon_frames / project.rate_hz, **asdict(rule.zones)}
    save_metrics(REPORT / "metrics.json", numbers)


if __name__ == "__main__":
    run(main)
