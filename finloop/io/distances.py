"""How a distance map was made, as a small JSON file."""

import json
from dataclasses import asdict
from pathlib import Path

from finloop.distance.map import MapFacts
from finloop.errors import FinloopError
from finloop.io.atomic import whole_file

MAP_FACTS_NAME = "facts.json"


def save_map_facts(path: Path, facts: MapFacts) -> None:
    """Write `facts`."""
    with whole_file(path) as part:
        part.write_text(json.dumps(asdict(facts), indent=2) + "\n", encoding="utf-8")


def load_map_facts(path: Path) -> MapFacts:
    """Read what `save_map_facts` wrote; FinloopError if it is missing or damaged."""
    try:
        return MapFacts(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise FinloopError(
            f"{path} cannot be read ({error})",
            "the file that the stage `distance` wrote",
            "make it again: `dvc repro --force distance`",
        ) from error
