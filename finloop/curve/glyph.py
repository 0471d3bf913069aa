"""Outlines of letters and digits, as curves to try things on: matplotlib's own DejaVu Sans."""

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from finloop.base.drawing import clean_curve
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve

FONT = "DejaVu Sans"


def glyph(character: str, size: float = 1000.0) -> list[Curve]:
    """The closed contours of a character, y down, the baseline at 0; `size`: of the font's em.

    Splines are cut into segments of about a unit, so that a larger size is smoother. FinloopError
    if it is not one character with an outline.
    """
    if len(character) != 1:
        raise FinloopError(
            f"{character!r} was asked as a glyph", "one character", "ask for one at a time"
        )
    outlines = []
    if character.isprintable() and not character.isspace():  # TextPath fails without an outline
        path = TextPath((0, 0), character, size=size, prop=FontProperties(family=FONT))
        outlines = path.to_polygons()
    if not outlines:
        raise FinloopError(
            f"{character!r} has no outline", "a letter, a digit, a sign", "ask for another one"
        )
    # On a screen y is down.
    return [clean_curve(Curve(np.array(o, float) * (1, -1), True), character) for o in outlines]
