"""The pictures that an edit list names, and what its rows want drawn."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.base.cutout import Cutouts
from finloop.base.errors import FinloopError
from finloop.features.table import orientations_of
from finloop.reel import sprite_row
from finloop.render.painter import Picture, Placed, Turned, picture

PLACE = ["x_px", "y_px"]


class Shelf(NamedTuple):
    """Cut-outs of the n frames, or of the n sprites in so many orientations.

    centres_px (n, 2): their mass centres in the film.
    """

    store: Cutouts
    centres_px: NDArray[np.float64]
    orientations: int = 1


class Gallery:
    """Pictures as an edit list names them, the most recent `keep` of them held."""

    def __init__(self, shelves: Mapping[str, Shelf], keep: int = 512) -> None:
        self.shelves = shelves
        self.picture = lru_cache(keep)(self._picture)

    def _picture(self, kind: str, source: int, orientation: int) -> Picture:
        shelf = self.shelves[kind]
        cutout = shelf.store[sprite_row(source, orientation, shelf.orientations)]
        x, y = shelf.centres_px[source]
        return picture(cutout.pixels, x - cutout.x0_px, y - cutout.y0_px)

    def frame(self, row: int) -> Picture:
        """The picture of a row of the film."""
        return self.picture(FRAME, row, 1)

    def turned(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float
    ) -> Turned:
        """A sprite in an orientation, or a frame (its orientation does not count), turned."""
        one = self.frame(source) if kind == FRAME else self.picture(kind, source, int(orientation))
        return Turned(one, rotation_deg, scale)


def shelves(
    stores: Mapping[str, Cutouts], tracks: pd.DataFrame, table: pd.DataFrame | None
) -> dict[str, Shelf]:
    """Open stores by kind, FRAME or SPRITE, with the mass centres of their pictures.

    tracks, table: x_px, y_px of every cut-out; the same and orientations of every sprite.
    FinloopError if a table belongs to another store.
    """
    made = {FRAME: Shelf(stores[FRAME], tracks[PLACE].to_numpy())}
    if table is not None:
        made[SPRITE] = Shelf(stores[SPRITE], table[PLACE].to_numpy(), orientations_of(table))
    for kind, (store, centres, orientations) in made.items():
        if len(store) != len(centres) * orientations:
            raise FinloopError(
                f"{len(store)} pictures of kind {kind}, but {len(centres)} mass centres",
                "a mass centre for every frame and sprite",
                "make both again: `dvc repro --force extract sprites`",
            )
    return made


def placed(edit: pd.DataFrame, gallery: Gallery) -> Iterator[Placed]:
    """Row by row what an edit list (schema EDIT) wants drawn.

    FinloopError at once, listing all that cannot be drawn.
    """
    _refuse(edit, gallery.shelves)

    def given() -> Iterator[Placed]:
        own = ("kind", "source", "orientation", "rotation_deg", "scale")
        other = [f"partner_{name}".removesuffix("_source") for name in own]
        columns = (edit[list(names)].itertuples(index=False) for names in (own, other))
        where = edit[["x_px", "y_px", "weight"]].itertuples(index=False)
        for fish, partner, (x, y, weight) in zip(*columns, where, strict=True):
            second = gallery.turned(*partner) if weight > 0 else None
            yield Placed(x, y, gallery.turned(*fish), second, weight)

    return given()


def _refuse(edit: pd.DataFrame, shelves: Mapping[str, Shelf]) -> None:
    """Raise if an edit list cannot be drawn: every kind of problem, each with its first tick."""
    do = "make the edit list again: `dvc repro --force animate`"
    if edit.empty:
        raise FinloopError("the edit list is empty", "at least one tick", do)
    problems: list[str] = []

    def refuse(bad: NDArray[np.bool_] | pd.Series, column: str, wanted: str) -> None:
        wrong = edit[np.asarray(bad, bool)]
        if len(wrong):
            tick, value = wrong.iloc[0]["tick"], wrong.iloc[0][column]
            more = f" (and at {len(wrong) - 1} more ticks)" if len(wrong) > 1 else ""
            problems.append(f"tick {tick}: {column} is {value}, wanted {wanted}{more}")

    sizes = {kind: len(shelf.centres_px) for kind, shelf in shelves.items()}
    refuse(edit["tick"] != np.arange(len(edit)), "tick", "0, 1, 2, …")
    for column in ("x_px", "y_px"):
        refuse(~np.isfinite(edit[column].to_numpy(float)), column, "a place")
    refuse(~edit["weight"].between(0, 1), "weight", "0 … 1")
    fades = (edit["weight"] > 0).to_numpy()
    for prefix, number, used in (
        ("", "source", np.full(len(edit), True)),
        ("partner_", "partner", fades),
    ):
        kind, row = edit[f"{prefix}kind"], edit[number].fillna(-1).to_numpy(int)
        refuse(used & ~kind.isin(list(sizes)), f"{prefix}kind", " or ".join(sizes))
        for name, size in sizes.items():
            bad = used & (kind == name) & ((row < 0) | (row >= size))
            refuse(bad, number, f"a {name}, 0 … {size - 1}")
        if SPRITE in shelves:
            most, column = shelves[SPRITE].orientations, f"{prefix}orientation"
            bad = used & (kind == SPRITE) & ~edit[column].fillna(0).between(1, most)
            refuse(bad, column, f"an orientation, 1 … {most}")
        scale = edit[f"{prefix}scale"].to_numpy(float)
        refuse(used & ~(np.isfinite(scale) & (scale > 0)), f"{prefix}scale", "more than 0")
        angle = edit[f"{prefix}rotation_deg"].to_numpy(float)
        refuse(used & ~np.isfinite(angle), f"{prefix}rotation_deg", "an angle")
    if problems:
        raise FinloopError(
            "the edit list cannot be drawn:\n    " + "\n    ".join(problems),
            "pictures that exist, at places and of sizes that can be drawn",
            do,
        )
