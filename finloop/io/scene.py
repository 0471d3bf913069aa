"""What `extract` learnt of the tank and its fish, as a small JSON file."""

import json
from dataclasses import asdict
from pathlib import Path

from finloop.errors import FinloopError
from finloop.extract.table import SceneFacts
from finloop.io.atomic import whole_file


def save_scene(path: Path, facts: SceneFacts) -> None:
    """Write `facts`."""
    with whole_file(path) as part:
        part.write_text(json.dumps(asdict(facts), indent=2) + "\n", encoding="utf-8")


def load_scene(path: Path) -> SceneFacts:
    """Read what `save_scene` wrote; FinloopError if it is missing or damaged."""
    try:
        return SceneFacts(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise FinloopError(
            f"{path} cannot be read ({error})",
            "the file that the stage `extract` wrote",
            "make it again: `dvc repro --force extract`",
        ) from error
