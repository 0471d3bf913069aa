"""Stage `morph`: turn one drawing into another; release a bent hoop (curve paper §2-4.1)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats
from finloop.base.drawing import Drawing, Morph
from finloop.base.tool import format_frame_counts
from finloop.curve.contour import Curve, resample_curve, signed_area
from finloop.curve.dynamics import (
    Material,
    Problem,
    SolverOptions,
    Trajectory,
    solve_motion,
    total_energy,
)
from finloop.curve.glyph import glyph_outlines
from finloop.curve.stiffness import connection_coefficients, off_diagonal_share, stiffness_matrix
from finloop.curve.wavelet import CUBIC, drop_details
from finloop.io.animation import ENDINGS, save_animation
from finloop.io.atomic import whole_folder
from finloop.io.picture import save_figure, save_picture
from finloop.io.svg import describe_unpainted, load_svg
from finloop.io.table import save_csv
from finloop.morph.force_list import parse_forces
from finloop.morph.in_forces import move_drawing
from finloop.morph.layers import (
    METHODS,
    PhysicalOptions,
    morph_drawings,
    there_and_back,
)
from finloop.morph.match import Resolution, match_curves
from finloop.morph.pairs import match_drawings
from finloop.morph.settings import MorphSettings
from finloop.plots.curve import figure2, figure3, figure6, figure7
from finloop.plots.morph import draw_morphs
from stages.settings import load_settings

OUT, REPORT = Path("data/morph"), Path("reports/morph")
FIGURES = REPORT / "figures"
TABLES = ("db4", "coif2")  # of the paper's Tables 1 and 2
DECIMALS = 10  # of connection coefficients
GLYPH_POINTS, HOOP_POINTS = 1024, 256
CONTROL = (4, 8, 16, 32)  # points of Fig. 7
FIG4_CONTROL = (8, 16, 32)  # points of the coarse rows of Fig. 4
FIG6_FRAMES = 18
AT_REST = 0.01  # share of a hoop's first displacement (RMS) below which it counts as at rest
FIG2_WAVELETS = {CUBIC: "cubic B-spline", "db4": "Daubechies (db4)"}  # as the paper
EULER = ("explicit-euler", "implicit-euler")
FIG5_PHYSICS = {  # of Fig. 5: e0, c, rho
    "soft, light damping": PhysicalOptions(1.0, 2.0, 1.0),
    "stiff": PhysicalOptions(6.0, 8.0, 1.0),
    "heavy damping": PhysicalOptions(1.0, 40.0, 1.0),
    "no mass": PhysicalOptions(1.0, 8.0, 0.0),
}


def _connection_tables() -> pd.DataFrame:
    """Return Tables 1 and 2 of the curve paper: connection coefficients of two wavelets.

    They are integrals of products of the wavelet's derivatives, a row for each shift l.
    """
    parts = []
    for wavelet in TABLES:
        coefficients = connection_coefficients(wavelet)
        mu, nu = coefficients.mu, coefficients.nu
        columns = {"mu_normalised": mu / mu[0], "nu_normalised": nu / nu[0], "mu": mu, "nu": nu}
        rows = pd.DataFrame(columns).round(DECIMALS) + 0.0  # no -0
        parts.append(rows.rename_axis("l").reset_index().assign(wavelet=wavelet))
    return pd.concat(parts)[["wavelet", "l", *columns]]


def _draw_released_hoop(p: MorphSettings) -> dict[str, float]:
    """Draw Figs. 6 and 7 of the curve paper, a bent hoop let go; return their numbers by name.

    The errors are those of the solvers, and of each number of control points of Fig. 7, in radii of
    the hoop: against the solution at all points, and against that solution without its details. The
    result also has the largest rise of the hoop's energy, which should only fall, as a share of the
    energy in the beginning, and when the hoop is at rest.
    """
    hoop, massless = _bent_hoops(p)
    exact = solve_motion(hoop)
    total = total_energy(hoop, exact)
    numbers = _solver_errors(hoop, massless)
    numbers["hoop_largest_rise_of_energy_share"] = float(np.diff(total).max() / total[0])
    remaining = _remaining_shares(exact)
    last_moving = min(np.flatnonzero(remaining > AT_REST)[-1], len(remaining) - 2)
    rest_time = float(hoop.times[last_moving + 1])
    frictionless = replace(hoop, material=replace(hoop.material, mass_damping=0.0))
    swinging = _remaining_shares(solve_motion(frictionless))
    numbers |= {
        "hoop_rest_time": rest_time,
        "hoop_frictionless_least_displacement_share": float(swinging.min()),
    }
    shown = replace(hoop, times=np.linspace(0, rest_time, FIG6_FRAMES))
    frames = solve_motion(shown).displacement + hoop.rest
    curves = {
        "friction as in the pictures": (hoop.times, remaining),
        "without friction, as the paper has it": (hoop.times, swinging),
    }
    title = f"a hoop let go; at the last time {100 * AT_REST:g} % of its displacement is left"
    save_figure(FIGURES / "fig6.png", figure6(frames, shown.times, hoop.rest, title, curves))
    rows, radius = [], np.linalg.norm(hoop.rest[0])
    for count in CONTROL:
        level = int(np.log2(HOOP_POINTS // count))  # each level of details halves the points
        coarse = solve_motion(shown, level=level).displacement
        coarse += drop_details(hoop.rest, p.wavelet, level)
        cut = drop_details(frames, p.wavelet, level)
        error, off_cut = (
            float(np.linalg.norm(coarse - other, axis=-1).max() / radius) for other in (frames, cut)
        )
        numbers[f"hoop_{count}_points_error_radii"] = error
        numbers[f"hoop_{count}_points_solved_against_cut_radii"] = off_cut
        rows.append((f"{count} points\n{error:.2g} radii off", coarse[::2]))
    title = f"each solved at its own number of control points; grey: at {HOOP_POINTS}"
    save_figure(FIGURES / "fig7.png", figure7(rows, shown.times[::2], title, frames[::2]))
    return numbers


def _remaining_shares(motion: Trajectory) -> Floats:
    """Return a curve's RMS displacement (t,) at each time, as a share of that at the start."""
    rms = np.sqrt((motion.displacement**2).sum(axis=-1).mean(axis=-1))
    return rms / rms[0]


def _solver_errors(hoop: Problem, massless: Problem) -> dict[str, float]:
    """Return the errors of the solvers by name, for a hoop with mass and one without it.

    Each is solved by those methods that can solve it.
    """
    numbers: dict[str, float] = {}
    for name, case, options, methods in (
        ("hoop", hoop, SolverOptions(levels=3), ("runge-kutta", "decoupled")),
        ("massless", massless, SolverOptions(levels=3, substeps=40), EULER),
    ):
        for method in methods:
            error = solve_motion(case, method, options).error
            numbers[f"{name}_error_{method.replace('-', '_')}"] = error
    return numbers


def _bent_hoops(p: MorphSettings) -> tuple[Problem, Problem]:
    """Return two problems of a bent hoop that is let go: with mass, and without.

    The hoop begins with the outline in `p.hoop`; at rest it is a circle of the same area.
    """
    outline = next(iter(load_svg(Path(p.hoop)).curves.values()))
    angle = np.linspace(0, 2 * np.pi, HOOP_POINTS, endpoint=False)
    radius = np.sqrt(abs(signed_area(outline)) / np.pi)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    shape, rest = match_curves(outline, Curve(ring, closed=True), HOOP_POINTS)
    displacement = shape - shape.mean(axis=0) - rest
    # Without friction, mode m swings m √(e₀/ρ) times per unit of time: the oval, m = 2, once. With
    # it, every swing falls to e^(−1.5) in that time.
    material = Material(density=1.0, elastic=0.25, mass_damping=3.0)
    no_mass = Material(density=0.0, elastic=1.0, mass_damping=1.0, stiffness_damping=0.02)
    hoop = Problem(rest, displacement, material, np.linspace(0, 4, 241), wavelet=p.wavelet)
    return hoop, replace(hoop, material=no_mass, times=np.linspace(0, 1, 61))


def _draw_curve_paper_figures(p: MorphSettings) -> dict[str, float]:
    """Draw Figs. 2 and 3 of the curve paper; return how diagonal its stiffness matrices are.

    The numbers, by name, say how much of a matrix is off its diagonal, in % of its energy, for
    several wavelets, each with 1, 2 and 3 levels.
    """
    outline = max(glyph_outlines(p.glyph), key=lambda letter: len(letter.points))
    letter: Curve = resample_curve(outline, GLYPH_POINTS)
    wavelets = FIG2_WAVELETS | {p.wavelet: FIG2_WAVELETS.get(p.wavelet, p.wavelet)}
    save_figure(FIGURES / "fig2.png", figure2(letter, list(wavelets.items())))
    k = stiffness_matrix(p.wavelet, n=64, levels=2)
    save_figure(FIGURES / "fig3.png", figure3(k, 2, f"stiffness, {p.wavelet}, two scales"))
    numbers: dict[str, float] = {}
    for wavelet in dict.fromkeys((*TABLES, p.wavelet)):
        for levels in (1, 2, 3):
            share = off_diagonal_share(stiffness_matrix(wavelet, n=256, levels=levels))
            numbers[f"off_diagonal_energy_{wavelet}_{levels}_levels_pct"] = 100 * share
    return numbers


def _morphs_at_levels(p: MorphSettings, drawings: tuple[Drawing, Drawing]) -> dict[str, Morph]:
    """Return the linear morphs at the coarse levels of Fig. 4, by name of the row."""
    return {
        f"linear, {count} control points": morph_drawings(
            *drawings, "linear", p.frames, p.contour_points,
            Resolution(int(np.log2(p.contour_points // count)), p.wavelet),
        )
        for count in FIG4_CONTROL
        if count < p.contour_points
    }  # fmt: skip


def _fold_table(morphs: dict[str, Morph]) -> pd.DataFrame:
    """Return a table of how often each contour folds (crosses itself), by method and contour.

    morphs: by method. The column proved_between_frames says whether it is proved that the contour
    does not cross itself between two frames either.
    """
    return pd.DataFrame(
        {"method": method, "contour": name, "frames_that_fold": int((count > 0).sum()),
         "folds": int(count.sum()), "proved_between_frames": result.continuous[name]}
        for method, result in morphs.items()
        for name, count in result.folds.items()
    )  # fmt: skip


def main() -> None:
    """Morph a drawing into another by every method, and draw the figures of the curve paper.

    data/morph/ gets the morph by `morph.method` and tables, reports/morph/ figures and metrics.
    """
    p: MorphSettings = load_settings("morph")
    numbers = _draw_curve_paper_figures(p) | _draw_released_hoop(p)
    first, last = load_svg(Path(p.first_drawing)), load_svg(Path(p.last_drawing))
    unpainted = describe_unpainted(first, last)
    first, last, pairing = match_drawings(first, last, Path(p.pairs) if p.pairs else None)
    drawings = first, last
    for finding in filter(None, [pairing, unpainted]):
        print(f"morph: {finding}", file=sys.stderr)
    resolution = Resolution(p.level, p.wavelet)
    physics = PhysicalOptions(p.elasticity, p.damping, p.mass, p.stiffness_damping)
    forces = parse_forces(p.forces)
    rate = Fraction(p.frame_rate_hz).limit_denominator(1001)  # 30000/1001 Hz is exact
    with report_progress("morph", len(METHODS) + len(ENDINGS), "steps") as advance:
        morphs = {}
        given = p.contour_points, resolution, physics
        for method in METHODS:
            if forces and method == "physical":
                motion = move_drawing(first, last, forces, p.frames, rate, *given)
                morphs[method] = motion.morph
                rest_time = motion.rest_time
                numbers["rest_time_s"] = float("nan") if rest_time is None else rest_time
            else:
                morphs[method] = morph_drawings(first, last, method, p.frames, *given)
            advance()
        if covered := morphs[p.method].count_cover_frames():
            pieces = format_frame_counts(covered, p.frames)
            print(f"morph: pieces cover each other: {pieces}", file=sys.stderr)
        is_there_and_back = p.back and not forces  # nothing falls upwards
        film = there_and_back(morphs[p.method]) if is_there_and_back else morphs[p.method]
        with whole_folder(OUT) as folder:
            for ending in ENDINGS:
                lost = save_animation(folder / f"{p.method}{ending}", film, rate, p.size_px)
                if lost:
                    print(f"morph: {lost}", file=sys.stderr)
                advance()
            coefficients = _connection_tables()
            save_csv(folder / "connection.csv", coefficients, decimals=DECIMALS, exact=True)
            save_csv(folder / "folds.csv", _fold_table(morphs), decimals=0)
    at_level = {
        f"{method}, {p.contour_points >> p.level} control points": morph
        for method, morph in morphs.items()
    }
    save_picture(FIGURES / "fig4.png", draw_morphs(_morphs_at_levels(p, drawings) | at_level))
    physical_morphs = {
        name: morph_drawings(*drawings, "physical", p.frames, p.contour_points, resolution, physics)
        for name, physics in FIG5_PHYSICS.items()
    }
    save_picture(FIGURES / "fig5.png", draw_morphs({"linear": morphs["linear"]} | physical_morphs))
    for method, result in morphs.items():
        folded = sum(bool(count.any()) for count in result.folds.values())
        numbers[f"{method}_contours_that_fold"] = folded
    numbers |= {"contours": len(morphs[p.method].layers), "frames": p.frames}
    save_metrics(REPORT / "metrics.json", numbers)


if __name__ == "__main__":
    run(main)
