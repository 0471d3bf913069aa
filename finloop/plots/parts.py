"""Parts of several figures: the tank below, headings, tiles in rows, text on a picture."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture

Colour = tuple[int, int, int]
_GROUND = 205  # grey level that a cut-out lies on


def over_tank(background: Picture, alpha: float, below: float = 0.0) -> tuple[Figure, Axes]:
    """Return a figure of the empty tank, with axes in px of the film.

    alpha: opacity of the tank, 0 … 1; below: inches for a key.
    """
    height, width = background.shape[:2]
    figure = Figure(figsize=(10, 10 * height / width + below), layout="constrained")
    axes = figure.subplots()
    axes.imshow(background, cmap="gray", vmin=0, vmax=255, alpha=alpha)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    return figure, axes


def arrows(axes: Axes, rows: pd.DataFrame, **style: Any) -> None:
    """Draw the headings of some rows as arrows; rows: columns x_px, y_px, heading_deg."""
    angle = np.radians(rows["heading_deg"])
    axes.quiver(
        rows["x_px"], rows["y_px"], np.cos(angle), np.sin(angle), angles="uv", scale=45,
        width=0.0025, **style,
    )  # fmt: skip


def in_rows(tiles: Sequence[Picture], columns: int) -> list[Picture]:
    """Join tiles (h, w, 3) side by side into rows, one picture each; white fills the last."""
    white = [np.full_like(tile, 255) for tile in tiles[:1]] * (-len(tiles) % columns)
    every = [*tiles, *white]
    return [np.hstack(every[i : i + columns]) for i in range(0, len(every), columns)]


def one_below_another(pictures: Sequence[Picture]) -> Picture:
    """Join pictures (h, w, 3) of any sizes into one column, as wide as the first picture."""
    width = pictures[0].shape[1]
    column = [pictures[0]]
    for picture in pictures[1:]:
        size = width, round(picture.shape[0] * width / picture.shape[1])
        column.append(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    return np.vstack(column)


def convert_to_colour(picture: Picture) -> Picture:
    """Return a picture (h, w) or (h, w, 3) as a new (h, w, 3)."""
    return np.dstack([picture] * 3 if picture.ndim == 2 else [picture])


def on_grey(colour: NDArray[np.float32], alpha: NDArray[np.float32]) -> Picture:
    """Lay premultiplied colours (h, w, 1 or 3), 0 … 255, over grey; return (h, w, 3) uint8.

    alpha (h, w, 1): 0 … 1.
    """
    whole = np.broadcast_to(colour + _GROUND * (1 - alpha), (*alpha.shape[:2], 3))
    return np.ascontiguousarray(np.clip(np.rint(whole), 0, 255).astype(np.uint8))


def write(
    picture: Picture, text: str, place: tuple[int, int], colour: Colour, size: float, line: int = 1
) -> None:
    """Write a text into a picture (h, w, 3), in place.

    place: x, y px of the left end of the base line; colour: RGB; size: scale of OpenCV's font;
    line: px.
    """
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, line, cv2.LINE_AA)


def message(text: str) -> Figure:
    """Return a figure with a text instead of a picture."""
    figure = Figure(figsize=(8, 2))
    figure.text(0.02, 0.5, text, va="center", fontsize=9, wrap=True)
    return figure


def draw_arrow(axes: Axes, start: Floats, end: Floats, **style: object) -> None:
    """Draw an arrow between two places (x, y) in the units of the axes, in Matplotlib's style."""
    arrow = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **style}
    ends = tuple(end), tuple(start)
    axes.annotate("", *ends, zorder=3, annotation_clip=False, arrowprops=arrow)
