"""The pictures that an edit list draws from, opened where the stages left them."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pandas as pd

from finloop.animate_edit import FRAME, SPRITE
from finloop.errors import FinloopError
from finloop.features import orientations_of
from finloop.files.cutouts import open_cutouts
from finloop.render import Gallery, Shelf

_PLACE = ["x_px", "y_px"]


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
        centres = {FRAME: tracks}
        stores = {FRAME: stack.enter_context(open_cutouts(cutouts))}
        if table is not None:
            centres[SPRITE] = table.loc[table.index.repeat(orientations_of(table))]
            stores[SPRITE] = stack.enter_context(open_cutouts(sprites))
        for kind, store in stores.items():
            if len(store) != len(centres[kind]):
                raise FinloopError(
                    f"{len(store)} pictures of kind {kind}, but {len(centres[kind])} mass centres",
                    "a mass centre for every picture",
                    "make both again: `dvc repro --force extract sprites`",
                )
        yield Gallery(
            {kind: Shelf(store, centres[kind][_PLACE].to_numpy()) for kind, store in stores.items()}
        )
