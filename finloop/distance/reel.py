"""The film's pictures by row: cut-outs, centred pictures in any pose, sprites, successors.

A row is a fish in a frame: one number for the row of the table of tracks, of the feature table and
of the store of cut-outs, in the order (track_id, frame). A sprite is a number and an orientation, 1
… orientations.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from finloop.base.arrays import Floats, Mask, Reals
from finloop.base.cutout import Cutout, Cutouts
from finloop.base.errors import FinloopError
from finloop.distance.picture import BODY, Place, picture, places, steps, typical_length
from finloop.features.table import direction_deg, orientations_of, step_of

Pictures = NDArray[np.float32]
Rows = NDArray[np.intp]

_KEY = ["track_id", "frame"]
_LOT = 500  # pictures at a time


def sprite_row(sprite: int, orientation: int, orientations: int) -> int:
    """Return a sprite's row in the store, for an orientation 1 … orientations."""
    return sprite * orientations + orientation - 1


@dataclass(frozen=True)
class Reel:
    """A film and, once they have been made, its sprites.

    features (n rows): track_id, frame, x_px, y_px, heading_deg, body_length_px; film: the n
    cut-outs; sprites (s rows): schema SPRITES; store: the sprites in all orientations; size: how
    many times as large as filmed all fish are drawn. FinloopError if tables and stores are not of
    one film.
    """

    features: pd.DataFrame
    film: Cutouts
    sprites: pd.DataFrame = field(default_factory=pd.DataFrame)
    store: Cutouts | None = None
    size: float = 1.0

    def __post_init__(self) -> None:
        keys = self.features[_KEY].to_numpy()
        problems = []
        if not np.array_equal(keys, self.film.index[_KEY].to_numpy()):
            problems.append(f"{len(self.film)} cut-outs are not those of the {len(keys)} rows")
        if len(self.sprites):
            rows = self.sprites["row"].to_numpy()
            true = keys[rows] if rows.max() < len(keys) else keys[:0]
            if not np.array_equal(self.sprites[_KEY].to_numpy(), true):
                problems.append(f"{len(self.sprites)} sprites are of other frames than they say")
        if self.store is not None:
            index, count = self.store.index, self.orientations
            rows = sprite_row(index["sprite"], index["orientation"], count)
            if not np.array_equal(rows, np.arange(len(self.sprites) * count)):
                problems.append(
                    f"{len(self.store)} pictures of sprites, wanted {len(self.sprites)} sprites in "
                    f"{count} orientations"
                )
        if problems:
            raise FinloopError(
                "; ".join(problems),
                "features, cut-outs and sprites of one film",
                "make them again: `dvc repro`",
            )

    def __len__(self) -> int:
        return len(self.features)

    def scale_to(self, size: float) -> "Reel":
        """Return the same film and sprites, drawn `size` times as large as filmed."""
        sprites = self.sprites
        if len(sprites):
            sprites = sprites.assign(scale=sprites["scale"] * (size / self.size))
        return replace(self, sprites=sprites, size=size)

    @property
    def orientations(self) -> int:
        """Return the number of orientations of every sprite in the store."""
        return orientations_of(self.sprites)

    # --- rows

    @cached_property
    def length_px(self) -> float:
        """Return the length at which every fish is drawn: the film's median, times `size`."""
        return self.size * float(self.features["body_length_px"].median())

    @cached_property
    def lengths_px(self) -> Reals:
        """Return the typical length (n,) of each row's track."""
        return typical_length(self.features).to_numpy()

    def place(self, row: int) -> Place:
        """Return the mass centre of a row."""
        return Place(*self._places[row].tolist())

    @cached_property
    def _places(self) -> Reals:
        """Return x, y (n, 2) of every row."""
        return self.features[["x_px", "y_px"]].to_numpy(float)

    @cached_property
    def goes_on(self) -> Mask:
        """Return whether the next row (n,) is the next frame of the same track."""
        follows = (np.diff(self.features[_KEY].to_numpy(), axis=0) == (0, 1)).all(axis=1)
        return np.append(follows, False)

    @cached_property
    def step_ends(self) -> tuple[Rows, Rows]:
        """Return rows, and beside them those a natural step later in the same track."""
        keys, frames = self.features[_KEY].to_numpy(), step_of(self.features)
        first = np.flatnonzero((keys[frames:] - keys[:-frames] == (0, frames)).all(axis=1))
        return first, first + frames

    def next_rows(self, row: ArrayLike) -> Rows:
        """Return the row of the track's next frame; the row itself at the end of a track."""
        rows = np.asarray(row, np.intp)
        return rows + self.goes_on[rows]

    # --- pictures

    def frame(self, row: int, size: int, length_px: float, turn_deg: float) -> Pictures:
        """Return a row's picture (size, size, c), turned anticlockwise as seen.

        All fish come out equally long; this one is `length_px` long as filmed.
        """
        return picture(self.film[int(row)], self.place(row), length_px, size, turn_deg)

    def frames(self, rows: Rows, size: int, pose: str) -> Pictures:
        """Return pictures (k, size, size, c) of some rows, at least one.

        A track's typical length is that of all its rows. `pose` FILM: as filmed; BODY: headed to
        the right.
        """
        heading = self.features["heading_deg"].to_numpy(float)[rows] * (pose == BODY)
        return self.align_pictures(rows, heading, size)

    def align_pictures(self, rows: Rows, heading_deg: Reals, size: int) -> Pictures:
        """Return pictures (k, size, size, c) of rows, turned so that these headings point right."""
        channels = self.film[0].pixels.shape[2]
        pictures = np.empty(
            (len(rows), size, size, channels), np.float32
        )  # a list would double the memory
        for number, (row, heading) in enumerate(zip(rows.tolist(), heading_deg, strict=True)):
            pictures[number] = self.frame(row, size, self.lengths_px[row], -heading)
        return pictures

    def steps(self, size: int, pose: str, rows: Rows | None = None) -> Floats:
        """Compute Eq. 5 from each of some rising rows (k,), None for all, to the next one.

        NaN where that is not the next frame of its track.
        """
        some = np.arange(len(self)) if rows is None else rows
        step = np.full(len(some), np.nan)
        for start in range(0, len(some) - 1, _LOT):
            lot = self.frames(some[start : start + _LOT + 1], size, pose)
            step[start : start + len(lot) - 1] = steps(lot)
        step[:-1][(np.diff(some) != 1) | ~self.goes_on[some[:-1]]] = np.nan
        return step

    # --- sprites

    def sprite(self, number: int, orientation: int = 1) -> Cutout:
        """Return a sprite's picture in an orientation, as stored."""
        if self.store is None:
            raise ValueError("this reel has no sprites")
        return self.store[sprite_row(int(number), int(orientation), self.orientations)]

    @cached_property
    def sprite_places(self) -> list[Place]:
        """Return the mass centre of every sprite."""
        return places(self.sprites)

    @cached_property
    def sprite_lengths_px(self) -> Reals:
        """Return the length (s,) as filmed of each sprite's fish."""
        return self.length_px / self.sprites["scale"].to_numpy()

    def sprite_picture(
        self, number: int, size: int, orientation: int = 1, turn_deg: float = 0.0
    ) -> Pictures:
        """Return a sprite (size, size, c) in an orientation, turned further by `turn_deg`."""
        place, length = self.sprite_places[number], self.sprite_lengths_px[number]
        return picture(self.sprite(number, orientation), place, length, size, turn_deg)

    def sprite_pictures(self, size: int, orientation: int = 1) -> Pictures:
        """Return every sprite (s, size, size, c) in an orientation."""
        count = len(self.sprites)
        return np.stack([self.sprite_picture(n, size, orientation) for n in range(count)])

    def after_sprites(self, size: int, orientation: int = 1) -> Pictures:
        """Return the film's next picture after every sprite, turned like the next sprite.

        At the end of a track it is the frame itself.
        """
        ahead = float(direction_deg(orientation, self.orientations))
        pictures = []
        for sprite, length in zip(self.sprites.itertuples(), self.sprite_lengths_px, strict=True):
            row, side = int(sprite.row), -1 if sprite.mirrored else 1
            turn = -sprite.heading_deg - side * sprite.turn_deg * self.goes_on[row]
            # A mirrored one is turned to the right, mirrored there, and its mirror turned on.
            picture = self.frame(int(self.next_rows(row)), size, length, turn + side * ahead)
            pictures.append(picture[::side])
        return np.stack(pictures)
