"""The pictures that an edit list draws from, opened where the stages left them."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.io.cutouts import open_cutouts
from finloop.render.gallery import Gallery, shelves
from stages.edit import DATA, Drawn


@contextmanager
def open_gallery(drawn: Drawn) -> Iterator[Gallery]:
    """Open the film's cut-outs and, if there is a table of sprites, the sprites.

    FinloopError if a store is missing or damaged, or its table belongs to another one.
    """
    with ExitStack() as stack:
        stores = {FRAME: stack.enter_context(open_cutouts(DATA / "extract/cutouts.arrow"))}
        if drawn.sprites is not None:
            store = stack.enter_context(open_cutouts(DATA / "sprites/sprites.arrow"))
            stores[SPRITE] = store
        yield Gallery(shelves(stores, drawn.tracks, drawn.sprites), drawn.bodies)
