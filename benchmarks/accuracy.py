"""Accuracy on the drawn carp against its ground truth: ten seeds, and harder films.

`python -m benchmarks.accuracy [--quick]` prints a table and writes benchmarks/accuracy.csv.
"""

import argparse
import tempfile
from pathlib import Path

import pandas as pd

from benchmarks.pipeline import ROOT, STAGES, prepare_folder, run_stage

FILMS = {
    **{f"seed {seed}": [f"clip.seed={seed}"] for seed in range(1, 11)},
    "fins always open": ["clip.fins_open_ratio=1.0"],
    "doubled noise": ["clip.noise_grey=5.0"],
    "grey film": ["clip.colour=false"],
    "three fish": ["clip.fish=3"],
    "60 px long": ["clip.body_length_px=60"],
}
COLUMNS = {
    "truth_found_pct": "found %",
    "tracks": "tracks",
    "truth_centre_error_median_px": "centre px",
    "truth_backbone_error_mean_pct": "backbone %",
    "truth_body_length_bias_pct": "length bias %",
    "truth_heading_error_median_deg": "heading °",
    "truth_heading_error_p95_deg": "heading p95 °",
    "truth_head_tail_swaps": "swaps",
    "truth_swimming_type_agreement_pct": "type %",
    "truth_motion_area_bend_rank_correlation": "area~bend",
    "truth_identity_changes": "identity changes",
}


def main(quick: bool = False) -> None:
    """Run the pipeline on every film and print the accuracy; quick: 300 frames each."""
    rows = {}
    with tempfile.TemporaryDirectory() as scratch:
        for name, overrides in FILMS.items():
            length = ["clip.frames=300"] if quick else []
            prepare_folder(Path(scratch), ["clip=carp", *length, *overrides])
            for stage in STAGES:
                metrics = run_stage(Path(scratch), stage)
            rows[name] = {title: metrics[key] for key, title in COLUMNS.items()}
            print(name, rows[name], flush=True)
    table = pd.DataFrame(rows).T
    print(table.to_string(float_format="{:.3g}".format))
    if not quick:
        table.round(4).to_csv(ROOT / "benchmarks/accuracy.csv", index_label="film")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="300 frames a film instead of 1500")
    main(parser.parse_args().quick)
