"""The film itself as an edit list, so that it is drawn and measured like an animation."""

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import EDIT, FILM, FRAME, STATES


def as_filmed(source: Ints, places_px: Floats) -> pd.DataFrame:
    """Return an edit list (schema `EDIT`) that shows feature rows (n,), one a tick, as filmed.

    places_px (n, 2): x, y at which each is drawn.
    """
    empty = {"string": "", "bool": False}
    rest = {
        column.name: None if column.nullable else empty.get(column.dtype, 0)
        for column in EDIT.columns
    }
    own = {
        "tick": np.arange(len(source)),
        "kind": FRAME,
        "source": source,
        "scale": 1.0,
        "x_px": places_px[:, 0],
        "y_px": places_px[:, 1],
        "mode": "film",
        "state": STATES[FILM],
    }
    return pd.DataFrame(rest | own, index=np.arange(len(source)))
