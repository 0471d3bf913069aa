"""Stage `realism`: test whether a classifier can distinguish the animation from its film.

It looks at motion (as extraction measures it), and at pictures (`stages.realism_pictures`).
"""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Sized
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.parallel import Workers, ordered_map
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT, split_by_fish
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import whole_folder
from finloop.io.mapped import save_array
from finloop.io.movie import Mp4Writer
from finloop.io.record import save_json
from finloop.io.table import load_table, save_csv, save_table
from finloop.project import Project
from finloop.realism import compare, examples
from finloop.realism.auc import compute_roc
from finloop.realism.compare import FilmSample, Sides, Verdict
from finloop.realism.crops import SIZE
from finloop.realism.examples import FILM
from finloop.realism.instrument import (
    EditList,
    Instrument,
    Swimming,
    join_measurements,
    measure_edit_list,
    sample_film_lists,
)  # fmt: skip
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import AGAIN, Windows
from finloop.render.gallery import Gallery
from stages.cluster import open_workers
from stages.kept import KeptResults, open_kept
from stages.origins import path_digest
from stages.realism_pictures import PictureResult, PictureSample
from stages.settings import load_settings

ANIMATE = Path("data/animate")
OUT, REPORT = Path("data/realism"), Path("reports/realism")
WORKERS_NEED = ["finloop.realism.instrument", "finloop.realism.compare", "finloop.project"]
LEAST_SHARE = 0.8  # of the ticks that extraction follows; below it a note is printed
INPUTS = [Path("data") / word for word in ("clip", "extract", "features", "pose", "sprites")]
"""What all measurements are made from, beside the edit list of a mode."""
NOTHING_KEPT = KeptResults(None, "", {})
PANEL_PX, CRF = 320, 20  # of the film of examples


@dataclass(frozen=True)
class GalleryOpener:
    """Opens the film's pictures when called, also in another process."""

    project: Project

    def __call__(self) -> AbstractContextManager[Gallery]:
        """Return a context with the gallery of the film's pictures, which stays open afterwards."""
        return nullcontext(self.project.whole_gallery)


def _followed_share(followed_ticks: Sized, lists: list[EditList]) -> float:
    """Return the share (0 … 1) of the ticks of edit lists in which extraction followed the fish.

    followed_ticks: an entry for each tick with a followed fish. lists: the edit lists.
    """
    return len(followed_ticks) / max(1, sum(len(edit) for edit, _ in lists))


def measure_swimming(
    edit_lists: dict[str, list[EditList]], pictures: GalleryOpener,
    instruments: dict[str, Instrument], pool: Workers, kept: KeptResults = NOTHING_KEPT,
) -> dict[str, Swimming]:  # fmt: skip
    """Draw the edit lists of film and modes, and measure the fish in the drawn pictures.

    edit_lists, instruments: edit lists, and how to extract the fish from their pictures, by mode or
    FILM. kept: feature tables of an earlier run. Return the measured swimming by the same names; a
    name without a followed fish is left out.
    """
    tables = {
        name: kept_tables
        for name, lists in edit_lists.items()
        if (kept_tables := kept.load_frames(name, len(lists))) is not None
    }
    new = [name for name in edit_lists if name not in tables]
    jobs = [(instruments[name], edit_list) for name in new for edit_list in edit_lists[name]]
    ticks = sum(len(edit_list.edit) for _, edit_list in jobs)
    with report_progress("realism", ticks, "ticks") as advance:
        results = ordered_map(partial(measure_edit_list, pictures), jobs, pool)
        for name in new:  # in the order of the jobs, and so of the results
            tables[name] = []
            for edit, _ in edit_lists[name]:
                tables[name].append(next(results))
                advance(len(edit))
            kept.save_frames(name, tables[name])
    return _join_measured(edit_lists, tables, instruments)


def _join_measured(
    edit_lists: dict[str, list[EditList]], tables: dict[str, list[pd.DataFrame]],
    instruments: dict[str, Instrument],
) -> dict[str, Swimming]:  # fmt: skip
    """Join the feature tables of each mode; print a note where few ticks were measured.

    tables: by name, one for each edit list in `edit_lists`. A name without a followed fish is left
    out.
    """
    measured: dict[str, Swimming] = {}
    for name, lists in edit_lists.items():
        followed, share = tables[name], 0.0
        if any(map(len, followed)):
            edits, rate_hz = [edit for edit, _ in lists], instruments[name].rate_hz
            measured[name] = join_measurements(edits, followed, rate_hz)
            share = _followed_share(measured[name].row, lists)
        if share < LEAST_SHARE:
            print(f"realism: extraction followed the fish of {name} in {100 * share:.0f} % of the "
                  "ticks, and the numbers use only these; look at the film from "
                  f"render.mode={name}", file=sys.stderr)  # fmt: skip
    return measured


def _classify_or_error(
    p: RealismSettings, named_windows: tuple[str, tuple[Windows, Windows]]
) -> Verdict | FinloopError:
    """Return how well a classifier separates two sets of windows; an error if they are too few.

    named_windows: name of the comparison, and its two sets of windows, short stretches of swimming.
    """
    name, both_sides = named_windows
    try:  # AGAIN, the film against itself drawn and measured again, needs no single channels
        return compare.classify_windows(both_sides, p, by_channel=name != AGAIN)
    except FinloopError as error:
        return error


def classify_all(
    sides: Sides, p: RealismSettings, pool: Workers, kept: KeptResults = NOTHING_KEPT
) -> dict[str, Verdict]:
    """Return the verdict of the classifier on each comparison that has enough windows.

    sides: the two sets of windows of each comparison, short stretches of swimming, by its name.
    kept: verdicts of an earlier run. New verdicts are kept, too; a note is printed on each
    comparison with too few windows.
    """
    kept_values = {name: kept.load_values(name) for name in sides}
    verdicts = {name: Verdict.from_values(values) for name, values in kept_values.items() if values}
    new = {name: windows for name, windows in sides.items() if name not in verdicts}
    results = ordered_map(partial(_classify_or_error, p), new.items(), pool)
    for name, result in zip(new, results, strict=True):
        if isinstance(result, Verdict):
            verdicts[name] = result
            kept.save_values(name, result.to_values())
        else:
            print(f"realism: no numbers for {name}: {result}", file=sys.stderr)
    return {name: verdicts[name] for name in sides if name in verdicts}  # in the order of `sides`


def _save_film(path: Path, windows: pd.DataFrame, project: Project, slower: int) -> None:
    """Write a film of the examples that shows each twice, `slower` times slowed down.

    windows: a row per tick of each example, the windows that are most clearly film or animation.
    """
    tank, length = project.background, project.scene.typical_length_px
    shape, rate = (PANEL_PX + examples.WORDS_PX, 2 * PANEL_PX, 3), project.facts.frame_rate
    with Mp4Writer(path, shape, rate / slower, CRF) as writer:
        for _, example in windows.groupby("example"):
            gallery = project.whole_gallery
            frames = list(examples.draw_example(example, gallery, tank, length, PANEL_PX))
            for frame in frames * 2:
                writer.write(frame)


def _save_picture_examples(
    folder: Path, pictures: PictureSample, results: dict[str, PictureResult], slower: int
) -> None:
    """Write where the network looks, and the most obvious windows as a table, crops and a film.

    The table is pictures.csv in `folder`. In the film each window is shown twice, `slower` times
    slowed down: the animation left, the film right. pictures: the compared film and animations;
    results: by the name of the comparison.
    """
    looks = {name: result.verdict.looks for name, result in results.items()}
    shown = {name: look for name, look in looks.items() if look is not None}
    save_json(folder / "looks.json", list(shown))
    save_array(folder / "looks.npy", np.array(list(shown.values()), np.float32))
    table, crops = pictures.show_examples(results, pictures.project.whole_gallery)
    save_csv(folder / "pictures.csv", table, decimals=4)
    save_array(folder / "crops.npy", crops)
    if not len(crops):
        return
    enlarged, rate = PANEL_PX // SIZE, pictures.project.facts.frame_rate
    shape = examples.WORDS_PX + enlarged * SIZE, 2 * enlarged * SIZE, 3
    with Mp4Writer(folder / "pictures.mp4", shape, rate / slower, CRF) as writer:
        for title, pair in zip(table["compared"], crops, strict=True):
            frames = list(examples.draw_crop_pair(title, pair, enlarged))
            for frame in frames * 2:
                writer.write(frame)


def _save_report(
    folder: Path, verdicts: dict[str, Verdict], by_picture: dict[str, Verdict], sample: FilmSample,
    edit_lists: dict[str, list[EditList]], measured: dict[str, Swimming],
) -> None:  # fmt: skip
    """Write auc.csv and roc.csv to `folder`, and the metrics to reports/realism/.

    verdicts, by_picture: by comparison, of motion and of pictures. edit_lists, measured: edit lists
    and measured swimming, by mode or FILM.
    """
    tables = compare.verdict_table(verdicts), compare.verdict_table(by_picture, "picture")
    save_csv(folder / "auc.csv", pd.concat(tables, ignore_index=True), decimals=4)
    curves = [
        compute_roc(result.scores).assign(compared=name, by=by)
        for by, results in (("motion", verdicts), ("picture", by_picture))
        for name, result in results.items()
    ]
    columns = ["compared", "by", "false_alarms", "hits"]
    table = pd.concat(curves, ignore_index=True) if curves else pd.DataFrame()
    save_csv(folder / "roc.csv", table.reindex(columns=columns), decimals=4)
    numbers = compare.auc_metrics(verdicts, by_picture)
    for name, result in measured.items():
        numbers |= {
            f"{name}_s": len(result.row) / sample.rate_hz,
            f"{name}_followed_pct": 100 * _followed_share(result.row, edit_lists[name]),
        }
    save_metrics(REPORT / "metrics.json", numbers)


def main() -> None:
    """Test whether a classifier can distinguish the animations from the film.

    data/realism/ gets its results and examples, also as a film, reports/realism/ the metrics.
    """
    with Project() as project, open_workers(WORKERS_NEED) as pool:
        animation_s: float = load_settings("animate").seconds
        _compare_swimming(load_settings("realism"), animation_s, project, pool)


def build_instrument(project: Project) -> Instrument:
    """Return an instrument that measures drawn fish exactly as extraction measured the film.

    Δ and the current of the water are those of the film, not measured anew.
    """
    features, rate = project.features, project.rate_hz
    delta_s, current = infer_delta_frames(features) / rate, float(features["current"].iloc[0])
    measure = replace(load_settings("features"), delta_s=delta_s, water_current_bl_s=current)
    arena, extract = project.arena.astype(np.uint8) * 255, load_settings("extract")
    return Instrument(project.background, arena, project.scene, extract, measure, rate)


def _compare_swimming(
    p: RealismSettings, animation_s: float, project: Project, pool: Workers
) -> None:
    """Measure the fish of film and animations, classify them, and write data/realism/.

    animation_s: length of an animation. FinloopError if no fish is followed in the film.
    """
    rate, features = project.rate_hz, project.features
    # By mode or FILM: edit lists to draw, and how the fish in their pictures are measured.
    film_instrument = build_instrument(project)
    longest, most = round(animation_s * rate), round(p.seconds * rate)
    edit_lists = {FILM: sample_film_lists(features, longest=longest, most=most, seed=p.seed)}
    instruments = {FILM: film_instrument}
    mode_inputs = {}  # what a mode's results depend on beside INPUTS, on which all depend
    for mode in MODES:
        path = ANIMATE / mode / "samples.parquet"
        if path.exists():  # the film shows enough for this mode
            scale = project.drawn_scale(mode)
            edit_lists[mode] = [EditList(edit) for edit in split_by_fish(load_table(path, EDIT))]
            instruments[mode] = film_instrument.adapt_to_animation(scale)
            mode_inputs[mode] = [path_digest(path), scale]
            mode_inputs[f"picture {mode}"] = mode_inputs[mode]
    kept = open_kept("realism", INPUTS, mode_inputs)  # results of an earlier run
    measured = measure_swimming(edit_lists, GalleryOpener(project), instruments, pool, kept)
    if FILM not in measured:
        raise FinloopError(
            "the film was drawn again from its cut-outs, and no fish was found in that film",
            "cut-outs that look like the filmed fish",
            "see in reports/film/extract/detections.png whether the outlines fit the fish",
        )
    sample = compare.build_film_sample(measured[FILM], features, rate, p)
    animated = {mode: measured[mode] for mode in measured if mode != FILM}
    sides = sample.comparison_windows(animated, features)
    verdicts = classify_all(sides, p, pool, kept)
    filmed = replace(sample, film=sample.as_filmed(features))
    pictures = PictureSample(filmed, project, instruments, edit_lists, measured)
    results = pictures.judge(GalleryOpener(project), pool, kept)
    with whole_folder(OUT) as folder:
        windows, curves = examples.find_examples(sample, edit_lists, measured, sides, verdicts)
        save_table(folder / "examples.parquet", windows, examples.EXAMPLES)
        save_table(folder / "curves.parquet", curves, examples.CURVES)
        if len(windows):
            _save_film(folder / "examples.mp4", windows, project, p.slower)
        _save_picture_examples(folder, pictures, results, p.slower)
        by_picture = {name: result.verdict for name, result in results.items()}
        _save_report(folder, verdicts, by_picture, sample, edit_lists, measured)


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the processes already use every core
    run(main)
