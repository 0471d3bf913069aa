"""Deformation of a curve by its stiffness (curve paper §3.1, §3.3): M q̈ + C q̇ + K q = Q (Eq. 3.3).

`solve` is the entry. In the φ basis K is circulant, and an FFT decouples it exactly. This is the
method "modal", the reference for the errors of all other methods. The parameter of a curve runs
from 0 to 1, so with e₀ = ρ = 1 mode m swings m times in a unit of time, at any n.

An open curve moves as one half of the closed curve that `curve.wavelet.close_by_mirroring` makes.
K preserves that symmetry, and the ends are free.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats
from finloop.curve.integrate import METHOD
from finloop.curve.oscillator import Numbers, Oscillators, forced_motion, motion
from finloop.curve.problem import (
    Problem,
    Solution,
    SolverOptions,
    Trajectory,
    check_problem,
    force_at,
    velocity_at_start,
)
from finloop.curve.stiffness import eigenvalues, stiffness
from finloop.curve.wavelet import back, forward


def solve(
    problem: Problem, method: str = "modal", options: SolverOptions | None = None
) -> Trajectory:
    """Solve M q̈ + C q̇ + K q = Q (Eq. 3.3) for the motion of a curve.

    "modal": exact. "runge-kutta": adaptive, Eq. 3.15. "explicit-euler", "implicit-euler": ρ = 0.
    "decoupled": Eq. 3.16 with the diagonal of K alone, in the wavelet basis. FinloopError if the
    problem or the method's settings are invalid; the message names them.
    """
    options = options or SolverOptions()
    problem = check_problem(problem, method)
    exact = modal(problem, options)
    if method == "modal":
        return Trajectory(problem.times, *exact[:2], exact.facts["estimate"], exact.facts)
    solution = {"decoupled": solve_decoupled, **METHOD}[method](problem, options)
    off = np.abs(solution.displacement - exact.displacement).max()
    size = np.abs(exact.displacement).max()
    error = float(off / size) if size else float(off)
    return Trajectory(
        problem.times, solution.displacement, solution.velocity, error, solution.facts
    )


# --- in a basis in which K is diagonal, or treated as diagonal


class Basis(NamedTuple):
    """A basis: points (n, d) to coefficients (m, d) and back (…, n, d), and K's diagonal (m,)."""

    to: Callable[[Floats], Numbers]
    points: Callable[[Numbers], Floats]
    k: Floats


def modal(problem: Problem, options: SolverOptions) -> Solution:
    """Solve exactly: K is circulant in the φ basis, so the Fourier modes are independent.

    A force that depends on place and time couples the modes. Then `forced_motion` refines its steps
    until the error is below `options.tolerance`.
    """
    n = len(problem.rest)
    basis = Basis(
        lambda points: np.fft.rfft(points, axis=0),
        lambda modes: np.fft.irfft(modes, n, axis=-2),
        eigenvalues(problem.wavelet, n, problem.material.elastic),
    )
    return _solve_in_basis(basis, problem, options)


def solve_decoupled(problem: Problem, options: SolverOptions) -> Solution:
    """Solve Eq. 3.16 in the wavelet basis without K's off-diagonals, with a considerable error."""
    n, levels = len(problem.rest), options.levels
    basis = Basis(
        lambda points: forward(points, problem.wavelet, levels),
        lambda coefficients: back(np.asarray(coefficients, float), problem.wavelet, levels),
        stiffness(problem.wavelet, n, levels, problem.material.elastic).diagonal(),
    )
    return _solve_in_basis(basis, problem, options)


def _solve_in_basis(basis: Basis, problem: Problem, options: SolverOptions) -> Solution:
    material = problem.material
    mass = material.density or 1.0  # of C, see Material
    damping = material.mass_damping * mass + material.stiffness_damping * basis.k
    modes = Oscillators(material.density, damping, basis.k)
    u, v = basis.to(problem.displacement), basis.to(velocity_at_start(problem))
    estimate = 0.0
    if callable(problem.force):

        def push(time: float, places: Numbers) -> Numbers:
            return basis.to(force_at(problem, time, basis.points(places)))

        places, speeds, estimate = forced_motion(
            modes, u, v, problem.times, push, options.tolerance
        )
    else:
        none = problem.force is None
        q = None if none else basis.to(force_at(problem, 0.0, problem.displacement))
        places, speeds = motion(modes, u, v, problem.times - problem.times[0], q)
    facts = {f"{name}_roots": float(count) for name, count in modes.cases().items()}
    return Solution(basis.points(places), basis.points(speeds), {**facts, "estimate": estimate})


# --- energy and momentum


def energy(problem: Problem, motion: Trajectory) -> Floats:
    """Return kinetic plus elastic energy (t,): ½ ρ ∫ |u̇|² + ½ ∫ e₀ |u′|²."""
    n = len(problem.rest)
    k = eigenvalues(problem.wavelet, n, problem.material.elastic)
    twice = np.full(len(k), 2.0)  # rfft leaves out the mirror images
    twice[[0, -1]] = 1
    modes = np.abs(np.fft.rfft(motion.displacement, axis=1)) ** 2
    elastic = np.einsum("tmd,m->t", modes, twice * k) / n**2
    kinetic = problem.material.density * (motion.velocity**2).sum(axis=(1, 2)) / n
    return (elastic + kinetic) / 2


def momentum(problem: Problem, motion: Trajectory) -> Floats:
    """Return the momentum ρ ∫ u̇, (t, d); without force it decays as e^(−s₁ t)."""
    return problem.material.density * motion.velocity.mean(axis=1)
