"""Pictures of `features`: a contact sheet of fish, Fig. 7, the tracks, and the orientations."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.plots import features as draw
from stages.run import progress

EXTRACT, REPORT = Path("data/extract"), Path("reports/features")
COLUMNS = ("backbone_x_px", "backbone_y_px")
FISH = 48  # on the contact sheet


def main() -> None:
    """Draw contact_sheet.png, fig7.png, trajectories.png and rose.png."""
    table = load_table(Path("data/features/features.parquet"), FEATURES)
    scene = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    tracks = load_table(EXTRACT / "tracks.parquet", tracks_schema(scene.points), COLUMNS)
    background = load_picture(EXTRACT / "background.png")
    rows = draw.most_doubtful(table, FISH)
    with progress("plots", 4, "pictures") as advance:
        with open_cutouts(EXTRACT / "cutouts.arrow") as film:
            fish = draw.specimens(table, tracks, rows, film, background)
            save_picture(REPORT / "contact_sheet.png", draw.contact_sheet(fish))
        advance()
        for name, figure in (
            ("fig7", draw.figure7(table)),
            ("trajectories", draw.trajectories(table, background)),
            ("rose", draw.rose(table)),
        ):
            save_figure(REPORT / f"{name}.png", figure)
            advance()


if __name__ == "__main__":
    run(main)
