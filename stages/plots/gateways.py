"""Picture of `gateways`: similar frames and sprites, side by side (Fig. 14)."""

from pathlib import Path

from finloop.gateways.find import GATEWAYS, IN, OUT
from finloop.io.picture import save_picture
from finloop.io.table import load_table
from finloop.plots.gateways import draw_gateways, gateway_pictures
from finloop.project import Project

PAIRS = 12  # of each direction


def main() -> None:
    """Draw gateways, pairs of a frame and a sprite that look alike, in contact_sheet.png.

    A direction without gateways shows its nearest refused pairs.
    """
    with Project() as project:
        gateways, reel = project.gateways, project.reel
        sheet = {}  # direction → pictures of its gateways
        nearest = load_table(project.data / "gateways/nearest.parquet", GATEWAYS)
        for direction in (IN, OUT):
            table = gateways if direction in set(gateways["direction"]) else nearest
            table = table[table["direction"] == direction]
            sheet[direction] = list(gateway_pictures(table, PAIRS, reel, project.map_facts))
    save_picture(Path("reports/motion/gateways/contact_sheet.png"), draw_gateways(sheet))
