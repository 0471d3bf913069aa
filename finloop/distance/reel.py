"""The film's pictures by row: cut-outs, centred pictures as filmed or turned, sprites, successors.

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
from finloop.distance.picture import (
    BODY,
    draw_centred_cutout,
    successive_distances,
    typical_lengths_px,
)
from finloop.features.table import count_orientations, natural_step_frames, orientation_heading_deg

Pictures = NDArray[np.float32]
Rows = NDArray[np.intp]

_KEY = ["track_id", "frame"]
_BATCH = 500  # pictures at a time


def sprite_store_row(sprite: int, orientation: int, orientations: int) -> int:
    """Return the number, in the store of sprites, of a sprite's picture in an orientation, 1 …."""
    return sprite * orientations + orientation - 1


@dataclass(frozen=True)
class Reel:
    """A film's fish, row by row: features and cut-outs (pixels with alpha), and the sprites.

    features (n rows): track_id, frame, x_px, y_px, heading_deg, body_length_px; cutouts: the n
    cut-outs; sprites (s rows): schema SPRITES; store: the sprites in all orientations; scale: how
    many times as large as filmed all fish are drawn. FinloopError if tables and stores are not of
    one film.
    """

    features: pd.DataFrame
    cutouts: Cutouts
    sprites: pd.DataFrame = field(default_factory=pd.DataFrame)
    store: Cutouts | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        keys = self.features[_KEY].to_numpy()
        problems = []
        if not np.array_equal(keys, self.cutouts.index[_KEY].to_numpy()):
            problems.append(f"{len(self.cutouts)} cut-outs are not those of the {len(keys)} rows")
        if len(self.sprites):
            rows = self.sprites["row"].to_numpy()
            keys_of_rows = keys[rows] if rows.max() < len(keys) else keys[:0]
            if not np.array_equal(self.sprites[_KEY].to_numpy(), keys_of_rows):
                problems.append(f"{len(self.sprites)} sprites are of other frames than they say")
        if self.store is not None:
            index, count = self.store.index, self.orientations
            rows = sprite_store_row(index["sprite"], index["orientation"], count)
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

    def scale_to(self, times_filmed: float) -> "Reel":
        """Return a reel with fish and sprites drawn `times_filmed` times as large as filmed."""
        sprites = self.sprites
        if len(sprites):
            sprites = sprites.assign(scale=sprites["scale"] * (times_filmed / self.scale))
        return replace(self, sprites=sprites, scale=times_filmed)

    @property
    def orientations(self) -> int:
        """Return the number of orientations of every sprite in the store."""
        return count_orientations(self.sprites)

    # --- rows

    @cached_property
    def length_px(self) -> float:
        """Return the body length [px] at which every fish is drawn: the median times `scale`."""
        return self.scale * float(self.features["body_length_px"].median())

    @cached_property
    def lengths_px(self) -> Reals:
        """Return the typical body length (n,) [px], as filmed, of the animal in each row."""
        return typical_lengths_px(self.features).to_numpy()

    @cached_property
    def centres_px(self) -> Reals:
        """Return the mass centres (n, 2) of the rows, px of the film."""
        return self.features[["x_px", "y_px"]].to_numpy(float)

    @cached_property
    def has_next_frame(self) -> Mask:
        """Return for each row (n,) whether the next row shows the same fish in the next frame."""
        follows = (np.diff(self.features[_KEY].to_numpy(), axis=0) == (0, 1)).all(axis=1)
        return np.append(follows, False)

    @cached_property
    def step_ends(self) -> tuple[Rows, Rows]:
        """Return the first and the last rows, (k,) each, of all steps of Δ / 5 within a track."""
        keys, frames = self.features[_KEY].to_numpy(), natural_step_frames(self.features)
        first = np.flatnonzero((keys[frames:] - keys[:-frames] == (0, frames)).all(axis=1))
        return first, first + frames

    def next_rows(self, rows_now: ArrayLike) -> Rows:
        """Return the rows (…) of the same fish a frame later; at a track's end the same rows."""
        rows = np.asarray(rows_now, np.intp)
        return rows + self.has_next_frame[rows]

    # --- pictures

    def draw_row(self, row: int, size_px: int, length_px: float, turn_deg: float) -> Pictures:
        """Return a picture with a row's fish in its middle, turned anticlockwise as seen.

        The picture is (size_px, size_px, channels), 0 … 1. length_px: the fish's body length as
        filmed.
        """
        return draw_centred_cutout(
            self.cutouts[int(row)], self.centres_px[row], length_px, size_px, turn_deg
        )

    def draw_rows(self, rows: Rows, size_px: int, reference: str) -> Pictures:
        """Return pictures (k, size_px, size_px, channels), 0 … 1, of the fish of rows (k,).

        reference: FILM, as filmed, or BODY, turned to head right. All fish are in the middle and
        equally long, by the typical length of the animal. There is at least one row.
        """
        heading = self.features["heading_deg"].to_numpy(float)[rows] * (reference == BODY)
        return self.draw_aligned_rows(rows, heading, size_px)

    def draw_aligned_rows(self, rows: Rows, heading_deg: Reals, size_px: int) -> Pictures:
        """Return pictures (k, size_px, size_px, channels), 0 … 1, of the fish of rows (k,), turned.

        heading_deg (k,): the direction in the film that points right in the picture.
        """
        channels = self.cutouts[0].pixels.shape[2]
        # A list would double the memory.
        pictures = np.empty((len(rows), size_px, size_px, channels), np.float32)
        for number, (row, heading) in enumerate(zip(rows.tolist(), heading_deg, strict=True)):
            pictures[number] = self.draw_row(row, size_px, self.lengths_px[row], -heading)
        return pictures

    def measure_steps(self, size_px: int, reference: str, rows: Rows) -> Floats:
        """Measure the picture distance (k,) (Eq. 5) from each of `rows` to the next of them.

        rows (k,): ascending. NaN where the next one is not the next frame of the same track.
        size_px, reference: as in `draw_rows`.
        """
        step = np.full(len(rows), np.nan)
        for start in range(0, len(rows) - 1, _BATCH):
            batch = self.draw_rows(rows[start : start + _BATCH + 1], size_px, reference)
            step[start : start + len(batch) - 1] = successive_distances(batch)
        step[:-1][(np.diff(rows) != 1) | ~self.has_next_frame[rows[:-1]]] = np.nan
        return step

    # --- sprites

    def read_sprite(self, number: int, orientation: int = 1) -> Cutout:
        """Return the stored cut-out of sprite `number` in an orientation, 1 …."""
        if self.store is None:
            raise ValueError("this reel has no sprites")
        return self.store[sprite_store_row(int(number), int(orientation), self.orientations)]

    @cached_property
    def sprite_centres_px(self) -> Reals:
        """Return the mass centres (s, 2) of the sprites, px of the film."""
        return self.sprites[["x_px", "y_px"]].to_numpy(float)

    @cached_property
    def _sprite_lengths_px(self) -> Reals:
        """Return the body length (s,) [px], as filmed, of each sprite's fish."""
        return self.length_px / self.sprites["scale"].to_numpy()

    def draw_sprite(
        self, number: int, size_px: int, orientation: int = 1, turn_deg: float = 0.0
    ) -> Pictures:
        """Return a picture (size_px, size_px, channels), 0 … 1, with a sprite in its middle.

        The picture shows `SPAN` lengths of that animal, so all animals come out equally long.
        turn_deg: turns it further, anticlockwise as seen.
        """
        centre, body_length = self.sprite_centres_px[number], self._sprite_lengths_px[number]
        return draw_centred_cutout(
            self.read_sprite(number, orientation), centre, body_length, size_px, turn_deg
        )

    def draw_sprites(self, size_px: int, orientation: int = 1) -> Pictures:
        """Return pictures (s, size_px, size_px, channels), 0 … 1, of all sprites."""
        numbers = range(len(self.sprites))
        return np.stack([self.draw_sprite(number, size_px, orientation) for number in numbers])

    def draw_frames_after_sprites(self, size_px: int, orientation: int = 1) -> Pictures:
        """Return pictures of the film frame that follows each sprite.

        They are (s, size_px, size_px, channels), turned, and mirrored, as the next sprite would be
        in this orientation. At the end of a track the frame of the sprite itself is drawn.
        """
        orientation_deg = float(orientation_heading_deg(orientation, self.orientations))
        pictures = []
        for sprite, length in zip(self.sprites.itertuples(), self._sprite_lengths_px, strict=True):
            row, side = int(sprite.row), -1 if sprite.mirrored else 1
            turn = -sprite.heading_deg - side * sprite.turn_deg * self.has_next_frame[row]
            # A mirrored fish is turned to head right, mirrored (upside down), and turned on.
            picture = self.draw_row(
                int(self.next_rows(row)), size_px, length, turn + side * orientation_deg
            )
            pictures.append(picture[::side])
        return np.stack(pictures)
