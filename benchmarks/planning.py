"""The start of the live tank, or the ticks planned per second, from the stages' outputs in data/.

`python -m benchmarks.planning start` opens the live tank, shows a frame and exits. `… plan` plans
and writes ticks per second of wall time and of processor time, by mode.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import json
import sys
import time
from pathlib import Path

import numpy as np

from finloop.animate.places import random_goals
from finloop.animate.shoal import plan_edit_list
from finloop.project import Project
from stages.play import open_modes, open_view

TICKS, WARM_UP, GOALS = 10_000, 1_000, 20


def start_tank() -> None:
    """Open the live tank and show its first frame."""
    with open_view("hybrid", None, 0) as view:
        view.render_frame()


def time_planning() -> None:
    """Write planning.json: ticks per second of wall time and of processor time, by mode."""
    numbers = {}
    with Project() as project:
        for mode, animator in open_modes(project).items():
            player = animator.player
            goals = random_goals(player.world, GOALS, np.random.default_rng(0))
            plan_edit_list(player, goals, WARM_UP, np.random.default_rng(2))
            wall, processor = time.perf_counter(), time.process_time()
            plan_edit_list(player, goals, TICKS, np.random.default_rng(1))
            numbers[f"{mode}_ticks_per_s"] = TICKS / (time.perf_counter() - wall)
            numbers[f"{mode}_ticks_per_processor_s"] = TICKS / (time.process_time() - processor)
    Path("planning.json").write_text(json.dumps(numbers, indent=2), encoding="utf-8")


if __name__ == "__main__":
    {"start": start_tank, "plan": time_planning}[sys.argv[1]]()
