"""The edit lists to compare: the modes' animations, and the film itself."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from finloop.base.stretches import sample_stretches
from finloop.edit.schema import by_fish, filmed_edit_list

Work = tuple[pd.DataFrame, Sequence[int]]
"""An edit list, and its ticks at which another fish begins."""


def animation_lists(samples: pd.DataFrame) -> list[Work]:
    """Divide the sample animations of a mode into one edit list per fish, none with a cut."""
    return [(one, ()) for one in by_fish(samples)]


def film_lists(tracks: pd.DataFrame, longest: int, most: int, seed: int) -> list[Work]:
    """Return stretches of the film as edit lists of about `longest` ticks, with their cuts.

    tracks: track_id, x_px, y_px of every row; most: rows in all lists together; seed: of the random
    choice of stretches.
    """
    places = tracks[["x_px", "y_px"]].to_numpy()
    works: list[Work] = []
    rows: list[np.ndarray] = []
    parts = sample_stretches(tracks["track_id"].to_numpy(), longest, most, seed)
    for part in parts:
        rows.append(np.arange(part.start, part.stop))
        if sum(map(len, rows)) >= longest or part is parts[-1]:
            every = np.concatenate(rows)
            cuts = np.cumsum([len(piece) for piece in rows])[:-1].tolist()
            works.append((filmed_edit_list(every, places[every]), cuts))
            rows = []
    return works
