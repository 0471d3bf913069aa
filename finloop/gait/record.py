"""Fitted gaits as plain values, for JSON files: numbers only, no contours."""

import json
from dataclasses import asdict
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.settings import check_values
from finloop.gait.model import Gait

DECIMALS = 6
MOST_BYTES = 1_000_000  # of a file
WANTED = "a gait as the stage `gait` writes it"
DO = "correct it by the examples in data/gaits/, or fit a gait: dvc repro gait"


def record_of(gait: Gait) -> dict[str, Any]:
    """Return a gait as plain values for JSON, rounded to DECIMALS.

    FinloopError if the gait is invalid, so that `gait_of` would reject its record.
    """
    content = json.loads(json.dumps(_round_floats(asdict(gait))))
    try:
        gait_of(content)
    except ValueError as error:
        raise FinloopError(str(error), WANTED, DO) from error
    return content


def gait_of(content: Any) -> Gait:
    """Return the gait that plain values describe, from `record_of` or written by hand.

    ValueError, with all problems, if the content is no gait.
    """
    gait, problems = check_values("gait", {"default": Gait}, content)
    if gait is None:
        raise ValueError("no gait: " + "; ".join(problems))
    return gait


def _round_floats(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _round_floats(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_round_floats(item) for item in value]
    return round(float(value), DECIMALS) + 0.0 if isinstance(value, float) else value
