"""The paper's Table 2 and ours: `python -m benchmarks.table2` writes table2.csv.

The stages run one after the other on the zebrafish, including the start of Python and files. The
clip is fetched once and kept, as by `make demo`; like the paper's, the table excludes fetching and
normalising.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
from functools import partial
from pathlib import Path

import pandas as pd

from benchmarks.animate import STAGES
from benchmarks.pipeline import prepare_folder, run_stage, write_table
from benchmarks.speed import time_call
from finloop.edit.modes import MODES
from finloop.io.numbers import load_numbers

PAPER_FRAMES = 4480
TABLE = (
    ("extracting fish images", "several hours", ("extract", "features")),
    ("motion model, 200 epochs", "about 70 s", ("bpn",)),
    ("analysing video loops", "about 30 min", ("distance", "loops")),
    ("fish images for all orientations", "about 15 min", ("sprites",)),
    ("gateways", "several hours", ("gateways",)),
    ("poses, jumps and forecast, not in the paper", "–", ("pose", "jumps", "forecast")),
    *(
        (f"animation, {mode}", "real time" if mode == "hybrid" else "–", (f"modes-{mode}",))
        for mode in MODES
    ),
)


def main() -> None:
    """Run all stages once; print and write the times beside those of the paper's Table 2."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        prepare_folder(folder, ["clip=zebrafish"])
        seconds = {}
        for stage in (*STAGES, *(f"modes-{mode}" for mode in MODES)):
            seconds[stage], _ = time_call(partial(run_stage, folder, stage))
        fish_frames = load_numbers(folder / "reports/features")["fish_frames"]
    ours = f"here, s ({fish_frames} fish-frames)"
    rows = [
        (process, paper, round(sum(seconds[stage] for stage in stage_names), 1))
        for process, paper, stage_names in TABLE
    ]
    columns = ["process", f"paper ({PAPER_FRAMES} frames)", ours]
    write_table(__file__, pd.DataFrame(rows, columns=columns))
    print("each mode: an animation of 60 s, `animate.trials` and those that `realism` compares")


if __name__ == "__main__":
    main()
