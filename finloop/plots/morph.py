"""Sheets of morphs: frames of a drawing side by side, one row per method (Figs. 4, 5)."""

from collections.abc import Mapping

import cv2
import numpy as np

from finloop.base.arrays import Picture
from finloop.base.drawing import Morph
from finloop.base.paint import group_contours, paint_layers

_COLUMNS, _SIZE = 9, 150  # frames in a row, and their width and height in px
_BAR = 22  # px above a row, for its name


def draw_morphs(morphs: Mapping[str, Morph]) -> Picture:
    """Return a picture (h, w, 3) with a row of frames for each morph, from its first to its last.

    morphs: by name. Above a row are its name and its number of folds: a contour meets itself.
    """
    rows = []
    for name, morph in morphs.items():
        side = max(morph.width, morph.height)
        tiles = []
        for frame in np.linspace(0, len(morph.tau) - 1, _COLUMNS).round().astype(int):
            shapes = group_contours(morph.closed, morph.paints_at(frame), side)
            contours = [
                (shape, [morph.layers[layer][frame] for layer in shape.layers]) for shape in shapes
            ]
            tiles.append(paint_layers(contours, (_SIZE, _SIZE), _SIZE / side))
        bar = np.full((_BAR, _SIZE * _COLUMNS, 3), 255, np.uint8)
        folds = sum(int(count.sum()) for count in morph.folds.values())
        text = f"{name}: {folds or 'no'} fold{'' if folds == 1 else 's'} in {len(morph.tau)} frames"
        cv2.putText(bar, text, (6, 16), (0, 0, 0), cv2.FontFace("sans"), 13)
        rows += [bar, np.hstack(tiles)]
    return np.vstack(rows)
