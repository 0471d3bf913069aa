"""Speed of planning: ticks per second, beside the copy of one frame through memory.

`python -m benchmarks.animate` animates a drawn carp in every mode and writes
benchmarks/animate.csv. A tick costs its share of deciding, moving and writing the edit list. The
limit is the least work of a player: to copy one 1280×720 frame. Both run in turn, and the table
has the median of the pairwise ratios.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.pipeline import data_stages, prepare_folder, run_stage, write_table
from benchmarks.speed import time_pairs
from finloop.animate.places import random_goals
from finloop.animate.protocols import AnyPlayer
from finloop.animate.shoal import plan_edit_list
from finloop.edit.schema import Goal
from finloop.project import Project
from stages.play import open_modes

TICKS, COPIES = 20_000, 500
MODES = "modes-"  # these stages do not run here: `open_modes` replaces them
STAGES = [name for name in data_stages(["animate"]) if not name.startswith(("animate", MODES))]


def main() -> None:
    """Print and write the table of planned ticks per second, by mode."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        prepare_folder(scratch, ["clip=carp", "clip.frames=750"])
        for stage in STAGES:
            run_stage(scratch, stage)
        with chdir(scratch), Project() as project:
            players = {name: mode.player for name, mode in open_modes(project).items()}
    frame = np.zeros((720, 1280, 3), np.uint8)
    canvas = np.empty_like(frame)

    def copy() -> None:
        for _ in range(COPIES):
            np.copyto(canvas, frame)

    rows = []
    for name, fish in players.items():
        goals = random_goals(fish.world, 20, np.random.default_rng(0))

        def swim(fish: AnyPlayer = fish, goals: list[Goal] = goals) -> None:
            plan_edit_list(fish, goals, TICKS, np.random.default_rng(1))

        planning_s, copying_s, _, _ = time_pairs(swim, copy)
        tick_s = planning_s / TICKS
        rows += [
            (f"{name}: planning and edit list", "ticks/s", TICKS / planning_s),
            (f"{name}: time of a tick / time of a copy", "1", tick_s / (copying_s / COPIES)),
        ]
    table = pd.DataFrame(rows, columns=["what", "unit", "value"])
    write_table(__file__, table, "%.4g")


if __name__ == "__main__":
    main()
