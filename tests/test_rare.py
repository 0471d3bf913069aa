"""What a step costs that the film seldom shows: laws, and what a fish makes of it."""

import numpy as np
import pytest

from finloop.animate.kinematics import turn_towards_aim, wrap
from finloop.edit.bodies import measure_movement
from finloop.plan.cost import Rarity
from finloop.puppet import Pose

SPRING = np.array([1.0, 0.7, 0.3, 0.1])


def pose_of(heading_deg, bend):
    """Fish of two straight halves, bent by `bend` (n,) radians between."""
    n = len(bend)
    posture = np.zeros((n, 6))
    posture[:, 0], posture[:, 4:] = 0.5, 0.5
    posture[:, 3] = bend
    zero = np.zeros(n)
    return Pose(zero, zero, np.radians(heading_deg), zero + 1, posture)


def rarity_of(heading_deg, bend, seen=np.nan, share=0.1):
    goes_on = np.arange(len(bend)) < len(bend) - 1
    seen = np.full(len(bend), seen) if np.ndim(seen) == 0 else seen
    moved = measure_movement(pose_of(heading_deg, bend))
    return Rarity.from_movement(moved, bend[:, None], goes_on, seen, SPRING, share)


def test_a_step_costs_its_share_of_the_time_that_the_film_takes_for_as_large_a_one():
    seen = np.array([4.0, 1.0, 2.0, 2.0, np.nan])
    made = rarity_of(np.zeros(5), np.linspace(0, 0.4, 5), seen, share=0.5)
    assert made.steps == pytest.approx([0, 4, 1, 2, 2])
    costs = made.step_costs(np.array([0.5, 1, 2, 3, 4, 9]))
    assert costs == pytest.approx([0.5, 0.5, 0.5 * 4 / 3, 2, 2, 2])
    assert made.cumulative_row_costs[-1] == pytest.approx(0)  # on average over the film nothing


def test_where_a_step_is_not_known_the_bodys_movement_stands_in():
    rng = np.random.default_rng(0)
    heading, bend = rng.normal(0, 20, 40).cumsum(), rng.normal(0, 0.2, 40)
    moved, bends = measure_movement(pose_of(heading, bend))
    seen = np.append(3 * moved, np.nan)
    seen[10:30] = np.nan
    assert rarity_of(heading, bend, seen).steps[1:] == pytest.approx(3 * moved)
    assert bends.max() < moved.max()
    assert measure_movement(pose_of(heading, np.zeros(40))).bends == pytest.approx(0)
    spun = measure_movement(pose_of(np.array([10.0, 100.0]), np.zeros(2))).whole
    assert spun == pytest.approx(np.sqrt((0.5 + 0 + 0.5) / 3))  # by 90 degrees: √2 · radius
    placed = pose_of(heading, bend)
    lines = placed.move_to(0.0, 0.0, placed.heading_rad, 1.0).backbone_px()
    assert moved == pytest.approx(np.sqrt((np.diff(lines, axis=0) ** 2).sum(-1).mean(-1)))
    turned = pose_of(heading + 70, bend)
    assert measure_movement(turned).whole == pytest.approx(moved)


def test_a_join_costs_more_the_farther_it_is_and_going_on_costs_nothing():
    rng = np.random.default_rng(1)
    made = rarity_of(rng.normal(0, 20, 60).cumsum(), rng.normal(0, 0.2, 60), 1.0 + rng.random(60))
    codes = np.zeros((120, 2))
    codes[[21, 22], 0] = 0.5, 1.0
    costs = [made.transition_costs(np.array([5, 65]), codes, row) for row in (20, 21, 22)]
    (near, _), (middle, _), (far, image) = costs  # 65: the mirror image of row 5
    assert near == 0 < middle <= far == image


def test_a_fish_on_the_spot_turns_no_faster_than_its_pictures_or_than_it_may():
    rng = np.random.default_rng(2)
    for own, error, most in rng.uniform((-20, -150, 0), (20, 150, 12), (300, 3)):
        turn = turn_towards_aim(own, error, most)
        assert abs(turn) <= max(abs(own), most) + 1e-9
        assert abs(turn - own) <= most + 1e-9
        assert abs(wrap(error - turn)) <= abs(wrap(error - own)) + 1e-9
