"""Rules towards a live animal: where a fish swims to, given where the animal is or was.

A rule is a pure function of the fish, the known animals, and the time. Lengths are in body lengths
of the fish, so a rule means the same in any film.
"""

import math

from finloop.stimulus.animals import Animal, LiveAnimals, PlacePx, TankGeometry
from finloop.stimulus.protocol import NEAREST, RuleSpec

Pose = tuple[float, float, float]
"""The fish itself: x, y px, heading_rad."""
Direction = tuple[float, float]
"""A direction, of length 1, x to the right and y down."""
_REACH = 1.5  # times the distance from an animal: length of the ways of escape that are compared
_TURNS = [sign * math.radians(step) for step in range(0, 121, 15) for sign in (1, -1)]
"""Ways of escape that are compared: angles from straight away, either way round."""
_TURN_COST = 0.05  # of a turn by half a circle, as a share of the animal's distance: settles ties
_LEAST_PX = 1e-6  # between two places; nearer ones have no direction


def find_rule_target(
    rule: RuleSpec, fish: Pose, animals: LiveAnimals, now_s: float, tank: TankGeometry
) -> PlacePx | None:
    """Return the place (x, y px) to which a rule sends a fish; None: the fish wanders.

    fish: x, y [px] and heading [rad] of it. It wanders without an animal, and in the rule `avoid`
    also far from it. now_s: session time.
    """
    named = [one for one in animals.present_animals(now_s) if rule.animal in (NEAREST, one.id)]
    if not named:
        return None
    # Of equally near ones it is the first by id.
    animal = min(named, key=lambda one: (math.dist((one.x, one.y), fish[:2]), one.id))
    place, distance_px = (animal.x, animal.y), rule.distance * tank.length_px
    match rule.rule:
        case "approach":
            return tank.into(*place)
        case "copy":
            past = animals.find_past_place(animal.id, now_s - rule.delay_s)
            return None if past is None else tank.into(*past)
        case "mirror":
            return tank.into(*mirror_place(place, rule.axis, tank))
        case "avoid":
            return _escape_place(fish, place, distance_px, tank)
    x, y = _side_of_animal(rule.rule, fish, animal)
    return tank.into(place[0] + distance_px * x, place[1] + distance_px * y)


def mirror_place(place: PlacePx, axis: str, tank: TankGeometry) -> PlacePx:
    """Return the mirror image (x, y px) of a place in the tank; axis: see `RuleSpec.axis`."""
    x, y = place
    return tank.width - 1 - x if axis != "y" else x, tank.height - 1 - y if axis != "x" else y


def _side_of_animal(rule: str, fish: Pose, animal: Animal) -> Direction:
    """Return on which side of an animal a fish shall swim: the unit direction from the animal.

    The rule decides: "keep distance" where the fish is, "lead" ahead of the animal, "follow"
    behind. The heading of an animal that has not moved yet is unknown: the fish keeps its distance
    then.
    """
    if rule == "keep distance" or animal.heading_rad is None:
        return _direction_to_fish((animal.x, animal.y), fish)
    x, y = math.cos(animal.heading_rad), -math.sin(animal.heading_rad)
    return (x, y) if rule == "lead" else (-x, -y)


def _direction_to_fish(start: PlacePx, fish: Pose) -> Direction:
    """Return the direction from a place to the fish; where both are equal, the fish's heading."""
    x, y = fish[0] - start[0], fish[1] - start[1]
    distance = math.hypot(x, y)
    if distance <= _LEAST_PX:
        return math.cos(fish[2]), -math.sin(fish[2])
    return x / distance, y / distance


def _escape_place(
    fish: Pose, animal: PlacePx, distance_px: float, tank: TankGeometry
) -> PlacePx | None:
    """Return the place to which a fish escapes from an animal; None while the animal is far away.

    animal: its place. distance_px: nearer animals make the fish escape. Of several places around,
    moved into the tank, the best one is farthest from the animal and from the fish. In open water
    that is straight away from the animal, before a wall along the wall, and in a corner out of it.
    """
    here = fish[:2]
    if (now_px := math.dist(here, animal)) >= distance_px:
        return None
    away, scored = _direction_to_fish(animal, fish), []
    for angle in _TURNS:
        cos, sin = math.cos(angle), math.sin(angle)
        way = away[0] * cos - away[1] * sin, away[0] * sin + away[1] * cos
        reach_px = _REACH * distance_px
        place = tank.into(here[0] + reach_px * way[0], here[1] + reach_px * way[1])
        along = way[0] * math.cos(fish[2]) - way[1] * math.sin(fish[2])
        turn = math.acos(max(-1.0, min(1.0, along))) / math.pi
        gain_px = math.dist(place, animal) + math.dist(place, here)
        scored.append((gain_px - _TURN_COST * now_px * turn, place))
    return max(scored)[1]
