"""The paths that are asked for, from files or from the film itself, as lines.

The door from `matching.path` to files.
"""

from pathlib import Path

import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.line import TRACK, Line
from finloop.features.line import track_line
from finloop.io.line import load_line
from finloop.plan.settings import MatchingSettings


def load_lines(p: MatchingSettings, features: pd.DataFrame) -> list[Line | None]:
    """Load the line of each fish from `matching.path`, None where it has none.

    Times are left out where fish are to swim at their own pace. FinloopError if there are more
    lines than fish, and as of whatever reads them.
    """
    paths = p.path if isinstance(p.path, list) else [p.path]
    if len(paths) > p.fish:
        raise FinloopError(
            f"matching.path names {len(paths)} paths for {p.fish} fish",
            "a path a fish at most",
            f"take more fish (matching.fish={len(paths)}), or fewer paths",
        )
    lines = [None if path is None else line_of(path, p.path_unit, features) for path in paths]
    if p.path_keep_times:
        return lines
    return [None if line is None else line._replace(time_s=None) for line in lines]


def line_of(path: str, unit: str, features: pd.DataFrame) -> Line:
    """The line that a text names: a track of the film (track:8), or a file.

    Places in a file are in `unit` unless its columns say more. FinloopError if there is none.
    """
    if path.startswith(TRACK):
        return track_line(features, path)
    return load_line(Path(path).expanduser(), unit)
