"""XML from unknown sources: read only if it is small, shallow and needs no other file.

Nothing is ever fetched: the parser has no loader, and references outside are refused or left out.
An entity may stand for a million others and a `use` for a million shapes, so entities are refused,
and the shapes of `use` are counted before they are drawn.
"""

from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from finloop.base.errors import FinloopError

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


def load_tree(path: Path) -> ElementTree.Element:
    """Load an SVG file's root element; remove what is no contour, such as text and pictures.

    A `symbol` becomes a `g` (with a viewBox: an `svg`) in `defs`. FinloopError if the file is
    missing, huge, no SVG, declares entities, points to another file for a shape, or would draw more
    than MOST_DRAWN.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FinloopError(
            f"{path} cannot be read ({error.strerror})",
            "an SVG drawing",
            "name a file that exists",
        ) from error
    if len(data) > MOST_BYTES:
        raise FinloopError(
            f"{path} has more than {MOST_BYTES / 2**20:g} MiB",
            "a drawing of a few contours",
            "save only the contours, without pictures, and simplify traced paths",
        )
    _survey(path, data)
    root = ElementTree.fromstring(data)
    if _tag(root) != "svg":
        raise FinloopError(
            f"{path} holds <{_tag(root)}>, no SVG", "an SVG drawing", "save the drawing as SVG"
        )
    _tidy(root)
    style = sum(len(element.text or "") for element in root.iter() if _tag(element) == "style")
    if style > MOST_STYLE:
        raise FinloopError(
            f"{path} has style sheets of {style / 1024:.0f} KiB",
            f"at most {MOST_STYLE // 1024} KiB",
            "save it without embedded fonts, or with styles as attributes",
        )
    _count(path, root)
    return root


def _survey(path: Path, data: bytes) -> None:
    """Parse the XML once, building nothing, and refuse entities."""
    parser = expat.ParserCreate()

    def entity(name: str, *rest: object) -> NoReturn:
        raise FinloopError(
            f"{path} declares the entity {name!r}, which may stand for any amount of text",
            "an SVG without entities",
            "save it as plain SVG: the drawing program then writes entities out",
        )

    parser.EntityDeclHandler = entity
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        empty = "it is empty" if not data.strip() else str(error)
        raise FinloopError(
            f"{path} is no XML ({empty})", "an SVG drawing", "save the drawing again as plain SVG"
        ) from error


def _weight(element: ElementTree.Element) -> int:
    return _ELEMENT + sum(len(element.get(name, "")) for name in _GEOMETRY)


def _too_many(path: Path) -> NoReturn:
    raise FinloopError(
        f"{path} draws more than {MOST_DRAWN // 1024} KiB of paths, or"
        f" {MOST_DRAWN // _ELEMENT} shapes, or nests more than {MOST_NESTED} deep",
        "a drawing of a few contours",
        "save only the contours to be morphed, and simplify traced paths",
    )


def _tag(element: ElementTree.Element) -> str:
    return element.tag.removeprefix(_SVG)


def _tidy(root: ElementTree.Element) -> None:
    """Remove what is no contour; hide symbols, which only a `use` shows, among definitions."""
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


def use_target(path: Path, element: ElementTree.Element) -> str | None:
    """Return the id of the shape that a `use` shows; None for another element or an empty `use`.

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


def _count(path: Path, root: ElementTree.Element) -> None:
    by_id = {element.get("id"): element for element in root.iter()}
    counts = dict[int, int]()
    open_ = set[int]()

    def count(element: ElementTree.Element, depth: int) -> int:
        key = id(element)
        if key in counts:
            return counts[key]
        if key in open_:
            raise FinloopError(
                f"{path} holds a <use> that shows itself",
                "shapes that do not contain themselves",
                f"remove the <use> of {use_target(path, element) or element.get('id')!r}",
            )
        if depth > MOST_NESTED:
            _too_many(path)
        open_.add(key)
        target_of = by_id.get(use_target(path, element) or "")
        parts = [*element, *([] if target_of is None else [target_of])]
        total = _weight(element) + sum(count(part, depth + 1) for part in parts)
        open_.discard(key)
        if total > MOST_DRAWN:
            _too_many(path)
        counts[key] = total
        return total

    count(root, 0)
