"""Find the pieces of a drawing: silhouettes, each with the contours that lie in it.

A piece is what hangs together: its silhouette is the outline around all of it, with its strokes.
A contour follows the silhouette by mean value coordinates (Floater 2003; Hormann & Floater 2006),
which keep every affine motion, hold for any simple polygon, and inside and outside of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from finloop.base.arrays import Floats, Points
from finloop.base.drawing import Curve, Drawing
from finloop.base.errors import FinloopError

RASTER_PX = 1024
"""Larger side of the mask on which pieces are found. So a silhouette is off by 0.1 % of it."""
LEAST_LINE_PX = 3  # width of a line on that mask, so that what touches hangs together
MOST_PIECES = 100


@dataclass(frozen=True)
class DrawingPieces:
    """The pieces of a drawing: closed silhouettes, and the piece of each contour by id."""

    silhouettes: tuple[Curve, ...]
    piece_of: dict[str, int]


def find_pieces(drawing: Drawing) -> DrawingPieces:
    """Return the pieces of a drawing, which do not touch; FinloopError if more than MOST_PIECES."""
    widths = {name: _line_width(drawing, name) for name in drawing.curves}
    low = np.min([c.points.min(axis=0) - widths[k] for k, c in drawing.curves.items()], axis=0)
    high = np.max([c.points.max(axis=0) + widths[k] for k, c in drawing.curves.items()], axis=0)
    extent = float((high - low).max()) or 1.0
    scale = RASTER_PX / extent
    shift = LEAST_LINE_PX - low * scale
    width, height = (np.ceil((high - low) * scale) + 2 * LEAST_LINE_PX + 1).astype(int)
    mask = np.zeros((height, width), np.uint8)
    pixels = {
        name: np.round(curve.points * scale + shift).astype(np.int32)
        for name, curve in drawing.curves.items()
    }
    for name, curve in drawing.curves.items():
        if curve.closed:
            cv2.fillPoly(mask, [pixels[name]], 255)
        thickness = max(LEAST_LINE_PX, round(widths[name] * scale))
        cv2.polylines(mask, [pixels[name]], curve.closed, 255, thickness)
    count, labels = cv2.connectedComponents(mask, connectivity=8)
    if count - 1 > MOST_PIECES:
        raise FinloopError(
            f"a drawing of {count - 1} separate pieces",
            f"at most {MOST_PIECES}",
            "join them, or leave small ones out",
        )
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = dict[int, Points]()  # of a piece; a part of a piece can lie in a hole of it
    for outline in outlines:
        points = outline[:, 0, :]
        label = int(labels[points[0, 1], points[0, 0]]) - 1
        if label not in largest or len(points) > len(largest[label]):
            largest[label] = points.astype(np.float64)
    silhouettes = [Curve((largest[k] - shift) / scale, closed=True) for k in sorted(largest)]
    rank = {label: number for number, label in enumerate(sorted(largest))}
    piece_of = {
        name: _piece_at(labels, points[0], rank, largest) for name, points in pixels.items()
    }
    return DrawingPieces(tuple(silhouettes), piece_of)


def _piece_at(
    labels: np.ndarray, pixel: np.ndarray, rank: Mapping[int, int], largest: Mapping[int, Points]
) -> int:
    """Return the number of the piece at a pixel (2,), or of the piece around it.

    labels (h, w): label + 1 of the piece that covers each pixel, 0 for none; pixel: x, y; rank:
    number of each piece, by label; largest: the points (n, 2) of its longest outline, by label.
    """
    label = int(labels[pixel[1], pixel[0]]) - 1
    if label in rank:
        return rank[label]
    place = (float(pixel[0]), float(pixel[1]))
    around = (
        k for k, points in largest.items()
        if cv2.pointPolygonTest(points.astype(np.float32), place, False) >= 0
    )  # fmt: skip
    return rank[next(around)]


def _line_width(drawing: Drawing, name: str) -> float:
    """Return the width of the line along a contour, 0 if it has none."""
    paint = drawing.styles.get(name)
    return paint.width if paint is not None and paint.stroke is not None else 0.0


def mean_value_weights(points: Floats, polygon: Floats) -> Floats:
    """Return the weights (m, n) of a polygon's corners (n, 2) that give points (m, 2) as means.

    Each row sums to 1, and `weights @ polygon` is `points`. w_i = (tan(α_{i−1}/2) + tan(α_i/2)) /
    r_i, where r_i is the distance of corner i, and α_i the angle under which edge i is seen.
    """
    offset = polygon[None] - points[:, None]
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), 1e-12)
    after, next_distance = np.roll(offset, -1, axis=1), np.roll(distance, -1, axis=1)
    cross = offset[..., 0] * after[..., 1] - offset[..., 1] * after[..., 0]
    product, dot = distance * next_distance, (offset * after).sum(axis=-1)
    # tan(α / 2) = sin α / (1 + cos α) = (1 − cos α) / sin α; the second is infinite on an edge,
    # whose two ends then share the weight.
    sine = np.where(np.abs(cross) > 1e-12 * product, cross, 1e-12 * product)
    tangent = np.where(dot > 0, cross / np.where(dot > 0, product + dot, 1), (product - dot) / sine)
    weights = (tangent + np.roll(tangent, 1, axis=1)) / distance
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
