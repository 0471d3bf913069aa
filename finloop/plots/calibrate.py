"""Picture of `calibrate`: distances and alignment of fish, in the film and by the zones."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from finloop.social.measures import MEASURES, values_of_measure

_LABELS = {
    "neighbour_distance": "nearest neighbour (body lengths)",
    "alignment_deg": "heading against the nearest neighbour's (°)",
    "inter_fish_deg": "bearing of the nearest neighbour (°)",
    "wall_distance": "distance from the wall (body lengths)",
    "polarisation": "polarisation of the shoal",
}
_COLOURS = ("#8a98a0", "#4d5b63", "#d1721f", "#2c7bb6")
_SHOWN = 0.99  # quantile of the values at which the axis ends
_BINS = 30


def draw_school_measures(groups: Mapping[str, pd.DataFrame]) -> Figure:
    """Draw the distribution of each measure of a school: a panel per measure, a line per group.

    groups: name of a group, such as a half of the film → its table, with a column per measure.
    """
    figure = Figure(figsize=(12, 6.4), layout="constrained")
    grid = figure.subplots(2, 3)
    for axes, name in zip(grid.flat, MEASURES, strict=False):
        values_by_group = {group: values_of_measure(table, name) for group, table in groups.items()}
        all_values = np.concatenate(list(values_by_group.values()))
        axes.set(xlabel=_LABELS[name], ylabel="density")
        if not len(all_values):
            axes.text(0.5, 0.5, "one fish at a time", ha="center", transform=axes.transAxes)
            continue
        edges = np.linspace(0, max(float(np.quantile(all_values, _SHOWN)), 1e-6), _BINS + 1)
        for (group, values), colour in zip(values_by_group.items(), _COLOURS, strict=False):
            if len(values):
                heights = np.histogram(values, edges)[0] / len(values) / np.diff(edges)
                axes.stairs(heights, edges, color=colour, lw=1.8, label=group)
        axes.set(xlim=(0, edges[-1]), ylim=(0, None))
    # The key fills the last panel. Even a fish alone has a distance from the wall, so that panel
    # names every group.
    handles, labels = grid.flat[MEASURES.index("wall_distance")].get_legend_handles_labels()
    grid.flat[-1].axis("off")
    grid.flat[-1].legend(handles, labels, loc="center", frameon=False)
    return figure
