"""Film and modes side by side: a panel each, the camera on the fish, coloured by what is shown."""

from collections.abc import Iterator, Mapping

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Picture
from finloop.edit.measures import picture_kinds
from finloop.edit.schema import filmed_edit_list
from finloop.render.gallery import Gallery, fish_by_row
from finloop.render.living import LivingTank
from finloop.render.marks import COLOURS, rgb_from_hex, write_text
from finloop.render.painter import Painter

CAPTION_PX = 40
"""Height of the text below a panel."""
_AROUND = 1.25  # body lengths that a panel shows on every side of the fish


def longest_tracks_edit_list(track: Ints, places: Floats, ticks: int) -> pd.DataFrame:
    """Return an edit list of at most `ticks` ticks that shows the film's longest tracks in turn.

    track (n,): number of the track of each row of the film, ascending; places (n, 2): x, y px.
    """
    _, first, count = np.unique(track, return_index=True, return_counts=True)
    longest_first = np.argsort(-count, kind="stable")
    tracks = [np.arange(first[index], first[index] + count[index]) for index in longest_first]
    rows = np.concatenate(tracks)[:ticks]
    return filmed_edit_list(rows, places[rows])


def draw_side_by_side(
    edits: Mapping[str, pd.DataFrame], gallery: Gallery, floor: Picture, length_px: float,
    size: int, tank: LivingTank | None = None,
) -> Iterator[Picture]:  # fmt: skip
    """Yield, for each tick, a picture (h, w, 3) uint8 of several edit lists side by side.

    edits: each of one fish, by the title below its panel, all equally long; floor: the empty tank,
    (H, W) or (H, W, 3) uint8; length_px: body length of the fish; size: width and height of a
    panel, px; tank: how it lives, None = not at all. A panel follows the fish; below it are its
    title and the kind of picture that it shows, such as "film". h is size + CAPTION_PX, w is size
    times the number of edit lists.
    """
    half_px = _AROUND * length_px
    panel_films = [
        _draw_panels(edit, gallery, floor, half_px, size, tank) for edit in edits.values()
    ]
    for panels in zip(*panel_films, strict=True):
        frame = np.full((size + CAPTION_PX, len(edits) * size, 3), 255, np.uint8)
        for number, (title, (picture, kind)) in enumerate(zip(edits, panels, strict=True)):
            x = number * size  # of the panel's left edge
            frame[:size, x : x + size] = picture  # below it a bar, 6 px high
            frame[size : size + 6, x : x + size] = rgb_from_hex(COLOURS[kind])
            black, grey = (0, 0, 0), (90, 90, 90)
            write_text(frame, title, (x + 8, size + 22), black, size=15, weight=700)
            write_text(frame, kind, (x + 8, size + 36), grey, size=12)
        yield frame


def _draw_panels(
    edit: pd.DataFrame, gallery: Gallery, floor: Picture, half_px: float, size: int,
    tank: LivingTank | None,
) -> Iterator[tuple[Picture, str]]:  # fmt: skip
    """Yield a square panel for each tick of an edit list, and the kind of the picture shown.

    The kind is a key of `COLOURS`, such as "film". half_px: how far a panel shows the tank on each
    side of the fish; size: side of a panel, px.
    """
    painter, kinds = Painter(floor, colour=True, tank=tank), picture_kinds(edit)
    middle = (size - 1) / 2
    zoom = middle / half_px
    for tick, (fish, kind) in enumerate(zip(fish_by_row(edit, gallery), kinds, strict=True)):
        painter.show(fish, tick=tick)
        to_panel = np.array([  # puts the fish into the middle
            [zoom, 0, middle - zoom * fish.x_px], [0, zoom, middle - zoom * fish.y_px],
        ])  # fmt: skip
        panel = cv2.warpAffine(
            painter.frame, to_panel, (size, size), flags=cv2.INTER_AREA,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        yield panel, str(kind)
