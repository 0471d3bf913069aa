"""A picture of the film: a frame, its difference from the still tank, light, camera, changes."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.base.arrays import Picture

_QUANTILE = 0.999  # quantile of the difference that is drawn black


def draw_film_check(
    frame: Picture, difference: NDArray[np.float32], table: pd.DataFrame, rate_hz: float, title: str
) -> Picture:
    """Return a picture of a frame, its difference from the still tank, and curves over time.

    The curves are of light, camera and change. difference (h, w): grey levels. table: columns
    frame, light, shift_x, shift_y (px), change, a row per frame. rate_hz: frames per second. title:
    text above the frame. The picture is RGB (h, w, 3).
    """
    height, width = difference.shape
    figure = Figure((12, 6 * height / width + 5.5), dpi=110, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    panels = figure.subplot_mosaic(
        [["frame", "difference"], ["light", "light"], ["camera", "camera"], ["change", "change"]],
        height_ratios=[6 * height / width, 1.6, 1.6, 1.6],
    )
    panels["frame"].imshow(frame, cmap="gray", vmin=0, vmax=255)
    panels["frame"].set_title(title)
    most = max(float(np.quantile(difference, _QUANTILE)), 1.0)
    panels["difference"].imshow(difference, cmap="gray_r", vmin=0, vmax=most)
    panels["difference"].set_title("its difference from the still tank")
    for name in ("frame", "difference"):
        panels[name].set_axis_off()
    time_s = table["frame"] / rate_hz
    _draw_curve(panels["light"], time_s, table["light"], 0.1, color="#E69F00", label="brightness")
    panels["light"].set(ylabel="light (first frame = 1)")
    for axis, colour, name in (("x", "#0072B2", "right"), ("y", "#D55E00", "down")):
        shift, style = table[f"shift_{axis}"], {"color": colour, "marker": ".", "ms": 2}
        _draw_curve(panels["camera"], time_s, shift, least_span=1.0, label=name, **style)
    panels["camera"].set(ylabel="camera (px)")
    panels["camera"].legend(frameon=False, loc="upper right", ncols=2)
    _draw_curve(panels["change"], time_s, table["change"], 4.0, color="#009E73", label="change")
    panels["change"].set(ylabel="change (grey levels)", xlabel="time (s)", ylim=(0, None))
    for name in ("light", "camera", "change"):
        panels[name].set_xlim(0, max(float(time_s.iloc[-1]), 1 / rate_hz))
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _draw_curve(
    axes: Axes, time_s: pd.Series, values: pd.Series, least_span: float, **style: Any
) -> None:
    """Draw values over time, with gaps where they are missing.

    The axis spans at least `least_span`, so that a nearly constant line looks flat. style:
    Matplotlib's, such as label and colour.
    """
    axes.plot(time_s, values, lw=0.8, **style)
    low, high = axes.get_ylim()
    if high - low < least_span:
        middle = (low + high) / 2
        axes.set_ylim(middle - least_span / 2, middle + least_span / 2)
