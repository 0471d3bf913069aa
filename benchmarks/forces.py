"""Speed of curves and drawings in fields of force: `python -m benchmarks.forces`.

Writes benchmarks/forces.csv: for each case the least and the median time of 40 runs, the least time
of the processor (which other programs on the machine do not lengthen as much), and the limit. A
solve is of 256 points, bent and let go for a second at 60 frames; the drawing is the face with 10
of its layers, 60 frames of 2 s. The limits are those of morphs.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from time import process_time

import numpy as np
import pandas as pd

from benchmarks.curve import bend_hoop
from benchmarks.pipeline import ROOT, write_table
from benchmarks.speed import time_call
from finloop.curve.dynamics import Material, Problem
from finloop.curve.forces import Attraction, Forces, Wind, solve_in_forces
from finloop.io.svg import load_svg
from finloop.morph.force_list import parse_forces
from finloop.morph.in_forces import STEPS, TARGET_POINTS, move_drawing
from finloop.morph.layers import PhysicalOptions

POINTS, FRAMES, RUNS, LAYERS = 256, 60, 40, 10
SOLVE_MS, DRAWING_MS = 15.0, 1000.0
MATERIAL = Material(1.0, 2.0, 0.5, 0.02)
PHYSICS = PhysicalOptions(2.0, 0.5, 1.0, 0.02)
FALL = Forces(gravity=(0.0, 5.0), floor=2.0, friction=0.5)


def solve_cases() -> dict[str, Callable[[], object]]:
    """Return the solves of a curve of POINTS points by name."""
    rest, bend = bend_hoop(POINTS)
    problem = Problem(rest, bend, MATERIAL, np.arange(FRAMES) / FRAMES)
    is_held = np.zeros((POINTS, 1), bool)
    is_held[:8] = True
    pull = Attraction(2 * bend_hoop(TARGET_POINTS)[0], 4.0)
    gusts = Wind((1.0, 0.0), 2.0, 0.5)
    cases = {
        "gravity, a floor": FALL,
        "gusts, held points": Forces(winds=(gusts,), is_held=is_held),
        "attraction to a curve": Forces(attractions=(pull,)),
    }
    substeps = int(np.ceil(STEPS / FRAMES))
    return {name: partial(solve_in_forces, problem, f, substeps) for name, f in cases.items()}


def drawing_case() -> Callable[[], object]:
    """Return the motion of a drawing of LAYERS contours."""
    face = load_svg(ROOT / "data/drawings/face_a.svg")
    face = replace(face, curves=dict(list(face.curves.items())[:LAYERS]))
    forces = parse_forces(["gravity=3", "floor=390", "wind=0.5,0,gust=0.5"])
    rate = Fraction(FRAMES, 2)
    return partial(move_drawing, face, face, forces, FRAMES, rate, POINTS, physics=PHYSICS)


def main() -> None:
    """Time all cases; print and write the table."""
    works = {f"a solve of {POINTS} points: {name}": w for name, w in solve_cases().items()}
    works[f"{LAYERS} layers, {FRAMES} frames"] = drawing_case()
    rows = []
    for name, work in works.items():
        work()  # compiles
        ms, cpu_ms = list[float](), list[float]()
        for _ in range(RUNS):
            start = process_time()
            ms.append(1000 * time_call(work)[0])
            cpu_ms.append(1000 * (process_time() - start))
        limit = DRAWING_MS if "layers" in name else SOLVE_MS
        rows.append({
            "what": name, "ms_least": min(ms), "ms_median": np.median(ms),
            "cpu_ms_least": min(cpu_ms), "limit_ms": limit,
        })  # fmt: skip
    write_table(__file__, pd.DataFrame(rows).round(1))


if __name__ == "__main__":
    main()
