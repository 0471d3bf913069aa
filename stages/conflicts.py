"""Find parameters that contradict each other or the files they name, before the first stage runs.

The schema checks each value alone. This checks values against each other, and against the files
that they name: a missing film, more leaders than fish, a film shorter than a track.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.settings import read_conf_values

Groups = Mapping[str, Mapping[str, Any]]


def find_conflicts(values: Groups) -> list[str]:
    """Return a sentence for each conflict of a parameter with another one or with a file.

    values: content of params.yaml, group → name → value, in which each value alone is right. A
    sentence begins with the parameter's name.
    """
    return [
        *_film_conflicts(values),
        *_missing_files(values),
        *_fish_conflicts(values["matching"]),
        *_mode_conflicts(values),
        *_goal_conflicts(values["animate"]),
    ]


def _film_conflicts(values: Groups) -> Iterator[str]:
    """Yield a sentence for each film that is missing, unreadable or too short for any track."""
    clip, shortest = values["clip"], values["extract"]["min_track_frames"]
    if clip.get("frames", shortest) < shortest:  # only a drawn film has this parameter
        yield _too_short_text("clip.frames", clip["frames"], shortest)
    if not clip.get("path"):
        return
    from finloop.io.footage import list_films

    entries = clip["path"] if isinstance(clip["path"], list) else [clip["path"]]
    for entry in entries:
        film_values = {"path": entry} if isinstance(entry, str) else entry
        try:
            for film in list_films(film_values["path"]):
                yield from _film_file_conflicts(film, {**clip, **film_values}, shortest)
        except FinloopError as error:
            yield f"clip.path: {error.came}; {error.do}"


def _film_file_conflicts(film: Path, clip: Mapping[str, Any], shortest: int) -> Iterator[str]:
    """Yield a sentence for each reason why a film cannot be used.

    Nothing is decoded. clip: the parameters of this film; the part from `start_s` to `end_s` is
    used. shortest: least number of its frames.
    """
    from finloop.io.footage.film import open_stream
    from finloop.io.footage.pictures import SUFFIXES

    rate = clip["frame_rate_hz"]
    if not film.exists():
        yield f"clip.path: there is nothing at {film.absolute()}"
        return
    if film.is_dir() or film.suffix.lower() in SUFFIXES:
        pictures = [path for path in film.glob("*") if path.suffix.lower() in SUFFIXES]
        frames = len(pictures)
        if frames and rate is None:
            yield (
                f"clip.frame_rate_hz: {film} does not state how fast it was shot; give it: "
                "clip.frame_rate_hz=25"
            )
    else:
        with open_stream(film) as (_, stream):
            frames, rate = stream.frames, rate or stream.average_rate
    if frames and rate:  # as the file states them, 0 = unknown; the stage `clip` counts frames
        end_s = frames / float(rate)
        if clip["start_s"] >= end_s:
            yield f"clip.start_s: {clip['start_s']:g} s, and {film} ends at {end_s:.4g} s"
            return
        frames = round((min(clip["end_s"] or end_s, end_s) - clip["start_s"]) * float(rate))
    if 0 < frames < shortest:
        yield _too_short_text(f"clip.path: {film}", frames, shortest)


def _too_short_text(what: str, frames: int, shortest: int) -> str:
    """Return the sentence that a film is too short for any track.

    what: the parameter that names the film, with which the sentence begins. frames: number of the
    film's frames. shortest: least number of frames of a track.
    """
    return (
        f"{what}: {frames} frames, and a track has at least {shortest}; take more film, "
        f"or type extract.min_track_frames={max(2, frames // 2)}"
    )


def _missing_files(values: Groups) -> Iterator[str]:
    """Yield a sentence for each file that a parameter names and that does not exist.

    Files that conf/ names by default are not checked: they are in the repository.
    """
    paths_by_parameter = {
        "clip.arena": values["clip"].get("arena"),
        "extract.tracks_path": values["extract"]["tracks_path"],
        "matching.path": values["matching"]["path"],
        "retarget.tracks": values["retarget"]["tracks"],
        "gait.regions": values["gait"]["regions"],
        "gait.walker_drawings": values["gait"]["walker_drawings"],
        "gait.swimmer_drawings": values["gait"]["swimmer_drawings"],
        "gait.swimmer_gait": values["gait"]["swimmer_gait"],
        "morph.first_drawing": values["morph"]["first_drawing"],
        "morph.last_drawing": values["morph"]["last_drawing"],
        "morph.pairs": values["morph"]["pairs"],
    }
    for name, paths in paths_by_parameter.items():
        group, key = name.split(".")
        if paths == read_conf_values(group, "default").get(key):
            continue
        for path in paths if isinstance(paths, list) else [paths]:
            # "track:8" is a track of the film; a pattern names a file for each of several films.
            if isinstance(path, str) and not re.search(r"^track:|[*{]", path):
                file = Path(path).expanduser()
                if not file.exists():
                    yield f"{name}: there is nothing at {file.absolute()}"


def _fish_conflicts(matching: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence if there are more paths than fish, or a pair [follower, leader] is wrong.

    matching: the parameters of mode `matching`.
    """
    fish, paths = matching["fish"], matching["path"]
    if isinstance(paths, list) and len(paths) > fish:
        yield f"matching.path: {len(paths)} paths for {fish} fish (matching.fish)"
    if matching["follow_pairs"]:
        from finloop.social.leader import leaders_by_follower

        try:
            leaders_by_follower(matching["follow_pairs"], fish)
        except FinloopError as error:
            yield f"matching.follow_pairs: {error.came}; matching.fish is {fish}"


def _mode_conflicts(values: Groups) -> Iterator[str]:
    """Yield a sentence for each stage that shows a retargeted track, if no track is named."""
    for stage in ("render", "tank", "export"):
        if values[stage]["mode"] == "retarget" and values["retarget"]["tracks"] is None:
            yield f"{stage}.mode: retarget shows retarget.tracks, which names none"


def _goal_conflicts(animate: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each goal that is wrong or outside the tank, and if there is none.

    animate: the parameters that all modes share.
    """
    if not animate["goals"]:
        yield "animate.goals: there are none; such as animate.goals=[[0.2,0.3],[0.8,0.7]]"
    for goal in animate["goals"]:
        if len(goal) != 2:
            yield f"animate.goals: {goal} is not [x, y]; such as animate.goals=[[0.2,0.3]]"
        elif animate["goal_unit"] == "tank" and not 0 <= min(goal) <= max(goal) <= 1:
            yield (
                f"animate.goals: {goal} is not in the tank, whose width and height are 1; for px, "
                "type animate.goal_unit=px"
            )
