"""Painting layers of contours: styles, and pictures with smooth edges.

Contours are painted alike in every format: strokes with round joins and caps, fills by the
even-odd rule, so that holes stay holes and folds are seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from finloop.base.arrays import Picture, Points
from finloop.base.errors import FinloopError

PART = "#"
"""Layers `d`, `d#2`, `d#3` are contours of one shape: the hole of a letter is one of them."""

FINE = 8
"""Mask pixels along the side of a pixel. OpenCV paints every one that it touches: fills are 0.05 px
and lines 0.12 px too wide. Its own smooth edges are worse; a finer mask is no better."""

_SHIFT = 6  # bits of a coordinate's fraction in OpenCV

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Paint:
    """How a shape is painted: colours are RGB 0 … 255, or None where nothing is painted."""

    fill: Colour | None
    stroke: Colour | None
    fill_opacity: float  # 0 … 1
    stroke_opacity: float
    width: float  # of the stroke, in units of the drawing


@dataclass(frozen=True)
class Shape:
    """Contours that are painted together, such as a letter and its holes."""

    name: str
    layers: tuple[str, ...]  # ids of the contours
    closed: tuple[bool, ...]  # whether each contour is closed
    paint: Paint


def parse_style(style: str, side: float) -> Paint:
    """Return fill and stroke of an SVG style such as "fill:red;stroke:none".

    A style with neither gives a black line of width `side` / 200; side: the longer side of the
    drawing. FinloopError if a colour or number cannot be read.
    """

    def parse_colour(key: str) -> Colour | None:
        text = values.get(key, "none")
        return None if text == "none" else ImageColor.getrgb(text)[:3]

    values = dict(part.split(":", 1) for part in style.split(";") if ":" in part)
    values = {key.strip(): value.strip() for key, value in values.items()}
    try:
        fill, stroke = parse_colour("fill"), parse_colour("stroke")
        if fill is None and stroke is None:
            return Paint(None, (0, 0, 0), 1.0, 1.0, side / 200)
        numbers = ("fill-opacity", "stroke-opacity", "stroke-width")
        return Paint(fill, stroke, *(float(values.get(key, 1)) for key in numbers))
    except ValueError as error:
        raise FinloopError(
            f"the style {style!r} cannot be read ({error})",
            'fill and stroke as colours or none: "fill:#ffd27f;stroke:black;stroke-width:2"',
            "correct the style",
        ) from error


def group_contours(
    closed: Mapping[str, bool], styles: Mapping[str, str], side: float
) -> list[Shape]:
    """Group contours into shapes in drawing order: `d`, `d#2` and `d#3` become the shape `d`.

    closed, styles: by contour id; `styles` may lack some. side: the longer side of the drawing.
    """
    together = dict[str, list[str]]()
    for name in closed:
        together.setdefault(name.partition(PART)[0], []).append(name)
    shapes = []
    for name, layers in together.items():
        rings = tuple(closed[layer] for layer in layers)
        paint = parse_style(styles.get(layers[0], ""), side)
        shapes.append(Shape(name, tuple(layers), rings, paint))
    return shapes


def paint_layers(
    shapes: list[tuple[Shape, list[Points]]], size_px: tuple[int, int], scale: float
) -> Picture:
    """Paint shapes with their contours (n, 2) in order on white; return an RGB picture.

    size_px: height and width of the picture. scale: px per unit of the drawing. Pixel (0, 0)
    reaches from 0 to 1 / scale, as in SVG.
    """
    picture = np.full((*size_px, 3), 255.0, np.float32)
    for shape, contours in shapes:
        paint = shape.paint
        if paint.fill is not None:
            _paint_colour(
                picture, contours, shape.closed, scale, paint.fill, paint.fill_opacity, None
            )
        if paint.stroke is not None:
            width = paint.width * scale
            _paint_colour(
                picture, contours, shape.closed, scale, paint.stroke, paint.stroke_opacity, width
            )
    return np.round(picture).astype(np.uint8)


def _paint_colour(
    picture: NDArray[np.float32],
    contours: list[Points],
    closed: tuple[bool, ...],
    scale: float,
    colour: Colour,
    opacity: float,
    width: float | None,
) -> None:
    """Paint contours in one colour onto a picture: their area, or lines along them.

    picture (h, w, 3): changes. closed: whether each contour is closed. scale: px per unit of the
    drawing. opacity: 0 … 1. width: of the lines in px, None for the area.
    """
    height, wide = picture.shape[:2]
    reach = 1 if width is None else width / 2 + 1
    every = np.concatenate(contours) * scale
    low = np.clip(np.floor(every.min(axis=0) - reach), 0, (wide, height)).astype(int)
    high = np.clip(np.ceil(every.max(axis=0) + reach), 0, (wide, height)).astype(int)
    if (low >= high).any():
        return  # outside
    mask = np.zeros(tuple((high - low)[::-1] * FINE), np.uint8)
    # OpenCV counts from the middle of the first pixel.
    fine = [(points * scale - low) * FINE - 0.5 for points in contours]
    lines = [np.round(points * 2**_SHIFT).astype(np.int32) for points in fine]
    if width is None:
        cv2.fillPoly(mask, lines, 255, cv2.LINE_8, _SHIFT)
    else:
        thick = max(1, round(width * FINE))
        for line, ring in zip(lines, closed, strict=True):
            cv2.polylines(mask, [line], ring, 255, thick, cv2.LINE_8, _SHIFT)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    share = cv2.resize(mask, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    share *= opacity / 255
    part = picture[low[1] : high[1], low[0] : high[0]]
    part += share[..., None] * (np.array(colour, np.float32) - part)
