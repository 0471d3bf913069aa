"""Figures of the test of realism: ROC curves, channels, the falsest windows."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from finloop.base.arrays import Picture
from finloop.plots.animate import COLOURS
from finloop.realism.examples import ANIMATION, FILM, SIDES
from finloop.realism.windows import AGAIN, CHANNELS, HALVES

WORDS = {HALVES: "one half of the film", AGAIN: "the film drawn again"}
UNITS = ("forward\n(body lengths/s)", "sideways\n(body lengths/s)", "turning\n(°/s)",
         "relative\nmotion area")  # fmt: skip
_GREY = {HALVES: "0.35", AGAIN: "0.65"}
_SIDE = {ANIMATION: COLOURS[1], FILM: "0.35"}


def draw_roc(table: pd.DataFrame, roc: pd.DataFrame) -> Figure:
    """Draw ROC curves, and bars of the area under them for each kind of measurement.

    table: columns compared, channel, auc, low, high (ends of the 95 % interval); roc: columns
    compared, false_alarms, hits. compared: a mode, or parts of the film.
    """
    names = list(dict.fromkeys(table["compared"]))
    modes = [name for name in names if name not in _GREY]
    colours = dict(zip(modes, COLOURS, strict=False)) | _GREY
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    curves, bars = figure.subplots(1, 2, width_ratios=(1, 1.6))
    curves.plot([0, 1], [0, 1], color="0.8", lw=1)
    if table.empty:
        curves.text(0.5, 0.5, "the film is too short", ha="center")
    channels = ["all", *CHANNELS]
    width = 0.8 / max(len(names), 1)
    # A curve and a group of bars for each comparison.
    for number, name in enumerate(names):
        areas = table[table["compared"] == name].set_index("channel")
        value, low, high = (float(areas.at["all", key]) for key in ("auc", "low", "high"))
        curve = roc[roc["compared"] == name]
        curves.plot(
            curve["false_alarms"], curve["hits"], color=colours[name],
            label=f"{WORDS.get(name, name)}: {value:.3f} ({low:.2f} – {high:.2f})",
        )  # fmt: skip
        areas = areas.reindex(channels)
        places = np.arange(len(channels)) + width * (number - (len(names) - 1) / 2)
        bars.bar(
            places, areas["auc"] - 0.5, width, bottom=0.5, color=colours[name],
            label=WORDS.get(name, name), error_kw={"ecolor": "0.2", "lw": 0.8},
            yerr=[areas["auc"] - areas["low"], areas["high"] - areas["auc"]],
        )  # fmt: skip
    # The axes.
    curves.set(xlabel="film windows taken for animation", ylabel="animation windows recognised",
               xlim=(0, 1), ylim=(0, 1), aspect="equal")  # fmt: skip
    if names:
        curves.legend(frameon=False, loc="lower right", fontsize=7, title="area (95 % interval)",
                      title_fontsize=7)  # fmt: skip
        bars.legend(frameon=False, ncols=2)
    bars.axhline(0.5, color="0.2", lw=0.8)
    bars.set_xticks(range(len(channels)), ["all four", *CHANNELS])
    bars.set(ylabel="area under the ROC curve; 0.5: cannot tell")
    bars.set_ylim(min(0.4, bars.get_ylim()[0]), 1.0)
    return figure


def draw_false_windows(
    curves: pd.DataFrame, titles: Sequence[str], strips: Sequence[Mapping[str, Picture]]
) -> Figure:
    """Draw the most obviously false windows, each with the film window most like it.

    On the left are pictures, on the right the channels of both. curves: columns example, side
    (animation or film), time_s and a column per channel. titles, strips: of each example a title,
    and a picture (h, w, 3) per side.
    """
    if not titles:
        figure = Figure(figsize=(8, 1.5))
        figure.text(0.5, 0.5, "no animation was compared", ha="center", va="center")
        return figure
    height = 2.1 * len(titles) + 0.5
    figure = Figure(figsize=(15, height))  # laid out by hand: matplotlib's layout took 2 of 7 s
    grid = figure.add_gridspec(
        2 * len(titles), 5, width_ratios=(5, 1, 1, 1, 1), wspace=0.25, hspace=0.3,
        left=0.01, right=0.99, top=1 - 0.4 / height, bottom=0.5 / height,
    )  # fmt: skip
    for number, (title, strip) in enumerate(zip(titles, strips, strict=True)):
        # The pictures of both sides, one above the other.
        for row, side in enumerate(SIDES):
            axes = figure.add_subplot(grid[2 * number + row, 0])
            axes.imshow(strip[side], aspect="equal")
            axes.set(xticks=[], yticks=[])
            words = title if side == ANIMATION else "the film window most like it"
            axes.set_title(words, fontsize=8, loc="left", color=_SIDE[side], pad=2)
        # The channels of both sides, each in a panel.
        example = curves[curves["example"] == number]
        for column, channel in enumerate(CHANNELS):
            axes = figure.add_subplot(grid[2 * number : 2 * number + 2, column + 1])
            for side, window in example.groupby("side"):
                axes.plot(window["time_s"], window[channel], color=_SIDE[str(side)], lw=1.2)
            axes.tick_params(labelsize=7)
            if number == 0:
                axes.set_title(UNITS[column], fontsize=8)
    words = "s (channels); pictures at equal times"
    figure.text(0.5, 0.1 / height, words, ha="center", fontsize=8)
    return figure
