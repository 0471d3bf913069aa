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
from finloop.distance.reel import sprite_store_row
from finloop.edit.bodies import Bodies
from finloop.edit.schema import FRAME, SPRITE, RowPicture, row_partner, row_picture
from finloop.features.table import count_orientations
from finloop.puppet import PlacedBackbone
from finloop.render.painter import (
    BentPicture,
    PaddedPicture,
    PlacedFish,
    TurnedPicture,
    pad_picture,
)

PLACE = ["x_px", "y_px"]
_PICTURE = ["kind", "orientation", "rotation_deg", "scale", "mirrored"]
_COLUMNS = [
    *PLACE, "source", *_PICTURE, "partner", *(f"partner_{name}" for name in _PICTURE), "weight",
    "pose",
]  # fmt: skip


class CutoutSet(NamedTuple):
    """All cut-outs of one kind: of n frames, or of n sprites in `orientations` orientations each.

    centres_px (n, 2): their mass centres in the film.
    """

    store: Cutouts
    centres_px: NDArray[np.float64]
    orientations: int = 1


class Gallery:
    """The fish pictures that the rows of edit lists name; those used last stay in memory."""

    def __init__(
        self, cutout_sets: Mapping[str, CutoutSet], bodies: Bodies | None = None, keep: int = 512
    ) -> None:
        """Take the cut-outs by kind, FRAME or SPRITE.

        bodies: the film's postures, without which no frame is drawn mirrored or in another pose.
        keep: how many pictures stay in memory.
        """
        self.cutout_sets, self.bodies = cutout_sets, bodies
        self.picture = lru_cache(keep)(self._load_picture)

    def _load_picture(
        self, kind: str, source: int, orientation: int, mirrored: bool
    ) -> PaddedPicture:
        """Return a stored cut-out as a picture to draw; mirrored: left and right exchanged.

        kind: FRAME or SPRITE; source: film row, or number of the sprite; orientation: that of a
        sprite, from 1.
        """
        cutout_set = self.cutout_sets[kind]
        cutout = cutout_set.store[sprite_store_row(source, orientation, cutout_set.orientations)]
        x_px, y_px = cutout_set.centres_px[source]
        x, y = x_px - cutout.x0_px, y_px - cutout.y0_px
        if mirrored:
            return pad_picture(cutout.pixels[:, ::-1], cutout.pixels.shape[1] - 1 - x, y)
        return pad_picture(cutout.pixels, x, y)

    def film_picture(self, row: int, mirrored: bool = False) -> PaddedPicture:
        """Return the picture of a row of the film; mirrored: left and right exchanged."""
        return self.picture(FRAME, row, 1, mirrored)

    def turn_picture(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float,
        mirrored: bool = False,
    ) -> TurnedPicture:  # fmt: skip
        """Return a frame, or a sprite in an orientation, turned and scaled as it is drawn.

        kind: FRAME or SPRITE; source: film row, or number of the sprite; orientation: of a sprite;
        rotation_deg: anticlockwise; mirrored: whether a frame is reflected about its heading.
        """
        if kind != FRAME:
            return TurnedPicture(
                self.picture(kind, source, int(orientation), False), rotation_deg, scale
            )
        if mirrored:
            assert self.bodies is not None
            # Exchanging left and right turns a heading h into 180° − h: turn it back to h.
            rotation_deg += 2 * self.bodies.heading_deg[source] - 180
        return TurnedPicture(self.film_picture(source, mirrored), rotation_deg, scale)

    def place_row(self, row: Any) -> PlacedFish:
        """Return the fish that a row (named tuple) of an edit list draws, and its cross-fade."""
        has_partner = row.weight > 0
        pictures = [row_picture(row), row_partner(row)] if has_partner else [row_picture(row)]
        drawn: list[TurnedPicture] | list[BentPicture]
        if row.pose is None:
            drawn = [self.turn_picture(*picture) for picture in pictures]
        else:
            drawn = self._pictures_to_bend(pictures, row.pose)
        partner = drawn[1] if has_partner else None
        return PlacedFish(row.x_px, row.y_px, drawn[0], partner, row.weight)

    def _pictures_to_bend(self, pictures: Sequence[RowPicture], codes: Floats) -> list[BentPicture]:
        """Return film pictures with the pose they are to be bent into, the same for all.

        codes (c,): that pose, by its principal-component scores; heading and size are those of the
        first picture. Mirrored pictures are mirrored first, then bent.
        """
        assert self.bodies is not None
        bodies = [self.bodies.body_in_edit_row(picture) for picture in pictures]
        poses = self.bodies.poses
        target = poses.pose_from_codes(int(bodies[0].row), codes)
        heading = math.radians(bodies[0].heading_deg)
        size_px = float(target.size_px) * pictures[0].scale
        bent: list[BentPicture] = []
        for body in bodies:
            filmed, picture = poses.pose[int(body.row)], self.film_picture(int(body.row))
            source = PlacedBackbone(
                picture.x_px, picture.y_px, float(filmed.heading_rad), float(filmed.size_px),
                filmed.posture,
            )  # fmt: skip
            mirrored = bool(body.mirrored)
            bent.append(BentPicture(picture, source, target.posture, heading, size_px, mirrored))
        return bent


def build_cutout_sets(
    stores: Mapping[str, Cutouts], tracks: pd.DataFrame, sprites: pd.DataFrame | None
) -> dict[str, CutoutSet]:
    """Return all cut-outs with their mass centres, by kind: FRAME, and SPRITE if there are sprites.

    stores: cut-outs (pixels of a fish with alpha) by kind; tracks: x_px, y_px of the fish in every
    frame; sprites: the table of sprites, None without sprites. FinloopError if a table and its
    store differ in their number of pictures.
    """
    cutout_sets = {FRAME: CutoutSet(stores[FRAME], tracks[PLACE].to_numpy())}
    if sprites is not None:
        cutout_sets[SPRITE] = CutoutSet(
            stores[SPRITE], sprites[PLACE].to_numpy(), count_orientations(sprites)
        )
    for kind, (store, centres, orientations) in cutout_sets.items():
        if len(store) != len(centres) * orientations:
            raise FinloopError(
                f"{len(store)} pictures of kind {kind}, but {len(centres)} mass centres",
                "a mass centre for every frame and sprite",
                "make both again: `dvc repro --force extract sprites`",
            )
    return cutout_sets


def place_rows(edit: pd.DataFrame, gallery: Gallery) -> Iterator[PlacedFish]:
    """Yield, for each row of an edit list (schema EDIT), the fish that it draws, and where.

    FinloopError before the first one lists all that cannot be drawn.
    """
    _check_drawable(edit, gallery)
    return map(gallery.place_row, edit[_COLUMNS].itertuples(index=False))


def place_ticks(edit: pd.DataFrame, gallery: Gallery) -> Iterator[tuple[PlacedFish, ...]]:
    """Yield, for each tick of an edit list (schema EDIT), all its fish, the lowest first.

    FinloopError before the first one lists all that cannot be drawn.
    """
    _check_drawable(edit, gallery)
    rows = edit.sort_values(["tick", "fish"], kind="stable")[_COLUMNS].itertuples(index=False)
    all_fish = map(gallery.place_row, rows)
    # The same iterator once for each fish: so many successive fish are one tick.
    return zip(*[all_fish] * edit["fish"].nunique(), strict=True)


def _check_drawable(edit: pd.DataFrame, gallery: Gallery) -> None:
    """Raise FinloopError if an edit list cannot be drawn; list each problem with its first tick."""
    cutout_sets, bodies = gallery.cutout_sets, gallery.bodies
    advice = "make the edit list again: `dvc repro --force animate`"
    if edit.empty:
        raise FinloopError("the edit list is empty", "at least one tick", advice)
    problems: list[str] = []

    def note_problem(is_bad: NDArray[np.bool_] | pd.Series, column: str, wanted: str) -> None:
        """Add a sentence on a column if some rows are bad, with the first tick of these."""
        bad = edit[np.asarray(is_bad, bool)]
        if len(bad):
            tick, value = bad.iloc[0]["tick"], bad.iloc[0][column]
            others = f" (and at {len(bad) - 1} more ticks)" if len(bad) > 1 else ""
            problems.append(f"tick {tick}: {column} is {value}, wanted {wanted}{others}")

    # Ticks, places and weights.
    sizes = {kind: len(cutout_set.centres_px) for kind, cutout_set in cutout_sets.items()}
    note_problem(edit["tick"] != edit.groupby("fish").cumcount(), "tick", "0, 1, 2, … of each fish")
    last = edit.groupby("fish")["tick"].transform("max")
    note_problem(last < last.max(), "fish", "as many ticks of each fish")
    for column in ("x_px", "y_px"):
        note_problem(~np.isfinite(edit[column].to_numpy(float)), column, "a place")
    note_problem(~edit["weight"].between(0, 1), "weight", "0 … 1")
    # The picture of each row, and the one to cross-fade with, where there is one.
    fades = (edit["weight"] > 0).to_numpy()
    for prefix, source_column, used in (
        ("", "source", np.full(len(edit), True)),
        ("partner_", "partner", fades),
    ):
        kind, source = edit[f"{prefix}kind"], edit[source_column].fillna(-1).to_numpy(int)
        note_problem(used & ~kind.isin(list(sizes)), f"{prefix}kind", " or ".join(sizes))
        for name, size in sizes.items():
            is_bad = used & (kind == name) & ((source < 0) | (source >= size))
            note_problem(is_bad, source_column, f"a {name}, 0 … {size - 1}")
        if SPRITE in cutout_sets:
            most, column = cutout_sets[SPRITE].orientations, f"{prefix}orientation"
            is_bad = used & (kind == SPRITE) & ~edit[column].fillna(0).between(1, most)
            note_problem(is_bad, column, f"an orientation, 1 … {most}")
        scale = edit[f"{prefix}scale"].to_numpy(float)
        note_problem(used & ~(np.isfinite(scale) & (scale > 0)), f"{prefix}scale", "more than 0")
        angle = edit[f"{prefix}rotation_deg"].to_numpy(float)
        note_problem(used & ~np.isfinite(angle), f"{prefix}rotation_deg", "an angle")
    # Poses.
    code_count = 0 if bodies is None else bodies.poses.codes.shape[1]
    fits = [
        pose is None
        or (code_count > 0 and np.shape(pose) == (code_count,) and np.isfinite(pose).all())
        for pose in edit["pose"]
    ]
    wanted = f"{code_count} codes of shapes" if code_count else "none: there are none"
    note_problem(~np.array(fits, bool), "pose", wanted)
    if problems:
        raise FinloopError(
            "the edit list cannot be drawn:\n    " + "\n    ".join(problems),
            "pictures that exist, at places and of sizes that can be drawn",
            advice,
        )
