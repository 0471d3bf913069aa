"""Load another program's tracks for a clip, and write them beside the tables of `extract`.

It connects `extract.given` to files; `extract.write` uses it where tracks are from a file.
"""

from dataclasses import replace
from glob import escape
from pathlib import Path

import numpy as np

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses
from finloop.extract import film
from finloop.extract.background import Scene
from finloop.extract.given import (
    ExternalTracks,
    FilmSize,
    SilhouetteFit,
    map_poses_to_clip,
    measure_silhouette_fit,
    refuse_other_film,
)
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import GIVEN, GIVEN_NAME, tracks_schema
from finloop.io.cutouts import TRACKS_NAME
from finloop.io.poses import load_poses
from finloop.io.table import load_table, save_table
from finloop.io.video import CLIP_NAME, FRAMES, FRAMES_NAME, VideoFacts, read_chosen_frames


def find_tracks_path(film: Path, pattern: str) -> str:
    """Return the path of one film's tracks, from a pattern for the tracks of several films.

    film: its path. pattern: a path in which {folder} and {name} stand for the film's folder
    and its name without ending, and `*`, `?`, `[…]` for unknown parts. FinloopError if it contains
    neither, or does not match exactly one path. Of DeepLabCut's tracks and their filtered twin,
    x.h5 and x_filtered.h5, the filtered ones are taken.
    """
    if "{name}" not in pattern and "{folder}" not in pattern:
        raise FinloopError(
            f"several films, and one file of tracks: {pattern}",
            "a file for each film",
            'name the film in extract.tracks_path: "{folder}/{name}*.h5"; or use a single film',
        )
    folder, name = escape(str(film.absolute().parent)), escape(film.stem)
    path = Path(pattern.replace("{folder}", folder).replace("{name}", name)).expanduser().absolute()
    paths = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    paths = [path for path in paths if path.with_stem(f"{path.stem}_filtered") not in paths]
    if len(paths) != 1:
        raise FinloopError(
            f"{len(paths)} tracks of {film} lie at {path}" + "".join(f"\n    {f}" for f in paths),
            "one file, or folder, of tracks for each film",
            "correct extract.tracks_path, so that it matches only that file",
        )
    return str(paths[0])


def load_external_tracks(clip: Path, facts: VideoFacts, p: ExtractSettings) -> ExternalTracks:
    """Return another program's tracks in `p.tracks_path`, sorted by frames of the clip.

    FinloopError if the tracks cannot be read, or do not fit the clip.
    """
    software = None if p.tracks_software == "auto" else p.tracks_software
    poses = load_poses(Path(p.tracks_path or "").expanduser(), software, facts.frame_rate_hz)
    poses = make_pixels_square(poses, facts)
    source_frames = load_table(clip / FRAMES_NAME, FRAMES)["source_frame"].to_numpy(np.int64)
    size = FilmSize(facts.source_frames, facts.width_px, facts.height_px)
    return map_poses_to_clip(poses, source_frames, size, p)


def make_pixels_square(poses: Poses, facts: VideoFacts) -> Poses:
    """Return poses in the clip's square px; in the film's file px may be oblong.

    facts: about the clip, which may be turned: then the file's pixels are as high as they were
    wide.
    """
    aspect = float(facts.pixel_aspect)
    wide, high = max(aspect, 1.0), max(1 / aspect, 1.0)
    scale = (high, wide) if facts.rotation_deg % 180 else (wide, high)
    return replace(poses, places=poses.places * scale)


def check_external_tracks(
    given: ExternalTracks, clip: Path, facts: VideoFacts, scene: Scene, detector: film.Detector
) -> SilhouetteFit:
    """Return how well tracks agree with silhouettes in sample frames of the clip.

    FinloopError if so few places agree that the tracks must be of another film.
    """
    tracked_frames = np.flatnonzero(given.stop > given.start)
    count = min(detector.settings.samples, len(tracked_frames))
    spread = np.linspace(0, len(tracked_frames) - 1, count)
    sample = tracked_frames[np.unique(spread.round().astype(int))].tolist()
    frames = read_chosen_frames(clip / CLIP_NAME, sample, colour=facts.colour)
    spots = [detector(frame, scene).spots for frame in frames]
    agreement = measure_silhouette_fit(given, sample, spots, detector.typical.length_px)
    refuse_other_film(given, agreement)
    return agreement


def save_external_tracks(folder: Path, given: ExternalTracks, points: int) -> None:
    """Write another program's animal, head and tail for each row of the table of tracks.

    folder: holds the table of tracks, and receives `GIVEN_NAME`. points: number of points of a
    backbone.
    """
    rows = load_table(folder / TRACKS_NAME, tracks_schema(points), ["track_id", "frame"])
    # `ExternalTrackLinker` numbers tracks: animal + run × number of animals.
    animal = rows["track_id"].to_numpy() % len(given.names)
    given_row = given.find_rows(rows["frame"].to_numpy(), animal)
    rows["animal"] = np.array(given.names, object)[animal]
    for name, place in (("head", given.head), ("tail", given.tail)):
        rows[f"{name}_x_px"], rows[f"{name}_y_px"] = place[given_row].T
    save_table(folder / GIVEN_NAME, rows, GIVEN)
