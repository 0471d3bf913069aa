"""Curves that move in fields of force: gravity, attraction, wind, a floor (curve paper §3.1, §4.2).

Q of Eq. 3.3 is constant or a function of place. The stiffness is solved exactly, as in
`curve.dynamics`; over a short step the force counts as constant, with its value at the middle of
the step. So the step need not follow the stiffness, and halving it quarters the error.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.dynamics import (
    Material,
    Numbers,
    Problem,
    Response,
    Trajectory,
    convert_problem,
    curve_oscillators,
    fourier_basis,
    oscillator_response,
)

Field = Callable[[Floats, Floats], Floats]
"""A force per length (n, 2) from places (n, 2) and velocities (n, 2) of a curve's points."""

STEP_LIMIT = 0.5
"""Largest step, in units of the time in which the forces change a point's motion."""


@dataclass(frozen=True)
class Forces:
    """Forces per length on a curve in the plane, y down, in units of the drawing and of time.

    gravity (2,): acceleration; it moves nothing without density. wind (2,): velocity of the air,
    which pulls each point along with `drag` × (wind − velocity). attractors (k, 2): points, such as
    those of a curve; each point of the curve is pulled to the nearest with `attraction` × its
    offset. floor: its y; below it a spring `floor_stiffness` × depth pushes up, and `floor_damping`
    × velocity brakes.
    """

    gravity: tuple[float, float] = (0.0, 0.0)
    wind: tuple[float, float] = (0.0, 0.0)
    drag: float = 0.0
    attractors: Floats | None = None
    attraction: float = 0.0
    floor: float | None = None
    floor_stiffness: float = 1000.0
    floor_damping: float = 10.0

    def field(self, density: float) -> Field:
        """Return the force on the points of a curve of a density, as a function of its motion."""

        def force(places: Floats, velocities: Floats) -> Floats:
            total = np.broadcast_to(density * np.asarray(self.gravity), places.shape)
            total = total + self.drag * (np.asarray(self.wind) - velocities)
            if self.attractors is not None:
                offsets = np.asarray(self.attractors) - places[:, None]
                nearest = (offsets**2).sum(axis=2).argmin(axis=1)
                total = total + self.attraction * offsets[np.arange(len(places)), nearest]
            if self.floor is not None:
                depth = np.maximum(places[:, 1] - self.floor, 0.0)
                total = total - self.floor_damping * velocities * (depth > 0)[:, None]
                total[:, 1] -= self.floor_stiffness * depth
            return total

        return force

    def fastest_rate(self, material: Material) -> float:
        """Return the largest rate at which the forces change a point's motion, 1 / time.

        FinloopError without density, if wind or floor brake as much as the material: then no step
        is short enough.
        """
        has_floor = self.floor is not None
        springs = self.attraction + (self.floor_stiffness if has_floor else 0.0)
        brakes = self.drag + (self.floor_damping if has_floor else 0.0)
        if material.density:
            rates = np.sqrt(springs / material.density), brakes / material.density
            return float(max(rates))
        if brakes >= material.mass_damping:
            raise FinloopError(
                f"no density, drag and floor damping {brakes:g}, damping {material.mass_damping:g}",
                "a density above 0, or brakes below the damping",
                "set a density",
            )
        return springs / (material.mass_damping - brakes)


def solve_in_forces(problem: Problem, forces: Forces, substeps: int = 20) -> Trajectory:
    """Return the motion of a curve in fields of force: M q̈ + C q̇ + K q = Q(q, q̇) (Eq. 3.3).

    problem: its times are evenly spaced, its own force is added to the others. substeps: steps
    between two times. FinloopError if the problem is invalid, its times are uneven, or the steps
    are too long for the forces; the message says how many will do.
    """
    problem = convert_problem(problem)
    material, times = problem.material, problem.times
    intervals = np.diff(times)
    if substeps < 1:
        raise FinloopError(f"{substeps} steps between two times", "1 or more", "set 20")
    if not len(intervals) or not np.allclose(intervals, intervals[0], rtol=1e-9):
        raise FinloopError(
            "times that are not evenly spaced", "two times or more, evenly spaced", "space them"
        )
    step = float(intervals[0]) / substeps
    rate = forces.fastest_rate(material)
    if step * rate > STEP_LIMIT:
        raise FinloopError(
            f"{substeps} steps between two times, for forces that act within {1 / rate:.2g}",
            f"steps of at most {STEP_LIMIT / rate:.2g}",
            f"set {int(np.ceil(intervals[0] * rate / STEP_LIMIT))} steps, or softer forces",
        )
    basis = fourier_basis(problem)
    oscillators = curve_oscillators(basis, material)
    both = oscillator_response(oscillators, np.array([step / 2, step]))
    half, whole = (Response(*(factor[k] for factor in both)) for k in (0, 1))
    field, constant = forces.field(material.density), problem.force_on_points()

    def push(places: Numbers, speeds: Numbers) -> Numbers:
        """Return the coefficients of the force, from those of displacement and velocity."""
        now = problem.rest + basis.inverse(places)
        return basis.transform(field(now, basis.inverse(speeds)) + constant)

    places, speeds = map(basis.transform, problem.state_at_start())
    motion = [np.stack([basis.inverse(places), basis.inverse(speeds)])]
    for _ in intervals:
        for _ in range(substeps):
            middle = _advance(half, places, speeds, push(places, speeds))
            places, speeds = _advance(whole, places, speeds, push(*middle))
        motion.append(np.stack([basis.inverse(places), basis.inverse(speeds)]))
    shapes = np.stack(motion, axis=1)
    return Trajectory(times, shapes[0], shapes[1])


def _advance(
    response: Response, places: Numbers, speeds: Numbers, force: Numbers
) -> tuple[Numbers, Numbers]:
    """Return places and speeds of oscillators (m, d) after a step with a constant force."""
    by_place, by_speed, by_force, place_rate, speed_rate, force_rate = (
        factor[:, None] for factor in response
    )
    return (
        by_place * places + by_speed * speeds + by_force * force,
        place_rate * places + speed_rate * speeds + force_rate * force,
    )
