"""The filmed body in every picture, frame or sprite: pose, movement and rest.

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
from finloop.base.parallel import map_row_blocks
from finloop.edit.schema import FRAME, RowPicture
from finloop.features.table import count_orientations, orientation_heading_deg, wrap_deg
from finloop.pose.film import FilmPoses
from finloop.puppet import Pose

Rows = NDArray[np.intp]


class Body(NamedTuple):
    """Filmed bodies (…) as they are drawn: row, mirrored or not, heading on screen in degrees."""

    row: Rows
    mirrored: Mask
    heading_deg: Floats

    def select(self, which: Any) -> "Body":
        """Return the bodies that a NumPy index (numbers, mask or slice) selects."""
        return Body(self.row[which], self.mirrored[which], self.heading_deg[which])


class Movement(NamedTuple):
    """How far an animal's body turns and bends from each of n rows to the next, body lengths.

    whole (n − 1,): by turning and bending; bends (n − 1,): by bending alone, with the heading kept.
    Both are root mean squares over the points of the backbone, with the centre kept.
    """

    whole: Floats
    bends: Floats


def measure_movement(pose: Pose) -> Movement:
    """Return how far [body lengths] the body turns and bends from each of n poses to the next."""

    def measure_movement_from(rows: slice) -> Floats:
        """Return how far the body moves from k rows to the next: in all, and by bending (2, k)."""
        batch = pose[rows.start : rows.stop + 1]
        # The backbones about their centres, headed right, a body length long; y points down.
        lines = batch.move_to(0.0, 0.0, 0.0, 1.0).backbone_px()
        x, y = np.ascontiguousarray(np.moveaxis(lines, 2, 0))
        turn = np.diff(batch.heading_rad)[:, None]
        cos, sin = np.cos(turn), np.sin(turn)
        turned = x[1:] * cos + y[1:] * sin, y[1:] * cos - x[1:] * sin
        mean_squares = [
            ((next_x - x[:-1]) ** 2 + (next_y - y[:-1]) ** 2).mean(-1)
            for next_x, next_y in (turned, (x[1:], y[1:]))
        ]
        return np.sqrt(mean_squares)

    batches = map_row_blocks(measure_movement_from, len(pose) - 1)
    return Movement(*np.concatenate([np.empty((2, 0)), *batches], axis=1))


@dataclass(frozen=True)
class Bodies:
    """The filmed posture in every picture, whether a film row or a sprite.

    poses: of n rows; goes_on (n,): whether the next row is the next frame of the same track;
    sprites (s rows): columns row, mirrored, heading_deg, turn_deg, orientations, or an empty table.
    """

    poses: FilmPoses
    goes_on: Mask
    sprites: pd.DataFrame

    @cached_property
    def heading_deg(self) -> Floats:
        """Return the heading (n,) of every row as filmed, in degrees, anticlockwise."""
        return np.degrees(self.poses.pose.heading_rad)

    @cached_property
    def movement(self) -> Movement:
        """Return how far [body lengths] the body turns and bends from each row to the next."""
        return measure_movement(self.poses.pose)

    @cached_property
    def _sprite_bodies(self) -> tuple[Rows, Mask, Floats, Floats]:
        """Return by sprite (s,): film row, whether mirrored, heading as filmed, turn to next frame.

        Angles are degrees; the turn is 0 where the film does not go on. A film without sprites gets
        one, all zeros: frames, too, look sprites up by number 0, and then do not use the result.
        """
        if not len(self.sprites):
            return np.zeros(1, np.intp), np.zeros(1, bool), np.zeros(1), np.zeros(1)
        row = self.sprites["row"].to_numpy(np.intp)
        turn_deg = self.sprites["turn_deg"].to_numpy(float) * self.goes_on[row]
        heading_deg = self.sprites["heading_deg"].to_numpy(float)
        return row, self.sprites["mirrored"].to_numpy(bool), heading_deg, turn_deg

    @cached_property
    def _code_velocities(self) -> Floats:
        """Return the change per frame of each pose code at every row, signed: (n, c)."""
        codes, goes_on = self.poses.codes, self.goes_on
        # The next and the previous frame of the track; at its ends the row itself.
        after = np.arange(len(codes)) + goes_on
        before = np.arange(len(codes)) - np.append(False, goes_on[:-1])
        return (codes[after] - codes[before]) / np.maximum(after - before, 1)[:, None]

    def sprite_direction_deg(self, orientation: int, rotation_deg: float) -> Floats:
        """Return the direction [°] in which a sprite swims in an orientation, turned further.

        Both angles are anticlockwise on screen.
        """
        return orientation_heading_deg(orientation, count_orientations(self.sprites)) + rotation_deg

    def picture_bodies(self, frame: Mask, number: Rows, turn_deg: Floats, mirrored: Mask) -> Body:
        """Return the filmed body in each picture (…), frame or sprite: row, mirrored, heading.

        frame: whether each picture is a frame, else a sprite; number: its row or sprite number;
        turn_deg: by how much a frame is turned, or the direction in which a sprite swims; mirrored:
        whether a frame is mirrored.
        """
        sprite_row, sprite_mirrored, sprite_heading, _turn = self._sprite_bodies
        sprite = np.where(frame, 0, number)
        row = np.where(frame, number, sprite_row[sprite])
        is_mirrored = np.where(frame, mirrored, sprite_mirrored[sprite])
        heading = self.heading_deg[row]
        # A sprite's head sways about the heading at which the sprite counts as filmed.
        sway = np.where(is_mirrored, -1, 1) * wrap_deg(heading - sprite_heading[sprite])
        return Body(row, is_mirrored, turn_deg + np.where(frame, heading, sway))

    def body_in_edit_row(self, shown: RowPicture) -> Body:
        """Return the filmed body in a picture that an edit list names."""
        frame, turn = np.array(shown.kind == FRAME), np.asarray(shown.rotation_deg, float)
        if not frame:
            direction = self.sprite_direction_deg(int(shown.orientation), shown.rotation_deg)
            turn = np.asarray(direction, float)
        return self.picture_bodies(frame, np.array(shown.source), turn, np.array(shown.mirrored))

    def next_body(self, body: Body) -> Body:
        """Return the bodies that the film shows a frame later; unchanged at the end of a track."""
        row = body.row + self.goes_on[body.row]
        side = np.where(body.mirrored, -1, 1)
        turn = side * wrap_deg(self.heading_deg[row] - self.heading_deg[body.row])
        return Body(row, body.mirrored, body.heading_deg + turn)

    def sprite_turn_deg(self, frame: Mask, number: Rows) -> Floats:
        """Return by how much [°] sprites (…) turn until the film's next frame; 0 for frames.

        frame (…): whether a picture is a frame, else a sprite; number (…): of the sprite.
        """
        _row, _mirrored, _heading, turn = self._sprite_bodies
        return np.where(frame, 0.0, turn[np.where(frame, 0, number)])

    def are_near_in_film(self, first: Body, second: Body, frames: int) -> Mask:
        """Return which pairs of bodies (…) are at most `frames` apart in one track of the film.

        Both bodies of a pair, or none, must be mirrored.
        """
        track = np.append(0, np.cumsum(~self.goes_on[:-1]))  # number of each row's track
        near = np.abs(first.row - second.row) <= frames
        same_track = track[first.row] == track[second.row]
        return near & same_track & (first.mirrored == second.mirrored)

    def codes(self, body: Body) -> Floats:
        """Return the pose codes (…, c), principal-component scores, of bodies as drawn."""
        return self._mirror_codes(self.poses.codes[body.row], body.mirrored)

    def code_velocity(self, body: Body) -> Floats:
        """Return the change per frame of each of c pose codes, signed, of bodies (…): (…, c).

        For a mirrored body it is that of the mirrored codes.
        """
        return self._mirror_codes(self._code_velocities[body.row], body.mirrored)

    def _mirror_codes(self, codes: Floats, mirrored: Mask) -> Floats:
        """Mirror those pose codes (…, c) that a mask (…) marks; return all codes."""
        return np.where(mirrored[..., None], codes @ self.poses.shapes.mirror_matrix, codes)


def resting_rows(bodies: Bodies, share: float) -> Mask:
    """Return the rows, as a mask (n,), at which the animal rests: it keeps place and posture.

    There the centre and the body about it move, since the row before, less than `share` of the
    film's root mean square movement. Nothing may move the fish there: a picture that stays the same
    and drifts looks false.
    """
    pose, same_track = bodies.poses.pose, bodies.goes_on[:-1]
    step = np.hypot(np.diff(pose.x_px), np.diff(pose.y_px)) / pose.size_px[1:]
    squared_movement = step**2 + bodies.movement.whole**2
    rests = np.zeros(len(bodies.goes_on), bool)
    if same_track.any():
        rests[1:] = same_track & (squared_movement < share**2 * squared_movement[same_track].mean())
    return rests
