"""The goals of an animation, as a small JSON file beside its edit lists."""

import json
from collections.abc import Sequence
from pathlib import Path

from finloop.animate.edit_list import Goal
from finloop.errors import FinloopError
from finloop.io.atomic import whole_file


def save_goals(path: Path, goals: Sequence[Goal]) -> None:
    """Write `goals` in their order."""
    with whole_file(path) as part:
        records = [goal._asdict() for goal in goals]
        part.write_text(json.dumps(records, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def load_goals(path: Path) -> list[Goal]:
    """Read what `save_goals` wrote; FinloopError if it is missing or damaged."""
    try:
        records = json.loads(path.read_text(encoding="utf-8"))
        return [
            Goal(str(r["name"]), *(float(r[key]) for key in ("x_px", "y_px", "radius_px")))
            for r in records
        ]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise FinloopError(
            f"{path} cannot be read ({error!r})",
            "the goals that the stage `animate` wrote",
            "make them again: `dvc repro --force animate`",
        ) from error
