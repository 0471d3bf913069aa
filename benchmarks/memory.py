"""Peak memory of `clip`, `extract` and `features` for a short clip and one ten times as long.

`python -m benchmarks.memory` prints a table and writes benchmarks/memory.csv.
"""

import tempfile
from pathlib import Path

import pandas as pd

from benchmarks.pipeline import ROOT, STAGES, peak_mib, prepare_folder

FRAMES = (500, 5000)


def main() -> None:
    """Measure peak memory for both clips; print and write the table."""
    rows = {}
    with tempfile.TemporaryDirectory() as scratch:
        for frames in FRAMES:
            size = ["clip.width_px=480", "clip.height_px=360", "clip.body_length_px=60"]
            prepare_folder(Path(scratch), ["clip=carp", f"clip.frames={frames}", *size])
            rows[f"{frames} frames, MiB"] = {
                word: peak_mib(Path(scratch), "-m", f"stages.{word}") for word in STAGES
            }
    table = pd.DataFrame(rows)
    table["ratio"] = table.iloc[:, 1] / table.iloc[:, 0]
    print(table.round(3).to_string())
    table.round(3).to_csv(ROOT / "benchmarks/memory.csv", index_label="stage")


if __name__ == "__main__":
    main()
