"""Stage `realism`: can a classifier tell the animation from its film, and what gives it away?"""

from stages.run import THREADS, progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.animate.planner import Planner
from finloop.animate.settings import Settings as AnimateSettings
from finloop.animate.swim import random_goals
from finloop.base.errors import FinloopError
from finloop.base.parallel import ordered_map, warm_up
from finloop.features.table import FEATURES
from finloop.io.atomic import whole_folder
from finloop.io.movie import Mp4Writer
from finloop.io.picture import load_picture
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, load_facts, load_mask
from finloop.realism import compare, examples
from finloop.realism.auc import roc
from finloop.realism.compare import Sample, Verdict
from finloop.realism.instrument import Instrument, Swimming, as_filmed, measured, swimming
from finloop.realism.settings import Settings
from finloop.realism.windows import AGAIN, HALVES, Windows
from stages.animate import bring
from stages.edit import DATA, Drawn, load_drawn
from stages.gallery import open_gallery
from stages.settings import load

CLIP, OUT, REPORT = DATA / "clip", DATA / "realism", Path("reports/realism")
WORKERS_NEED = ["finloop.realism.instrument", "finloop.realism.compare", "stages.gallery"]
FILM = "film"  # beside the modes
PANEL_PX, CRF = 320, 20  # of the film of examples

Work = tuple[pd.DataFrame, Sequence[int]]
"""An edit list, and its ticks at which another fish begins."""
Sides = dict[str, tuple[Windows, Windows]]


def animations(planner: Planner, mode: str, seconds: float, p: AnimateSettings) -> Iterator[Work]:
    """Animations of so many seconds in all, as `animate` makes them, with other seeds and goals.

    Each is `animate.seconds` long: to random goals first, then the fish wanders.
    """
    waters = planner.waters
    for number in range(int(np.ceil(seconds / p.seconds))):
        left = seconds - number * p.seconds
        one = replace(p, seed=p.seed + 1 + number, seconds=min(p.seconds, left))
        rng, reach = np.random.default_rng(one.seed), waters.touch_px + waters.head_px
        goals = random_goals(waters.tank, reach, p.trial_goals, rng)
        again = replace(planner, waters=replace(waters, settings=one))
        yield again.plan(mode, [g._replace(radius_px=waters.touch_px) for g in goals])[1], ()


def filmed(tracks: pd.DataFrame, longest: int, most: int, seed: int) -> list[Work]:
    """The film to compare with as edit lists, each of about `longest` ticks."""
    places = tracks[["x_px", "y_px"]].to_numpy()
    works: list[Work] = []
    rows: list[np.ndarray] = []
    chosen = compare.stretches(tracks["track_id"].to_numpy(), longest, most, seed)
    for one in chosen:
        rows.append(np.arange(one.start, one.stop))
        if sum(map(len, rows)) >= longest or one is chosen[-1]:
            every = np.concatenate(rows)
            cuts = np.cumsum([len(part) for part in rows])[:-1].tolist()
            works.append((as_filmed(every, places[every]), cuts))
            rows = []
    return works


def followed(
    works: dict[str, list[Work]], drawn: Drawn, instrument: Instrument
) -> dict[str, Swimming]:
    """What extraction measures of film and animations, without those that it cannot follow."""
    work = partial(measured, partial(open_gallery, drawn), instrument)
    every = [one for part in works.values() for one in part]
    tables = []
    with progress("realism", sum(len(edit) for edit, _ in every), "ticks") as advance:
        for (edit, _), table in zip(every, ordered_map(work, every, THREADS), strict=True):
            tables.append(table)
            advance(len(edit))
    swum: dict[str, Swimming] = {}
    for name, part in works.items():
        own, tables = tables[: len(part)], tables[len(part) :]
        if any(len(table) for table in own):
            swum[name] = swimming([edit for edit, _ in part], own, instrument.rate_hz)
        else:
            print(f"realism: extraction could follow no fish in {name}: no numbers for it; look at "
                  f"the film that render.mode={name} makes", file=sys.stderr)  # fmt: skip
    return swum


def sides(sample: Sample, swum: dict[str, Swimming], features: pd.DataFrame) -> Sides:
    """The windows to be told apart. features: of the film as it was filmed."""
    film, blocks = sample.film, sample.blocks()
    before = features.iloc[film.row].assign(track_id=film.table["track_id"].to_numpy())
    return {
        **{mode: sample.beside(made) for mode, made in swum.items() if mode != FILM},
        HALVES: sample.halves(),
        AGAIN: (sample.windows(replace(film, table=before), blocks), sample.windows(film, blocks)),
    }


def _judged(p: Settings, item: tuple[str, tuple[Windows, Windows]]) -> Verdict | FinloopError:
    """A comparison, or why there is none."""
    try:
        return compare.verdict(item[1], p, alone=item[0] != AGAIN)
    except FinloopError as error:
        return error


def judged(pairs: Sides, p: Settings) -> dict[str, Verdict]:
    """All comparisons that there are enough windows for."""
    verdicts: dict[str, Verdict] = {}
    results = ordered_map(partial(_judged, p), pairs.items(), THREADS)
    for name, result in zip(pairs, results, strict=True):
        if isinstance(result, Verdict):
            verdicts[name] = result
        else:
            print(f"realism: no numbers for {name}: {result}", file=sys.stderr)
    return verdicts


@dataclass(frozen=True)
class Show:
    """All that the most obviously false windows are picked from."""

    sample: Sample
    works: dict[str, list[Work]]
    swum: dict[str, Swimming]

    def window(self, name: str, windows: Windows, number: int) -> pd.DataFrame:
        """A window of the film or of a mode as an edit list, with the heading it begins with."""
        swum = self.swum[name]
        rows = windows.first[number] + np.arange(self.sample.cut.length + 1)
        edit = self.works[name][int(swum.part[rows[0]])][0].iloc[swum.tick[rows]]
        return edit.assign(start_deg=float(swum.table["heading_deg"].iloc[rows[0]]))

    def worst(self, mode: str, pair: tuple[Windows, Windows], verdict: Verdict) -> Iterator[
        tuple[pd.DataFrame, pd.DataFrame]
    ]:  # fmt: skip
        """Examples of a mode: rows of `EXAMPLES` and of `CURVES`, but for their number."""
        film, made = pair
        cut, count = self.sample.cut, self.sample.p.examples
        score = verdict.scores.score[len(film.x) :]
        for one in examples.worst(film, made, score, count, cut.length):
            edit = [
                self.window(mode, made, one.made).assign(side=examples.MADE),
                self.window(FILM, film, one.film).assign(side=examples.FILM),
            ]
            seen = {examples.MADE: made.x[one.made], examples.FILM: film.x[one.film]}
            yield (
                pd.concat(edit, ignore_index=True).assign(compared=mode, score=one.score),
                examples.curves(seen, cut.step / self.sample.rate_hz),
            )


def save_examples(folder: Path, show: Show, pairs: Sides, verdicts: dict[str, Verdict]) -> None:
    """Write the tables of the examples."""
    every = [
        example
        for mode in verdicts
        if mode in show.swum
        for example in show.worst(mode, pairs[mode], verdicts[mode])
    ]
    for place, (name, schema) in enumerate(
        (("examples", examples.EXAMPLES), ("curves", examples.CURVES))
    ):
        parts = [one[place].assign(example=number) for number, one in enumerate(every)]
        table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
        save_table(folder / f"{name}.parquet", table.reindex(columns=schema.names), schema)


def save_film(folder: Path, drawn: Drawn, slower: int) -> None:
    """Write the examples as a slow film, each twice; none where there are none."""
    table = load_table(folder / "examples.parquet", examples.EXAMPLES)
    if table.empty:
        return
    rate, tank = (
        load_facts(CLIP / FACTS_NAME).frame_rate,
        load_picture(DATA / "extract/background.png"),
    )
    shape = PANEL_PX + examples.WORDS_PX, 2 * PANEL_PX, 3
    length = drawn.scene.typical_length_px
    with (
        open_gallery(drawn) as gallery,
        Mp4Writer(folder / "examples.mp4", shape, rate / slower, CRF) as writer,
    ):
        for _, example in table.groupby("example"):
            for frame in 2 * list(examples.side_by_side(example, gallery, tank, length, PANEL_PX)):
                writer.write(frame)


def save_report(verdicts: dict[str, Verdict], sample: Sample, swum: dict[str, Swimming]) -> None:
    """Write numbers and curves."""
    save_csv(REPORT / "auc.csv", compare.table(verdicts), decimals=4)
    curves = [roc(one.scores).assign(compared=name) for name, one in verdicts.items()]
    columns = ["compared", "false_alarms", "hits"]
    table = pd.concat(curves, ignore_index=True) if curves else pd.DataFrame()
    save_csv(REPORT / "roc.csv", table.reindex(columns=columns), decimals=4)
    seconds = {f"{name}_s": len(one.row) / sample.rate_hz for name, one in swum.items()}
    save_metrics(REPORT / "metrics.json", compare.numbers(verdicts) | seconds)


def main() -> None:
    """Make data/realism/, reports/realism/."""
    p: Settings = load("realism")
    q: AnimateSettings = load("animate")
    if THREADS > 1:
        warm_up(WORKERS_NEED)
    facts = load_facts(CLIP / FACTS_NAME)
    rate = facts.frame_rate_hz
    mask = load_mask(CLIP / ARENA_NAME, facts.width_px, facts.height_px)
    features = load_table(DATA / "features/features.parquet", FEATURES)
    works = {FILM: filmed(features, round(q.seconds * rate), round(p.seconds * rate), p.seed)}
    amount = min(p.seconds, sum(len(edit) for edit, _ in works[FILM]) / rate)
    with bring(q) as planner:
        for mode in planner.players:
            works[mode] = list(animations(planner, mode, amount, q))
    drawn = load_drawn(mode, "realism", sprites=True, bodies=True)
    instrument = Instrument(
        load_picture(DATA / "extract/background.png"), mask.astype(np.uint8) * 255, drawn.scene,
        load("extract"), load("features"), rate,
    )  # fmt: skip
    swum = followed(works, drawn, instrument)
    if FILM not in swum:
        raise FinloopError(
            "extraction could follow no fish of the film drawn again",
            "cut-outs that look like the fish they were cut from",
            "look at reports/extract/detections.png",
        )
    sample = compare.sample(swum[FILM], features, rate, p)
    pairs = sides(sample, swum, features)
    verdicts = judged(pairs, p)
    with whole_folder(OUT) as folder:
        save_examples(folder, Show(sample, works, swum), pairs, verdicts)
        save_film(folder, drawn, p.slower)
    save_report(verdicts, sample, swum)


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the processes already use every core
    run(main)
