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
from finloop.curve.wavelet import inverse_transform, wavelet_transform


def solve(
    problem: Problem, method: str = "modal", options: SolverOptions | None = None
) -> Trajectory:
    """Return the motion of a curve that is released: M q̈ + C q̇ + K q = Q (Eq. 3.3).

    q is the displacement from rest, Q the force; M, C, K are mass, damping and stiffness. method:
    "modal" is exact. "runge-kutta" has adaptive steps (Eq. 3.15). "explicit-euler" and
    "implicit-euler" need density 0. "decoupled" uses the diagonal of K alone, in the wavelet basis
    (Eq. 3.16). The result's `error` compares it with "modal". FinloopError if the problem or the
    method's settings are invalid; the message names them.
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
    """A basis in which the stiffness K is diagonal, or treated as diagonal.

    to: function from points (n, d) to coefficients (m, d); points: its inverse, from (…, m, d) to
    (…, n, d); k: the diagonal (m,) of the stiffness K.
    """

    to: Callable[[Floats], Numbers]
    points: Callable[[Numbers], Floats]
    k: Floats


def modal(problem: Problem, options: SolverOptions) -> Solution:
    """Return the exact motion (Eq. 3.3) by Fourier modes, which are independent.

    The stiffness K is circulant in the φ basis, so a Fourier transform makes it diagonal. A force
    that depends on place and time couples the modes. Then `forced_motion` refines its steps until
    the error is below `options.tolerance`.
    """
    n = len(problem.rest)
    basis = Basis(
        lambda points: np.fft.rfft(points, axis=0),
        lambda modes: np.fft.irfft(modes, n, axis=-2),
        eigenvalues(problem.wavelet, n, problem.material.elastic),
    )
    return _solve_in_basis(basis, problem, options)


def solve_decoupled(problem: Problem, options: SolverOptions) -> Solution:
    """Return the motion by Eq. 3.16: only the diagonal of the stiffness K, in the wavelet basis.

    The neglected entries beside the diagonal cause a considerable error.
    """
    n, levels = len(problem.rest), options.levels
    basis = Basis(
        lambda points: wavelet_transform(points, problem.wavelet, levels),
        lambda coefficients: inverse_transform(
            np.asarray(coefficients, float), problem.wavelet, levels
        ),
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
    facts = {f"{name}_roots": float(count) for name, count in modes.count_root_kinds().items()}
    return Solution(basis.points(places), basis.points(speeds), {**facts, "estimate": estimate})


# --- energy and momentum


def energy(problem: Problem, motion: Trajectory) -> Floats:
    """Return the kinetic plus elastic energy at every time: ½ ρ ∫ |u̇|² + ½ ∫ e₀ |u′|².

    motion: of the problem's curve at t times. The result is (t,); u is the displacement from rest,
    ρ the density, e₀ the elastic constant.
    """
    n = len(problem.rest)
    k = eigenvalues(problem.wavelet, n, problem.material.elastic)
    twice = np.full(len(k), 2.0)  # rfft leaves out the mirror images
    twice[[0, -1]] = 1
    modes = np.abs(np.fft.rfft(motion.displacement, axis=1)) ** 2
    elastic = np.einsum("tmd,m->t", modes, twice * k) / n**2
    kinetic = problem.material.density * (motion.velocity**2).sum(axis=(1, 2)) / n
    return (elastic + kinetic) / 2


def momentum(problem: Problem, motion: Trajectory) -> Floats:
    """Return the momentum ρ ∫ u̇ at every time; without force it decays as e^(−s₁ t).

    The result is (t, d); u̇ is the velocity, ρ the density, s₁ the material's `mass_damping`.
    """
    return problem.material.density * motion.velocity.mean(axis=1)
