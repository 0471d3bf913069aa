"""DRAWN: the state of a fish as the display's page draws it, one array of numbers.

The page's drawing depends on these numbers and the pictures alone. The first numbers are `FIELDS`,
the posture follows (`finloop.puppet.pose`). x, y: px of the tank's picture, y down; heading:
radians, anticlockwise as seen; size: px. picture, partner: rows of the film, -1 = none; weight: the
partner's share; mirrored: 1 where the film's left is drawn as right. look: the number of a look;
alpha: 0 … 1. All are float32, which holds every row of a film of some hours exactly.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.edit.bodies import Bodies, Body
from finloop.edit.schema import FRAME, row_partner, row_picture

FIELDS = (
    "x_px", "y_px", "heading_rad", "size_px", "picture", "partner", "weight", "mirrored",
    "partner_mirrored", "look", "alpha",
)  # fmt: skip
X, Y, HEADING, SIZE, PICTURE, PARTNER, WEIGHT, MIRRORED, PARTNER_MIRRORED, LOOK, ALPHA = range(11)
POSTURE = len(FIELDS)

FILM_LOOK: dict[str, Any] = {"as": "fish", "contrast": 1.0, "size": 1.0, "colour": None}
"""The look, as pages read it, of fish that are drawn as filmed."""

States = NDArray[np.float32]
"""States (…, fields) of fish, or (ticks, fish, fields) of a motion."""


def drawn_states(rows: Sequence[Any], bodies: Bodies) -> States:
    """Return the states (fish, fields) from which the display's page draws the fish at one tick.

    rows: one for each fish, of an edit list or of the live tank. A picture drawn as filmed has the
    film's posture, two cross-faded ones a mixed posture, and a fish with its own pose code
    (`row.pose`) that of the code.
    """
    mixed = np.array([row.weight > 0 for row in rows], bool)
    body = _picture_bodies(rows, bodies, np.zeros_like(mixed))
    partner = _picture_bodies(rows, bodies, mixed)
    weight = np.where(mixed, [row.weight for row in rows], 0.0)
    codes, partner_codes = bodies.codes(body), bodies.codes(partner)
    codes = codes + weight[:, None] * (partner_codes - codes)
    for number, row in enumerate(rows):
        if row.pose is not None:
            codes[number] = row.pose
    posture = bodies.poses.shapes.decode(codes)
    states = np.empty((len(rows), POSTURE + posture.shape[1]), np.float32)
    states[:, X] = [row.x_px for row in rows]
    states[:, Y] = [row.y_px for row in rows]
    states[:, HEADING] = np.radians(body.heading_deg)
    states[:, SIZE] = bodies.poses.pose.size_px[body.row] * [row.scale for row in rows]
    states[:, PICTURE], states[:, MIRRORED] = body.row, body.mirrored
    states[:, PARTNER] = np.where(mixed, partner.row, -1)
    states[:, PARTNER_MIRRORED] = partner.mirrored & mixed
    states[:, WEIGHT], states[:, LOOK], states[:, ALPHA] = weight, 0, 1
    states[:, POSTURE:] = posture
    return states


def _picture_bodies(rows: Sequence[Any], bodies: Bodies, of_partner: NDArray[np.bool_]) -> Body:
    """Return the filmed bodies in the pictures (film frames or sprites) of n edit-list rows.

    of_partner (n,): true for the picture to cross-fade with, false for the main one.
    """
    pictures = [
        row_partner(row) if is_partner else row_picture(row)
        for row, is_partner in zip(rows, of_partner, strict=True)
    ]
    is_frame = np.array([picture.kind == FRAME for picture in pictures], bool)
    turn_deg = np.array([picture.rotation_deg for picture in pictures], float)
    for number in np.flatnonzero(~is_frame):  # a sprite is turned to its orientation first
        orientation = int(pictures[number].orientation)
        turn_deg[number] += float(bodies.sprite_direction_deg(orientation, 0.0))
    sources = np.array([picture.source for picture in pictures], np.intp)
    mirrored = np.array([picture.mirrored for picture in pictures], bool)
    return bodies.picture_bodies(is_frame, sources, turn_deg, mirrored)
