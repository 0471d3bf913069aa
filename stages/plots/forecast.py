"""Pictures of `forecast`: learning and the spread; a fish that swims freely beside the film."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from finloop.features.table import FEATURES
from finloop.forecast.assess import FREE, HELD_OUT
from finloop.io.picture import save_figure
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.plots.forecast import free_figure, learning_figure
from stages.forecasts import load_look, states_of
from stages.poses import load_poses

DATA, REPORT = Path("data"), Path("reports/forecast")


def main() -> None:
    """Draw learning.png and free.png; empty pictures where there is no model."""
    folder = DATA / "forecast"
    if (folder / "reason.json").exists():
        for name in ("learning", "free"):
            save_figure(REPORT / f"{name}.png", Figure(figsize=(2, 1)))
        return
    features = load_table(DATA / "features/features.parquet", FEATURES)
    poses = load_poses(features)
    rate_hz = load_facts(DATA / "clip" / FACTS_NAME).frame_rate_hz
    film = states_of(features, poses, load_look(), rate_hz)
    curve = pd.read_csv(REPORT / "curve.csv")
    held_out = load_table(folder / "held_out.parquet", HELD_OUT)
    save_figure(REPORT / "learning.png", learning_figure(curve, held_out))
    save_figure(REPORT / "free.png", free_figure(film, load_table(folder / "free.parquet", FREE)))


if __name__ == "__main__":
    run(main)
