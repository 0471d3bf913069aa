"""Several films as one motion base: their fish of one size and in one light.

The first film gives the tank, the body length and the light; `io.several` defines the folders.
"""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.extract.alike import Likeness, levels, likeness, match_cutout, match_measures
from finloop.extract.table import GIVEN, GIVEN_NAME, SceneFacts, tracks_schema
from finloop.extract.write import BACKGROUND_NAME, SCENE_NAME
from finloop.io.cutouts import CUTOUTS_NAME, TRACKS_NAME, CutoutStore, CutoutWriter, open_cutouts
from finloop.io.record import load_record
from finloop.io.several import FILMS, FilmPart, frames_at_rate, readable_parts
from finloop.io.table import load_table, table_writer
from finloop.io.video import FACTS_NAME, VideoFacts, load_facts

_SAMPLE = 200  # cut-outs of a film from which its light is measured
Rows = NDArray[np.intp]


class Contribution(NamedTuple):
    """A film's part of the motion base: how many rows and tracks, and the scaling of its fish.

    like: makes its fish as long and as bright as those of the first film.
    """

    name: str
    rows: int
    tracks: int
    like: Likeness


class FilmTracks(NamedTuple):
    """The tracks of one of several films.

    table: its rows at the common rate; rows (k,): their numbers in the film's own table and
    cut-outs; home: its folder.
    """

    part: FilmPart
    facts: VideoFacts
    scene: SceneFacts
    table: pd.DataFrame
    rows: Rows
    home: Path


def join_extractions(clip: Path, folder: Path, errors: dict[str, str]) -> list[Contribution]:
    """Write the joint tracks, cut-outs, scene and background of several films; return their parts.

    clip, folder: what `clip` and `extract` have written, a folder a film in `films`; the joint
    files lie in `folder` itself, with tracks of another program. A film whose tracks are all
    shorter than a frame of the common rate adds none.

    errors: by name of each film without tracks, the reason. FinloopError if the first film is among
    them: the animation is shown in its tank.
    """
    parts, whole = readable_parts(clip), load_facts(clip / FACTS_NAME)
    if parts[0].name in errors:
        raise FinloopError(
            f"{parts[0].path}, the first film, cannot be followed: {errors[parts[0].name]}",
            "a first film in which fish can be followed: the animation is shown in its tank",
            "put another film first, or correct this one's parameters",
        )
    first = folder / FILMS / parts[0].name
    for name in (SCENE_NAME, BACKGROUND_NAME):
        shutil.copyfile(first / name, folder / name)
    scene = load_record(folder / SCENE_NAME, SceneFacts, "extract")
    contributions: list[Contribution] = []
    light = None
    with ExitStack() as stack:
        write = stack.enter_context(table_writer(folder / TRACKS_NAME, tracks_schema(scene.points)))
        write_given = None
        if (first / GIVEN_NAME).exists():
            write_given = stack.enter_context(table_writer(folder / GIVEN_NAME, GIVEN))
        cutouts = stack.enter_context(CutoutWriter(folder / CUTOUTS_NAME))
        for part in parts:
            if part.name in errors:
                continue
            film = _load(part, clip, folder, whole)
            if not len(film.rows):
                contributions.append(Contribution(part.name, 0, 0, Likeness()))
                continue
            grey = film.facts.colour and not whole.colour
            with open_cutouts(film.home / CUTOUTS_NAME) as store:
                film_levels = levels(_sample_cutouts(store, film.rows), grey)
                light = film_levels if light is None else light
                length = film.scene.typical_length_px
                like = likeness(length, scene.typical_length_px, film_levels, light, grey)
                table = _number_tracks(film, like, sum(earlier.tracks for earlier in contributions))
                write(table)
                if write_given:
                    write_given(_external_rows(film, table, like))
                _copy(cutouts, store, film.rows, table, like)
            tracks = table["track_id"].nunique()
            contributions.append(Contribution(part.name, len(film.rows), tracks, like))
    return contributions


def _number_tracks(film: FilmTracks, like: Likeness, tracks: int) -> pd.DataFrame:
    """Scale a film's tracks to the first film's fish, and number them after `tracks` others."""
    table = match_measures(film.table, like)
    number = np.unique(table["track_id"], return_inverse=True)[1]
    return table.assign(track_id=(number + tracks).astype("int32"))


def _external_rows(film: FilmTracks, table: pd.DataFrame, like: Likeness) -> pd.DataFrame:
    """Return the rows of another program's tracks of a film, in the order of the common table.

    An animal's name begins with that of its film, for every film has an animal number 1.
    """
    rows = load_table(film.home / GIVEN_NAME, GIVEN).iloc[film.rows]
    rows = match_measures(rows.reset_index(drop=True), Likeness(like.scale))
    names = film.part.name + "-" + rows["animal"].astype(str)
    return rows.assign(track_id=table["track_id"], frame=table["frame"], animal=names)


def _load(part: FilmPart, clip: Path, folder: Path, whole: VideoFacts) -> FilmTracks:
    home = folder / FILMS / part.name
    scene = load_record(home / SCENE_NAME, SceneFacts, "extract")
    facts = load_facts(clip / FILMS / part.name / FACTS_NAME)
    table = load_table(home / TRACKS_NAME, tracks_schema(scene.points))
    frames = frames_at_rate(facts.frames, facts.frame_rate, whole.frame_rate)
    rows = np.flatnonzero(np.isin(table["frame"], frames))
    table = table.iloc[rows].reset_index(drop=True)
    at = part.start + np.searchsorted(frames, table["frame"])
    return FilmTracks(part, facts, scene, table.assign(frame=at.astype("int32")), rows, home)


def _sample_cutouts(store: CutoutStore, rows: Rows) -> Iterator[Cutout]:
    for row in np.unique(np.linspace(0, len(rows) - 1, _SAMPLE).astype(int)):
        yield store[int(rows[row])]


def _copy(
    writer: CutoutWriter, store: CutoutStore, rows: Rows, table: pd.DataFrame, like: Likeness
) -> None:
    """Write the cut-outs of these rows under the keys of the table."""
    keys = table[["track_id", "frame"]].to_numpy()
    if like.none:
        writer.copy(store, rows, keys)
        return
    for row, (track_id, frame) in zip(rows.tolist(), keys.tolist(), strict=True):
        writer.write(match_cutout(store[row], like)._replace(track_id=track_id, frame=frame))
