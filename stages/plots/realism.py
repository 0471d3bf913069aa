"""Pictures of `realism`: ROC curves and channels, and what gives an animation away."""

from pathlib import Path

import numpy as np

from finloop.io.mapped import open_array
from finloop.io.picture import save_figure
from finloop.io.record import load_json, remake_hint
from finloop.io.table import load_csv, load_table
from finloop.plots.realism import draw_false_windows, draw_looks, draw_obvious_crops, draw_roc
from finloop.project import Project
from finloop.realism.crops import SIZE
from finloop.realism.examples import CURVES, EXAMPLES, SIDES, draw_strip
from finloop.render.painter import Painter

OUT, REPORT = Path("data/realism"), Path("reports/modes/realism")
STRIP = 10, 130  # pictures, px


def _draw_pictures() -> None:
    """Draw where the network looks, looks.png, and the most obviously false crops, pictures.png."""
    names: list[str] = load_json(OUT / "looks.json", list, *remake_hint("realism"))
    looks = open_array(OUT / "looks.npy", (None,) * (4 if names else 1), "float32")
    shown = load_csv(OUT / "pictures.csv")
    crops = np.asarray(open_array(OUT / "crops.npy", (None, 2, None, SIZE, SIZE), "uint8"))
    first = shown.drop_duplicates("compared").set_index("compared")["example"]
    under = {str(name): crops[number, 0, 0] for name, number in first.items()}
    save_figure(REPORT / "looks.png", draw_looks(dict(zip(names, looks, strict=True)), under))
    titles = [f"{number + 1}: {name}" for number, name in enumerate(shown["compared"])]
    save_figure(REPORT / "pictures.png", draw_obvious_crops(titles, crops))


def main() -> None:
    """Draw how well animation and film are distinguished, and the most obviously false windows.

    A window is a short stretch of swimming.
    """
    auc, roc = (load_csv(OUT / name) for name in ("auc.csv", "roc.csv"))
    for by, name in (("motion", "auc.png"), ("picture", "picture_auc.png")):
        save_figure(REPORT / name, draw_roc(auc[auc["by"] == by], roc[roc["by"] == by]))
    _draw_pictures()

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
