"""The pictures that an edit list draws from, opened where the stages left them."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from uuid import uuid4

from finloop.edit.schema import FRAME, SPRITE
from finloop.io.cutouts import open_cutouts
from finloop.render.gallery import Gallery, shelves
from stages.edit import DATA, Drawn, load_drawn


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


@dataclass(frozen=True)
class Pictures:
    """Opens the pictures of an edit list, also in another process, which loads the tables itself.

    Of a film of hours they are too large to be sent with every piece of work.
    """

    mode: str
    stage: str
    drawn: Drawn  # with sprites and postures
    run: str = field(default_factory=lambda: uuid4().hex)  # a worker may outlive it

    def __call__(self) -> AbstractContextManager[Gallery]:
        """The pictures, opened."""
        return open_gallery(self.drawn)

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self.mode, self.stage, self.run)


@lru_cache(1)
def _unpickled(mode: str, stage: str, run: str) -> Pictures:
    """The unpickled pictures in another process, made once a run."""
    return pictures_of(mode, stage)


def pictures_of(mode: str, stage: str) -> Pictures:
    """The pictures of a mode's edit list for a stage, with sprites and postures.

    FinloopError if a file is missing or damaged.
    """
    return Pictures(mode, stage, load_drawn(mode, stage, sprites=True, bodies=True))
