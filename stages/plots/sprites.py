"""Picture of `sprites`: every step of each sequence, and one of them in all orientations."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.features.table import orientations_of
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import save_picture
from finloop.io.table import load_table
from finloop.plots.sprites import contact_sheet
from finloop.reel import sprite_row
from finloop.sprites.orient import SPRITES

SPRITES_FOLDER = Path("data/sprites")


def main() -> None:
    """Draw contact_sheet.png."""
    sprites = load_table(SPRITES_FOLDER / "sprites.parquet", SPRITES)
    with open_cutouts(SPRITES_FOLDER / "sprites.arrow") as store:
        count = orientations_of(sprites)
        sheet = contact_sheet(sprites, lambda s, o: store[sprite_row(s, o, count)])
    save_picture(Path("reports/sprites/contact_sheet.png"), sheet)


if __name__ == "__main__":
    run(main)
