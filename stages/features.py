"""Stage `features`: tracks become the feature table, Fig. 7, Table 1 and pictures."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.drawn.truth import TRUTH
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.metrics import against_truth, summary, table1
from finloop.features.settings import Settings
from finloop.features.table import FEATURES, USED, features
from finloop.io.cutouts import CutoutStore, open_cutouts
from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.io.record import load_record
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import FACTS_NAME, TRUTH_NAME, load_facts
from finloop.plots.features import (
    Specimen,
    contact_sheet,
    figure7,
    longest_track,
    most_doubtful,
    rose,
    trajectories,
)
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
TRACKS_NAME, CUTOUTS_NAME, SCENE_NAME = "tracks.parquet", "cutouts.arrow", "scene.json"
TABLE, REPORT = Path("data/features/features.parquet"), Path("reports/features")
SHOWN = 48  # fish on the contact sheet


def specimens(
    table: pd.DataFrame,
    backbones: np.ndarray,
    numbers: np.ndarray,
    cutouts: CutoutStore,
    background: np.ndarray,
) -> Iterator[Specimen]:
    """Rows of the table with their cut-outs laid over the empty tank."""
    for number in numbers.tolist():
        row, cutout = table.iloc[number], cutouts[number]
        yield Specimen(row, backbones[number], cutout.over(background), cutout.x0_px, cutout.y0_px)


def main() -> None:
    """Make data/features/, reports/features/."""
    settings: Settings = load("features")
    facts = load_facts(CLIP / FACTS_NAME)
    scene = load_record(EXTRACT / SCENE_NAME, SceneFacts, "extract")
    tracks = load_table(EXTRACT / TRACKS_NAME, tracks_schema(scene.points), USED)
    table, backbones = features(tracks, facts.frame_rate_hz, settings)
    save_table(TABLE, table, FEATURES)

    metrics = summary(table)
    truth = CLIP / TRUTH_NAME
    if truth.exists():
        true = load_table(truth, TRUTH)
        metrics |= against_truth(table, backbones, true)
    save_csv(REPORT / "table1.csv", table1(table), decimals=3)
    fig7 = longest_track(table)[["frame", "motion_area_rel", "swimming_type"]]
    save_csv(REPORT / "fig7.csv", fig7, decimals=4)

    background = load_picture(EXTRACT / "background.png")
    with open_cutouts(EXTRACT / CUTOUTS_NAME) as cutouts, progress("features", 4, "pictures") as on:
        shown = specimens(table, backbones, most_doubtful(table, SHOWN), cutouts, background)
        save_picture(REPORT / "contact_sheet.png", contact_sheet(shown))
        on()
        save_figure(REPORT / "fig7.png", figure7(table))
        on()
        save_figure(REPORT / "trajectories.png", trajectories(table, background))
        on()
        save_figure(REPORT / "rose.png", rose(table))
        on()
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
