"""Stage `clip`: normalise one film or several into the clip, with facts, arena and truth."""

from stages.run import report_findings, report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.base.finding import Finding
from finloop.clip.check import Quality, psnr_db
from finloop.clip.rewrite import Watch, make_clip
from finloop.clip.settings import ClipSettings, FootageSettings
from finloop.clip.verdict import REPAIRS, judge_completeness, list_findings
from finloop.clip.write import ClipSource, open_clip_source
from finloop.io.atomic import whole_folder
from finloop.io.checkpoints import remove_folders_except
from finloop.io.footage import list_films, read_file_stamps, refuse_changed_film, unique_film_names
from finloop.io.several import FILMS, JoinedFilm, join_clips, list_film_folders
from finloop.io.video import CLIP_NAME, VideoFacts, read_chosen_frames
from stages.reuse import code_digest, key_digest, reuse_or_make
from stages.settings import load_settings

CLIP = Path("data/clip")
KEPT = Path("data/.clip.films")  # earlier clips of several films; DVC does not remove it
METRICS = Path("reports/clip/metrics.json")
COMPARED_EVERY = 4  # samples from one that is compared with its coded frame to the next
FACTS = (  # among the metrics
    "frames", "width_px", "height_px", "frame_rate_hz", "frames_repeated", "frames_dropped",
    "frames_missing",
)  # fmt: skip


def main() -> None:
    """Make the normalised clip of the film or films; write data/clip/, and metrics to reports/.

    What is doubtful in the films is printed and written to data/clip/findings.csv.
    """
    p: ClipSettings = load_settings("clip")
    films = drop_repeated_films(settings_of_films(p)) if isinstance(p, FootageSettings) else []
    with whole_folder(CLIP) as folder:
        if len(films) > 1:
            numbers = _write_clips(films, folder)
        else:
            remove_folders_except(KEPT, [])  # a single film is not kept for reuse
            p = films[0] if films else p
            numbers = _write_clip(p, open_clip_source(p), folder, report_progress)
    save_metrics(METRICS, numbers)
    report_findings(CLIP, _film_findings(numbers))


def settings_of_films(p: FootageSettings) -> list[FootageSettings]:
    """Return the parameters of each film that `p.path` names, in order.

    `p.path` is a file, pattern or folder, or a list of these, some with parameters of their own.
    """
    return [
        replace(path_settings, path=str(film))
        for path, path_settings in p.settings_by_path()
        for film in list_films(path)
    ]


def drop_repeated_films(films: list[FootageSettings]) -> list[FootageSettings]:
    """Return the films without repeats; print a warning for each repeat.

    films: parameters of each film. A repeat has the file and the parameters of an earlier film.
    """
    first_by_file = dict[FootageSettings, FootageSettings]()
    for film in films:
        key = replace(film, path=str(film.film.resolve()))
        first = first_by_file.setdefault(key, film)
        if first is not film:
            twice = "twice" if film.path == first.path else f"twice as {first.path}"
            print(f"finloop: WARNING: {film.path} is named {twice}, and used once", file=sys.stderr)
    return list(first_by_file.values())


def _write_clip(
    p: ClipSettings, source: ClipSource, folder: Path, watch: Watch
) -> dict[str, float]:
    """Write one film's clip to `folder`; print notes on it, and return its metrics by name.

    watch: opens the report of progress. FinloopError if the film's file changes meanwhile.
    """
    for note in source.facts.notes:
        print(f"finloop: note: {note}", file=sys.stderr)
    before = read_file_stamps(p.film) if isinstance(p, FootageSettings) else []
    clip = make_clip(p, source, folder, watch)
    facts, tally = clip.facts, clip.tally
    for note in facts.notes[len(source.facts.notes) :]:  # on frames that cannot be read
        print(f"finloop: WARNING: {note}", file=sys.stderr)
    if isinstance(p, FootageSettings):
        refuse_changed_film(p.film, before)
    # Some of the sampled frames are read from the clip, to measure what the coding loses.
    numbers = list(tally.samples)[::COMPARED_EVERY]
    coded = read_chosen_frames(folder / CLIP_NAME, numbers, colour=facts.colour, threads=1)
    filmed = [tally.samples[number] for number in numbers]
    return {
        **_fact_metrics(facts),
        **clip.metrics,
        "brightness_mean_level": tally.brightness_mean,
        "brightness_min_level": tally.darkest,
        "brightness_max_level": tally.brightest,
        "coding_psnr_db": psnr_db(zip(filmed, coded, strict=True)),
        "arena_fraction": float(clip.arena.mean()),
    }


def _film_findings(metrics: dict[str, float]) -> dict[str, list[Finding]]:
    """Return the findings on each film, by its name.

    metrics: those of the stage, by name. With several films, a film's begin with its name.
    """
    findings = {}
    for name, _ in list_film_folders(CLIP):
        prefix = f"{name}_" if name else ""
        repaired = {repair for repair in REPAIRS if metrics[f"{prefix}mended_{repair}"]}
        refused = {repair for repair in REPAIRS if f"{prefix}refused_{repair}" in metrics}
        quality = Quality.from_metrics(metrics, prefix)
        quality_as_filmed = Quality.from_metrics(metrics, f"{prefix}filmed_")
        findings[name] = [
            judge_completeness(int(metrics[f"{prefix}frames_missing"])),
            *list_findings(quality, quality_as_filmed, repaired, refused),
        ]
    return findings


def _write_clips(films: list[FootageSettings], folder: Path) -> dict[str, float]:
    """Write each film's clip to a folder of its own below `folder`, and join all to one clip.

    Return all metrics; those of one film begin with its name. A clip that an earlier run made of
    the same film, settings and code is reused; older ones are deleted. A film that cannot be read
    is left out, with a warning; FinloopError if none can be read.
    """
    code, parts, digests = code_digest("clip"), list[JoinedFilm](), list[str]()
    numbers: dict[str, float] = {}
    named_films = list(zip(unique_film_names(p.film for p in films), films, strict=True))

    def no_progress(*_: object) -> AbstractContextManager[Callable[[], None]]:
        """Return a context with a function that does nothing, in place of progress."""
        return nullcontext(lambda: None)

    with report_progress("clip", len(films), "films") as advance:
        for name, p in named_films:
            path, clip_folder, why_left_out = p.film, folder / FILMS / name, ""
            print(f"finloop: {name} is {path}", file=sys.stderr)
            try:
                source = open_clip_source(p)
                key = {"clip": asdict(p), "code": code, "film": read_file_stamps(path)}
                make = partial(_write_clip, p, source, watch=no_progress)
                digests.append(digest := key_digest(key))
                metrics = reuse_or_make(KEPT / digest, clip_folder, make)
                numbers |= {f"{name}_{metric}": value for metric, value in metrics.items()}
            except FinloopError as error:
                print(f"finloop: WARNING: {name} is left out: {error}", file=sys.stderr)
                why_left_out = error.came
            parts.append(JoinedFilm(name, str(path), error=why_left_out))
            advance()
    remove_folders_except(KEPT, digests)
    joined_facts = join_clips(folder, parts)
    failed = sum(bool(part.error) for part in parts)
    numbers |= _fact_metrics(joined_facts)
    first_readable = next(part for part in parts if not part.error)
    print(f"finloop: the animation uses the tank of {first_readable.name}", file=sys.stderr)
    return numbers | {"films": len(films) - failed, "films_left_out": failed}


def _fact_metrics(facts: VideoFacts) -> dict[str, float]:
    """Return the metrics that are facts of a clip: size, rate, duration, lost frames, segments."""
    return {name: getattr(facts, name) for name in FACTS} | {
        "duration_s": facts.frames / facts.frame_rate_hz,
        "segments": len(facts.segments),
    }


if __name__ == "__main__":
    run(main)
