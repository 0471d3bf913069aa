"""Join several films, so that their fish have one size and one light.

The first film gives the tank, the body length and the light; `io.several` defines the folders.
Cut-outs are (h, w, channels) uint8, colour premultiplied by alpha, the last channel.
"""

import shutil
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.extract.table import GIVEN, GIVEN_NAME, SceneFacts, tracks_schema
from finloop.extract.write import BACKGROUND_NAME, SCENE_NAME
from finloop.io.cutouts import CUTOUTS_NAME, TRACKS_NAME, CutoutStore, CutoutWriter, open_cutouts
from finloop.io.record import load_record
from finloop.io.several import FILMS, JoinedFilm, frames_at_rate, load_readable_films
from finloop.io.table import load_table, table_writer
from finloop.io.video import FACTS_NAME, VideoFacts, load_facts

_SAMPLE = 200  # cut-outs of a film from which its light is measured
_OPAQUE = 250  # least alpha of a pixel that shows only the fish
# Smaller differences are ignored, because every resampling blurs: tracks of one zebrafish film
# differ by up to 8 % from its typical length, and its light drifts by 2 %, the carp's by 3 %.
_SAME_LENGTH, _SAME_LIGHT = 0.1, 0.05
_MOST_LIGHT = 3.0  # a larger gain would show noise instead of a fish
Rows = NDArray[np.intp]


class FishScaling(NamedTuple):
    """How a film's fish are changed in size, light and colour to match the first film's."""

    scale: float = 1.0  # factor on lengths
    gains: tuple[float, ...] = ()  # factor on each channel's light; none: as filmed
    grey: bool = False  # whether colours are dropped


class FilmContribution(NamedTuple):
    """How many rows and tracks one of several films adds, and how its fish are scaled."""

    name: str
    rows: int
    tracks: int
    like: FishScaling


class _FilmTracks(NamedTuple):
    """The tracks of one of several films.

    table: its rows at the common rate, with the joint clip's frame numbers; rows (k,): their
    numbers in the film's own table and cut-outs; home: its folder.
    """

    part: JoinedFilm
    facts: VideoFacts
    scene: SceneFacts
    table: pd.DataFrame
    rows: Rows
    home: Path


class _JointFiles(NamedTuple):
    """Writers of the joint files of all films: tracks, external tracks, cut-outs."""

    write_tracks: Callable[[pd.DataFrame], None]
    write_external: Callable[[pd.DataFrame], None] | None  # None without such tracks
    cutouts: CutoutWriter


def join_extractions(clip: Path, folder: Path, errors: dict[str, str]) -> list[FilmContribution]:
    """Join tracks and cut-outs of several films to one; return what each film adds.

    clip, folder: what `clip` and `extract` have written, with a folder for each film in `films`;
    the joint files are written to `folder` itself. A film whose tracks are all shorter than a frame
    of the common rate adds none.

    errors: by name of each film without tracks, the reason. FinloopError if the first film is among
    them: the animation is shown in its tank.
    """
    parts, joint = load_readable_films(clip), load_facts(clip / FACTS_NAME)
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
    contributions: list[FilmContribution] = []
    first_levels = None  # median grey levels of the first film's fish
    with ExitStack() as stack:
        write = stack.enter_context(table_writer(folder / TRACKS_NAME, tracks_schema(scene.points)))
        write_external = None
        if (first / GIVEN_NAME).exists():
            write_external = stack.enter_context(table_writer(folder / GIVEN_NAME, GIVEN))
        cutouts = stack.enter_context(CutoutWriter(folder / CUTOUTS_NAME))
        files = _JointFiles(write, write_external, cutouts)
        for part in (part for part in parts if part.name not in errors):
            film = _load_film_tracks(part, clip, folder, joint)
            scaling, tracks = FishScaling(), 0
            if len(film.rows):
                drop_colour = film.facts.colour and not joint.colour
                levels = _median_levels(film, drop_colour)
                first_levels = levels if first_levels is None else first_levels
                scaling = find_fish_scaling(
                    film.scene.typical_length_px, scene.typical_length_px, levels, first_levels,
                    drop_colour,
                )  # fmt: skip
                first_track = sum(earlier.tracks for earlier in contributions)
                tracks = _append_film(film, files, scaling, first_track)
            contributions.append(FilmContribution(part.name, len(film.rows), tracks, scaling))
    return contributions


def _append_film(
    film: _FilmTracks, files: _JointFiles, scaling: FishScaling, first_track: int
) -> int:
    """Append one film's scaled rows to the joint files; return how many tracks it adds.

    first_track: the number of its first track in the joint table.
    """
    table = _renumber_tracks(_scale_measures(film.table, scaling), first_track)
    files.write_tracks(table)
    if files.write_external:
        files.write_external(_joint_external_rows(film, table, scaling.scale))
    with open_cutouts(film.home / CUTOUTS_NAME) as store:
        _copy_cutouts(files.cutouts, store, film.rows, table, scaling)
    return table["track_id"].nunique()


def _renumber_tracks(table: pd.DataFrame, first_track: int) -> pd.DataFrame:
    """Return a table whose tracks have successive numbers from `first_track` on."""
    track = np.unique(table["track_id"], return_inverse=True)[1] + first_track
    return table.assign(track_id=track.astype("int32"))


def _joint_external_rows(film: _FilmTracks, table: pd.DataFrame, scale: float) -> pd.DataFrame:
    """Return a film's rows of external tracks that belong to its rows in the joint table.

    External tracks are those of another tracking program. table: the film's rows in the joint
    table, whose tracks and frames they get. scale: factor on lengths. Animals get the film's name
    in front, because each film may have an animal "1".
    """
    rows = load_table(film.home / GIVEN_NAME, GIVEN).iloc[film.rows]
    rows = _scale_measures(rows.reset_index(drop=True), FishScaling(scale))
    animal = film.part.name + "-" + rows["animal"].astype(str)
    return rows.assign(**table[["track_id", "frame"]], animal=animal)


def _load_film_tracks(part: JoinedFilm, clip: Path, folder: Path, whole: VideoFacts) -> _FilmTracks:
    """Load those rows of one film's tracks whose frames remain at the common frame rate.

    clip, folder: those of all films together; whole: facts about the joint clip, whose frame
    numbers the rows get.
    """
    home = folder / FILMS / part.name
    scene = load_record(home / SCENE_NAME, SceneFacts, "extract")
    facts = load_facts(clip / FILMS / part.name / FACTS_NAME)
    table = load_table(home / TRACKS_NAME, tracks_schema(scene.points))
    frames = frames_at_rate(facts.frames, facts.frame_rate, whole.frame_rate)
    rows = np.flatnonzero(np.isin(table["frame"], frames))
    table = table.iloc[rows].reset_index(drop=True)
    joint_frame = part.start + np.searchsorted(frames, table["frame"])
    return _FilmTracks(
        part, facts, scene, table.assign(frame=joint_frame.astype("int32")), rows, home
    )


def _copy_cutouts(
    writer: CutoutWriter, store: CutoutStore, rows: Rows, table: pd.DataFrame, scaling: FishScaling
) -> None:
    """Write scaled cut-outs of some rows of a film to the joint store.

    store: the film's cut-outs; rows (k,): their numbers in it; table: the same rows of the joint
    table, with their new tracks and frames.
    """
    keys = table[["track_id", "frame"]].to_numpy()
    if scaling == FishScaling():
        writer.copy_cutouts(store, rows, keys)
        return
    for row, (track_id, frame) in zip(rows.tolist(), keys.tolist(), strict=True):
        writer.write(match_cutout(store[row], scaling)._replace(track_id=track_id, frame=frame))


def _median_levels(film: _FilmTracks, drop_colour: bool) -> Floats:
    """Return the median levels (channels,), 0 … 255, of the fish in a film's cut-outs.

    They are measured in a sample of its rows. drop_colour: whether RGB counts as grey.
    """
    opaque = []
    with open_cutouts(film.home / CUTOUTS_NAME) as store:
        for row in spread_rows(film.rows, _SAMPLE).tolist():
            pixels = store[row].pixels
            pixels = _drop_colour(pixels) if drop_colour else pixels
            opaque.append(pixels[pixels[..., -1] >= _OPAQUE][:, :-1])
    return np.median(np.concatenate(opaque), axis=0)


def find_fish_scaling(
    length_px: float, first_length_px: float, light: Floats, first_light: Floats, drop_colour: bool
) -> FishScaling:
    """Return the scaling of size, light and colour that makes a film's fish match the first film's.

    Its scale multiplies lengths, its gains (none: as filmed) the levels of each channel. length_px,
    first_length_px: typical body lengths; light, first_light (channels,): median levels, 0 … 255;
    drop_colour: whether colours are dropped. Differences that also occur within one film
    are ignored: 10 % of length, 5 % of light. Light is changed threefold at most.
    """
    scale = first_length_px / length_px
    if abs(scale - 1) <= _SAME_LENGTH:
        scale = 1.0
    gains = np.clip(first_light / np.maximum(light, 1.0), 1 / _MOST_LIGHT, _MOST_LIGHT)
    same = bool((np.abs(gains - 1) <= _SAME_LIGHT).all())
    return FishScaling(scale, () if same else tuple(gains.tolist()), drop_colour)


def _drop_colour(pixels: Picture) -> Picture:
    """Return a cut-out's RGB and alpha (h, w, 4) as grey and alpha (h, w, 2), uint8."""
    mono = cv2.cvtColor(np.ascontiguousarray(pixels[..., :-1]), cv2.COLOR_RGB2GRAY)
    return np.dstack([mono, pixels[..., -1]])


def match_cutout(cutout: Cutout, scaling: FishScaling) -> Cutout:
    """Return a film's cut-out scaled to the first film's size and light, with its position."""
    pixels = _drop_colour(cutout.pixels) if scaling.grey else cutout.pixels
    if scaling.gains:
        colours = pixels[..., :-1] * np.array(scaling.gains)
        colours = np.minimum(np.rint(colours), pixels[..., -1:]).astype(np.uint8)
        pixels = np.concatenate([colours, pixels[..., -1:]], axis=-1)
    if scaling.scale == 1.0:
        return cutout._replace(pixels=pixels)
    return _resize_cutout(cutout._replace(pixels=pixels), scaling.scale)


def _resize_cutout(cutout: Cutout, scale: float) -> Cutout:
    """Return a cut-out drawn `scale` times as large, with its position."""
    pixels = cutout.pixels
    # The first column and row of the result, and its last; a pixel reaches half a px to both sides.
    corner = np.array([cutout.x0_px, cutout.y0_px]) - 0.5
    x0, y0 = np.floor(scale * corner).astype(int).tolist()
    x1, y1 = np.ceil(scale * (corner + pixels.shape[1::-1])).astype(int).tolist()
    if scale < 1:  # avoids aliasing: a blur of 0.4 px becomes one of 0.4 px of the smaller picture
        blur = 0.4 * float(np.sqrt(scale**-2 - 1))
        pixels = cv2.GaussianBlur(pixels, (0, 0), blur, borderType=cv2.BORDER_CONSTANT)
    to_cutout = np.array([
        [1 / scale, 0, x0 / scale - cutout.x0_px], [0, 1 / scale, y0 / scale - cutout.y0_px],
    ])  # fmt: skip
    interpolation = cv2.INTER_LINEAR if scale < 1 else cv2.INTER_CUBIC
    drawn = cv2.warpAffine(
        pixels, to_cutout, (x1 + 1 - x0, y1 + 1 - y0), flags=interpolation | cv2.WARP_INVERSE_MAP
    )
    drawn = np.minimum(drawn, drawn[..., -1:])  # a colour never exceeds its alpha
    return cutout._replace(x0_px=x0, y0_px=y0, pixels=drawn)


def _scale_measures(tracks: pd.DataFrame, scaling: FishScaling) -> pd.DataFrame:
    """Return a table of tracks with positions, sizes and contrasts scaled to the first film."""
    if scaling == FishScaling():
        return tracks
    scaled = tracks.copy()
    for name in tracks.columns[tracks.columns.str.endswith("_px")]:
        factor = scaling.scale ** (2 if name == "area_px" else 1)
        scaled[name] = [value * factor for value in tracks[name]]  # a cell may be an array
    if scaling.gains:
        scaled["contrast"] = tracks["contrast"] * np.float32(np.mean(scaling.gains))
    return scaled
