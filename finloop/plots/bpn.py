"""Pictures of the motion model: Fig. 15 of the fish paper, and predicted beside true states."""

import numpy as np
import pandas as pd
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure

from finloop.base.arrays import Floats
from finloop.bpn.held_out import count_confusions
from finloop.bpn.model import round_swimming_types
from finloop.plots.features import TYPES


def figure15(curve: pd.DataFrame) -> Figure:
    """Draw Fig. 15 of the fish paper: the network's error per epoch, on training and held-out rows.

    curve: columns epoch, and area_rmse and type_error_pct with the prefix train_ or held_out_.
    """
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    panels = figure.subplots(1, 2)
    labels = ("motion area: RMS error (0–1 scale)", "swimming type: wrong (%)")
    for axes, name, ylabel in zip(panels, ("area_rmse", "type_error_pct"), labels, strict=True):
        for side, colour in (("train", "#0072B2"), ("held_out", "#D55E00")):
            label = "learnt from" if side == "train" else "held out"
            axes.plot(curve["epoch"], curve[f"{side}_{name}"], color=colour, lw=1.3, label=label)
        # The axis shows all errors from epoch 1 on; epoch 0, before any learning, may be far above.
        # It reaches at least twice the last error, or 1 if that is 0.
        errors = curve.loc[curve["epoch"] > 0, [f"train_{name}", f"held_out_{name}"]]
        top = max(2 * float(errors.iloc[-1].max()) or 1.0, 1.05 * float(errors.max().max()))
        axes.set(xlabel="epoch", ylabel=ylabel, ylim=(0, top))
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    return figure


def draw_held_out_predictions(predicted: Floats, true: Floats) -> Figure:
    """Draw the network's predictions for n held-out rows: a scatter of areas, a table of types.

    predicted, true (n, 2): relative motion area and swimming type.
    """
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    scatter, confusions = figure.subplots(1, 2)
    # Motion areas, in the colour of the true type.
    types = round_swimming_types(true[:, 1])
    colours = np.empty((len(true), 4))
    for swimming_type, (name, colour) in TYPES.items():
        colours[types == swimming_type] = to_rgba_array(colour)
        scatter.scatter([], [], s=14, color=colour, label=name)  # for the key alone
    scatter.scatter(true[:, 0], predicted[:, 0], s=7, c=colours, alpha=0.45, linewidths=0)
    scatter.plot([0, 1], [0, 1], color="0.3", lw=0.9)
    scatter.set(
        xlabel="true motion area, Δ later", ylabel="predicted", xlim=(0, 1), ylim=(0, 1),
        aspect="equal", title="motion area of held-out rows (line: perfect)",
    )  # fmt: skip
    scatter.legend(frameon=True, title="true type", loc="upper left", fontsize=8)
    # The table of types: of the rows of each true type, the share predicted as each type.
    counts = count_confusions(predicted, true)
    share = 100 * counts / np.maximum(counts.sum(1, keepdims=True), 1)
    names = [name for name, _ in TYPES.values()]
    confusions.imshow(share, cmap="Blues", vmin=0, vmax=100)
    for row, column in np.ndindex(counts.shape):
        confusions.text(
            column, row, f"{share[row, column]:.0f} %\n({counts[row, column]})",
            ha="center", va="center", color="white" if share[row, column] > 55 else "black",
        )  # fmt: skip
    confusions.set(
        xticks=range(3), xticklabels=names, yticks=range(3), yticklabels=names,
        xlabel="predicted type", ylabel="true type, Δ later", title="type of held-out rows",
    )  # fmt: skip
    return figure
