"""Contact sheet of the sprites and their pivots."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pandas as pd

from finloop.base.cutout import Cutout
from finloop.features.table import count_orientations, orientation_heading_deg
from finloop.plots.parts import Picture, join_in_rows, lay_on_grey, write_text

_INK = (150, 30, 30)


def draw_sprites(
    sprites: pd.DataFrame,
    pictures: Callable[[int, int], Cutout],
    columns: int = 12,
    size: int = 150,
) -> Picture:
    """Draw every sprite in orientation 1, and the most bent sprite in all orientations.

    pictures(sprite, orientation): returns the stored cut-out, orientations counted from 1. A cross
    marks the pivot. columns: tiles per row. size: width of a tile in px. Returns (h, w, 3).
    """
    count = count_orientations(sprites)
    reach = 1
    for row in sprites.itertuples():
        for cutout in (pictures(row.sprite, 1), pictures(row.sprite, 1 + count // 4)):
            h, w = cutout.pixels.shape[:2]
            x, y = row.x_px - cutout.x0_px, row.y_px - cutout.y0_px
            reach = max(reach, 1 + int(np.ceil(max(x, y, w - x, h - y))))

    def draw_orientation(row: Any, orientation: int, above: str, below: str) -> Picture:
        return _draw_tile(pictures(row.sprite, orientation), row, reach, size, above, below)

    bands = []
    for word, rows in sprites.groupby("sequence", sort=False):
        tiles = []
        for row in rows.itertuples():
            motion = f"a {row.motion_area_rel:.2f} {row.turn_deg:+.0f} deg"
            above, below = f"{word} {row.step} {row.phase}", f"{row.track_id}:{row.frame} {motion}"
            tiles.append(draw_orientation(row, 1, above, below))
        bands += join_in_rows(tiles, columns)
    row = next(sprites.iloc[[int(sprites["motion_area_rel"].argmax())]].itertuples())
    turns = {
        orientation: f"{orientation_heading_deg(orientation, count):.0f} deg"
        for orientation in range(1, count + 1)
    }
    tiles = [
        draw_orientation(row, orientation, f"orientation {orientation}", angle)
        for orientation, angle in turns.items()
    ]
    return np.vstack([*bands, *join_in_rows(tiles, columns)])


def _draw_tile(cutout: Cutout, row: Any, reach: int, size: int, above: str, below: str) -> Picture:
    """Draw a cut-out in a tile, `size` px wide, with its pivot in the middle.

    row: of the table of sprites. reach: px of the film from the middle to the tile's edge. above,
    below: texts.
    """
    scale = size / (2 * reach)
    x, y = row.x_px - cutout.x0_px, row.y_px - cutout.y0_px
    matrix = np.array([[scale, 0, size / 2 - scale * x], [0, scale, size / 2 - scale * y]])
    pixels = cutout.pixels.astype(np.float32)
    big = np.clip(cv2.warpAffine(pixels, matrix, (size, size), flags=cv2.INTER_CUBIC), 0, 255)
    tile = lay_on_grey(big[..., :-1], big[..., -1:] / 255)
    middle = size // 2
    cv2.drawMarker(tile, (middle, middle), (255, 255, 255), cv2.MARKER_CROSS, 5, 1)
    cv2.rectangle(tile, (0, 0), (size - 1, size - 1), (225,) * 3, 1)
    for text, y in ((above, 12), (below, size - 5)):
        write_text(tile, text, (4, y), _INK, 0.32)
    return tile
