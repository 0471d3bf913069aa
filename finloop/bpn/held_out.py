"""How well a motion model foretells what it has not seen, and pictures of it (Fig. 15).

Skill = 1 - error / error of a baseline, on the same held-out rows: 1 is perfect, 0 no better than
the baseline. *Persistence* says that nothing changes; *linear* is least squares with an intercept,
fitted to the rows that the network learnt from. Both are clipped to the range of the outputs.
"""

import numpy as np
import pandas as pd
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.bpn.model import OUTPUT_HIGH, OUTPUT_LOW, Mask, MotionModel, Numbers, Rows, type_class
from finloop.plots.features import TYPES

_COMPARED = ("area_rmse", "type_rmse", "type_error_pct")


def persistence(inputs: Numbers) -> Numbers:
    """Nothing changes: (n, 4) → (n, 2)."""
    return inputs[:, :2]


def linear(train_inputs: Numbers, train_outputs: Numbers, inputs: Numbers) -> Numbers:
    """Linear least squares with an intercept: (n, 4) → (n, 2)."""
    known = np.column_stack([train_inputs, np.ones(len(train_inputs))])
    solution = np.linalg.lstsq(known, train_outputs, rcond=None)[0]
    found = np.column_stack([inputs, np.ones(len(inputs))]) @ solution
    return np.clip(found, OUTPUT_LOW, OUTPUT_HIGH)


def errors(predicted: Numbers, true: Numbers) -> dict[str, float]:
    """Errors of states (n, 2): area on its 0-1 scale, type as a number and as a class.

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
            for (word, _), value in zip(TYPES.values(), recall, strict=True)
        },
    }


def confusion(predicted: Numbers, true: Numbers) -> NDArray[np.int64]:
    """Counts (3, 3) of true type by predicted type, both in the order of TYPES."""
    said, was = type_class(predicted[:, 1]), type_class(true[:, 1])
    return np.array([[np.sum((was == a) & (said == b)) for b in TYPES] for a in TYPES])


def assessment(model: MotionModel, rows: Rows, train: Mask, held_out: Mask) -> dict[str, float]:
    """Flat numbers for metrics.json; a skill against a baseline without error is left out (NaN)."""
    inputs, outputs = rows.inputs[held_out], rows.outputs[held_out]
    known = rows.inputs[train], rows.outputs[train]
    learnt = errors(model.predict(known[0]), known[1])
    found = {
        "held_out": errors(model.predict(inputs), outputs),
        "persistence": errors(persistence(inputs), outputs),
        "linear": errors(linear(*known, inputs), outputs),
    }
    skills = {
        f"{name.removesuffix('_pct')}_skill_against_{baseline}": (
            1 - found["held_out"][name] / found[baseline][name]
            if found[baseline][name] > 0
            else float("nan")
        )
        for baseline in ("persistence", "linear")
        for name in _COMPARED
    }
    return {
        "train_rows": int(train.sum()),
        "held_out_rows": int(held_out.sum()),
        **{
            f"{side}_{name}": value
            for side, of_side in ({"train": learnt} | found).items()
            for name, value in of_side.items()
            if name != "type_error_pct"  # the accuracy says it
        },
        **skills,
        "skills_not_above_0": sum(skill <= 0 for skill in skills.values()),
    }


def figure15(curve: pd.DataFrame) -> Figure:
    """Fig. 15 of the fish paper: error per epoch, of the rows learnt from and of those held out."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    panels = figure.subplots(1, 2)
    words = ("motion area: RMS error (0–1 scale)", "swimming type: wrong (%)")
    for axes, name, word in zip(panels, ("area_rmse", "type_error_pct"), words, strict=True):
        for side, colour in (("train", "#0072B2"), ("held_out", "#D55E00")):
            label = "learnt from" if side == "train" else "held out"
            axes.plot(curve["epoch"], curve[f"{side}_{name}"], color=colour, lw=1.3, label=label)
        taught = curve.loc[curve["epoch"] > 0, [f"train_{name}", f"held_out_{name}"]]
        top = 2 * float(taught.iloc[-1].max()) or 1.0  # epoch 0 may lie far above
        axes.set(xlabel="epoch", ylabel=word, ylim=(0, max(top, 1.05 * float(taught.max().max()))))
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    return figure


def held_out_figure(predicted: Numbers, true: Numbers) -> Figure:
    """Predicted against true states (n, 2) of held-out rows: areas, and which type for which."""
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    kinds = type_class(true[:, 1])
    colours = np.empty((len(true), 4))
    for kind, (word, colour) in TYPES.items():
        colours[kinds == kind] = to_rgba_array(colour)
        left.scatter([], [], s=14, color=colour, label=word)
    left.scatter(true[:, 0], predicted[:, 0], s=7, c=colours, alpha=0.45, linewidths=0)
    left.plot([0, 1], [0, 1], color="0.3", lw=0.9)
    left.set(
        xlabel="true motion area, Δ later", ylabel="predicted", xlim=(0, 1), ylim=(0, 1),
        aspect="equal", title="motion area of held-out rows (line: perfect)",
    )  # fmt: skip
    left.legend(frameon=True, title="true type", loc="upper left", fontsize=8)

    counts = confusion(predicted, true)
    share = 100 * counts / np.maximum(counts.sum(1, keepdims=True), 1)
    words = [word for word, _ in TYPES.values()]
    right.imshow(share, cmap="Blues", vmin=0, vmax=100)
    for row, column in np.ndindex(counts.shape):
        right.text(
            column, row, f"{share[row, column]:.0f} %\n({counts[row, column]})",
            ha="center", va="center", color="white" if share[row, column] > 55 else "black",
        )  # fmt: skip
    right.set(
        xticks=range(3), xticklabels=words, yticks=range(3), yticklabels=words,
        xlabel="predicted type", ylabel="true type, Δ later", title="type of held-out rows",
    )  # fmt: skip
    return figure
