"""Read SVG drawings: every path command, basic shapes, transforms, groups, `use`, viewBox, styles.

svgelements reads the geometry. Curved pieces become polylines that stay within FLATNESS of them. A
path of several contours gives a layer for each: `d`, `d#2`, `d#3` …; no XML id contains "#".

A file may come from anybody, so it is read only if it is small, shallow and needs no other file.
Nothing is ever fetched. An entity may stand for a million others and a `use` for a million shapes:
entities are refused, and the shapes of `use` are counted before they are drawn.
"""

import io
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
import svgelements as svg

from finloop.base.arrays import Points
from finloop.base.drawing import Curve, Drawing, clean_curve
from finloop.base.errors import FinloopError
from finloop.base.paint import PART

FLATNESS = 1e-4  # share of the larger side of the drawing
MOST_CONTOURS = 1000
MOST_BYTES = 4 * 2**20
MOST_DRAWN = 2**19
"""Characters of geometry, counted each time a `use` shows it; so many take five seconds to read."""

MOST_NESTED = 64
MOST_STYLE = 2**16  # characters of style sheets; each is compared with every element

_ELEMENT = 100  # characters that an element counts for beside its geometry
_GEOMETRY = ("d", "points", "transform")
_SVG = "{http://www.w3.org/2000/svg}"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
# Nothing of these is a contour of its own.
_NO_CONTOURS = {
    *("image", "text", "script", "foreignObject", "metadata", "animate", "filter"),
    *("marker", "mask", "clipPath", "pattern", "linearGradient", "radialGradient"),
}
_MOST_PIECES = 500  # pieces of one curved segment
# What svgelements raises where it does not understand a drawing.
_MISREAD = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError
_GRADIENT = "#808080"  # stands for gradients and patterns


class _Contour(NamedTuple):
    """A contour that a drawing shows."""

    name: str
    name_is_id: bool  # whether the name is its XML id, which must not change
    curve: Curve
    style: str  # SVG style text; "" if nothing paints it


def load_svg(path: Path) -> Drawing:
    """Load the contours of an SVG file as polylines by id, in drawing order, in px of its viewport.

    A contour without an id takes that of the nearest group or `use` around it, else "contour"; if
    several would share such a name, they are numbered: `eye`, `eye-2`. FinloopError if the file is
    no SVG that may be read, has no contour, an invalid one (see `clean_curve`), or two with one id.
    """
    tree = _load_safe_tree(path)
    try:
        source = io.BytesIO(ElementTree.tostring(tree))
        picture = svg.SVG.parse(source, reify=True, on_error="raise")
        contours = list(_shown_contours(picture)) if isinstance(picture, svg.SVG) else []
    except _MISREAD as error:
        raise FinloopError(
            f"{path} cannot be understood ({error!r})",
            "an SVG whose paths and transforms follow the standard",
            "open it in a drawing program and save it as plain SVG",
        ) from error
    if not contours:
        raise FinloopError(
            f"{path} has no contour",
            "at least one path or shape that is shown; text and pictures do not count",
            "turn text into paths, and show hidden layers",
        )
    if len(contours) > MOST_CONTOURS:
        raise FinloopError(
            f"{path} has {len(contours)} contours",
            f"at most {MOST_CONTOURS}",
            "save only the contours to be morphed",
        )
    by_name = dict(zip(_unique_names(path, contours), contours, strict=True))
    curves = {name: clean_curve(contour.curve, name) for name, contour in by_name.items()}
    styles = {name: contour.style for name, contour in by_name.items() if contour.style}
    width, height = picture.width, picture.height
    if not {"viewBox", "width", "height"} & tree.attrib.keys():  # the file states no size
        corner = np.maximum.reduce([curve.points.max(axis=0) for curve in curves.values()])
        width, height = np.maximum(corner, 1)
    return Drawing(curves, float(width), float(height), styles)


# --- names


def _unique_names(path: Path, contours: list[_Contour]) -> list[str]:
    """Return a unique name for each contour; names that are XML ids do not change.

    Of other names, the second and later ones get a number: eye, eye-2. path: of the file, for
    messages. FinloopError if two contours have one id.
    """
    ids = Counter(contour.name for contour in contours if contour.name_is_id)
    if repeated := [name for name, count in ids.items() if count > 1]:
        raise FinloopError(
            f"{path} uses the id {repeated[0]!r} {ids[repeated[0]]} times",
            "an id of its own for every contour",
            "rename them: ids define which contours of two drawings belong together",
        )
    unique_names, used = [], set(ids)
    for contour in contours:
        number, unique = 1, contour.name
        while not contour.name_is_id and unique in used:
            number += 1
            unique = f"{contour.name}-{number}"
        used.add(unique)
        unique_names.append(unique)
    return unique_names


def _named_shapes(group: Any, default_name: str) -> Iterator[tuple[str, bool, Any]]:
    """Yield (name, whether the name is its own XML id, shape) for every shape in an SVG group.

    default_name: given to shapes that neither have an id nor lie in a group with one.
    """
    for child in group:
        child_id = child.id or ""
        # A `use` shows shapes whose ids stand elsewhere in the file: those are not its own.
        if isinstance(child, svg.Use):
            for name, _, shape in _named_shapes(child, child_id or default_name):
                yield child_id or name, False, shape
        elif isinstance(child, svg.Shape):
            yield child_id or default_name, bool(child_id), child
        elif isinstance(child, list):  # a group
            yield from _named_shapes(child, child_id or default_name)


# --- contours


def _shown_contours(picture: Any) -> Iterator[_Contour]:
    """Yield every contour that a drawing shows; picture: the drawing as svgelements reads it.

    A shape that has no id of its own takes that of what is around it. The second and later contours
    of a shape `d`, such as the hole of a letter, are named `d#2`, `d#3` ….
    """
    tolerance_px = FLATNESS * max(float(picture.width), float(picture.height))
    for name, name_is_id, shape in _named_shapes(picture, "contour"):
        if shape.values.get("visibility") in ("hidden", "collapse"):
            continue
        style = _paint_style(shape)
        for number, curve in enumerate(_shape_contours(shape, tolerance_px), 1):
            contour_name = f"{name}{PART}{number}" if number > 1 else name
            yield _Contour(contour_name, name_is_id, curve, style)


def _shape_contours(shape: Any, tolerance_px: float) -> Iterator[Curve]:
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


# --- styles


def _paint_style(shape: Any) -> str:
    """Return the SVG style that paints a shape (fill, stroke, width, opacity); "" if none."""
    shape_opacity = _parse_opacity(shape.values.get("opacity"))
    colours = {"fill": shape.fill, "stroke": shape.stroke}
    style = {key: _css_colour(colour, shape.values.get(key)) for key, colour in colours.items()}
    if set(style.values()) == {"none"}:
        return ""
    for key, colour in colours.items():
        if style[key] != "none" and (opacity := shape_opacity * float(colour.opacity)) < 1:
            style[f"{key}-opacity"] = f"{opacity:.4g}"
    if style["stroke"] != "none":
        style["stroke-width"] = f"{shape.implicit_stroke_width:.6g}"
    return ";".join(f"{key}:{value}" for key, value in style.items())


def _css_colour(colour: Any, text: object) -> str:
    """Return a colour as #rrggbb, or "none"; for a gradient or pattern, a grey.

    text: the colour as the file writes it; svgelements drops gradients.
    """
    if str(text).startswith("url("):
        return _GRADIENT
    if colour is None or colour.value is None:
        return "none"
    return f"#{colour.red:02x}{colour.green:02x}{colour.blue:02x}"


def _parse_opacity(text: str | None) -> float:
    """Return the opacity, 0 … 1, that a text states; 1 if it states none."""
    try:
        return min(max(float(text or 1), 0), 1)
    except ValueError:
        return 1.0


# --- what may be read


def _load_safe_tree(path: Path) -> ElementTree.Element:
    """Load an SVG file's XML tree without elements that draw no contour, such as text and pictures.

    FinloopError if the file is missing, huge, no SVG, declares entities, points to another file for
    a shape, or would draw more than MOST_DRAWN characters of geometry.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FinloopError(
            f"{path} cannot be read ({error.strerror})", "an SVG drawing", "name a file that exists"
        ) from error
    if len(data) > MOST_BYTES:
        raise FinloopError(
            f"{path} has more than {MOST_BYTES / 2**20:g} MiB",
            "a drawing of a few contours",
            "save only the contours, without pictures, and simplify traced paths",
        )
    _refuse_entities(path, data)
    root = ElementTree.fromstring(data)
    if _tag(root) != "svg":
        raise FinloopError(
            f"{path} holds <{_tag(root)}>, no SVG", "an SVG drawing", "save the drawing as SVG"
        )
    _keep_contours(root)
    styles = [element.text or "" for element in root.iter() if _tag(element) == "style"]
    if (characters := sum(map(len, styles))) > MOST_STYLE:
        raise FinloopError(
            f"{path} has style sheets of {characters / 1024:.0f} KiB",
            f"at most {MOST_STYLE // 1024} KiB",
            "save it without embedded fonts, or with styles as attributes",
        )
    _refuse_large(path, root)
    return root


def _refuse_entities(path: Path, data: bytes) -> None:
    """Raise FinloopError if the bytes of a file are not XML, or declare XML entities."""
    parser = expat.ParserCreate()

    def refuse_entity(name: str, *rest: object) -> NoReturn:
        """Raise FinloopError for a declared entity."""
        raise FinloopError(
            f"{path} declares the entity {name!r}, which may stand for any amount of text",
            "an SVG without entities",
            "save it as plain SVG: the drawing program then writes entities out",
        )

    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        empty = "it is empty" if not data.strip() else str(error)
        raise FinloopError(
            f"{path} is no XML ({empty})", "an SVG drawing", "save the drawing again as plain SVG"
        ) from error


def _tag(element: ElementTree.Element) -> str:
    """Return the name of an XML element without the SVG namespace."""
    return element.tag.removeprefix(_SVG)


def _keep_contours(root: ElementTree.Element) -> None:
    """Remove elements that draw no contour; move symbols, which only a `use` shows, to `defs`.

    root: the tree, which is changed.
    """
    hidden = ElementTree.Element(f"{_SVG}defs")
    for parent in list(root.iter()):
        for child in list(parent):
            if _tag(child) in _NO_CONTOURS:
                parent.remove(child)
            elif _tag(child) == "symbol":
                child.tag = f"{_SVG}{'svg' if 'viewBox' in child.attrib else 'g'}"
                parent.remove(child)
                hidden.append(child)
    root.append(hidden)


def _use_target(path: Path, element: ElementTree.Element) -> str | None:
    """Return the id of the shape that an XML element shows; None unless it is a `use` with one.

    path: of the SVG, for messages. FinloopError if the shape is in another file.
    """
    if _tag(element) != "use":
        return None
    for name in _HREFS:
        if reference := element.get(name, "").strip():
            if reference.startswith("#"):
                return reference[1:]
            raise FinloopError(
                f"{path} shows a shape of another file: {reference[:100]!r}, which is not fetched",
                "an SVG that holds all its shapes",
                "copy the shape into the drawing",
            )
    return None


def _refuse_large(path: Path, root: ElementTree.Element) -> None:
    """Raise FinloopError if a drawing has too much geometry, is too deep, or contains itself."""
    by_id = {element.get("id"): element for element in root.iter()}
    sizes = dict[int, int]()  # of the measured elements, by `id` of the Python object
    unfinished = set[int]()  # elements within which another is being measured now

    def measure_element(element: ElementTree.Element, depth: int) -> int:
        """Return how much geometry [characters] an element draws, with all its parts.

        A part is a child, or the shape that a `use` shows. depth: of the element below the root.
        """
        key = id(element)
        if key in sizes:
            return sizes[key]
        if key in unfinished:
            raise FinloopError(
                f"{path} holds a <use> that shows itself",
                "shapes that do not contain themselves",
                f"remove the <use> of {_use_target(path, element) or element.get('id')!r}",
            )
        unfinished.add(key)
        used = by_id.get(_use_target(path, element) or "")
        parts = [*element, *([] if used is None else [used])]
        size = _ELEMENT + sum(len(element.get(name, "")) for name in _GEOMETRY)
        if depth <= MOST_NESTED:
            size += sum(measure_element(part, depth + 1) for part in parts)
        if depth > MOST_NESTED or size > MOST_DRAWN:
            raise FinloopError(
                f"{path} draws more than {MOST_DRAWN // 1024} KiB of paths, or"
                f" {MOST_DRAWN // _ELEMENT} shapes, or nests more than {MOST_NESTED} deep",
                "a drawing of a few contours",
                "save only the contours to be morphed, and simplify traced paths",
            )
        unfinished.discard(key)
        sizes[key] = size
        return size

    measure_element(root, 0)
