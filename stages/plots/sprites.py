"""Picture of `sprites`: every step of each sequence, and one of them in all orientations."""

from pathlib import Path

from finloop.distance.reel import sprite_store_row
from finloop.features.table import count_orientations
from finloop.io.picture import save_picture
from finloop.plots.sprites import draw_sprites
from finloop.project import Project


def main() -> None:
    """Draw every step of each sequence of sprites, and one sprite in all orientations."""
    with Project() as project:
        sprites, store = project.sprites, project.sprite_cutouts
        count = count_orientations(sprites)
        sheet = draw_sprites(
            sprites, lambda number, sector: store[sprite_store_row(number, sector, count)]
        )
    save_picture(Path("reports/motion/sprites/contact_sheet.png"), sheet)
