"""The pictures of `realism`: crops of the film itself and of drawn animations, and verdicts."""

import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask, Picture
from finloop.base.errors import FinloopError
from finloop.base.parallel import Workers, ordered_map
from finloop.io.video import CLIP_NAME, read_chosen_frames
from finloop.project import Project
from finloop.realism.compare import FilmSample, Verdict, classify_pictures
from finloop.realism.crops import (
    PICTURE_CHANNELS,
    SIZE,
    CropCamera,
    CropCollector,
    CropMeter,
    CropSeries,
    cut_crops,
    join_crop_series,
    no_crops,
    rows_with_company,
)  # fmt: skip
from finloop.realism.examples import FILM, most_false_windows
from finloop.realism.instrument import (
    EditList,
    Instrument,
    Swimming,
    measure_pictures,
    rows_to_keep,
)  # fmt: skip
from finloop.realism.windows import AGAIN, HALVES, Windows
from finloop.render.gallery import Gallery, fish_by_row
from finloop.render.living import LivingTank
from stages.kept import KeptResults
from stages.run import report_progress

_CHUNK = 120  # frames of the film that a job reads


@dataclass(frozen=True)
class FilmPart:
    """Fish in some successive frames of a clip, and how their crops are cut.

    rows (n,): of all the film's rows that are compared. frames (n,): ascending. places (n, 3): x, y
    and heading. track (n,): numbers. keep (n,): whose crops are kept. counts (n,): whose measures
    are used; the others only give the crop before the first one of their fish.
    """

    clip: Path
    colour: bool
    camera: CropCamera
    rows: Ints
    frames: Ints
    places: Floats
    track: Ints
    keep: Mask
    counts: Mask


def measure_film_part(part: FilmPart) -> CropSeries:
    """Measure the crops of one part's fish in the clip's own frames; return a series of n rows."""
    collector, meters = CropCollector(len(part.rows)), dict[int, CropMeter]()
    frames = read_chosen_frames(part.clip, part.frames.tolist(), colour=part.colour)
    for number, frame in enumerate(frames):
        meter = meters.setdefault(int(part.track[number]), CropMeter(part.camera))
        x_px, y_px, heading_deg = part.places[number]
        measured = meter.measure(frame, x_px, y_px, heading_deg, alone=True)
        collector.add(number, measured, bool(part.keep[number]))
    return collector.pictures()


def film_parts(
    filmed: Swimming, project: Project, camera: CropCamera, stride: int, company: Mask
) -> Iterable[FilmPart]:
    """Yield the parts of the film whose fish are compared; a crop is kept every `stride` ticks.

    filmed: the compared stretches as filmed, n rows. company (n,): True where the crop shows
    another fish, too; such a crop is not kept.
    """
    table = filmed.table
    track, frame = table["track_id"].to_numpy(), table["frame"].to_numpy()
    keep = rows_to_keep(track, stride) & ~company
    places = table[["x_px", "y_px", "heading_deg"]].to_numpy(float)
    clip, colour = project.data / "clip" / CLIP_NAME, project.facts.colour
    order = np.argsort(frame, kind="stable")
    used_frames = np.unique(frame)
    for chunk in np.array_split(used_frames, max(1, len(used_frames) // _CHUNK)):
        low, high = np.searchsorted(frame[order], [chunk[0] - 1, chunk[-1] + 1])
        rows = order[low:high]
        counts = frame[rows] >= chunk[0]
        yield FilmPart(
            clip, colour, camera, rows, frame[rows], places[rows], track[rows],
            keep[rows] & counts, counts,
        )  # fmt: skip


def _join_film_parts(
    parts: Iterable[FilmPart], pictures: Iterable[CropSeries], filmed: Swimming, company: Mask
) -> CropSeries:
    """Join the crop series of all parts of the film to one, in the order of the film's n rows.

    parts, pictures: the parts, and the series of each. company (n,): True where the crop shows
    another fish, too; the measures there become NaN.
    """
    channels = np.full((len(filmed.row), len(PICTURE_CHANNELS)), np.nan)
    rows, crops = [np.zeros(0, np.int64)], [no_crops()]
    for part, result in zip(parts, pictures, strict=True):
        channels[part.rows[part.counts]] = result.channels[part.counts]
        rows.append(part.rows[result.crop_rows])
        crops.append(result.crops)
    channels[company] = np.nan
    all_rows = np.concatenate(rows)
    order = np.argsort(all_rows, kind="stable")
    return CropSeries(channels, all_rows[order], np.concatenate(crops)[order])


@dataclass(frozen=True)
class PictureResult:
    """How well pictures distinguish two sets of windows, and the most obvious ones of an animation.

    pairs: of windows, by the rows of animation and film with which they begin, and the score.
    """

    verdict: Verdict
    pairs: list[tuple[int, int, float]]

    def to_values(self) -> dict[str, Any]:
        """Return the result as plain values that JSON can hold."""
        return {"verdict": self.verdict.to_values(), "pairs": self.pairs}

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> "PictureResult":
        """Restore a result from the plain values of `to_values`."""
        return cls(Verdict.from_values(values["verdict"]), [tuple(x) for x in values["pairs"]])


@dataclass(frozen=True)
class PictureSample:
    """The film as filmed and what is compared with it, each measured in its pictures.

    sample: with the film as filmed. instruments, edit_lists, measured: as in stage `realism`, by
    mode, or FILM for the film drawn again.
    """

    sample: FilmSample
    project: Project
    instruments: Mapping[str, Instrument]
    edit_lists: Mapping[str, Sequence[EditList]]
    measured: Mapping[str, Swimming]

    @property
    def open_tank(self) -> Callable[[], LivingTank | None]:
        """Return a function that returns the empty tank with the film's grain and light.

        It returns None if the film shows neither.
        """
        return partial(self.project.living_tank, "film")

    @property
    def names(self) -> list[str]:
        """Return the names of the comparisons: the modes, the film drawn again, the halves."""
        return [*(AGAIN if name == FILM else name for name in self.measured), HALVES]

    def judge(
        self, open_pictures: Callable[[], AbstractContextManager[Gallery]], pool: Workers,
        kept: KeptResults,
    ) -> dict[str, PictureResult]:  # fmt: skip
        """Return the result of each comparison that has enough windows, by its name.

        kept: results of an earlier run, by "picture <name>".
        """
        results = dict[str, PictureResult]()
        for name in self.names:
            if values := kept.load_values(f"picture {name}"):
                results[name] = PictureResult.from_values(values)
        new = [name for name in self.names if name not in results]
        if new:
            film = self._measure_film_crops(pool)
            pictures = self._drawn_pictures(new, open_pictures, pool)
            jobs = ((name, *self._sides(name, film, pictures)) for name in new)
            for name, result in zip(new, ordered_map(partial(_judge, self.sample), jobs, pool),
                                    strict=True):  # fmt: skip
                if isinstance(result, FinloopError):
                    print(f"realism: no pictures of {name}: {result}", file=sys.stderr)
                    continue
                results[name] = result
                kept.save_values(f"picture {name}", result.to_values())
        return {name: results[name] for name in self.names if name in results}

    def _measure_film_crops(self, pool: Workers) -> CropSeries:
        """Measure the film's own pictures of the compared fish; return all ticks as one series."""
        filmed, camera = self.sample.film, self.instruments[FILM].crop_camera
        company = rows_with_company(filmed.row, self.project.features, camera)
        stride = self.sample.window_cut.stride
        parts = list(film_parts(filmed, self.project, camera, stride, company))
        with report_progress("realism: pictures of the film", len(parts), "parts") as advance:
            pictures = list[CropSeries]()
            for result in ordered_map(measure_film_part, parts, pool):
                pictures.append(result)
                advance(1)
        return _join_film_parts(parts, pictures, filmed, company)

    def _drawn_pictures(
        self, names: Collection[str], open_pictures: Callable[[], AbstractContextManager[Gallery]],
        pool: Workers,
    ) -> dict[str, CropSeries]:  # fmt: skip
        """Draw the animations and measure their crops; return a series for each, by its name."""
        stride, jobs, owners = self.sample.window_cut.stride, [], list[str]()
        for name, swimming in self.measured.items():
            compared = AGAIN if name == FILM else name
            for number, edit_list in enumerate(self.edit_lists[name]) if compared in names else ():
                table = swimming.table[swimming.list_number == number].reset_index(drop=True)
                keep = rows_to_keep(table["track_id"].to_numpy(), stride)
                jobs.append((self.instruments[name], edit_list, table, keep))
                owners.append(compared)
        parts: dict[str, list[CropSeries]] = {name: [] for name in owners}
        with report_progress("realism: pictures", len(jobs), "animations") as advance:
            results = ordered_map(
                partial(measure_pictures, open_pictures, self.open_tank), jobs, pool
            )
            for name, result in zip(owners, results, strict=True):
                parts[name].append(result)
                advance(1)
        return {name: join_crop_series(results) for name, results in parts.items()}

    def _sides(
        self, name: str, film: CropSeries, drawn: Mapping[str, CropSeries]
    ) -> tuple[tuple[Windows, Windows], tuple[Windows, Windows]]:
        """Return the two sets of windows of a comparison, and those of its crops.

        name: of the comparison. film: crop series of the film; drawn: that of each animation, by
        name.
        """
        both = []
        for view in ("picture", "crop"):
            filmed = replace(self.sample.film, pictures=film)
            sample = replace(self.sample, film=filmed, view=view)
            if name == HALVES:
                both.append(sample.half_windows())
            else:
                animation = self.measured[FILM if name == AGAIN else name]
                pictures = drawn[name]
                if name == AGAIN:  # the very same moments, or they would tell
                    seen = np.isfinite(film.channels).all(axis=1, keepdims=True)
                    channels = np.where(seen, pictures.channels, np.nan)
                    pictures = pictures._replace(channels=channels)
                animation = replace(animation, pictures=pictures)
                both.append(sample.windows_beside_film(animation))
        return both[0], both[1]

    def show_examples(
        self, results: Mapping[str, PictureResult], gallery: Gallery
    ) -> tuple[pd.DataFrame, NDArray[np.uint8]]:
        """Return a table of the most obvious windows of the modes, and their crops as seen.

        The table has the columns example, compared, score; the crops are (examples, 2, ticks, SIZE,
        SIZE): an animation, and the film window most like it.
        """
        ticks = self.sample.window_cut.length + 1
        rows, crops = list[tuple[int, str, float]](), list[NDArray[np.uint8]]()
        for name, result in results.items():
            for animation, film, score in result.pairs if name in self.measured else ():
                rows.append((len(rows), name, score))
                shown = self._animation_crops(name, animation + np.arange(ticks), gallery)
                crops.append(np.stack([shown, self._film_crops(film + np.arange(ticks))]))
        table = pd.DataFrame(rows, columns=["example", "compared", "score"])
        empty = np.zeros((0, 2, ticks, SIZE, SIZE), np.uint8)
        return table, np.stack(crops) if crops else empty

    def _animation_crops(self, name: str, rows: Ints, gallery: Gallery) -> NDArray[np.uint8]:
        """Return the crops (ticks, SIZE, SIZE) of successive measured rows of an animation."""
        swimming, instrument = self.measured[name], self.instruments[name]
        edit = self.edit_lists[name][int(swimming.list_number[rows[0]])].edit
        ticks = swimming.tick[rows]
        edit = edit.iloc[ticks].assign(tick=np.arange(len(rows)))
        painter, camera = instrument.living_painter(self.open_tank()), instrument.crop_camera
        drawn = instrument.reduce_to_filmed_size(edit)

        def frames() -> Iterator[Picture]:
            """Yield the frame of each tick."""
            for tick, fish in zip(ticks, fish_by_row(drawn, gallery), strict=True):
                painter.show(fish, tick=int(tick))
                yield painter.frame

        return cut_crops(camera, frames(), swimming.table.iloc[rows])

    def _film_crops(self, rows: Ints) -> NDArray[np.uint8]:
        """Return the crops (ticks, SIZE, SIZE) of successive rows of the film."""
        table, project = self.sample.film.table.iloc[rows], self.project
        frames = read_chosen_frames(
            project.data / "clip" / CLIP_NAME, table["frame"].tolist(), colour=project.facts.colour
        )
        return cut_crops(self.instruments[FILM].crop_camera, frames, table)


def _judge(
    sample: FilmSample, job: tuple[str, tuple[Windows, Windows], tuple[Windows, Windows]]
) -> PictureResult | FinloopError:
    """Return the result of one comparison; an error if it has too few windows.

    job: its name, its windows and its crops. The film drawn again is judged without a network.
    """
    name, windows, crops = job
    try:
        verdict = classify_pictures(windows, None if name == AGAIN else crops, sample.p)
    except FinloopError as error:
        return error
    if name in (AGAIN, HALVES):
        return PictureResult(verdict, [])
    film, animation = windows
    scores, length = verdict.scores.score[len(film) :], sample.window_cut.length
    pairs = most_false_windows(film, animation, scores, sample.p.examples, length)
    return PictureResult(
        verdict,
        [(int(animation.first[a]), int(film.first[f]), score) for a, f, score in pairs],
    )
