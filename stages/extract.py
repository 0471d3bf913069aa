"""Stage `extract`: make background, tracks, backbones and cut-outs from the normalised clip."""

from stages.run import report_findings, report_progress, run, save_metrics  # isort: skip  (before numpy)

import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import cv2
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.finding import Finding
from finloop.base.parallel import Workers
from finloop.extract.film import NoTrackError
from finloop.extract.join_films import FilmContribution, FishScaling, join_extractions
from finloop.extract.load_given import find_tracks_path
from finloop.extract.samples import Verdict
from finloop.extract.settings import ExtractSettings
from finloop.extract.verdict import list_findings
from finloop.extract.write import (
    Extraction,
    describe_lost_frames,
    extract_tracks,
    save_tank_pictures,
)
from finloop.io.atomic import whole_folder
from finloop.io.checkpoints import Checkpoints, remove_folders_except
from finloop.io.footage import read_file_stamps
from finloop.io.several import FILMS, JoinedFilm, load_joined_films, load_readable_films
from finloop.io.table import save_csv
from finloop.io.video import (
    FACTS_NAME,
    GRAIN_NAME,
    load_facts,
)
from stages.cluster import open_workers
from stages.origins import path_digest
from stages.reuse import code_digest, key_digest, reuse_or_make
from stages.settings import load_settings

CLIP, EXTRACT, REPORT = Path("data/clip"), Path("data/extract"), Path("reports/extract")
# DVC removes neither before it runs the stage: results of interrupted runs, and finished films.
CHECKPOINTS, KEPT = Path("data/.extract.part"), Path("data/.extract.films")
LONG = 60  # frames of a long track
_REASONS_NOT_USED = {
    "places_no_silhouette": "show no silhouette",
    "places_shared": "share a silhouette",
    "places_not_isolated": "show no isolated animal",
    "places_in_short_runs": "are in runs shorter than extract.min_track_frames",
}
WORKERS_NEED = ["finloop.extract.film", "finloop.extract.ready", "finloop.io.checkpoints"]
"""What the workers of a cluster import before they begin."""


def main() -> None:
    """Follow every animal of the clip; write data/extract/, and metrics to reports/extract/.

    data/extract/ gets background and grain of the tank, tracks with backbones, cut-outs, a row per
    film in films.csv, and what is doubtful in findings.csv, which is printed, too.
    """
    settings: ExtractSettings = load_settings("extract")
    with open_workers(WORKERS_NEED) as pool, whole_folder(EXTRACT) as folder:
        if load_readable_films(CLIP):  # several films
            numbers, films = _extract_films(CLIP, settings, pool, folder)
        else:  # one film: keep results until it is done, for a run that continues after a stop
            checkpoints = Checkpoints(CHECKPOINTS / key_digest(_track_inputs(CLIP, settings)))
            remove_folders_except(CHECKPOINTS, [checkpoints.folder.name])
            remove_folders_except(KEPT, [])
            numbers = _extract_film(CLIP, settings, pool, checkpoints, folder)
            name = load_facts(CLIP / FACTS_NAME).source
            rows, tracks = int(numbers["fish_frames"]), int(numbers["tracks"])
            films = [_film_row(FilmContribution(name, rows, tracks, FishScaling()))]
    remove_folders_except(CHECKPOINTS, [])
    save_metrics(REPORT / "metrics.json", numbers)
    save_csv(EXTRACT / "films.csv", pd.DataFrame(films), decimals=3)
    used_films = [film["film"] for film in films if not film["left_out_because"]]
    names = used_films if load_readable_films(CLIP) else [""]
    report_findings(EXTRACT, _film_findings(numbers, names))


def _film_findings(numbers: dict[str, float], names: list[str]) -> dict[str, Iterator[Finding]]:
    """Return the findings on each film, by its name.

    numbers: metrics of the stage; those of one of several films begin with its name and a "_".
    names: of the films that are used; "" for a single film.
    """
    findings = {}
    for name in names:
        prefix = f"{name}_" if name else ""
        findings[name] = list_findings({
            key.removeprefix(prefix): value
            for key, value in numbers.items()
            if key.startswith(prefix)
        })  # fmt: skip
    return findings


def _track_inputs(clip: Path, p: ExtractSettings) -> dict[str, Any]:
    """Return all that a clip's tracks are made from, as plain values by name.

    They are the parameters `p`, the program, the clip in folder `clip`, and given tracks, if any.
    """
    tracks = Path(p.tracks_path or "").expanduser()
    return {
        "extract": asdict(p), "code": code_digest("extract"), "clip": path_digest(clip),
        "tracks": read_file_stamps(tracks) if p.tracks_path and tracks.exists() else None,
    }  # fmt: skip


def _extract_film(
    clip: Path, settings: ExtractSettings, pool: Workers, checkpoints: Checkpoints, folder: Path
) -> dict[str, float]:
    """Write the tracks and cut-outs of one clip to `folder`; return its metrics by name.

    checkpoints: results of an interrupted run, to go on from. NoTrackError if nothing can be
    followed.
    """
    facts = load_facts(clip / FACTS_NAME)
    if checkpoints.stored_bytes():
        print("finloop: continues with the results of an interrupted run", file=sys.stderr)
    try:
        with report_progress("extract", facts.frames) as advance:
            extraction = extract_tracks(clip, settings, folder, pool, advance, checkpoints)
    except NoTrackError:
        checkpoints.remove()  # a new run would find nothing, too
        raise
    grain_grey, lack = save_tank_pictures(clip, folder, extraction.scene)
    if lack:
        note = f"the empty tank of an animation stands still: {lack}"
        print(f"finloop: note: {note}", file=sys.stderr)
    for note in describe_used_positions(extraction.given):
        print(f"finloop: note: {note}", file=sys.stderr)
    if extraction.lost:
        print(
            f"finloop: WARNING: {describe_lost_frames(extraction.lost, facts)}. "
            "To make the clip again: `dvc repro --force clip`",
            file=sys.stderr,
        )
    grain = {"tank_grain_grey": grain_grey}
    return {"frames": facts.frames, **_extraction_metrics(extraction), **grain}


def describe_used_positions(numbers: Mapping[str, float]) -> Iterator[str]:
    """Yield sentences on how many positions of another program's tracks are used, and why not more.

    numbers: counts of its places and animals, as in `Extraction.given`; empty without such a file.
    """
    if not numbers:
        return
    parts = [f"{numbers['places_used_share']:.1%} of the places in the file of tracks are used"]
    parts += [
        f"{numbers[name] / max(1, numbers['places']):.1%} {reason}"
        for name, reason in _REASONS_NOT_USED.items()
        if numbers[name]
    ]
    yield "; ".join(parts)
    animals, unused = numbers["animals"], numbers["animals"] - numbers["animals_used"]
    if unused:
        yield f"of its {animals:g} animals {unused:g} never have a silhouette of their own"


def _extract_films(
    clip: Path, settings: ExtractSettings, pool: Workers, folder: Path
) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Write the tracks and cut-outs of several films, a folder each below `folder`, and join them.

    clip: folder of the clips. Return metrics, and a row of films.csv for each film. A film that
    cannot be used is left out, with a warning. What an earlier run made of a film is reused.
    """
    numbers, parts = dict[str, float](), load_joined_films(clip)
    errors = {part.name: part.error for part in parts if part.error}
    jobs = []  # film, its settings, digest of what its tracks are made from
    for part in parts:
        if not part.error:
            with _leave_out_on_error(part, errors):
                film_settings = _settings_of_film(part, settings)
                inputs = _track_inputs(clip / FILMS / part.name, film_settings)
                jobs.append((part, film_settings, key_digest(inputs)))
    # Results under other digests are of other parameters or films: nothing will read them.
    digests = [digest for _, _, digest in jobs]
    remove_folders_except(CHECKPOINTS, digests)
    for part, film_settings, digest in jobs:
        film_folder, checkpoints = Path(FILMS) / part.name, Checkpoints(CHECKPOINTS / digest)
        print(f"finloop: {part.name}", file=sys.stderr)
        with _leave_out_on_error(part, errors):
            make = partial(_extract_film, clip / film_folder, film_settings, pool, checkpoints)
            metrics = reuse_or_make(KEPT / digest, folder / film_folder, make)
            numbers |= {f"{part.name}_{name}": value for name, value in metrics.items()}
    remove_folders_except(KEPT, digests)
    contributions = join_extractions(clip, folder, errors)
    grain = folder / FILMS / contributions[0].name / GRAIN_NAME  # the tank is that of the first
    if grain.exists():
        shutil.copy(grain, folder)
    numbers["frames"] = load_facts(clip / FACTS_NAME).frames
    numbers["fish_frames"] = sum(item.rows for item in contributions)
    numbers["tracks"] = sum(item.tracks for item in contributions)
    numbers |= {"films": len(contributions), "films_left_out": len(errors)}
    return numbers, [
        *map(_film_row, contributions),
        *({"film": name, "left_out_because": error} for name, error in errors.items()),
    ]


def _settings_of_film(part: JoinedFilm, settings: ExtractSettings) -> ExtractSettings:
    """Return the settings for one film, with its own file of tracks instead of the pattern for all.

    A note that says which file is used is printed. Without a pattern the settings are unchanged.
    """
    if not settings.tracks_path:
        return settings
    path = find_tracks_path(Path(part.path), settings.tracks_path)
    print(f"finloop: note: the tracks of {part.name} are {path}", file=sys.stderr)
    return replace(settings, tracks_path=path)


@contextmanager
def _leave_out_on_error(part: JoinedFilm, errors: dict[str, str]) -> Iterator[None]:
    """Run a block for one film; on FinloopError print a warning, note the cause, and continue.

    errors: name of the film → cause; gets an entry for a film that fails.
    """
    try:
        yield
    except FinloopError as error:
        print(f"finloop: WARNING: {part.path} is left out: {error}", file=sys.stderr)
        errors[part.name] = error.came


def _film_row(contribution: FilmContribution) -> dict[str, Any]:
    """Return one film's row of films.csv: numbers of rows and tracks, factors of length and light.

    Multiplied by them, its fish are as long and as bright as those of the first film.
    """
    gains = contribution.like.gains or (1.0,)
    return {
        "film": contribution.name,
        "fish_frames": contribution.rows,
        "tracks": contribution.tracks,
        "length_times": contribution.like.scale,
        "light_times": sum(gains) / len(gains),
        "left_out_because": "",
    }


def _extraction_metrics(extraction: Extraction) -> dict[str, float]:
    """Return the metrics of an extraction: noise, typical fish, verdicts, lengths of tracks.

    The verdicts count the silhouettes that are a fish, several fish or none.
    """
    scene, verdicts, frames_by_track, jumps_pct, area_range, given, lost, light = extraction
    long_tracks = [count for count in frames_by_track.values() if count >= LONG]
    return {
        **{name: value for name, value in asdict(scene).items() if name.endswith(("_grey", "_px"))},
        "silhouettes": verdicts.total(),
        **{f"silhouettes_{v.replace(' ', '_')}": verdicts[v] for v in get_args(Verdict)},
        "fish_frames": frames_by_track.total(),
        "tracks": len(frames_by_track),
        f"tracks_of_{LONG}_frames": len(long_tracks),
        f"fish_frames_in_tracks_of_{LONG}_frames": sum(long_tracks),
        "longest_track_frames": max(frames_by_track.values()),
        "area_jumps_pct": jumps_pct,
        "area_range": area_range,
        **light._asdict(),
        **given,
        **({"frames_lost": len(lost)} if lost else {}),
    }


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the workers already use every core
    run(main)
