"""Outlines of letters and digits from matplotlib's fonts, as test curves."""

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from finloop.base.drawing import clean_curve
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve

FONT = "DejaVu Sans"
SIZE = 1000.0  # side of the em square (the height of a line): segments are about 1 long


def glyph_outlines(character: str, font: str = FONT) -> list[Curve]:
    """Return the closed contours of a character's outline; y is down, the baseline at y = 0.

    The unit is 1 / SIZE of a line's height. font: a family that matplotlib brings. FinloopError if
    `character` is not a single character with an outline.
    """
    if len(character) != 1:
        raise FinloopError(
            f"the glyph {character!r}", "one character", "pass one character at a time"
        )
    outlines = []
    if character.isprintable() and not character.isspace():  # TextPath fails without an outline
        path = TextPath((0, 0), character, size=SIZE, prop=FontProperties(family=font))
        outlines = path.to_polygons()
    if not outlines:
        raise FinloopError(
            f"{character!r} has no outline", "a letter, digit or sign", "choose another character"
        )
    y_down = (1, -1)  # matplotlib's y is up
    return [
        clean_curve(Curve(np.array(outline, float) * y_down, closed=True), character)
        for outline in outlines
    ]
