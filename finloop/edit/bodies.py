"""The filmed body behind every picture, whether it is a frame or a sprite.

A sprite is a row of the film that was turned and perhaps mirrored. A frame may also be mirrored, at
the line through its mass centre along its heading.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.edit.movement import Movement, movement
from finloop.edit.schema import FRAME
from finloop.features.table import direction_deg, orientations_of, wrap_deg
from finloop.pose.film import FilmPoses

Rows = NDArray[np.intp]


class Body(NamedTuple):
    """Filmed bodies (…) as drawn: feature row, mirrored or not, heading on screen in degrees."""

    row: Rows
    mirrored: Mask
    heading_deg: Floats

    def select(self, which: Any) -> "Body":
        """Return the bodies that a NumPy index (numbers, mask or slice) selects."""
        return Body(self.row[which], self.mirrored[which], self.heading_deg[which])


@dataclass(frozen=True)
class Bodies:
    """The film's postures, which rows are followed by another, and the rows behind the sprites.

    poses: of n rows; goes_on (n,): whether the next row is the next frame of the same track;
    sprites (s rows): columns row, mirrored, heading_deg, turn_deg, orientations, or an empty table.
    """

    poses: FilmPoses
    goes_on: Mask
    sprites: pd.DataFrame

    @cached_property
    def heading_deg(self) -> Floats:
        """Return the heading (n,) [°] of every row as filmed, anticlockwise."""
        return np.degrees(self.poses.pose.heading_rad)

    @cached_property
    def movement(self) -> Movement:
        """Return how far [body lengths] the body turns and bends from each row to the next."""
        return movement(self.poses.pose)

    @cached_property
    def _sprite_bodies(self) -> tuple[Rows, Mask, Floats, Floats]:
        """Return each sprite's row, mirror flag, filmed direction and turn to the next frame."""
        if not len(self.sprites):
            return np.zeros(1, np.intp), np.zeros(1, bool), np.zeros(1), np.zeros(1)
        row = self.sprites["row"].to_numpy(np.intp)
        turn = self.sprites["turn_deg"].to_numpy(float) * self.goes_on[row]
        axis = self.sprites["heading_deg"].to_numpy(float)
        return row, self.sprites["mirrored"].to_numpy(bool), axis, turn

    @cached_property
    def _speed(self) -> Floats:
        """Return the change of codes (n, c) a frame at every row, over the frames beside it."""
        codes, more = self.poses.codes, self.goes_on
        after = np.arange(len(codes)) + more
        before = np.arange(len(codes)) - np.append(False, more[:-1])
        return (codes[after] - codes[before]) / np.maximum(after - before, 1)[:, None]

    @cached_property
    def _orientations(self) -> int:
        return orientations_of(self.sprites)

    def line_deg(self, orientation: int, rotation_deg: float) -> Floats:
        """Return the direction [°] in which a sprite swims on screen.

        It is that of the stored orientation (1 …) plus the rotation with which the sprite is drawn.
        """
        return direction_deg(orientation, self._orientations) + rotation_deg

    def picture_bodies(self, frame: Mask, number: Rows, turn_deg: Floats, mirrored: Mask) -> Body:
        """Return the filmed bodies (…) that pictures show.

        frame (…): whether each picture is a frame, else a sprite; number: its row or sprite number;
        turn_deg: by how much a frame is turned, or the direction of a sprite's line; mirrored:
        whether a frame is mirrored.
        """
        rows, flips, axis, _ = self._sprite_bodies
        sprite = np.where(frame, 0, number)
        row, mirror = (
            np.where(frame, number, rows[sprite]),
            np.where(frame, mirrored, flips[sprite]),
        )
        heading = self.heading_deg[row]
        sway = np.where(mirror, -1, 1) * wrap_deg(heading - axis[sprite])
        return Body(row, mirror, turn_deg + np.where(frame, heading, sway))

    def edit_row_body(
        self, kind: str, source: int, orientation: int, rotation_deg: float, mirrored: bool
    ) -> Body:
        """Return the filmed body that a row of an edit list shows.

        The arguments are columns of `EDIT`; source: a feature row or, for kind SPRITE, a sprite.
        """
        turn = rotation_deg if kind == FRAME else self.line_deg(int(orientation), rotation_deg)
        frame = np.array(kind == FRAME)
        return self.picture_bodies(
            frame, np.array(source), np.asarray(turn, float), np.array(mirrored)
        )

    def next_body(self, body: Body) -> Body:
        """Return the bodies that the film shows next, or the same bodies where nothing follows."""
        row = body.row + self.goes_on[body.row]
        side = np.where(body.mirrored, -1, 1)
        turn = side * wrap_deg(self.heading_deg[row] - self.heading_deg[body.row])
        return Body(row, body.mirrored, body.heading_deg + turn)

    def line_turn_deg(self, frame: Mask, number: Rows) -> Floats:
        """Return by how much (…) [°] each sprite's line turns to the next frame; 0 for frames.

        frame (…): whether each picture is a frame; number (…): its row or sprite number.
        """
        return np.where(frame, 0.0, self._sprite_bodies[3][np.where(frame, 0, number)])

    def same_moment(self, one: Body, other: Body, frames: int) -> Mask:
        """Return whether (…) two bodies show nearly the same moment, both mirrored or both not.

        That is: rows of one track, at most `frames` frames apart.
        """
        track = np.append(0, np.cumsum(~self.goes_on[:-1]))
        near = np.abs(one.row - other.row) <= frames
        return near & (track[one.row] == track[other.row]) & (one.mirrored == other.mirrored)

    def codes(self, body: Body) -> Floats:
        """Return the pose codes (…, c) of bodies as drawn, after mirroring."""
        return self._mirror_codes(self.poses.codes[body.row], body.mirrored)

    def speed(self, body: Body) -> Floats:
        """Return by how much the pose codes (…, c) of bodies, as drawn, change per frame."""
        return self._mirror_codes(self._speed[body.row], body.mirrored)

    def _mirror_codes(self, codes: Floats, mirrored: Mask) -> Floats:
        return np.where(mirrored[..., None], codes @ self.poses.shapes.mirror, codes)
