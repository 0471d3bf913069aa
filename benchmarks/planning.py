"""Start of the live tank, its reaction to a goal, or ticks planned per second, from data/.

`python -m benchmarks.planning start` opens the live tank, shows a frame and exits. `… plan` plans
and writes ticks per second of wall time and of processor time, by mode. `… react` sends the fish of
a live tank to goals and prints how long the ticks take in which it plans for them.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import gc
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
REACTIONS, MOST_WAIT = 500, 30  # goals; ticks between two of them


def start_tank() -> None:
    """Open the live tank and make what a page gets first."""
    with open_view("hybrid", None, 0) as view:
        view.opening_messages()
        view.frame_messages()


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


def time_reactions() -> None:
    """Print the milliseconds of processor time from a goal to its plan and the edit list's row.

    They are those of the first goal, which may load compiled functions, and percentiles of all
    others. One fish in mode `matching` is sent on while it swims, after 1 to 30 ticks.
    """
    rng, took = np.random.default_rng(0), []
    with open_view("matching", 1, 0) as view:
        tank, (height, width) = view.tank, view.feed.tank.floor.shape[:2]
        gc.freeze()  # as the server of the page does
        for _ in range(REACTIONS):
            for _ in range(rng.integers(1, MOST_WAIT + 1)):
                tank.advance()
            start = time.process_time()
            tank.send_to_goal(0, rng.uniform(0, width), rng.uniform(0, height))
            tank.advance()
            took.append(1e3 * (time.process_time() - start))
        gc.unfreeze()
    first, *others = took
    numbers = {f"percentile {share}": np.percentile(others, share) for share in (50, 99, 100)}
    print({name: round(float(ms), 2) for name, ms in {"first": first, **numbers}.items()})


if __name__ == "__main__":
    {"start": start_tank, "plan": time_planning, "react": time_reactions}[sys.argv[1]]()
