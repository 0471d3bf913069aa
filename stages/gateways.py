"""Stage `gateways`: the most similar frames and sprites, in both directions (Fig. 14)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.distance.map import find_map_rows
from finloop.gateways.find import (
    GATEWAYS,
    IN,
    OUT,
    gateway_metrics,
    list_gateways,
    measure_sprite_distances,
)
from finloop.gateways.settings import GatewaysSettings
from finloop.io.atomic import whole_folder
from finloop.io.table import save_table
from finloop.project import Project
from stages.settings import load_settings

REPORT = Path("reports/gateways")
WORDS = {IN: "into", OUT: "out of"}  # a gateway leads from sprites into the film, or out of it


def _report_missing(
    found: pd.DataFrame, nearest: pd.DataFrame, step: float, least_deltas: float
) -> None:
    """Print which direction has no gateway, and the threshold that would give one.

    A gateway is a pair of a frame and a sprite that look alike. found: the gateways. nearest: the
    nearest pairs, however unlike. step: the natural step, distance between successive pictures.
    least_deltas: least time, in Δ, for which film is played.
    """
    for direction, word in WORDS.items():
        if (found["direction"] == direction).any():
            continue
        distances = nearest.loc[nearest["direction"] == direction, "distance"]
        if distances.empty:
            why = f"no track lasts {least_deltas:g} Δ and one frame more"
        else:
            # Rounded up to 0.1, and never so tight that a rounding error refuses the pair.
            threshold = np.ceil(10 * distances.min() / step + 1e-6) / 10
            why = f"gateways.distance_threshold={threshold:.1f} would give some"
        print(f"gateways: no gateway {word} the film; {why}", file=sys.stderr)


def main() -> None:
    """Find the gateways, pairs of a frame and a sprite between which the animation can change.

    data/gateways/ gets them and, for comparison, the nearest pairs; reports/gateways/ the metrics.
    """
    settings: GatewaysSettings = load_settings("gateways")
    with Project() as project:
        features, sprites, facts = project.features, project.sprites, project.map_facts
        rate_hz, step = project.rate_hz, facts.step_median
        rows = find_map_rows(features, project.step_distances)
        with report_progress("gateways", len(rows)) as advance:
            distances = measure_sprite_distances(
                project.reel, rows, facts.size, facts.frame_of_reference, advance
            )
        found = list_gateways(distances, sprites, features, step, settings)
        nearest = list_gateways(
            distances, sprites, features, step, replace(settings, distance_threshold=np.inf)
        )
    _report_missing(found, nearest, step, settings.min_deltas_ahead)
    with whole_folder(Path("data/gateways")) as folder:
        save_table(folder / "gateways.parquet", found, GATEWAYS)
        save_table(folder / "nearest.parquet", nearest, GATEWAYS)
    metrics = gateway_metrics(found, nearest, distances, features, rate_hz, step)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
