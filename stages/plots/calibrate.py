"""Picture of `calibrate`: distances and alignment of fish, in the film and by the zones."""

from pathlib import Path

from finloop.io.picture import save_figure
from finloop.io.table import load_table
from finloop.plots.calibrate import draw_school_measures
from finloop.social.measures import SCHOOL, split_in_halves

FOLDER = Path("data/calibrate")
NAMES = {"zones": "points that swim by the zones", "alone": "points without other fish"}


def main() -> None:
    """Draw how distances and headings between fish are distributed, in reports/film/calibrate/.

    The groups are the two halves of the film, and simulated points with and without zones, if any.
    """
    first, second = split_in_halves(load_table(FOLDER / "film.parquet", SCHOOL))
    groups = {"film, first half": first, "film, second half": second}
    for name, title in NAMES.items():
        if (path := FOLDER / f"{name}.parquet").exists():
            groups[title] = load_table(path, SCHOOL)
    save_figure(Path("reports/film/calibrate/distributions.png"), draw_school_measures(groups))
