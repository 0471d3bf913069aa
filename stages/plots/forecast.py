"""Pictures of `forecast`: learning and the spread; a fish that swims freely beside the film."""

from pathlib import Path

from matplotlib.figure import Figure

from finloop.forecast.assess import FREE, HELD_OUT
from finloop.io.picture import save_figure
from finloop.io.table import load_csv, load_table
from finloop.plots.forecast import draw_free_swimming, draw_learning
from finloop.project import Project

REPORT = Path("reports/motion/forecast")


def main() -> None:
    """Draw the forecast's errors per epoch, and a fish that only the forecast moves.

    The files are learning.png and free.png in reports/motion/forecast/, empty without a model.
    """
    project = Project()
    if not project.has_forecast:
        for name in ("learning", "free"):
            save_figure(REPORT / f"{name}.png", Figure(figsize=(2, 1)))
        return
    folder, curve = project.data / "forecast", load_csv(Path("reports/forecast/curve.csv"))
    held_out = load_table(folder / "held_out.parquet", HELD_OUT)
    free = draw_free_swimming(project.forecast_states, load_table(folder / "free.parquet", FREE))
    save_figure(REPORT / "learning.png", draw_learning(curve, held_out))
    save_figure(REPORT / "free.png", free)
