"""Stage `jumps`: find jumps between frames that look and move alike, mirror images included."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from finloop.distance.reel import Reel
from finloop.io.atomic import whole_folder
from finloop.io.mapped import create_array, flush_array, open_array
from finloop.io.record import save_record
from finloop.io.table import save_table
from finloop.jumps.film import find_film_jumps
from finloop.jumps.settings import JumpsSettings
from finloop.jumps.signature import Pictures, picture_array_shape
from finloop.jumps.table import JUMPS, LOOK, VisibleFacts
from finloop.pose.film import FilmPoses
from finloop.project import Project
from stages.cluster import open_workers
from stages.settings import load_settings

OUT, REPORT = Path("data/jumps"), Path("reports/jumps")
WORKERS_NEED = ["finloop.jumps.film", "finloop.project"]


@dataclass
class StoredFilm:
    """The film's rows with small pictures in a file that all worker processes share.

    Small pictures of its n rows, (n, size, size, c), are in the file `path`. Every process opens
    the file and the project itself. OSError if the disk is full.
    """

    path: Path
    size: int
    project: Project

    def create(self) -> None:
        """Create the file of pictures, all black; this process can then fill it."""
        shape = picture_array_shape(self.project.film_reel, self.size)
        self._pictures = create_array(self.path, shape, "uint8")

    @cached_property
    def _pictures(self) -> Pictures:
        """Return the rows' pictures as an array that is mapped from the file."""
        shape = picture_array_shape(self.project.film_reel, self.size)
        return open_array(self.path, shape, "uint8")

    def load_film(self) -> tuple[Reel, FilmPoses]:
        """Return the pictures and the poses of the film's rows."""
        return self.project.film_reel, self.project.poses

    def picture_array(self) -> Pictures:
        """Return the rows' pictures (n, size, size, c) uint8, mapped from the file."""
        return self._pictures

    def share_pictures(self) -> None:
        """Write the pictures that this process has filled in to the file, for other processes."""
        flush_array(self._pictures)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs to open this film in another process."""
        return StoredFilm, (self.path, self.size, self.project)


def main() -> None:
    """Find jumps between rows of the film that look and move alike, also mirrored.

    data/jumps/ gets the jumps and the rows' pictures and looks (numbers for light and skin).
    """
    p: JumpsSettings = load_settings("jumps")
    with (
        Project() as project,
        open_workers(WORKERS_NEED, threads=True) as pool,
        whole_folder(OUT) as folder,
    ):
        source = StoredFilm(folder / "pictures.npy", p.look_px, project)
        source.create()  # its file of pictures, which the workers fill
        reel, _ = source.load_film()
        with report_progress("jumps", len(reel), "rows") as advance:
            result = find_film_jumps(source, p, pool, advance)
        save_table(folder / "jumps.parquet", result.jumps, JUMPS)
        save_record(folder / "facts.json", VisibleFacts(result.visible.natural))
        look = pd.DataFrame({"look": list(result.look)})
        save_table(folder / "look.parquet", look, LOOK)
    save_metrics(REPORT / "metrics.json", result.numbers)


if __name__ == "__main__":
    run(main)
