"""The backbone and the half widths of one fish at every tick of an edit list.

A picture of an edit list is a frame of the film or a sprite, and a sprite is a frame of the film,
turned and perhaps mirrored. So every tick has one backbone of the film, or in a cross-fade two,
which are mixed by their weight as the pictures are (`finloop.render.painter`). Where the edit list
has a pose, the backbone is bent by the difference between that pose and the filmed one.

Coordinates of the tank are px of the film with y up (−y of the film) and z above the floor; angles
anticlockwise as seen from above. A backbone runs from head to tail, relative to the mass centre.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Reals
from finloop.base.schema import lists_to_array, lists_to_points
from finloop.edit.bodies import Bodies
from finloop.edit.schema import FRAME, SPRITE, row_picture
from finloop.features.head import begins_at_tail
from finloop.features.table import count_orientations, orientation_heading_deg

Rows = NDArray[np.intp]

_SHIFT_S = 4.1  # between the height curves of successive fish
USED = ("x_px", "y_px", "backbone_x_px", "backbone_y_px", "half_width_px")
"""The columns of a table of tracks from which bodies are made."""


@dataclass(frozen=True)
class FilmBodies:
    """Backbones and half widths of all fish of a film, n rows, about their mass centres, y up.

    backbone: (n, p, 2) px, head first; half_width: (n, p) px; heading_deg: (n,).
    """

    backbone: Reals
    half_width: Reals
    heading_deg: Reals


class BodyPlacement(NamedTuple):
    """Which filmed body is shown at each tick, and how: mirrored, turned and scaled, each (ticks,).

    row: of the film; turn_deg: anticlockwise, after mirroring; axis_deg: direction of the line
    through the mass centre about which a mirrored body is reflected.
    """

    row: Rows
    turn_deg: Reals
    scale: Reals
    mirrored: NDArray[np.bool_]
    axis_deg: Reals


@dataclass(frozen=True)
class TankPoses:
    """Places, backbones and half widths of one fish at every tick, in coordinates of the tank.

    centre (ticks, 2): px, mass centre; backbone (ticks, p, 2): px, relative to it; half_width
    (ticks, p): px; heading (ticks,): rad, without jumps of 2π; first, second: the filmed bodies
    whose skins it wears; weight (ticks,): share of the second.
    """

    centre: Reals
    backbone: Reals
    half_width: Reals
    heading: Reals
    first: BodyPlacement
    second: BodyPlacement
    weight: Reals

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.centre)


def film_body_shapes(tracks: pd.DataFrame, features: pd.DataFrame) -> FilmBodies:
    """Return the backbones and half widths of all fish of a film, about their mass centres.

    Backbones are head first, y up. tracks: columns `USED`, n rows; features: columns head and
    heading_deg of the same rows.
    """
    line = lists_to_points(tracks, "backbone").astype(float)
    half_width = lists_to_array(tracks["half_width_px"]).astype(float)
    backwards = begins_at_tail(line, features)
    line[backwards], half_width[backwards] = line[backwards, ::-1], half_width[backwards, ::-1]
    local = line - tracks[["x_px", "y_px"]].to_numpy(float)[:, None]
    return FilmBodies(local * (1, -1), half_width, features["heading_deg"].to_numpy(float))


def poses_in_tank(
    edit: pd.DataFrame, film: FilmBodies, sprites: pd.DataFrame, bodies: Bodies | None = None
) -> TankPoses:
    """Return backbone, half widths, heading and skins of a fish at every tick of its edit list.

    edit: schema EDIT, of one fish; sprites: schema SPRITES, or empty; bodies: the film's postures,
    by which the backbone is bent at ticks with a pose; None if no tick has one.
    """
    first = _find_shown_bodies(edit, "", "source", film, sprites)
    partner = _find_shown_bodies(edit, "partner_", "partner", film, sprites)
    weight = edit["weight"].to_numpy(float)
    # Without a cross-fade the second body is the first one.
    second = BodyPlacement(*(
        np.where(weight > 0, of_partner, of_first)
        for of_first, of_partner in zip(first, partner, strict=True)
    ))  # fmt: skip
    first_line, first_width = _place_bodies(film, first)
    second_line, second_width = _place_bodies(film, second)
    share = weight[:, None]
    line = first_line + share[..., None] * (second_line - first_line)
    if bodies is not None:
        for tick in np.flatnonzero(edit["pose"].notna()):
            line[tick] = _posed_backbone(edit.iloc[tick], film, bodies)
    return TankPoses(
        centre=edit[["x_px", "y_px"]].to_numpy(float) * (1, -1), backbone=line,
        half_width=first_width + share * (second_width - first_width),
        heading=np.unwrap(np.radians(edit["heading_deg"].to_numpy(float))),
        first=first, second=second, weight=weight,
    )  # fmt: skip


def _posed_backbone(row: Any, film: FilmBodies, bodies: Bodies) -> Reals:
    """Return the backbone (p, 2) px of a fish whose pose in an edit-list row was not filmed.

    As the filmed posture becomes the unfilmed one, each point of the film's backbone moves like the
    posture's point at the same arc length from the head. All lines are compared headed right, with
    the mass centre at (0, 0) and y up.
    """
    body = bodies.body_in_edit_row(row_picture(row))
    film_row, to_side = int(body.row), (1, -1 if body.mirrored else 1)
    line = film.backbone[film_row] @ _rotation_matrices(-film.heading_deg[film_row]).T * to_side
    # The posture's points are fewer than the backbone's; y is down in them.
    filmed = bodies.poses.pose[film_row]
    filmed = filmed.move_to(0, 0, 0, filmed.size_px)
    posed = bodies.poses.pose_from_codes(film_row, row.pose).move_to(0, 0, 0, filmed.size_px)
    filmed_line = filmed.backbone_px() * (1, -1) * to_side
    change = posed.backbone_px() * (1, -1) - filmed_line
    filmed_arc, arc = _arc_length_to_points(filmed_line), _arc_length_to_points(line)
    line += np.column_stack([np.interp(arc, filmed_arc, values) for values in change.T])
    return row.scale * line @ _rotation_matrices(float(body.heading_deg)).T


def _rotation_matrices(angle_deg: float | Reals) -> Reals:
    """Return matrices (…, 2, 2) that turn vectors (y up) anticlockwise by angles (…) [degrees]."""
    angle = np.radians(angle_deg)
    return _stack_matrices(np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle))


def _arc_length_to_points(line: Reals) -> Reals:
    """Return the length (p,) of a line (p, 2) from its first point to each of its points."""
    return np.append(0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))


def _find_shown_bodies(
    edit: pd.DataFrame, prefix: str, source_column: str, film: FilmBodies, sprites: pd.DataFrame
) -> BodyPlacement:
    """Return which filmed body the main or partner picture of each tick shows, and its placement.

    Where a tick has no partner, row 0 of the film stands in. prefix, source_column: "" and "source"
    for the main picture, "partner_" and "partner" for the one to cross-fade with.
    """
    source = edit[source_column].fillna(0).to_numpy(int)
    turn = edit[f"{prefix}rotation_deg"].fillna(0).to_numpy(float).copy()
    scale = edit[f"{prefix}scale"].fillna(1).to_numpy(float)
    kind = edit[f"{prefix}kind"].fillna(FRAME)
    is_sprite = (kind == SPRITE).to_numpy()
    row = np.where(is_sprite, 0, source)
    # axis: the filmed heading, about which a mirrored body is reflected.
    axis, mirrored = film.heading_deg[row], edit[f"{prefix}mirrored"].to_numpy(bool, copy=True)
    if is_sprite.any():
        shown = sprites.iloc[source[is_sprite]]
        row[is_sprite] = shown["row"]
        axis[is_sprite], mirrored[is_sprite] = shown["heading_deg"], shown["mirrored"]
        orientation = edit[f"{prefix}orientation"][is_sprite].to_numpy(int)
        # A sprite is turned from its heading in the film to its orientation, and then further.
        turn[is_sprite] += (
            orientation_heading_deg(orientation, count_orientations(sprites)) - axis[is_sprite]
        )
    return BodyPlacement(row.astype(np.intp), turn, scale, mirrored, axis)


def _place_bodies(film: FilmBodies, placement: BodyPlacement) -> tuple[Reals, Reals]:
    """Return the backbones (ticks, p, 2) and half widths (ticks, p), px, of the placed bodies.

    Filmed bodies are mirrored, turned and scaled about their mass centres.
    """
    line = film.backbone[placement.row]
    # A reflection about a line at the angle α has the matrix ((cos 2α, sin 2α), (sin 2α, −cos 2α)).
    twice = 2 * np.radians(placement.axis_deg)
    mirror = _stack_matrices(np.cos(twice), np.sin(twice), np.sin(twice), -np.cos(twice))
    line = np.where(placement.mirrored[:, None, None], line @ mirror.swapaxes(1, 2), line)
    turn = _rotation_matrices(placement.turn_deg)
    scale = placement.scale[:, None]
    return scale[..., None] * (line @ turn.swapaxes(1, 2)), scale * film.half_width[placement.row]


def _stack_matrices(a: Reals, b: Reals, c: Reals, d: Reals) -> Reals:
    """Return matrices ((a, b), (c, d)), (…, 2, 2), from arrays (…) of their entries."""
    return np.stack([np.stack([a, b], -1), np.stack([c, d], -1)], -2)


def swimming_heights(time_s: Reals, depth: float, fish: int = 0) -> Reals:
    """Return a fish's height above the floor at each tick, (ticks,) px; the height is invented.

    The film does not show it; it changes slowly. time_s (ticks,): times of the ticks; depth: of the
    water, px; fish: its number, which shifts the changes in time.
    """
    shifted_s = time_s + _SHIFT_S * fish
    slow, slower = (np.sin(2 * np.pi * shifted_s / period) for period in (7.3, 17.0))  # s
    return depth * (0.5 + 0.13 * slower + 0.05 * slow)
