"""Forces as a user writes them: `gravity=4`, `wind=2,0,gust=0.5`, `floor=380`, a text for each.

The first value says what or where, `name=value` after it how. Places are those of the SVG; speeds
and strengths count in heights of its picture and in seconds of the film, the paper's τ.
`morph.in_forces` moves a drawing by them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from finloop.base.errors import FinloopError

Place = tuple[float, float] | str
"""x and y in the drawing's coordinates, or the id of a shape of it."""


@dataclass(frozen=True)
class GravityForce:
    """An acceleration downwards, in heights of the picture / s²; below 0 it lifts."""

    strength: float


@dataclass(frozen=True)
class WindForce:
    """A wind of velocity (right, down), in heights of the picture / s.

    gust: share of its speed by which it changes; gust_length: of an eddy, heights.
    """

    velocity: tuple[float, float]
    drag: float = 8.0
    gust: float = 0.0
    gust_length: float = 0.5


@dataclass(frozen=True)
class AttractionForce:
    """A pull to a point, or to the nearest point of a shape's outline.

    At mass 1 and without damping a drawing swings √strength times a second around a point.
    """

    to: Place
    strength: float = 1.0


@dataclass(frozen=True)
class FloorForce:
    """A floor at a height y of the drawing, or at the upper end of a shape.

    friction: Coulomb's number, 0 = ice.
    """

    y: float | str
    friction: float = 0.5


@dataclass(frozen=True)
class HoldForce:
    """A shape, by its id, that holds in place whatever touches it at rest."""

    by: str


Force = GravityForce | WindForce | AttractionForce | FloorForce | HoldForce

KINDS: dict[str, type[Any]] = {
    "gravity": GravityForce,
    "wind": WindForce,
    "attraction": AttractionForce,
    "floor": FloorForce,
    "hold": HoldForce,
}
FORMS = (
    "gravity=STRENGTH, wind=RIGHT,DOWN[,drag=,gust=,gust_length=], "
    "attraction=X,Y or ID[,strength=], floor=Y or ID[,friction=], hold=ID"
)
LARGEST = 1e6
_LEAST_ZERO = ("drag", "gust", "strength", "friction")


def parse_forces(texts: Sequence[str]) -> tuple[Force, ...]:
    """Return the forces that texts describe; FinloopError if one describes none."""
    return tuple(map(parse_force, texts))


def parse_force(text: str) -> Force:
    """Return the force that a text describes; FinloopError if it has none of the FORMS."""
    kind, _, values = text.partition("=")
    if kind not in KINDS:
        raise _form_error(text, f"{kind!r} is none of {', '.join(KINDS)}")
    declared = KINDS[kind]
    main, *others = fields(declared)
    words = values.split(",")
    number = next((k for k, word in enumerate(words) if "=" in word), len(words))
    options = dict[str, float]()
    for word in words[number:]:
        name, equals, value = word.partition("=")
        if not equals or name not in [field.name for field in others]:
            raise _form_error(text, f"{word!r} is no option of {kind}")
        options[name] = _parse_number(text, value)
    first = _parse_main_value(text, kind, words[:number])
    for name, size in options.items():
        if size < 0 or (size == 0 and name not in _LEAST_ZERO):
            limit = "0 or more" if name in _LEAST_ZERO else "above 0"
            raise _form_error(text, f"{name} is {size:g}, not {limit}")
    force: Force = declared(**{main.name: first}, **options)
    return force


def _parse_main_value(text: str, kind: str, words: list[str]) -> float | tuple[float, float] | str:
    """Return the first value of a force's text: a number, two, or the id of a shape.

    text: the whole force, for messages; words: what stands between commas before the options.
    FinloopError if it is no value of this kind of force.
    """
    wanted: dict[str, tuple[int, bool]] = {  # how many numbers, and whether an id will do
        "gravity": (1, False), "wind": (2, False), "attraction": (2, True),
        "floor": (1, True), "hold": (0, True),
    }  # fmt: skip
    count, may_be_id = wanted[kind]
    if count and len(words) == count and (not may_be_id or all(map(_is_number, words))):
        numbers = [_parse_number(text, word) for word in words]
        return numbers[0] if count == 1 else (numbers[0], numbers[1])
    identifier = ",".join(words)
    if may_be_id and identifier and not (count and any(map(_is_number, words))):
        return identifier
    raise _form_error(text, f"{identifier!r} is no value of {kind}")


def _is_number(word: str) -> bool:
    """Return whether a word is written as a number, finite or not."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _parse_number(text: str, word: str) -> float:
    """Return a word of a force's text as a number; FinloopError if it is none, or too large."""
    if not _is_number(word) or not abs(float(word)) <= LARGEST:
        raise _form_error(text, f"{word!r} is no number of size {LARGEST:g} at most")
    return float(word)


def _form_error(text: str, reason: str) -> FinloopError:
    """Return the error that a text describes no force."""
    return FinloopError(f"the force {text!r}: {reason}", FORMS, "write one of these")
