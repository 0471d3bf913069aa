"""Picture of `distance`: both maps of the longest tracks (Fig. 9)."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.distance.map import MapFacts, about_mean, alike, full, kinds
from finloop.distance.settings import Settings
from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import save_figure
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.plots.distance import figure9, picture_rows
from finloop.reel import Reel
from stages.settings import load


def main() -> None:
    """Draw fig9.png."""
    p: Settings = load("distance")
    facts = load_record(Path("data/distance/facts.json"), MapFacts, "distance")
    features = load_table(Path("data/features/features.parquet"), FEATURES)
    rows = picture_rows(features, p.picture_frames)
    with open_cutouts(Path("data/extract/cutouts.arrow")) as film:
        distance = full(about_mean(Reel(features, film).frames(rows, facts.size, facts.pose)))
    features = features.iloc[rows]
    compared = alike(
        kinds(features, facts.pose), features["motion_area_rel"].to_numpy(), p.area_threshold
    )
    figure = figure9(distance, compared, features["track_id"].to_numpy(), facts.step_median)
    save_figure(Path("reports/distance/fig9.png"), figure)


if __name__ == "__main__":
    run(main)
