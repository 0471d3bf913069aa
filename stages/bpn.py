"""Stage `bpn`: learn the motion model from the feature table, and its errors (Fig. 15)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from finloop.base.errors import FinloopError
from finloop.bpn.back_propagation import train_on_film_rows
from finloop.bpn.held_out import HELD_OUT, assess_model, held_out_table
from finloop.bpn.model import pair_rows_with_later, split_rows, split_rows_if_possible
from finloop.bpn.onnx import export_onnx_bytes
from finloop.bpn.settings import BpnSettings
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import save_bytes
from finloop.io.record import save_json
from finloop.io.table import save_csv, save_table
from finloop.project import Project
from stages.settings import load_settings

OUT, REPORT = Path("data/bpn"), Path("reports/bpn")


def main() -> None:
    """Train the network that predicts motion area and swimming type, and measure its errors.

    It is written to data/bpn/ (JSON and ONNX, with its predictions of held-out rows), the errors to
    reports/bpn/. Where possible a second network is trained, only to be tested on another split.
    """
    p: BpnSettings = load_settings("bpn")
    project = Project()
    rate_hz, table = project.rate_hz, project.features
    rows = pair_rows_with_later(table, infer_delta_frames(table))
    train, held_out = split_rows_if_possible(rows, p)  # masks (n,)
    splits = learnt_splits = [(train, held_out)]
    if not held_out.any():
        print(f"bpn: so short a film trains the network with all {len(rows.inputs)} rows; none is "
              "held out, so its error on other film is unknown", file=sys.stderr)  # fmt: skip
    # The other split tests the network on other times, or on other fish.
    with suppress(FinloopError):  # one track, or too short
        other = split_rows(rows, "tracks" if p.held_out_by == "blocks" else "blocks", p)
        splits = [*splits, other]
        # The learning curve of the other network is not kept, so it needs no held-out rows.
        learnt_splits = [*splits[:1], (other[0], np.zeros_like(other[0]))]
    with report_progress("bpn", p.epochs * len(splits), "epochs") as advance:
        trained = [train_on_film_rows(rows, split, p, rate_hz, advance) for split in learnt_splits]
    metrics, *other_metrics = (
        assess_model(model, rows, *split) for (model, _), split in zip(trained, splits, strict=True)
    )
    for values in other_metrics:
        names = [name for name in values if "held_out" in name or "skill" in name]
        metrics |= {f"other_split_{name}": values[name] for name in names}
    model, curve = trained[0]
    save_json(OUT / "model.json", model.to_values(), indent=1)
    save_bytes(OUT / "model.onnx", export_onnx_bytes(model))
    save_csv(REPORT / "curve.csv", curve, decimals=5)
    save_table(OUT / "held_out.parquet", held_out_table(model, rows, held_out), HELD_OUT)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
