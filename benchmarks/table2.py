"""The paper's Table 2 and ours: `python -m benchmarks.table2` writes table2.csv.

The stages run one after the other on the zebrafish, including the start of Python and files. The
clip is fetched once and kept, as by `make demo`; like the paper's, the table excludes fetching and
normalising.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import json
import tempfile
import time
from pathlib import Path

import pandas as pd

from benchmarks.animate import STAGES
from benchmarks.pipeline import prepare_folder, run_stage, write_table
from finloop.edit.modes import MODES

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
        took = {}
        for word in (*STAGES, *(f"modes-{mode}" for mode in MODES)):
            start = time.perf_counter()
            run_stage(folder, word)
            took[word] = time.perf_counter() - start
        features = (folder / "reports/features/metrics.json").read_text(encoding="utf-8")
        fish_frames = json.loads(features)["fish_frames"]
    table = pd.DataFrame(
        [
            {
                "process": process,
                f"paper ({PAPER_FRAMES} frames)": paper,
                f"here, s ({fish_frames} fish-frames)": round(sum(took[word] for word in words), 1),
            }
            for process, paper, words in TABLE
        ]
    )
    write_table(__file__, table)
    print("each mode: an animation of 60 s, `animate.trials` and those that `realism` compares")


if __name__ == "__main__":
    main()
