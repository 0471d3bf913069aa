"""Rules towards a live animal: laws of the places that the fish swim to."""

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from finloop.animate.arena import make_tank as arena_tank
from finloop.stimulus.animals import Animal, TankGeometry
from finloop.stimulus.protocol import RuleSpec
from finloop.stimulus.rules import find_rule_target, mirror_place

RULES = get_args(RuleSpec.model_fields["rule"].annotation)
LENGTH = 40.0
SEA = TankGeometry(1001, 1001, LENGTH, lambda x, y: (x, y))  # no walls
MIDDLE = 500.0
POOL = arena_tank(np.ones((300, 400), bool), 15.0)
WALLED = TankGeometry(400, 300, LENGTH, POOL.nearest_legal_point)
NOW = 100.0


class Sightings:
    """AnimalSettings at rest, or where `way` has each at a time."""

    def __init__(self, *animals, way=None):
        self.animals, self.way = animals, way

    def present_animals(self, now_s):
        if self.way is None:
            return list(self.animals)
        x, y = self.way(now_s)
        return [one._replace(x=x, y=y) for one in self.animals]

    def find_past_place(self, id, time_s):
        some = [one for one in self.present_animals(time_s) if one.id == id]
        return (some[0].x, some[0].y) if some else None


def animal(x, y, heading=0.0, id="1"):
    return Animal(id, x, y, heading, 0.0, NOW)


def spec(rule, **how):
    return RuleSpec(rule=rule, **how)


def aim_of(rule, own, others, now=NOW, tank=SEA, **how):
    """Where a rule sends a fish."""
    return find_rule_target(spec(rule, **how), own, others, now, tank)


def rotate(x, y, angle):
    """A place turned about the middle of the sea, anticlockwise as seen."""
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = x - MIDDLE, y - MIDDLE
    return MIDDLE + x * cos + y * sin, MIDDLE - x * sin + y * cos


coordinates = st.floats(100, 900)
angles = st.floats(-math.pi, math.pi)
scenes = st.tuples(coordinates, coordinates, angles, coordinates, coordinates, angles)
laws = settings(max_examples=25)


def apart(scene, least=1.0):
    return math.hypot(scene[0] - scene[3], scene[1] - scene[4]) > least


# --- symmetry


def mirror(x, y):
    return 1000 - x, y


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("mirrored", [False, True])
@laws
@given(scenes, angles, st.floats(0.5, 30))
def test_a_scene_that_is_turned_or_mirrored_has_its_aim_turned_or_mirrored(
    rule, mirrored, scene, angle, distance
):
    how = {} if rule in ("approach", "copy", "mirror") else {"distance": distance}
    x, y, heading, to_x, to_y, to_heading = scene
    at_distance = abs(math.hypot(x - to_x, y - to_y) - distance * SEA.length_px) < 1e-6
    if at_distance or not apart(scene):  # by the last bit near or far
        return

    def moved_place(x, y):
        return mirror(x, y) if mirrored else rotate(x, y, angle)

    def moved_heading(heading):
        return math.pi - heading if mirrored else heading + angle

    other = Sightings(animal(to_x, to_y, to_heading))
    plain = aim_of(rule, (x, y, heading), other, **how)
    own = *moved_place(x, y), moved_heading(heading)
    other = Sightings(animal(*moved_place(to_x, to_y), moved_heading(to_heading)))
    wanted = None if plain is None else pytest.approx(moved_place(*plain), abs=1e-6)
    assert aim_of(rule, own, other, **how) == wanted


@pytest.mark.parametrize("rule", RULES)
@laws
@given(scenes, st.floats(0.5, 30), st.floats(-1e3, 2e3))
def test_every_aim_is_where_a_fish_can_be(rule, scene, distance, far):
    how = {} if rule in ("approach", "copy", "mirror") else {"distance": distance}
    x, y, heading, _, to_y, to_heading = scene
    own = (*POOL.nearest_legal_point(x / 2.5, y / 3.4), heading)
    place = aim_of(rule, own, Sightings(animal(far, to_y, to_heading)), tank=WALLED, **how)
    assert place is None or POOL.nearest_legal_point(*place) == place


@pytest.mark.parametrize("rule", RULES)
def test_a_still_animal_gives_a_constant_aim_and_no_animal_gives_none(rule):
    own, still = (520.0, 480.0, 1.0), Sightings(animal(500.0, 500.0, 0.3))
    aims = {aim_of(rule, own, still, now=now) for now in np.arange(0, 90, 7.3)}
    assert len(aims) == 1 and None not in aims
    assert aim_of(rule, own, Sightings()) is None
    assert aim_of(rule, own, still, animal="2") is None


# --- each rule


def test_distances_are_body_lengths_of_the_fish():
    own, there = (500.0, 400.0, 0.0), Sightings(animal(500.0, 500.0, math.pi / 2))  # it looks up
    for length in (10.0, 40.0):
        tank = SEA._replace(length_px=length)

        def place(rule, tank=tank, **how):
            return pytest.approx(aim_of(rule, own, there, tank=tank, **how))

        assert place("approach") == (500.0, 500.0)
        assert (500.0, 500 + 3 * length) == place("follow", distance=3)
        assert (500.0, 500 - 3 * length) == place("lead", distance=3)
        assert (500.0, 500 - 2 * length) == place("keep distance", distance=2)


@laws
@given(scenes, st.floats(0.1, 30))
def test_keep_distance_is_so_far_from_the_animal_and_towards_the_fish(scene, distance):
    x, y, heading, to_x, to_y, _ = scene
    there = Sightings(animal(to_x, to_y))
    place = aim_of("keep distance", (x, y, heading), there, distance=distance)
    assert math.dist(place, (to_x, to_y)) == pytest.approx(distance * LENGTH)
    far = math.hypot(x - to_x, y - to_y)
    assert math.dist(place, (x, y)) == pytest.approx(abs(far - distance * LENGTH), abs=1e-6)


@laws
@given(scenes)
def test_who_follows_and_who_leads_are_on_either_side(scene):
    own, there = scene[:3], Sightings(animal(*scene[3:]))
    behind, ahead = (aim_of(rule, own, there, distance=2) for rule in ("follow", "lead"))
    assert np.add(behind, ahead) / 2 == pytest.approx(scene[3:5])
    assert math.dist(behind, ahead) == pytest.approx(4 * LENGTH)


@pytest.mark.parametrize("rule", ["follow", "lead"])
def test_a_heading_that_is_not_known_yet_is_no_reason_to_turn(rule):
    own, there = (600.0, 500.0, 2.0), Sightings(animal(500.0, 500.0, None))
    assert aim_of(rule, own, there) == (500 + LENGTH, 500)


def test_a_copy_is_where_the_animal_was_exactly():
    def animal_place(t):
        return 500 + 90 * math.sin(t), 500 + 70 * math.cos(0.7 * t)

    for delay in (0.0, 0.5, 7.3):
        there = Sightings(animal(0, 0), way=animal_place)
        assert aim_of("copy", (0, 0, 0), there, delay_s=delay) == animal_place(NOW - delay)
    there.find_past_place = lambda id, time_s: None
    assert aim_of("copy", (0, 0, 0), there) is None


@laws
@given(st.floats(0, 399), st.floats(0, 299), st.sampled_from(["x", "y", "centre"]))
def test_a_mirror_is_an_involution_about_the_middle(x, y, axis):
    image = mirror_place((x, y), axis, WALLED)
    assert mirror_place(image, axis, WALLED) == pytest.approx((x, y))
    middle = (x + image[0]) / 2, (y + image[1]) / 2
    assert middle == pytest.approx((x if axis == "y" else 199.5, y if axis == "x" else 149.5))


def test_both_mirrors_together_are_the_centre():
    there = Sightings(animal(100.0, 90.0))
    one = aim_of("mirror", (0, 0, 0), there, axis="x", tank=WALLED)
    both = aim_of("mirror", (0, 0, 0), Sightings(animal(*one)), axis="y", tank=WALLED)
    assert aim_of("mirror", (0, 0, 0), there, tank=WALLED) == both == (299, 209)


def test_the_nearest_animal_counts_or_the_one_that_is_named():
    there = Sightings(
        animal(500.0, 500.0, id="b"), animal(600.0, 500.0, id="a"), animal(700.0, 500.0, id="c")
    )
    assert aim_of("approach", (640, 500, 0), there) == (600, 500)
    assert aim_of("approach", (550, 500, 0), there) == (600, 500)  # as near: a before b
    assert aim_of("approach", (500, 500, 0), there, animal="c") == (700, 500)


# --- away


@laws
@given(scenes, st.floats(1, 30))
def test_in_open_water_the_fish_flees_straight_and_only_from_what_is_near(scene, distance):
    x, y, heading, to_x, to_y, _ = scene
    far = math.hypot(x - to_x, y - to_y)
    place = aim_of("avoid", (x, y, heading), Sightings(animal(to_x, to_y)), distance=distance)
    assert (place is None) == (far >= distance * LENGTH)
    if place is not None and far > 1:
        away, ahead = np.array([x - to_x, y - to_y]) / far, np.subtract(place, (x, y))
        assert ahead @ away == pytest.approx(np.hypot(*ahead))
        assert np.hypot(*ahead) > distance * LENGTH


def test_before_a_wall_the_fish_flees_along_it_to_the_side_it_looks_to():
    wall = POOL.nearest_legal_point(0, 150)[0]
    for heading, side in ((math.pi / 2, -1), (-math.pi / 2, 1)):
        own = wall, 150.0, heading
        x, y = aim_of("avoid", own, Sightings(animal(wall + 50, 150.0)), distance=2, tank=WALLED)
        assert x < wall + 10 and side * (y - 150) > LENGTH


@pytest.mark.parametrize("corner", [(0, 0), (399, 0), (0, 299), (399, 299)])
def test_a_fish_in_a_corner_gets_out_of_it_and_one_before_it_does_not_get_in(corner):
    end = np.array(POOL.nearest_legal_point(*corner))
    inwards = np.sign(np.array([199.5, 149.5]) - end)
    for start, near in ((0, 40), (30, 55), (40, 80)):  # in the corner, and before it
        own, other = end + start * inwards, end + (start + near) * inwards * [1, 0.9]
        for heading in np.linspace(-3, 3, 7):
            there = Sightings(animal(*other))
            place = aim_of("avoid", (*own, heading), there, distance=3, tank=WALLED)
            assert np.abs(place - end).max() > 1.5 * LENGTH


def test_a_chased_fish_does_not_end_in_a_corner():
    """A fish that swims to its aim a bit faster than an animal that chases it stays ahead of it."""
    own, chaser, heading, gaps = np.array([200.0, 150.0]), np.array([160.0, 160.0]), 0.0, []
    for _ in range(600):
        there = Sightings(animal(*chaser))
        place = aim_of("avoid", (*own, heading), there, distance=2.5, tank=WALLED)
        if place is not None:
            step = np.subtract(place, own)
            own = own + step * min(1, 5.0 / max(np.hypot(*step), 1e-9))
            heading = math.atan2(-step[1], step[0])
        step = own - chaser
        chaser = chaser + step * min(1, 3.0 / max(np.hypot(*step), 1e-9))
        gaps.append(math.dist(own, chaser))
    assert min(gaps) > 0.6 * LENGTH


# --- the protocol's part


USES = {
    "approach": (), "keep distance": ("distance",), "follow": ("distance",), "lead": ("distance",),
    "avoid": ("distance",), "copy": ("delay_s",), "mirror": ("axis",),
}  # fmt: skip


@pytest.mark.parametrize("rule", RULES)
def test_what_a_rule_has_no_use_for_is_refused(rule):
    for name, value in {"distance": 2.0, "delay_s": 3.0, "axis": "x"}.items():
        if name in USES[rule]:
            assert getattr(spec(rule, **{name: value}), name) == value
        else:
            with pytest.raises(ValidationError, match=f"{name} is of"):
                spec(rule, **{name: value})
    whole = spec(rule)
    assert RuleSpec.model_validate_json(whole.model_dump_json()) == whole


@pytest.mark.parametrize("bad", [
    {"rule": "attack"}, {"rule": "follow", "distance": 0}, {"rule": "follow", "distance": "1"},
    {"rule": "follow", "distance": math.inf}, {"rule": "copy", "delay_s": -1}, {"rule": "copy", "delay_s": 61},
    {"rule": "approach", "renew": -0.1}, {"rule": "approach", "renew": math.nan}, {"rule": "approach", "animal": ""},
    {"rule": "approach", "animal": 1}, {"rule": "mirror", "axis": "z"}, {"rule": "approach", "speed": 1}, {},
])  # fmt: skip
def test_a_rule_is_strict(bad):
    with pytest.raises(ValidationError):
        RuleSpec(**bad)
