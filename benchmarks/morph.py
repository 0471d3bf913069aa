"""Folding of morphs: all pairs of single-contour letters and digits of DejaVu Sans.

`python -m benchmarks.morph` prints the table and writes benchmarks/morph.csv, for 256 points and 60
frames in between: the exact share of pairs with only strictly simple frames; the time per pair on
one core; the vertices' path length, relative to the linear morph. The figures of other tools are
earlier measurements on 276 such pairs.
"""

from functools import partial

import os  # isort: skip

os.environ["FINLOOP_THREADS"] = "1"  # one core, also for matrix products
import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import string
from itertools import combinations

import numpy as np
import pandas as pd

from benchmarks.pipeline import ROOT
from benchmarks.speed import time_call
from finloop.curve.contour import Curve
from finloop.curve.glyph import glyph_outlines
from finloop.morph.folds import count_polygon_folds, stays_simple
from finloop.morph.layers import linear_morph, physical_morph
from finloop.morph.simple import morph_without_folds, path_lengths

FRAMES, POINTS = 60 + 2, 256
ELASTIC, DAMPING, MASS = 0.1, 4.0, 1.0
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


def result_row(
    morph_kind: str, is_free: list[bool], seconds: list[float], ratios: list[float]
) -> dict:
    """Return a row of the table: share of morphs without folds, their time and ratios."""
    ms = 1000 * np.array(seconds)
    return {
        "what": morph_kind,
        "pairs": len(is_free),
        "simple_percent": 100 * np.mean(is_free),
        "ms_mean": ms.mean(),
        "ms_median": np.median(ms),
        "ms_99": np.percentile(ms, 99),
        "path_ratio_mean": np.mean(ratios),
        "path_ratio_max": np.max(ratios),
    }


def main() -> None:
    """Morph all pairs of glyphs; print and write the table."""
    pairs = list(combinations(single_contour_glyphs().values(), 2))
    for a, b in pairs[:40:8]:  # compiles
        morph_without_folds(a, b, FRAMES, POINTS)
        physical_morph(a, b, FRAMES, POINTS, ELASTIC, DAMPING, MASS)
    straight = [time_call(partial(linear_morph, a, b, FRAMES, POINTS)) for a, b in pairs]
    way = [path_lengths(frames)[-1] for _, frames in straight]
    swung = [
        time_call(partial(physical_morph, a, b, FRAMES, POINTS, ELASTIC, DAMPING, MASS))
        for a, b in pairs
    ]
    found = [time_call(partial(morph_without_folds, a, b, FRAMES, POINTS)) for a, b in pairs]
    rows = [
        result_row(
            name,
            [not count_polygon_folds(frames).any() for _, frames in results],
            [seconds for seconds, _ in results],
            [path_lengths(frames)[-1] / far for (_, frames), far in zip(results, way, strict=True)],
        )
        for name, results in (
            ("here: linear", straight),
            ("here: physical", swung),
            ("here: simple", found),
        )
    ]
    unfolded = [not count_polygon_folds(frames).any() for _, frames in straight]
    kept = [k for k, is_free in enumerate(unfolded) if is_free]
    rows.append(
        result_row(
            "here: simple, where linear is",
            [not count_polygon_folds(found[k][1]).any() for k in kept],
            [found[k][0] for k in kept],
            [path_lengths(found[k][1])[-1] / way[k] for k in kept],
        )
    )
    rows += [
        {"what": f"measured elsewhere: {name}", "pairs": 276, "simple_percent": share}
        for name, share in OTHERS.items()
    ]
    table = pd.DataFrame(rows).round(3)
    print(table.to_string(index=False))
    proved = sum(stays_simple(frames) for _, frames in found)
    print(f"proved between frames: {proved} of {len(found)}")
    table.to_csv(ROOT / "benchmarks/morph.csv", index=False)


if __name__ == "__main__":
    main()
