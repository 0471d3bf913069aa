"""Overrides `group.key=value` in Hydra's syntax: of values, and of what was probably meant."""

import json
import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

_WITH_UNIT = re.compile(r"([-+]?\d*[.,]?\d+(?:[eE][-+]?\d+)?)\s*([^\W\d]*|%|°)")
_MINUTES = re.compile(r"(\d+):(\d\d(?:\.\d+)?)")
_UNITS = {
    "s": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 0.001, "min": 60.0},
    "seconds": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 0.001, "min": 60.0},
    "deg": {"deg": 1.0, "degrees": 1.0, "°": 1.0},
    "px": {"px": 1.0, "pixels": 1.0},
    "hz": {"hz": 1.0, "fps": 1.0},
    "mm": {"mm": 1.0, "cm": 10.0},
    "bl": {"bl": 1.0},
    "ratio": {"%": 0.01},
    "pct": {"%": 1.0},
}
"""The last word of a parameter's name → units that a user may write behind a number, in its own."""
_LARGEST = 1e15
_WORDS = {
    "none": None, "null": None, "nil": None, "yes": True, "on": True, "true": True,
    "no": False, "off": False, "false": False,
}  # fmt: skip


def format_override(value: Any) -> str:
    """Return a value in the syntax of Hydra's overrides: JSON, but with keys without quotes.

    Letters beyond ASCII stay, and `${` does not refer to another value.
    """
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{key}:{format_override(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(format_override, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("${", "\\${")


def quote_override(name: str, value: Any) -> str:
    """Return `name=value` as it is typed in a shell; a plain word stands without quotes."""
    plain = isinstance(value, str) and re.fullmatch(r"[\w./-]*[^\W\d_][\w./-]*", value)
    return shlex.quote(f"{name}={value if plain else format_override(value)}")


def suggest_override(
    name: str, value: Any, choices: list[str], accepts: Callable[[Any], bool]
) -> str:
    """Return the advice "; type name=value" with the value probably meant; "" without a guess.

    name: dotted name of the parameter. value: as it was given and refused. choices: the words that
    the parameter allows. accepts: a function that says whether the parameter allows a value.
    """
    for meant in _guess_meant_values(name, value, choices):
        if accepts(meant):
            return f"; type {quote_override(name, meant)}"
    return ""


def _guess_meant_values(name: str, value: Any, choices: list[str]) -> Iterator[Any]:
    """Yield the values that the user may have meant by a refused value, the most probable first.

    name: of the parameter; its last word is its unit, such as s or px. choices: the words that it
    allows.
    """
    unit = re.split(r"[._]", name)[-1]
    if isinstance(value, str):
        stripped = value.strip()
        if stripped.lower() in _WORDS:
            meaning = _WORDS[stripped.lower()]
            # Some parameters have words for these.
            yield from (meaning, {True: "always", False: "never", None: "auto"}[meaning])
        yield from get_close_matches(stripped.lower(), choices)  # a misspelt word
        if minutes := _MINUTES.fullmatch(stripped):
            if unit in ("s", "seconds"):
                yield _shorten(60 * int(minutes[1]) + float(minutes[2]))
        elif number := _WITH_UNIT.fullmatch(stripped):
            factors = {"": 1.0} | _UNITS.get(unit, {})
            if (factor := factors.get(number[2].lower())) is not None:
                yield _shorten(float(number[1].replace(",", ".")) * factor)
        yield [stripped]  # for a parameter that takes a list
    elif isinstance(value, list):
        yield [value]
        if len(value) == 1:
            yield value[0]
    elif isinstance(value, bool):
        yield from ("always", "never") if value else ("never", "always")
    elif isinstance(value, int | float) and abs(value) < _LARGEST:  # so no NaN
        yield _shorten(value)
        if unit == "ratio":
            yield value / 100  # it was meant in percent
        yield str(value)
        yield [value]


def _shorten(number: float) -> float | int:
    """Return a number as an int if it is whole, else rounded to 9 decimals."""
    return int(number) if number % 1 == 0 else round(number, 9)
