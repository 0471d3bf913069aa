"""Picture of `gateways`: similar frames and sprites, side by side (Fig. 14)."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.gateways.find import GATEWAYS, IN, OUT
from finloop.io.picture import save_picture
from finloop.io.table import load_table
from finloop.plots.gateways import draw_gateways, gateway_pictures, spread_by_distance
from finloop.project import Project

PAIRS = 12  # of each direction


def main() -> None:
    """Draw reports/gateways/contact_sheet.png; without gateways, the nearest refused pairs."""
    with Project() as project:
        ways, reel, sheet = project.gateways, project.reel, {}
        nearest = load_table(project.data / "gateways/nearest.parquet", GATEWAYS)
        for direction in (IN, OUT):
            table = ways if direction in set(ways["direction"]) else nearest
            some = spread_by_distance(table[table["direction"] == direction], PAIRS)
            sheet[direction] = list(gateway_pictures(some, reel, project.map_facts))
    save_picture(Path("reports/gateways/contact_sheet.png"), draw_gateways(sheet))


if __name__ == "__main__":
    run(main)
