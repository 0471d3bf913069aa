"""The pictures that an edit list names, and what its rows draw."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.cutout import Cutouts
from finloop.base.errors import FinloopError
from finloop.distance.reel import sprite_row
from finloop.edit.bodies import Bodies
from finloop.edit.schema import FRAME, SPRITE, RowPicture, row_partner, row_picture
from finloop.features.table import count_orientations
from finloop.puppet import PlacedBackbone
from finloop.render.painter import Bent, Picture, Placed, Turned, picture

PLACE = ["x_px", "y_px"]
_PICTURE = ["kind", "orientation", "rotation_deg", "scale", "mirrored"]
_COLUMNS = [
    *PLACE, "source", *_PICTURE, "partner", *(f"partner_{name}" for name in _PICTURE), "weight",
    "pose",
]  # fmt: skip


class Shelf(NamedTuple):
    """A store of cut-outs: n frames, or n sprites in each of `orientations` orientations.

    centres_px (n, 2): their mass centres in the film.
    """

    store: Cutouts
    centres_px: NDArray[np.float64]
    orientations: int = 1


class Gallery:
    """The pictures that an edit list names; the most recent `keep` stay in memory.

    shelves: by kind, FRAME or SPRITE; bodies: the film's postures, without which no frame can be
    drawn mirrored or in another pose.
    """

    def __init__(
        self, shelves: Mapping[str, Shelf], bodies: Bodies | None = None, keep: int = 512
    ) -> None:
        self.shelves, self.bodies = shelves, bodies
        self.picture = lru_cache(keep)(self._picture)

    def _picture(self, kind: str, source: int, orientation: int, mirrored: bool) -> Picture:
        """Return a stored cut-out as a picture to draw, perhaps with left and right exchanged."""
        shelf = self.shelves[kind]
        cutout = shelf.store[sprite_row(source, orientation, shelf.orientations)]
        x_px, y_px = shelf.centres_px[source]
        x, y = x_px - cutout.x0_px, y_px - cutout.y0_px
        if mirrored:
            return picture(cutout.pixels[:, ::-1], cutout.pixels.shape[1] - 1 - x, y)
        return picture(cutout.pixels, x, y)

    def frame(self, row: int, mirrored: bool = False) -> Picture:
        """Return the picture of a row of the film; mirrored: left and right exchanged."""
        return self.picture(FRAME, row, 1, mirrored)

    def rotate_picture(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float,
        mirrored: bool = False,
    ) -> Turned:  # fmt: skip
        """Return a frame, or a sprite in an orientation, as it is drawn: turned and scaled.

        The arguments are the fields of `RowPicture`.
        """
        if kind != FRAME:
            return Turned(self.picture(kind, source, int(orientation), False), rotation_deg, scale)
        if mirrored:
            assert self.bodies is not None
            rotation_deg += 2 * self.bodies.heading_deg[source] - 180
        return Turned(self.frame(source, mirrored), rotation_deg, scale)

    def place(self, row: Any) -> Placed:
        """Return the fish and its partner that a row of an edit list, a named tuple, draws."""
        names = [row_picture(row), row_partner(row)] if row.weight > 0 else [row_picture(row)]
        if row.pose is None:
            drawn: list[Turned] | list[Bent] = [self.rotate_picture(*name) for name in names]
        else:
            drawn = self._bend_bodies(names, row.pose)
        partner = drawn[1] if row.weight > 0 else None
        return Placed(row.x_px, row.y_px, drawn[0], partner, row.weight)

    def _bend_bodies(self, names: Sequence[RowPicture], codes: Floats) -> list[Bent]:
        """Return the pictures bent into one pose, with heading and size of the first picture."""
        assert self.bodies is not None
        poses, shown = self.bodies.poses, [self.bodies.edit_row_body(name) for name in names]
        target = poses.pose_from_codes(int(shown[0].row), codes)
        heading = math.radians(shown[0].heading_deg)
        size_px, drawn = float(target.size_px) * names[0].scale, []
        for body in shown:
            own, film = poses.pose[int(body.row)], self.frame(int(body.row))
            source = PlacedBackbone(
                film.x_px, film.y_px, float(own.heading_rad), float(own.size_px), own.posture
            )
            mirrored = bool(body.mirrored)
            drawn.append(Bent(film, source, target.posture, heading, size_px, mirrored))
        return drawn


def shelves(
    stores: Mapping[str, Cutouts], tracks: pd.DataFrame, table: pd.DataFrame | None
) -> dict[str, Shelf]:
    """Return the cut-outs and their mass centres, those of film frames and those of sprites.

    tracks: x_px, y_px of every cut-out; table: the same and orientations of every sprite, None
    without sprites. FinloopError if a table belongs to another store.
    """
    made = {FRAME: Shelf(stores[FRAME], tracks[PLACE].to_numpy())}
    if table is not None:
        made[SPRITE] = Shelf(stores[SPRITE], table[PLACE].to_numpy(), count_orientations(table))
    for kind, (store, centres, orientations) in made.items():
        if len(store) != len(centres) * orientations:
            raise FinloopError(
                f"{len(store)} pictures of kind {kind}, but {len(centres)} mass centres",
                "a mass centre for every frame and sprite",
                "make both again: `dvc repro --force extract sprites`",
            )
    return made


def place_rows(edit: pd.DataFrame, gallery: Gallery) -> Iterator[Placed]:
    """Yield what each row of an edit list (schema EDIT) draws, and where.

    FinloopError at once, listing all that cannot be drawn.
    """
    _refuse(edit, gallery)
    return map(gallery.place, edit[_COLUMNS].itertuples(index=False))


def place_ticks(edit: pd.DataFrame, gallery: Gallery) -> Iterator[tuple[Placed, ...]]:
    """Yield all fish that an edit list (schema EDIT) draws at each tick, the lowest first.

    FinloopError at once, listing all that cannot be drawn.
    """
    _refuse(edit, gallery)
    rows = edit.sort_values(["tick", "fish"], kind="stable")[_COLUMNS].itertuples(index=False)
    return zip(*[map(gallery.place, rows)] * edit["fish"].nunique(), strict=True)


def _refuse(edit: pd.DataFrame, gallery: Gallery) -> None:
    """Raise if an edit list cannot be drawn: every kind of problem, each with its first tick."""
    shelves, bodies = gallery.shelves, gallery.bodies
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
    refuse(edit["tick"] != edit.groupby("fish").cumcount(), "tick", "0, 1, 2, … of each fish")
    last = edit.groupby("fish")["tick"].transform("max")
    refuse(last < last.max(), "fish", "as many ticks of each fish")
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
    codes = 0 if bodies is None else bodies.poses.codes.shape[1]
    fits = [
        pose is None or (codes > 0 and np.shape(pose) == (codes,) and np.isfinite(pose).all())
        for pose in edit["pose"]
    ]
    refuse(
        ~np.array(fits, bool),
        "pose",
        f"{codes} codes of shapes" if codes else "none: there are none",
    )
    if problems:
        raise FinloopError(
            "the edit list cannot be drawn:\n    " + "\n    ".join(problems),
            "pictures that exist, at places and of sizes that can be drawn",
            do,
        )
