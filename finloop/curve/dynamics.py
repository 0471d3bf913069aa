"""Move a curve by its stiffness: M q̈ + C q̇ + K q = Q (curve paper §3.1, §3.3, Eq. 3.3).

Glossary: *rest* u₀ (n, d) the natural shape; *displacement* u from it; ρ *density*, e₀ *elastic*,
s₁ *mass_damping*, s₂ *stiffness_damping*; Q a constant force per length, such as gravity.

`solve_motion` is the entry. In the φ basis K is circulant, and an FFT decouples it exactly. This is
the method "modal", the reference for the errors of all other methods. The parameter of a curve runs
from 0 to 1, so with e₀ = ρ = 1 mode m swings m times in a unit of time, at any n.

With a level the n / 2^level coarse coefficients alone are solved, with M, C and K of that level
(Fig. 7): a coarse curve costs less, and swings a little slower or faster than the fine one.

An open curve moves as one half of the closed curve that `curve.wavelet.close_by_mirroring` makes.
K preserves that symmetry, and the ends are free.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import factorial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.stiffness import stiffness_eigenvalues, stiffness_matrix
from finloop.curve.wavelet import (
    control_points,
    curves_from_control,
    inverse_transform,
    wavelet_transform,
)

METHODS = ("modal", "runge-kutta", "explicit-euler", "implicit-euler", "decoupled")
SCHULZ_ITERATIONS = 100
"""Largest number of Schulz iterations; every matrix that float64 can invert needs fewer."""
SCHULZ_TOLERANCE = 1e-10  # largest entry of |I − XC| for an inverse X of C

Numbers = NDArray[np.inexact]


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
    """A curve of n points, bent and released at times[0], whose motion is wanted.

    rest (n, d): its shape without force; displacement (n, d) from it at times[0], and velocity (n,
    d), None = 0. times (t,): ascending, at which the motion is wanted. force: constant, (n, d), or
    (d,) for the same force at every point; None = 0.
    """

    rest: Floats
    displacement: Floats
    material: Material
    times: Floats
    velocity: Floats | None = None
    force: Floats | None = None
    wavelet: str = "coif2"

    def state_at_start(self) -> Floats:
        """Return displacement and velocity of the points at the start, (2, n, d)."""
        u, v = self.displacement, self.velocity
        return np.stack([u, np.zeros_like(u) if v is None else v])

    def force_on_points(self) -> Floats:
        """Return the constant force Q (n, d) on every point."""
        return np.zeros_like(self.displacement) + (0 if self.force is None else self.force)


@dataclass(frozen=True)
class SolverOptions:
    """Settings of the methods of `curve.dynamics.solve_motion`; "modal" needs none.

    levels: of the wavelet basis. "runge-kutta" uses the relative tolerance `rtol` and scipy's
    `integrator`. Euler takes `substeps` between two times and inverts the damping matrix C by
    "sparse" factors or "schulz".
    """

    levels: int = 3
    rtol: float = 1e-6
    integrator: str = "RK45"
    substeps: int = 10
    inverse: str = "sparse"


@dataclass(frozen=True)
class Trajectory:
    """The motion of a curve: displacements from rest, velocities, (t, n, d) each, and their error.

    `error` is the largest deviation of the displacement from the exact one of the same level,
    relative to the largest exact displacement.
    """

    times: Floats
    displacement: Floats
    velocity: Floats
    error: float = 0.0


def solve_motion(
    problem: Problem, method: str = "modal", options: SolverOptions | None = None, level: int = 0
) -> Trajectory:
    """Return the motion of a bent and released curve: M q̈ + C q̇ + K q = Q (Eq. 3.3).

    q is the displacement from rest, Q the force; M, C, K are mass, damping and stiffness. method:
    "modal" is exact. "runge-kutta" has adaptive steps (Eq. 3.15). "explicit-euler" and
    "implicit-euler" need density 0. "decoupled" uses the diagonal of K alone, in the wavelet basis
    (Eq. 3.16). level: only n / 2^level control points of the displacement are solved, with M, C, K
    and Q of that level; the result is the curve of n points that they make, without details.
    FinloopError if the problem or the method's settings are invalid; the message names them.
    """
    options = options or SolverOptions()
    problem = convert_problem(problem, method)
    if level:
        coarse = solve_motion(_coarsen_problem(problem, level), method, options)
        shapes = np.stack([coarse.displacement, coarse.velocity])
        displacement, velocity = curves_from_control(shapes, problem.wavelet, level)
        return replace(coarse, displacement=displacement, velocity=velocity)
    exact = _solve_modal(problem)
    if method == "modal":
        return exact
    if method == "decoupled":
        motion = _solve_decoupled(problem, options)
    elif method == "runge-kutta":
        motion = solve_by_runge_kutta(problem, options)
    else:
        motion = solve_by_euler(problem, options, implicit=method == "implicit-euler")
    deviation = float(np.abs(motion.displacement - exact.displacement).max())
    largest = float(np.abs(exact.displacement).max())
    return replace(motion, error=deviation / (largest or 1.0))


def _coarsen_problem(problem: Problem, level: int) -> Problem:
    """Return the problem of a curve's n / 2^level control points."""
    rest, u, v, q = (
        control_points(points, problem.wavelet, level)
        for points in (problem.rest, *problem.state_at_start(), problem.force_on_points())
    )
    force = None if problem.force is None else q
    return replace(problem, rest=rest, displacement=u, velocity=v, force=force)


def convert_problem(problem: Problem, method: str = "modal") -> Problem:
    """Return a problem with arrays as fields; FinloopError if the method cannot solve it."""
    material = problem.material
    rest, u, times = (
        np.asarray(field, np.float64)
        for field in (problem.rest, problem.displacement, problem.times)
    )
    v = np.zeros_like(u) if problem.velocity is None else np.asarray(problem.velocity, np.float64)
    force = None if problem.force is None else np.asarray(problem.force, np.float64)
    constants = np.array(list(vars(material).values()), np.float64)
    arrays = [rest, u, v, times, constants, np.zeros(0) if force is None else force]
    massless = material.density == 0
    refusals = (  # (whether it applies, what came, what is needed)
        (method not in METHODS, f"the method {method!r}", f"one of {', '.join(METHODS)}"),
        (not all(np.isfinite(array).all() for array in arrays),
         "numbers that are not finite in a curve, a material, the times or a force",
         "finite numbers"),
        (not (u.ndim == 2 and u.shape == v.shape == rest.shape),
         f"a rest shape of shape {rest.shape}, displacements {u.shape}, velocities {v.shape}",
         "the same shape (n, d)"),
        (force is not None and force.shape not in (u.shape, u.shape[1:]),
         f"a force of shape {() if force is None else force.shape}",
         f"{u.shape}, or {u.shape[1:]} for the same force at every point"),
        (times.ndim != 1 or len(times) < 1 or bool((np.diff(times) <= 0).any()),
         "times that do not increase", "increasing times, the first at the start"),
        (bool((constants < 0).any()), f"a material with a negative number: {material}",
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
    return Problem(rest, u, material, times, velocity=v, force=force, wavelet=problem.wavelet)


# --- independent oscillators, ρ a″ + c a′ + k a = Q (Eq. 3.16; the paper prints r̈, ṙ, e₀ and f₀)


@dataclass(frozen=True)
class Oscillators:
    """m independent oscillators: one density ρ, dampings c (m,), stiffnesses k (m,)."""

    density: float
    damping: Floats
    stiffness: Floats


class Response(NamedTuple):
    """Factors (t, m) by which positions and speeds of m oscillators at t times are computed.

    The place is of_place · a₀ + of_speed · v₀ + of_force · Q, with a₀, v₀ the first place and speed
    and Q the constant force. The three `_rate` fields give the speed in the same way.
    """

    of_place: Floats
    of_speed: Floats
    of_force: Floats
    of_place_rate: Floats
    of_speed_rate: Floats
    of_force_rate: Floats


def oscillator_response(oscillators: Oscillators, times: Floats, forced: bool = True) -> Response:
    """Return the factors (t, m) that solve Eq. 3.16 for m oscillators at times (t,).

    forced: False leaves out the factor of the force (it is 0) and saves half of the time. The
    formulas neither cancel nor overflow near double roots, where swinging becomes creeping.
    """
    t = np.asarray(times, np.float64)[:, None]
    density, k = oscillators.density, oscillators.stiffness
    if density == 0:
        return _massless_response(oscillators, t)
    # The roots are r = −γ ± √(γ² − k / ρ). Real ones creep; `slow` is the one nearer to 0, as
    # (k / ρ) / (γ + √…), which does not cancel. Complex ones decay by γ and swing.
    gamma, square = oscillators.damping / (2 * density), k / density
    discriminant = gamma**2 - square
    root, creeps = np.sqrt(np.abs(discriminant)), discriminant >= 0
    slow = np.where(creeps, square / np.where(creeps & (gamma + root > 0), gamma + root, 1), gamma)
    # `cosine` is e^(−γt) cos ωt and `of_speed` e^(−γt) sin(ωt) / ω with ω = `root`; where the roots
    # are real, with cosh and sinh in place of cos and sin.
    cosine = np.exp(-slow * t)
    of_speed = cosine * t
    root_distance, angle = 2 * root[creeps] * t, root[~creeps] * t
    cosine[:, creeps] *= (1 + np.exp(-root_distance)) / 2
    of_speed[:, creeps] *= _mean_of_decay(root_distance)
    cosine[:, ~creeps] *= np.cos(angle)
    of_speed[:, ~creeps] *= np.sin(angle) / np.where(angle > 0, angle, 1) + (angle == 0)
    of_place = cosine + gamma * of_speed
    of_force = np.zeros_like(of_place)
    if forced:
        unscaled = _force_response(2 * gamma * t, square * t**2, slow * t, of_place)
        of_force = t**2 * unscaled / density
    return Response(
        of_place, of_speed, of_force,
        of_place_rate=-square * of_speed,
        of_speed_rate=cosine - gamma * of_speed,
        of_force_rate=of_speed / density,
    )  # fmt: skip


def _massless_response(oscillators: Oscillators, t: Floats) -> Response:
    """Return the factors (t, m) for oscillators without mass at times (t, 1).

    There is one root, −k / c: the place creeps, and the first speed has no effect.
    """
    rate = oscillators.stiffness / oscillators.damping
    decay = np.exp(-rate * t)
    zeros = np.zeros_like(decay)
    of_force = t * _mean_of_decay(rate * t) / oscillators.damping
    return Response(decay, zeros, of_force, -rate * decay, zeros, decay / oscillators.damping)


def _mean_of_decay(x: Floats) -> Floats:
    """Return the mean of e^−s over s from 0 to x (…), ≥ 0: (1 − e^−x) / x, and 1 at x = 0."""
    return np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1), 1)


def _force_response(total: Floats, product: Floats, slow: Floats, decayed_place: Floats) -> Floats:
    """Return how far a constant force of 1 moves oscillators, in units of time²/density.

    −x and −y are the two roots of the characteristic polynomial, each multiplied by the time since
    the start; they are complex where the oscillator swings. total = x + y, product = xy; slow: the
    smaller of x and y if they are real, else unused. decayed_place: where an oscillator is that
    began at place 1, at rest. All arguments and the result are (times, oscillators).

    The result is (1 − decayed_place) / product. Where this cancels: if x and y are small, a power
    series in them; if x is much smaller than y, (D(x) − D(y)) / (y − x), D = `_mean_of_decay`.
    """
    # Each formula is evaluated everywhere, on harmless numbers where it does not hold.
    are_small, are_unequal = (total < 0.5) & (product < 0.25), product < 0.01 * total**2
    small_total, small_product = np.minimum(total, 0.5), np.minimum(product, 0.25)
    series, term, last_term = np.zeros_like(product), np.ones_like(product), np.zeros_like(product)
    for n in range(1, 16):
        series += (-1) ** (n + 1) * term / factorial(n + 1)
        term, last_term = small_total * term - small_product * last_term, term
    x, y = np.where(are_unequal, slow, 0), np.where(are_unequal, total - slow, 1)
    by_roots = (_mean_of_decay(x) - _mean_of_decay(y)) / (y - x)
    by_place = (1 - decayed_place) / np.where(product > 0, product, 1)
    return np.where(are_small, series, np.where(are_unequal, by_roots, by_place))


def oscillator_motion(
    oscillators: Oscillators, a: Numbers, v: Numbers, times: Floats, force: Numbers | None
) -> tuple[Numbers, Numbers]:
    """Return exact positions and speeds (t, m, d) of m oscillators under a constant force.

    a, v (m, d): places and speeds at the start, real or complex as Fourier coefficients are; times
    (t,): since the start; force (m, d), None = 0.
    """
    response = oscillator_response(oscillators, times, forced=force is not None)
    factors = Response(*(factor[..., None] for factor in response))
    places = factors.of_place * a + factors.of_speed * v
    speeds = factors.of_place_rate * a + factors.of_speed_rate * v
    if force is not None:
        places, speeds = places + factors.of_force * force, speeds + factors.of_force_rate * force
    return places, speeds


# --- in a basis in which K is diagonal, or treated as diagonal


class Basis(NamedTuple):
    """A basis for the points of a curve, in which the stiffness K counts as diagonal.

    transform: from points (n, d) to coefficients (m, d); inverse: its inverse, from (…, m, d) to
    (…, n, d); k: the diagonal (m,) of the stiffness K.
    """

    transform: Callable[[Floats], Numbers]
    inverse: Callable[[Numbers], Floats]
    k: Floats


def fourier_basis(problem: Problem) -> Basis:
    """Return the Fourier basis of a curve's points, in which the circulant matrix K is diagonal."""
    n = len(problem.rest)
    return Basis(
        transform=lambda points: np.fft.rfft(points, axis=0),
        inverse=lambda modes: np.fft.irfft(modes, n, axis=-2),
        k=stiffness_eigenvalues(problem.wavelet, n, problem.material.elastic),
    )


def curve_oscillators(basis: Basis, material: Material) -> Oscillators:
    """Return one oscillator for each coefficient of a curve in a basis."""
    mass = material.density or 1.0  # without mass, mass_damping multiplies I, see `Material`
    damping = material.mass_damping * mass + material.stiffness_damping * basis.k
    return Oscillators(material.density, damping, basis.k)


def _solve_modal(problem: Problem) -> Trajectory:
    """Return the exact motion, computed in the Fourier basis."""
    return _solve_in_basis(fourier_basis(problem), problem)


def _solve_decoupled(problem: Problem, options: SolverOptions) -> Trajectory:
    """Return the motion by Eq. 3.16, which keeps only the diagonal of K in the wavelet basis."""
    n, wavelet, levels = len(problem.rest), problem.wavelet, options.levels
    basis = Basis(
        transform=lambda points: wavelet_transform(points, wavelet, levels),
        inverse=lambda q: inverse_transform(np.asarray(q, float), wavelet, levels),
        k=stiffness_matrix(wavelet, n, levels, problem.material.elastic).diagonal(),
    )
    return _solve_in_basis(basis, problem)


def _solve_in_basis(basis: Basis, problem: Problem) -> Trajectory:
    """Return a curve's motion, computed as independent oscillators in a basis."""
    u, v = problem.state_at_start()
    oscillators = curve_oscillators(basis, problem.material)
    force = None if problem.force is None else basis.transform(problem.force_on_points())
    elapsed = problem.times - problem.times[0]
    places, speeds = oscillator_motion(
        oscillators, basis.transform(u), basis.transform(v), elapsed, force
    )
    return Trajectory(problem.times, basis.inverse(places), basis.inverse(speeds))


# --- the paper's integrators (§3.3), in the wavelet basis, where K is sparse


class WaveletSystem(NamedTuple):
    """The equation of motion (Eq. 3.3) of n points in the wavelet basis.

    c, k (n, n): damping C and stiffness K; force (n, d): coefficients of Q; transform: from points
    (…, n, d) to coefficients (…, n, d); inverse: its inverse.
    """

    c: csr_array
    k: csr_array
    force: Floats
    transform: Callable[[Floats], Floats]
    inverse: Callable[[Floats], Floats]


def _wavelet_system(problem: Problem, options: SolverOptions) -> WaveletSystem:
    """Return the equation of motion (Eq. 3.3) of a problem in the wavelet basis."""
    n, material = len(problem.rest), problem.material
    k = stiffness_matrix(problem.wavelet, n, options.levels, material.elastic)
    m = (material.density or 1.0) * eye_array(n)  # M = ρI: the basis functions are orthonormal
    c = csr_array(material.mass_damping * m + material.stiffness_damping * k)
    transform = partial(wavelet_transform, wavelet=problem.wavelet, levels=options.levels)
    inverse = partial(inverse_transform, wavelet=problem.wavelet, levels=options.levels)
    return WaveletSystem(c, k, transform(problem.force_on_points()), transform, inverse)


def solve_by_runge_kutta(problem: Problem, options: SolverOptions) -> Trajectory:
    """Return the motion by an adaptive Runge–Kutta formula of scipy (Eq. 3.15).

    The density must not be 0. FinloopError if the formula fails.
    """
    system, shape = _wavelet_system(problem, options), problem.displacement.shape
    density = problem.material.density
    start = system.transform(problem.state_at_start())

    def slope(time: float, state: Floats) -> Floats:
        """Return the time derivative of a state: coefficients and their rates, one flat array."""
        q, rate = state.reshape(2, *shape)
        resistance = system.k @ q + system.c @ rate
        acceleration = (system.force - resistance) / density
        return np.concatenate([rate.ravel(), acceleration.ravel()])

    scale = float(np.abs(start).max()) or 1.0
    state, states, step = start.ravel(), [start.ravel()], None
    # One call per interval: scipy's interpolation between steps is less accurate than its steps.
    for first, last in pairwise(problem.times):
        result = scipy.integrate.solve_ivp(
            slope,
            (first, last),
            state,
            options.integrator,
            rtol=options.rtol,
            atol=options.rtol * scale,
            first_step=None if step is None else min(step, last - first),
        )
        if not result.success:
            raise FinloopError(
                f"{options.integrator} failed: {result.message}",
                "an equation that the integrator can solve",
                "use the method modal, or a larger options.rtol",
            )
        state, step = result.y[:, -1], float(np.diff(result.t).max())
        states.append(state)
    q, rate = np.moveaxis(np.reshape(states, (-1, 2, *shape)), 1, 0)
    displacement, velocity = system.inverse(q), system.inverse(rate)
    return Trajectory(problem.times, displacement, velocity)


def solve_by_euler(problem: Problem, options: SolverOptions, implicit: bool) -> Trajectory:
    """Return the motion of a massless curve, C q̇ + K q = Q, by Euler's steps (§3.3).

    Explicit, q(t + Δt) = q + Δt C⁻¹(Q − K q): FinloopError if Δt is too long for stable steps.
    Implicit, q(t + Δt) = (C + Δt K)⁻¹ (C q + Δt Q): stable at any Δt. FinloopError if the times are
    not evenly spaced.
    """
    substeps, step = options.substeps, _euler_step(problem.times, options.substeps)
    system = _wavelet_system(problem, options)
    c, k, force = system.c, system.k, system.force  # C, K and Q in the wavelet basis
    if not implicit:
        _refuse_unstable_step(k, problem.material, step, substeps)
    solve_step = _build_solver(csr_array(c + step * k) if implicit else c, options.inverse)
    solve_rate = _build_solver(c, "sparse") if implicit else solve_step  # q̇ = C⁻¹(Q − K q)
    q = system.transform(problem.displacement)
    states = [q]
    for _ in problem.times[1:]:
        for _ in range(substeps):
            if implicit:
                q = solve_step(c @ q + step * force)
            else:
                q = q + step * solve_step(force - k @ q)
        states.append(q)
    rates = [solve_rate(force - k @ q) for q in states]
    displacement, velocity = system.inverse(np.stack(states)), system.inverse(np.stack(rates))
    return Trajectory(problem.times, displacement, velocity)


def _euler_step(times: Floats, substeps: int) -> float:
    """Return the time step Δt of Euler's method: `substeps` of them lie between two times.

    FinloopError if the times are not evenly spaced, or `substeps` is below 1.
    """
    intervals = np.diff(times)
    is_even = len(intervals) and np.allclose(intervals, intervals[0], rtol=1e-9, atol=0)
    if substeps < 1 or not is_even:
        raise FinloopError(
            f"{len(times)} times, perhaps unevenly spaced, and {substeps} substeps",
            "two or more evenly spaced times and at least 1 substep, for Euler's method",
            "correct the times or options.substeps, or use the method modal",
        )
    return float(intervals.mean()) / substeps


def _refuse_unstable_step(k: csr_array, material: Material, step: float, substeps: int) -> None:
    """Raise FinloopError if the time step of explicit Euler is too long to be stable.

    k: the stiffness matrix K; step: Δt; substeps: number of steps between two times.
    """
    stiffest = float(np.abs(k).sum(axis=1).max())  # no eigenvalue is larger
    fastest = stiffest / (material.mass_damping + material.stiffness_damping * stiffest)
    if step * fastest > 2:
        raise FinloopError(
            f"explicit Euler with steps of {step:.3g}",
            f"steps of {2 / fastest:.3g} at most: longer steps are unstable",
            f"set options.substeps to {int(np.ceil(substeps * step * fastest / 2))} or "
            "more, or use implicit-euler",
        )


def _build_solver(matrix: csr_array, method: str) -> Callable[[Floats], Floats]:
    """Return a function that solves matrix · x = b for x.

    method: "sparse" factors or "schulz" iteration. FinloopError for any other method.
    """
    if method == "schulz":
        inverse, _iterations, _residual = invert_by_schulz(matrix.toarray())
        return lambda right: inverse @ right
    if method == "sparse":
        factors = splu(csc_array(matrix))
        return lambda right: factors.solve(np.ascontiguousarray(right))
    raise FinloopError(f"options.inverse {method!r}", "sparse or schulz", "choose one of the two")


def invert_by_schulz(matrix: Floats) -> tuple[Floats, int, float]:
    """Return a matrix's inverse X, the number of iterations, and the largest entry of |I − X C|.

    matrix: C. The method is Schulz iteration, X ← 2X − XCX from Cᵀ / ‖CᵀC‖, until that entry is at
    most SCHULZ_TOLERANCE. The paper names no norm; this one is the largest row sum, which bounds
    every eigenvalue, so the iteration converges. FinloopError if C is singular, or nearly.
    """
    unit = np.eye(len(matrix))
    x = matrix.T / np.abs(matrix.T @ matrix).sum(axis=1).max()
    for iteration in range(SCHULZ_ITERATIONS):
        deviation = unit - x @ matrix
        residual = float(np.abs(deviation).max())
        if residual <= SCHULZ_TOLERANCE:
            return x, iteration, residual
        x = x + deviation @ x
    raise FinloopError(
        f"the Schulz iteration has a residual of {residual:.2g} after {SCHULZ_ITERATIONS} steps",
        f"{SCHULZ_TOLERANCE:g}: a matrix far from singular",
        "raise mass_damping, or set options.inverse to sparse",
    )


# --- energy and momentum


def total_energy(problem: Problem, motion: Trajectory) -> Floats:
    """Return the kinetic plus elastic energy (t,) at every time: ½ ρ ∫ |u̇|² + ½ ∫ e₀ |u′|².

    u is the displacement from rest, ρ the density, e₀ the elastic constant.
    """
    n = len(problem.rest)
    k = stiffness_eigenvalues(problem.wavelet, n, problem.material.elastic)
    counts = np.full(len(k), 2.0)  # of each mode of rfft in the full transform
    counts[[0, -1]] = 1
    squared_modes = np.abs(np.fft.rfft(motion.displacement, axis=1)) ** 2
    elastic = np.einsum("tmd,m->t", squared_modes, counts * k) / n**2
    kinetic = problem.material.density * (motion.velocity**2).sum(axis=(1, 2)) / n
    return (elastic + kinetic) / 2
