"""The paths requested by `matching.path`, from files or from the film itself, as lines."""

from pathlib import Path

import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.line import TRACK, Line
from finloop.features.line import track_as_path
from finloop.io.line import load_line
from finloop.plan.matching_settings import MatchingSettings


def load_path_lines(p: MatchingSettings, features: pd.DataFrame) -> list[Line | None]:
    """Return the line of each entry of `matching.path`, None for an entry without a path.

    features: the film's feature table. Times are left out unless `matching.path_keep_times`.
    FinloopError if there are more lines than fish, or if a line cannot be read.
    """
    paths = p.path if isinstance(p.path, list) else [p.path]
    if len(paths) > p.fish:
        raise FinloopError(
            f"matching.path names {len(paths)} paths for {p.fish} fish",
            "at most one path for each fish",
            f"take more fish (matching.fish={len(paths)}), or fewer paths",
        )
    lines = [
        None if path is None else load_track_or_file(path, p.path_unit, features) for path in paths
    ]
    if p.path_keep_times:
        return lines
    return [None if line is None else line._replace(time_s=None) for line in lines]


def load_track_or_file(path: str, unit: str, features: pd.DataFrame) -> Line:
    """Return the line that a path names: a track of the film (`track:8`), or a file.

    unit: of places in a file, unless its columns say more; features: the film's feature table.
    FinloopError if there is no such track or file.
    """
    if path.startswith(TRACK):
        return track_as_path(features, path)
    return load_line(Path(path).expanduser(), unit)
