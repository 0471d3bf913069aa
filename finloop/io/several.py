"""The folders of several films, and their clips as one: facts, arena, one count of frames.

Each film has its own folder `films/<name>/`, both in the clip's folder and in that of the tracks.
Beside these folders lies what later stages read, as if there were a single film.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.io.record import load_records, save_records
from finloop.io.video import ARENA_NAME, FACTS_NAME, VideoFacts, load_facts, save_facts

FILMS, PARTS_NAME = "films", "films.json"
_SAME_RATE = 0.02  # films whose rates differ by less are taken frame by frame
_COUNTS = ("frames_repeated", "frames_dropped", "frames_missing")
Frames = NDArray[np.intp]


class JoinedFilm(NamedTuple):
    """One of several films that are joined to one clip, and its range of frames in the clip."""

    name: str  # of its folder below films/
    path: str  # of its file
    start: int = 0  # its first frame
    stop: int = 0  # the first frame after it
    error: str = ""  # why it is left out; "" if it is used


def load_readable_films(clip: Path) -> list[JoinedFilm]:
    """Return the films that the clip in folder `clip` joins, without those that could not be read.

    The list is empty for a clip of a single film.
    """
    return [part for part in load_joined_films(clip) if not part.error]


def load_joined_films(clip: Path) -> list[JoinedFilm]:
    """Return all films that were to be joined to the clip in folder `clip`, unreadable ones too."""
    return (
        load_records(clip / PARTS_NAME, JoinedFilm, "clip") if (clip / PARTS_NAME).exists() else []
    )


def list_film_folders(clip: Path) -> list[tuple[str, Path]]:
    """Return the name and the folder of each readable film of the clip in folder `clip`.

    Folders are relative, and the same below the folder of the clip and below that of the tracks. A
    single film has the name "" and the folder ".".
    """
    return [(part.name, Path(FILMS) / part.name) for part in load_readable_films(clip)] or [
        ("", Path())
    ]


def join_clips(clip: Path, parts: Sequence[JoinedFilm]) -> VideoFacts:
    """Join the clips of several films: write their common facts, arena and list of films.

    Return the facts of the joined clip. Its rate is the lowest of all: of a faster film some frames
    are left out. Its arena is that of the first film. clip: the folder that holds films/<name>/.
    parts: all films. FinloopError if no film could be read.
    """
    facts = {
        part.name: load_facts(clip / FILMS / part.name / FACTS_NAME)
        for part in parts
        if not part.error
    }
    if not facts:
        raise FinloopError(
            "none of the films can be used:\n    "
            + "\n    ".join(f"{part.path}: {part.error}" for part in parts),
            "at least one film that can be read",
            "correct clip.path, or repair the films",
        )
    first_name = next(iter(facts))
    rate = min(film.frame_rate for film in facts.values())
    placed_parts, segments = _assign_frame_ranges(parts, facts, rate)
    joined = replace(
        facts[first_name],
        frames=max(part.stop for part in placed_parts),
        frame_rate=rate,
        colour=all(film.colour for film in facts.values()),
        segments=tuple(segments),
        **{name: sum(getattr(film, name) for film in facts.values()) for name in _COUNTS},
        notes=tuple(f"{name}: {note}" for name, film in facts.items() for note in film.notes),
    )
    save_facts(clip / FACTS_NAME, joined)
    shutil.copyfile(clip / FILMS / first_name / ARENA_NAME, clip / ARENA_NAME)
    save_records(clip / PARTS_NAME, placed_parts)
    return joined


def _assign_frame_ranges(
    parts: Sequence[JoinedFilm], facts: Mapping[str, VideoFacts], rate: Fraction
) -> tuple[list[JoinedFilm], list[tuple[int, int]]]:
    """Give each film its frames, start to stop, in the joined clip; list the clip's uncut ranges.

    Return the films, and the ranges (start, stop). A film has one or more segments, ranges without
    a cut. Stops are not included. Films that could not be read get no range. facts: about each film
    that could be read, by its name. rate: frames per second of the joined clip.
    """
    placed_parts: list[JoinedFilm] = []
    segments: list[tuple[int, int]] = []
    frames = 0  # of the joined clip so far
    for part in parts:
        if not part.error:
            film = facts[part.name]
            shown = frames_at_rate(film.frames, film.frame_rate, rate)
            # A frame of the film becomes its place among the shown ones, counted on in the clip.
            placed = np.searchsorted(shown, np.array(film.segments)) + frames
            segments += [(int(first), int(stop)) for first, stop in placed if first < stop]
            part = part._replace(start=frames, stop=frames + len(shown))
            frames = part.stop
        placed_parts.append(part)
    return placed_parts, segments


def frames_at_rate(frames: int, rate: Fraction, lower_rate: Fraction) -> Frames:
    """Return the numbers of a film's frames that are shown when it plays at a lower rate.

    frames: how many the film has. rate, lower_rate: frames per second of the film, and of the
    result. Rates that differ by 2 % at most count as equal: all frames are shown.
    """
    step = float(rate / lower_rate)
    if abs(step - 1) <= _SAME_RATE:
        return np.arange(frames)
    shown = int((frames - 1) / step) + 1
    return np.rint(np.arange(shown) * step).astype(np.intp)
