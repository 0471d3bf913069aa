"""All numbers of a stage: `numbers.csv`, a row a number, sorted by name."""

import csv
from collections.abc import Mapping
from pathlib import Path

from finloop.io.atomic import whole_file

NUMBERS_NAME = "numbers.csv"


def save_numbers(folder: Path, numbers: Mapping[str, float | int]) -> None:
    """Write a stage's numbers by name to `folder`/numbers.csv, sorted by name."""
    lines = ["number,value", *(f"{name},{value!r}" for name, value in sorted(numbers.items()))]
    with whole_file(folder / NUMBERS_NAME) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def load_numbers(folder: Path) -> dict[str, float]:
    """Return a stage's numbers by name from `folder`/numbers.csv; empty if there is no file."""
    path = folder / NUMBERS_NAME
    return parse_numbers(path.read_text(encoding="utf-8")) if path.is_file() else {}


def parse_numbers(text: str) -> dict[str, float]:
    """Return the numbers by name in the text of a numbers.csv; whole numbers become int."""
    values = {row["number"]: row["value"] for row in csv.DictReader(text.splitlines())}
    return {
        name: int(value) if value.lstrip("-").isdigit() else float(value)
        for name, value in values.items()
    }
