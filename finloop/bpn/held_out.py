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
    LearningRows,
    MotionModel,
    round_swimming_types,
)
from finloop.features.swimming_type import WORDS

HELD_OUT = Schema(
    *columns(
        "float64", "1", *(f"{side}_{name}" for side in ("predicted", "true") for name in OUTPUTS)
    )
)
"""Predicted and true states Δ later of the held-out rows."""

COMPARED = ("area_rmse", "type_rmse", "type_error_pct")


def held_out_table(model: MotionModel, rows: LearningRows, held_out: Mask) -> pd.DataFrame:
    """Return the table HELD_OUT: predicted and true states, a time Δ after held-out rows.

    held_out: mask (n,) of `rows`.
    """
    states = np.hstack([model.predict(rows.inputs[held_out]), rows.outputs[held_out]])
    return pd.DataFrame(states, columns=HELD_OUT.names)


def predict_by_linear_fit(train_inputs: Floats, train_outputs: Floats, inputs: Floats) -> Floats:
    """Return the outputs (n, 2) that linear least squares with an intercept predicts.

    train_inputs (m, 4), train_outputs (m, 2): the rows that it is fitted to; inputs (n, 4): those
    that it predicts from. Predictions are clipped to the range of the outputs.
    """
    design = np.column_stack([train_inputs, np.ones(len(train_inputs))])
    solution = np.linalg.lstsq(design, train_outputs, rcond=None)[0]
    predicted = np.column_stack([inputs, np.ones(len(inputs))]) @ solution
    return np.clip(predicted, OUTPUT_LOW, OUTPUT_HIGH)


def state_errors(predicted: Floats, true: Floats) -> dict[str, float]:
    """Return the errors of predicted motion areas and swimming types, by name.

    predicted, true: (n, 2), columns OUTPUTS. area_rmse, type_rmse: root mean squares, of areas 0 …
    1 and of types -1 … 1. type_error_pct, type_accuracy_pct: rows whose rounded type is wrong,
    right. …_recall_pct: rows of one true type that are predicted as it; NaN if the type does not
    occur.
    """
    area_rmse, type_rmse = np.sqrt(np.mean((predicted - true) ** 2, axis=0))
    counts = count_confusions(predicted, true)
    with np.errstate(invalid="ignore"):
        recall = 100 * np.diag(counts) / counts.sum(1)
    wrong = 100 * (1 - np.trace(counts) / len(true))
    return {
        "area_rmse": float(area_rmse),
        "type_rmse": float(type_rmse),
        "type_error_pct": float(wrong),
        "type_accuracy_pct": float(100 - wrong),
        **{
            f"{word}_recall_pct": float(value)
            for word, value in zip(WORDS.values(), recall, strict=True)
        },
    }


def count_confusions(predicted: Floats, true: Floats) -> Ints:
    """Return how many rows have each true type (first axis) and predicted type (second): (3, 3).

    predicted, true: (n, 2), columns OUTPUTS. Types are rounded, in the order straight, left, right.
    """
    is_predicted, is_true = (  # (n, 3)
        (round_swimming_types(states[:, 1])[:, None] == list(WORDS)).astype(np.int64)
        for states in (predicted, true)
    )
    return is_true.T @ is_predicted


def assess_model(
    model: MotionModel, rows: LearningRows, train: Mask, held_out: Mask
) -> dict[str, float]:
    """Return a model's errors, its skills against the baselines, and numbers of rows, by name.

    train, held_out: masks (n,) of `rows`. A skill is 1 − error / error of a baseline: persistence
    (no change) or a linear fit; NaN if the baseline has no error. Without held-out rows there are
    only the errors on the training rows.
    """
    inputs, outputs = rows.inputs[held_out], rows.outputs[held_out]
    training = rows.inputs[train], rows.outputs[train]
    results = {"train": state_errors(model.predict(training[0]), training[1])}
    skills: dict[str, float] = {}
    if held_out.any():
        model_errors = results["held_out"] = state_errors(model.predict(inputs), outputs)
        baselines = {
            "persistence": inputs[:, :2],
            "linear": predict_by_linear_fit(*training, inputs),
        }
        for baseline, predicted in baselines.items():
            errors = results[baseline] = state_errors(predicted, outputs)
            for name in COMPARED:
                skill = 1 - model_errors[name] / errors[name] if errors[name] > 0 else float("nan")
                skills[f"{name.removesuffix('_pct')}_skill_against_{baseline}"] = skill
        skills["skills_not_above_0"] = sum(skill <= 0 for skill in skills.values())
    return {
        "train_rows": int(train.sum()),
        "held_out_rows": int(held_out.sum()),
        **{
            f"{side}_{name}": value
            for side, errors_of_side in results.items()
            for name, value in errors_of_side.items()
            if name != "type_error_pct"  # the accuracy already gives it
        },
        **skills,
    }
