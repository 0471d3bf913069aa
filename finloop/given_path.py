"""The paths that are asked for, from files or from the film itself, as lines.

The door from `animate.path` to files.
"""

from pathlib import Path

import pandas as pd

from finloop.animate.paths import track_line
from finloop.animate.settings import Settings
from finloop.base.errors import FinloopError
from finloop.base.line import TRACK, Line
from finloop.io.line import load_line


def given_lines(p: Settings, features: pd.DataFrame) -> list[Line | None]:
    """The line of each fish by `animate.path`, None where it has none.

    Times are left out where fish are to swim at their own pace. FinloopError if there are more
    lines than fish, and as of whatever reads them.
    """
    paths = p.path if isinstance(p.path, list) else [p.path]
    if len(paths) > p.fish:
        raise FinloopError(
            f"animate.path names {len(paths)} paths for {p.fish} fish",
            "a path a fish at most",
            f"take more fish (animate.fish={len(paths)}), or fewer paths",
        )
    return [None if path is None else _line(path, p, features) for path in paths]


def _line(path: str, p: Settings, features: pd.DataFrame) -> Line:
    if path.startswith(TRACK):
        line = track_line(features, path)
    else:
        line = load_line(Path(path).expanduser(), p.path_in)
    return line if p.path_times else line._replace(time_s=None)
