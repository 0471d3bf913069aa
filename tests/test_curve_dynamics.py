"""Dynamics of deformed curves: laws, closed forms, every method against the exact one.

The hoop is a circle of radius 1; mode k of it swings k times in a unit of time (e₀ = ρ = 1).
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from finloop.base.errors import FinloopError
from finloop.curve.dynamics import (
    METHODS,
    Material,
    Oscillators,
    Problem,
    SolverOptions,
    invert_by_schulz,
    oscillator_motion,
    oscillator_response,
    solve_motion,
    total_energy,
)
from finloop.curve.stiffness import stiffness_matrix
from finloop.curve.wavelet import (
    close_by_mirroring,
    control_points,
    curves_from_control,
    drop_details,
)
from finloop.plots.curve import figure6, figure7

TIGHT = SolverOptions(rtol=1e-8, integrator="DOP853", substeps=30)
TIMES = np.linspace(0, 0.5, 11)
LIGHT = Material(1, 1, 0.5, 0.001)
MASSLESS = Material(0, 1, 1.0, 0.01)


def hoop(n):
    t = 2 * np.pi * np.arange(n) / n
    return np.stack([np.cos(t), np.sin(t)], axis=1)


def wobble(n, seed=0):
    """A smooth displacement."""
    t = 2 * np.pi * np.arange(n) / n
    weights = np.random.default_rng(seed).normal(size=(2, 4, 2)) / np.arange(1, 5)[:, None] ** 2
    waves = np.stack([np.cos(np.outer(t, np.arange(1, 5))), np.sin(np.outer(t, np.arange(1, 5)))])
    return np.einsum("cnk,ckd->nd", waves, weights)


def problem(material=LIGHT, n=64, times=TIMES, **more):
    return Problem(hoop(n), more.pop("displacement", wobble(n)), material, times, **more)


def for_method(method, **more):
    return problem(MASSLESS if method.endswith("euler") else LIGHT, **more)


# --- one oscillator: the closed form


@given(st.floats(0.1, 5), st.floats(0, 20), st.floats(0, 50), *[st.floats(-2, 2)] * 3)
@settings(max_examples=60)
def test_the_closed_form_solves_the_equation(density, c, k, a, v, q):
    """Against the exponential of the first-order system (3.15), the force a state of its own."""
    of = Oscillators(density, np.array([c]), np.array([k]))
    times = np.array([0.0, 0.3, 1.0])
    places, speeds = oscillator_motion(of, np.array([[a]]), np.array([[v]]), times, np.array([[q]]))
    system = np.array([[0, 1, 0], [-k / density, -c / density, 1 / density], [0, 0, 0]])
    for time, place, speed in zip(times, places[:, 0, 0], speeds[:, 0, 0], strict=True):
        wanted = expm(time * system) @ [a, v, q]
        assert place == pytest.approx(wanted[0], rel=1e-9, abs=1e-10)
        assert speed == pytest.approx(wanted[1], rel=1e-9, abs=1e-10)


def test_near_the_double_root_nothing_jumps_and_stiff_ones_do_not_overflow():
    near = 4 + np.array([-1e-7, -1e-12, 0, 1e-12, 1e-7])
    at = oscillator_response(Oscillators(1.0, near, np.full(5, 4.0)), np.linspace(0, 3, 7))
    for part in at:
        assert np.ptp(part, axis=1).max() < 1e-6
    for c in (3.999, 4.0001, 4.001):  # not the double root's either
        wanted = expm(np.array([[0, 1], [-4, -c]]))[0]
        one = oscillator_response(Oscillators(1.0, np.array([c]), np.array([4.0])), np.array([1.0]))
        assert np.allclose([one.of_place[0, 0], one.of_speed[0, 0]], wanted, rtol=0, atol=1e-13)
    stiff = oscillator_response(
        Oscillators(1.0, np.array([1e9, 1e9]), np.array([1e12, 0])), np.array([0, 5.0])
    )
    assert all(np.isfinite(part).all() for part in stiff)
    assert stiff.of_place[1, 0] == pytest.approx(0, abs=1e-300)
    assert stiff.of_force[1, 1] == pytest.approx(5e-9, rel=1e-6)
    free = oscillator_response(Oscillators(2.0, np.zeros(1), np.zeros(1)), np.array([3.0]))
    assert free.of_force[0, 0] == pytest.approx(9 / 4)  # ½ q t² / ρ


# --- the exact solution


def test_the_exact_solution_against_a_tight_integrator_in_the_phi_basis():
    p = problem(displacement=wobble(128), n=128, velocity=wobble(128, 1), force=np.array([1.0, -2]))
    k = stiffness_matrix("coif2", 128, 0)

    def slope(t, y):
        u, w = y.reshape(2, 128, 2)
        c = 0.5 * w + 0.001 * (k @ w)
        return np.concatenate([w.ravel(), ([1.0, -2] - k @ u - c).ravel()])

    start = np.stack([p.displacement, p.velocity]).ravel()
    found = solve_ivp(slope, (0, 0.5), start, "DOP853", TIMES, rtol=1e-10, atol=1e-12)
    ours = solve_motion(p)
    assert np.abs(ours.displacement - found.y.T.reshape(-1, 2, 128, 2)[:, 0]).max() < 1e-8
    assert np.abs(ours.velocity - found.y.T.reshape(-1, 2, 128, 2)[:, 1]).max() < 1e-6
    assert ours.error == 0


def test_a_mode_of_the_hoop_swings_so_often():
    t = 2 * np.pi * np.arange(256) / 256
    for mode in (1, 2, 3):
        u = np.stack([np.cos(mode * t), 0 * t], axis=1)
        motion = solve_motion(
            problem(Material(), 256, displacement=u, times=np.array([0, 0.5, 1]) / mode)
        )
        assert np.allclose(motion.displacement[1], -u, atol=1e-4)
        assert np.allclose(motion.displacement[2], u, atol=1e-4)


# --- laws


@given(st.floats(0.1, 5), st.floats(0.1, 5), st.floats(0, 5), st.floats(0, 0.1), st.integers(0, 99))
@settings(max_examples=30)
def test_energy_never_rises_and_stays_without_damping(density, elastic, s1, s2, seed):
    times = np.linspace(0, 2, 40)
    jagged = 0.01 * (-1.0) ** np.arange(64)[:, None]
    first = wobble(64, seed) + jagged, wobble(64, seed + 1)
    more = {"displacement": first[0], "velocity": first[1], "times": times}
    damped = problem(Material(density, elastic, s1, s2), **more)
    course = total_energy(damped, solve_motion(damped))
    assert (np.diff(course) <= 1e-12 * course[0]).all()
    free = problem(Material(density, elastic), **more)
    course = total_energy(free, solve_motion(free))
    assert np.allclose(course, course[0], rtol=1e-11)
    # As a sum over K itself.
    k = stiffness_matrix("coif2", 64, 0, elastic)
    byhand = ((first[0] * (k @ first[0])).sum() + density * (first[1] ** 2).sum()) / 2 / 64
    assert course[0] == pytest.approx(byhand)


@pytest.mark.parametrize("method", ["modal", "runge-kutta"])
def test_momentum(method):
    """ρ ∫ u̇ fades by e^{−s₁t} towards Q / s₁: what is inside the curve cannot push it.

    This holds for the exact motion and for `solve_by_runge_kutta`.
    """
    q = np.array([0.3, -1.0])
    material = Material(2.0, 3.0, 0.8, 0.002)
    for force in (None, q, np.broadcast_to(q, (64, 2))):
        p = problem(material, velocity=wobble(64, 2) + (1, 2), force=force)
        start = 2 * p.velocity.mean(axis=0)
        pushed = np.zeros(2) if force is None else q
        fade = np.exp(-0.8 * TIMES)[:, None]
        wanted = start * fade + pushed / 0.8 * (1 - fade)
        momentum = 2 * solve_motion(p, method, TIGHT).velocity.mean(axis=1)
        assert np.allclose(momentum, wanted, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_the_rest_state_stays_at_rest(method):
    p = for_method(method, displacement=np.zeros((64, 2)))
    motion = solve_motion(p, method, TIGHT)
    assert not motion.displacement.any()
    assert not motion.velocity.any()
    assert motion.error == 0


def test_refining_the_scale_converges():
    """The hoop at 8, 16, …, 128 control points against 1024 of them."""
    n = 1024
    u = wobble(n)
    fine = solve_motion(problem(n=n, displacement=u)).displacement
    p = problem(n=n, displacement=u)
    errors = [
        np.abs(solve_motion(p, level=level).displacement - fine).max() for level in (7, 6, 5, 4, 3)
    ]
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 1e-3 * errors[0]


@pytest.mark.parametrize("wavelet", ["coif2", "db4"])
@pytest.mark.parametrize("control", [4, 16])
def test_a_level_is_solved_by_its_own_k(control, wavelet):
    """Against the exponential of Eq. 3.15 in the φ basis of the level, with velocity and force."""
    n, level, zeros = 64, int(np.log2(64 // control)), np.zeros((control, control))
    force = np.array([1.0, -2]) + wobble(n, 2)
    p = problem(velocity=wobble(n, 1), force=force, wavelet=wavelet)
    u, v, q = (control_points(x, wavelet, level) for x in (p.displacement, p.velocity, force))
    k = stiffness_matrix(wavelet, control, 0).toarray()
    unit = np.eye(control)
    system = np.block([[zeros, unit, zeros], [-k, -0.5 * unit - 0.001 * k, unit], [zeros] * 3])
    wanted = expm(TIMES[-1] * system) @ np.concatenate([u, v, q])
    motion = solve_motion(p, level=level)
    for found, few in ((motion.displacement, wanted[:control]),
                       (motion.velocity, wanted[control : 2 * control])):  # fmt: skip
        assert np.allclose(found[-1], curves_from_control(few, wavelet, level), atol=1e-9)
    by_steps = solve_motion(p, "runge-kutta", SolverOptions(0, 1e-8, "DOP853"), level)
    assert np.allclose(by_steps.displacement, motion.displacement, atol=1e-5)
    cut = drop_details(solve_motion(p).displacement, wavelet, level)
    assert np.abs(cut - motion.displacement).max() > 1e-3  # solved is not cut


@pytest.mark.parametrize("method", METHODS)
def test_shifts_and_turns_do_not_matter(method):
    p = for_method(method)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    turned = Problem(p.rest @ turn + 7, p.displacement @ turn, p.material, TIMES + 3)
    a, b = solve_motion(p, method, TIGHT), solve_motion(turned, method, TIGHT)
    assert np.allclose(a.displacement @ turn, b.displacement, atol=1e-6)
    assert a.error == pytest.approx(b.error, rel=0.5, abs=1e-6)


def test_an_open_curve_has_free_ends_and_stays_its_own_mirror_image():
    t = np.linspace(0, 1, 32)
    line = close_by_mirroring(np.stack([t, 0 * t], axis=1))
    bend = close_by_mirroring(np.stack([0 * t, (t - 0.3) ** 2], axis=1))
    motion = solve_motion(Problem(line, bend, LIGHT, TIMES))
    assert np.allclose(motion.displacement[:, :32], motion.displacement[:, :31:-1], atol=1e-12)
    assert np.abs(motion.displacement[-1, :32] - bend[:32]).max() > 0.01


# --- every method against the exact one


@pytest.mark.parametrize("force", [None, np.array([0.0, 9.81])])
@pytest.mark.parametrize("method", METHODS)
def test_error_against_the_exact_solution(method, force):
    p = for_method(method, force=force)
    motion = solve_motion(p, method, TIGHT)
    exact = solve_motion(p).displacement
    off = np.abs(motion.displacement - exact).max() / np.abs(exact).max()
    if method != "modal":
        assert motion.error == pytest.approx(off)
    limit = {"modal": 0, "runge-kutta": 1e-6, "decoupled": 3.0}.get(method, 2e-2)
    assert motion.error <= limit
    assert motion.displacement.shape == motion.velocity.shape == (11, 64, 2)
    assert np.allclose(motion.displacement[0], p.displacement)
    if force is None and method not in ("modal", "decoupled"):
        course = total_energy(p, motion)
        assert (np.diff(course) <= 1e-7 * course[0]).all()
    # A velocity is the change of place.
    if method not in ("decoupled",):
        inner = (motion.displacement[2:] - motion.displacement[:-2]) / (TIMES[2] - TIMES[0])
        assert np.abs(inner - motion.velocity[1:-1]).max() < 0.2 * np.abs(motion.velocity).max()


def test_euler_is_of_first_order_and_both_inverses_agree():
    """Half the steps of `solve_by_euler` have twice its error."""
    for method in ("explicit-euler", "implicit-euler"):
        p = problem(MASSLESS, force=np.array([1.0, 0]))
        errors = [solve_motion(p, method, SolverOptions(substeps=s)).error for s in (20, 40, 80)]
        assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)
        assert errors[1] / errors[2] == pytest.approx(2, rel=0.1)
        by = [
            solve_motion(p, method, SolverOptions(substeps=5, inverse=i))
            for i in ("sparse", "schulz")
        ]
        assert np.allclose(by[0].displacement, by[1].displacement, atol=1e-10)


def test_schulz_iteration():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(30, 30))
    matrix = a @ a.T + np.eye(30)
    inverse, steps, residual = invert_by_schulz(matrix)
    assert np.allclose(inverse, np.linalg.inv(matrix), atol=1e-9)
    assert residual <= 1e-10
    assert 3 < steps < 40
    with pytest.raises(FinloopError, match="residual"):
        invert_by_schulz(np.ones((4, 4)))


def test_decoupling_is_no_small_error():
    """Dropping the off-diagonals costs 37 % and more over a period of mode 2, lightly damped."""
    t = 2 * np.pi * np.arange(128) / 128
    u = np.stack([np.cos(2 * t), np.sin(2 * t)], axis=1)
    for wavelet in ("db4", "coif2"):
        for levels in (1, 2, 3):
            material, times = Material(1, 1, 0.2, 0), np.linspace(0, 0.5, 26)
            p = problem(material, 128, times, displacement=u, wavelet=wavelet)
            motion = solve_motion(p, "decoupled", SolverOptions(levels=levels))
            assert motion.error > 0.37
    # It is exact without elasticity: each coefficient fades alone.
    p = problem(Material(1, 0, 0.7, 0), velocity=wobble(64, 1), force=np.array([1.0, 2]))
    assert solve_motion(p, "decoupled").error < 1e-12


# --- what is refused


@pytest.mark.parametrize(
    ("change", "method", "word"),
    [
        ({"times": [0, 1, 1]}, "modal", "increase"),
        ({"times": [0, np.nan]}, "modal", "finite"),
        ({"displacement": np.full((64, 2), np.nan)}, "modal", "finite"),
        ({"displacement": np.zeros((32, 2))}, "modal", "shape"),
        ({"force": np.zeros(3)}, "modal", "force of shape"),
        ({"material": Material(-1)}, "modal", "negative"),
        ({"material": Material(0, 1, 0, 1)}, "modal", "mass_damping"),
        ({"material": MASSLESS}, "runge-kutta", "density, 0"),
        ({}, "implicit-euler", "density 1"),
        ({}, "leapfrog", "leapfrog"),
        (dict.fromkeys(("rest", "displacement"), np.zeros((48, 2))), "modal", "48 points"),
        ({"wavelet": "db2"}, "modal", "square integrable"),
        ({"material": MASSLESS, "times": [0, 1, 3]}, "implicit-euler", "evenly"),
    ],
)
def test_what_makes_no_sense_is_refused(change, method, word):
    p = Problem(**{**vars(problem()), **change})
    with pytest.raises(FinloopError, match=word):
        solve_motion(p, method)


@pytest.mark.parametrize("level", [-1, 6, 7])
def test_a_level_that_the_curve_does_not_have_is_refused(level):
    with pytest.raises(FinloopError, match=r"levels|1 points"):
        solve_motion(problem(), level=level)


def test_explicit_euler_refuses_steps_that_grow_without_end_and_says_how_many_will_do():
    p = problem(Material(0, 1, 1.0, 1e-4))
    with pytest.raises(FinloopError, match="unstable") as refused:
        solve_motion(p, "explicit-euler", SolverOptions(substeps=1))
    enough = int(refused.value.do.split("substeps to ")[1].split()[0])
    assert solve_motion(p, "explicit-euler", SolverOptions(substeps=enough)).error < 0.1
    with pytest.raises(FinloopError, match="unstable"):
        solve_motion(p, "explicit-euler", SolverOptions(substeps=int(0.7 * enough)))
    with pytest.raises(FinloopError, match="sparse or schulz"):
        solve_motion(problem(MASSLESS), "implicit-euler", SolverOptions(inverse="cholesky"))


def test_figures_6_and_7_draw_the_hoop():
    n = 64
    frames = hoop(n) + solve_motion(problem()).displacement
    figure = figure6(frames, TIMES, hoop(n), "hoop")
    assert len(figure.axes) == 12
    x, y = figure.axes[5].lines[1].get_data()
    assert np.allclose(np.stack([x, y], axis=1)[:-1], frames[5])
    assert figure.axes[0].yaxis_inverted()
    shares = {"all": (TIMES, np.linspace(1, 0, len(TIMES)))}
    figure = figure6(frames, TIMES, hoop(n), "hoop", shares)
    assert np.allclose(figure.axes[12].lines[0].get_ydata(), np.linspace(1, 0, len(TIMES)))
    rows = [("4 points", frames[:3]), ("8 points", frames[3:6])]
    figure = figure7(rows, TIMES[:3], "hoop", frames[:3])
    assert len(figure.axes) == 6
    behind, before = (line.get_xydata()[:-1] for line in figure.axes[4].lines)
    assert np.allclose(behind, frames[1]) and np.allclose(before, frames[4])
