"""Stage `pose`: describe every posture of the film by a few codes of its principal shapes."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from dataclasses import asdict
from pathlib import Path

import numpy as np

from finloop.extract.table import OUTLINE_POINTS, tracks_schema
from finloop.io.atomic import whole_folder
from finloop.io.mapped import create_array, save_array
from finloop.io.record import save_record
from finloop.io.table import read_list_blocks, save_table
from finloop.pose import compute_film_poses
from finloop.pose.film import POSES, USED, restore_poses
from finloop.pose.settings import PoseSettings
from finloop.project import Project
from stages.settings import load_settings

OUT, REPORT = Path("data/pose"), Path("reports/pose")
OUTLINE = ("outline_x_px", "outline_y_px")
BLOCK_ROWS = 50_000  # rows of the table of tracks that are in memory at a time


def main() -> None:
    """Describe the posture in each row by pose codes; write data/pose/ and reports/pose/.

    data/pose/ gets codes, principal shapes, postures and outlines, reports/pose/ the metrics.
    """
    p: PoseSettings = load_settings("pose")
    project = Project()
    features = project.features
    poses = compute_film_poses(project.tracks(USED), features, p)
    with whole_folder(OUT) as folder:
        save_table(folder / "poses.parquet", poses.code_table(features), POSES)
        save_record(folder / "shapes.json", poses.facts)
        # From rounded codes and facts, so equal to the last bit to what others load from the files.
        restored = restore_poses(features, poses.codes, asdict(poses.facts))
        save_array(folder / "postures.npy", restored.pose.posture)
        _save_outlines(folder / "outlines.npy", project)
    explained = 100 * poses.shapes.variance_shares
    numbers = {
        "shapes": len(explained),
        "first_shape_pct": float(explained[0]),
        "explained_pct": float(explained.sum()),
        "trunk_pct": 100.0 * poses.trunk,  # whether body and tail have points of their own
        "tail_spread_body_lengths": poses.tail_spread,
        "gap": poses.shapes.gap,  # how far from a filmed posture another may be
        "memory_s": poses.memory_frames / project.rate_hz,
        "bend_rms_rad": float(np.sqrt((poses.codes**2).sum(1).mean())),
    }
    save_metrics(REPORT / "metrics.json", numbers)


def _save_outlines(path: Path, project: Project) -> None:
    """Write the outlines of all rows of the film to a .npy file (rows, points, 2), x, y in px."""
    outlines = create_array(path, (len(project.features), OUTLINE_POINTS, 2), "float32")
    table, first = project.data / "extract/tracks.parquet", 0
    for axes in read_list_blocks(table, tracks_schema(project.scene.points), OUTLINE, BLOCK_ROWS):
        outlines[first : first + len(axes[0])] = np.stack(axes, -1)
        first += len(axes[0])


if __name__ == "__main__":
    run(main)
