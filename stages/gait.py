"""Stage `gait`: motion fitted from film drives a drawn character (curve paper §4.2, Figs. 8-14)."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.drawn.dog.draw import film, limb_masks
from finloop.drawn.dog.walk import DogFilm, gammas, phases, truth
from finloop.errors import FinloopError
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.gait.compare import CLOCKS, Comparison, compare
from finloop.gait.cycles import film_of_regions, film_of_swim
from finloop.gait.film import Film, Keys, hips, samples_of
from finloop.gait.fit import fit, subcycles_of
from finloop.gait.limbs import region_contour, trace_contour
from finloop.gait.model import Gait
from finloop.gait.outline import of_track, swim
from finloop.gait.record import record_of
from finloop.gait.settings import Settings
from finloop.gait.tool import load_gait
from finloop.gait.transfer import repeat, transfer
from finloop.gait.truth import true_gamma
from finloop.io.animation import save_animation
from finloop.io.atomic import whole_folder
from finloop.io.movie import Mp4Writer
from finloop.io.picture import save_figure
from finloop.io.record import load_record, save_json
from finloop.io.regions import load_regions, save_masks
from finloop.io.svg import load_svg
from finloop.io.table import load_table, save_csv
from finloop.io.video import FACTS_NAME, load_facts, read_frames
from finloop.plots.gait import figures
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
FEATURES_AT = Path("data/features/features.parquet")
TRACKS = ("track_id", "frame", "outline_x_px", "outline_y_px", "backbone_x_px", "backbone_y_px")
OUT, REPORT = Path("data/gait"), Path("reports/gait")
LEAST_FRAMES, SECONDS = 8, 4  # of a drawn cycle; of a drawing's MP4
ENDINGS = (".svg", ".webp", ".mp4", ".lottie.json")
CRF = 18
EXACT_POINTS = 256
SHOWN = 24  # pictures of Fig. 8
CLEAR = 0.2  # from here on an error of γ is told as a share of it
Pictures = tuple[list[NDArray[np.uint8]], NDArray[np.float64]]


class Learnt(NamedTuple):
    """A gait, the film and keys it came from, and what its clock is worth on frames left out."""

    film: Film
    gait: Gait
    keys: Keys
    worth: Comparison

    def draw(self, folder: Path, pictures: Pictures | None = None) -> None:
        """Figs. 8 to 14 into a folder."""
        gait = self.gait
        samples = samples_of(self.film, gait.split, gait.wavelet, gait.coarse)
        subcycles = subcycles_of(self.keys, samples, gait.wavelet, gait.coarse)
        for name, figure in figures(self.film, gait, self.keys, subcycles, pictures):
            save_figure(folder / f"{name}.png", figure)

    def numbers(self, what: str) -> dict[str, float]:
        """For the metrics."""
        return {
            f"{what}_frequency_hz": self.gait.frequency_hz,
            f"{what}_confidence": self.gait.confidence,
            f"{what}_cycles": self.gait.cycles,
        } | {f"{what}_rms_{clock}_pct": 100 * self.worth.rms[clock] for clock in CLOCKS}


def learnt(
    film: Film, name: str, frequency_hz: float, p: Settings, source: str, confidence: float
) -> Learnt:
    """Fit a gait to a film, and to parts of it for the frames left out."""
    worth = compare(film, split=p.split, wavelet=p.wavelet, coarse=p.coarse)
    gait, keys = fit(
        film, name, frequency_hz, split=p.split, wavelet=p.wavelet, coarse=p.coarse,
        per_scale=p.per_scale,
    )  # fmt: skip
    gait = replace(gait, source=source, confidence=confidence, residuals=worth.rms)
    return Learnt(film, gait, keys, worth)


def outlines(p: Settings) -> tuple[Learnt | None, pd.DataFrame]:
    """Every track's tail beat; the gait of the one that is surest, if one repeats."""
    rate = load_facts(CLIP / FACTS_NAME).frame_rate_hz
    scene = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    tracks = load_table(EXTRACT / "tracks.parquet", tracks_schema(scene.points), TRACKS)
    known = load_table(FEATURES_AT, FEATURES, ("track_id", "frame", "head_x_px", "head_y_px"))
    rows, best = [], None
    groups = dict(list(known.groupby("track_id")))
    with progress("gait", tracks["track_id"].nunique(), "tracks") as advance:
        for number, track in tracks.groupby("track_id"):
            beat = swim(*of_track(track, groups[number]), rate, p.points)
            row = {
                "track_id": number, "frames": len(track), "frequency_hz": beat.period.frequency_hz,
                "cycles": beat.period.cycles, "confidence": beat.period.confidence,
                "why_not": beat.period.why,
            }  # fmt: skip
            if not beat.period.why:
                try:
                    one = learnt(
                        film_of_swim(beat), f"track {number}", float(beat.period.frequency_hz), p,
                        f"track {number} of the clip", beat.period.confidence,
                    )  # fmt: skip
                except FinloopError as error:
                    row["why_not"] = error.came
                else:
                    row |= {f"rms_{clock}_pct": 100 * one.worth.rms[clock] for clock in CLOCKS}
                    if best is None or one.gait.confidence > best.gait.confidence:
                        best = one
            rows.append(row)
            advance()
    columns = ["track_id", "frames", "frequency_hz", "cycles", "confidence"]
    columns += [f"rms_{clock}_pct" for clock in CLOCKS] + ["why_not"]
    return best, pd.DataFrame(rows).reindex(columns=columns)


def dog(p: Settings) -> DogFilm:
    """The drawn dog that the parameters ask for."""
    size = p.dog_width_px / DogFilm.width_px
    return DogFilm(
        frames=p.dog_frames, frame_rate_hz=p.dog_rate_hz, cycles=p.dog_cycles,
        width_px=p.dog_width_px, height_px=round(DogFilm.height_px * size),
        trunk_px=DogFilm.trunk_px * size, noise=p.dog_noise, seed=p.seed,
    )  # fmt: skip


def filmed_dog(walk: DogFilm, folder: Path) -> Pictures:
    """Film the dog, and find its near limbs in the film as it was coded; pictures of a cycle."""
    rate = Fraction(walk.frame_rate_hz).limit_denominator(1001)
    path = folder / "dog_film.mp4"
    with Mp4Writer(path, (walk.height_px, walk.width_px, 3), rate, CRF) as writer:
        for picture in film(walk):
            writer.write(picture)
    save_masks(folder / "regions", (limb_masks(one) for one in read_frames(path, colour=True)))
    cycle = min(walk.frames, round(walk.frames / walk.cycles))
    which = np.unique(np.linspace(0, cycle - 1, SHOWN).astype(int))
    shown = [one for k, one in enumerate(read_frames(path, colour=True)) if k in which]
    return shown, phases(walk)[which]


def recovered(walk: DogFilm, table: pd.DataFrame, p: Settings) -> dict[str, float]:
    """Fill in γ as it is, the clock's and that of exact contours; how far off they are at most."""
    exact = Film(truth(walk, EXACT_POINTS), phases(walk), walk.body_length_px, "swap")
    exact = replace(exact, offsets=hips(exact))
    found, _ = fit(exact, "exact", walk.frequency_hz, split=p.split, wavelet=p.wavelet)
    true = true_gamma(walk)
    for k, (name, sub) in table[["contour", "subcycle"]].iterrows():
        if name in true:
            values = true[name][sub], found.gamma[name][sub][0], gammas(walk, name)["AB".index(sub)]
            table.loc[k, ["true", "exact", "clock"]] = values
    numbers = {}
    clear = table["true"].abs() >= CLEAR
    for way in ("exact", "gamma"):
        off = (table[way] - table["true"]).abs()
        what = f"dog_gamma_error_{'film' if way == 'gamma' else way}"
        numbers[f"{what}_pct"] = float(100 * (off / table["true"].abs())[clear].max())
        numbers[f"{what}_small_gammas"] = float(off[~clear].max())
    return numbers


def table_of(which: str, gait: Gait) -> pd.DataFrame:
    """γ by contour and subcycle, the mean over the scales; what is true is not known of a film."""
    rows = [
        (which, name, sub, float(np.mean(values)), *(np.nan,) * 3)
        for name, of in gait.gamma.items()
        for sub, values in of.items()
    ]
    columns = ["film", "contour", "subcycle", "gamma", "true", "exact", "clock"]
    return pd.DataFrame(rows, columns=columns)


def limbs(p: Settings, folder: Path) -> tuple[Learnt, Pictures | None]:
    """The gait of the drawn dog, or of own film's limbs."""
    if p.limbs == "dog":
        pictures: Pictures | None = filmed_dog(dog(p), folder)
        regions, rate, name = folder / "regions", p.dog_rate_hz, "dog_walk"
        source = "the film of the drawn dog"
    else:
        assert p.regions is not None and p.regions_rate_hz is not None
        pictures, regions, rate = None, Path(p.regions), p.regions_rate_hz
        name, source = regions.name, f"regions in {regions.name}"
    seen_in = load_regions(regions, region_contour, trace_contour)
    cut, beat, found = film_of_regions(seen_in.frames, rate, p.points, p.split, seen_in.first)
    for note in found.notes:
        print(f"gait: {note}")
    return learnt(cut, name, float(beat.frequency_hz), p, source, beat.confidence), pictures


def driven(name: str, keys: tuple[str, str], gait: Gait, p: Settings, folder: Path) -> dict:
    """A drawing in motion, in every format; how far its feet slide."""
    one, two = (load_svg(Path(key)) for key in keys)
    frames = max(LEAST_FRAMES, round(p.frame_rate_hz / gait.frequency_hz))
    done = transfer(one, two, gait, frames, p.points)
    rate = Fraction(frames * gait.frequency_hz).limit_denominator(1001)
    long = repeat(done.morph, max(1, round(SECONDS * gait.frequency_hz)))
    for ending in ENDINGS:  # a player of MP4 stops at its end, the others begin again
        shown = long if ending == ".mp4" else done.morph
        save_animation(folder / f"{name}{ending}", shown, rate, p.size_px)
    numbers: dict[str, float] = {
        f"{name}_contours_that_fold": sum(bool(of.any()) for of in done.morph.folds.values())
    }
    for when, ground in (("before", done.before), ("after", done.after)):
        if ground is not None:
            numbers[f"{name}_feet_slide_{when}_pct"] = 100 * max(ground.slide.values())
    return numbers


def fish_gait(p: Settings, swum: Learnt | None) -> Gait:
    """The gait that drives the drawn fish: a shipped one, or the clip's own."""
    if p.fish_gait is not None:
        return load_gait(Path(p.fish_gait))
    if swum is None:
        raise FinloopError(
            "gait.fish_gait is null, and no track of the clip has an outline that repeats",
            "a clip with a steady tail beat, or the path of a gait",
            "see why in reports/gait/tracks.csv, or set gait.fish_gait=data/gaits/trout.json",
        )
    return swum.gait


def main() -> None:
    """Make data/gait/, reports/gait/."""
    p: Settings = load("gait")
    with whole_folder(OUT) as folder:
        walked, pictures = limbs(p, folder)  # first: here most is given, and can be wrong
        swum, tracks = outlines(p)
        save_csv(REPORT / "tracks.csv", tracks, decimals=4)
        fish = fish_gait(p, swum)
        numbers: dict[str, float] = {
            "tracks": len(tracks),
            "tracks_that_repeat": int(tracks["rms_gamma_pct"].notna().sum()),
            "tracks_rms_gamma_median_pct": float(tracks["rms_gamma_pct"].median()),
            "tracks_rms_linear_median_pct": float(tracks["rms_linear_pct"].median()),
        }
        table = table_of("limbs", walked.gait)
        numbers |= walked.numbers("limbs")
        if p.limbs == "dog":
            numbers |= recovered(dog(p), table, p)
        save_json(folder / "limbs.json", record_of(walked.gait), indent=1)
        with whole_folder(REPORT / "limbs") as shown:
            walked.draw(shown, pictures)
        with whole_folder(REPORT / "outline") as shown:
            if swum is None:
                why = "no track of the clip has an outline that repeats: see tracks.csv"
                print(f"gait: {why}")
                (shown / "none.txt").write_text(why + "\n", encoding="utf-8")
            else:
                numbers |= swum.numbers("outline")
                table = pd.concat([table, table_of("outline", swum.gait)], ignore_index=True)
                save_json(folder / "outline.json", record_of(swum.gait), indent=1)
                swum.draw(shown)
        with progress("gait", 2, "drawings") as advance:
            numbers |= driven("dog", (p.dog_1, p.dog_2), walked.gait, p, folder)
            advance()
            numbers |= driven("fish", (p.fish_1, p.fish_2), fish, p, folder)
            advance()
    save_csv(REPORT / "gamma.csv", table, decimals=4)
    parts = {"limbs": walked} | ({"outline": swum} if swum else {})
    for name in ("by_contour", "by_scale"):
        each = [getattr(one.worth, name).assign(film=what) for what, one in parts.items()]
        save_csv(REPORT / f"{name}.csv", pd.concat(each, ignore_index=True), decimals=5)
    save_metrics(REPORT / "metrics.json", numbers)


if __name__ == "__main__":
    run(main)
