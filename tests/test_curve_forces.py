"""Curves in fields of force: gravity, wind, attraction, a floor; closed forms and balances."""

from dataclasses import replace

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.curve.dynamics import Material, Problem, solve_motion
from finloop.curve.forces import Forces, solve_in_forces

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


def test_attraction_to_a_point_is_a_spring_and_halving_the_step_quarters_the_error():
    p = problem(density=1.0, elastic=0.5)
    forces = Forces(attractors=np.array([[3.0, 0.0]]), attraction=4.0)
    wanted = 3 - 3 * np.cos(2 * TIMES)  # of the middle, which no stiffness holds
    errors = [
        np.abs(middle(solve_in_forces(p, forces, substeps))[:, 0] - wanted).max()
        for substeps in (4, 8)
    ]
    assert errors[0] < 0.05 and errors[1] / errors[0] == pytest.approx(0.25, abs=0.05)


def test_each_point_goes_to_the_nearest_of_a_curve():
    p = problem(bend=0.0, density=1.0, elastic=1e-6, mass_damping=20.0, times=np.linspace(0, 40, 9))
    found = solve_in_forces(p, Forces(attractors=2 * RING, attraction=4.0), substeps=200)
    np.testing.assert_allclose(found.displacement[-1] + RING, 2 * RING, atol=0.05)


def test_in_wind_a_curve_ends_at_the_speed_of_the_wind_and_at_its_rest_shape():
    p = problem(density=1.0, elastic=0.5, times=np.linspace(0, 20, 11))
    end = solve_in_forces(p, Forces(wind=(0.5, -0.2), drag=2.0), substeps=40)
    np.testing.assert_allclose(end.velocity[-1], np.broadcast_to([0.5, -0.2], (N, 2)), atol=1e-3)
    shape = end.displacement[-1] - end.displacement[-1].mean(axis=0)
    assert np.abs(shape).max() < 1e-3


def test_on_a_floor_a_ring_comes_to_rest_and_the_floor_bears_its_weight():
    forces = Forces(gravity=(0.0, 5.0), floor=1.5, floor_stiffness=400.0, floor_damping=4.0)
    p = problem(bend=0.0, density=1.0, elastic=5.0, mass_damping=1.0, times=np.linspace(0, 20, 41))
    found = solve_in_forces(p, forces, substeps=40)
    depth = np.maximum(found.displacement[-1] + RING - [0, 1.5], 0)[:, 1]
    assert np.abs(found.velocity[-1]).max() < 1e-3
    assert 400 * depth.sum() == pytest.approx(N * 5.0, rel=0.01)
    height = np.ptp((found.displacement[-1] + RING)[:, 1])
    assert height < 2 - 1e-3  # its own weight flattens it
    mirrored = solve_in_forces(replace(p, rest=RING * [-1, 1]), forces, substeps=40)
    np.testing.assert_allclose(mirrored.displacement, found.displacement * [-1, 1], atol=1e-6)


def test_steps_that_are_too_long_are_refused_and_the_named_number_will_do():
    forces, p = Forces(floor=1.0, floor_stiffness=1e4), problem(density=1.0)
    with pytest.raises(FinloopError, match="1 steps between two times") as refused:
        solve_in_forces(p, forces, substeps=1)
    steps = int(refused.value.do.split()[1])
    assert np.isfinite(solve_in_forces(p, forces, steps).displacement).all()
    with pytest.raises(FinloopError, match="0 steps"):
        solve_in_forces(p, Forces(), substeps=0)
    massless = problem(density=0.0, mass_damping=0.5)
    with pytest.raises(FinloopError, match="no density"):
        solve_in_forces(massless, Forces(drag=0.5))
    with pytest.raises(FinloopError, match="steps between two times"):
        solve_in_forces(massless, Forces(attractors=RING, attraction=500.0))
    pulled = solve_in_forces(massless, Forces(attractors=RING, attraction=5.0, drag=0.1))
    assert np.isfinite(pulled.displacement).all()
    with pytest.raises(FinloopError, match="not evenly spaced"):
        solve_in_forces(replace(p, times=np.array([0.0, 1.0, 3.0])), Forces())
    with pytest.raises(FinloopError, match="density"):
        solve_in_forces(problem(density=-1.0), Forces())
