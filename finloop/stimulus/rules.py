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
_REACH = 1.5  # times the distance to keep: how far away the compared places of escape are
_ESCAPE_TURNS = [sign * math.radians(step) for step in range(0, 121, 15) for sign in (1, -1)]
"""Directions of escape that are compared: angles from straight away, to the left and right."""
_TURN_COST = 0.05  # of a turn by half a circle, as a share of the animal's distance: settles ties
_LEAST_PX = 1e-6  # between two places; nearer ones have no direction


def find_rule_target(
    rule: RuleSpec, fish: Pose, animals: LiveAnimals, now_s: float, tank: TankGeometry
) -> PlacePx | None:
    """Return the place (x, y px) to which a rule sends a fish; None: the fish wanders.

    fish: its x, y [px] and heading [rad]; now_s: session time. It wanders if the animal is absent,
    if it shall copy an unknown past of the animal, or avoid an animal that is far away.
    """
    present = animals.present_animals(now_s)
    candidates = [animal for animal in present if rule.animal in (NEAREST, animal.id)]
    if not candidates:
        return None
    # The nearest; the id decides between equally near ones.
    animal = min(candidates, key=lambda one: (math.dist((one.x, one.y), fish[:2]), one.id))
    place, distance_px = (animal.x, animal.y), rule.distance * tank.length_px
    match rule.rule:
        case "approach":
            return tank.nearest_place(*place)
        case "copy":
            past = animals.find_past_place(animal.id, now_s - rule.delay_s)
            return None if past is None else tank.nearest_place(*past)
        case "mirror":
            return tank.nearest_place(*mirror_place(place, rule.axis, tank))
        case "avoid":
            return _escape_place(fish, place, distance_px, tank)
    x, y = _side_of_animal(rule.rule, fish, animal)
    return tank.nearest_place(place[0] + distance_px * x, place[1] + distance_px * y)


def mirror_place(place: PlacePx, axis: str, tank: TankGeometry) -> PlacePx:
    """Return the mirror image (x, y px) of a place in the tank.

    axis: "x" exchanges left and right, "y" top and bottom, "centre" both.
    """
    x, y = place
    return (
        x if axis == "y" else tank.width - 1 - x,
        y if axis == "x" else tank.height - 1 - y,
    )  # fmt: skip


def _side_of_animal(rule: str, fish: Pose, animal: Animal) -> Direction:
    """Return the unit direction from an animal to the side on which a fish shall swim.

    The rule decides: "keep distance" where the fish is now, "lead" ahead of the animal, "follow"
    behind it. While the animal's heading is unknown, each is the side where the fish is now.
    """
    if rule == "keep distance" or animal.heading_rad is None:
        return _direction_to_fish((animal.x, animal.y), fish)
    x, y = math.cos(animal.heading_rad), -math.sin(animal.heading_rad)
    return (x, y) if rule == "lead" else (-x, -y)


def _direction_to_fish(start: PlacePx, fish: Pose) -> Direction:
    """Return the unit direction from a place to the fish; its heading if it is at the place."""
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
    x, y, heading_rad = fish
    animal_distance_px = math.dist((x, y), animal)
    if animal_distance_px >= distance_px:
        return None
    away_x, away_y = _direction_to_fish(animal, fish)
    reach_px, scored = _REACH * distance_px, []
    for angle in _ESCAPE_TURNS:
        cos, sin = math.cos(angle), math.sin(angle)
        escape_x, escape_y = away_x * cos - away_y * sin, away_x * sin + away_y * cos
        place = tank.nearest_place(x + reach_px * escape_x, y + reach_px * escape_y)
        # The fish's turn into this direction, from 0 to 1 half turn, settles ties.
        cos_turn = escape_x * math.cos(heading_rad) - escape_y * math.sin(heading_rad)
        half_turns = math.acos(max(-1.0, min(1.0, cos_turn))) / math.pi
        gain_px = math.dist(place, animal) + math.dist(place, (x, y))
        scored.append((gain_px - _TURN_COST * animal_distance_px * half_turns, place))
    return max(scored)[1]
