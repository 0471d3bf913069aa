"""Turn a track of the film into a path that fish can follow."""

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.line import PX, TRACK, Line, check_line


def track_as_path(features: pd.DataFrame, name: str, parameter: str = "matching.path") -> Line:
    """Return a track of the film as a path that other fish can follow, with times and headings.

    features: the feature table; name: of the track, such as `track:8`; parameter: name of the
    setting that gave it, for the message. The path is in px, s and degrees. FinloopError if there
    is no such track.
    """
    track_ids = features["track_id"]
    number = name.removeprefix(TRACK).strip()
    rows = np.flatnonzero(track_ids == int(number)) if number.isdecimal() else np.zeros(0, int)
    if not len(rows):
        longest = track_ids.value_counts().index[:8].tolist()
        raise FinloopError(
            f"{name} is no track of the film",
            f"one of its {track_ids.nunique()} tracks; the longest: {', '.join(map(str, longest))}",
            f"correct {parameter} (data/features/features.parquet has all tracks)",
        )
    columns = ("x_px", "y_px", "time_s", "heading_deg")
    x, y, time, heading = (features[column].to_numpy(float)[rows] for column in columns)
    return check_line(Line(name, x, y, PX, time, heading, rows=rows))
