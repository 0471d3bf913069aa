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


def shape_of(layer: str) -> str:
    """Return the shape that a layer belongs to: `d` for `d` and `d#2`."""
    name, mark, number = layer.rpartition(PART)
    return name if mark and name and number.isdecimal() else layer


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
    """Return how a shape is painted, from an SVG style such as "fill:red;stroke:none".

    A style with neither fill nor stroke gives a black line of width `side` / 200; side: the longer
    side of the drawing. FinloopError if a colour or number cannot be read.
    """
    values = dict(part.split(":", 1) for part in style.split(";") if ":" in part)
    values = {key.strip(): value.strip() for key, value in values.items()}

    def parse_colour(key: str) -> Colour | None:
        """Return the colour of the key `fill` or `stroke`; None if it is none or missing."""
        text = values.get(key, "none")
        return None if text == "none" else ImageColor.getrgb(text)[:3]

    try:
        fill, stroke = parse_colour("fill"), parse_colour("stroke")
        if fill is None and stroke is None:
            black = 0, 0, 0
            return Paint(None, black, fill_opacity=1.0, stroke_opacity=1.0, width=side / 200)
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

    closed: whether each contour is closed, by its id. styles: SVG styles by id; a shape has the
    style of its first contour, "" if it is missing. side: the longer side of the drawing.
    """
    layers_of_shape = dict[str, list[str]]()
    for layer in closed:
        layers_of_shape.setdefault(shape_of(layer), []).append(layer)
    shapes = []
    for name, layers in layers_of_shape.items():
        layers_closed = tuple(closed[layer] for layer in layers)
        paint = parse_style(styles.get(layers[0], ""), side)
        shapes.append(Shape(name, tuple(layers), layers_closed, paint))
    return shapes


def paint_layers(
    shapes: list[tuple[Shape, list[Points]]], size_px: tuple[int, int], scale: float
) -> Picture:
    """Paint shapes on white, each over the ones before; return an RGB picture (h, w, 3).

    shapes: each with its contours, (n, 2) in units of the drawing. size_px: height and width of the
    picture. scale: px per unit of the drawing. Pixel (0, 0) reaches from 0 to 1 / scale, as in SVG.
    """
    picture = np.full((*size_px, 3), 255.0, np.float32)
    for shape, contours in shapes:
        paint = shape.paint
        contours_px = [points * scale for points in contours]
        for colour, opacity, width_px in (
            (paint.fill, paint.fill_opacity, None),  # None: the area
            (paint.stroke, paint.stroke_opacity, paint.width * scale),
        ):
            if colour is not None:
                _paint_colour(picture, contours_px, shape.closed, colour, opacity, width_px)
    return np.round(picture).astype(np.uint8)


def _paint_colour(
    picture: NDArray[np.float32], contours: list[Points], closed: tuple[bool, ...],
    colour: Colour, opacity: float, width_px: float | None,
) -> None:  # fmt: skip
    """Paint contours in one colour onto a picture: their area, or lines along them.

    picture (h, w, 3): is changed in place. contours: (n, 2) px of the picture. closed: whether each
    contour is closed, for lines. opacity: 0 … 1. width_px: of the lines; None paints the area.
    """
    picture_size = picture.shape[1::-1]  # width, height
    margin = 1 if width_px is None else width_px / 2 + 1
    points = np.concatenate(contours)
    low = np.clip(np.floor(points.min(axis=0) - margin), 0, picture_size).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + margin), 0, picture_size).astype(int)
    if (low >= high).any():
        return  # outside the picture
    # Paint a mask with FINE² pixels for each pixel; averaging them gives smooth edges.
    mask = np.zeros(tuple((high - low)[::-1] * FINE), np.uint8)
    # OpenCV counts from the middle of the first pixel, in whole steps of 1 / 2**_SHIFT pixel.
    fine = [(contour - low) * FINE - 0.5 for contour in contours]
    lines = [np.round(contour * 2**_SHIFT).astype(np.int32) for contour in fine]
    if width_px is None:
        cv2.fillPoly(mask, lines, 255, cv2.LINE_8, _SHIFT)
    else:
        thickness = max(1, round(width_px * FINE))
        for line, is_closed in zip(lines, closed, strict=True):
            cv2.polylines(mask, [line], is_closed, 255, thickness, cv2.LINE_8, _SHIFT)
    window_size = (int(high[0] - low[0]), int(high[1] - low[1]))
    share = cv2.resize(mask, window_size, interpolation=cv2.INTER_AREA).astype(np.float32)
    share *= opacity / 255
    window = picture[low[1] : high[1], low[0] : high[0]]
    window += share[..., None] * (np.array(colour, np.float32) - window)
