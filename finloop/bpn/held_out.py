"""Errors and skills of a motion model on held-out rows.

Skill = 1 - error / error of a baseline, on the same held-out rows: 1 is perfect, 0 no better than
the baseline. *Persistence* predicts no change; *linear* is least squares with an intercept, fitted
to the rows that the network learnt from. Both are clipped to the range of the outputs.
"""

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.schema import Schema, columns
from finloop.bpn.model import (
    OUTPUT_HIGH,
    OUTPUT_LOW,
    OUTPUTS,
    MotionModel,
    Rows,
    type_class,
)
from finloop.features.swimming_type import WORDS

SIDES = ("predicted", "true")
HELD_OUT = Schema(
    *columns("float64", "1", *(f"{side}_{name}" for side in SIDES for name in OUTPUTS))
)
"""Predicted and true states Δ later of the held-out rows."""

COMPARED = ("area_rmse", "type_rmse", "type_error_pct")


def held_out_table(model: MotionModel, rows: Rows, held_out: Mask) -> pd.DataFrame:
    """Return the table HELD_OUT of predicted and true states."""
    states = np.hstack([model.predict(rows.inputs[held_out]), rows.outputs[held_out]])
    return pd.DataFrame(states, columns=HELD_OUT.names)


def linear(train_inputs: Floats, train_outputs: Floats, inputs: Floats) -> Floats:
    """Predict by linear least squares with an intercept: (n, 4) → (n, 2)."""
    design = np.column_stack([train_inputs, np.ones(len(train_inputs))])
    solution = np.linalg.lstsq(design, train_outputs, rcond=None)[0]
    predicted = np.column_stack([inputs, np.ones(len(inputs))]) @ solution
    return np.clip(predicted, OUTPUT_LOW, OUTPUT_HIGH)


def errors(predicted: Floats, true: Floats) -> dict[str, float]:
    """Return errors of states (n, 2): area on its 0-1 scale, type as a number and as a class.

    The recall of a type that does not occur is NaN.
    """
    area, kind = np.sqrt(np.mean((predicted - true) ** 2, axis=0))
    counts = confusion(predicted, true)
    with np.errstate(invalid="ignore"):
        recall = 100 * np.diag(counts) / counts.sum(1)
    wrong = 100 * (1 - np.trace(counts) / len(true))
    return {
        "area_rmse": float(area),
        "type_rmse": float(kind),
        "type_error_pct": float(wrong),
        "type_accuracy_pct": float(100 - wrong),
        **{
            f"{word}_recall_pct": float(value)
            for word, value in zip(WORDS.values(), recall, strict=True)
        },
    }


def confusion(predicted: Floats, true: Floats) -> Ints:
    """Count true type by predicted type, (3, 3), both in the order of WORDS."""
    answer, truth = type_class(predicted[:, 1]), type_class(true[:, 1])
    return np.array([[np.sum((truth == a) & (answer == b)) for b in WORDS] for a in WORDS])


def assessment(model: MotionModel, rows: Rows, train: Mask, held_out: Mask) -> dict[str, float]:
    """Return numbers for metrics.json; NaN for a skill against a baseline without error.

    If no row is held out, there are no skills, and the errors are those of the rows learnt from.
    """
    inputs, outputs = rows.inputs[held_out], rows.outputs[held_out]
    training = rows.inputs[train], rows.outputs[train]
    learnt = errors(model.predict(training[0]), training[1])
    results = {}
    if held_out.any():
        results = {
            "held_out": errors(model.predict(inputs), outputs),
            "persistence": errors(inputs[:, :2], outputs),
            "linear": errors(linear(*training, inputs), outputs),
        }
    skills = {
        f"{name.removesuffix('_pct')}_skill_against_{baseline}": (
            1 - results["held_out"][name] / results[baseline][name]
            if results[baseline][name] > 0
            else float("nan")
        )
        for baseline in ("persistence", "linear")
        if results
        for name in COMPARED
    }
    failures = {"skills_not_above_0": sum(skill <= 0 for skill in skills.values())}
    return {
        "train_rows": int(train.sum()),
        "held_out_rows": int(held_out.sum()),
        **{
            f"{side}_{name}": value
            for side, numbers in ({"train": learnt} | results).items()
            for name, value in numbers.items()
            if name != "type_error_pct"  # the accuracy already gives it
        },
        **skills,
        **(failures if results else {}),
    }
