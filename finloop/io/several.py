"""The folders of several films, and their clips as one: facts, arena, one count of frames.

Each film has its own folder `films/<name>/`, both in the clip's folder and in that of the tracks.
Beside these folders lies what later stages read, as if there were a single film.
"""

import shutil
from collections.abc import Sequence
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


class FilmPart(NamedTuple):
    """One of several films that a clip joins; path: of its file, name: of its folder below films/.

    start, stop: its frames in the count that runs on from film to film, `stop` excluded. error: why
    it is left out; "" if it is used.
    """

    name: str
    path: str
    start: int = 0  # its first frame
    stop: int = 0  # the first frame after it
    error: str = ""


def parts_of(clip: Path) -> list[FilmPart]:
    """Return the readable films that a clip joins; an empty list if it holds a single film.

    clip: the folder of the clip.
    """
    return [part for part in all_parts(clip) if not part.error]


def all_parts(clip: Path) -> list[FilmPart]:
    """Return all films that a clip joins, also those that could not be read; see `parts_of`."""
    return load_records(clip / PARTS_NAME, FilmPart, "clip") if (clip / PARTS_NAME).exists() else []


def film_folders(clip: Path) -> list[tuple[str, Path]]:
    """Return each readable film's name and relative folder, below that of the clip or the tracks.

    clip: the folder of the clip. A single film has the name "" and the path ".": it lies in those
    folders themselves.
    """
    return [(part.name, Path(FILMS) / part.name) for part in parts_of(clip)] or [("", Path())]


def join_clips(clip: Path, parts: Sequence[FilmPart]) -> VideoFacts:
    """Write facts.json, arena.png and films.json of several films as one clip; return its facts.

    clip: the folder that holds films/<name>/. parts: all films. The common rate is the lowest, so
    no frame is shown twice; a faster film is thinned. The count of frames continues from film to
    film. arena.png is that of the first film. FinloopError if no film could be read.
    """
    facts = {
        part.name: load_facts(clip / FILMS / part.name / FACTS_NAME)
        for part in parts
        if not part.error
    }
    if not facts:
        raise _no_films([(part.path, part.error) for part in parts])
    first = next(iter(facts))
    rate = min(fact.frame_rate for fact in facts.values())
    listed: list[FilmPart] = []
    segments: list[tuple[int, int]] = []
    start = 0
    for part in parts:
        if not part.error:
            own = facts[part.name]
            ticks = frames_at_rate(own.frames, own.frame_rate, rate)
            cuts = np.searchsorted(ticks, np.array(own.segments)) + start
            segments += [(int(a), int(b)) for a, b in cuts if a < b]
            part = part._replace(start=start, stop=start + len(ticks))
            start = part.stop
        listed.append(part)
    whole = replace(
        facts[first],
        frames=start,
        frame_rate=rate,
        colour=all(fact.colour for fact in facts.values()),
        segments=tuple(segments),
        **{name: sum(getattr(fact, name) for fact in facts.values()) for name in _COUNTS},
        notes=tuple(f"{name}: {note}" for name, fact in facts.items() for note in fact.notes),
    )
    save_facts(clip / FACTS_NAME, whole)
    shutil.copyfile(clip / FILMS / first / ARENA_NAME, clip / ARENA_NAME)
    save_records(clip / PARTS_NAME, listed)
    return whole


def frames_at_rate(frames: int, rate: Fraction, common: Fraction) -> Frames:
    """Return which of a film's frames each tick of a lower, common rate shows: (ticks,).

    frames: their number. rate, common: of the film and of the ticks, per second.
    """
    step = float(rate / common)
    if abs(step - 1) <= _SAME_RATE:
        return np.arange(frames)
    return np.rint(np.arange(int((frames - 1) / step) + 1) * step).astype(np.intp)


def _no_films(errors: Sequence[tuple[str, str]]) -> FinloopError:
    return FinloopError(
        "none of the films can be used:\n    "
        + "\n    ".join(": ".join(error) for error in errors),
        "at least one film that can be read",
        "correct clip.path, or repair the films",
    )
