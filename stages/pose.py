"""Stage `pose`: every posture of the film as a few codes, the shares of its principal shapes."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from dataclasses import asdict
from pathlib import Path

import numpy as np

from finloop.extract.table import OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.io.atomic import whole_folder
from finloop.io.mapped import new_array, save_array
from finloop.io.record import load_record, save_record
from finloop.io.table import load_table, read_lists, save_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.pose import film_poses
from finloop.pose.film import POSES, USED, restored
from finloop.pose.settings import Settings
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/pose"), Path("reports/pose")
OUTLINE = ("outline_x_px", "outline_y_px")
ROWS = 50_000  # of the table of tracks, at a time


def main() -> None:
    """Make data/pose/, reports/pose/."""
    p: Settings = load("pose")
    points = load_record(DATA / "extract/scene.json", SceneFacts, "extract").points
    tracks = load_table(DATA / "extract/tracks.parquet", tracks_schema(points), USED)
    features = load_table(DATA / "features/features.parquet", FEATURES)
    rate_hz = load_facts(DATA / "clip" / FACTS_NAME).frame_rate_hz
    poses = film_poses(tracks, features, p)
    with whole_folder(OUT) as folder:
        save_table(folder / "poses.parquet", poses.table(features), POSES)
        save_record(folder / "shapes.json", poses.facts)
        # As they would be worked out from the files, to the last bit.
        again = restored(features, poses.codes, asdict(poses.facts))
        save_array(folder / "postures.npy", again.pose.posture)
        save_outlines(folder / "outlines.npy", points, len(features))
    explained = 100 * poses.shapes.explained
    numbers = {
        "shapes": len(explained),
        "first_shape_pct": float(explained[0]),
        "explained_pct": float(explained.sum()),
        "trunk_pct": 100.0 * poses.trunk,
        "tail_spread_body_lengths": poses.tail_spread,
        "gap": poses.shapes.gap,
        "memory_s": poses.memory_frames / rate_hz,
        "bend_rms_rad": float(np.sqrt((poses.codes**2).sum(1).mean())),
    }
    save_metrics(REPORT / "metrics.json", numbers)


def save_outlines(path: Path, points: int, rows: int) -> None:
    """Write the outlines (rows, k, 2) x, y px of all rows, to be mapped; points: of a backbone."""
    outlines = new_array(path, (rows, OUTLINE_POINTS, 2), "float32")
    table, first = DATA / "extract/tracks.parquet", 0
    for axes in read_lists(table, tracks_schema(points), OUTLINE, ROWS):
        outlines[first : first + len(axes[0])] = np.stack(axes, -1)
        first += len(axes[0])


if __name__ == "__main__":
    run(main)
