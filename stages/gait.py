"""Stage `gait`: motion fitted to film drives a drawn character (curve paper §4.2, Figs. 8-14)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.drawn.dog.draw import dog_frames, limb_masks
from finloop.drawn.dog.walk import DogFilm, foot_gammas, frame_phases, true_limb_contours
from finloop.gait.compare import CLOCKS, ClockComparison, compare_clocks, describe_doubtful_fit
from finloop.gait.cycles import swimmer_gait_contours, walker_gait_contours
from finloop.gait.fit import (
    GaitContours,
    build_subcycles,
    fit_gait,
    partner_offsets,
)
from finloop.gait.limbs import check_traced_contour, region_contour
from finloop.gait.model import Gait, Keys, gait_to_record
from finloop.gait.outline import swim_contours, track_outlines
from finloop.gait.period import Period
from finloop.gait.settings import GaitSettings, Sharing
from finloop.gait.tool import load_gait
from finloop.gait.transfer import animate_drawing, repeat_cycle
from finloop.gait.truth import true_gamma
from finloop.io.animation import save_animation
from finloop.io.atomic import whole_folder
from finloop.io.movie import Mp4Writer
from finloop.io.picture import save_figure
from finloop.io.record import save_json
from finloop.io.regions import load_regions, save_masks
from finloop.io.svg import load_svg
from finloop.io.table import save_csv
from finloop.io.video import read_frames
from finloop.plots.gait import draw_gait_figures
from finloop.project import Project
from stages.settings import load_settings

TRACKS = ("track_id", "frame", "outline_x_px", "outline_y_px", "backbone_x_px", "backbone_y_px")
OUT, REPORT = Path("data/gait"), Path("reports/gait")
FIGURES = REPORT / "figures"
LEAST_FRAMES = 8  # of a cycle of a moved drawing
SECONDS = 4  # of a moved drawing's MP4, which repeats the cycle
ENDINGS = (".svg", ".webp", ".mp4", ".lottie.json")
CRF = 18  # quality of the drawn dog's film: hardly any loss
EXACT_POINTS = 256  # of the drawn dog's contours, known without a film
FIG8_PICTURES = 24  # of a cycle, to choose those of Fig. 8 from
CLEAR = 0.2  # |γ| from which on its error is given as a share of it
_RATE_DENOMINATOR = 1001  # largest of a frame rate, so that 30000/1001 Hz is exact


class CyclePictures(NamedTuple):
    """Pictures (h, w, 3) of one gait cycle, and the phase [cycles] of each."""

    pictures: list[NDArray[np.uint8]]
    phases: NDArray[np.float64]


class GaitFit(NamedTuple):
    """A fitted gait, with the contours it was fitted to, its key frames and held-out errors."""

    film: GaitContours
    gait: Gait
    keys: Keys
    errors: ClockComparison
    sharing: Sharing

    def rms(self) -> dict[str, float]:
        """Return the RMS errors on held-out frames, in % of body length.

        They are named `rms_<clock>_pct`; `rms_gamma_pct` is that of the gait's own γ.
        """
        rms = {f"rms_{clock}_pct": 100 * self.errors.rms[clock] for clock in CLOCKS}
        return {"rms_gamma_pct": rms[f"rms_{self.sharing}_pct"], **rms}


def _draw_figures(fit: GaitFit, folder: Path, pictures: CyclePictures | None) -> None:
    """Write Figs. 8 to 14 of the curve paper to `folder`.

    pictures: of a cycle, for Fig. 8; None = Fig. 8 shows contours instead.
    """
    film, gait, keys = fit.film, fit.gait, fit.keys
    subcycles = build_subcycles(film, keys, gait.split, gait.descriptor)
    for name, figure in draw_gait_figures(film, gait, keys, subcycles, pictures):
        save_figure(folder / f"{name}.png", figure)


def _fit_film(film: GaitContours, name: str, beat: Period, p: GaitSettings, source: str) -> GaitFit:
    """Return a gait fitted to the contours of a film, with its errors on held-out frames.

    name, source: of the gait; source says what it is fitted to. beat: the film's gait cycle.
    """
    settings: dict[str, Any] = {"split": p.split, "wavelet": p.wavelet, "coarse": p.coarse}
    errors = compare_clocks(film, **settings)
    if doubt := describe_doubtful_fit(film, errors.rms[p.gamma]):
        print(f"gait: {name}: {doubt}")
    frequency_hz = float(beat.frequency_hz)
    gait, keys = fit_gait(film, name, frequency_hz, **settings, sharing=p.gamma)
    confidence = None if np.isnan(beat.confidence) else beat.confidence
    gait = replace(gait, source=source, confidence=confidence, residuals=errors.rms)
    return GaitFit(film, gait, keys, errors, p.gamma)


def fit_tracks(p: GaitSettings) -> tuple[GaitFit | None, pd.DataFrame]:
    """Fit a gait to the outlines of each track of the clip; return the best fit, and a table.

    The best fit is that of the clearest tail beat, None if no track has a gait. The table has a row
    for each track: its beat, its errors, and why it has no gait.
    """
    project = Project()
    rate, tracks = project.rate_hz, project.tracks(TRACKS)
    heads = project.features[["track_id", "frame", "head_x_px", "head_y_px"]]
    rows, fits = [], []
    with report_progress("gait", tracks["track_id"].nunique(), "tracks") as advance:
        for number, track in tracks.groupby("track_id"):
            outlines = track_outlines(track, heads[heads["track_id"] == number])
            fish = swim_contours(*outlines, rate, p.contour_points)
            beat, name = fish.period, f"track {number}"
            row = {
                "track_id": number, "frames": len(track), "frequency_hz": beat.frequency_hz,
                "cycles": beat.cycles, "confidence": beat.confidence, "why_not": beat.why,
            }  # fmt: skip
            if not beat.why:
                try:
                    contours = swimmer_gait_contours(fish)
                    fit = _fit_film(contours, name, beat, p, source=f"{name} of the clip")
                    fits.append(fit)
                    row |= fit.rms()
                except FinloopError as error:
                    row["why_not"] = error.came
            rows.append(row)
            advance()
    columns = ["track_id", "frames", "frequency_hz", "cycles", "confidence"]
    columns += [f"rms_{clock}_pct" for clock in ("gamma", *CLOCKS)] + ["why_not"]
    best = max(fits, key=lambda fit: fit.gait.confidence or 0.0, default=None)
    return best, pd.DataFrame(rows).reindex(columns=columns)


def _dog_film(p: GaitSettings) -> DogFilm:
    """Return the parameters of the drawn dog's film."""
    scale = p.dog_width_px / DogFilm.width_px
    return DogFilm(
        frames=p.dog_frames, frame_rate_hz=p.dog_rate_hz, cycles=p.dog_cycles,
        width_px=p.dog_width_px, height_px=round(DogFilm.height_px * scale),
        trunk_px=DogFilm.trunk_px * scale, noise=p.dog_noise, seed=p.seed,
    )  # fmt: skip


def _draw_dog_film(walk: DogFilm, folder: Path) -> CyclePictures:
    """Write the drawn dog's film and masks of its limbs to `folder`; return pictures of a cycle."""
    rate = Fraction(walk.frame_rate_hz).limit_denominator(_RATE_DENOMINATOR)
    path = folder / "dog_film.mp4"
    with Mp4Writer(path, (walk.height_px, walk.width_px, 3), rate, CRF) as writer:
        for picture in dog_frames(walk):
            writer.write(picture)
    save_masks(folder / "regions", map(limb_masks, read_frames(path, colour=True)))
    cycle = min(walk.frames, round(walk.frames / walk.cycles))
    ticks = spread_rows(np.arange(cycle), FIG8_PICTURES)
    frames = enumerate(read_frames(path, colour=True))
    pictures = [picture for tick, picture in frames if tick in ticks]
    return CyclePictures(pictures, frame_phases(walk)[ticks])


def _fill_in_reference_gammas(walk: DogFilm, table: pd.DataFrame, p: GaitSettings) -> None:
    """Write the expected γ of the drawn dog's limbs into a table of fitted γ, in place.

    table: from `_gamma_table`, a row per contour and subcycle. true: γ of the motion with which the
    dog is drawn. exact: γ fitted to its contours, which are known without a film. clock: γ of the
    foot's timing alone. Rows of contours that are no limbs stay NaN.
    """
    # "swap": half a cycle later each limb does what its left-right partner does now.
    contours = GaitContours(
        true_limb_contours(walk, EXACT_POINTS), frame_phases(walk), walk.body_length_px,
        symmetry="swap",
    )  # fmt: skip
    # The partners hang at different places of the body; the swap must not move them there.
    contours = replace(contours, offsets=partner_offsets(contours))
    exact, _ = fit_gait(contours, "exact", walk.frequency_hz, split=p.split, wavelet=p.wavelet)
    true = true_gamma(walk)
    for row, (limb, subcycle) in table[["contour", "subcycle"]].iterrows():
        if limb in true:
            exact_gamma = exact.gamma[limb][subcycle][0]  # the only one: for all scales
            clock_gammas = dict(zip("ABCD", foot_gammas(walk, limb), strict=True))
            gammas = true[limb][subcycle], exact_gamma, clock_gammas[subcycle]
            table.loc[row, ["true", "exact", "clock"]] = gammas


def _gamma_errors(table: pd.DataFrame) -> dict[str, float]:
    """Return the largest errors of γ by name: of γ fitted to exact contours, and to the film.

    Where the true |γ| is at least CLEAR, the error is in % of it; for smaller γ it is absolute.
    table: of γ, with the columns true, exact and gamma (fitted to the film).
    """
    numbers = {}
    true = table["true"].abs()
    is_clear = true >= CLEAR
    for name, column in (("exact", "exact"), ("film", "gamma")):
        error = (table[column] - table["true"]).abs()
        numbers[f"dog_gamma_error_{name}_pct"] = float(100 * (error / true)[is_clear].max())
        numbers[f"dog_gamma_error_{name}_small_gammas"] = float(error[~is_clear].max())
    return numbers


def _gamma_table(film: str, gait: Gait) -> pd.DataFrame:
    """Return a table of the gait parameter γ, a row per contour and subcycle.

    film: name for the column film. gamma is that of the limb, see `Gait.limb_gamma`; the columns
    true, exact and clock are NaN, for `_fill_in_reference_gammas`.
    """
    rows = [
        (film, name, subcycle, gait.limb_gamma(name, subcycle), np.nan, np.nan, np.nan)
        for name, subcycles in gait.gamma.items()
        for subcycle in subcycles
    ]
    columns = ["film", "contour", "subcycle", "gamma", "true", "exact", "clock"]
    return pd.DataFrame(rows, columns=columns)


def _fit_limbs(p: GaitSettings, folder: Path) -> tuple[GaitFit, CyclePictures | None]:
    """Return the gait of the drawn dog, or of the limbs in `p.regions`, and pictures of a cycle.

    The dog's film is written to `folder`. There are no pictures, None, for `p.regions`.
    """
    pictures: CyclePictures | None = None
    if p.regions is None:
        pictures = _draw_dog_film(_dog_film(p), folder)
        regions, rate, name = folder / "regions", p.dog_rate_hz, "dog_walk"
        source = "the film of the drawn dog"
    else:
        assert p.regions_rate_hz is not None
        regions, rate = Path(p.regions), p.regions_rate_hz
        name, source = regions.name, f"regions in {regions.name}"
    traces = load_regions(regions, region_contour, check_traced_contour)
    walk, beat, contours = walker_gait_contours(
        traces.frames,
        rate,
        p.contour_points,
        p.split,
        traces.first,
        p.symmetry,
        p.regions_cycle_frames,
    )
    for note in contours.notes:
        print(f"gait: {note}")
    return _fit_film(walk, name, beat, p, source), pictures


def _animate_drawing(
    name: str, keys: tuple[str, ...], gait: Gait, p: GaitSettings, folder: Path
) -> dict[str, float]:
    """Write a drawing moved by a gait to `folder`, in all file formats; return metrics by name.

    name: of the files. keys: paths of the drawing's key poses. The metrics are how many contours
    cross themselves, and how far the worst foot slides on the ground, in % of the drawing's width,
    before and after the limbs are sheared so that feet stand still.
    """
    poses = [load_svg(Path(key)) for key in keys]
    frames = max(LEAST_FRAMES, round(p.frame_rate_hz / gait.frequency_hz))
    control = p.contour_points >> p.level if p.level else None
    result = animate_drawing(poses, gait, frames, p.contour_points, control, p.wavelet)
    rate = Fraction(frames * gait.frequency_hz).limit_denominator(_RATE_DENOMINATOR)
    cycles = repeat_cycle(result.morph, max(1, round(SECONDS * gait.frequency_hz)))
    for ending in ENDINGS:  # a player of MP4 stops at its end, the others begin again
        morph = cycles if ending == ".mp4" else result.morph
        save_animation(folder / f"{name}{ending}", morph, rate, p.size_px)
    folded = sum(bool(counts.any()) for counts in result.morph.folds.values())
    numbers: dict[str, float] = {f"{name}_contours_that_fold": folded}
    for when, ground in (("before", result.before), ("after", result.after)):
        if ground is not None:
            numbers[f"{name}_feet_slide_{when}_pct"] = 100 * max(ground.slide.values())
    return numbers


def _swimmer_gait(p: GaitSettings, swimmer: GaitFit | None) -> Gait:
    """Return the gait that moves the drawn fish: from a file, or the one fitted to the clip.

    swimmer: the fit to the clip; None if no track has one. FinloopError if there is neither.
    """
    if p.swimmer_gait is not None:
        return load_gait(Path(p.swimmer_gait))
    if swimmer is None:
        raise FinloopError(
            "gait.swimmer_gait is null, and no track of the clip has an outline that repeats",
            "a clip with a steady tail beat, or the path of a gait",
            "see data/gait/tracks.csv, or set gait.swimmer_gait=data/gaits/trout.json",
        )
    return swimmer.gait


def main() -> None:
    """Fit gaits to filmed limbs and to the clip's fish, and move drawings by them.

    data/gait/ gets the gaits, the moved drawings and tables, reports/gait/ figures and metrics.
    """
    p: GaitSettings = load_settings("gait")
    with whole_folder(OUT) as folder:
        walker, pictures = _fit_limbs(p, folder)  # first: most user input, and so most errors
        swimmer, tracks = fit_tracks(p)
        save_csv(folder / "tracks.csv", tracks, decimals=4)
        fish = _swimmer_gait(p, swimmer)
        fits = {"limbs": walker} | ({"outline": swimmer} if swimmer else {})
        numbers: dict[str, float] = {
            "tracks": len(tracks),
            "tracks_that_repeat": int(tracks["rms_gamma_pct"].notna().sum()),
            "tracks_rms_gamma_median_pct": float(tracks["rms_gamma_pct"].median()),
            "tracks_rms_linear_median_pct": float(tracks["rms_linear_pct"].median()),
        }
        gammas = {film: _gamma_table(film, fit.gait) for film, fit in fits.items()}
        if p.regions is None:
            _fill_in_reference_gammas(_dog_film(p), gammas["limbs"], p)
            numbers |= _gamma_errors(gammas["limbs"])
        save_csv(folder / "gamma.csv", pd.concat(gammas.values(), ignore_index=True), decimals=4)
        numbers |= _save_fits(folder, fits, pictures)
        if swimmer is None:
            print("gait: no track of the clip has an outline that repeats: see tracks.csv")
        with report_progress("gait", 2, "drawings") as advance:
            numbers |= _animate_drawing("dog", p.walker_drawings, walker.gait, p, folder)
            advance()
            numbers |= _animate_drawing("fish", p.swimmer_drawings, fish, p, folder)
            advance()
    save_metrics(REPORT / "metrics.json", numbers)


def _save_fits(
    folder: Path, fits: Mapping[str, GaitFit], pictures: CyclePictures | None
) -> dict[str, float]:
    """Write fitted gaits and their errors to `folder`, and their figures; return metrics by name.

    fits: by the name of the film, "limbs" or "outline". pictures: of a cycle of the limbs, for
    their Fig. 8; None = it shows the contours.
    """
    numbers: dict[str, float] = {}
    for film, fit in fits.items():
        names = ("frequency_hz", "confidence", "cycles")
        facts = {name: getattr(fit.gait, name) for name in names} | fit.rms()
        numbers |= {f"{film}_{name}": value for name, value in facts.items()}
        save_json(folder / f"{film}.json", gait_to_record(fit.gait), indent=1)
        with whole_folder(FIGURES / film) as figures_of_film:
            _draw_figures(fit, figures_of_film, pictures if film == "limbs" else None)
        numbers[f"{film}_coordinates_not_monotone"] = len(fit.errors.not_monotone)
    for name in ("by_contour", "by_scale", "not_monotone"):
        parts = [getattr(fit.errors, name).assign(film=film) for film, fit in fits.items()]
        save_csv(folder / f"{name}.csv", pd.concat(parts, ignore_index=True), decimals=5)
    return numbers


if __name__ == "__main__":
    run(main)
