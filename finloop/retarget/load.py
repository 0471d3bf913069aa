"""Load the track to retarget: from a file, from another film, or from this film itself.

Only this module of `retarget` reads files.
"""

from pathlib import Path

import numpy as np

from finloop.base.errors import FinloopError
from finloop.base.line import TRACK
from finloop.base.schema import lists_to_points
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.head import turn_head_first
from finloop.features.line import track_as_path
from finloop.features.table import FEATURES
from finloop.io.poses import load_poses
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.retarget.film import RetargetData, track_from_film_rows
from finloop.retarget.settings import RetargetSettings
from finloop.retarget.track import Track, choose_animal, track_from_backbones, track_from_poses

_SCENE, _TRACKS = "extract/scene.json", "extract/tracks.parquet"
_FEATURES, _FACTS = "features/features.parquet", f"clip/{FACTS_NAME}"
_LINES = ("track_id", "frame", "backbone_x_px", "backbone_y_px")


def load_track(film: RetargetData, p: RetargetSettings) -> Track:
    """Return the track that the parameter `retarget.tracks` names.

    film: the film whose frames are drawn. FinloopError if the track cannot be read.
    """
    assert p.tracks is not None
    steps = film.poses.pose.posture.shape[1] // 2 - 1  # a posture of n steps is 2 + 2 n numbers
    if p.tracks.startswith(TRACK):
        rows = track_as_path(film.reel.features, p.tracks, "retarget.tracks").rows
        assert rows is not None
        return track_from_film_rows(film, rows, p.tracks)
    path = Path(p.tracks).expanduser()
    folder = film_data_folder(path)
    if folder is not None:
        return _load_film_track(folder, steps, p)
    rate = p.tracks_rate_hz or film.rate_hz
    return track_from_poses(load_poses(path, None, rate, "retarget.tracks"), rate, steps, p)


def film_data_folder(path: Path) -> Path | None:
    """Return the folder data/ of another film; None if a path is not that of a film.

    path: the folder data/, or the folder extract/ in it.
    """
    folder = path.parent if path.name == "extract" else path
    return folder if (folder / _TRACKS).exists() else None


def film_track_files(folder: Path) -> list[Path]:
    """Return the four files of a film's folder data/ from which a track is read."""
    return [folder / name for name in (_SCENE, _TRACKS, _FEATURES, _FACTS)]


def _load_film_track(folder: Path, steps: int, p: RetargetSettings) -> Track:
    """Return a track of another film, read from its folder data/.

    steps: number of segments of a backbone in the film that is to be drawn. FinloopError if the
    other film's tables do not match, or the track is missing.
    """
    scene = load_record(folder / _SCENE, SceneFacts, "extract")
    features = load_table(folder / _FEATURES, FEATURES)
    rate = p.tracks_rate_hz or load_facts(folder / _FACTS).frame_rate_hz
    tracks = load_table(folder / _TRACKS, tracks_schema(scene.points), _LINES)
    if len(tracks) != len(features):
        raise FinloopError(
            f"{folder} holds {len(tracks)} rows of tracks, and {len(features)} of features",
            "two tables of one film with equally many rows",
            "make the tables of that film again: `dvc repro features`",
        )
    counts = features["track_id"].value_counts().sort_index()
    names = [str(track_id) for track_id in counts.index]
    number = choose_animal(p.animal, names, counts.to_numpy())
    rows = np.flatnonzero((features["track_id"] == counts.index[number]).to_numpy())
    backbones = turn_head_first(
        lists_to_points(tracks.iloc[rows], "backbone").astype(float), features.iloc[rows]
    )
    frame = features["frame"].to_numpy(np.int64)[rows]
    name = f"track {features['track_id'].iloc[rows[0]]} of {folder}"
    return track_from_backbones(name, rate, frame, backbones, steps)
