"""The pictures that an edit list draws from, opened where the stages left them."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pandas as pd

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.io.cutouts import open_cutouts
from finloop.render.gallery import Gallery, shelves


@contextmanager
def open_gallery(
    cutouts: Path, tracks: pd.DataFrame, sprites: Path, table: pd.DataFrame | None
) -> Iterator[Gallery]:
    """Open the film's cut-outs and, if a `table` of sprites is given, the sprites.

    FinloopError if a store is missing or damaged, or its table belongs to another one.

    cutouts, sprites: the two stores.
    tracks, table: their tables: x_px, y_px of every cut-out; the same and orientations of every
        sprite.
    """
    with ExitStack() as stack:
        stores = {FRAME: stack.enter_context(open_cutouts(cutouts))}
        if table is not None:
            stores[SPRITE] = stack.enter_context(open_cutouts(sprites))
        yield Gallery(shelves(stores, tracks, table))
