"""Film and modes side by side: a panel each, the camera on the fish, coloured by what is shown."""

from collections.abc import Iterator, Mapping

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Picture
from finloop.edit.measures import picture_kinds
from finloop.edit.schema import filmed_edit_list
from finloop.render.gallery import Gallery, place_rows
from finloop.render.marks import COLOURS, rgb_from_hex, write_text
from finloop.render.painter import Painter

WORDS_PX = 40
"""Height of the text below a panel."""
_AROUND = 1.25  # body lengths that a panel shows on every side of the fish


def longest_tracks_edit_list(track: Ints, places: Floats, ticks: int) -> pd.DataFrame:
    """Return an edit list of at most `ticks` ticks that shows the film's longest tracks in turn.

    track (n,): number of the track of each row of the film; places (n, 2): x, y px.
    """
    _, first, count = np.unique(track, return_index=True, return_counts=True)
    longest_first = np.argsort(-count, kind="stable")
    tracks = [np.arange(first[index], first[index] + count[index]) for index in longest_first]
    rows = np.concatenate(tracks)[:ticks]
    return filmed_edit_list(rows, places[rows])


def draw_side_by_side(
    edits: Mapping[str, pd.DataFrame], gallery: Gallery, floor: Picture, length_px: float, size: int
) -> Iterator[Picture]:
    """Draw edit lists of one fish side by side: yield a picture (h, w, 3) uint8 for each tick.

    edits: by the title below each, all equally long; floor: the empty tank, (H, W) or (H, W, 3)
    uint8; length_px: body length of the fish; size: width and height of a panel, px. A panel
    follows the fish; below it are its title and what it shows. h is size + WORDS_PX, w is size ·
    lists.
    """
    half_px = _AROUND * length_px
    panel_films = [_draw_panels(edit, gallery, floor, half_px, size) for edit in edits.values()]
    for panels in zip(*panel_films, strict=True):
        frame = np.full((size + WORDS_PX, len(edits) * size, 3), 255, np.uint8)
        for number, (title, (picture, name)) in enumerate(zip(edits, panels, strict=True)):
            left = number * size
            frame[:size, left : left + size] = picture  # below it a bar, 6 px high
            frame[size : size + 6, left : left + size] = rgb_from_hex(COLOURS[name])
            black, grey = (0, 0, 0), (90, 90, 90)
            write_text(frame, title, (left + 8, size + 22), black, size=15, weight=700)
            write_text(frame, name, (left + 8, size + 36), grey, size=12)
        yield frame


def _draw_panels(
    edit: pd.DataFrame, gallery: Gallery, floor: Picture, half_px: float, size: int
) -> Iterator[tuple[Picture, str]]:
    """Yield, for each tick, a square picture around the fish and the name of what it shows.

    floor: the empty tank; half_px: how far a panel shows it on each side of the fish, px of the
    tank; size: side of a panel, px.
    """
    painter, names = Painter(floor, colour=True), picture_kinds(edit)
    for fish, name in zip(place_rows(edit, gallery), names, strict=True):
        painter.show(fish)
        middle = (size - 1) / 2
        zoom = middle / half_px
        to_panel = np.array([  # puts the fish into the middle
            [zoom, 0, middle - zoom * fish.x_px], [0, zoom, middle - zoom * fish.y_px],
        ])  # fmt: skip
        panel = cv2.warpAffine(
            painter.frame, to_panel, (size, size), flags=cv2.INTER_AREA,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        yield panel, str(name)
