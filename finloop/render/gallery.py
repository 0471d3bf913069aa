"""The pictures that an edit list names, and what its rows draw."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask
from finloop.base.cutout import Cutouts
from finloop.base.errors import FinloopError
from finloop.distance.reel import sprite_store_row
from finloop.edit.bodies import Bodies
from finloop.edit.schema import FRAME, SPRITE, RowPicture, row_partner, row_picture
from finloop.extract.matte import drop_residue
from finloop.features.table import count_orientations
from finloop.puppet import PlacedBackbone
from finloop.render.painter import (
    BentPicture,
    PaddedPicture,
    PlacedFish,
    TurnedPicture,
    pad_picture,
    sharpen_picture,
)

PLACE = ["x_px", "y_px"]
_PICTURE = ["kind", "orientation", "rotation_deg", "scale", "mirrored"]
_COLUMNS = [
    *PLACE, "source", *_PICTURE, "partner", *(f"partner_{name}" for name in _PICTURE), "weight",
    "pose",
]  # fmt: skip


class CutoutSet(NamedTuple):
    """All cut-outs of one kind: n frames, or n sprites, each in `orientations` orientations.

    centres_px (n, 2): the mass centres of the n frames or sprites in the film.
    """

    store: Cutouts
    centres_px: Floats
    orientations: int = 1


class Gallery:
    """Pictures of fish that edit lists name; the last used ones stay in memory."""

    def __init__(
        self, cutout_sets: Mapping[str, CutoutSet], bodies: Bodies | None = None, keep: int = 256,
        residue: bool = True,
    ) -> None:  # fmt: skip
        """Take the cut-outs by kind, FRAME or SPRITE.

        bodies: the film's postures, without which no frame is drawn mirrored or in another pose.
        keep: how many pictures stay in memory. residue: whether they keep the faint residue around
        the fish (`finloop.extract.matte`), which belongs on the film's own tank alone.
        """
        self.cutout_sets, self.bodies, self.residue = cutout_sets, bodies, residue
        self.picture = lru_cache(keep)(self._load_picture)

    def _load_picture(
        self, kind: str, source: int, orientation: int, mirrored: bool
    ) -> PaddedPicture:
        """Return a stored cut-out as a picture to draw, sharpened; mirrored: left is right.

        kind, source, orientation: columns of `EDIT`.
        """
        cutout_set = self.cutout_sets[kind]
        cutout = cutout_set.store[sprite_store_row(source, orientation, cutout_set.orientations)]
        x_px, y_px = cutout_set.centres_px[source]
        x, y = x_px - cutout.x0_px, y_px - cutout.y0_px
        pixels = cutout.pixels if self.residue else drop_residue(cutout.pixels)
        if mirrored:
            pixels, x = pixels[:, ::-1], pixels.shape[1] - 1 - x
        return sharpen_picture(pad_picture(pixels, x, y))

    def film_picture(self, row: int, mirrored: bool = False) -> PaddedPicture:
        """Return the picture of a row of the film; mirrored: left and right exchanged."""
        return self.picture(FRAME, row, 1, mirrored)

    def picture_to_draw(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float,
        mirrored: bool = False,
    ) -> TurnedPicture:  # fmt: skip
        """Return a picture with the rotation and scale to draw it at; nothing is turned yet.

        The arguments are columns of `EDIT`. mirrored: whether a frame is reflected about its
        heading; ignored for sprites, which are stored as they are shown.
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

    def place_fish(self, row: Any) -> PlacedFish:
        """Return the fish that a row of an edit list draws: place, picture and cross-fade."""
        has_partner = row.weight > 0
        pictures = [row_picture(row), row_partner(row)] if has_partner else [row_picture(row)]
        drawn: list[TurnedPicture] | list[BentPicture]
        if row.pose is None:
            drawn = [self.picture_to_draw(*picture) for picture in pictures]
        else:
            drawn = self._pictures_to_bend(pictures, row.pose)
        partner = drawn[1] if has_partner else None
        return PlacedFish(row.x_px, row.y_px, drawn[0], partner, row.weight)

    def _pictures_to_bend(self, pictures: Sequence[RowPicture], codes: Floats) -> list[BentPicture]:
        """Return film pictures (one, or two to cross-fade), ready to be bent into one pose.

        codes (c,): that pose, by its principal-component scores; all are drawn with the heading and
        size of the first picture. Mirrored pictures are mirrored first, then bent.
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

    stores: by kind; tracks: x_px, y_px of the fish in every frame; sprites: their table, if there
    are any. FinloopError if a table and its store differ in their number of pictures.
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


def fish_by_row(edit: pd.DataFrame, gallery: Gallery) -> Iterator[PlacedFish]:
    """Yield the fish that each row of an edit list (schema EDIT) draws: place and picture.

    FinloopError before the first one lists all that cannot be drawn.
    """
    _check_drawable(edit, gallery)
    return map(gallery.place_fish, edit[_COLUMNS].itertuples(index=False))


def fish_by_tick(edit: pd.DataFrame, gallery: Gallery) -> Iterator[tuple[PlacedFish, ...]]:
    """Yield the fish that each tick of an edit list (schema EDIT) draws, ordered by number.

    FinloopError before the first one lists all that cannot be drawn.
    """
    _check_drawable(edit, gallery)
    rows = edit.sort_values(["tick", "fish"], kind="stable")[_COLUMNS].itertuples(index=False)
    all_fish = map(gallery.place_fish, rows)
    # The same iterator once for each fish: so many successive fish are one tick.
    return zip(*[all_fish] * edit["fish"].nunique(), strict=True)


def _check_drawable(edit: pd.DataFrame, gallery: Gallery) -> None:
    """Raise FinloopError if an edit list cannot be drawn; list each problem with its first tick."""
    advice = "make the edit list again: `dvc repro --force animate`"
    if edit.empty:
        raise FinloopError("the edit list is empty", "at least one tick", advice)
    # Each picture of a row, and the one to cross-fade with, where there is one.
    always, fades = np.full(len(edit), True), (edit["weight"] > 0).to_numpy()
    checks = [
        *_find_bad_places(edit),
        *_find_bad_pictures(edit, "", "source", always, gallery.cutout_sets),
        *_find_bad_pictures(edit, "partner_", "partner", fades, gallery.cutout_sets),
        _find_bad_poses(edit, gallery.bodies),
    ]
    problems = [_describe_bad_rows(edit, check) for check in checks if check.is_bad.any()]
    if problems:
        raise FinloopError(
            "the edit list cannot be drawn:\n    " + "\n    ".join(problems),
            "pictures that exist, at places and of sizes that can be drawn",
            advice,
        )


class _ColumnCheck(NamedTuple):
    """A check of a column of an edit list: a mask (n,) of the bad rows, and what is wanted."""

    is_bad: Mask
    column: str
    wanted: str


def _describe_bad_rows(edit: pd.DataFrame, check: _ColumnCheck) -> str:
    """Return a sentence about the first bad row of an edit list and the number of the others."""
    bad = edit[check.is_bad]
    tick, value = bad.iloc[0]["tick"], bad.iloc[0][check.column]
    others = f" (and at {len(bad) - 1} more ticks)" if len(bad) > 1 else ""
    return f"tick {tick}: {check.column} is {value}, wanted {check.wanted}{others}"


def _find_bad_places(edit: pd.DataFrame) -> Iterator[_ColumnCheck]:
    """Yield the checks of an edit list's ticks, places and weights of cross-fades."""
    ticks = edit.groupby("fish")["tick"]
    is_bad = (edit["tick"] != ticks.cumcount()).to_numpy(bool)
    yield _ColumnCheck(is_bad, "tick", "0, 1, 2, … of each fish")
    last = ticks.transform("max")
    yield _ColumnCheck((last < last.max()).to_numpy(bool), "fish", "as many ticks of each fish")
    for column in ("x_px", "y_px"):
        yield _ColumnCheck(~np.isfinite(edit[column].to_numpy(float)), column, "a place")
    yield _ColumnCheck(~edit["weight"].between(0, 1).to_numpy(bool), "weight", "0 … 1")


def _find_bad_pictures(
    edit: pd.DataFrame, prefix: str, source_column: str, used: Mask,
    cutout_sets: Mapping[str, CutoutSet],
) -> Iterator[_ColumnCheck]:  # fmt: skip
    """Yield the checks of an edit list's pictures: kind, number, orientation, size and angle.

    prefix, source_column: "" and "source" for the columns of the main picture, "partner_" and
    "partner" for the one to cross-fade with; used (n,): the rows that show such a picture.
    """
    kind, number = edit[f"{prefix}kind"], edit[source_column].fillna(-1).to_numpy(int)
    sizes = {name: len(cutout_set.centres_px) for name, cutout_set in cutout_sets.items()}
    is_unknown = ~kind.isin(list(sizes)).to_numpy(bool)
    yield _ColumnCheck(used & is_unknown, f"{prefix}kind", " or ".join(sizes))
    for name, size in sizes.items():
        is_bad = used & (kind == name).to_numpy(bool) & ((number < 0) | (number >= size))
        yield _ColumnCheck(is_bad, source_column, f"a {name}, 0 … {size - 1}")
    if SPRITE in cutout_sets:
        most, column = cutout_sets[SPRITE].orientations, f"{prefix}orientation"
        is_other = ~edit[column].fillna(0).between(1, most).to_numpy(bool)
        is_bad = used & (kind == SPRITE).to_numpy(bool) & is_other
        yield _ColumnCheck(is_bad, column, f"an orientation, 1 … {most}")
    scale = edit[f"{prefix}scale"].to_numpy(float)
    is_bad = used & ~(np.isfinite(scale) & (scale > 0))
    yield _ColumnCheck(is_bad, f"{prefix}scale", "more than 0")
    angle = edit[f"{prefix}rotation_deg"].to_numpy(float)
    yield _ColumnCheck(used & ~np.isfinite(angle), f"{prefix}rotation_deg", "an angle")


def _find_bad_poses(edit: pd.DataFrame, bodies: Bodies | None) -> _ColumnCheck:
    """Return the check of an edit list's poses: each is None, or has as many codes as `bodies`."""
    code_count = 0 if bodies is None else bodies.poses.codes.shape[1]
    fits = [
        pose is None
        or (code_count > 0 and np.shape(pose) == (code_count,) and np.isfinite(pose).all())
        for pose in edit["pose"]
    ]
    wanted = f"{code_count} codes of shapes" if code_count else "none: there are none"
    return _ColumnCheck(~np.array(fits, bool), "pose", wanted)
