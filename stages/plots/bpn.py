"""Pictures of `bpn`: the error per epoch (Fig. 15), and predictions beside the truth."""

from pathlib import Path

from finloop.bpn.held_out import HELD_OUT
from finloop.io.picture import save_figure
from finloop.io.table import load_csv, load_table
from finloop.plots.bpn import draw_held_out_predictions, figure15

REPORT = Path("reports/motion/bpn")


def main() -> None:
    """Draw the network's errors per epoch (Fig. 15), and predictions beside the truth."""
    held_out = load_table(Path("data/bpn/held_out.parquet"), HELD_OUT).to_numpy()
    save_figure(REPORT / "fig15.png", figure15(load_csv(Path("reports/bpn/curve.csv"))))
    predicted_figure = draw_held_out_predictions(held_out[:, :2], held_out[:, 2:])
    save_figure(REPORT / "held_out.png", predicted_figure)
