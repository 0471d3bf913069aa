"""Stage `calibrate`: zones of company, fitted to one half of the film, beside its other half."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.calibrate.film import FilmShoal, film_shoal
from finloop.calibrate.fit import Fitted, fitted, without_company
from finloop.calibrate.points import own_steps, swum_points
from finloop.calibrate.settings import Settings
from finloop.features.table import FEATURES, delta_of
from finloop.io.atomic import whole_folder
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, load_facts, load_mask
from finloop.social.measures import SHOAL, beside
from finloop.social.rule import Shoaling
from finloop.social.zones import NO_ZONES, Zones
from stages.rules import save_rule
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/calibrate"), Path("reports/calibrate")


def shoals(film: FilmShoal, zones: Zones, p: Settings) -> dict[str, pd.DataFrame]:
    """The measures of fish that are points: that swim by the zones, and without company."""
    rows, made = film.whole_steps(p.rows), {}
    for name, rule in (("zones", zones), ("alone", NO_ZONES)):
        steps, rng = own_steps(film, rows, rule), np.random.default_rng(p.seed)
        made[name] = swum_points(film, steps, rule, p, rng)
    return made


def numbers(film: FilmShoal, fit: Fitted | None, zones: Zones) -> dict[str, float | int]:
    """The zones, and how well they foretell."""
    told: dict[str, float | int] = {"fitted": int(fit is not None), "fish": film.fish}
    if fit is not None:
        told["explained_pct"] = 100 * fit.explained
        told["explained_held_out_pct"] = 100 * fit.explained_held_out
        told["own_direction"] = fit.own
    return {**told, **asdict(zones)}


def main() -> None:
    """Make data/calibrate/, reports/calibrate/."""
    p: Settings = load("calibrate")
    features = load_table(DATA / "features/features.parquet", FEATURES)
    facts = load_facts(DATA / "clip" / FACTS_NAME)
    arena = load_mask(DATA / "clip" / ARENA_NAME, facts.width_px, facts.height_px)
    film = film_shoal(
        features, arena, delta_of(features), None if p.horizon == "auto" else p.horizon
    )
    fit = fitted(film, p) if film.teaches else None
    zones = fit.zones if fit else without_company(p)
    with whole_folder(OUT) as folder:
        steps = own_steps(film, film.whole_steps(p.rows), zones)
        save_rule(folder, Shoaling(zones, steps, film.horizon, p.alike))
        save_table(folder / "film.parquet", film.table, SHOAL)
        swum = shoals(film, zones, p) if fit else {}
        for name, table in swum.items():
            save_table(folder / f"{name}.parquet", table, SHOAL)
    if fit is None:
        together = int((film.seen_at_once > 1).sum())
        print(
            f"calibrate: {together} of {len(film.seen_at_once)} frames show two fish or more, too "
            "few to learn company from, so the zones are those of Couzin et al. (2002), or given",
            file=sys.stderr,
        )
    first, second = film.half(True), film.half(False)
    table = beside({"film": film.table, "second_half": second}, {"first_half": first, **swum})
    save_csv(REPORT / "company.csv", table, decimals=3)
    distances = {
        f"{row.shoal}_{row.measure}_to_{row.beside}": row.distance for row in table.itertuples()
    }
    save_metrics(REPORT / "metrics.json", {
        "horizon_s": film.horizon / facts.frame_rate_hz, **numbers(film, fit, zones), **distances,
    })  # fmt: skip


if __name__ == "__main__":
    run(main)
