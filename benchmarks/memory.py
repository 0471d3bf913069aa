"""Peak memory of `extract` and `features` for a short clip and one ten times as long.

`python -m benchmarks.memory` prints a table and writes benchmarks/memory.csv.
"""

import os
import resource
import tempfile
from pathlib import Path

import pandas as pd

from benchmarks.pipeline import ROOT, STAGES, prepare, stage

FRAMES = (500, 5000)


def peak_mb(folder: Path, word: str) -> float:
    """Peak resident memory, in MB, of one stage run in a process of its own."""
    pid = os.fork()
    if pid == 0:
        stage(folder, word)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        (folder / "peak").write_text(str(peak))
        os._exit(0)
    os.waitpid(pid, 0)
    return int((folder / "peak").read_text()) / 1024


def main() -> None:
    """Measure, print, write."""
    rows = {}
    with tempfile.TemporaryDirectory() as scratch:
        for frames in FRAMES:
            size = ["clip.width_px=480", "clip.height_px=360", "clip.body_length_px=60"]
            prepare(Path(scratch), ["clip=carp", f"clip.frames={frames}", *size])
            rows[f"{frames} frames, MB"] = {w: peak_mb(Path(scratch), w) for w in STAGES}
    table = pd.DataFrame(rows)
    table["ratio"] = table.iloc[:, 1] / table.iloc[:, 0]
    print(table.round(3).to_string())
    table.round(3).to_csv(ROOT / "benchmarks/memory.csv", index_label="stage")


if __name__ == "__main__":
    main()
