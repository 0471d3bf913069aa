"""Read SVG drawings: every path command, basic shapes, transforms, groups, `use`, viewBox, styles.

svgelements reads the geometry and applies style sheets; gradients are read here. Curved pieces
become polylines that stay within FLATNESS of them. A path of several contours gives a layer for
each: `d`, `d#2`, `d#3` …; no XML id contains "#".

A file may come from anybody, so it is read only if it is small, shallow and needs no other file.
Nothing is ever fetched. An entity may stand for a million others and a `use` for a million shapes:
entities are refused, and the shapes of `use` are counted before they are drawn. What would change
the picture and is no contour, such as a clip path, is refused by name.
"""

import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn, cast
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
import svgelements as svg

from finloop.base.arrays import Points
from finloop.base.drawing import LARGEST, Curve, Drawing, clean_curve
from finloop.base.errors import FinloopError
from finloop.base.paint import PART
from finloop.base.style import Colour, Fill, Gradient, Paint, Stop

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
    *("image", "script", "foreignObject", "metadata", "animate", "filter"),
    *("marker", "mask", "clipPath"),
}
_GRADIENTS = ("linearGradient", "radialGradient")
# What changes how a shape looks and is no contour, by attribute: its name, and what to do.
_REFUSED = {
    "clip-path": ("a clip path", "release clip paths, or cut the shapes with them"),
    "mask": ("a mask", "release masks, or cut the shapes with them"),
    "filter": ("a filter", "remove filters, such as blur and shadow"),
    "pattern": ("a pattern", "fill with colours or gradients in place of patterns"),
    "marker": ("a marker", "turn markers, such as arrow heads, into paths"),
    "text": ("text", "turn text into paths"),
}
_RECT = ("x", "y", "width", "height")
_NO_IDLE_CLIP = {"transform", "clipPathUnits", "rx", "ry"}
_MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")
_PPI = 96  # px in an inch
_MOST_PIECES = 500  # pieces of one curved segment
_MOST_PARTS = 64  # stops of a gradient, and lengths of a dashed line
_NEAREST_FOCUS = 0.99  # radii from the centre of a gradient to its focus
# What svgelements raises where it does not understand a drawing.
_MISREAD = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError


class _Shown(NamedTuple):
    """A shape that a drawing shows, and what the groups around it say of it."""

    name: str
    name_is_id: bool  # whether the name is its XML id, which must not change
    shape: Any  # as svgelements reads it
    groups: tuple[str, ...]  # ids of the groups around it, the nearest first
    opacity: float  # of it and all groups around it, 0 … 1
    refused: frozenset[str]  # keys of `_REFUSED`


class _Contour(NamedTuple):
    """A contour that a drawing shows."""

    name: str
    name_is_id: bool  # whether the name is its XML id, which must not change
    curve: Curve
    groups: tuple[str, ...]  # ids of the groups around it, the nearest first
    paint: Paint | None  # None if nothing paints it


@dataclass(frozen=True)
class _Servers:
    """What fills may refer to: elements by id, such as gradients; and how styles apply to stops."""

    elements: Mapping[str, ElementTree.Element]
    values: Mapping[str, Any]  # of stops, after style sheets, by id
    size: tuple[float, float]  # width and height of the picture, in units of its viewBox


def load_svg(path: Path) -> Drawing:
    """Load the contours of an SVG file as polylines by id, in drawing order, in px of its viewport.

    A contour without an id takes that of the nearest group or `use` around it, else "contour"; if
    several would share such a name, they are numbered: `eye`, `eye-2`. FinloopError if the file is
    no SVG that may be read, has no contour, an invalid one (see `clean_curve`), two with one id, or
    shows anything of `_REFUSED`.
    """
    tree = _load_safe_tree(path)
    try:
        source = io.BytesIO(ElementTree.tostring(tree))
        picture = svg.SVG.parse(source, reify=False, on_error="raise")
        if not isinstance(picture, svg.SVG):
            picture = svg.SVG()
        shown = list(_shown_shapes(picture))
        _refuse_parts(path, tree, shown)
        contours = list(_shown_contours(picture, shown, _find_servers(tree, picture)))
    except _MISREAD as error:
        raise FinloopError(
            f"{path} cannot be understood ({error!r})",
            "an SVG whose paths and transforms follow the standard",
            "open it in a drawing program and save it as plain SVG",
        ) from error
    if not contours:
        raise FinloopError(
            f"{path} has no contour",
            "at least one path or shape that is shown; pictures do not count",
            "trace pictures, and show hidden layers",
        )
    if len(contours) > MOST_CONTOURS:
        raise FinloopError(
            f"{path} has {len(contours)} contours",
            f"at most {MOST_CONTOURS}",
            "save only the contours to be morphed",
        )
    by_name = dict(zip(_unique_names(path, contours), contours, strict=True))
    curves = {name: clean_curve(contour.curve, name) for name, contour in by_name.items()}
    styles = {name: contour.paint for name, contour in by_name.items() if contour.paint}
    groups = {name: contour.groups for name, contour in by_name.items() if contour.groups}
    width, height = picture.width, picture.height
    if not {"viewBox", "width", "height"} & tree.attrib.keys():  # the file states no size
        corner = np.maximum.reduce([curve.points.max(axis=0) for curve in curves.values()])
        width, height = np.maximum(corner, 1)
    if not (0 < width <= LARGEST and 0 < height <= LARGEST):
        raise FinloopError(
            f"{path} is a picture of {width:g} × {height:g}",
            "a width and a height above 0",
            "correct its viewBox, or width and height",
        )
    return Drawing(curves, float(width), float(height), styles, groups)


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


def _shown_shapes(picture: Any) -> Iterator[_Shown]:
    """Yield every shape that a drawing shows; picture: the drawing as svgelements reads it.

    A shape without an id of its own takes that of what is around it, else "contour".
    """
    top = _Shown("contour", False, picture, (), 1.0, frozenset())
    for shown in _shapes_within(top):
        if shown.shape.values.get("visibility") not in ("hidden", "collapse"):
            yield shown


def _shapes_within(group: _Shown) -> Iterator[_Shown]:
    """Yield every shape in a group; group: as if it were a shape."""
    for child in group.shape:
        stated = child.values.get("attributes", {})  # without what groups around it state
        child_id = _decode_id(child.id or "")
        shown = _Shown(
            child_id or group.name,
            bool(child_id),
            child,
            group.groups,
            group.opacity * _parse_opacity(stated.get("opacity")),
            group.refused | {key for key in _REFUSED if stated.get(key, "none") != "none"},
        )
        within = shown._replace(groups=(child_id, *group.groups) if child_id else group.groups)
        # A `use` shows shapes whose ids stand elsewhere in the file: those are not its own.
        if isinstance(child, svg.Use):
            for part in _shapes_within(within):
                yield part._replace(name=child_id or part.name, name_is_id=False)
        elif isinstance(child, svg.Shape) or "text" in shown.refused:
            yield shown
        elif isinstance(child, list):  # a group
            yield from _shapes_within(within)


def _decode_id(text: str) -> str:
    """Return an id as it was typed: Illustrator writes `fore_left` as `fore_x5F_left`."""
    return re.sub(r"_x([0-9A-F]{2,4})_", lambda code: chr(int(code[1], 16)), text)


def _refuse_parts(path: Path, tree: ElementTree.Element, shown: list[_Shown]) -> None:
    """Raise FinloopError, with all problems, if shapes look different from their contours.

    path: of the file, for messages; tree: of the file; shown: its shapes.
    """
    patterns = {element.get("id", "") for element in tree.iter() if _tag(element) == "pattern"}
    names_by_kind = dict[str, list[str]]()
    for name, _, shape, _, _, refused in shown:
        kinds = set(refused)
        if any(shape.values.get(marker, "none") != "none" for marker in _MARKERS):
            kinds.add("marker")
        if any(_fill_target(shape.values.get(key)) in patterns for key in ("fill", "stroke")):
            kinds.add("pattern")
        for kind in kinds:
            names_by_kind.setdefault(kind, []).append(name)
    if names_by_kind:
        said, advice = [], []
        for kind, (what, do) in _REFUSED.items():
            if names := list(dict.fromkeys(names_by_kind.get(kind, []))):
                few = ", ".join(map(repr, names[:3])) + (" …" if len(names) > 3 else "")
                said.append(f"{what} ({few})")
                advice.append(do)
        raise FinloopError(
            f"{path} shows {', '.join(said)}",
            "paths and shapes with colours, gradients, lines and dashes",
            "; ".join(advice),
        )


# --- contours


def _shown_contours(picture: Any, shown: list[_Shown], servers: _Servers) -> Iterator[_Contour]:
    """Yield every contour that a drawing shows; picture: the drawing as svgelements reads it.

    The second and later contours of a shape `d`, such as the hole of a letter, are named `d#2`,
    `d#3` …. shown: the shapes of the drawing.
    """
    tolerance_px = FLATNESS * max(float(picture.width), float(picture.height))
    for name, name_is_id, shape, groups, opacity, _ in shown:
        paint = _read_paint(shape, opacity, servers)  # before the shape changes its coordinates
        shape.reify()
        for number, curve in enumerate(_shape_contours(shape, tolerance_px), 1):
            contour_name = f"{name}{PART}{number}" if number > 1 else name
            yield _Contour(contour_name, name_is_id, curve, groups, paint)


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


def _read_paint(shape: Any, opacity: float, servers: _Servers) -> Paint | None:
    """Return how a shape is painted, in px of the viewport; None if nothing paints it.

    shape: before `reify`. opacity: of it and the groups around it, 0 … 1.
    """
    fill, fill_opacity = _read_fill(shape, "fill", shape.fill, servers)
    stroke, stroke_opacity = _read_fill(shape, "stroke", shape.stroke, servers)
    if fill is None and stroke is None:
        return None
    width = float(shape.implicit_stroke_width)
    dashes = _read_dashes(shape, width, servers.size) if stroke is not None else ()
    return Paint(fill, stroke, opacity * fill_opacity, opacity * stroke_opacity, width, *dashes)


def _read_fill(shape: Any, key: str, colour: Any, servers: _Servers) -> tuple[Fill, float]:
    """Return a shape's fill or stroke and its opacity; key: "fill" or "stroke".

    colour: as svgelements reads it, which does not know gradients.
    """
    text = str(shape.values.get(key))
    stated = _parse_opacity(shape.values.get(f"{key}-opacity"))
    if target := _fill_target(text):
        if target in servers.elements:
            return _read_gradient(target, shape, servers), stated
        text = text.partition(")")[2].strip()  # the colour in place of what is missing
        colour = svg.Color(text) if text else None
    if colour is None or colour.value is None:
        return None, 1.0
    return (colour.red, colour.green, colour.blue), float(colour.opacity)


def _fill_target(text: object) -> str | None:
    """Return the id that a fill or stroke refers to: of `url(#id)`; None if it is a colour."""
    found = re.match(r"""url\(\s*["']?#(.+?)["']?\s*\)""", str(text))
    return found[1] if found else None


def _find_servers(tree: ElementTree.Element, picture: Any) -> _Servers:
    """Return the gradients of a drawing; picture: the drawing as svgelements reads it."""
    elements = {
        element.attrib["id"]: element
        for element in tree.iter()
        if _tag(element) in _GRADIENTS and "id" in element.attrib
    }
    box = picture.viewbox
    size = (picture.width, picture.height) if box is None else (box.width, box.height)
    return _Servers(elements, picture.objects, (float(size[0]), float(size[1])))


def _read_gradient(name: str, shape: Any, servers: _Servers) -> Gradient | None:
    """Return the gradient with an id as it fills a shape; None if it paints nothing.

    It has the attributes and stops of the gradient that it refers to, where it states none.
    """
    chain, reference = list[ElementTree.Element](), name
    while (element := servers.elements.get(reference)) is not None and element not in chain:
        chain.append(element)
        reference = _href(element)[1:]
    stated = dict[str, str]()
    for element in chain[::-1]:
        stated |= element.attrib
    stops = next((stops for element in chain if (stops := _read_stops(element, servers))), ())
    in_box = stated.get("gradientUnits") != "userSpaceOnUse"
    to_drawing = svg.Matrix(shape.transform)
    if in_box:  # lengths are shares of the shape's box
        left, top, right, bottom = shape.bbox(transformed=False)
        if left == right or top == bottom:
            return None
        to_drawing = svg.Matrix(right - left, 0, 0, bottom - top, left, top) * to_drawing
    to_drawing = svg.Matrix(stated.get("gradientTransform", "")) * to_drawing
    width, height = (1.0, 1.0) if in_box else servers.size

    def coordinate(key: str, usual: str) -> float:
        """Return an attribute that is a length along x, along y, or neither (r)."""
        text = stated.get(key, usual).strip()
        diagonal = float(np.hypot(width, height) / np.sqrt(2))
        whole = {"x": width, "y": height}.get(key.strip("cf12"), diagonal)
        return _parse_length(text, whole)

    kind: Literal["linear", "radial"] = "linear"
    focus = 0.0, 0.0
    if _tag(chain[0]) == "linearGradient":
        x1, y1 = coordinate("x1", "0%"), coordinate("y1", "0%")
        x2, y2 = coordinate("x2", "100%"), coordinate("y2", "0%")
        own = svg.Matrix(x2 - x1, y2 - y1, y1 - y2, x2 - x1, x1, y1)
    else:
        kind = "radial"
        cx, cy, r = (coordinate(key, "50%") for key in ("cx", "cy", "r"))
        off = np.array([coordinate("fx", str(cx)) - cx, coordinate("fy", str(cy)) - cy]) / (r or 1)
        off *= min(1, _NEAREST_FOCUS / max(float(np.hypot(*off)), 1e-9))
        focus = float(off[0]), float(off[1])
        own = svg.Matrix(r, 0, 0, r, cx, cy)
    m = own * to_drawing
    spread: Literal["pad", "reflect", "repeat"] = "pad"
    if (stated_spread := stated.get("spreadMethod")) in ("reflect", "repeat"):
        spread = cast('Literal["reflect", "repeat"]', stated_spread)
    return Gradient(kind, stops, (m.a, m.b, m.c, m.d, m.e, m.f), focus, spread) if stops else None


def _read_stops(gradient: ElementTree.Element, servers: _Servers) -> tuple[Stop, ...]:
    """Return the stops of a gradient; FinloopError if there are too many."""
    stops = list[Stop]()
    for element in gradient:
        if _tag(element) != "stop":
            continue
        values = servers.values[element.attrib["id"]].values
        colour = svg.Color(values.get("stop-color", "black"))
        opacity = _parse_opacity(values.get("stop-opacity")) * float(colour.opacity)
        offset = min(max(_parse_length(values.get("offset", "0"), 1.0), 0.0), 1.0)
        offset = max(offset, stops[-1].offset) if stops else offset
        rgb: Colour = (colour.red, colour.green, colour.blue)
        stops.append(Stop(offset, rgb, opacity))
    _refuse_many("a gradient", len(stops), "stops")
    return tuple(stops)


def _read_dashes(
    shape: Any, width: float, size: tuple[float, float]
) -> tuple[tuple[float, ...], float, bool]:
    """Return a shape's dashes and gaps, their offset, and whether their ends are round.

    width: of its stroke, in px of the viewport; size: of the picture, for lengths in per cent.
    Square ends make dashes longer by the width, and gaps shorter.
    """
    texts = re.split(r"[\s,]+", str(shape.values.get("stroke-dasharray", "")).strip())
    if texts in ([""], ["none"]):
        return (), 0.0, False
    _refuse_many("a dashed line", len(texts), "lengths")
    diagonal = float(np.hypot(*size) / np.sqrt(2))
    # px of the viewport in a unit of the shape
    scale = width / shape.stroke_width if shape.stroke_width else 1.0
    lengths = [scale * _parse_length(text, diagonal) for text in texts]
    offset = scale * _parse_length(str(shape.values.get("stroke-dashoffset", "0")), diagonal)
    lengths = lengths * 2 if len(lengths) % 2 else lengths
    ends = shape.values.get("stroke-linecap", "butt")
    if ends == "square":
        gaps = [min(width, gap) for gap in lengths[1::2]]
        lengths[::2] = [dash + gap for dash, gap in zip(lengths[::2], gaps, strict=True)]
        lengths[1::2] = [gap - less for gap, less in zip(lengths[1::2], gaps, strict=True)]
        offset += width / 2
    if min(lengths) < 0 or not any(lengths[1::2]):
        return (), 0.0, False  # as SVG says of negative lengths
    return tuple(lengths), offset, ends == "round"


def _refuse_many(what: str, count: int, parts: str) -> None:
    """Raise FinloopError if something has more than _MOST_PARTS parts."""
    if count > _MOST_PARTS:
        raise FinloopError(f"{what} of {count} {parts}", f"at most {_MOST_PARTS}", "simplify it")


def _parse_length(text: str, whole: float) -> float:
    """Return a length in px; whole: what 100 % is."""
    return float(svg.Length(text).value(ppi=_PPI, relative_length=whole))


def _parse_opacity(text: str | None) -> float:
    """Return the opacity, 0 … 1, that a text states; 1 if it states none."""
    with suppress(ValueError):
        return min(max(_parse_length(text or "1", 1.0), 0), 1)
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
    _drop_idle_clips(root)
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
    """Change a tree, given by its root, so that svgelements draws only contours.

    Elements that draw no contour are removed, except patterns, which fills may refer to. Symbols,
    which only a `use` shows, move to `defs`, style sheets to the front. Text becomes an empty group
    with an attribute `text`. Stops of gradients get ids.
    """
    hidden = ElementTree.Element(f"{_SVG}defs")
    first = ElementTree.Element(f"{_SVG}defs")
    numbers = count()
    for parent in list(root.iter()):
        for child in list(parent):
            tag = _tag(child)
            if tag in _NO_CONTOURS:
                parent.remove(child)
            elif tag == "symbol":
                child.tag = f"{_SVG}{'svg' if 'viewBox' in child.attrib else 'g'}"
                parent.remove(child)
                hidden.append(child)
            elif tag == "style":
                parent.remove(child)
                first.append(child)
            elif tag == "pattern":
                child[:] = []
            elif tag == "text":
                words = "".join(child.itertext()).strip()
                child[:], child.tag = [], f"{_SVG}g"
                child.set("text", "shown" if words else "none")
                child.set("id", child.get("id") or words[:20] or "text")
            elif tag == "stop":
                child.set("id", f"{PART}{next(numbers)}")
    root.insert(0, first)
    root.append(hidden)


def _drop_idle_clips(root: ElementTree.Element) -> None:
    """Remove references to clip paths that are the whole picture, as Figma and Illustrator write.

    root: of the tree, which is changed.
    """
    box = root.get("viewBox") or f"0 0 {root.get('width')} {root.get('height')}"
    idle = set[str | None]()
    for clip in (element for element in root.iter() if _tag(element) == "clipPath"):
        rect = clip[0] if len(clip) == 1 and _tag(clip[0]) == "rect" else None
        if rect is None or _NO_IDLE_CLIP & (clip.attrib.keys() | rect.keys()):
            continue
        with suppress(ValueError):
            x, y, width, height = (float(rect.get(key, 0)) for key in _RECT)
            left, top, across, down = map(float, re.split(r"[\s,]+", box.strip()))
            is_covered = x <= left and y <= top
            if is_covered and x + width >= left + across and y + height >= top + down:
                idle.add(clip.get("id"))
    groups = [root]  # and those within them that no transform moves
    while groups:
        group = groups.pop()
        if "clip-path" in group.attrib and _fill_target(group.get("clip-path")) in idle:
            del group.attrib["clip-path"]
        groups += [child for child in group if "transform" not in child.attrib]


def _use_target(path: Path, element: ElementTree.Element) -> str | None:
    """Return the id of the shape that an XML element shows; None unless it is a `use` with one.

    path: of the SVG, for messages. FinloopError if the shape is in another file.
    """
    if _tag(element) != "use":
        return None
    reference = _href(element)
    if reference and not reference.startswith("#"):
        raise FinloopError(
            f"{path} shows a shape of another file: {reference[:100]!r}, which is not fetched",
            "an SVG that holds all its shapes",
            "copy the shape into the drawing",
        )
    return reference[1:] or None


def _href(element: ElementTree.Element) -> str:
    """Return what an XML element refers to, such as "#id"; "" if nothing."""
    return next((text for name in _HREFS if (text := element.get(name, "").strip())), "")


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
