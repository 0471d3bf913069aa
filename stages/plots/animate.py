"""Pictures of `animate`: speeds, turn rates and states of modes and film, and paths."""

from pathlib import Path

from finloop.animate.measures import KINEMATICS
from finloop.io.atomic import whole_folder
from finloop.io.numbers import load_numbers
from finloop.io.picture import save_figure
from finloop.io.table import load_csv, load_table
from finloop.plan.path_measures import PATH_ROWS
from finloop.plots.animate import draw_kinematics
from finloop.plots.path import draw_path
from finloop.project import Project

DATA, REPORT = Path("data/animate"), Path("reports/modes/animate")
DEPARTURES = DATA / "beside/left.csv"  # where a fish leaves its path
PATH = DATA / "matching/path.parquet"


def main() -> None:
    """Draw speeds, turn rates and states of all modes; draw each given path and the fish's errors.

    The files are kinematics.png and path/path.png, path/path-2.png … in reports/modes/animate/.
    """
    table = load_table(DATA / "beside/kinematics.parquet", KINEMATICS)
    numbers = load_numbers(Path("reports/animate"))
    save_figure(REPORT / "kinematics.png", draw_kinematics(table, numbers))
    with whole_folder(REPORT / "path") as folder:
        if PATH.exists():
            paths, departures = load_table(PATH, PATH_ROWS), load_csv(DEPARTURES)
            background = Project().background
            for fish, path in paths.groupby("fish"):
                name = "path.png" if fish == paths["fish"].min() else f"path-{fish + 1}.png"
                departed = departures[departures["fish"] == fish]
                save_figure(folder / name, draw_path(path, departed, background))
