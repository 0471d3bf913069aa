"""Rules towards a live animal: where a fish swims to, given where the animal is or was.

A rule is a pure function of the fish, the known animals, and the time. Lengths are in body lengths
of the fish, so a rule means the same in any film.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Literal, NamedTuple, Protocol

from pydantic import BaseModel, ConfigDict, Field, model_validator

Aim = tuple[float, float]
"""The place that a fish swims to, px."""
Own = tuple[float, float, float]
"""The fish itself: x, y, heading_rad."""
Way = tuple[float, float]
"""A direction, of length 1, x to the right and y down."""

NEAREST = "nearest"
MOST_DELAY_S = 60.0
_FIELDS = {
    "distance": ("keep distance", "follow", "lead", "avoid"),
    "delay_s": ("copy",),
    "axis": ("mirror",),
}
_REACH = 1.5  # times the distance from an animal: length of the ways of escape that are compared
_TURNS = [sign * math.radians(step) for step in range(0, 121, 15) for sign in (1, -1)]
"""Ways of escape that are compared: angles from straight away, either way round."""
_TURN = (
    0.05  # what a turn by half a circle costs, as a share of the animal's distance: settles ties
)
_LEAST_PX = 1e-6  # between two places; nearer ones have no direction


class RuleSpec(BaseModel):
    """How the fish react to a live animal."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False,
        use_attribute_docstrings=True,
    )  # fmt: skip

    rule: Literal["approach", "keep distance", "follow", "lead", "avoid", "copy", "mirror"]
    """approach: to the animal; keep distance: at `distance` from it, on the line from it to the
    fish; follow: `distance` behind it; lead: `distance` ahead of it; avoid: away while it is
    nearer than that; copy: to where it was some time ago; mirror: to its mirror image."""
    animal: Annotated[str, Field(min_length=1, max_length=40)] = NEAREST
    """The tracker's id of an animal, or nearest: the one nearest to the fish."""
    distance: Annotated[float, Field(gt=0, le=100)] = 1.0
    """Body lengths, above 0..100; of keep distance, follow, lead and avoid."""
    delay_s: Annotated[float, Field(ge=0, le=MOST_DELAY_S)] = 1.0
    """How long ago the animal was where the fish swims to, s, 0..60; of copy."""
    axis: Literal["x", "y", "centre"] = "centre"
    """What is mirrored about the tank's middle: x (left and right change places), y (top and
    bottom), or centre (both); of mirror."""
    renew: Annotated[float, Field(ge=0, le=10)] = 0.25
    """Body lengths, 0..10, by which the place must move before the fish decides anew."""

    @model_validator(mode="after")
    def _refuse_unused_values(self) -> "RuleSpec":
        """Refuse a value that the rule does not use: the user would expect an effect."""
        for name, rules in _FIELDS.items():
            given = getattr(self, name) != RuleSpec.model_fields[name].default
            if given and self.rule not in rules:
                raise ValueError(f"{name} is of {', '.join(rules)}; {self.rule} has none")
        return self


class TankGeometry(NamedTuple):
    """The tank as rules need it: its width and height, and the body length of a fish, px.

    into: returns the place nearest to x, y (px) where the centre of a fish can be.
    """

    width: float
    height: float
    length_px: float
    into: Callable[[float, float], tuple[float, float]]


class Present(Protocol):
    """A live animal that is present, in the tank's picture."""

    @property
    def id(self) -> str:
        """Return the animal's id, as the tracker names it."""
        ...

    @property
    def x(self) -> float:
        """Return the animal's x, px to the right."""
        ...

    @property
    def y(self) -> float:
        """Return the animal's y, px downwards."""
        ...

    @property
    def heading_rad(self) -> float | None:
        """Return the animal's heading, rad anticlockwise as seen; None while it is unknown."""
        ...


class Known(Protocol):
    """The known animals: `finloop.stimulus.animals.LiveAnimals`, or a test's."""

    def present_animals(self, now_s: float) -> Sequence[Present]:
        """Return the animals that are present at a session time, s."""
        ...

    def past(self, id: str, time_s: float) -> tuple[float, float] | None:
        """Return where an animal was (x, y px) at a session time, s; None: unknown."""
        ...


def aim(rule: RuleSpec, own: Own, animals: Known, now_s: float, tank: TankGeometry) -> Aim | None:
    """Return the place (x, y px) that a rule sends a fish to; None: the fish wanders.

    It wanders without an animal, and in the rule `avoid` also far from it. own: x, y (px), heading
    (rad) of the fish; now_s: session time, s.
    """
    animal = _animal(rule.animal, own, animals.present_animals(now_s))
    if animal is None:
        return None
    place = animal.x, animal.y
    match rule.rule:
        case "approach":
            return tank.into(*place)
        case "copy":
            past = animals.past(animal.id, now_s - rule.delay_s)
            return None if past is None else tank.into(*past)
        case "mirror":
            return tank.into(*mirror_place(place, rule.axis, tank))
        case "avoid":
            return _escape(own, place, rule.distance * tank.length_px, tank)
    way = _beside(rule.rule, own, animal)
    return tank.into(*_point_along(place, way, rule.distance * tank.length_px))


def mirror_place(place: Aim, axis: str, tank: TankGeometry) -> Aim:
    """Return the mirror image (x, y px) of a place in the tank; axis: see `RuleSpec.axis`."""
    x, y = place
    return tank.width - 1 - x if axis != "y" else x, tank.height - 1 - y if axis != "x" else y


def _animal(name: str, own: Own, animals: Sequence[Present]) -> Present | None:
    """Return the animal of that name, or the nearest one; of equally near ones the first by id."""
    some = [one for one in animals if name in (NEAREST, one.id)]
    return min(
        some, key=lambda one: (math.hypot(one.x - own[0], one.y - own[1]), one.id), default=None
    )


def _beside(rule: str, own: Own, animal: Present) -> Way:
    """Return the direction from an animal to the place of keep distance, follow or lead.

    The heading of an animal that has not moved yet is unknown: the fish keeps its distance then.
    """
    if rule == "keep distance" or animal.heading_rad is None:
        return _direction_to_fish((animal.x, animal.y), own)
    x, y = math.cos(animal.heading_rad), -math.sin(animal.heading_rad)
    return (x, y) if rule == "lead" else (-x, -y)


def _direction_to_fish(start: Aim, own: Own) -> Way:
    """Return the direction from a place to the fish; at that very place, the fish's heading."""
    x, y = own[0] - start[0], own[1] - start[1]
    far = math.hypot(x, y)
    return (x / far, y / far) if far > _LEAST_PX else (math.cos(own[2]), -math.sin(own[2]))


def _point_along(start: Aim, way: Way, far: float) -> Aim:
    return start[0] + far * way[0], start[1] + far * way[1]


def _escape(own: Own, animal: Aim, distance_px: float, tank: TankGeometry) -> Aim | None:
    """Return where the fish escapes to; None while the animal is farther than `distance_px`.

    Of several ways out, moved into the tank, the best one gets farthest from the animal and has
    most water ahead. In open water that is straight away from the animal, before a wall along the
    wall, and in a corner out of it.
    """
    if math.dist(own[:2], animal) >= distance_px:
        return None
    return max(_ways_out(own, animal, _REACH * distance_px, tank))[1]


def _ways_out(
    own: Own, animal: Aim, reach_px: float, tank: TankGeometry
) -> Iterator[tuple[float, Aim]]:
    """Yield places in the tank to flee to, each preceded by its score, px."""
    away, far = _direction_to_fish(animal, own), math.dist(own[:2], animal)
    for angle in _TURNS:
        cos, sin = math.cos(angle), math.sin(angle)
        way = away[0] * cos - away[1] * sin, away[0] * sin + away[1] * cos
        place = tank.into(*_point_along(own[:2], way, reach_px))
        clear, ahead = math.dist(place, animal), math.dist(place, own[:2])
        along = way[0] * math.cos(own[2]) - way[1] * math.sin(own[2])
        turn = math.acos(max(-1.0, min(1.0, along))) / math.pi
        yield clear + ahead - _TURN * far * turn, place
