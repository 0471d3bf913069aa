"""Stage `jumps`: the jumps between frames that look and move alike, mirror images too."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import pandas as pd

from finloop.features.table import FEATURES
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import open_cutouts
from finloop.io.mapped import new_array
from finloop.io.record import save_record
from finloop.io.table import load_table, save_table
from finloop.jumps.film import FilmJumps, film_jumps
from finloop.jumps.settings import Settings
from finloop.jumps.table import JUMPS, LOOK, VisibleFacts
from finloop.jumps.visible import shape_of
from finloop.reel import Reel
from stages.poses import load_poses
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/jumps"), Path("reports/jumps")


def main() -> None:
    """Make data/jumps/, reports/jumps/."""
    p: Settings = load("jumps")
    features = load_table(DATA / "features/features.parquet", FEATURES)
    with open_cutouts(DATA / "extract/cutouts.arrow") as film:
        reel = Reel(features, film)
        with whole_folder(OUT) as folder:
            pictures = new_array(folder / "pictures.npy", shape_of(reel, p.look_px), "uint8")
            with progress("jumps", len(reel), "rows") as advance:
                result = film_jumps(reel, load_poses(features), p, advance, pictures)
            save(folder, result)
    save_metrics(REPORT / "metrics.json", result.numbers)


def save(folder: Path, result: FilmJumps) -> None:
    """Write everything but the pictures of rows."""
    save_table(folder / "jumps.parquet", result.jumps, JUMPS)
    save_record(folder / "facts.json", VisibleFacts(result.visible.natural))
    look = pd.DataFrame({"look": list(result.look)})
    save_table(folder / "look.parquet", look, LOOK)


if __name__ == "__main__":
    run(main)
