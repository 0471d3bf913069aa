"""Contact sheet of the sprites and their pivots."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pandas as pd

from finloop.base.cutout import Cutout
from finloop.extract.matte import drop_residue
from finloop.features.table import count_orientations, orientation_heading_deg
from finloop.plots.parts import INK, Picture, composite_on_grey, join_in_rows, write_text


def draw_sprites(
    sprites: pd.DataFrame, load_cutout: Callable[[int, int], Cutout],
    columns: int = 12, size: int = 150,
) -> Picture:  # fmt: skip
    """Return a picture of every sprite in orientation 1, and of the most bent one in all of them.

    sprites: schema `SPRITES`. load_cutout(sprite, orientation): returns the stored cut-out,
    orientations counted from 1. A cross marks the pivot. columns: tiles per row. size: width of a
    tile, px. The picture is (h, w, 3).
    """
    count = count_orientations(sprites)
    reach = _farthest_from_pivot_px(sprites, load_cutout)  # all tiles have one scale

    def draw_orientation(row: Any, orientation: int, above: str, below: str) -> Picture:
        """Return a tile that shows a sprite in an orientation, with texts above and below."""
        return _draw_tile(load_cutout(row.sprite, orientation), row, reach, size, above, below)

    bands = []
    for sequence, rows in sprites.groupby("sequence", sort=False):
        tiles = []
        for row in rows.itertuples():
            above = f"{sequence} {row.step} {row.phase}"
            below = f"{row.track_id}:{row.frame} "
            below += f"a {row.motion_area_rel:.2f} {row.turn_deg:+.0f} deg"
            tiles.append(draw_orientation(row, 1, above, below))
        bands += join_in_rows(tiles, columns)
    most_bent = next(sprites.iloc[[int(sprites["motion_area_rel"].argmax())]].itertuples())
    tiles = []
    for orientation in range(1, count + 1):
        above = f"orientation {orientation}"
        below = f"{orientation_heading_deg(orientation, count):.0f} deg"
        tiles.append(draw_orientation(most_bent, orientation, above, below))
    return np.vstack([*bands, *join_in_rows(tiles, columns)])


def _farthest_from_pivot_px(
    sprites: pd.DataFrame, load_cutout: Callable[[int, int], Cutout]
) -> int:
    """Return the largest distance [px] along x or y from a pivot to an edge of its cut-out.

    Each sprite is measured in two orientations, a quarter turn apart. sprites, load_cutout: as in
    `draw_sprites`.
    """
    reach = 1
    for row in sprites.itertuples():
        for orientation in (1, 1 + count_orientations(sprites) // 4):
            cutout = load_cutout(row.sprite, orientation)
            height, width = cutout.pixels.shape[:2]
            x, y = row.x_px - cutout.x0_px, row.y_px - cutout.y0_px
            reach = max(reach, 1 + int(np.ceil(max(x, y, width - x, height - y))))
    return reach


def _draw_tile(cutout: Cutout, row: Any, reach: int, size: int, above: str, below: str) -> Picture:
    """Return a tile, `size` px wide, with a cut-out whose pivot is in the middle.

    row: of the table of sprites, with the pivot x_px, y_px. reach: px of the film from the middle
    to the tile's edge. above, below: texts.
    """
    scale = size / (2 * reach)
    x, y = row.x_px - cutout.x0_px, row.y_px - cutout.y0_px
    to_tile = np.array([[scale, 0, size / 2 - scale * x], [0, scale, size / 2 - scale * y]])
    pixels = drop_residue(cutout.pixels).astype(np.float32)
    scaled = np.clip(cv2.warpAffine(pixels, to_tile, (size, size), flags=cv2.INTER_CUBIC), 0, 255)
    tile = composite_on_grey(scaled[..., :-1], scaled[..., -1:] / 255)
    middle = size // 2
    white, grey = (255, 255, 255), (225, 225, 225)
    cv2.drawMarker(tile, (middle, middle), white, cv2.MARKER_CROSS, markerSize=5, thickness=1)
    cv2.rectangle(tile, (0, 0), (size - 1, size - 1), grey, thickness=1)
    write_text(tile, above, (4, 12), INK, font_scale=0.32)
    write_text(tile, below, (4, size - 5), INK, font_scale=0.32)
    return tile
