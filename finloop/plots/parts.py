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
INK = (150, 30, 30)  # of texts on cut-outs, which are grey
_GROUND = 205  # grey level that a cut-out lies on


def draw_empty_tank(
    background: Picture, alpha: float, key_inches: float = 0.0
) -> tuple[Figure, Axes]:
    """Draw the picture of the empty tank; return the figure and its axes, in px of the film.

    background: (h, w) grey or (h, w, 3) RGB. alpha: opacity of the picture, 0 … 1. key_inches:
    height left free for a key.
    """
    height, width = background.shape[:2]
    figure = Figure(figsize=(10, 10 * height / width + key_inches), layout="constrained")
    axes = figure.subplots()
    axes.imshow(background, cmap="gray", vmin=0, vmax=255, alpha=alpha)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    return figure, axes


def unit_vectors(angle_deg: float | Floats) -> Floats:
    """Return unit vectors x, y (…, 2) of angles (…) in degrees, anticlockwise; y points down."""
    angle = np.radians(angle_deg)
    return np.stack([np.cos(angle), -np.sin(angle)], axis=-1)


def draw_heading_arrows(axes: Axes, rows: pd.DataFrame, **style: Any) -> None:
    """Draw an arrow along the heading of each animal in a table.

    rows: columns x_px, y_px, heading_deg. style: Matplotlib's, such as the colour.
    """
    angle = np.radians(rows["heading_deg"])
    axes.quiver(
        rows["x_px"], rows["y_px"], np.cos(angle), np.sin(angle), angles="uv", scale=45,
        width=0.0025, **style,
    )  # fmt: skip


def join_in_rows(tiles: Sequence[Picture], columns: int) -> list[Picture]:
    """Join tiles (h, w, 3) of one size side by side; return one picture per row of tiles.

    columns: tiles in a row; white tiles fill the last row. Without tiles there is no row.
    """
    missing = -len(tiles) % columns
    white_tiles = [np.full_like(tiles[0], 255)] * missing if tiles else []
    tiles = [*tiles, *white_tiles]
    return [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]


def crop_with_edge_repeated(
    picture: Picture, left: int, top: int, width: int, height: int
) -> Picture:
    """Return a rectangle of a picture; beyond the picture its edge pixels are repeated.

    left, top, width, height: of the rectangle, px.
    """
    columns = np.clip(np.arange(left, left + width), 0, picture.shape[1] - 1)
    rows = np.clip(np.arange(top, top + height), 0, picture.shape[0] - 1)
    return picture[rows[:, None], columns]


def stack_pictures(pictures: Sequence[Picture]) -> Picture:
    """Stack pictures (h, w, 3) below each other; return one, as wide as the first.

    The others are resized to this width.
    """
    width = pictures[0].shape[1]
    column = [pictures[0]]
    for picture in pictures[1:]:
        size = width, round(picture.shape[0] * width / picture.shape[1])
        column.append(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    return np.vstack(column)


def convert_to_colour(picture: Picture) -> Picture:
    """Return a copy of a grey or colour picture, (h, w) or (h, w, 3), in colour (h, w, 3)."""
    return np.dstack([picture] * 3 if picture.ndim == 2 else [picture])


def composite_on_grey(colour: NDArray[np.float32], alpha: NDArray[np.float32]) -> Picture:
    """Composite premultiplied colours (h, w, 1 or 3), 0 … 255, over grey; return (h, w, 3).

    alpha (h, w, 1): 0 … 1.
    """
    blended = np.broadcast_to(colour + _GROUND * (1 - alpha), (*alpha.shape[:2], 3))
    return np.ascontiguousarray(np.clip(np.rint(blended), 0, 255).astype(np.uint8))


def write_text(
    picture: Picture, text: str, place: tuple[int, int], colour: Colour, font_scale: float,
    stroke_px: int = 1,
) -> None:  # fmt: skip
    """Write a text into a picture (h, w, 3), in place.

    place: x, y in px of the left end of the text's base line. colour: RGB. font_scale: 1 is about
    22 px high. stroke_px: width of the strokes.
    """
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, text, place, font, font_scale, colour, stroke_px, cv2.LINE_AA)


def draw_message(text: str) -> Figure:
    """Return a figure that shows a text, in place of a chart without content."""
    figure = Figure(figsize=(8, 2))
    figure.text(0.02, 0.5, text, va="center", fontsize=9, wrap=True)
    return figure


def draw_arrow(axes: Axes, start: Floats, end: Floats, **style: object) -> None:
    """Draw an arrow between two places (x, y) in the units of the axes.

    style: Matplotlib's, such as color and lw.
    """
    arrow = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **style}
    # An annotation without a text; its arrow leads from the text's place to the annotated place.
    axes.annotate(
        "", xy=tuple(end), xytext=tuple(start), zorder=3, annotation_clip=False, arrowprops=arrow
    )
