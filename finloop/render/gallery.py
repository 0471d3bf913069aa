"""Stores of pictures beside the mass centres of what they show: what an edit list is drawn from."""

from collections.abc import Mapping

import pandas as pd

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.base.cutout import Cutouts
from finloop.errors import FinloopError
from finloop.features.table import orientations_of
from finloop.render.painter import Shelf

PLACE = ["x_px", "y_px"]


def shelves(
    stores: Mapping[str, Cutouts], tracks: pd.DataFrame, table: pd.DataFrame | None
) -> dict[str, Shelf]:
    """Open stores by kind, FRAME or SPRITE, with the mass centres of their pictures.

    tracks, table: x_px, y_px of every cut-out; the same and orientations of every sprite.

    Raises
    ------
    FinloopError
        If a table belongs to another store.
    """
    centres = {FRAME: tracks}
    if table is not None:
        centres[SPRITE] = table.loc[table.index.repeat(orientations_of(table))]
    for kind, store in stores.items():
        if len(store) != len(centres[kind]):
            raise FinloopError(
                f"{len(store)} pictures of kind {kind}, but {len(centres[kind])} mass centres",
                "a mass centre for every picture",
                "make both again: `dvc repro --force extract sprites`",
            )
    return {kind: Shelf(store, centres[kind][PLACE].to_numpy()) for kind, store in stores.items()}
