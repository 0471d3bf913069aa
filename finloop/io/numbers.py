"""The numbers of a stage: `metrics.json`, which DVC reads as metrics and as a table."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path

from finloop.io.atomic import save_bytes
from finloop.io.checksums import check_file

NUMBERS_NAME = "metrics.json"


def save_numbers(
    folder: Path, numbers: Mapping[str, float | int], headlines: Collection[str] = ()
) -> None:
    """Write a stage's numbers by name to `folder`/metrics.json, sorted, a line each.

    headlines: names of those that DVC compares. They stand at the top, by name; all numbers follow
    in the list `numbers`, which DVC draws as a table.
    """
    top = [f"  {json.dumps(name)}: {value!r}," for name, value in sorted(numbers.items())
           if name in headlines]  # fmt: skip
    rows = [
        f"    {json.dumps({'number': name, 'value': value})}"
        for name, value in sorted(numbers.items())
    ]
    lines = ["{", *top, '  "numbers": [', ",\n".join(rows), "  ]", "}", ""]
    save_bytes(folder / NUMBERS_NAME, "\n".join(lines).encode())


def load_numbers(folder: Path) -> dict[str, float]:
    """Return a stage's numbers by name from `folder`/metrics.json; empty if there is no file."""
    path = folder / NUMBERS_NAME
    return parse_numbers(check_file(path).read_text("utf-8")) if path.is_file() else {}


def parse_numbers(text: str) -> dict[str, float]:
    """Return the numbers by name in the text of a metrics.json; whole numbers are int."""
    return {row["number"]: row["value"] for row in json.loads(text)["numbers"]}
