"""The path that is asked for, from a file or from the film itself, as a line.

The door from `animate.paths` to files.
"""

from pathlib import Path

import pandas as pd

from finloop.animate.paths import track_line
from finloop.animate.settings import Settings
from finloop.base.line import TRACK, Line
from finloop.io.line import load_line


def given_line(p: Settings, features: pd.DataFrame) -> Line | None:
    """The line of `animate.path`, None where there is none; FinloopError as of whatever reads it.

    Its times are left out where the fish is to swim at its own pace.
    """
    if p.path is None:
        return None
    if p.path.startswith(TRACK):
        line = track_line(features, p.path)
    else:
        line = load_line(Path(p.path).expanduser(), p.path_in)
    return line if p.path_times else line._replace(time_s=None)
