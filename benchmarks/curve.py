"""Speed and error of the wavelet curves: against PyWavelets, scipy's integrator, a sparse product.

`python -m benchmarks.curve` prints the tables and writes benchmarks/curve.csv. Ratios come from
runs in turn. The exact solution is that of a bent hoop of 1024 points; peers get sparse K in the φ
basis. Round trips, off-diagonal energies, the errors of all methods, and time and error against the
number of control points (Figs. 7, 14) are printed only.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd
import pywt
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.sparse import csr_array

from benchmarks.pipeline import write_table
from benchmarks.speed import time_call, time_pairs
from finloop.curve.dynamics import Material, Problem, SolverOptions, solve_motion
from finloop.curve.stiffness import off_diagonal_share, stiffness_matrix
from finloop.curve.wavelet import CUBIC, inverse_transform, wavelet_transform

CURVES, POINTS, LEVELS = 1000, 1024, 6
LARGE, LIMIT_S = 4096, 0.1
TIMES = np.linspace(0, 1, 61)  # the paper's τ: a swing of the slowest mode
CONTROL = (4, 8, 16, 32, 64, 128, 256)
TIGHT = 1e-10
MATERIAL = Material(1.0, 1.0, 0.5, 0.0)
MASSLESS = Material(0.0, 1.0, 1.0, 0.01)
WAVELETS = ("db3", "db4", "db6", "sym8", "coif1", "coif2", "coif5")


def transform_one_by_one(points: NDArray) -> list[list[NDArray]]:
    """Return the wavelet coefficients by PyWavelets, one curve and one coordinate at a time."""
    return [
        pywt.wavedec(column, "coif2", mode="periodization", level=LEVELS)
        for curve in points
        for column in np.ascontiguousarray(curve.T)
    ]


def compare_transforms() -> tuple[str, float, float, float]:
    """Return the row of the table on transforms; print the worst round trip."""
    points = np.random.default_rng(0).normal(size=(CURVES, POINTS, 2))
    timing = time_pairs(
        partial(wavelet_transform, points, "coif2", LEVELS), partial(transform_one_by_one, points)
    )
    few_curves, worst_error = points[:4], 0.0
    for name in (*pywt.wavelist(kind="discrete"), CUBIC):
        if name != "dmey":
            returned = inverse_transform(wavelet_transform(few_curves, name, 3), name, 3)
            worst_error = max(worst_error, float(np.abs(returned - few_curves).max()))
    print(f"worst round trip of all wavelets but dmey: {worst_error:.1e}")
    return ("coif2 forward / PyWavelets, curve by curve", *timing[:3])


def bend_hoop(point_count: int) -> tuple[NDArray, NDArray]:
    """Return the hoop of the curve paper and a displacement that bends it, each (n, 2)."""
    t = 2 * np.pi * np.arange(point_count) / point_count
    rest = np.stack([np.cos(t), np.sin(t)], axis=1)
    x, y = 0.35 * np.cos(t) + 0.2 * np.cos(3 * t), -0.4 * np.sin(t) + 0.2 * np.cos(2 * t)
    return rest, np.stack([x, y], axis=1)


def integrate_with_scipy(problem: Problem) -> NDArray:
    """Integrate (3.15) in the φ basis with scipy's DOP853, (t, n, 2)."""
    n = len(problem.rest)
    k = stiffness_matrix(problem.wavelet, n, 0)
    size = 2 * n

    def slope(time: float, state: NDArray) -> NDArray:
        u, v = state[:size].reshape(n, 2), state[size:].reshape(n, 2)
        resistance = k @ u + MATERIAL.mass_damping * v
        return np.concatenate([state[size:], -resistance.ravel()])

    start = np.concatenate([problem.displacement.ravel(), np.zeros(size)])
    result = solve_ivp(
        slope, (TIMES[0], TIMES[-1]), start, "DOP853", TIMES, rtol=TIGHT, atol=TIGHT / 100
    )
    return result.y[:size].T.reshape(len(TIMES), n, 2)


def change_basis(stiffness: csr_array, basis: csr_array) -> csr_array:
    """Return a stiffness matrix in another basis, by two sparse products."""
    return basis @ stiffness @ basis.T


def compare_exact_solutions() -> tuple[str, float, float, float]:
    """Return the row of the table on exact solutions; print how far apart they are."""
    problem = Problem(*bend_hoop(POINTS), MATERIAL, TIMES)
    ours_s, theirs_s, ratio, motion = time_pairs(
        lambda: solve_motion(problem), lambda: integrate_with_scipy(problem)
    )
    difference = np.abs(motion.displacement - integrate_with_scipy(problem)).max()
    print(
        f"exact solution against solve_ivp: {difference:.1e} apart, {1 / ratio:.0f} times as fast"
    )
    return f"exact solution, {POINTS} points / solve_ivp at {TIGHT:g}", ours_s, theirs_s, ratio


def time_stiffness_matrices() -> Iterator[tuple[str, float, float, float]]:
    """Yield the rows of the table on the stiffness matrix K in wavelet bases."""
    for levels in (1, 4, 8):
        work = partial(stiffness_matrix, "coif2", LARGE, levels)
        seconds = min(time_call(work)[0] for _ in range(5))
        what = f"K, {LARGE} × {LARGE}, {levels} levels / the limit"
        yield what, seconds, LIMIT_S, seconds / LIMIT_S
    basis = csr_array(wavelet_transform(np.eye(POINTS), "coif2", 4))
    k = stiffness_matrix("coif2", POINTS, 0)
    timing = time_pairs(
        lambda: stiffness_matrix("coif2", POINTS, 4), lambda: change_basis(k, basis)
    )
    yield (f"K, {POINTS} × {POINTS}, 4 levels / sparse W K Wᵀ", *timing[:3])


def print_method_errors() -> None:
    """Print error and time of the methods of `solve_motion`."""
    for method, material, options in (
        ("modal", MATERIAL, SolverOptions()),
        ("runge-kutta", MATERIAL, SolverOptions()),
        ("runge-kutta", MATERIAL, SolverOptions(rtol=1e-10, integrator="DOP853")),
        ("decoupled", MATERIAL, SolverOptions()),
        ("modal", MASSLESS, SolverOptions()),
        ("implicit-euler", MASSLESS, SolverOptions()),
        ("implicit-euler", MASSLESS, SolverOptions(inverse="schulz")),
        ("explicit-euler", MASSLESS, SolverOptions()),
        ("explicit-euler", MASSLESS, SolverOptions(inverse="schulz")),
        ("decoupled", MASSLESS, SolverOptions()),
    ):
        problem = Problem(*bend_hoop(256), material, TIMES)
        seconds, motion = time_call(partial(solve_motion, problem, method, options))
        detail = options.integrator if method == "runge-kutta" else ""
        detail = options.inverse if method.endswith("euler") else detail
        print(
            f"{method} {detail}, density {material.density:g}: error {motion.error:.1e}, "
            f"{1e3 * seconds:.1f} ms"
        )


def print_costs_of_levels() -> None:
    """Print time and error of a hoop solved at fewer control points than its CONTROL[-1].

    The paper's Runge-Kutta works in the φ basis; a step of it must follow the stiffest mode, whose
    frequency grows with the number of control points.
    """
    problem = Problem(*bend_hoop(CONTROL[-1]), MATERIAL, TIMES)
    fine = solve_motion(problem).displacement
    options = SolverOptions(levels=0)
    rows = []
    for level in reversed(range(len(CONTROL))):
        runs = [
            min((time_call(partial(solve_motion, problem, method, options, level))
                 for _ in range(5)), key=lambda run: run[0])
            for method in ("modal", "runge-kutta")
        ]  # fmt: skip
        errors = [float(np.abs(motion.displacement - fine).max()) for _, motion in runs]
        (modal_s, _), (runge_kutta_s, _) = runs
        rows.append((CONTROL[-1] >> level, 1e3 * modal_s, 1e3 * runge_kutta_s, *errors))
    columns = ["control points", "modal [ms]", "Runge-Kutta [ms]", "modal error", "its error"]
    print("cost of a level, with the rebuilt curves; errors in radii of the hoop:")
    print(pd.DataFrame(rows, columns=columns).round(4).to_string(index=False))


def main() -> None:
    """Time transforms, integrators and products; print and write the tables."""
    rows = [compare_transforms(), compare_exact_solutions(), *time_stiffness_matrices()]
    numbers = ["ours_s", "theirs_s", "ratio"]
    table = pd.DataFrame(rows, columns=["what", *numbers])
    table[numbers] = table[numbers].map(lambda number: float(f"{number:.4g}"))
    write_table(__file__, table)
    shares = pd.DataFrame({
        name: [100 * off_diagonal_share(stiffness_matrix(name, POINTS, m)) for m in range(7)]
        for name in WAVELETS
    })  # fmt: skip
    print("off-diagonal energy of K [%] per level:")
    print(shares.round(1).to_string(index_names=False))
    print_method_errors()
    print_costs_of_levels()


if __name__ == "__main__":
    main()
