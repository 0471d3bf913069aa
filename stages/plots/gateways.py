"""Picture of `gateways`: frames and sprites that are alike, side by side (Fig. 14)."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.distance.map import MapFacts
from finloop.features.table import FEATURES
from finloop.gateways.find import GATEWAYS, IN, OUT
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import save_picture
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.plots.gateways import contact_sheet, pairs, spread
from finloop.reel import Reel
from finloop.sprites.orient import SPRITES

DATA = Path("data")
PAIRS = 12  # of each direction


def main() -> None:
    """Draw contact_sheet.png; where no gateway is near enough, the nearest that were refused."""
    facts = load_record(DATA / "distance/facts.json", MapFacts, "distance")
    features = load_table(DATA / "features/features.parquet", FEATURES)
    sprites = load_table(DATA / "sprites/sprites.parquet", SPRITES)
    ways, nearest = (
        load_table(DATA / f"gateways/{name}.parquet", GATEWAYS) for name in ("gateways", "nearest")
    )
    with (
        open_cutouts(DATA / "sprites/sprites.arrow") as store,
        open_cutouts(DATA / "extract/cutouts.arrow") as film,
    ):
        reel, sheet = Reel(features, film, sprites, store), {}
        for direction in (IN, OUT):
            table = ways if direction in set(ways["direction"]) else nearest
            some = spread(table[table["direction"] == direction], PAIRS)
            sheet[direction] = list(pairs(some, reel, facts))
    save_picture(Path("reports/gateways/contact_sheet.png"), contact_sheet(sheet))


if __name__ == "__main__":
    run(main)
