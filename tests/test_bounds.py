"""Whether a picture is inside the tank: against the pixels of its outline."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from toy_film import HULL, LENGTH, film_world_of, matching_of, open_tank

from finloop.animate.arena import is_legal_point, make_tank
from finloop.animate.encounters import place_outline
from finloop.animate.kinematics import Target
from finloop.animate.obstacles import cover_with_discs
from finloop.plan.walls import fits_in_tank, keep_inside, push_inside, tank_bounds

BENT = np.array([[30.0, 4], [0, -6], [-30, 12], [-34, 16], [-2, 4]])


def pool():
    """A tank with a bay, and the bounds of a fish of two pictures, one of them bent."""
    arena = np.zeros((240, 320), bool)
    arena[20:220, 30:290] = True
    arena[20:90, 30:100] = False
    bodies = np.stack([np.concatenate([HULL, HULL[:2]]), BENT])
    discs = cover_with_discs(bodies, [])
    return make_tank(arena, 40.0), tank_bounds(make_tank(arena, 40.0), discs), bodies


def shown_inside(arena, hull, place, mirrored=False):
    """Whether every pixel of an outline is inside."""
    mask = np.zeros((400, 500), np.uint8)
    corners = place_outline(hull, *place, mirrored) + 50
    cv2.fillPoly(mask, [np.rint(16 * corners).astype(np.int32)], 1, shift=4)
    return bool(np.pad(arena, 50)[mask[:340, :420] > 0].all()) and not mask[340:].any()


@pytest.mark.parametrize("mirrored", [False, True])
def test_what_fits_has_every_pixel_inside_and_what_is_well_inside_fits(mirrored):
    water, bounds, bodies = pool()
    rng, counts = np.random.default_rng(0), {True: 0, False: 0}
    for _ in range(1500):
        picture = int(rng.integers(2))
        place = rng.uniform(20, 300), rng.uniform(10, 230), rng.uniform(-180, 180)
        free = fits_in_tank(bounds, picture + 2 * mirrored, *place)
        counts[free] += 1
        if free:
            assert shown_inside(water.arena, bodies[picture], place, mirrored)
        elif is_legal_point(water.arena, *place[:2]):
            assert not shown_inside(water.depth_px > 10, bodies[picture], place, mirrored)
    assert min(counts.values()) > 250


def test_every_picture_fits_where_the_tank_is_roomy():
    water, bounds, _ = pool()
    rng = np.random.default_rng(1)
    for y, x in rng.permutation(np.argwhere(water.legal))[:300]:
        assert fits_in_tank(
            bounds, int(rng.integers(4)), float(x), float(y), rng.uniform(-180, 180)
        )


def test_a_fish_without_discs_fits_where_the_tank_is_roomy_alone():
    legal = np.ones((50, 70), bool)  # no whole number of cells
    rng = np.random.default_rng(7)
    legal[rng.integers(50, size=20), rng.integers(70, size=20)] = False
    bounds = tank_bounds(open_tank())._replace(roomy=legal)
    whole = np.pad(legal, [(0, 14), (0, 10)], constant_values=True)
    bounds = bounds._replace(roomy_cells=whole.reshape(4, 16, 5, 16).all(axis=(1, 3)))
    for x, y in rng.uniform(-20, 90, (2000, 2)):
        assert fits_in_tank(bounds, 0, x, y, 0.0) == is_legal_point(legal, x, y)


def test_a_place_at_a_wall_is_moved_straight_off_it():
    _, bounds, _ = pool()
    x, y, free = push_inside(bounds, 0, 200.0, 26.0, 90.0)  # its nose is 14 px behind the wall
    assert free and x == pytest.approx(200, abs=1) and 40 < y < 55
    assert push_inside(bounds, 0, x, y, 90.0) == (x, y, True)
    along = push_inside(bounds, 0, 200.0, 26.0, 0.0)
    assert along[2] and 26 <= along[1] < y - 5  # there is room along a wall


def test_a_way_inside_is_left_as_it_is_and_one_into_a_wall_slides_along_it():
    _, bounds, _ = pool()
    numbers = np.zeros(60, np.int64)
    way = np.column_stack([np.linspace(150, 250, 60), np.full(60, 120.0), np.zeros(60)])
    assert np.array_equal(keep_inside(bounds, numbers, way, 3.0), way)
    way[:, 1] = np.linspace(60, 20, 60)
    slid = keep_inside(bounds, numbers, way, 3.0)
    assert len(slid) == 60 and np.array_equal(slid[:, 0], way[:, 0])
    assert all(fits_in_tank(bounds, 0, *place) for place in slid)
    assert np.abs(np.diff(slid[-9:, 1])).max() < 1.5
    way[30:, 1] = 0.0  # far behind the wall at once
    assert len(keep_inside(bounds, numbers, way, 3.0)) == 30


def test_a_fish_in_a_slot_in_which_it_cannot_turn_backs_out_of_it():
    arena = np.zeros((300, 300), bool)
    arena[100:200, 20:160] = True
    arena[138:162, 160:260] = True  # too narrow for the fish to turn in
    player = matching_of(film_world_of(room_=make_tank(arena, 0.6 * LENGTH)))
    own_world = replace(player.world, discs=player.silhouettes.discs)
    player, rng = replace(player, world=own_world), np.random.default_rng(0)
    keeper = player._fallback
    fish = player.begin(rng).fish._replace(x=232.0, y=150.0, heading=0.0)
    fish = fish._replace(rotation_deg=-float(own_world.film.heading[fish.row]))
    *_, ahead = keeper._in_place_stretches(fish, Target(0, 0, 0, 0))
    ahead = replace(
        ahead, trajectory=np.repeat([[300.0, 150.0, 0.0]], len(ahead.trajectory), axis=0)
    )
    places = []
    while fish.tick < 500:
        fish = player._fish_after(fish, keeper.keep_clear(fish, ahead))
        places.append((fish.x, fish.y, fish.heading))
        assert fits_in_tank(own_world.bounds, fish.row, *places[-1])
    steps = -np.diff(np.array(places)[:, 0])
    assert steps.min() >= 0 and steps.max() < LENGTH / 4
    assert own_world.tank.legal[round(fish.y), round(fish.x)]
