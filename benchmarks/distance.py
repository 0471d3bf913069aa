"""Speed of the distance maps: against the bare matrix product, scipy, and one pair at a time.

`python -m benchmarks.distance` prints the tables and writes benchmarks/distance.csv. Pictures are
random; the mix of orientations and types makes Eq. 7 alone skip 94.4 % of all pairs, as in the
paper's Table 1. Ratios come from runs in turn. The two slow peers run once, on a part of the map,
and their times are scaled to the whole map.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from benchmarks.pipeline import ROOT, peak_mib, write_table
from benchmarks.speed import time_call, time_pairs
from finloop.base.arrays import Floats, Ints
from finloop.distance.map import (
    count_pairs,
    find_comparison_blocks,
    find_similar_pairs,
    full_distance_map,
    pair_table,
    sort_by_kind_and_area,
    subtract_mean_picture,
)

FRAMES, LONG, SIZE, CHANNELS, THRESHOLD = 4480, 20000, 64, 2, 0.1
SKIPPED = 0.944  # of all pairs, by orientation and swimming type (Table 1)
TYPES = np.array([0.62, 0.20, 0.18])  # straight, left, right
ORIENTATIONS = 24
PART = 0.02  # share of the frames for the slow peers
LEAST = LONG * SIZE**2 * CHANNELS * 4 / 2**30  # GiB of the pictures of the long film


def kind_shares() -> NDArray[np.float64]:
    """Return the shares of 24 × 3 kinds, geometric in the orientation, Σ share² = 1 − SKIPPED."""
    low, high = 0.5, 1.0
    while high - low > 1e-12:
        ratio = (low + high) / 2
        orientation_share = ratio ** np.arange(ORIENTATIONS)
        share = np.outer(orientation_share / orientation_share.sum(), TYPES).ravel()
        low, high = (ratio, high) if (share**2).sum() > 1 - SKIPPED else (low, ratio)
    return share


def random_film(frame_count: int, mixed: bool = True) -> tuple[NDArray[np.float32], Ints, Floats]:
    """Return random pictures (n, SIZE, SIZE, CHANNELS), kinds and areas; not `mixed`: 3 kinds."""
    rng = np.random.default_rng(frame_count)
    pictures = rng.random((frame_count, SIZE, SIZE, CHANNELS), np.float32)
    share = kind_shares() if mixed else TYPES
    kind, area = rng.choice(len(share), frame_count, p=share), rng.random(frame_count)
    rows = sort_by_kind_and_area(kind, area)
    return pictures, kind[rows], area[rows]


def pairs_by_kind(pictures: NDArray[np.float32], kinds: Ints, areas: Floats) -> pd.DataFrame:
    """Return the table of pairs of pictures of one kind, with their distances (Eq. 6)."""
    pairs = find_similar_pairs(subtract_mean_picture(pictures), kinds, areas, THRESHOLD)
    return pair_table(pairs, np.arange(len(kinds)))


def peak_gib(frame_count: int, mixed: bool) -> float:
    """Return the peak resident memory of `pairs_by_kind` in a process of its own, in GiB."""
    call = f"pairs_by_kind(*random_film({frame_count}, {mixed}))"
    code = f"from benchmarks.distance import pairs_by_kind, random_film; {call}"
    return peak_mib(ROOT, "-c", code) / 1024


def distances_one_by_one(pictures: NDArray[np.float32]) -> list[float]:
    """Return the distances (Eq. 5) of pictures, computed pair by pair."""
    return [
        float(np.linalg.norm(picture - later_picture))
        for number, picture in enumerate(pictures)
        for later_picture in pictures[number + 1 :]
    ]


def main() -> None:
    """Time the distance map and its peers; print and write the table."""
    pictures, kind, area = random_film(FRAMES)
    flat = pictures.reshape(FRAMES, -1)
    turned = np.ascontiguousarray(flat.T)
    pairs = FRAMES * (FRAMES - 1) / 2
    alike = np.bincount(kind)  # rows of each kind
    print(
        f"{FRAMES} frames: orientation and type skip "
        f"{100 * (1 - (alike * (alike - 1) / 2).sum() / pairs):.1f} % of the pairs, with the area "
        f"{100 * (1 - count_pairs(find_comparison_blocks(kind, area, THRESHOLD)) / pairs):.1f} % "
        "are not computed"
    )
    all_s, bare_s, bare, _ = time_pairs(lambda: full_distance_map(pictures), lambda: flat @ turned)
    some_s, _, faster, _ = time_pairs(
        lambda: pairs_by_kind(pictures, kind, area), lambda: full_distance_map(pictures)
    )
    part_frames = int(PART * FRAMES)
    scipy_s = time_call(lambda: cdist(flat[:part_frames], flat))[0] * FRAMES / part_frames
    seconds, distances = time_call(lambda: distances_one_by_one(pictures[:part_frames]))
    loop_s = seconds * pairs / len(distances)
    speed = [
        ("full / the bare product x @ xT", all_s, bare_s, bare),
        ("grouped, Table 1 mix / full", some_s, all_s, faster),
        ("full / scipy cdist", all_s, scipy_s, all_s / scipy_s),
        ("grouped, Table 1 mix / scipy cdist", some_s, scipy_s, some_s / scipy_s),
        ("full / a loop over pairs", all_s, loop_s, all_s / loop_s),
        ("grouped, Table 1 mix / a loop over pairs", some_s, loop_s, some_s / loop_s),
    ]
    memory = [
        (f"{LONG} frames grouped, {mix}; pictures alone", peak_gib(LONG, mixed), LEAST)
        for mix, mixed in (("Table 1 mix", True), ("types alone, all kept", False))
    ]
    results = [(*row, "s") for row in speed] + [
        (what, peak, alone, peak / alone, "GiB") for what, peak, alone in memory
    ]
    table = pd.DataFrame(results, columns=["what", "ours", "theirs", "ratio", "unit"]).round(4)
    write_table(__file__, table)


if __name__ == "__main__":
    main()
