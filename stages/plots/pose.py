"""Picture of `pose`: the first principal shapes of the postures, drawn on an animal of the film."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import save_picture
from finloop.io.table import load_table
from finloop.plots.pose import sheet
from stages.poses import DATA, load_poses


def main() -> None:
    """Draw shapes.png."""
    poses = load_poses(load_table(DATA / "features/features.parquet", FEATURES))
    with open_cutouts(DATA / "extract/cutouts.arrow") as film:
        save_picture(Path("reports/pose/shapes.png"), sheet(poses, film))


if __name__ == "__main__":
    run(main)
