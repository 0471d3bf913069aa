"""Folding of morphs: all pairs of single-contour letters and digits of DejaVu Sans, and regions.

`python -m benchmarks.morph` prints the table and writes benchmarks/morph.csv, for 256 points and 60
frames in between: the exact share of pairs with only strictly simple frames; the processor time of
a pair, the less of two; the vertices' path length, relative to the linear morph. The figures of
other tools are earlier measurements on 276 such pairs. Regions are 300 random pairs of glyphs of
three fonts that are in one piece, with holes in one of them at least.
"""

from functools import partial

import os  # isort: skip

os.environ["FINLOOP_THREADS"] = "1"  # one core, also for matrix products
import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import string
import time
from collections.abc import Callable
from itertools import combinations
from typing import TypeVar

import numpy as np
import pandas as pd

from benchmarks.pipeline import write_table
from finloop.base.arrays import Points
from finloop.curve.contour import Curve
from finloop.curve.glyph import glyph_outlines
from finloop.morph.folds import (
    ContourLayout,
    count_contour_folds,
    count_polygon_folds,
    stays_simple,
)
from finloop.morph.layers import PhysicalOptions, linear_morph, physical_morph
from finloop.morph.regions import split_regions
from finloop.morph.simple import (
    morph_regions_without_folds,
    morph_without_folds,
    path_lengths,
)

FRAMES, POINTS = 60 + 2, 256
PHYSICS = PhysicalOptions(elastic=0.1, damping=4.0, mass=1.0)
OTHERS = {
    "d3-interpolate-path": 15.9,
    "polymorph": 17.8,
    "flubber": 19.9,
    "linear, best shift": 31.9,
    "intrinsic blend after Sederberg": 39.5,
}


def single_contour_glyphs() -> dict[str, Curve]:
    """Return the outlines of all letters and digits with a single contour."""
    outlines = {name: glyph_outlines(name) for name in string.ascii_letters + string.digits}
    return {name: found[0] for name, found in outlines.items() if len(found) == 1}


FONTS, REGION_PAIRS = ("DejaVu Sans", "DejaVu Serif", "STIXGeneral"), 300


def random_regions() -> list[tuple[list[Curve], list[Curve]]]:
    """Return random pairs of glyphs in one piece, of which the first has holes."""
    glyphs = [
        outlines
        for font in FONTS
        for name in string.ascii_letters + string.digits + "&@#"
        if len(split_regions(outlines := glyph_outlines(name, font))) == 1
    ]
    with_holes = [number for number, outlines in enumerate(glyphs) if len(outlines) > 1]
    rng = np.random.default_rng(0)
    return [
        (glyphs[rng.choice(with_holes)], glyphs[rng.integers(len(glyphs))])
        for _ in range(REGION_PAIRS)
    ]


Result = TypeVar("Result")


def measure_call(work: Callable[[], Result]) -> tuple[float, Result]:
    """Return the processor seconds that `work` takes, the less of two times, and its result."""
    seconds = []
    for _ in range(2):
        start = time.process_time()
        result = work()
        seconds.append(time.process_time() - start)
    return min(seconds), result


def region_row() -> dict[str, object]:
    """Return a row of the table for regions: the share of pairs without a fold, and their times."""
    milliseconds, free = [], 0
    for a, b in random_regions():
        call = partial(morph_regions_without_folds, a, b, FRAMES, POINTS)
        seconds, stacks = measure_call(call)
        layout = ContourLayout((POINTS,) * len(stacks))
        free += not count_contour_folds(np.concatenate(stacks, axis=1), layout).any()
        milliseconds.append(1000 * seconds)
    return {
        "what": "here: regions with holes", "pairs": REGION_PAIRS,
        "simple_percent": 100 * free / REGION_PAIRS, "ms_mean": np.mean(milliseconds),
        "ms_median": np.median(milliseconds), "ms_99": np.percentile(milliseconds, 99),
    }  # fmt: skip


def result_row(
    morph_kind: str, morphs: list[tuple[float, Points]], linear_lengths: list[float]
) -> dict[str, object]:
    """Return a row of the table: share of morphs without folds, their times and path ratios.

    morphs: seconds and frames (f, n, 2) of each; linear_lengths: of the paths of linear morphs.
    """
    ms = 1000 * np.array([seconds for seconds, _ in morphs])
    lengths = np.array([path_lengths(frames)[-1] for _, frames in morphs])
    ratios = lengths / linear_lengths
    return {
        "what": morph_kind, "pairs": len(morphs),
        "simple_percent": 100 * np.mean([is_free_of_folds(frames) for _, frames in morphs]),
        "ms_mean": ms.mean(), "ms_median": np.median(ms), "ms_99": np.percentile(ms, 99),
        "path_ratio_mean": ratios.mean(), "path_ratio_max": ratios.max(),
    }  # fmt: skip


def is_free_of_folds(frames: Points) -> bool:
    """Return whether no frame (f, n, 2) of a morph has a fold."""
    return not count_polygon_folds(frames).any()


def main() -> None:
    """Morph all pairs of glyphs; print and write the table."""
    pairs = list(combinations(single_contour_glyphs().values(), 2))
    for a, b in pairs[:40:8]:  # compiles
        morph_without_folds(a, b, FRAMES, POINTS)
        physical_morph(a, b, FRAMES, POINTS, PHYSICS)
    linear = [measure_call(partial(linear_morph, a, b, FRAMES, POINTS)) for a, b in pairs]
    physical = [
        measure_call(partial(physical_morph, a, b, FRAMES, POINTS, PHYSICS)) for a, b in pairs
    ]
    simple = [measure_call(partial(morph_without_folds, a, b, FRAMES, POINTS)) for a, b in pairs]
    lengths = [path_lengths(frames)[-1] for _, frames in linear]
    kept = [k for k, (_, frames) in enumerate(linear) if is_free_of_folds(frames)]
    rows = [
        result_row("here: linear", linear, lengths),
        result_row("here: physical", physical, lengths),
        result_row("here: simple", simple, lengths),
        result_row("here: simple, where linear is", [simple[k] for k in kept],
                   [lengths[k] for k in kept]),
        region_row(),
    ]  # fmt: skip
    rows += [
        {"what": f"measured elsewhere: {name}", "pairs": 276, "simple_percent": share}
        for name, share in OTHERS.items()
    ]
    write_table(__file__, pd.DataFrame(rows).round(3))
    proved = sum(stays_simple(frames) for _, frames in simple)
    print(f"proved between frames: {proved} of {len(simple)}")


if __name__ == "__main__":
    main()
