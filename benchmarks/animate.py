"""Speed of planning: ticks per second, beside the copy of one frame through memory.

`python -m benchmarks.animate` swims a drawn carp and writes benchmarks/animate.csv. A tick costs
its share of deciding, moving and writing the edit list; the limit is what a player cannot do
without, to copy one 1280×720 frame. Both are run in turn, and the median of the pairwise ratios is
given.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import os
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.pipeline import prepare, stage
from benchmarks.speed import paired
from finloop.animate import random_goals
from finloop.files.cutouts import open_cutouts
from finloop.files.table import load_table
from stages.animate import EXTRACT, FEATURES, SPRITES_FOLDER, bring
from stages.params import load
from stages.params.animate import OPTIONS

TICKS, COPIES = 50_000, 500
STAGES = ("clip", "extract", "features", "bpn", "sprites")


def main() -> None:
    """Print and write the table."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        prepare(scratch, ["clip=carp", "clip.frames=750"])
        for word in STAGES:
            stage(scratch, word)
        home = Path.cwd()
        os.chdir(scratch)
        try:
            features = load_table(Path("data/features/features.parquet"), FEATURES)
            with (
                open_cutouts(SPRITES_FOLDER / "sprites.arrow") as store,
                open_cutouts(EXTRACT / "cutouts.arrow") as film,
            ):
                fish = bring(load("animate", OPTIONS), features, film, store).fish
        finally:
            os.chdir(home)
    mode = fish.mode
    rng = np.random.default_rng(0)
    goals = random_goals(mode.tank, mode.touch_px, 20, rng)
    frame = np.zeros((720, 1280, 3), np.uint8)
    canvas = np.empty_like(frame)

    def copy() -> None:
        for _ in range(COPIES):
            np.copyto(canvas, frame)

    ours, theirs, _, _ = paired(lambda: fish.play(goals, TICKS, np.random.default_rng(1)), copy)
    table = pd.DataFrame(
        [
            ("planning and edit list", "ticks/s", TICKS / ours),
            ("copy of one 1280×720 frame", "frames/s", COPIES / theirs),
            ("time of a tick / time of a copy", "1", (ours / TICKS) / (theirs / COPIES)),
        ],
        columns=["what", "unit", "value"],
    )
    print(table.to_string(index=False))
    table.to_csv(Path(__file__).with_name("animate.csv"), index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
