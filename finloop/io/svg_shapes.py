"""Shapes of SVG as contours: paths and basic shapes as svgelements reads them, as polylines.

Curved pieces become polylines that stay within a tolerance of them.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import svgelements as svg

from finloop.base.arrays import Mask, Points
from finloop.base.drawing import LARGEST, Curve
from finloop.io.svg_style import UnreadableValueError, local_name, read_length

MOST_CONTOURS = 1000  # of a path, and of a drawing
_LONG_NUMBER = re.compile(r"\d{100}")  # the library takes the square of its length to read it
_FEW = 64  # points and edges of a contour that show whether it lies within another one
_TOUCH = 1e-5  # share of a contour's size: places nearer to it lie on it
_LINES, _WIDE = 32, 2e-3  # across a shape; share of its size that is seen
_MOST_PIECES = 500  # pieces of one curved segment


def read_attribute(
    element: ElementTree.Element, values: Mapping[str, str], key: str, usual: str = ""
) -> str:
    """Return what a style or an attribute states for a length, as text; `usual` if neither does.

    values: the element's styles. key: name of the property, such as "width".
    """
    styled = values.get(key, "auto")
    return styled if styled != "auto" else element.get(key) or usual


def find_area_edges(curves: Sequence[Curve]) -> list[bool]:
    """Return for each contour whether it bounds the filled area, by SVG's rule `nonzero`.

    Where contours cross, all of them count as bounds: the even-odd rule paints them.
    """
    if not all((np.abs(curve.points) <= LARGEST).all() for curve in curves):
        return [True] * len(curves)  # refused later, by name
    areas, around = [], [0] * len(curves)  # how often the area around a contour is within others
    for curve in curves:
        x, y = (curve.points - curve.points[0]).T
        areas.append(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    signs = np.sign(areas).astype(int).tolist()
    low = np.stack([curve.points.min(axis=0) for curve in curves])
    high = np.stack([curve.points.max(axis=0) for curve in curves])
    is_box_inside = (low[:, None] >= low).all(axis=2) & (high[:, None] <= high).all(axis=2)
    for inner, outer in np.argwhere(is_box_inside).tolist():
        # Of two that lie on each other, the first is the outer one.
        if (-abs(areas[outer]), outer) >= (-abs(areas[inner]), inner):
            continue
        is_inside = _are_inside(curves[inner].points, curves[outer].points)
        if is_inside.any() and not is_inside.all():
            return [True] * len(curves)
        around[inner] += signs[outer] * bool(is_inside.all())
    return [0 in (outside, outside + sign) for outside, sign in zip(around, signs, strict=True)]


def _are_inside(points: Points, around: Points) -> Mask:
    """Return whether points along a contour (n, 2) lie inside another one (m, 2), as a mask (k,).

    The points are some vertices and middles of edges. Those that lie on the other contour are left
    out.
    """
    every = max(1, len(points) // _FEW)
    middles = (points + np.roll(points, -1, axis=0)) / 2
    places = np.concatenate([points[::every], middles[::every]])
    low, size = around.min(axis=0), np.ptp(around, axis=0).max() or 1.0
    ring = ((around - low) / size).astype(np.float32)
    sides = [cv2.pointPolygonTest(ring, place, True) for place in ((places - low) / size).tolist()]
    return np.array([side > 0 for side in sides if abs(side) > _TOUCH], bool)


def is_painted_otherwise(curves: Sequence[Curve]) -> bool:
    """Return whether the rule `nonzero` paints areas of contours that the even-odd rule leaves out.

    That is so where contours of one direction overlap, or a contour overlaps itself. Areas between
    horizontal sample lines, and very narrow ones, are missed.
    """
    start = np.concatenate([curve.points for curve in curves])
    end = np.concatenate([np.roll(curve.points, -1, axis=0) for curve in curves])
    low, size = start.min(axis=0), np.ptp(start, axis=0)
    for y in low[1] + (np.arange(_LINES) + 0.5) / _LINES * size[1]:
        rises = (start[:, 1] <= y) & (end[:, 1] > y)
        falls = (start[:, 1] > y) & (end[:, 1] <= y)
        meets = rises | falls
        (x0, y0), (x1, y1) = start[meets].T, end[meets].T
        x = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        order = np.argsort(x, kind="stable")
        winding = np.cumsum(rises[meets][order].astype(int) - falls[meets][order])[:-1]
        is_left_out = (winding != 0) & (winding % 2 == 0)
        if (np.diff(x[order])[is_left_out] > _WIDE * size.max()).any():
            return True
    return False


def read_shape(
    element: ElementTree.Element, values: Mapping[str, str], size: tuple[float, float]
) -> Any:
    """Return a shape as svgelements has it, in its own coordinates; None if nothing is drawn.

    values: of its properties; size: of the viewport.
    """
    tag = local_name(element)
    diagonal = float(np.hypot(*size) / np.sqrt(2))

    def length(key: str, usual: str = "0") -> float:
        """Return an attribute that is a length along x, along y, or neither (r)."""
        along = {"x": size[0], "w": size[0], "y": size[1], "h": size[1]}
        which = key[1] if key[0] in "cr" and len(key) > 1 else key[0]
        return read_length(
            key, read_attribute(element, values, key, usual), along.get(which, diagonal)
        )

    def radius(key: str, other: str) -> float | None:
        """Return the radius of a rounded corner; None if none is stated."""
        known = {
            name for name in (key, other) if read_attribute(element, values, name, "auto") != "auto"
        }
        return length(key if key in known else other) if known else None

    if tag == "path":
        text = _read_path_data(element, values)
        for letters in ("Mm", "Zz"):  # the library looks through all of a path at each
            if (count := sum(map(text.count, letters))) > MOST_CONTOURS:
                raise UnreadableValueError(f"d: {count} contours, more than {MOST_CONTOURS}")
        return svg.Path(text)
    if tag in ("polyline", "polygon"):
        if _LONG_NUMBER.search(text := element.get("points", "")):
            raise UnreadableValueError(f"points: {text[:100]}")
        return (svg.Polygon if tag == "polygon" else svg.Polyline)(text)
    if tag == "line":
        return svg.SimpleLine(length("x1"), length("y1"), length("x2"), length("y2"))
    if tag == "rect":
        width, height = length("width"), length("height")
        if width <= 0 or height <= 0:
            return None
        corner = {"rx": radius("rx", "ry"), "ry": radius("ry", "rx")}
        corner = {key: value for key, value in corner.items() if value}
        return svg.Rect(length("x"), length("y"), width, height, **corner)
    rx, ry = (length("r"),) * 2 if tag == "circle" else (radius("rx", "ry"), radius("ry", "rx"))
    if not rx or not ry or rx < 0 or ry < 0:
        return None
    return svg.Ellipse(length("cx"), length("cy"), rx, ry)


def _read_path_data(element: ElementTree.Element, values: Mapping[str, str]) -> str:
    """Return the data of a path: its attribute, or what a style states as `path("…")`."""
    if (text := values.get("d")) is None:
        return element.get("d", "")
    if text == "none":
        return ""
    found = re.fullmatch(r"""path\(\s*(?:\w+\s*,\s*)?(["'])(.*)\1\s*\)""", text, re.DOTALL)
    if found is None:
        raise UnreadableValueError(f"d: {text[:100]}")
    return found[2]


def shape_polylines(shape: Any, tolerance_px: float) -> Iterator[Curve]:
    """Yield a shape's contours as polylines; tolerance_px: largest distance from the exact curve.

    A contour is closed if the shape says so, or if three points or more end where they began.
    """
    pieces: list[Points] = []
    previous: Any = None
    for segment in [*shape.segments(), svg.Move(0j)]:  # the added move ends the last contour
        _correct_smooth_control(previous, segment)
        previous = segment
        if isinstance(segment, svg.Move) and pieces:
            points = np.concatenate(pieces)
            closed = len(points) > 2 and bool((points[0] == points[-1]).all())
            yield Curve(points, closed=closed)
            pieces = []
        elif isinstance(segment, svg.Close) and pieces:
            yield Curve(np.concatenate(pieces), closed=True)
            pieces = []
        elif not isinstance(segment, svg.Move | svg.Close):
            pieces.append(_polyline(segment, tolerance_px))


def _correct_smooth_control(previous: Any, segment: Any) -> None:
    """Set the first control point of a smooth SVG segment (S or T) as the standard says.

    The point mirrors the last control point of the previous segment if both are of the same kind;
    else it is the segment's start. svgelements mirrors in both cases.
    """
    if not getattr(segment, "smooth", False):
        return
    alike = type(previous) is type(segment)
    if isinstance(segment, svg.CubicBezier):
        segment.control1 = 2 * segment.start - previous.control2 if alike else segment.start
    elif isinstance(segment, svg.QuadraticBezier):
        segment.control = 2 * segment.start - previous.control if alike else segment.start


def _polyline(segment: Any, tolerance_px: float) -> Points:
    """Return points (n, 2) px along a segment of an SVG path, both ends exact.

    tolerance_px: largest distance of the polyline from the curve.
    """
    if isinstance(segment, svg.Arc):
        return _arc_polyline(segment, tolerance_px)
    control = [segment.start, segment.end]
    if isinstance(segment, svg.CubicBezier):
        control[1:1] = [segment.control1, segment.control2]
    elif isinstance(segment, svg.QuadraticBezier):
        control[1:1] = [segment.control]
    nodes = _to_points(*control)
    degree = len(nodes) - 1
    if degree == 1:
        return nodes
    # A chord of a curve b(t) over a step h is at most h² max|b″| / 8 from it. Of a Bézier curve,
    # b″ is at most degree · (degree − 1) times the largest second difference of its nodes.
    second = degree * (degree - 1) * np.abs(np.diff(nodes, 2, axis=0)).sum(axis=1).max()
    t = np.linspace(0, 1, _piece_count(np.sqrt(second / (8 * tolerance_px))) + 1)[:, None]
    points_by_t: list[Points] = list(nodes)
    while len(points_by_t) > 1:  # de Casteljau's algorithm, for all t at once
        points_by_t = [(1 - t) * a + t * b for a, b in pairwise(points_by_t)]
    return points_by_t[0]


def _arc_polyline(arc: Any, tolerance_px: float) -> Points:
    """Return points (n, 2) px along an elliptical arc, both ends exact.

    tolerance_px: largest distance of the polyline from the arc.
    """
    radius, sweep = max(arc.rx, arc.ry), abs(float(arc.sweep))
    # In a circle of radius r, a chord over the angle 2 arccos(1 − d / r) is d away from its arc.
    chord_angle = 2 * np.arccos(np.clip(1 - tolerance_px / max(radius, tolerance_px), -1, 1))
    shares = np.linspace(0, 1, _piece_count(sweep / chord_angle) + 1)
    points = np.asarray(arc.npoint(shares), np.float64)
    points[[0, -1]] = _to_points(arc.start, arc.end)
    return points


def _piece_count(count: float) -> int:
    """Round a number of pieces up to a whole number from 1 to `_MOST_PIECES`.

    Infinity and NaN become 1.
    """
    return int(np.ceil(np.clip(count, 1, _MOST_PIECES))) if np.isfinite(count) else 1


def _to_points(*points: Any) -> Points:
    """Convert svgelements points to an array (n, 2) of x and y."""
    return np.array([[p.x, p.y] for p in points], np.float64)
