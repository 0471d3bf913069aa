"""Stage `distance`: how similar the frames of the film are (fish paper §4.1, Eqs. 5-8, Fig. 9)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.distance.map import EXACT, PAIRS, STEPS, compare_frames, count_pairs, list_map_blocks
from finloop.distance.picture import paired_distances
from finloop.distance.reel import Reel
from finloop.distance.settings import DistanceSettings
from finloop.io.atomic import whole_folder
from finloop.io.record import save_record
from finloop.io.table import save_table
from finloop.project import Project
from stages.settings import load_settings

FOLDER, REPORT = Path("data/distance"), Path("reports/distance")
SAMPLE = 1000  # pairs measured again in float64


def _count_inexact(pairs: pd.DataFrame, reel: Reel, size_px: int, reference: str) -> int:
    """Recompute SAMPLE stored distances in float64; return how many differ by more than EXACT.

    pairs: columns i, j (rows of the film) and distance. size_px: side of the pictures compared.
    reference: whether they show the fish as filmed or turned head right.
    """
    sample, count = pairs.sample(min(SAMPLE, len(pairs)), random_state=0), 0
    for start in range(0, len(sample), 50):  # 50 at a time, to save memory
        part = sample.iloc[start : start + 50]
        first = reel.draw_rows(part["i"].to_numpy(), size_px, reference).astype(float)
        second = reel.draw_rows(part["j"].to_numpy(), size_px, reference).astype(float)
        errors = np.abs(paired_distances(first, second) - part["distance"].to_numpy())
        count += int((errors > EXACT).sum())
    return count


def main() -> None:
    """Find the pairs of frames that look alike; write data/distance/ and reports/distance/.

    pairs.parquet has the similar pairs, steps/ the distances between successive frames.
    """
    p: DistanceSettings = load_settings("distance")
    with Project() as project:
        features, reel = project.features, project.film_reel
        blocks = list_map_blocks(features, p)
        with report_progress("distance", len(blocks), "blocks") as advance:
            pairs, steps, facts = compare_frames(reel, p, advance)
        pairs_inexact = _count_inexact(pairs, reel, p.picture_size_px, p.frame_of_reference)

    with whole_folder(FOLDER) as folder:
        save_table(folder / "pairs.parquet", pairs, PAIRS)
        (folder / "steps").mkdir()  # apart from the pairs: most stages read these alone
        save_table(folder / "steps/steps.parquet", steps, STEPS)
        save_record(folder / "steps/facts.json", facts)

    frames = len(steps)
    count, pairs_computed = frames * (frames - 1) // 2, count_pairs(blocks)
    metrics = {
        "frames": frames,
        "film_mapped_pct": 100 * frames / len(features),
        "pairs": count,
        "pairs_computed": pairs_computed,
        "pairs_skipped_pct": 100 * (1 - pairs_computed / count),
        "pairs_kept": float(len(pairs)),  # the last digit of so many at a threshold varies
        "pairs_kept_pct": 100 * len(pairs) / count,
        "step_median": facts.step_median,
        "step_p95": facts.step_p95,
        "pairs_inexact": pairs_inexact,
    }
    save_metrics(REPORT / "metrics.json", metrics)
    if frames < len(features):
        print(
            f"distance: {frames:,} of the film's {len(features):,} rows are compared, in "
            "stretches spread over it (distance.max_rows); loops and gateways are of these",
            file=sys.stderr,
        )
    if not len(pairs):
        print("distance: no two frames are similar enough", file=sys.stderr)


if __name__ == "__main__":
    run(main)
