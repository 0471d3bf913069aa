"""Which SVG files are read at all: small, shallow ones that need no other file.

A file may come from anybody. Nothing is ever fetched. An entity may stand for a million others and
a `use` for a million shapes: entities are refused, and the shapes of `use` are counted first.
"""

from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from finloop.base.errors import FinloopError
from finloop.io.svg_style import MOST_NESTED, local_name

MOST_BYTES = 4 * 2**20
MOST_DRAWN = 2**19
"""Characters of geometry, counted each time a `use` shows it; so many take five seconds to read."""

# Nothing of these is a contour of its own.
_NO_CONTOURS = {
    *("image", "script", "foreignObject", "metadata", "animate", "filter", "marker", "mask"),
}
_ELEMENT = 100  # characters that an element counts for beside its geometry
_GEOMETRY = ("d", "points", "transform")
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")


def load_safe_tree(path: Path) -> ElementTree.Element:
    """Load an SVG file's XML tree.

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
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError) as error:  # such as a prefix of no namespace
        raise _no_xml_error(path, str(error)) from error
    if local_name(root) != "svg":
        raise FinloopError(
            f"{path} holds <{local_name(root)}>, no SVG",
            "an SVG drawing",
            "save the drawing as SVG",
        )
    for parent in list(root.iter()):
        for child in list(parent):
            if local_name(child) in _NO_CONTOURS:
                parent.remove(child)
            elif local_name(child) == "pattern":
                child[:] = []  # fills may refer to it
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
        raise _no_xml_error(path, str(error) if data.strip() else "it is empty") from error


def _no_xml_error(path: Path, reason: str) -> FinloopError:
    """Return the error for a file that is no XML."""
    return FinloopError(
        f"{path} is no XML ({reason})", "an SVG drawing", "save the drawing again as plain SVG"
    )


def use_target(path: Path, element: ElementTree.Element) -> str | None:
    """Return the id that a `use` element refers to; None for other elements, or if it has none.

    path: of the SVG, for messages. FinloopError if the shape is in another file.
    """
    if local_name(element) != "use":
        return None
    reference = read_href(element)
    if reference and not reference.startswith("#"):
        raise FinloopError(
            f"{path} shows a shape of another file: {reference[:100]!r}, which is not fetched",
            "an SVG that holds all its shapes",
            "copy the shape into the drawing",
        )
    return reference[1:] or None


def read_href(element: ElementTree.Element) -> str:
    """Return an XML element's reference (href), such as "#id"; "" if it has none."""
    return next((text for name in _HREFS if (text := element.get(name, "").strip())), "")


def _refuse_large(path: Path, root: ElementTree.Element) -> None:
    """Raise FinloopError if a drawing has too much geometry, is too deep, or contains itself."""
    # Of equal ids the first counts, as in `svg`.
    by_id = {element.get("id"): element for element in reversed(list(root.iter()))}
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
                f"remove the <use> of {use_target(path, element) or element.get('id')!r}",
            )
        unfinished.add(key)
        used = by_id.get(use_target(path, element) or "")
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
