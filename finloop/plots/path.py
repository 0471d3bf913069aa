"""A figure of a path: the requested path, the path of each mode, and the error along it."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from finloop.base.arrays import Picture
from finloop.edit.modes import COLOURS
from finloop.plan.path_measures import root_mean_square

_REQUESTED = "0.2"


def draw_path(paths: pd.DataFrame, departures: pd.DataFrame, background: Picture) -> Figure:
    """Draw the requested path and each mode's path over the tank; on the right, errors over time.

    Rings mark where a fish left its path. paths: columns of `path_measures.PATH_ROWS`, among them
    across and late, the errors in body lengths. departures: columns of `path_measures.DEPARTURES`,
    a row for each part of the path that a fish left. background (h, w): the empty tank.
    """
    height, width = background.shape[:2]
    modes = dict(iter(paths.groupby("mode", sort=False)))
    timed = bool(paths["late"].notna().any())
    figure = Figure(figsize=(15, max(5.0, 7.5 * height / width)), layout="constrained")
    # The tank, with the requested path up to where the mode that got farthest is at the end.
    grid = GridSpec(len(modes), 2, figure, width_ratios=[1.1, 1])
    tank = figure.add_subplot(grid[:, 0])
    tank.imshow(background, cmap="gray", vmin=0, vmax=255, alpha=0.35)
    farthest = paths.loc[paths["along_px"].idxmax(), "mode"]
    requested = paths[paths["mode"] == farthest]
    tank.plot(requested["asked_x_px"], requested["asked_y_px"], color=_REQUESTED, lw=3.5, alpha=0.5,
              label=f"requested path of fish {paths['fish'].iloc[0] + 1}")  # fmt: skip
    # Each mode's path in the tank, and its errors in a panel.
    errors = None
    for row, (colour, (mode, path)) in enumerate(zip(COLOURS, modes.items(), strict=False)):
        tank.plot(path["x_px"], path["y_px"], color=colour, lw=1, label=f"path: {mode}")
        parts = departures[departures["mode"] == mode]
        tank.plot(parts["asked_x_px"], parts["asked_y_px"], "o", ms=11, mfc="none", mec=colour)
        errors = figure.add_subplot(grid[row, 1], sharex=errors, sharey=errors)
        _draw_errors(errors, path, parts, colour, timed)
        beside = root_mean_square(path["across"].to_numpy())
        errors.set_title(f"{mode}: {beside:.3f} body lengths RMS beside the path", fontsize=10)
    if errors is not None:
        errors.set_xlabel("time (s)")
    tank.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    tank.legend(frameon=True, loc="upper right")
    return figure


def _draw_errors(
    axes: Axes, path: pd.DataFrame, departures: pd.DataFrame, colour: str, timed: bool
) -> None:
    """Draw a mode's errors over time, with bands where the fish has left the path.

    path, departures: the mode's rows, as in `draw_path`. timed: whether the path has times: then
    the distance from the place due at each time is drawn, too.
    """
    axes.plot(path["time_s"], path["across"], color=colour, lw=1, label="beside the path")
    if timed:
        axes.plot(path["time_s"], path["late"], color=colour, lw=1, ls=":",
                  label="from the requested place")  # fmt: skip
    for part in departures.itertuples():
        axes.axvspan(part.from_s, part.to_s, color=colour, alpha=0.15)
    axes.set(ylabel="body lengths", ylim=(0, None))
    axes.legend(frameon=False, loc="upper right", fontsize=8)
