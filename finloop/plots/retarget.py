"""Picture of `retarget`: requested lines and drawn backbones at some moments."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Picture, Points
from finloop.base.schema import lists_to_points
from finloop.base.stretches import spread_rows
from finloop.plots.parts import INK, Colour, convert_to_colour, join_in_rows, write_text
from finloop.render.painter import Painter, PlacedFish

_REQUESTED, _DRAWN = (86, 180, 233), (213, 94, 0)  # RGB, Okabe-Ito
_HALO = (255, 255, 255)
_COLUMNS, _TILE_PX = 4, 300  # tiles in a row, and their width
MOMENTS = 11  # spread over the track; one more, the last, is the worst


def choose_ticks_to_draw(requested: pd.DataFrame) -> list[int]:
    """Return at most MOMENTS ticks, spread over the track, and then that of the largest error.

    requested: columns of `retarget.ASKED`, a row per tick. Its column apart is the error, NaN where
    nothing is requested; without any error the last tick is left out.
    """
    spread = spread_rows(np.arange(len(requested)), MOMENTS).tolist()
    errors = requested["apart"].to_numpy(float)
    return [*spread, int(np.nanargmax(errors))] if np.isfinite(errors).any() else spread


def draw_backbones(
    requested: pd.DataFrame, ticks: Sequence[int], fish: Iterable[PlacedFish], painter: Painter,
    size_px: int,
) -> Picture:  # fmt: skip
    """Return a picture (h, w, 3) of one tile per tick, with fish, requested points and backbone.

    The points are wide and blue, the backbone red. requested: columns of `retarget.ASKED`, a row
    per tick. fish: where to draw it at these ticks. size_px: width of a tile in the tank.
    """
    tiles = []
    for tick, placed in zip(ticks, fish, strict=True):
        painter.show(placed)
        # The part of the tank around the fish, enlarged to a tile, with both lines.
        row = requested.iloc[[tick]]
        wanted, drawn = (lists_to_points(row, name)[0].astype(float) for name in ("asked", "drawn"))
        corner = np.array([placed.x_px, placed.y_px]) - size_px / 2  # the fish is in the middle
        scale = _TILE_PX / size_px
        to_tile = np.column_stack([scale * np.eye(2), -scale * corner])
        tile = cv2.warpAffine(
            convert_to_colour(painter.frame), to_tile, (_TILE_PX, _TILE_PX), flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        _draw_line(tile, scale * (wanted - corner), _REQUESTED, width=5)
        _draw_line(tile, scale * (drawn - corner), _DRAWN, width=1)
        error = float(row["apart"].iloc[0])
        text = f"{row['file_s'].iloc[0]:.2f} s"
        text += "" if np.isnan(error) else f", {100 * error:.1f} % off"
        for colour, stroke in ((_HALO, 4), (INK, 1)):
            write_text(tile, text, (6, 16), colour, font_scale=0.45, stroke_px=stroke)
        tiles.append(tile)
    return np.vstack(join_in_rows(tiles, _COLUMNS))


def _draw_line(tile: Picture, points: Points, colour: Colour, width: int) -> None:
    """Draw a line into a tile, in place, through points (n, 2); one point becomes a dot.

    width: px.
    """
    sixteenths = np.round(16 * points).astype(np.int32)  # of a pixel, for cv2's shift=4
    if len(sixteenths) == 1:
        place = tuple(sixteenths[0].tolist())
        cv2.circle(tile, place, 16 * width, colour, cv2.FILLED, cv2.LINE_AA, shift=4)
    else:
        cv2.polylines(tile, [sixteenths], False, colour, width, cv2.LINE_AA, shift=4)
