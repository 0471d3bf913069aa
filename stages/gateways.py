"""Stage `gateways`: the most similar frames and sprites, in both directions (Fig. 14)."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.distance.map import map_rows
from finloop.gateways.find import GATEWAYS, IN, OUT, gateway_metrics, gateways, nearness
from finloop.gateways.settings import GatewaysSettings
from finloop.io.atomic import whole_folder
from finloop.io.table import save_table
from finloop.project import Project
from stages.settings import load

REPORT = Path("reports/gateways")
WORDS = {IN: "into", OUT: "out of"}


def report_missing_gateways(
    ways: pd.DataFrame, nearest: pd.DataFrame, step: float, least: float
) -> None:
    """Report on stderr each direction without a gateway, and what would give one.

    ways: gateways; nearest: those without a threshold; step: median natural step; least: Δ of film
    that must follow the frame.
    """
    for direction, word in WORDS.items():
        if (ways["direction"] == direction).any():
            continue
        near = nearest.loc[nearest["direction"] == direction, "distance"]
        if near.empty:
            why = f"no track lasts {least:g} Δ and one frame more"
        else:
            most = np.ceil(10 * near.min() / step + 1e-6) / 10
            why = f"gateways.distance_threshold={most:.1f} would give some"
        print(f"gateways: no gateway {word} the film; {why}", file=sys.stderr)


def main() -> None:
    """Write the gateways and nearest pairs to data/gateways/, metrics to reports/gateways/."""
    settings: GatewaysSettings = load("gateways")
    with Project() as project:
        features, sprites, facts = project.features, project.sprites, project.map_facts
        rate_hz, step = project.rate_hz, facts.step_median
        rows = map_rows(features, project.steps)
        with progress("gateways", len(rows)) as advance:
            near = nearness(project.reel, rows, facts.size, facts.pose, advance)
        ways = gateways(near, sprites, features, step, settings)
        without_threshold = replace(settings, distance_threshold=np.inf)
        nearest = gateways(near, sprites, features, step, without_threshold)
    report_missing_gateways(ways, nearest, step, settings.least)
    with whole_folder(Path("data/gateways")) as folder:
        save_table(folder / "gateways.parquet", ways, GATEWAYS)
        save_table(folder / "nearest.parquet", nearest, GATEWAYS)
    metrics = gateway_metrics(ways, nearest, near, features, rate_hz, step)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
