"""Stage `clip`: normalise one film or several into the clip, with facts, arena and truth."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import pandas as pd

from finloop.base.errors import FinloopError
from finloop.clip.check import Quality, psnr_db
from finloop.clip.rewrite import Watch, make_clip
from finloop.clip.settings import ClipSettings, FootageSettings
from finloop.clip.verdict import REPAIRS, list_findings
from finloop.clip.write import ClipSource, open_clip_source
from finloop.io.atomic import whole_folder
from finloop.io.footage import list_films, read_file_stamps, refuse_changed_film, unique_film_names
from finloop.io.pieces import remove_folders_except
from finloop.io.several import FILMS, FilmPart, join_clips, list_film_folders
from finloop.io.table import save_csv
from finloop.io.video import CLIP_NAME, VideoFacts, read_chosen_frames
from stages.reuse import code_digest, key_digest, reuse_or_make
from stages.settings import load_settings

CLIP = Path("data/clip")
KEPT = Path("data/.clip.films")  # what was made of each film; DVC does not remove it
METRICS, FINDINGS = Path("reports/clip/metrics.json"), Path("data/clip/findings.csv")
FACTS = (  # among the metrics
    "frames", "width_px", "height_px", "frame_rate_hz", "frames_repeated", "frames_dropped",
    "frames_missing",
)  # fmt: skip


def main() -> None:
    """Make the normalised clip of the film; write data/clip/, and metrics to reports/clip/."""
    p: ClipSettings = load_settings("clip")
    films = drop_repeated_films(settings_of_films(p)) if isinstance(p, FootageSettings) else []
    with whole_folder(CLIP) as folder:
        if len(films) > 1:
            numbers = _write_clips(films, folder)
        else:
            remove_folders_except(KEPT, [])
            p = films[0] if films else p
            numbers = _write_clip(p, open_clip_source(p), folder, report_progress)
    save_metrics(METRICS, numbers)
    _report_findings(numbers)


def settings_of_films(p: FootageSettings) -> list[FootageSettings]:
    """Return the parameters of each film that a path, pattern, folder or list names, in order."""
    return [
        replace(of_path, path=str(film))
        for path, of_path in p.settings_by_path()
        for film in list_films(path)
    ]


def drop_repeated_films(films: list[FootageSettings]) -> list[FootageSettings]:
    """Return the films without those named twice with equal values; print a warning for each."""
    taken = dict[FootageSettings, FootageSettings]()
    for film in films:
        key = replace(film, path=str(film.film.resolve()))
        if key in taken:
            twice = "twice" if film.path == taken[key].path else f"twice as {taken[key].path}"
            print(f"finloop: WARNING: {film.path} is named {twice}, and used once", file=sys.stderr)
        taken.setdefault(key, film)
    return list(taken.values())


def _write_clip(
    p: ClipSettings, source: ClipSource, folder: Path, watch: Watch
) -> dict[str, float]:
    """Write one film's clip to `folder`; return its metrics.

    watch: reports progress. FinloopError if the film's file changes meanwhile.
    """
    for note in source.facts.notes:
        print(f"finloop: note: {note}", file=sys.stderr)
    before = read_file_stamps(p.film) if isinstance(p, FootageSettings) else []
    clip = make_clip(p, source, folder, watch)
    facts, tally = clip.facts, clip.tally
    for note in source.loss.notes:
        print(f"finloop: WARNING: {note}", file=sys.stderr)
    if isinstance(p, FootageSettings):
        refuse_changed_film(p.film, before)
    coded = read_chosen_frames(folder / CLIP_NAME, list(tally.samples), colour=facts.colour)
    return {
        **_fact_metrics(facts),
        **clip.metrics,
        "brightness_mean_level": tally.brightness_mean,
        "brightness_min_level": tally.darkest,
        "brightness_max_level": tally.brightest,
        "coding_psnr_db": psnr_db(zip(tally.samples.values(), coded, strict=True)),
        "arena_fraction": float(clip.arena.mean()),
    }


def _report_findings(metrics: dict[str, float]) -> None:
    """Write what is doubtful in the films to data/clip/findings.csv, and print it on stderr."""
    rows = []
    for name, _ in list_film_folders(CLIP):
        prefix = f"{name}_" if name else ""  # of several films
        repaired = {word for word in REPAIRS if metrics[f"{prefix}mended_{word}"]}
        now, filmed = (Quality.from_metrics(metrics, prefix + part) for part in ("", "filmed_"))
        for finding in list_findings(now, filmed, repaired):
            rows.append({"film": name} | finding.table_row if name else finding.table_row)
            print(f"finloop: {name + ': ' if name else ''}{finding.terminal_line}", file=sys.stderr)
    save_csv(FINDINGS, pd.DataFrame(rows), 0)


def _write_clips(films: list[FootageSettings], folder: Path) -> dict[str, float]:
    """Write the clips of several films, a folder each, and join them; return all metrics."""
    code, parts, used = code_digest("clip"), list[FilmPart](), list[str]()
    numbers: dict[str, float] = {}
    named_films = list(zip(unique_film_names(p.film for p in films), films, strict=True))
    with report_progress("clip", len(films), "films") as advance:
        for name, p in named_films:
            path, home = p.film, Path(FILMS) / name
            parts.append(FilmPart(name, str(path)))
            print(f"finloop: {name} is {path}", file=sys.stderr)
            try:
                source = open_clip_source(p)
                key = {"clip": asdict(p), "code": code, "film": read_file_stamps(path)}
                make = partial(_write_clip, p, source, watch=lambda *_: nullcontext(lambda: None))
                used.append(key_digest(key))
                of_film = reuse_or_make(KEPT / used[-1], folder / home, make)
                numbers |= {f"{name}_{key}": value for key, value in of_film.items()}
            except FinloopError as error:
                print(f"finloop: WARNING: {name} is left out: {error}", file=sys.stderr)
                parts[-1] = parts[-1]._replace(error=error.came)
            advance()
    remove_folders_except(KEPT, used)
    whole = join_clips(folder, parts)
    failed = sum(bool(part.error) for part in parts)
    tank = next(part for part in parts if not part.error)
    print(f"finloop: the animation uses the tank of {tank.name}", file=sys.stderr)
    return numbers | _fact_metrics(whole) | {"films": len(films) - failed, "films_left_out": failed}


def _fact_metrics(facts: VideoFacts) -> dict[str, float]:
    """Return the facts of a clip that are metrics: size, rate, duration, lost frames, segments."""
    return {name: getattr(facts, name) for name in FACTS} | {
        "duration_s": facts.frames / facts.frame_rate_hz,
        "segments": len(facts.segments),
    }


if __name__ == "__main__":
    run(main)
