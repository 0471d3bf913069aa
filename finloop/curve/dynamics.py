"""Deformation of a curve by its stiffness (curve paper §3.1, §3.3): M q̈ + C q̇ + K q = Q (Eq. 3.3).

Glossary: *rest* u₀ (n, d) the natural shape; *displacement* u from it; ρ *density*, e₀ *elastic*,
s₁ *mass_damping*, s₂ *stiffness_damping*; Q a force per length, at every point.

`solve_motion` is the entry. In the φ basis K is circulant, and an FFT decouples it exactly. This is
the method "modal", the reference for the errors of all other methods. The parameter of a curve runs
from 0 to 1, so with e₀ = ρ = 1 mode m swings m times in a unit of time, at any n.

An open curve moves as one half of the closed curve that `curve.wavelet.close_by_mirroring` makes.
K preserves that symmetry, and the ends are free.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
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
from finloop.curve.wavelet import inverse_transform, wavelet_transform

METHODS = ("modal", "runge-kutta", "explicit-euler", "implicit-euler", "decoupled")
SCHULZ_ITERATIONS = 100
"""Largest number of Schulz iterations; every matrix that float64 can invert needs fewer."""

_MOST_EVALUATIONS = 50_000  # of a force that depends on place and time

ForceField = Callable[[float, Floats], Floats]
"""The force Q (n, d) as a function of time and the points' places (n, d)."""
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
    """A curve of n points, a power of two, that is bent and released at times[0].

    rest (n, d): its shape without force; displacement (n, d) from it at times[0], and velocity (n,
    d), None = 0. times (t,): ascending, at which the motion is wanted. force: (n, d); (d,) for the
    same force at every point; a function of time and places; or None.
    """

    rest: Floats
    displacement: Floats
    material: Material
    times: Floats
    velocity: Floats | None = None
    force: Floats | ForceField | None = None
    wavelet: str = "coif2"

    def state_at_start(self) -> Floats:
        """Return displacement and velocity of the points at times[0], (2, n, d)."""
        u = np.asarray(self.displacement, np.float64)
        return np.stack([u, np.zeros_like(u) if self.velocity is None else self.velocity])

    def force_at(self, time: float, displacement: Floats) -> Floats:
        """Return the force Q (n, d) on points displaced by (n, d) from rest, at a time."""
        if callable(self.force):
            return np.broadcast_to(self.force(time, self.rest + displacement), displacement.shape)
        return np.zeros_like(displacement) + (0 if self.force is None else self.force)


@dataclass(frozen=True)
class SolverOptions:
    """Settings of the methods of `curve.dynamics.solve_motion`.

    All methods but "modal" use `levels` of the wavelet basis. "runge-kutta" uses the relative
    tolerance `rtol` and scipy's `integrator`. Euler takes `substeps` between two times and inverts
    the damping matrix C by "sparse" factors or "schulz". "modal" and "decoupled" use `tolerance` if
    the force depends on place and time.
    """

    levels: int = 3
    rtol: float = 1e-6
    integrator: str = "RK45"
    substeps: int = 10
    inverse: str = "sparse"
    tolerance: float = 1e-9


@dataclass(frozen=True)
class Trajectory:
    """Motion of a curve: displacements from rest and velocities, each (t, n, d), and their error.

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
    """Result of one method: displacements and velocities, each (t, n, d), and counts by name."""

    displacement: Floats
    velocity: Floats
    facts: dict[str, float]


def solve_motion(
    problem: Problem, method: str = "modal", options: SolverOptions | None = None
) -> Trajectory:
    """Return the motion of a curve that is bent and released: M q̈ + C q̇ + K q = Q (Eq. 3.3).

    q is the displacement from rest, Q the force; M, C, K are mass, damping and stiffness. method:
    "modal" is exact. "runge-kutta" has adaptive steps (Eq. 3.15). "explicit-euler" and
    "implicit-euler" need density 0. "decoupled" uses the diagonal of K alone, in the wavelet basis
    (Eq. 3.16). FinloopError if the problem or the method's settings are invalid; the message names
    them.
    """
    options = options or SolverOptions()
    problem = _check_problem(problem, method)
    exact = _solve_modal(problem, options)
    if method == "modal":
        error = exact.facts["estimate"]
        return Trajectory(problem.times, exact.displacement, exact.velocity, error, exact.facts)
    if method == "decoupled":
        solution = _solve_decoupled(problem, options)
    elif method == "runge-kutta":
        solution = solve_by_runge_kutta(problem, options)
    else:
        solution = solve_by_euler(problem, options, implicit=method == "implicit-euler")
    deviation = np.abs(solution.displacement - exact.displacement).max()
    largest = np.abs(exact.displacement).max()
    error = float(deviation / largest) if largest else float(deviation)
    return Trajectory(
        problem.times, solution.displacement, solution.velocity, error, solution.facts
    )


def _check_problem(problem: Problem, method: str) -> Problem:
    """Convert a problem's fields to arrays; FinloopError if the method cannot solve it."""
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
    return Problem(rest, u, material, times, velocity=v, force=force, wavelet=problem.wavelet)


# --- independent oscillators, ρ a″ + c a′ + k a = Q (Eq. 3.16; the paper prints r̈, ṙ, e₀ and f₀)


@dataclass(frozen=True)
class Oscillators:
    """Independent oscillators, m in number: one density ρ, dampings c (m,), stiffnesses k (m,)."""

    density: float
    damping: Floats
    stiffness: Floats

    def count_root_kinds(self) -> dict[str, int]:
        """Count the oscillators by the roots of ρr² + c r + k = 0: "real", "double", "complex".

        Real roots creep, complex roots swing. If ρ = 0 every oscillator has one root, and counts as
        real or, with c = 0, as double.
        """
        discriminant = self.damping**2 - 4 * self.density * self.stiffness
        signs = {"real": discriminant > 0, "double": discriminant == 0, "complex": discriminant < 0}
        return {kind: int(is_kind.sum()) for kind, is_kind in signs.items()}


class Response(NamedTuple):
    """Factors (t, m) from which places and speeds of m oscillators at t times are computed.

    With a₀, v₀ the first place and speed and Q the constant force, the place is place · a₀ + speed
    · v₀ + pushed · Q. The three `_rate` fields give the speed in the same way.
    """

    place: Floats
    speed: Floats
    pushed: Floats
    place_rate: Floats
    speed_rate: Floats
    pushed_rate: Floats


def oscillator_response(oscillators: Oscillators, times: Floats, forced: bool = True) -> Response:
    """Return the factors that solve Eq. 3.16 for independent oscillators, at times (t,).

    The factors are (t, m). forced: False sets the factor `pushed` of the force to 0, and saves half
    of the time. The formulas neither cancel nor overflow near double roots, where swinging becomes
    creeping.
    """
    t = np.asarray(times, np.float64)[:, None]
    k = oscillators.stiffness
    if oscillators.density == 0:
        rate = k / oscillators.damping
        place = np.exp(-rate * t)
        zeros = np.zeros_like(place)
        pushed = t * _mean_of_decay(rate * t) / oscillators.damping
        return Response(place, zeros, pushed, -rate * place, zeros, place / oscillators.damping)
    # The roots are r = −γ ± √(γ² − k / ρ). Real ones creep; `slow` is the one nearer to 0, as
    # (k / ρ) / (γ + √…), which does not cancel. Complex ones decay by γ and swing.
    gamma, square = oscillators.damping / (2 * oscillators.density), k / oscillators.density
    discriminant = gamma**2 - square
    root, creeps = np.sqrt(np.abs(discriminant)), discriminant >= 0
    slow = np.where(creeps, square / np.where(creeps & (gamma + root > 0), gamma + root, 1), gamma)
    decay = np.exp(-slow * t)  # becomes the factor of the place where γ is 0
    speed = decay * t
    root_distance, angle = 2 * root[creeps] * t, root[~creeps] * t
    decay[:, creeps] *= (1 + np.exp(-root_distance)) / 2
    speed[:, creeps] *= _mean_of_decay(root_distance)
    decay[:, ~creeps] *= np.cos(angle)
    speed[:, ~creeps] *= np.sin(angle) / np.where(angle > 0, angle, 1) + (angle == 0)
    place = decay + gamma * speed
    pushed = np.zeros_like(place)
    if forced:
        moved = _force_response(2 * gamma * t, square * t**2, slow * t, place)
        pushed = t**2 * moved / oscillators.density
    return Response(
        place, speed, pushed,
        place_rate=-square * speed,
        speed_rate=decay - gamma * speed,
        pushed_rate=speed / oscillators.density,
    )  # fmt: skip


def _mean_of_decay(x: Floats) -> Floats:
    """Return the mean of e^−s for s from 0 to x, (1 − e^−x) / x; it is 1 at 0."""
    return np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1), 1)


def _force_response(total: Floats, product: Floats, slow: Floats, place: Floats) -> Floats:
    """Return how far a constant force of 1 moves oscillators: (1 − place) / product.

    −x, −y are the roots in steps of t, `total` = x + y, `product` = xy, `slow` the x nearer 0. With
    D = `_mean_of_decay` the value is (D(x) − D(y)) / (y − x), or a power series if both are small.
    """
    # Each formula is evaluated everywhere, on harmless numbers where it does not hold.
    term, last_term = np.ones_like(product), np.zeros_like(product)
    series = np.zeros_like(product)
    small_total, small_product = np.minimum(total, 0.5), np.minimum(product, 0.25)
    for n in range(1, 16):
        series += (-1) ** (n + 1) * term / factorial(n + 1)
        term, last_term = small_total * term - small_product * last_term, term
    unequal = product < 0.01 * total**2  # x is much nearer 0 than y
    x, y = np.where(unequal, slow, 0), np.where(unequal, total - slow, 1)
    by_roots = (_mean_of_decay(x) - _mean_of_decay(y)) / (y - x)
    by_place = (1 - place) / np.where(product > 0, product, 1)
    return np.where((total < 0.5) & (product < 0.25), series, np.where(unequal, by_roots, by_place))


def oscillator_motion(
    oscillators: Oscillators, a: Numbers, v: Numbers, times: Floats, force: Numbers | None
) -> tuple[Numbers, Numbers]:
    """Return exact places and speeds, (t, m, d) each, of m oscillators under a constant force.

    a, v (m, d): places and speeds at the start, may be complex as FFTs are; times (t,): since the
    start; force (m, d), or None for none.
    """
    response = oscillator_response(oscillators, times, forced=force is not None)
    factors = Response(*(field[..., None] for field in response))
    places = factors.place * a + factors.speed * v
    speeds = factors.place_rate * a + factors.speed_rate * v
    if force is not None:
        places, speeds = places + factors.pushed * force, speeds + factors.pushed_rate * force
    return places, speeds


# --- in a basis in which K is diagonal, or treated as diagonal


class Basis(NamedTuple):
    """A basis for the coefficients of a curve in which the stiffness K is, or counts as, diagonal.

    transform: from points (n, d) to coefficients (m, d); inverse: its inverse, from (…, m, d) to
    (…, n, d); k: the diagonal (m,) of the stiffness K.
    """

    transform: Callable[[Floats], Numbers]
    inverse: Callable[[Numbers], Floats]
    k: Floats


def _solve_modal(problem: Problem, options: SolverOptions) -> Solution:
    """Return the exact motion, by a Fourier transform, which makes the circulant K diagonal."""
    n = len(problem.rest)
    basis = Basis(
        transform=lambda points: np.fft.rfft(points, axis=0),
        inverse=lambda modes: np.fft.irfft(modes, n, axis=-2),
        k=stiffness_eigenvalues(problem.wavelet, n, problem.material.elastic),
    )
    return _solve_in_basis(basis, problem, options)


def _solve_decoupled(problem: Problem, options: SolverOptions) -> Solution:
    """Return the motion by Eq. 3.16, which keeps only the diagonal of K in the wavelet basis."""
    n, wavelet, levels = len(problem.rest), problem.wavelet, options.levels
    basis = Basis(
        transform=lambda points: wavelet_transform(points, wavelet, levels),
        inverse=lambda q: inverse_transform(np.asarray(q, float), wavelet, levels),
        k=stiffness_matrix(wavelet, n, levels, problem.material.elastic).diagonal(),
    )
    return _solve_in_basis(basis, problem, options)


def _solve_in_basis(basis: Basis, problem: Problem, options: SolverOptions) -> Solution:
    """Return the motion of a curve: one independent oscillator for each coefficient of a basis.

    Under a constant force the motion is exact; any other force is integrated.
    """
    material, (u, v) = problem.material, problem.state_at_start()
    mass = material.density or 1.0  # as `Material` says
    damping = material.mass_damping * mass + material.stiffness_damping * basis.k
    modes = Oscillators(material.density, damping, basis.k)
    facts = {f"{kind}_roots": float(count) for kind, count in modes.count_root_kinds().items()}
    if callable(problem.force):
        return _integrate_changing_force(basis, modes, problem, facts, options.tolerance)
    force = None if problem.force is None else basis.transform(problem.force_at(0.0, u))
    places, speeds = oscillator_motion(
        modes, basis.transform(u), basis.transform(v), problem.times - problem.times[0], force
    )
    return Solution(basis.inverse(places), basis.inverse(speeds), {**facts, "estimate": 0.0})


def _integrate_changing_force(
    basis: Basis, modes: Oscillators, problem: Problem, facts: dict[str, float], tolerance: float
) -> Solution:
    """Return the motion under a force that depends on place and time, by scipy's integrators.

    modes: the oscillators; facts: counts to add to the result. The integrator's tolerance is
    lowered until the places change by at most `tolerance`, relative to the farthest place: the
    estimate of the error. FinloopError if the force changes too fast.
    """
    too_fast = FinloopError(
        f"the force changes too fast for {_MOST_EVALUATIONS} evaluations",
        f"a smooth force, with places accurate to {tolerance:g}",
        "smooth or weaken the force, or pass times that lie closer together",
    )
    shape, density = problem.displacement.shape, modes.density
    k, c = modes.stiffness[:, None], modes.damping[:, None]
    evaluations = 0

    def slope(time: float, state: Floats) -> Floats:
        """Return the rate of change of a state, displacements and speeds, as one flat array."""
        nonlocal evaluations
        evaluations += 1
        if evaluations > _MOST_EVALUATIONS:
            raise too_fast
        u, v = state.reshape(2, *shape)
        force = basis.transform(problem.force_at(time, u)) - k * basis.transform(u)
        if density == 0:
            return np.stack([basis.inverse(force / c), np.zeros(shape)]).ravel()
        return np.stack([v, basis.inverse(force - c * basis.transform(v)) / density]).ravel()

    start = problem.state_at_start().ravel()
    formula = "DOP853" if density else "LSODA"  # without mass the equations are stiff
    span, last_u = (problem.times[0], problem.times[-1]), None
    for rtol in tolerance * np.array([0.1, 0.01, 1e-3, 1e-4]):
        atol = rtol * (np.abs(start).max() or 1.0)
        result = scipy.integrate.solve_ivp(
            slope, span, start, method=formula, t_eval=problem.times,
            rtol=max(rtol, 3e-14), atol=atol,  # scipy refuses less
        )  # fmt: skip
        if not result.success:
            raise too_fast
        u, v = np.moveaxis(result.y.T.reshape(-1, 2, *shape), 1, 0)
        if last_u is not None:
            largest = np.abs(u).max()
            change = float(np.abs(u - last_u).max() / largest) if largest else 0.0
            if change <= tolerance:
                break
        last_u = u
    else:
        raise too_fast
    if density == 0:
        # Without mass the speed is no part of the state: it follows from the places.
        rates = [
            slope(time, state)[: u[0].size]
            for time, state in zip(result.t, result.y.T, strict=True)
        ]
        v = np.reshape(rates, u.shape)
    return Solution(u, v, {**facts, "estimate": change})


# --- the paper's integrators (§3.3), in the wavelet basis, where K is sparse


class WaveletSystem(NamedTuple):
    """The equation of motion (Eq. 3.3) in the wavelet basis.

    It holds damping C and stiffness K (n, n), the transform of points, and the force.
    """

    c: csr_array
    k: csr_array
    transform: Callable[[Floats], Floats]  # from points (…, n, d) to coefficients (…, n, d)
    inverse: Callable[[Floats], Floats]  # its inverse
    force: Callable[[float, Floats], Floats]  # the force Q at a time and coefficients (n, d)


def _wavelet_system(problem: Problem, options: SolverOptions) -> WaveletSystem:
    """Build the equation of motion (Eq. 3.3) of a problem in the wavelet basis."""
    n, material = len(problem.rest), problem.material
    k = stiffness_matrix(problem.wavelet, n, options.levels, material.elastic)
    m = (material.density or 1.0) * eye_array(n)  # M = ρI: the basis functions are orthonormal
    c = csr_array(material.mass_damping * m + material.stiffness_damping * k)

    def transform(points: Floats) -> Floats:
        """Return the wavelet coefficients of points (…, n, d)."""
        return wavelet_transform(points, problem.wavelet, options.levels)

    def inverse(coefficients: Floats) -> Floats:
        """Return the points of wavelet coefficients (…, n, d)."""
        return inverse_transform(coefficients, problem.wavelet, options.levels)

    constant = None
    if not callable(problem.force):
        constant = transform(problem.force_at(0.0, problem.displacement))

    def force(time: float, q: Floats) -> Floats:
        """Return the coefficients (n, d) of the force at a time and coefficients q (n, d)."""
        return transform(problem.force_at(time, inverse(q))) if constant is None else constant

    return WaveletSystem(c, k, transform, inverse, force)


def solve_by_runge_kutta(problem: Problem, options: SolverOptions) -> Solution:
    """Return the motion by an adaptive Runge–Kutta formula of scipy (Eq. 3.15).

    The density must not be 0. FinloopError if the formula fails.
    """
    system, shape = _wavelet_system(problem, options), problem.displacement.shape
    density = problem.material.density
    start = system.transform(problem.state_at_start())

    def slope(time: float, state: Floats) -> Floats:
        """Return the rate of change of a state, coefficients and their rates, as one flat array."""
        q, rate = state.reshape(2, *shape)
        resistance = system.k @ q + system.c @ rate
        acceleration = (system.force(time, q) - resistance) / density
        return np.concatenate([rate.ravel(), acceleration.ravel()])

    scale = float(np.abs(start).max()) or 1.0
    state, states, evaluations, step = start.ravel(), [start.ravel()], 0, None
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
        evaluations += result.nfev
        states.append(state)
    q, rate = np.moveaxis(np.reshape(states, (-1, 2, *shape)), 1, 0)
    return Solution(system.inverse(q), system.inverse(rate), {"evaluations": float(evaluations)})


def solve_by_euler(problem: Problem, options: SolverOptions, implicit: bool) -> Solution:
    """Return the motion of a curve without mass, C q̇ + K q = Q, by Euler's steps (§3.3).

    Explicit, q(t + Δt) = q + Δt C⁻¹(Q − K q): FinloopError if Δt is too long for stable steps.
    Implicit, q(t + Δt) = (C + Δt K)⁻¹ (C q + Δt Q), with Q at time t: stable at any Δt.
    FinloopError if the times are not even.
    """
    times, substeps = problem.times, options.substeps
    intervals = np.diff(times)
    if (
        substeps < 1
        or not len(intervals)
        or not np.allclose(intervals, intervals[0], rtol=1e-9, atol=0)
    ):
        raise FinloopError(
            f"{len(times)} times, perhaps unevenly spaced, and {substeps} substeps",
            "two or more evenly spaced times and at least 1 substep, for Euler's method",
            "correct the times or options.substeps, or use the method modal",
        )
    step = float(intervals.mean()) / substeps
    system = _wavelet_system(problem, options)
    c, k = system.c, system.k
    if not implicit:
        stiffest = float(np.abs(k).sum(axis=1).max())  # no eigenvalue is larger
        material = problem.material
        fastest = stiffest / (material.mass_damping + material.stiffness_damping * stiffest)
        if step * fastest > 2:
            raise FinloopError(
                f"explicit Euler with steps of {step:.3g}",
                f"steps of {2 / fastest:.3g} at most: longer steps are unstable",
                f"set options.substeps to {int(np.ceil(substeps * step * fastest / 2))} or "
                "more, or use implicit-euler",
            )
    solve, facts = _build_solver(csr_array(c + step * k) if implicit else c, options.inverse)
    solve_c = _build_solver(c, "sparse")[0] if implicit else solve
    q = system.transform(problem.displacement)
    states = [q]
    for first in times[:-1]:
        for time in first + step * np.arange(substeps):
            force = system.force(time, q)
            q = solve(c @ q + step * force) if implicit else q + step * solve(force - k @ q)
        states.append(q)
    rates = [solve_c(system.force(time, q) - k @ q) for time, q in zip(times, states, strict=True)]
    facts["steps"] = float(substeps * len(intervals))
    displacement, velocity = (system.inverse(np.stack(q)) for q in (states, rates))
    return Solution(displacement, velocity, facts)


def _build_solver(
    matrix: csr_array, method: str
) -> tuple[Callable[[Floats], Floats], dict[str, float]]:
    """Return a function that solves matrix · x = right for x, and facts about its factors.

    method: "sparse" factors or "schulz" iteration. The facts are `factors_nonzero`, or
    `schulz_iterations` and `schulz_residual`. FinloopError for any other method.
    """
    if method == "schulz":
        x, iterations, residual = invert_by_schulz(matrix.toarray())
        facts = {"schulz_iterations": float(iterations), "schulz_residual": residual}
        return lambda right: x @ right, facts
    if method == "sparse":
        factors = splu(csc_array(matrix))
        facts = {"factors_nonzero": float(factors.nnz)}
        return lambda right: factors.solve(np.ascontiguousarray(right)), facts
    raise FinloopError(f"options.inverse {method!r}", "sparse or schulz", "choose one of the two")


def invert_by_schulz(matrix: Floats, tolerance: float = 1e-10) -> tuple[Floats, int, float]:
    """Invert a matrix C (n, n) by Schulz iteration, X ← 2X − XCX from Cᵀ / ‖CᵀC‖.

    Return the inverse (n, n), the number of iterations, and the largest entry of |I − XC|, at most
    `tolerance`. The paper names no norm; this one is the largest row sum, which bounds every
    eigenvalue, so the iteration converges. FinloopError if the matrix is singular, or nearly.
    """
    unit = np.eye(len(matrix))
    x = matrix.T / np.abs(matrix.T @ matrix).sum(axis=1).max()
    for iteration in range(SCHULZ_ITERATIONS):
        deviation = unit - x @ matrix
        residual = float(np.abs(deviation).max())
        if residual <= tolerance:
            return x, iteration, residual
        x = x + deviation @ x
    raise FinloopError(
        f"the Schulz iteration has a residual of {residual:.2g} after {SCHULZ_ITERATIONS} steps",
        f"{tolerance:g}: a matrix far from singular",
        "raise mass_damping, or set options.inverse to sparse",
    )


# --- energy and momentum


def total_energy(problem: Problem, motion: Trajectory) -> Floats:
    """Return the kinetic plus elastic energy (t,) at every time: ½ ρ ∫ |u̇|² + ½ ∫ e₀ |u′|².

    u is the displacement from rest, ρ the density, e₀ the elastic constant.
    """
    n = len(problem.rest)
    k = stiffness_eigenvalues(problem.wavelet, n, problem.material.elastic)
    counts = np.full(len(k), 2.0)  # rfft leaves out the mirror images
    counts[[0, -1]] = 1
    modes = np.abs(np.fft.rfft(motion.displacement, axis=1)) ** 2
    elastic = np.einsum("tmd,m->t", modes, counts * k) / n**2
    kinetic = problem.material.density * (motion.velocity**2).sum(axis=(1, 2)) / n
    return (elastic + kinetic) / 2
