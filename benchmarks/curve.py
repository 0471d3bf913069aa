"""Speed and error of the wavelet curves: against PyWavelets, scipy's integrator, a sparse product.

`python -m benchmarks.curve` prints the tables and writes benchmarks/curve.csv. Ratios come from
runs in turn. The exact solution is that of a bent hoop of 1024 points; peers get sparse K in the φ
basis. Round trips, off-diagonal energies, the errors of all methods, and time and error against the
number of control points (Figs. 7, 14) are printed only.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

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
from finloop.drawn.dog.walk import DogFilm, true_limb_contours
from finloop.gait.coarse import few_point_contours
from finloop.gait.model import Gait, HalfCycleLayout, contours_at_phases
from finloop.gait.truth import true_gamma

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
    """Print time and error of a hoop solved at fewer control points than all (Fig. 7).

    The paper's Runge-Kutta works in the φ basis; a step of it must follow the stiffest mode, whose
    frequency grows with the number of control points.
    """
    problem = Problem(*bend_hoop(CONTROL[-1]), MATERIAL, TIMES)
    fine = solve_motion(problem).displacement
    options = SolverOptions(levels=0)
    rows = []
    for control in CONTROL:
        level = int(np.log2(CONTROL[-1] // control))
        row: list[float] = [control]
        for method in ("modal", "runge-kutta"):
            ms, motion = fastest_call(partial(solve_motion, problem, method, options, level))
            row += [ms, float(np.abs(motion.displacement - fine).max())]
        rows.append(row)
    columns = ["points", "modal, ms", "error", "Runge-Kutta, ms", "error"]
    print("a hoop solved at few control points, curves rebuilt; errors in radii:")
    print_rounded(rows, columns)


def print_costs_of_gait() -> None:
    """Print time and error of a gait cycle solved at few control points (Fig. 14): the drawn dog.

    Its keys are exact: frames 1 and 2 of a film of four frames a cycle.
    """
    dog, phases = DogFilm(frames=4, cycles=1), np.arange(24) / 24
    contours = true_limb_contours(dog, CONTROL[-2])
    key1, key2 = ({name: points[k] for name, points in contours.items()} for k in (0, 1))
    gamma = {name: {letter: (gamma,) for letter, gamma in subcycles.items()}
             for name, subcycles in true_gamma(dog).items()}  # fmt: skip
    gait = Gait("dog", "swap", dog.frequency_hz, gamma)
    layout = HalfCycleLayout()
    whole = fastest_call(partial(contours_at_phases, (key1, key2), gait, phases, layout))
    rows = [[CONTROL[-2], whole[0], 0.0]]
    for control in (4, 16, 64):
        few = partial(few_point_contours, (key1, key2), gait, phases, layout, control)
        ms, frames = fastest_call(few)
        off = np.stack([frames[name] - whole[1][name] for name in frames])
        rms = np.sqrt((off**2).sum(axis=-1).mean())
        rows.append([control, ms, 100 * float(rms) / dog.body_length_px])
    print("a gait cycle solved at few control points, curves rebuilt; error in % of body length:")
    print_rounded(rows, ["points", "ms", "error"])


def fastest_call(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the least time of five calls, in ms, and the result."""
    seconds, result = min((time_call(work) for _ in range(5)), key=lambda run: run[0])
    return 1e3 * seconds, result


def print_rounded(rows: list[list[float]], columns: list[str]) -> None:
    """Print a table of numbers with two significant digits."""
    table = pd.DataFrame(rows, columns=columns)
    print(table.to_string(index=False, float_format=lambda number: f"{number:.2g}"))


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
    print_costs_of_gait()


if __name__ == "__main__":
    main()
