"""Pictures of sprites, and of what the film shows after them: centred, of one size (Eq. 5)."""

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.cutout import Cutouts
from finloop.distance.picture import picture
from finloop.features.table import direction_deg, orientations_of

_SOLID = 64  # alpha from which a pixel belongs to the fish

Floats = NDArray[np.float64]


def pictures(
    sprites: pd.DataFrame, store: Cutouts, length_px: float, size: int, number: int = 1
) -> NDArray[np.float32]:
    """Every sprite (n, size, size, c) in the orientation `number`, at the drawn size."""
    count = orientations_of(sprites)
    return np.stack(
        [
            picture(store[at * count + number - 1], row, length_px / row.scale, size)
            for at, row in enumerate(sprites.itertuples())
        ]
    )


def following(
    sprites: pd.DataFrame, features: pd.DataFrame, film: Cutouts, length_px: float,
    size: int, number: int = 1,
) -> NDArray[np.float32]:  # fmt: skip
    """What the film shows after every sprite, turned as the sprite's next one would be.

    At the end of a track, where there is nothing, the frame itself.
    """
    places = list(features[["x_px", "y_px"]].itertuples(index=False))
    key = features[["track_id", "frame"]].to_numpy()
    goes_on = np.append((np.diff(key, axis=0) == (0, 1)).all(1), False)
    heading = float(direction_deg(number, orientations_of(sprites)))
    found = []
    for sprite in sprites.itertuples():
        row, turn = int(sprite.row), -sprite.heading_deg
        if goes_on[row]:
            row, turn = row + 1, turn - (-1 if sprite.mirrored else 1) * sprite.turn_deg
        # A mirrored one is turned to the right, mirrored there, and its mirror turned on.
        cutout, length = film[row], length_px / sprite.scale
        if sprite.mirrored:
            shown = picture(cutout, places[row], length, size, turn - heading)[::-1]
        else:
            shown = picture(cutout, places[row], length, size, turn + heading)
        found.append(shown)
    return np.stack(found)


def outlines(sprites: pd.DataFrame, store: Cutouts) -> list[Floats]:
    """The hull (k, 2) of every sprite, px from the mass centre at the drawn size: ahead, left."""
    found, count = [], orientations_of(sprites)
    for number, row in enumerate(sprites.itertuples()):
        cutout = store[number * count]
        solid = np.argwhere(cutout.pixels[..., -1] >= _SOLID)[:, ::-1].astype(np.float32)
        hull = cv2.convexHull(solid)[:, 0].astype(float)
        offset = hull + np.array([cutout.x0_px - row.x_px, cutout.y0_px - row.y_px])
        found.append(offset * np.array([row.scale, -row.scale]))
    return found
