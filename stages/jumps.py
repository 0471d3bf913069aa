"""Stage `jumps`: the jumps between frames that look and move alike, mirror images too."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import pandas as pd

from finloop.io.atomic import whole_folder
from finloop.io.record import save_record
from finloop.io.table import save_table
from finloop.jumps.film import FilmJumps, film_jumps
from finloop.jumps.settings import Settings
from finloop.jumps.table import JUMPS, LOOK, VisibleFacts
from stages.cluster import workers
from stages.rows import StoredFilm
from stages.settings import load

OUT, REPORT = Path("data/jumps"), Path("reports/jumps")
WORKERS_NEED = ["finloop.jumps.film", "stages.rows"]


def main() -> None:
    """Make data/jumps/, reports/jumps/."""
    p: Settings = load("jumps")
    with workers(WORKERS_NEED, threads=True) as crew, whole_folder(OUT) as folder:
        source = StoredFilm(folder / "pictures.npy", p.look_px)
        source.create()
        with progress("jumps", len(source.film()[0]), "rows") as advance:
            result = film_jumps(source, p, crew, advance)
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
