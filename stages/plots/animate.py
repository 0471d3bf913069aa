"""Picture of `animate`: speed, turn rate and states of every mode beside the film's."""

from stages.run import run  # isort: skip  (before numpy)

import json
from pathlib import Path

from finloop.animate.measures import KINEMATICS
from finloop.io.picture import save_figure
from finloop.io.table import load_table
from finloop.plots.animate import kinematics

REPORT = Path("reports/animate")


def main() -> None:
    """Draw kinematics.png."""
    table = load_table(Path("data/animate/kinematics.parquet"), KINEMATICS)
    numbers = json.loads((REPORT / "metrics.json").read_text(encoding="utf-8"))
    save_figure(REPORT / "kinematics.png", kinematics(table, numbers))


if __name__ == "__main__":
    run(main)
