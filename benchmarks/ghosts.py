"""Ghosts: cross-faded ticks that look like neither of their two pictures, in every mode.

`python -m benchmarks.ghosts FOLDER …` takes working copies with a finished pipeline, one per film,
and writes benchmarks/ghosts.csv: the number of ticks, of cross-faded ones, of ghosts among them
(`finloop.edit.ghosts`), and how many there would be if pictures in one pose were mixed as others.
Mode `hybrid` is planned once more with `hybrid.join=inertial`.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import sys
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pandas as pd

from benchmarks.pipeline import write_table
from finloop.base.errors import FinloopError
from finloop.edit import pictures as edit_pictures
from finloop.edit.ghosts import LOOKS, GhostTicks, measure_ghosts, tank_colour
from finloop.edit.modes import MODES
from finloop.edit.pictures import Pictures
from finloop.edit.schema import INERTIAL, SPRITE, split_by_fish
from finloop.modes.hybrid import hybrid_animator
from finloop.project import Project
from finloop.puppet import mix_pictures


def _mix_in_pose(first: Any, second: Any, weight: float, box: Any) -> Any:
    """Mix two pictures in one pose as they are; the arguments are those of `change_in_pose`."""
    return mix_pictures(first.draw_part(box), second.draw_part(box), weight)


def count_ghosts(edit: pd.DataFrame, pictures: Pictures, project: Project) -> dict[str, int]:
    """Return how many ticks of the first fish are cross-faded, and how many of them are ghosts."""
    first, ground = split_by_fish(edit)[0], tank_colour(project.background)

    def count(ghosts: GhostTicks) -> int:
        """Return the number of ghosts."""
        return int(ghosts.is_ghost.sum())

    now = measure_ghosts(first, pictures, ground)
    with patch.object(edit_pictures, "change_in_pose", _mix_in_pose):
        mixed = count(measure_ghosts(first, pictures, ground))
    by_look = dict(zip(LOOKS, (now.beyond > now.limit).sum(0).tolist(), strict=True))
    counts = {"ticks": len(first), "cross_faded": len(now.tick), "ghosts_if_mixed": mixed}
    return counts | {"ghosts": count(now)} | by_look


def measure_film(name: str) -> list[dict[str, Any]]:
    """Return a row for each mode of the film in the present folder."""
    rows: list[dict[str, Any]] = []
    with Project() as project:
        edits: dict[str, pd.DataFrame] = {}
        for mode in MODES:
            try:
                edits[mode] = project.edit_list(mode, "render")
            except FinloopError as error:
                print(f"{name}: {error.came}", file=sys.stderr)
        settings = project.settings
        hybrid = hybrid_animator(
            project.sprite_assets, project.network_mode, project.loops, project.gateways,
            settings("animate"), settings("loops"), replace(settings("hybrid"), join=INERTIAL),
        )  # fmt: skip
        edits["hybrid, join=inertial"] = hybrid.plan(hybrid.goals())[1]
        for mode, edit in edits.items():
            has_sprites = SPRITE in {*edit["kind"], *edit["partner_kind"]}
            assets = project.sprite_assets if has_sprites else project.film_assets
            rows.append({"film": name, "mode": mode} | count_ghosts(edit, assets.pictures, project))
    return rows


def main() -> None:
    """Count the ghosts of all films; print and write the table."""
    rows = []
    for folder in sys.argv[1:] or ["."]:
        with chdir(folder):
            rows += measure_film(Path.cwd().name)
        write_table(__file__, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
