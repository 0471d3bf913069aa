"""The pictures that an edit list draws from, opened where the stages left them."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pandas as pd

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.base.cutout import Cutouts
from finloop.errors import FinloopError
from finloop.features.table import orientations_of
from finloop.io.cutouts import open_cutouts
from finloop.render.painter import Gallery, Shelf

PLACE = ["x_px", "y_px"]


@contextmanager
def open_gallery(
    cutouts: Path, tracks: pd.DataFrame, sprites: Path, table: pd.DataFrame | None
) -> Iterator[Gallery]:
    """Open the film's cut-outs and, if a `table` of sprites is given, the sprites.

    Parameters
    ----------
    cutouts, sprites
        The two stores.
    tracks, table
        Their tables: x_px, y_px of every cut-out; the same and orientations of every sprite.

    Raises
    ------
    FinloopError
        If a store is missing or damaged, or its table belongs to another one.
    """
    with ExitStack() as stack:
        stores = {FRAME: stack.enter_context(open_cutouts(cutouts))}
        if table is not None:
            stores[SPRITE] = stack.enter_context(open_cutouts(sprites))
        yield Gallery(shelves(stores, tracks, table))


def shelves(
    stores: Mapping[str, Cutouts], tracks: pd.DataFrame, table: pd.DataFrame | None
) -> dict[str, Shelf]:
    """Open stores by kind, with the mass centres of their pictures; tables as for `open_gallery`.

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
