"""Figures of the test of realism: ROC curves, channels, the falsest windows."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from finloop.base.arrays import Floats, Picture
from finloop.edit.modes import COLOURS
from finloop.realism.examples import ANIMATION, FILM, SIDES
from finloop.realism.windows import AGAIN, CHANNELS, HALVES

WORDS = {HALVES: "one half of the film", AGAIN: "the film drawn again"}
UNITS = ("forward\n(body lengths/s)", "sideways\n(body lengths/s)", "turning\n(°/s)",
         "relative\nmotion area")  # fmt: skip
_GREY = {HALVES: "0.35", AGAIN: "0.65"}
_SIDE = {ANIMATION: COLOURS[1], FILM: "0.35"}


def draw_roc(table: pd.DataFrame, roc: pd.DataFrame) -> Figure:
    """Draw ROC curves, and bars of the area under them for each kind of measurement.

    table: columns compared, channel, auc, low, high (ends of the 95 % interval), of motion or of
    pictures; roc: columns compared, false_alarms, hits. compared: a mode, or parts of the film.
    """
    by_comparison = table.groupby("compared", sort=False)
    areas = {str(name): rows.set_index("channel") for name, rows in by_comparison}
    modes = [name for name in areas if name not in _GREY]
    colours = dict(zip(modes, COLOURS, strict=False)) | _GREY
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    curves, bars = figure.subplots(1, 2, width_ratios=(1, 1.6))
    _draw_roc_curves(curves, areas, roc, colours)
    _draw_area_bars(bars, areas, colours)
    return figure


def _draw_roc_curves(
    axes: Axes, areas: Mapping[str, pd.DataFrame], roc: pd.DataFrame, colours: Mapping[str, str]
) -> None:
    """Draw the ROC curve of each comparison, with the area under it in the legend.

    areas, colours: by name of the comparison; roc: as in `draw_roc`.
    """
    axes.plot([0, 1], [0, 1], color="0.8", lw=1)
    for name, area in areas.items():
        value, low, high = (float(area.at["all", key]) for key in ("auc", "low", "high"))
        curve = roc[roc["compared"] == name]
        axes.plot(
            curve["false_alarms"], curve["hits"], color=colours[name],
            clip_on=False,  # a curve of area 1 lies on the frame
            label=f"{WORDS.get(name, name)}: {value:.3f} ({low:.2f} – {high:.2f})",
        )  # fmt: skip
    axes.set(xlabel="film windows taken for animation", ylabel="animation windows recognised",
             xlim=(0, 1), ylim=(0, 1), aspect="equal")  # fmt: skip
    if areas:
        axes.legend(frameon=False, loc="lower right", fontsize=7, title="area (95 % interval)",
                    title_fontsize=7)  # fmt: skip
    else:
        axes.text(0.5, 0.5, "the film is too short", ha="center")


def _draw_area_bars(
    axes: Axes, areas: Mapping[str, pd.DataFrame], colours: Mapping[str, str]
) -> None:
    """Draw the areas under the ROC curves: for each channel a bar for each comparison.

    areas, colours: by name of the comparison; a comparison may lack channels.
    """
    channels = list(dict.fromkeys(name for area in areas.values() for name in area.index))
    width = 0.8 / max(len(areas), 1)
    for number, (name, area) in enumerate(areas.items()):
        shown = area.reindex(channels)
        places = np.arange(len(channels)) + width * (number - (len(areas) - 1) / 2)
        axes.bar(
            places, shown["auc"] - 0.5, width, bottom=0.5, color=colours[name],
            label=WORDS.get(name, name), error_kw={"ecolor": "0.2", "lw": 0.8},
            yerr=[shown["auc"] - shown["low"], shown["high"] - shown["auc"]],
        )  # fmt: skip
    if areas:
        axes.legend(frameon=False, ncols=2)
    axes.axhline(0.5, color="0.2", lw=0.8)
    names = ["all\ntogether" if name == "all" else name.replace("_", "\n") for name in channels]
    axes.set_xticks(range(len(channels)), names, fontsize=10 if len(names) < 8 else 7)
    axes.set(ylabel="area under the ROC curve; 0.5: cannot tell")
    axes.set_ylim(min(0.4, axes.get_ylim()[0]), 1.0)


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


def draw_looks(looks: Mapping[str, Floats], crops: Mapping[str, Picture]) -> Figure:
    """Draw where the network looks: for each comparison a map for crops and one for their changes.

    looks: by name, (2, h, w). crops: by name, a crop (h, w) to lie under the maps, where there is
    one.
    """
    if not looks:
        figure = Figure(figsize=(8, 1.5))
        figure.text(0.5, 0.5, "no pictures were compared", ha="center", va="center")
        return figure
    figure = Figure(figsize=(2.2 * max(len(looks), 3), 4.9), layout="constrained")
    panels = figure.subplots(2, len(looks), squeeze=False)
    for column, (name, maps) in zip(panels.T, looks.items(), strict=True):
        for axes, heat, view in zip(column, maps, ("crop", "change of the crop"), strict=True):
            smooth = cv2.GaussianBlur(np.asarray(heat, np.float32), (0, 0), 2.0)
            axes.imshow(
                crops.get(name, np.full(heat.shape, 128, np.uint8)), "gray", vmin=0, vmax=255
            )
            axes.imshow(smooth, "inferno", alpha=0.6)
            axes.set(xticks=[], yticks=[])
            axes.set_title(f"{WORDS.get(name, name)}\n{view}", fontsize=8)
    return figure


def draw_obvious_crops(titles: Sequence[str], crops: Picture, shown: int = 12) -> Figure:
    """Draw windows whose pictures are most obviously false, each above the film most like it.

    titles: of n windows. crops (n, 2, ticks, h, w): of animation and film. shown: ticks drawn.
    """
    if not titles:
        return draw_false_windows(pd.DataFrame(), [], [])
    ticks = np.linspace(0, crops.shape[2] - 1, shown).round().astype(int)
    figure = Figure(figsize=(15, 2.75 * len(titles)))
    panels = figure.subplots(2 * len(titles), 1, squeeze=False)[:, 0]
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.005, top=1 - 0.1 / len(titles))
    for axes, number in zip(panels, range(len(panels)), strict=True):
        example, side = divmod(number, 2)
        axes.imshow(np.hstack(list(crops[example, side, ticks])), "gray", vmin=0, vmax=255)
        axes.set(xticks=[], yticks=[])
        words = titles[example] if side == 0 else "the film window most like it"
        axes.set_title(words, fontsize=8, loc="left", color=_SIDE[SIDES[side]], pad=2)
    return figure
