"""The paper's integrators of Eq. 3.3 (§3.3), in the wavelet basis, where K is sparse.

Runge–Kutta on the first-order system (3.15); with ρ = 0, Euler's steps on C q̇ + K q = Q, C⁻¹ by
Schulz iteration or by sparse factors. `curve.dynamics.solve` calls them.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
import scipy
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.problem import Problem, Solution, SolverOptions, force_at, velocity_at_start
from finloop.curve.stiffness import damping, mass, stiffness
from finloop.curve.wavelet import inverse_transform, wavelet_transform

ITERATIONS = 100
"""Largest number of Schulz iterations; every matrix that float64 can invert needs fewer."""


def matrices(problem: Problem, options: SolverOptions) -> tuple[csr_array, csr_array]:
    """Return damping C and stiffness K of a problem, each (n, n), in the wavelet basis."""
    n, material = len(problem.rest), problem.material
    k = stiffness(problem.wavelet, n, options.levels, material.elastic)
    m = mass(n, material.density or 1.0)
    return damping(m, k, material.mass_damping, material.stiffness_damping), k


def _push(problem: Problem, options: SolverOptions) -> Callable[[float, Floats], Floats]:
    """Return the force Q in the wavelet basis, as a function of time and coefficients (n, d)."""
    if not callable(problem.force):
        constant = wavelet_transform(
            force_at(problem, 0.0, problem.displacement), problem.wavelet, options.levels
        )
        return lambda time, q: constant

    def push(time: float, q: Floats) -> Floats:
        points = inverse_transform(q, problem.wavelet, options.levels)
        return wavelet_transform(force_at(problem, time, points), problem.wavelet, options.levels)

    return push


def runge_kutta(problem: Problem, options: SolverOptions) -> Solution:
    """Return the motion by an adaptive Runge–Kutta formula of scipy (Eq. 3.15).

    The density must not be 0. FinloopError if the formula fails.
    """
    c, k = matrices(problem, options)
    push, shape = _push(problem, options), problem.displacement.shape
    density = problem.material.density
    velocity = velocity_at_start(problem)
    start = wavelet_transform(
        np.stack([problem.displacement, velocity]), problem.wavelet, options.levels
    )

    def slope(time: float, state: Floats) -> Floats:
        q, rate = state.reshape(2, *shape)
        return np.concatenate(
            [rate.ravel(), ((push(time, q) - k @ q - c @ rate) / density).ravel()]
        )

    scale = float(np.abs(start).max()) or 1.0
    state, states, evaluations, step = start.ravel(), [start.ravel()], 0, None
    # One call per interval: scipy's interpolation between steps is less accurate than its steps.
    for begin, end in pairwise(problem.times):
        result = scipy.integrate.solve_ivp(
            slope,
            (begin, end),
            state,
            options.integrator,
            rtol=options.rtol,
            atol=options.rtol * scale,
            first_step=None if step is None else min(step, end - begin),
        )
        if not result.success:
            raise FinloopError(
                f"{options.integrator} failed: {result.message}",
                "an equation that the integrator can solve",
                "use the method modal, or a larger options.rtol",
            )
        state, step = result.y[:, -1], float(np.diff(result.t).max())
        evaluations += result.nfev
        states.append(state)
    both = np.stack(states).reshape(-1, 2, *shape)
    q, rate = (inverse_transform(both[:, i], problem.wavelet, options.levels) for i in (0, 1))
    return Solution(q, rate, {"evaluations": float(evaluations)})


def schulz(matrix: Floats, tolerance: float = 1e-10) -> tuple[Floats, int, float]:
    """Invert a matrix (n, n) by Schulz iteration, X ← 2X − XCX from Cᵀ / ‖CᵀC‖, C the matrix.

    Return the inverse (n, n), the number of iterations, and the largest entry of |I − XC|, at most
    `tolerance`. The paper names no norm; this one is the largest row sum, which bounds every
    eigenvalue, so the iteration converges. FinloopError if the matrix is singular, or nearly.
    """
    unit = np.eye(len(matrix))
    x = matrix.T / np.abs(matrix.T @ matrix).sum(axis=1).max()
    for iteration in range(ITERATIONS):
        rest = unit - x @ matrix
        residual = float(np.abs(rest).max())
        if residual <= tolerance:
            return x, iteration, residual
        x = x + rest @ x
    raise FinloopError(
        f"the Schulz iteration has a residual of {residual:.2g} after {ITERATIONS} steps",
        f"{tolerance:g}: a matrix far from singular",
        "raise mass_damping, or set options.inverse to sparse",
    )


def _inverse(
    matrix: csr_array, options: SolverOptions
) -> tuple[Callable[[Floats], Floats], dict[str, float]]:
    """Return a function that solves with the matrix, and facts about the factors or iterations."""
    if options.inverse == "schulz":
        x, iterations, residual = schulz(matrix.toarray())
        facts = {"schulz_iterations": float(iterations), "schulz_residual": residual}
        return lambda right: x @ right, facts
    if options.inverse == "sparse":
        factors = splu(csc_array(matrix))
        return lambda right: factors.solve(np.ascontiguousarray(right)), {
            "factors_nonzero": float(factors.nnz)
        }
    raise FinloopError(
        f"options.inverse {options.inverse!r}", "sparse or schulz", "choose one of the two"
    )


def _even_step(problem: Problem, options: SolverOptions) -> float:
    """Return Δt of Euler's steps; FinloopError if the times are not even."""
    gaps = np.diff(problem.times)
    if options.substeps < 1 or not len(gaps) or not np.allclose(gaps, gaps[0], rtol=1e-9, atol=0):
        raise FinloopError(
            f"{len(problem.times)} times, perhaps unevenly spaced, and {options.substeps} substeps",
            "two or more evenly spaced times and at least 1 substep, for Euler's method",
            "correct the times or options.substeps, or use the method modal",
        )
    return float(gaps.mean()) / options.substeps


def _integrate_steps(
    problem: Problem,
    options: SolverOptions,
    step: float,
    advance: Callable[[float, Floats, Floats], Floats],
) -> Floats:
    """Return the coefficients (t, n, d), stepped by `advance(time, q, Q)`."""
    push = _push(problem, options)
    q = wavelet_transform(problem.displacement, problem.wavelet, options.levels)
    course = [q]
    for index in range(1, len(problem.times)):
        for number in range(options.substeps):
            time = problem.times[index - 1] + number * step
            q = advance(time, q, push(time, q))
        course.append(q)
    return np.stack(course)


def euler(problem: Problem, options: SolverOptions, implicit: bool) -> Solution:
    """Return the motion of a curve without mass, C q̇ + K q = Q, by Euler's steps (§3.3).

    Explicit, q(t + Δt) = q + Δt C⁻¹(Q − K q): FinloopError if Δt is too long for stable steps.
    Implicit, q(t + Δt) = (C + Δt K)⁻¹ (C q + Δt Q), with Q at time t: stable at any Δt.
    FinloopError if the times are not even.
    """
    step = _even_step(problem, options)
    c, k = matrices(problem, options)
    if not implicit:
        stiffest = float(np.abs(k).sum(axis=1).max())  # no eigenvalue is larger
        material = problem.material
        fastest = stiffest / (material.mass_damping + material.stiffness_damping * stiffest)
        if step * fastest > 2:
            raise FinloopError(
                f"explicit Euler with steps of {step:.3g}",
                f"steps of {2 / fastest:.3g} at most: longer steps are unstable",
                f"set options.substeps to {int(np.ceil(options.substeps * step * fastest / 2))} or "
                "more, or use implicit-euler",
            )
    solve, facts = _inverse(csr_array(c + step * k) if implicit else c, options)
    exact_solve = solve if not implicit else _inverse(c, SolverOptions(inverse="sparse"))[0]

    def advance(time: float, q: Floats, force: Floats) -> Floats:
        if implicit:
            return solve(c @ q + step * force)
        return q + step * solve(force - k @ q)

    coefficients = _integrate_steps(problem, options, step, advance)
    push = _push(problem, options)
    rates = np.stack(
        [
            exact_solve(push(time, q) - k @ q)
            for time, q in zip(problem.times, coefficients, strict=True)
        ]
    )
    steps = options.substeps * (len(problem.times) - 1)
    u, v = (
        inverse_transform(values, problem.wavelet, options.levels)
        for values in (coefficients, rates)
    )
    return Solution(u, v, {"steps": float(steps), **facts})


METHOD: dict[str, Callable[[Problem, SolverOptions], Solution]] = {
    "runge-kutta": runge_kutta,
    "explicit-euler": partial(euler, implicit=False),
    "implicit-euler": partial(euler, implicit=True),
}
