"""JSON files: facts, goals, models, gaits. Their packages define what the keys mean."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from finloop.io.checksums import check_file

T = TypeVar("T")
MOST_BYTES = 100_000_000


def save_json(path: Path, content: Any, indent: int | None = 2) -> None:
    """Write plain values (dictionaries, lists, numbers, text) as JSON, completely or not at all.

    indent: spaces of a level; None: all in one line, without spaces.
    """
    marks = (",", ":") if indent is None else None
    text = json.dumps(content, indent=indent, separators=marks, ensure_ascii=False, allow_nan=False)
    save_bytes(path, f"{text}\n".encode())


def load_json(
    path: Path, build: Callable[[Any], T], wanted: str, do: str, most_bytes: int = MOST_BYTES
) -> T:
    """Load a JSON file; return what the function `build` makes of its content.

    FinloopError, with the lines `wanted` and `do`, if the file is missing, larger than
    `most_bytes`, no JSON, or `build` raises ValueError, TypeError, KeyError or AttributeError.
    """
    try:
        if path.stat().st_size > most_bytes:
            raise ValueError(f"larger than {most_bytes} bytes")
        return build(json.loads(check_file(path).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise FinloopError(f"{path} cannot be read ({error!s:.500})", wanted, do) from error


def save_record(path: Path, record: Any) -> None:
    """Write a dataclass of plain values as a JSON object."""
    save_json(path, asdict(record))


def load_record(path: Path, kind: Callable[..., T], stage: str) -> T:
    """Read a JSON object that a stage wrote into a dataclass.

    kind: the dataclass, or a function of the object's keys. FinloopError, which names the stage, if
    the file is missing or `kind` refuses it.
    """
    return load_json(path, lambda content: kind(**content), *remake_hint(stage))


def save_records(path: Path, records: Sequence[NamedTuple]) -> None:
    """Write named tuples of plain values as a JSON list of objects."""
    save_json(path, [record._asdict() for record in records])


def load_records(path: Path, kind: Callable[..., T], stage: str) -> list[T]:
    """Read a JSON list of objects that a stage wrote into dataclasses or named tuples.

    kind: their class. FinloopError, which names the stage, if the file is missing or `kind` refuses
    an object.
    """
    return load_json(
        path, lambda content: [kind(**record) for record in content], *remake_hint(stage)
    )


def remake_hint(stage: str) -> tuple[str, str]:
    """Return an error's lines `wanted` and `do` for a damaged file that a stage wrote."""
    wanted = f"the file that the stage `{stage}` wrote"
    return wanted, f"make it again: `dvc repro --force {stage}`"
