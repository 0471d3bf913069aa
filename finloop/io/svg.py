"""Read SVG drawings: every path command, basic shapes, transforms, groups, `use`, viewBox, styles.

`io.svg_shapes` reads the geometry of shapes, `io.svg_style` styles; elements are followed here.
Curved pieces become polylines that stay within FLATNESS of them. A path of several contours gives
a layer for each: `d`, `d#2`, `d#3` …

`io.svg_safe` says which files are read. What would change the picture and is no contour, such as a
clip path, is refused by name, and so is a value that cannot be read. A file is read in a process of
its own, which ends where it takes too much time or memory.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast
from xml.etree import ElementTree

import numpy as np
import svgelements as svg

from finloop.base.drawing import LARGEST, Curve, Drawing, clean_curve
from finloop.base.errors import FinloopError
from finloop.base.limited_process import LimitedProcess, LimitExceededError
from finloop.base.paint import PART, layers_by_shape
from finloop.base.style import Fill, Gradient, Paint, Stop
from finloop.io.svg_safe import load_safe_tree, read_href, use_target
from finloop.io.svg_shapes import (
    MOST_CONTOURS,
    find_area_edges,
    is_painted_otherwise,
    read_attribute,
    read_shape,
    shape_polylines,
)
from finloop.io.svg_style import (
    UnreadableValueError,
    Values,
    declared_styles,
    inherit_values,
    local_name,
    read_colour,
    read_length,
    read_opacity,
)

FLATNESS = 1e-4  # share of the larger side of the drawing
MOST_S, MOST_MIB = 8, 1024  # of the processor and of memory, to read a drawing
CUT = 0.01  # share of a nested viewport that a shape may reach beyond it and count as whole
SHORT = 0.01  # share of the picture that an artboard may leave uncovered at each side

_GROUPS = ("svg", "g", "a")
_SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
_GRADIENTS = ("linearGradient", "radialGradient")


class _Refused(NamedTuple):
    """A way to change how a shape looks that is refused, and what the user can do instead."""

    what: str  # in words
    do: str
    harmless: tuple[str, ...] = ("none",)  # values that change nothing


_REFUSED = {
    "clip-path": _Refused("a clip path", "release clip paths, or cut the shapes with them"),
    "mask": _Refused("a mask", "release masks, or cut the shapes with them"),
    "filter": _Refused("a filter", "remove filters, such as blur and shadow"),
    "mix-blend-mode": _Refused("a blend mode", "set the blend mode to normal", ("normal",)),
    "paint-order": _Refused(
        "a line below its fill", "set the paint order to fill, stroke",
        ("normal", "fill", "fill stroke", "fill stroke markers", "fill markers",
         "fill markers stroke", "markers fill stroke"),
    ),
    "transform-origin": _Refused(
        "a transform about a point of its own", "apply transforms", ("0", "0 0", "0px 0px", "0% 0%")
    ),
    "transform-box": _Refused("a transform in a box of its own", "apply transforms", ("view-box",)),
    "offset-path": _Refused("a place along a path (offset-path)", "apply transforms"),
    "vector-effect": _Refused(
        "a vector effect", "set vector-effect to none", ("none", "non-scaling-stroke")
    ),
    "pattern": _Refused("a pattern", "fill with colours or gradients in place of patterns"),
    "marker": _Refused("a marker", "turn markers, such as arrow heads, into paths"),
    "text": _Refused("text", "turn text into paths"),
}  # fmt: skip
_MOVES = ("translate", "rotate", "scale", "transform")  # in the order in which CSS applies them
_MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")
_RECT = ("x", "y", "width", "height")
_NO_IDLE_CLIP = {"transform", "clipPathUnits", "rx", "ry"}
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_INKSCAPE_ID = re.compile(
    r"(?:layer|g|use|path|rect|circle|ellipse|line|polyline|polygon|spiral|star)[-\d]+"
)
_TRANSFORM = re.compile(
    r"[\s,]*+(?:(?:matrix|translate[XY]?|scale[XY]?|rotate|skew[XY]?)\s*+"
    r"\(\s*+(?:[-+.\d][^\s,()]*+[\s,]*+)*+\)[\s,]*+)*+"
)
_MOST_PARTS = 64  # stops of a gradient, and lengths of a dashed line
_NEAREST_FOCUS = 0.99  # radii from the centre of a gradient to its focus
# What svgelements raises where it does not understand a drawing.
_MISREAD = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError


class _Context(NamedTuple):
    """What an SVG element inherits from the elements around it: styles, transform, size."""

    name: str  # for shapes without an id
    groups: tuple[str, ...]  # ids of the groups around it, the nearest first
    values: Values  # of the properties
    matrix: Any  # svg.Matrix, to px of the picture
    size: tuple[float, float]  # of the viewport, what lengths in per cent refer to
    opacity: float = 1.0
    refused: frozenset[str] = frozenset()  # keys of `_REFUSED`
    is_used: bool = False  # whether a `use` shows it: ids are not its own then
    is_moved: bool = False  # whether a transform moves it
    # matrices from px of the picture to unit squares that cut what is shown: of nested viewports
    cuts: tuple[Any, ...] = ()


class _ShownShape(NamedTuple):
    """A shape that a drawing shows, with its name and its styles."""

    name: str
    name_is_id: bool  # whether the name is its XML id, which must not change
    group: _Context  # with its own values, matrix, opacity
    element: ElementTree.Element


@dataclass(frozen=True)
class _Document:
    """An SVG's elements with their stated properties, ids and parents."""

    path: Path
    declared: Mapping[ElementTree.Element, Values]
    by_id: Mapping[str, ElementTree.Element]  # "" for those without one
    parents: Mapping[ElementTree.Element, ElementTree.Element]
    idle_clips: frozenset[str]  # ids of clip paths that are the whole picture

    def find_paint_server(self, text: str) -> tuple[str, ElementTree.Element | None] | None:
        """Return the id in a fill `url(#id)`, and the element with this id; None for a colour.

        The element, a gradient or a pattern, is None if the file has none with this id.
        """
        target = _fill_target(text)
        return None if target is None else (target, self.by_id.get(target) if target else None)


_PARSER = LimitedProcess(MOST_S, MOST_MIB)


def load_svg(path: Path) -> Drawing:
    """Load an SVG file's contours as `parse_svg` does, in a process of its own.

    FinloopError, too, if that takes more than MOST_S of the processor, or MOST_MIB of memory.
    """
    try:
        return _PARSER.call(parse_svg, path)
    except LimitExceededError as error:
        raise FinloopError(
            f"{path} ({path.stat().st_size / 1024:.0f} KiB) takes more than {MOST_S} s of the"
            f" processor or {MOST_MIB} MiB of memory to read",
            "a drawing of a few contours",
            "simplify its paths, transforms and style sheets, and save it as plain SVG",
        ) from error


def parse_svg(path: Path) -> Drawing:
    """Load an SVG file's contours as polylines by name, in drawing order, in px of its viewport.

    The name is the id, or Inkscape's label beside an id of its own, such as `path12`. A contour
    without a name takes that of the nearest group or `use` around it, else "contour". Several that
    would share such a name, or a label, are numbered: `eye`, `eye-2`.
    FinloopError if the file is no SVG that may be read, has no contour, an invalid one (see
    `clean_curve`), two with one id, or shows anything of `_REFUSED` or a value that cannot be read.
    """
    root = load_safe_tree(path)
    problems = _Problems(path)
    try:
        document = _Document(
            path,
            declared_styles(path, root),
            {element.get("id", ""): element for element in reversed(list(root.iter()))},
            {child: parent for parent in root.iter() for child in parent},
            frozenset(_find_idle_clips(root)),
        )
        size, top = _read_root(root)
        shown, rules = list(_shown_shapes(document, root, top, problems)), dict[str, str]()
        problems.add_refused_features(document, shown)
        tolerance_px = FLATNESS * max(size)
        by_name = dict[str, tuple[Curve, Paint | None, tuple[str, ...]]]()
        for name, item in zip(_unique_names(path, shown), shown, strict=True):
            rules[name] = item.group.values.get("fill-rule", "nonzero").lower()
            with problems.collect(name):
                for number, (curve, paint) in enumerate(
                    _read_contours(document, item, tolerance_px), start=1
                ):
                    part = f"{name}{PART}{number}" if number > 1 else name
                    if part in by_name:
                        raise FinloopError(
                            f"{path} uses the name {part!r} for two contours",
                            f"ids that differ: a path's second contour has its id and {PART}2",
                            "rename one of the two paths",
                        )
                    by_name[part] = curve, paint, item.group.groups
    except _MISREAD as error:
        raise FinloopError(
            f"{path} cannot be understood ({error!r})",
            "an SVG whose paths and transforms follow the standard",
            "open it in a drawing program and save it as plain SVG",
        ) from error
    problems.raise_if_any()
    if not by_name:
        raise FinloopError(
            f"{path} has no contour",
            "at least one path or shape that is shown; pictures do not count",
            "trace pictures, and show hidden layers",
        )
    if len(by_name) > MOST_CONTOURS:
        raise FinloopError(
            f"{path} has {len(by_name)} contours",
            f"at most {MOST_CONTOURS}",
            "save only the contours to be morphed",
        )
    curves = {name: clean_curve(curve, name) for name, (curve, _, _) in by_name.items()}
    styles = {name: paint for name, (_, paint, _) in by_name.items() if paint}
    has_size = bool({"viewBox", "width", "height"} & root.attrib.keys())
    for name in _find_artboards(curves, styles, size) if has_size else ():
        del curves[name], by_name[name]
    groups = {name: around for name, (_, _, around) in by_name.items() if around}
    unpainted = _find_unpainted(curves, styles, rules)
    width, height = size
    if not has_size:
        corner = np.maximum.reduce([curve.points.max(axis=0) for curve in curves.values()])
        width, height = np.maximum(corner, 1)
    if not (0 < width <= LARGEST and 0 < height <= LARGEST):
        raise FinloopError(
            f"{path} is a picture of {width:g} × {height:g}",
            "a width and a height above 0",
            "correct its viewBox, or width and height",
        )
    return Drawing(curves, float(width), float(height), styles, groups, unpainted=unpainted)


def _find_artboards(
    curves: Mapping[str, Curve], styles: Mapping[str, Paint], size: tuple[float, float]
) -> set[str]:
    """Return the names of unpainted rectangles that cover the picture; none if these are all.

    Illustrator and Affinity write such a rectangle for an artboard. size: of the picture, px.
    """
    margin = SHORT * np.array(size)
    artboards = set[str]()
    for name, curve in curves.items():
        low, high = curve.points.min(axis=0), curve.points.max(axis=0)
        to_side = np.minimum(curve.points - low, high - curve.points)  # 0 at corners of its box
        is_rectangle = curve.closed and len(curve.points) == 4 and (to_side <= 1e-6 * high).all()
        is_whole = (low <= margin).all() and (high >= size - margin).all()
        if name not in styles and is_rectangle and is_whole:
            artboards.add(name)
    return artboards if len(artboards) < len(curves) else set()


def _find_unpainted(
    curves: Mapping[str, Curve], styles: Mapping[str, Paint], rules: Mapping[str, str]
) -> tuple[str, ...]:
    """Return the names of shapes of which `fill-rule` paints areas that the even-odd rule does not.

    rules: the `fill-rule` of each shape, by name.
    """
    return tuple(
        name
        for name, layers in layers_by_shape(curves).items()
        if name in styles
        and styles[name].fill is not None
        and rules[name] == "nonzero"
        and is_painted_otherwise([curves[layer] for layer in layers])
    )


def describe_unpainted(*drawings: Drawing) -> str:
    """Return in words which shapes have areas that their fill-rule paints and finloop does not."""
    names = dict.fromkeys(name for drawing in drawings for name in drawing.unpainted)
    if not names:
        return ""
    return (
        f"painted by the even-odd rule, though fill-rule is nonzero: {', '.join(names)} (unite the"
        " contours in the drawing program)"
    )


# --- what is refused


class _Problems:
    """Collects all that a drawing shows and finloop cannot read, for a single error message."""

    def __init__(self, path: Path) -> None:
        """Begin without problems; path: of the file."""
        self._path = path
        self._names = dict[str, list[str]]()  # of shapes, by key of `_REFUSED`
        self._unreadable = list[str]()
        self._shape = ""

    def collect(self, shape: str) -> "_Problems":
        """Return a context manager: unreadable values in its block become problems of a shape.

        shape: its name, for the message.
        """
        self._shape = shape
        return self

    def __enter__(self) -> None:
        """Begin to collect the problems of a shape."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """Keep the error of a value that cannot be read, and go on after the block."""
        if isinstance(error, UnreadableValueError):
            self._unreadable.append(f"{error} ({self._shape!r})")
            return True
        return False

    def add_refused_features(self, document: _Document, shown: list[_ShownShape]) -> None:
        """Add the features of `_REFUSED`, such as clip paths and masks, that shapes show."""
        for item in shown:
            values, kinds = item.group.values, set(item.group.refused)
            if any(values.get(key, "none") != "none" for key in _MARKERS):
                kinds.add("marker")
            servers = [
                document.find_paint_server(values.get(key, "")) for key in ("fill", "stroke")
            ]
            if any(found and found[1] is not None and local_name(found[1]) == "pattern"
                   for found in servers):  # fmt: skip
                kinds.add("pattern")
            if "none" in (values.get("fill"), values.get("stroke", "none")):
                kinds.discard("paint-order")  # nothing lies below anything
            for kind in kinds:
                self._names.setdefault(kind, []).append(item.name)

    def raise_if_any(self) -> None:
        """Raise one FinloopError with all problems, if there are any."""
        said, advice = list[str](), list[str]()
        for kind, (what, do, _) in _REFUSED.items():
            if names := list(dict.fromkeys(self._names.get(kind, []))):
                few = ", ".join(map(repr, names[:3])) + (" …" if len(names) > 3 else "")
                said.append(f"{what} ({few})")
                advice.append(do)
        if self._unreadable:
            several = list(dict.fromkeys(self._unreadable))
            said.append(
                f"what cannot be read: {', '.join(several[:5])}" + " …" * (len(several) > 5)
            )
            advice.append("correct these values")
        if said:
            raise FinloopError(
                f"{self._path} shows {', '.join(said)}",
                "paths and shapes with colours, gradients, lines and dashes",
                "; ".join(advice),
            )


def _find_idle_clips(root: ElementTree.Element) -> Iterator[str]:
    """Yield the ids of clip paths that cover the whole picture, and so clip nothing.

    Figma and Illustrator write them.
    """
    box = root.get("viewBox") or f"0 0 {root.get('width')} {root.get('height')}"
    for clip in (element for element in root.iter() if local_name(element) == "clipPath"):
        rect = clip[0] if len(clip) == 1 and local_name(clip[0]) == "rect" else None
        if rect is None or _NO_IDLE_CLIP & (clip.attrib.keys() | rect.keys()):
            continue
        with suppress(ValueError):
            x, y, width, height = (float(rect.get(key, 0)) for key in _RECT)
            left, top, across, down = map(float, re.split(r"[\s,]+", box.strip()))
            is_covered = x <= left and y <= top
            if is_covered and x + width >= left + across and y + height >= top + down:
                yield clip.get("id", "")


# --- names


def _unique_names(path: Path, shown: list[_ShownShape]) -> list[str]:
    """Return a unique name for each shape; names that are XML ids do not change.

    Of other names, the second and later ones get a number: eye, eye-2. path: of the file, for
    messages. FinloopError if two shapes have one id.
    """
    ids = Counter(item.name for item in shown if item.name_is_id)
    if repeated := [name for name, count in ids.items() if count > 1]:
        raise FinloopError(
            f"{path} uses the id {repeated[0]!r} {ids[repeated[0]]} times",
            "an id of its own for every contour",
            "rename them: ids define which contours of two drawings belong together",
        )
    unique_names, used, numbers = list[str](), set(ids), Counter[str]()
    for item in shown:
        unique = item.name
        while not item.name_is_id and unique in used:
            numbers[item.name] += 1
            unique = f"{item.name}-{numbers[item.name] + 1}"
        used.add(unique)
        unique_names.append(unique)
    return unique_names


def _own_name(element: ElementTree.Element) -> str:
    """Return the name that an element has in the drawing program; "" if it has none.

    It is the id, but Illustrator writes `fore_left` as `fore_x5F_left`, and Inkscape as a label,
    with an id of its own such as `path12`.
    """
    if (label := element.get(_LABEL)) and _INKSCAPE_ID.fullmatch(element.get("id", "")):
        return label
    return _decoded_id(element)


def _decoded_id(element: ElementTree.Element) -> str:
    """Return the id of an element as it was before Illustrator wrote it; "" without one."""
    encoded = element.get("id", "")
    return re.sub(r"_x([0-9A-F]{2,4})_", lambda code: chr(int(code[1], 16)), encoded)


# --- elements


def _read_root(root: ElementTree.Element) -> tuple[tuple[float, float], _Context]:
    """Return the picture's width and height [px], and the context of the root's children."""
    box = _read_view_box(root)
    width, height = (
        None if text is None or (box is None and text.strip().endswith("%"))
        else read_length(key, text, box[at] if box else 0.0)
        for key, text, at in (("width", root.get("width"), 2), ("height", root.get("height"), 3))
    )  # fmt: skip
    if box is None:
        size = width or 1.0, height or 1.0
        return size, _Context("contour", (), {}, svg.Matrix(), size)
    across, down = box[2:]
    if width is None:
        width = across if height is None else height * across / down
    if height is None:
        height = width * down / across
    matrix = _fit_box(box, (0.0, 0.0, width, height), root)
    return (width, height), _Context("contour", (), {}, matrix, (across, down))


def _read_view_box(element: ElementTree.Element) -> tuple[float, float, float, float] | None:
    """Return x, y, width and height of an element's viewBox; None if it has none."""
    if (text := element.get("viewBox")) is None:
        return None
    parts = re.split(r"[\s,]+", text.strip())
    if len(parts) != 4:
        raise UnreadableValueError(f"viewBox: {text[:100]}")
    x, y, width, height = (read_length("viewBox", part, 0.0) for part in parts)
    return x, y, width, height


def _fit_box(
    box: tuple[float, float, float, float], place: tuple[float, float, float, float],
    element: ElementTree.Element,
) -> Any:  # fmt: skip
    """Return the matrix that maps a viewBox onto a rectangle: x, y, width, height."""
    aspect = " ".join(element.get("preserveAspectRatio", "xMidYMid").split())
    return svg.Matrix(svg.Viewbox.viewbox_transform(*place, *box, aspect))


def _shown_shapes(
    document: _Document, element: ElementTree.Element, around: _Context, problems: _Problems,
    place: tuple[float, float] | None = None,
) -> Iterator[_ShownShape]:  # fmt: skip
    """Yield every shape that an element and its descendants show.

    around: the context of the element. place: width and height that a `use` gives to a viewport.
    """
    tag = local_name(element)
    if tag not in (*_GROUPS, *_SHAPES, "use", "switch", "text", "symbol") or not _applies(element):
        return
    own_name = _own_name(element)
    name = own_name or around.name
    with problems.collect(name):
        group = _child_context(document, element, around)
        if group.values.get("display") == "none":
            return
        if tag == "text":
            words = "".join(element.itertext()).strip()
            if words and group.values.get("visibility") not in ("hidden", "collapse"):
                refused = group.refused | {"text"}
                yield _ShownShape(
                    own_name or words[:20], False, group._replace(refused=refused), element
                )
        elif tag in _SHAPES:
            if group.values.get("visibility") not in ("hidden", "collapse"):
                is_id = own_name == _decoded_id(element) != "" and not group.is_used
                yield _ShownShape(name, is_id, group, element)
        else:
            is_root = element not in document.parents
            if own_name and not is_root:
                group = group._replace(name=own_name, groups=(own_name, *group.groups))
            if tag == "use":
                yield from _used_shapes(document, element, group, problems)
                return
            if tag in ("svg", "symbol") and not is_root:
                group = _viewport_context(element, group, place)
            children = list(element)
            if tag == "switch":
                kinds = (*_GROUPS, *_SHAPES, "use", "switch", "text", "image")
                children = [c for c in children if local_name(c) in kinds and _applies(c)][:1]
            for child in children:
                if local_name(child) != "symbol":
                    yield from _shown_shapes(document, child, group, problems)


def _applies(element: ElementTree.Element) -> bool:
    """Return whether an element applies here: it needs no extension, and its language is English.

    An element that states no language counts as English.
    """
    languages = element.get("systemLanguage", "en").lower().split(",")
    return "requiredExtensions" not in element.attrib and any(
        language.strip().partition("-")[0] == "en" for language in languages
    )


def _child_context(document: _Document, element: ElementTree.Element, around: _Context) -> _Context:
    """Return the context of an element's children: styles, matrix, opacity, refused features."""
    values = inherit_values(document.declared[element], around.values)
    refused = set(around.refused)
    is_moved = any(values.get(key, "none") != "none" for key in _MOVES)
    for key, (_, _, harmless) in _REFUSED.items():
        text = " ".join(values.get(key, harmless[0]).split())
        if text in harmless or (key in ("transform-origin", "transform-box") and not is_moved):
            continue
        is_idle = key == "clip-path" and _fill_target(text) in document.idle_clips
        if not (is_idle and not around.is_moved and not is_moved):
            refused.add(key)
    matrix = around.matrix
    for key in _MOVES:
        text = values.get(key, "none")
        is_call = key == "transform" or text == "none"
        matrix = _read_transform(key, text if is_call else f"{key}({text})") * matrix
    return around._replace(
        values=values,
        matrix=matrix,
        opacity=around.opacity * read_opacity("opacity", values.get("opacity", "1")),
        refused=frozenset(refused),
        is_moved=around.is_moved or is_moved,
    )


def _used_shapes(
    document: _Document, element: ElementTree.Element, group: _Context, problems: _Problems
) -> Iterator[_ShownShape]:
    """Yield the shapes that a `use` element shows; their ids stand elsewhere in the file."""
    target_id = use_target(document.path, element)
    target = document.by_id.get(target_id) if target_id else None
    if target is None:
        return
    x, y = (read_length(key, read_attribute(element, group.values, key, "0"), size)
            for key, size in zip("xy", group.size, strict=True))  # fmt: skip
    place = tuple(
        read_length(key, text, size)
        if (text := read_attribute(element, group.values, key) or target.get(key))
        else size
        for key, size in zip(("width", "height"), group.size, strict=True)
    )
    inner = group._replace(matrix=svg.Matrix(1, 0, 0, 1, x, y) * group.matrix, is_used=True)
    own_name = _own_name(element)
    for part in _shown_shapes(
        document, target, inner, problems, cast("tuple[float, float]", place)
    ):
        yield part._replace(name=own_name or part.name, name_is_id=False)


def _viewport_context(
    element: ElementTree.Element, group: _Context, place: tuple[float, float] | None
) -> _Context:
    """Return the context of the children of a nested `svg` or a `symbol`, which have a viewport.

    place: width and height that a `use` gives to the viewport.
    """
    x, y = 0.0, 0.0
    if local_name(element) == "svg":
        x, y = (read_length(key, read_attribute(element, group.values, key, "0"), size)
                for key, size in zip("xy", group.size, strict=True))  # fmt: skip
    width, height = place or (
        read_length(key, read_attribute(element, group.values, key, "100%"), size)
        for key, size in zip(("width", "height"), group.size, strict=True)
    )
    box = _read_view_box(element)
    if box is None:
        matrix, size = svg.Matrix(1, 0, 0, 1, x, y), (width, height)
    else:
        matrix, size = _fit_box(box, (x, y, width, height), element), (box[2], box[3])
    cuts = group.cuts
    square = svg.Matrix(width, 0, 0, height, x, y) * group.matrix
    if group.values.get("overflow") not in ("visible", "auto") and square.determinant:
        cuts += (~square,)
    return group._replace(matrix=matrix * group.matrix, size=size, is_moved=True, cuts=cuts)


def _read_transform(key: str, text: str) -> Any:
    """Return an SVG transform as a matrix; UnreadableValueError if invalid or not finite."""
    if text in ("", "none"):
        return svg.Matrix()
    try:
        if not _TRANSFORM.fullmatch(text) or "%" in text:
            raise ValueError
        matrix = svg.Matrix(text)
        if not np.isfinite([getattr(matrix, name) for name in "abcdef"]).all():
            raise ValueError
    except _MISREAD as error:
        raise UnreadableValueError(f"{key}: {text[:100]}") from error
    return matrix


# --- contours


def _read_contours(
    document: _Document, item: _ShownShape, tolerance_px: float
) -> Iterator[tuple[Curve, Paint | None]]:
    """Yield every contour of a shape that a drawing shows, and how it is painted."""
    shape = read_shape(item.element, item.group.values, item.group.size)
    if shape is None:
        return
    moved = shape * item.group.matrix
    moved.reify()
    curves = list(shape_polylines(moved, tolerance_px))
    unit_px = _dash_unit(item.element, item.group.values, curves)
    paint = _read_paint(document, item.group, shape, unit_px)
    rule = item.group.values.get("fill-rule", "nonzero").lower()
    if rule not in ("nonzero", "evenodd"):
        raise UnreadableValueError(f"fill-rule: {rule[:100]}")
    is_nonzero = rule == "nonzero"
    if is_nonzero and len(curves) > 1 and paint is not None and paint.fill is not None:
        is_edge = find_area_edges(curves)
        if paint.stroke is not None and not all(is_edge):
            raise UnreadableValueError(
                "fill-rule: nonzero, for a contour with a line within the area (reverse it for a"
                " hole, else give it a path of its own)"
            )
        curves = [curve for curve, keep in zip(curves, is_edge, strict=True) if keep]
    for curve in curves:
        for m in item.group.cuts if np.isfinite(curve.points).all() else ():
            unit = curve.points @ [[m.a, m.b], [m.c, m.d]] + [m.e, m.f]
            if unit.min() < -CUT or unit.max() > 1 + CUT:
                raise UnreadableValueError(
                    "overflow: hidden, of an svg or symbol that cuts it (set it to visible, or cut"
                    " the shape)"
                )
        yield curve, paint


# --- styles


def _read_paint(
    document: _Document, group: _Context, shape: Any, dash_unit_px: float | None
) -> Paint | None:
    """Return how a shape is painted, in px of the viewport; None if nothing paints it.

    group: its values, matrix and opacity; shape: in its own coordinates; dash_unit_px: from
    `_dash_unit`.
    """
    values = group.values
    matrix = group.matrix
    scale = float(np.sqrt(abs(matrix.a * matrix.d - matrix.b * matrix.c)))
    if values.get("vector-effect") == "non-scaling-stroke":
        scale = 1.0
    diagonal = float(np.hypot(*group.size) / np.sqrt(2))
    fill, fill_opacity = _read_fill(document, group, shape, "fill", "black")
    stroke, stroke_opacity = _read_fill(document, group, shape, "stroke", "none")
    own_width = read_length("stroke-width", values.get("stroke-width", "1"), diagonal)
    if own_width < 0:
        raise UnreadableValueError(f"stroke-width: {own_width:g}")
    if own_width == 0:
        stroke = None
    if fill is None and stroke is None:
        return None
    dashes: tuple[float, ...] = ()
    offset, is_round = 0.0, False
    if stroke is not None:
        dashes, offset, is_round = _read_dashes(
            values, own_width, scale, diagonal, scale if dash_unit_px is None else dash_unit_px
        )
    gradients = [one.matrix for one in (fill, stroke) if isinstance(one, Gradient)]
    largest = np.abs([scale * own_width, *dashes, offset, *np.ravel(gradients)]).max()
    if not largest <= LARGEST:
        raise UnreadableValueError(f"a line or gradient of a size of {largest:g}")
    return Paint(
        fill, stroke, group.opacity * fill_opacity, group.opacity * stroke_opacity,
        scale * own_width, dashes, offset, is_round,
    )  # fmt: skip


def _read_fill(
    document: _Document, group: _Context, shape: Any, key: str, usual: str
) -> tuple[Fill, float]:
    """Return the fill, or the stroke, of a shape, and its opacity, 0 … 1.

    key: "fill" or "stroke". usual: the value where none is stated.
    """
    text = group.values.get(key, usual)
    opacity = read_opacity(f"{key}-opacity", group.values.get(f"{key}-opacity", "1"))
    if server := document.find_paint_server(text):
        if server[1] is not None and local_name(server[1]) in _GRADIENTS:
            return _read_gradient(document, server[0], group, shape), opacity
        text = text.partition(")")[2].strip() or "none"  # the colour in place of what is missing
    if text == "none":
        return None, 1.0
    colour, own_opacity = read_colour(key, group.values, text)
    return colour, opacity * own_opacity


def _fill_target(text: str) -> str | None:
    """Return the id in a fill or stroke `url(#id)`; None if the text is no such reference.

    The id is "" if the reference leads to another file.
    """
    found = re.match(r"url\(([^)]*)\)", text)
    target = found[1].strip(" \t\r\n\"'") if found else ""
    return (target[1:] if target.startswith("#") else "") if found else None


def _read_gradient(document: _Document, name: str, group: _Context, shape: Any) -> Gradient | None:
    """Return the gradient with an id, in px, as it fills a shape; None if it paints nothing.

    Attributes and stops that it does not state come from the gradient to which it refers.
    """
    chain, reference = list[ElementTree.Element](), name
    while reference and (element := document.by_id.get(reference)) is not None:
        if element in chain or local_name(element) not in _GRADIENTS:
            break
        chain.append(element)
        reference = read_href(element)[1:]
    stated = dict[str, str]()
    for element in chain[::-1]:
        stated |= element.attrib
    stops = next((stops for element in chain if (stops := _read_stops(document, element))), ())
    in_box = stated.get("gradientUnits") != "userSpaceOnUse"
    to_drawing = svg.Matrix(group.matrix)
    if in_box:  # lengths are shares of the shape's box
        left, top, right, bottom = shape.bbox(transformed=False)
        if left == right or top == bottom:
            return None
        to_drawing = svg.Matrix(right - left, 0, 0, bottom - top, left, top) * to_drawing
    transform = _read_transform("gradientTransform", stated.get("gradientTransform", ""))
    to_drawing = transform * to_drawing
    width, height = (1.0, 1.0) if in_box else group.size

    def coordinate(key: str, usual: str) -> float:
        """Return a length of the gradient; 100 % is the width, the height or their mean."""
        text = stated.get(key, usual).strip()
        diagonal = float(np.hypot(width, height) / np.sqrt(2))
        whole = {"x": width, "y": height}.get(key.strip("cf12"), diagonal)
        return read_length(key, text, whole)

    kind: Literal["linear", "radial"] = "linear"
    focus = 0.0, 0.0
    if local_name(chain[0]) == "linearGradient":
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


def _read_stops(document: _Document, gradient: ElementTree.Element) -> tuple[Stop, ...]:
    """Return the colour stops of a gradient; FinloopError if there are too many."""
    around, values = [gradient], Values()
    while around[-1] in document.parents:
        around.append(document.parents[around[-1]])
    for element in around[::-1]:
        values = inherit_values(document.declared[element], values)
    stops = list[Stop]()
    for element in gradient:
        if local_name(element) != "stop":
            continue
        own = inherit_values(document.declared[element], values)
        colour, opacity = read_colour("stop-color", own, own.get("stop-color", "black"))
        opacity *= read_opacity("stop-opacity", own.get("stop-opacity", "1"))
        offset = read_opacity("offset", element.get("offset", "0"))  # a share, 0 … 1, too
        offset = max(offset, stops[-1].offset) if stops else offset
        stops.append(Stop(offset, colour, opacity))
    _refuse_too_many_parts("a gradient", len(stops), "stops")
    return tuple(stops)


def _dash_unit(
    element: ElementTree.Element, values: Mapping[str, str], curves: Sequence[Curve]
) -> float | None:
    """Return the length [px] of the unit in which a shape states its dashes.

    None if there are no dashes, or no `pathLength`, the number of units that the shape is long.
    """
    if (text := element.get("pathLength")) is None or "stroke-dasharray" not in values:
        return None
    stated = read_length("pathLength", text, 1.0)
    if stated <= 0:
        return None  # as SVG says
    rings = [np.concatenate([curve.points, curve.points[: curve.closed]]) for curve in curves]
    return float(sum(np.hypot(*np.diff(ring, axis=0).T).sum() for ring in rings)) / stated


def _read_dashes(
    values: Mapping[str, str], own_width: float, scale: float, diagonal: float, unit_px: float
) -> tuple[tuple[float, ...], float, bool]:
    """Return a stroke's dash and gap lengths [px], their offset [px], and whether caps are round.

    own_width: stroke width in the shape's own units; scale: px per own unit; diagonal: length that
    100 % stands for; unit_px: of the dashes. A solid line gives (), 0 and False. Square ends make
    dashes longer by the width, and gaps shorter.
    """
    texts = re.split(r"[\s,]+", values.get("stroke-dasharray", "").strip())
    if texts in ([""], ["none"]):
        return (), 0.0, False
    _refuse_too_many_parts("a dashed line", len(texts), "lengths")
    lengths = [unit_px * read_length("stroke-dasharray", text, diagonal) for text in texts]
    stated_offset = values.get("stroke-dashoffset", "0")
    offset = unit_px * read_length("stroke-dashoffset", stated_offset, diagonal)
    lengths = lengths * 2 if len(lengths) % 2 else lengths
    ends = values.get("stroke-linecap", "butt")
    if ends == "square":
        width = scale * own_width
        gaps = [min(width, gap) for gap in lengths[1::2]]
        lengths[::2] = [dash + gap for dash, gap in zip(lengths[::2], gaps, strict=True)]
        lengths[1::2] = [gap - less for gap, less in zip(lengths[1::2], gaps, strict=True)]
        offset += width / 2
    if min(lengths) < 0 or not any(lengths[1::2]):
        return (), 0.0, False  # as SVG says of negative lengths
    return tuple(lengths), offset, ends == "round"


def _refuse_too_many_parts(what: str, count: int, parts: str) -> None:
    """Raise FinloopError if a gradient or a line has more parts than `_MOST_PARTS`."""
    if count > _MOST_PARTS:
        raise FinloopError(f"{what} of {count} {parts}", f"at most {_MOST_PARTS}", "simplify it")
