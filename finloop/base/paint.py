"""Painting layers of contours: shapes, and pictures with smooth edges.

Contours are painted alike in every format: lines with round joins and ends, fills by the even-odd
rule, so that holes stay holes and folds are seen. Only dashes may have straight ends.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints, Picture, Points
from finloop.base.drawing import Morph
from finloop.base.style import (
    Colour,
    Gradient,
    Paint,
    colours_at,
    gradient_offsets,
    move_fill,
    scale_paint,
)

PART = "#"
"""Layers `d`, `d#2`, `d#3` are contours of one shape: the hole of a letter is one of them."""

FINE = 8
"""Mask pixels along the side of a pixel. OpenCV paints every one that it touches: fills are 0.05 px
and lines 0.12 px too wide. Its own smooth edges are worse; a finer mask is no better."""

LEAST_PERIOD = 0.5
"""Shortest dashes with their gaps, px, that are painted; shorter ones are a paler line."""

MOST_DASHES = 10_000  # times that a line's dashes repeat

_SHIFT = 6  # bits of a coordinate's fraction in OpenCV
_THICKEST = 32_767  # px, of OpenCV's lines


def shape_of(layer: str) -> str:
    """Return the shape that a layer belongs to: `d` for `d` and `d#2`."""
    name, mark, number = layer.rpartition(PART)
    return name if mark and name and number.isdecimal() else layer


def layers_by_shape(layers: Iterable[str]) -> dict[str, list[str]]:
    """Return the layers of each shape, in their order, by its id."""
    shapes = dict[str, list[str]]()
    for layer in layers:
        shapes.setdefault(shape_of(layer), []).append(layer)
    return shapes


@dataclass(frozen=True)
class Shape:
    """Contours that are painted together, such as a letter and its holes."""

    name: str
    layers: tuple[str, ...]  # ids of the contours
    closed: tuple[bool, ...]  # whether each contour is closed
    paint: Paint


def group_contours(
    closed: Mapping[str, bool], styles: Mapping[str, Paint], side: float
) -> list[Shape]:
    """Group contours into shapes in drawing order: `d`, `d#2` and `d#3` become the shape `d`.

    closed: whether each contour is closed, by its id. styles: paints by id; a shape has that of its
    first contour. Without one it is a black line, as wide as side / 200. side: the longer side of
    the drawing.
    """
    black_line = Paint(None, (0, 0, 0), 1.0, 1.0, width=side / 200)
    layers_of_shape = layers_by_shape(closed)
    shapes = []
    for name, layers in layers_of_shape.items():
        layers_closed = tuple(closed[layer] for layer in layers)
        paint = styles.get(layers[0], black_line)
        if paint.fill is None and paint.stroke is None:
            paint = black_line
        shapes.append(Shape(name, tuple(layers), layers_closed, paint))
    return shapes


def painted_frames(morph: Morph) -> list[list[Shape]]:
    """Return the painted shapes of a morph, bottom first, each as it is in every frame.

    One shape can hold several contours.
    """
    side = max(morph.width, morph.height)
    frames = [
        group_contours(morph.closed, morph.paints_at(frame), side)
        for frame in range(len(morph.tau))
    ]
    return [list(shapes) for shapes in zip(*frames, strict=True)]


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
        for fill, opacity, line in (
            (paint.fill, paint.fill_opacity, None),  # None: the area
            (paint.stroke, paint.stroke_opacity, scale_paint(paint, scale, np.zeros(2))),
        ):
            fill_px = move_fill(fill, scale * np.eye(2), np.zeros(2))
            if fill_px is not None and opacity > 0:
                _paint_fill(picture, contours_px, shape.closed, fill_px, opacity, line)
    return np.round(picture).astype(np.uint8)


def _paint_fill(
    picture: NDArray[np.float32], contours: list[Points], closed: tuple[bool, ...],
    fill: Colour | Gradient, opacity: float, line: Paint | None,
) -> None:  # fmt: skip
    """Paint contours in a colour or gradient onto a picture: their area, or lines along them.

    picture (h, w, 3): is changed in place. contours: (n, 2) px of the picture. closed: whether each
    contour is closed, for lines. opacity: 0 … 1. line: has the width and the dashes of the lines,
    px; None paints the area.
    """
    picture_size = picture.shape[1::-1]  # width, height
    margin = 1 if line is None else line.width / 2 + 1
    points = np.concatenate(contours)
    low = np.clip(np.floor(points.min(axis=0) - margin), 0, picture_size).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + margin), 0, picture_size).astype(int)
    if (low >= high).any():
        return  # outside the picture
    # Paint a mask with FINE² pixels for each pixel; averaging them gives smooth edges.
    mask = np.zeros(tuple((high - low)[::-1] * FINE), np.uint8)
    fine = [(contour - low) * FINE for contour in contours]
    if line is None:
        cv2.fillPoly(mask, [_to_fixed_point(contour) for contour in fine], 255, cv2.LINE_8, _SHIFT)
    else:
        fine_line = scale_paint(line, FINE, np.zeros(2))
        opacity *= max(
            _draw_line(mask, np.r_[contour, contour[:is_closed]], is_closed, fine_line)
            for contour, is_closed in zip(fine, closed, strict=True)
        )
    window_size = (int(high[0] - low[0]), int(high[1] - low[1]))
    share = cv2.resize(mask, window_size, interpolation=cv2.INTER_AREA).astype(np.float32)
    share *= opacity / 255
    if not isinstance(fill, Gradient):
        colour = np.array(fill, np.float32)
    else:
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]] + 0.5
        rgba = colours_at(fill, gradient_offsets(fill, np.stack([x, y], axis=-1)))
        colour, share = rgba[..., :3].astype(np.float32), share * rgba[..., 3].astype(np.float32)
    window = picture[low[1] : high[1], low[0] : high[0]]
    window += share[..., None] * (colour - window)


def _to_fixed_point(points: Points) -> Ints:
    """Return points (n, 2) of a mask as OpenCV takes them, (n, 2) int32.

    OpenCV counts from the middle of the first pixel, in whole steps of 1 / 2**_SHIFT pixel.
    """
    return np.round((points - 0.5) * 2**_SHIFT).astype(np.int32)


def _draw_line(mask: NDArray[np.uint8], points: Points, closed: bool, line: Paint) -> float:
    """Draw a dashed line onto a mask; return its opacity, < 1 where dashes are too fine to draw.

    mask: is changed in place. points (n, 2): px of the mask; of a closed line the last is the
    first. line: its width and dashes in px of the mask. Dashes that are too short or too many to be
    seen become a whole line, which is paler.
    """
    thickness = int(np.clip(round(line.width), 1, _THICKEST))
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    period = sum(line.dashes)
    if not line.dashes or not along[-1] / MOST_DASHES < period or period < LEAST_PERIOD * FINE:
        fixed = _to_fixed_point(points[:-1] if closed else points)
        cv2.polylines(mask, [fixed], closed, 255, thickness, cv2.LINE_8, _SHIFT)
        return sum(line.dashes[::2]) / period if period else 1.0

    def cut_line(start: float, end: float) -> Points:
        """Return the part of the line from one distance along it to another, (m, 2)."""
        inside = points[(along > start) & (along < end)]
        ends = np.column_stack([np.interp([start, end], along, axis) for axis in points.T])
        return np.concatenate([ends[:1], inside, ends[1:]])

    for start, end in dash_spans(line, along[-1]):
        if line.round_dashes:
            fixed = _to_fixed_point(cut_line(start, end))
            cv2.polylines(mask, [fixed], False, 255, thickness, cv2.LINE_8, _SHIFT)
            continue
        # OpenCV's lines have round ends: draw a shorter one, and a rectangle over each end.
        reach = min(line.width / 2, (end - start) / 2)
        if end - start > line.width:
            fixed = _to_fixed_point(cut_line(start + reach, end - reach))
            cv2.polylines(mask, [fixed], False, 255, thickness, cv2.LINE_8, _SHIFT)
        for first, last in ((start, start + reach), (end - reach, end)):
            a, b = cut_line(first, last)[[0, -1]]
            side = (b - a)[::-1] * [-1, 1] / max(float(np.hypot(*(b - a))), 1e-9) * line.width / 2
            corners = _to_fixed_point(np.stack([a - side, b - side, b + side, a + side]))
            cv2.fillConvexPoly(mask, corners, 255, cv2.LINE_8, _SHIFT)
    return 1.0


def dash_spans(line: Paint, length: float) -> Iterator[tuple[float, float]]:
    """Yield where along a line each dash starts and ends; length: of the line."""
    edges = np.r_[0.0, np.cumsum(line.dashes)]
    begin = -(line.dash_offset % edges[-1])
    for turn in range(int(np.ceil((length - begin) / edges[-1]))):
        for start, end in edges[:-1].reshape(-1, 2) + begin + turn * edges[-1]:
            if end >= 0 and start <= length:
                yield max(float(start), 0.0), min(float(end), length)
