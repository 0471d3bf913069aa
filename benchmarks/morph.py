"""Folding of morphs: all pairs of single-contour letters and digits of DejaVu Sans, and regions.

`python -m benchmarks.morph` prints the table and writes benchmarks/morph.csv, for 256 points and 60
frames in between: the exact share of pairs with only strictly simple frames; the processor time of
a pair, the less of two; the vertices' path length, relative to the linear morph. The figures of
other tools are earlier measurements on 276 such pairs. Regions are 300 random pairs of glyphs of
three fonts that are in one piece, with holes in one of them at least. Drawings are 300 random pairs
of three to eight layers: glyphs, stars and waves. They have no fold if no contour meets itself or
another one of its shape, and no pieces of one shape cover each other. Layers may pass over others.
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
from finloop.base.drawing import Drawing, Morph
from finloop.curve.contour import Curve
from finloop.curve.glyph import glyph_outlines
from finloop.morph.folds import (
    ContourLayout,
    count_contour_folds,
    count_polygon_folds,
    stays_simple,
)
from finloop.morph.layers import (
    PhysicalOptions,
    linear_morph,
    morph_drawings,
    physical_morph,
)
from finloop.morph.pairs import match_drawings
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


DRAWING_PAIRS, SIDE_PX = 300, 600.0  # of random drawings; the side of each


def random_drawing_pairs(seed: int, pairs: int) -> list[tuple[Drawing, Drawing]]:
    """Return random pairs of drawings of three to eight layers; six of ten pairs share their ids.

    Each layer is a glyph (six of ten), a star of 5 to 39 points, or a wave, an open curve.
    """
    rng = np.random.default_rng(seed)

    def random_layer() -> list[Curve]:
        """Return the contours of a layer, at a random place, size and, of three in ten, angle."""
        kind = rng.integers(10)
        if kind < 6:
            glyph = rng.choice(list(string.ascii_letters + string.digits + "&@#%äö!?"))
            contours = glyph_outlines(glyph, rng.choice(FONTS))
            corners = np.concatenate([curve.points for curve in contours])
            low, high = corners.min(axis=0), corners.max(axis=0)
            contours = [
                Curve((curve.points - (low + high) / 2) / (high - low).max(), True)
                for curve in contours
            ]
        elif kind < 8:
            count = rng.integers(5, 40)
            angle = 2 * np.pi * (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count
            radius = rng.uniform(0.15, 0.5, count)
            star = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
            contours = [Curve(star, True)]
        else:
            x = np.linspace(-0.5, 0.5, 30)
            y = 0.2 * np.sin(rng.uniform(2, 9) * x + rng.uniform(0, 6))
            contours = [Curve(np.stack([x, y], axis=1), False)]
        turn = rng.uniform(0, 2 * np.pi) if rng.random() < 0.3 else 0.0
        scale, place = rng.uniform(40, 220), rng.uniform(80, 520, 2)
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        return [Curve(curve.points @ rotation * scale + place, curve.closed) for curve in contours]

    def random_drawing(names: list[str]) -> Drawing:
        """Return a drawing with a layer for each id."""
        curves = {
            f"{name}#{number}" if number > 1 else name: curve
            for name in names
            for number, curve in enumerate(random_layer(), start=1)
        }
        return Drawing(curves, SIDE_PX, SIDE_PX)

    drawings = []
    for _ in range(pairs):
        names = [f"a{k}" for k in range(rng.integers(3, 9))]
        others = names if rng.random() < 0.6 else [f"b{k}" for k in range(rng.integers(3, 9))]
        drawings.append((random_drawing(names), random_drawing(others)))
    return drawings


def morph_pair(a: Drawing, b: Drawing) -> Morph:
    """Return the fold-free morph between two drawings, whose shapes are paired first."""
    first, second, _ = match_drawings(a, b)
    return morph_drawings(first, second, "fold_free", FRAMES, POINTS)


def drawings_row() -> dict[str, object]:
    """Return a row of the table for drawings: the share of pairs without a fold, and their times.

    Pieces of one shape that cover each other count as a fold.
    """
    milliseconds, free = [], 0
    for a, b in random_drawing_pairs(0, DRAWING_PAIRS):
        seconds, morph = measure_call(partial(morph_pair, a, b))
        free += not (morph.count_fold_frames() or morph.count_cover_frames())
        milliseconds.append(1000 * seconds)
    return {
        "what": "here: drawings of several layers", "pairs": DRAWING_PAIRS,
        "simple_percent": 100 * free / DRAWING_PAIRS, "ms_mean": np.mean(milliseconds),
        "ms_median": np.median(milliseconds), "ms_99": np.percentile(milliseconds, 99),
    }  # fmt: skip


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
        drawings_row(),
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
