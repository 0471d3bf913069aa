"""Stage `realism`: test whether a classifier can distinguish the animation from its film."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Sized
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.animate.settings import AnimateSettings
from finloop.base.errors import FinloopError
from finloop.base.parallel import Workers, ordered_map
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT, split_by_fish
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import whole_folder
from finloop.io.movie import Mp4Writer
from finloop.io.table import load_table, save_csv, save_table
from finloop.project import Project
from finloop.realism import compare, examples
from finloop.realism.auc import roc
from finloop.realism.compare import Sample, Sides, Verdict
from finloop.realism.examples import FILM
from finloop.realism.instrument import (
    Instrument,
    Swimming,
    Work,
    film_lists,
    join_measurements,
    measure_list,
)  # fmt: skip
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import AGAIN, Windows
from finloop.render.gallery import Gallery
from stages.cluster import workers
from stages.settings import load

ANIMATE = Path("data/animate")
OUT, REPORT = Path("data/realism"), Path("reports/realism")
WORKERS_NEED = ["finloop.realism.instrument", "finloop.realism.compare", "finloop.project"]
LEAST_SHARE = 0.8  # of the ticks that extraction follows; below it a note is printed
PANEL_PX, CRF = 320, 20  # of the film of examples


@dataclass(frozen=True)
class GalleryOpener:
    """Open all pictures from which edit lists draw; it can be sent to another process."""

    project: Project

    def __call__(self) -> AbstractContextManager[Gallery]:
        """Return the gallery of the film's pictures; the project closes it."""
        return nullcontext(self.project.whole_gallery)


def _followed_share(followed_ticks: Sized, work: list[Work]) -> float:
    """Return the share (0 … 1) of the ticks of edit lists in which extraction followed a fish."""
    return len(followed_ticks) / max(1, sum(len(edit) for edit, _ in work))


def swimming_of(
    works: dict[str, list[Work]], pictures: GalleryOpener, instruments: dict[str, Instrument],
    pool: Workers,
) -> dict[str, Swimming]:  # fmt: skip
    """Draw the edit lists of film and modes, and measure the fish in them by extraction.

    works, instruments: by mode or FILM. Returns the measured swimming by the same names, of those
    with a followed fish.
    """
    jobs = [(instruments[name], *job) for name, work in works.items() for job in work]
    tables = []
    with progress("realism", sum(len(edit) for _, edit, _ in jobs), "ticks") as advance:
        results = ordered_map(partial(measure_list, pictures), jobs, pool)
        for (_, edit, _), table in zip(jobs, results, strict=True):
            tables.append(table)
            advance(len(edit))
    measured: dict[str, Swimming] = {}
    for name, work in works.items():
        followed, tables = tables[: len(work)], tables[len(work) :]
        share = 0.0
        if any(map(len, followed)):
            edits, rate_hz = [edit for edit, _ in work], instruments[name].rate_hz
            measured[name] = join_measurements(edits, followed, rate_hz)
            share = _followed_share(measured[name].row, work)
        if share < LEAST_SHARE:
            print(f"realism: extraction followed the fish of {name} in {100 * share:.0f} % of the "
                  "ticks, and the numbers use only these; look at the film from "
                  f"render.mode={name}", file=sys.stderr)  # fmt: skip
    return measured


def _verdict(
    p: RealismSettings, item: tuple[str, tuple[Windows, Windows]]
) -> Verdict | FinloopError:
    try:
        return compare.classify_windows(item[1], p, alone=item[0] != AGAIN)
    except FinloopError as error:
        return error


def verdicts_of(sides: Sides, p: RealismSettings, pool: Workers) -> dict[str, Verdict]:
    """Return the verdict of each comparison that has enough windows; stderr names the others."""
    verdicts: dict[str, Verdict] = {}
    results = ordered_map(partial(_verdict, p), sides.items(), pool)
    for name, result in zip(sides, results, strict=True):
        if isinstance(result, Verdict):
            verdicts[name] = result
        else:
            print(f"realism: no numbers for {name}: {result}", file=sys.stderr)
    return verdicts


def _save_film(path: Path, windows: pd.DataFrame, project: Project, slower: int) -> None:
    """Write a film of the examples, each twice, `slower` times as slow as filmed."""
    tank, length = project.background, project.scene.typical_length_px
    shape, rate = (PANEL_PX + examples.WORDS_PX, 2 * PANEL_PX, 3), project.facts.frame_rate
    with Mp4Writer(path, shape, rate / slower, CRF) as writer:
        for _, example in windows.groupby("example"):
            gallery = project.whole_gallery
            for frame in 2 * list(examples.draw_example(example, gallery, tank, length, PANEL_PX)):
                writer.write(frame)


def _save_report(
    verdicts: dict[str, Verdict], sample: Sample, works: dict[str, list[Work]],
    measured: dict[str, Swimming],
) -> None:  # fmt: skip
    """Write auc.csv, roc.csv and the metrics to reports/realism/."""
    save_csv(REPORT / "auc.csv", compare.verdict_table(verdicts), decimals=4)
    curves = [roc(result.scores).assign(compared=name) for name, result in verdicts.items()]
    columns = ["compared", "false_alarms", "hits"]
    table = pd.concat(curves, ignore_index=True) if curves else pd.DataFrame()
    save_csv(REPORT / "roc.csv", table.reindex(columns=columns), decimals=4)
    numbers = compare.auc_metrics(verdicts)
    for name, result in measured.items():
        numbers |= {
            f"{name}_s": len(result.row) / sample.rate_hz,
            f"{name}_followed_pct": 100 * _followed_share(result.row, works[name]),
        }
    save_metrics(REPORT / "metrics.json", numbers)


def main() -> None:
    """Write data/realism/ (examples) and reports/realism/ (auc.csv, roc.csv, metrics)."""
    with Project() as project, workers(WORKERS_NEED) as pool:
        _compare_swimming(load("realism"), load("animate"), project, pool)


def instrument_of(project: Project) -> Instrument:
    """Return the instrument that measures drawn fish as extraction measured the film."""
    features, rate = project.features, project.rate_hz
    delta_s, current = infer_delta_frames(features) / rate, float(features["current"].iloc[0])
    return Instrument(
        project.background, project.arena.astype(np.uint8) * 255, project.scene, load("extract"),
        replace(load("features"), delta_s=delta_s, water_current_bl_s=current), rate,
    )  # fmt: skip


def _compare_swimming(
    p: RealismSettings, q: AnimateSettings, project: Project, pool: Workers
) -> None:
    """Measure film and animations, classify them, and write data/realism/ and reports/realism/."""
    rate, features = project.rate_hz, project.features
    works = {FILM: film_lists(features, round(q.seconds * rate), round(p.seconds * rate), p.seed)}
    instrument = instrument_of(project)
    instruments = {FILM: instrument}
    for mode in MODES:
        path = ANIMATE / mode / "samples.parquet"
        if path.exists():
            works[mode] = [(edit, ()) for edit in split_by_fish(load_table(path, EDIT))]
            instruments[mode] = instrument.adapt_to_animation(project.size(mode))
    measured = swimming_of(works, GalleryOpener(project), instruments, pool)
    if FILM not in measured:
        raise FinloopError(
            "extraction follows no fish in the film drawn again",
            "cut-outs that look like the filmed fish",
            "look at reports/extract/detections.png",
        )
    sample = compare.film_sample(measured[FILM], features, rate, p)
    sides = sample.comparison_windows(
        {mode: measured[mode] for mode in measured if mode != FILM}, features
    )
    verdicts = verdicts_of(sides, p, pool)
    with whole_folder(OUT) as folder:
        windows, curves = examples.WindowPool(sample, works, measured).tables(sides, verdicts)
        save_table(folder / "examples.parquet", windows, examples.EXAMPLES)
        save_table(folder / "curves.parquet", curves, examples.CURVES)
        if len(windows):
            _save_film(folder / "examples.mp4", windows, project, p.slower)
    _save_report(verdicts, sample, works, measured)


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the processes already use every core
    run(main)
