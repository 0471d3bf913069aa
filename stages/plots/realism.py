"""Pictures of `realism`: ROC curves and channels, and the most obviously false windows."""

from pathlib import Path

import pandas as pd

from finloop.io.picture import save_figure
from finloop.io.table import load_table
from finloop.plots.realism import draw_false_windows, draw_roc
from finloop.project import Project
from finloop.realism.examples import CURVES, EXAMPLES, SIDES, draw_strip
from finloop.render.painter import Painter

OUT, REPORT = Path("data/realism"), Path("reports/modes/realism")
STRIP = 10, 130  # pictures, px


def main() -> None:
    """Draw how well animation and film are distinguished, and the most obviously false windows.

    A window is a short stretch of swimming.
    """
    auc, roc = (pd.read_csv(OUT / name) for name in ("auc.csv", "roc.csv"))
    save_figure(REPORT / "auc.png", draw_roc(auc, roc))

    table = load_table(OUT / "examples.parquet", EXAMPLES)
    titles, strips = [], []
    with Project() as project:
        gallery, painter = project.whole_gallery, Painter(project.background)
        length = project.scene.typical_length_px
        for number, example in table.groupby("example"):
            pictures = {}
            for side in SIDES:  # film and animation
                window = example[example["side"] == side]
                pictures[side] = draw_strip(window, gallery, painter, length, *STRIP)
            strips.append(pictures)
            titles.append(f"{number + 1}: {example['compared'].iloc[0]}")
    curves = load_table(OUT / "curves.parquet", CURVES)
    save_figure(REPORT / "contact_sheet.png", draw_false_windows(curves, titles, strips))
