"""The motion model as a JSON file: every number, unit and name in plain sight, exact to the bit."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from finloop.bpn.model import INPUTS, OUTPUTS, MotionModel
from finloop.errors import FinloopError
from finloop.io.atomic import whole_file

_FORMAT = "finloop motion model 1"
_NUMBERS = ("delta_s", "margin")
_RANGES = {"input_low": 4, "input_high": 4, "output_low": 2, "output_high": 2}
_WEIGHTS = ("hidden_weights", "hidden_bias", "output_weights", "output_bias")


def save_model(path: Path, model: MotionModel) -> None:
    """Write `model`, whole or not at all."""
    content = {
        "format": _FORMAT,
        "inputs": INPUTS,
        "outputs": OUTPUTS,
        **{name: float(getattr(model, name)) for name in _NUMBERS},
        **{name: getattr(model, name).tolist() for name in (*_RANGES, *_WEIGHTS)},
    }
    with whole_file(path) as part:
        text = json.dumps(content, indent=1, allow_nan=False)
        part.write_text(text + "\n", encoding="utf-8")


def load_model(path: Path) -> MotionModel:
    """Read what `save_model` wrote; FinloopError if it is missing, damaged or does not fit."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        _same(content, {"format": _FORMAT, "inputs": INPUTS, "outputs": OUTPUTS})
        numbers: dict[str, Any] = {name: float(content[name]) for name in _NUMBERS}
        arrays: dict[str, Any] = {
            name: np.array(content[name], float) for name in (*_RANGES, *_WEIGHTS)
        }
        hidden = arrays["hidden_bias"].size
        shapes = dict(zip(_WEIGHTS, ((4, hidden), (hidden,), (hidden, 2), (2,)), strict=True))
        shapes |= {name: (size,) for name, size in _RANGES.items()}
        for name, array in arrays.items():
            if array.shape != shapes[name] or hidden == 0 or not np.isfinite(array).all():
                raise ValueError(f"{name}: {shapes[name]} finite numbers are wanted")
        for side in ("input", "output"):
            if not np.all(arrays[f"{side}_low"] < arrays[f"{side}_high"]):
                raise ValueError(f"{side}_low is not below {side}_high")
        if not (0 <= numbers["margin"] < 0.5 and 0 < numbers["delta_s"] < math.inf):
            raise ValueError("margin or delta_s is out of range")
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise FinloopError(
            f"{path} cannot be read as a motion model ({error})",
            "the file that the stage `bpn` wrote",
            "make it again: `dvc repro --force bpn`",
        ) from error
    return MotionModel(**numbers, **arrays)


def _same(content: dict[str, object], wanted: dict[str, object]) -> None:
    for name, value in wanted.items():
        if content[name] != value:
            raise ValueError(f"{name}: {value!r} is wanted, got {content[name]!r}")
