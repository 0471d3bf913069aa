"""Styles of an SVG: the cascade of style sheets, inheritance, variables, colours and lengths.

tinycss2 reads style sheets and colours, cssselect2 matches selectors. A value that cannot be read
is refused by name: nothing becomes black in silence.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

import cssselect2
import numpy as np
import tinycss2
import tinycss2.color4

from finloop.base.errors import FinloopError
from finloop.base.style import Colour, oklab_to_colour

Values = dict[str, str]
"""Properties of an element, and its variables `--name`, by name."""

MOST_STYLE = 2**16  # characters of style sheets
MOST_SELECTOR = 1000  # parts of the selectors of a rule
MOST_ATTRIBUTES = 2**19  # characters of `style` attributes that differ
MOST_MATCHES = 2**21
"""Comparisons of selectors with elements; so many take a few seconds."""
MOST_NESTED = 64  # elements within each other
MOST_COLOUR = 200  # characters of a colour
MOST_VALUE = 2**12  # characters of a value after its variables have been put in

INHERITED = {
    *(
        "fill",
        "fill-opacity",
        "fill-rule",
        "stroke",
        "stroke-opacity",
        "stroke-width",
        "stroke-dasharray",
    ),
    *("stroke-dashoffset", "stroke-linecap", "visibility", "color", "paint-order"),
    *("marker", "marker-start", "marker-mid", "marker-end"),
}
OWN = {
    *("display", "opacity", "clip-path", "mask", "filter", "mix-blend-mode", "transform"),
    *("transform-origin", "transform-box", "translate", "rotate", "scale", "offset-path"),
    *("vector-effect", "overflow", "stop-color", "stop-opacity"),
}
STYLE_ONLY = {"translate", "rotate", "scale", "offset-path"}
"""Properties that count only in styles: attributes of these names mean something else."""
GEOMETRY = {"d", "x", "y", "width", "height", "cx", "cy", "r", "rx", "ry"}
"""Attributes that style sheets may state, too."""
_LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(%|[a-z]*)", re.I)
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6,
          "pt": 96 / 72, "pc": 16.0}  # fmt: skip


class UnreadableValueError(ValueError):
    """Error of a property whose value cannot be read; its text states both of them."""


# --- the cascade


def declared_styles(path: Path, root: ElementTree.Element) -> dict[ElementTree.Element, Values]:
    """Return, for each element of an SVG tree, the properties that it states itself.

    They come from attributes, then style sheets, then `style`; inherited ones are left out. path:
    of the file, for messages. FinloopError if the style sheets are too long, too complex, or have
    selectors that look at siblings.
    """
    sheets = [element.text or "" for element in root.iter() if local_name(element) == "style"]
    matcher = _compile_sheets(path, sheets, _count_by_depth(root))
    styles = {text: _read_declarations(text) for text in _distinct_style_attributes(path, root)}
    declared = dict[ElementTree.Element, Values]()
    for wrapper in cssselect2.ElementWrapper.from_xml_root(root).iter_subtree():
        element: ElementTree.Element = wrapper.etree_element
        usual = {
            key: text
            for key, text in element.attrib.items()
            if key in (INHERITED | OWN) - STYLE_ONLY and text.strip()
        }
        important: Values = {}
        rules = [payload for *_, pseudo, payload in matcher.match(wrapper) if pseudo is None]
        for plain, strong in [*rules, styles[element.get("style", "")]]:
            usual |= plain
            important |= strong
        declared[element] = usual | important
    return declared


def _distinct_style_attributes(path: Path, root: ElementTree.Element) -> set[str]:
    """Return the distinct `style` attributes in an SVG tree; FinloopError if they are too long."""
    texts = {element.get("style", "") for element in root.iter()}
    if (characters := sum(map(len, texts))) > MOST_ATTRIBUTES:
        raise FinloopError(
            f"{path} has style attributes of {characters / 1024:.0f} KiB",
            f"at most {MOST_ATTRIBUTES // 1024} KiB that differ",
            "save it as plain SVG",
        )
    return texts


def _count_by_depth(root: ElementTree.Element) -> list[int]:
    """Return how many elements there are at each depth; the first is that of the root."""
    counts, level = list[int](), [root]
    while level:
        counts.append(len(level))
        level = [child for element in level for child in element]
    return counts


def _compile_sheets(path: Path, sheets: Sequence[str], counts: Sequence[int]) -> cssselect2.Matcher:
    """Return a matcher that finds the rules of some style sheets for an element.

    counts: number of elements at each depth of the tree. path: of the file, for messages.
    FinloopError if the sheets are too long or too complex.
    """
    if (characters := sum(map(len, sheets))) > MOST_STYLE:
        raise FinloopError(
            f"{path} has style sheets of {characters / 1024:.0f} KiB",
            f"at most {MOST_STYLE // 1024} KiB",
            "save it without embedded fonts, or with styles as attributes",
        )
    matcher, work = cssselect2.Matcher(), 0
    for sheet in sheets:
        for rule in tinycss2.parse_stylesheet(sheet, skip_comments=True, skip_whitespace=True):
            if rule.type != "qualified-rule":
                continue  # such as @import: nothing is fetched
            if len(rule.prelude) > MOST_SELECTOR:
                raise FinloopError(
                    f"{path} has a style rule with selectors of {len(rule.prelude)} parts",
                    f"at most {MOST_SELECTOR}",
                    "save it with styles as attributes",
                )
            try:
                selectors = cssselect2.compile_selector_list(rule.prelude)
            except cssselect2.SelectorError:
                continue  # as CSS says
            steps = _count_selector_steps(path, rule.prelude)
            work += len(selectors) * sum(
                count * max(1, depth) ** steps for depth, count in enumerate(counts)
            )
            if work > MOST_MATCHES or len(counts) > MOST_NESTED:
                raise FinloopError(
                    f"{path} has style sheets with too many rules for its elements",
                    f"at most {MOST_MATCHES} comparisons, {MOST_NESTED} elements in each other",
                    "save it with styles as attributes",
                )
            declarations = _read_declarations(rule.content)
            for selector in selectors:
                matcher.add_selector(selector, declarations)
    return matcher


def _count_selector_steps(path: Path, prelude: Sequence[tinycss2.ast.Node]) -> int:
    """Return the largest number of ancestor steps in a rule's selectors: 2 for `g > .eye path`.

    FinloopError for selectors that look at siblings, or at what is in elements.
    """
    text = tinycss2.serialize(prelude)
    if any(token.type == "function" or token in ("+", "~") for token in prelude):
        raise FinloopError(
            f"{path} has a style rule for {text.strip()[:100]!r}",
            "selectors of ids, classes and elements within others",
            "save it with styles as attributes",
        )
    return len(re.findall(r"[^\s>,][\s>]+(?=[^\s>,])", text))


def _read_declarations(text: str | Sequence[tinycss2.ast.Node]) -> tuple[Values, Values]:
    """Return the known properties, and variables, of CSS declarations: usual, then !important."""
    usual, important = Values(), Values()
    for declaration in tinycss2.parse_blocks_contents(text) if text else ():
        if declaration.type == "declaration":
            name = declaration.name if declaration.name.startswith("--") else declaration.lower_name
            if name in INHERITED | OWN | GEOMETRY or name.startswith("--"):
                value = tinycss2.serialize(declaration.value).strip()
                (important if declaration.important else usual)[name] = value
    return usual, important


def local_name(element: ElementTree.Element) -> str:
    """Return the name of an XML element without the SVG namespace."""
    return str(element.tag).removeprefix("{http://www.w3.org/2000/svg}")


# --- inheritance


def inherit_values(declared: Mapping[str, str], parent: Mapping[str, str]) -> Values:
    """Return the properties of an element: its declared ones, and those inherited."""
    values = {key: text for key, text in parent.items() if key in INHERITED or key.startswith("--")}
    values |= {key: text for key, text in declared.items() if key.startswith("--")}
    variables = _Variables(values)
    values |= {key: variables.resolve(key) for key in declared if key.startswith("--")}
    for key, text in declared.items():
        if key.startswith("--"):
            continue
        text = variables.replace_variables(text).strip()
        word = text.lower()
        if word in ("unset", "revert", "revert-layer"):
            word = "inherit" if key in INHERITED else "initial"
        if word == "inherit":
            values |= {key: parent[key]} if key in parent else {}
        elif word == "initial":
            values.pop(key, None)
        else:
            values[key] = text
    return values


class _Variables:
    """CSS variables of an element, which replace `var(--name)` in values."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        """Keep the variables by name; their values may use other variables."""
        self._texts = texts
        self._known = Values()
        self._unfinished = set[str]()

    def resolve(self, name: str) -> str:
        """Return the value of a variable; `var(…)` stays where another variable does not exist."""
        if name not in self._known:
            self._unfinished.add(name)
            self._known[name] = self.replace_variables(self._texts[name])
            self._unfinished.discard(name)
        return self._known[name]

    def replace_variables(self, text: str) -> str:
        """Return a value with its variables replaced; UnreadableValueError if it gets too long."""
        if "var(" not in text:
            return text
        parts = list(self._replaced_parts(tinycss2.parse_component_value_list(text)))
        filled = "".join(parts)
        if len(filled) > MOST_VALUE:
            raise UnreadableValueError(f"{text[:100]!r}, of more than {MOST_VALUE} characters")
        return filled

    def _replaced_parts(self, tokens: Sequence[tinycss2.ast.Node]) -> Iterator[str]:
        """Yield the parts of a value, with variables replaced, as texts to be joined."""
        for token in tokens:
            if token.type == "function" and token.lower_name == "var":
                name = next((part.value for part in token.arguments if part.type == "ident"), "")
                comma = next((k for k, part in enumerate(token.arguments) if part == ","), None)
                if name in self._texts and name not in self._unfinished:
                    yield self.resolve(name)
                elif comma is not None:
                    yield from self._replaced_parts(token.arguments[comma + 1 :])
                else:
                    yield tinycss2.serialize([token])
            elif token.type == "function":
                yield f"{token.name}("
                yield from self._replaced_parts(token.arguments)
                yield ")"
            else:
                yield tinycss2.serialize([token])


# --- values


def read_colour(key: str, values: Mapping[str, str], text: str) -> tuple[Colour, float]:
    """Return a colour and its opacity, 0 … 1; UnreadableValueError if there is no such colour.

    key: of the property, for messages; values: of the element, for `currentcolor`.
    """
    if len(text) > MOST_COLOUR:
        raise UnreadableValueError(f"{key}: {text[:100]} …")
    tokens = [
        token
        for token in tinycss2.parse_component_value_list(text, skip_comments=True)
        if token.type != "whitespace"
    ]
    colour = tinycss2.color4.parse_color(tokens[0]) if len(tokens) == 1 else None
    if colour == "currentcolor":
        current = values.get("color", "black")
        text = "black" if current.lower() == "currentcolor" else current
        return read_colour(key, values, text)
    if colour is None:
        raise UnreadableValueError(f"{key}: {text[:100]}")
    if colour.space in ("oklab", "oklch"):
        light, a, b = (channel or 0.0 for channel in colour.coordinates)
        if colour.space == "oklch":
            a, b = a * np.cos(np.deg2rad(b)), a * np.sin(np.deg2rad(b))
        return oklab_to_colour(np.array([light, a, b])), colour.alpha
    try:
        channels = colour.to("srgb").coordinates
    except NotImplementedError as error:
        raise UnreadableValueError(f"{key}: {text[:100]}") from error
    red, green, blue = (int(np.clip(round(255 * channel), 0, 255)) for channel in channels)
    return (red, green, blue), colour.alpha


def read_opacity(key: str, text: str) -> float:
    """Return an opacity, 0 … 1, that a text states as a number or in per cent."""
    return min(max(read_length(key, text, 1.0), 0.0), 1.0)


def read_length(key: str, text: str, whole: float) -> float:
    """Return a length in px; UnreadableValueError if it is none, or not finite.

    key: of the property, for messages; whole: what 100 % is.
    """
    found = _LENGTH.fullmatch(text.strip())
    unit = found[2].lower() if found else ""
    if found is None or (unit != "%" and unit not in _UNITS):
        raise UnreadableValueError(f"{key}: {text[:100]}")
    value = float(found[1]) * (whole / 100 if unit == "%" else _UNITS[unit])
    if not isfinite(value):
        raise UnreadableValueError(f"{key}: {text[:100]}")
    return value
