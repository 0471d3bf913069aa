"""Curves in fields of force: gravity, wind, attraction, a floor; closed forms and balances."""

from dataclasses import replace

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.curve.dynamics import Material, Problem, solve_motion, total_energy
from finloop.curve.forces import Attraction, Forces, Wind, find_rest_time, solve_in_forces
from finloop.curve.stiffness import stiffness_matrix

N = 32
ANGLE = np.linspace(0, 2 * np.pi, N, endpoint=False)
RING = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
TIMES = np.linspace(0, 2, 21)


def problem(times=TIMES, bend=0.3, velocity=None, **material) -> Problem:
    """A ring of radius 1, bent to an oval and let go."""
    bent = bend * RING * [1, -1]
    return Problem(RING, bent, Material(**material), times, velocity=velocity)


def middle(motion):
    """The mean place of the points at every time."""
    return motion.displacement.mean(axis=1)


@pytest.mark.parametrize("density", [0.0, 1.0, 2.0])
def test_a_constant_force_is_solved_exactly(density):
    p = problem(density=density, elastic=0.5, mass_damping=0.7)
    gravity = np.array([0.3, 2.0])
    found = solve_in_forces(p, Forces(gravity=(0.3, 2.0)), substeps=3)
    exact = solve_motion(replace(p, force=density * gravity))
    np.testing.assert_allclose(found.displacement, exact.displacement, atol=1e-9)
    # Without mass, the velocity at the start is not given but follows from the force.
    np.testing.assert_allclose(found.velocity[1:], exact.velocity[1:], atol=1e-9)


def test_a_free_fall_is_exact_in_the_mean_and_keeps_the_energy():
    p = problem(density=2.0, elastic=0.5)
    found = solve_in_forces(p, Forces(gravity=(0.0, 3.0)), substeps=1)
    np.testing.assert_allclose(middle(found)[:, 1], 1.5 * TIMES**2, atol=1e-12)
    potential = -2.0 * 3.0 * middle(found)[:, 1]
    energy = total_energy(p, found) + potential
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)


def test_attraction_to_a_point_is_solved_exactly_and_ends_there():
    p = problem(density=1.0, elastic=0.5)
    pull = Forces(attractions=(Attraction(np.array([[3.0, 0.0]]), 4.0),))
    found = middle(solve_in_forces(p, pull, substeps=1))  # no stiffness holds the middle
    np.testing.assert_allclose(found[:, 0], 3 - 3 * np.cos(2 * TIMES), atol=1e-9)
    np.testing.assert_allclose(found[:, 1], 0, atol=1e-9)
    damped = problem(density=1.0, elastic=0.5, mass_damping=3.0, times=np.linspace(0, 12, 121))
    motion = solve_in_forces(damped, pull)
    np.testing.assert_allclose(middle(motion)[-1], [3, 0], atol=1e-6)
    rest_time = find_rest_time(motion)
    assert rest_time is not None and 2 < rest_time < 6
    assert find_rest_time(solve_in_forces(p, pull)) is None  # without damping


def curve_energy(p, motion, target, strength):
    """The energy of a curve that is drawn to the nearest of many points, at every time."""
    places = motion.displacement + p.rest
    gap = np.linalg.norm(places[:, :, None] - target, axis=-1).min(axis=-1)
    return total_energy(p, motion) + strength / 2 * (gap**2).mean(axis=1)


def test_halving_the_step_quarters_the_error_of_energy_near_a_curve():
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    target = 2 * np.stack([np.cos(angle), 0.8 * np.sin(angle)], axis=1)
    p = problem(density=1.0, elastic=0.3)
    pull = Forces(attractions=(Attraction(target, 6.0),))
    drifts = []
    for substeps in (1, 2):
        energy = curve_energy(p, solve_in_forces(p, pull, substeps), target, 6.0)
        drifts.append(np.abs(energy / energy[0] - 1).max())
    assert drifts[0] < 0.05 and drifts[1] < 0.4 * drifts[0]


def test_each_point_goes_to_the_nearest_of_a_curve():
    p = problem(bend=0.0, density=1.0, elastic=1e-6, mass_damping=20.0, times=np.linspace(0, 40, 9))
    found = solve_in_forces(p, Forces(attractions=(Attraction(2 * RING, 4.0),)), substeps=50)
    np.testing.assert_allclose(found.displacement[-1] + RING, 2 * RING, atol=0.05)


@pytest.mark.parametrize("density", [0.0, 1.0])
def test_in_wind_a_curve_ends_at_the_speed_of_the_wind_and_at_its_rest_shape(density):
    p = problem(
        density=density, elastic=0.5, mass_damping=1 - density, times=np.linspace(0, 20, 11)
    )
    end = solve_in_forces(p, Forces(winds=(Wind((0.5, -0.2), 2.0),)), substeps=1)
    share = 1 if density else 2 / 3  # without mass, something must resist: it brakes, too
    speed = np.broadcast_to(share * np.array([0.5, -0.2]), (N, 2))
    np.testing.assert_allclose(end.velocity[-1], speed, atol=1e-3)
    shape = end.displacement[-1] - end.displacement[-1].mean(axis=0)
    assert np.abs(shape).max() < 1e-3


def test_constant_wind_bends_a_curve_that_is_held_as_far_as_its_stiffness_says():
    p = problem(bend=0.0, density=1.0, elastic=2.0, mass_damping=4.0, times=np.linspace(0, 8, 9))
    is_held = np.zeros((N, 1), bool)
    is_held[0] = True
    found = solve_in_forces(p, Forces(winds=(Wind((0.5, 0.0), 3.0),), is_held=is_held), 30)
    np.testing.assert_allclose(found.displacement[:, 0], 0, atol=1e-12)
    free = np.arange(1, N)
    k = stiffness_matrix("coif2", N, 0, 2.0).toarray()[np.ix_(free, free)]
    np.testing.assert_allclose(
        found.displacement[-1, 1:, 0], np.linalg.solve(k, np.full(N - 1, 1.5)), rtol=1e-6
    )
    share = np.arange(N) / N  # of a string: u″ = −Q / e₀
    string = 1.5 / 2.0 * share * (1 - share) / 2
    assert np.abs(found.displacement[-1, :, 0] - string).max() < 0.05 * string.max()


def test_gusts_travel_with_the_wind_and_turn_round():
    wind = Wind((2.0, 0.0), 1.0, gust=0.5, gust_length=4.0)
    places = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 7.0], [4.0, 0.0]])
    np.testing.assert_allclose(
        wind.gust_velocity(places, 0.0), [[0, 1], [1, 0], [1, 0], [0, 1]], atol=1e-12
    )
    np.testing.assert_allclose(
        wind.gust_velocity(places + [2 * 0.7, 0], 0.7), wind.gust_velocity(places, 0.0), atol=1e-12
    )
    p = problem(density=1.0, elastic=0.5, times=np.linspace(0, 2, 6))
    fine, *coarse = (
        solve_in_forces(p, Forces(winds=(wind,)), substeps).displacement for substeps in (64, 2, 4)
    )
    errors = [np.abs(motion - fine).max() for motion in coarse]
    assert errors[1] / errors[0] == pytest.approx(0.25, abs=0.06)


def test_on_a_floor_a_ring_comes_to_rest_and_its_stiffness_bears_its_weight():
    forces = Forces(gravity=(0.0, 5.0), floor=1.5, friction=0.5)
    p = problem(bend=0.0, density=1.0, elastic=5.0, mass_damping=1.0, times=np.linspace(0, 20, 41))
    found = solve_in_forces(p, forces, substeps=60)
    places = found.displacement + RING
    assert places[..., 1].max() <= 1.5 + 1e-9  # at no time
    assert np.abs(np.diff(places[-2:], axis=0)).max() < 1e-4
    rest_time = find_rest_time(found)
    assert rest_time is not None and rest_time < 15
    elastic = stiffness_matrix("coif2", N, 0, 5.0) @ found.displacement[-1]
    lowest = places[-1, :, 1].argmax()
    far = np.abs((np.arange(N) - lowest + N // 2) % N - N // 2) > 4  # beyond a step's blur
    np.testing.assert_allclose(elastic[far, 1], 5.0, rtol=0.01)
    assert elastic[~far, 1].sum() == pytest.approx(-5.0 * far.sum(), rel=1e-3)
    assert np.ptp(places[-1, :, 1]) < 2 - 1e-3  # its own weight flattens it
    mirrored = solve_in_forces(replace(p, rest=RING * [-1, 1]), forces, substeps=60)
    np.testing.assert_allclose(mirrored.displacement, found.displacement * [-1, 1], atol=1e-6)


def test_friction_stops_a_sliding_curve_as_coulomb_says():
    """From speed v it slides v² / 2μg, whatever its mass and the step."""
    launch = np.broadcast_to([1.0, 0.0], (N, 2))
    for density, substeps in ((1.0, 1), (3.0, 4)):
        p = problem(
            np.linspace(0, 2, 121),
            0.0,
            launch,
            density=density,
            elastic=20.0 * density,
            stiffness_damping=0.05,
        )
        for friction, distance in ((0.2, 0.5), (0.0, 2.0)):
            forces = Forces(gravity=(0.0, 5.0), floor=1.0, friction=friction)
            slid = middle(solve_in_forces(p, forces, substeps))[-1, 0]
            assert slid == pytest.approx(distance, rel=0.1)


def test_a_floor_takes_energy_and_gives_none():
    p = problem(np.linspace(0, 4, 241), 0.0, density=1.0, elastic=2.0)
    found = solve_in_forces(p, Forces(gravity=(0.0, 5.0), floor=1.5))
    energy = total_energy(p, found) + 5.0 * (0.5 - middle(found)[:, 1])
    assert np.diff(energy).max() < 1e-3 * energy[0] and energy[-1] < 0.9 * energy[0]
    height = 0.5 - middle(found)[:, 1]
    assert height[60:].max() > 0.1 + height[30:60].min()  # it bounces, by its own stiffness


def test_curves_beside_each_other_move_as_each_would_alone():
    left, right = problem(density=1.0, elastic=0.5), problem(bend=-0.1, density=1.0, elastic=0.5)
    both = Problem(
        np.hstack([left.rest, right.rest]), np.hstack([left.displacement, right.displacement]),
        left.material, TIMES,
    )  # fmt: skip
    forces = Forces((0.0, 4.0), (Wind((1.0, 0.0), 0.5, 0.4),), floor=2.0, friction=0.3)
    found = solve_in_forces(both, forces).displacement
    alone = [solve_in_forces(one, forces).displacement for one in (left, right)]
    np.testing.assert_allclose(found, np.concatenate(alone, axis=2), atol=1e-12)


def test_without_forces_a_curve_moves_as_always_and_at_rest_it_rests():
    p = problem(density=1.0, elastic=0.5, mass_damping=0.3)
    found, exact = solve_in_forces(p, Forces()), solve_motion(p)
    np.testing.assert_allclose(found.displacement, exact.displacement, atol=1e-12)
    still = solve_in_forces(problem(bend=0.0, density=1.0), Forces())
    assert not still.displacement.any() and not still.velocity.any()
    assert find_rest_time(still) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"gravity": (0.0, np.nan)},
        {"floor": np.inf},
        {"friction": -0.1},
        {"winds": (Wind((1.0, 0.0), -1.0),)},
        {"winds": (Wind((np.inf, 0.0), 1.0),)},
        {"winds": (Wind((1.0, 0.0), 1.0, 0.5, 0.0),)},
        {"attractions": (Attraction(RING, -1.0),)},
        {"attractions": (Attraction(np.array([[np.nan, 0.0]]), 1.0),)},
    ],
)
def test_impossible_forces_are_refused(wrong):
    with pytest.raises(FinloopError, match="the forces"):
        Forces(**wrong)


def test_impossible_motions_are_refused():
    p = problem(density=1.0)
    with pytest.raises(FinloopError, match="0 steps"):
        solve_in_forces(p, Forces(), substeps=0)
    with pytest.raises(FinloopError, match="not evenly spaced"):
        solve_in_forces(replace(p, times=np.array([0.0, 1.0, 3.0])), Forces())
    with pytest.raises(FinloopError, match="density"):
        solve_in_forces(problem(density=-1.0), Forces())
    with pytest.raises(FinloopError, match=r"a floor at y = 0\.5 above the lower end"):
        solve_in_forces(p, Forces(floor=0.5))
