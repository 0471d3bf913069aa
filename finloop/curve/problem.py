"""The problem that `curve.dynamics` solves, its settings and its solution (curve paper §3.1).

Glossary: *rest* u₀ (n, d) the natural shape; *displacement* u from it; ρ *density*, e₀ *elastic*,
s₁ *mass_damping*, s₂ *stiffness_damping*; Q a force per length, at every point.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError

METHODS = ("modal", "runge-kutta", "explicit-euler", "implicit-euler", "decoupled")

Field = Callable[
    [float, Floats], Floats
]  # Q (n, d) as a function of time and the points' places (n, d)


@dataclass(frozen=True)
class Material:
    """The material of a curve: density ρ, elastic constant e₀, and damping C = s₁M + s₂K (Eq. 3.5).

    mass_damping is s₁, stiffness_damping s₂. With ρ = 0 (§3.3) the M of C is I instead of ρI = 0: K
    alone cannot be inverted.
    """

    density: float = 1.0
    elastic: float = 1.0
    mass_damping: float = 0.0
    stiffness_damping: float = 0.0


@dataclass(frozen=True)
class Problem:
    """A curve of n points, a power of two, that is bent and released at times[0].

    rest (n, d): its shape without force; displacement (n, d) from it at times[0], and velocity (n,
    d), None = 0. times (t,): rising, at which the motion is wanted. force: (n, d); (d,) for the
    same force at every point; a function of time and places; or None.
    """

    rest: Floats
    displacement: Floats
    material: Material
    times: Floats
    velocity: Floats | None = None
    force: Floats | Field | None = None
    wavelet: str = "coif2"


@dataclass(frozen=True)
class SolverOptions:
    """Settings of the methods of `curve.dynamics.solve`.

    All methods but "modal" use `levels` of the wavelet basis. "runge-kutta" uses the relative
    tolerance `rtol` and scipy's `integrator`. Euler takes `substeps` between two times and inverts
    C by "sparse" factors or "schulz". "modal" uses `tolerance` if the force depends on place and
    time.
    """

    levels: int = 3
    rtol: float = 1e-6
    integrator: str = "RK45"
    substeps: int = 10
    inverse: str = "sparse"
    tolerance: float = 1e-9


@dataclass(frozen=True)
class Trajectory:
    """Displacements from rest and velocities, each (t, n, d), at `times` (t,), and their error.

    `error` is the largest deviation from the exact displacement, relative to the largest exact
    displacement; "modal" estimates it itself, 0 for a closed form. `facts` holds steps, residuals
    and other counts of the method.
    """

    times: Floats
    displacement: Floats
    velocity: Floats
    error: float
    facts: dict[str, float] = field(default_factory=dict)


class Solution(NamedTuple):
    """Displacements from rest and velocities, each (t, n, d), and counts of the method by name."""

    displacement: Floats
    velocity: Floats
    facts: dict[str, float]


def check_problem(problem: Problem, method: str) -> Problem:
    """Return the problem with an array in every field; its velocity is 0 if it has none.

    method: one of METHODS. FinloopError if the problem is invalid, or invalid for this method.
    """
    material, force = problem.material, problem.force
    times, rest = np.asarray(problem.times, np.float64), np.asarray(problem.rest, np.float64)
    u = np.asarray(problem.displacement, np.float64)
    v = np.zeros_like(u) if problem.velocity is None else np.asarray(problem.velocity, np.float64)
    values = [rest, u, v, times, np.array(list(vars(material).values()), np.float64)]
    negative = bool((values[-1] < 0).any())
    if force is not None and not callable(force):
        force = np.asarray(force, np.float64)
        values.append(force)
    massless = material.density == 0
    refusals = (  # (whether it applies, what came, what is needed)
        (method not in METHODS, f"the method {method!r}", f"one of {', '.join(METHODS)}"),
        (not all(np.isfinite(array).all() for array in values),
         "numbers that are not finite in a curve, a material, the times or a force",
         "finite numbers"),
        (not (u.ndim == 2 and u.shape == v.shape == rest.shape),
         f"a rest shape of shape {rest.shape}, displacements {u.shape}, velocities {v.shape}",
         "the same shape (n, d)"),
        (isinstance(force, np.ndarray) and force.shape not in (u.shape, u.shape[1:]),
         f"a force of shape {getattr(force, 'shape', ())}",
         f"{u.shape}, or {u.shape[1:]} for the same force at every point"),
        (times.ndim != 1 or len(times) < 1 or bool((np.diff(times) <= 0).any()),
         "times that do not increase", "increasing times, the first at the start"),
        (negative, f"a material with a negative number: {material}",
         "density, elastic and both dampings of 0 or more"),
        (massless and material.mass_damping == 0,
         "a curve without mass (density 0) and without mass_damping",
         "mass_damping above 0: without it C is singular, as nothing resists a shift"),
        (massless and method == "runge-kutta",
         "runge-kutta on Eq. 3.15, which divides by the density, 0",
         "a density above 0, or one of the Euler methods, modal or decoupled"),
        (not massless and method.endswith("euler"),
         f"{method} with density {material.density:g}",
         "density 0: these methods solve C q̇ + K q = Q (§3.3)"),
    )  # fmt: skip
    for applies, came, goal in refusals:
        if applies:
            raise FinloopError(came, goal, "change the problem, or use another method")
    return Problem(rest, u, material, times, v, force, problem.wavelet)


def force_at(problem: Problem, time: float, displacement: Floats) -> Floats:
    """Return the force Q (n, d) on the points at a time, for displacements (n, d) from rest."""
    force = problem.force
    if callable(force):
        return np.broadcast_to(force(time, problem.rest + displacement), displacement.shape)
    return np.zeros_like(displacement) + (0 if force is None else force)


def velocity_at_start(problem: Problem) -> Floats:
    """Return the velocity (n, d) of the points at times[0]; 0 if the problem has none."""
    return np.zeros_like(problem.displacement) if problem.velocity is None else problem.velocity
