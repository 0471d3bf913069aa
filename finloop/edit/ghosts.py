"""Ghosts: cross-faded ticks that look like neither of their two pictures, but like both at once.

Four numbers say how a picture looks: the logarithms of the visible area, of the contrast (mean
difference from the empty tank) and of the texture (SD of fine detail within the animal), and the
share of the area that is half transparent, its outermost pixels left out. A tick is a ghost if one
of them lies beyond both pictures by more than the film's 99.5th percentile from frame to frame.
"""

from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.stretches import spread_rows
from finloop.distance.picture import FILM
from finloop.edit.pictures import Picture, Pictures, draw_edit_list

LOOKS = ("area", "contrast", "texture", "half_transparent")
"""The numbers that say how a picture looks, in their order."""

_VISIBLE, _OPAQUE, _SOLID = 0.1, 0.8, 0.9  # alpha
_DETAIL = 3.0  # px, SD of the blur that takes the fine detail away
_FAINT = 1e-3  # of the range of grey levels: contrast and texture below count as equal
_QUANTILE, _PAIRS = 0.995, 400  # of the film; most pairs of its frames that are measured


class GhostTicks(NamedTuple):
    """How far cross-faded ticks (k,) look beyond both their pictures, and how far the film allows.

    tick (k,); beyond (k, 4): 0 where a number of `LOOKS` lies between those of both pictures;
    limit (4,): the film's.
    """

    tick: NDArray[np.intp]
    beyond: Floats
    limit: Floats

    @property
    def is_ghost(self) -> NDArray[np.bool_]:
        """Return which of the ticks are ghosts, (k,)."""
        return np.asarray((self.beyond > self.limit).any(1))


def tank_colour(background: NDArray[np.uint8]) -> Floats:
    """Return the median colour (1 or 3,), 0 … 1, of an empty tank, (H, W) or (H, W, 3)."""
    height, width = background.shape[:2]
    return np.asarray(np.median(background.reshape(height * width, -1), axis=0) / 255)


def measure_look(picture: Picture, ground: Floats) -> Floats:
    """Return how a picture looks (4,): area, contrast, texture, half-transparent share (`LOOKS`).

    picture (size, size, channels): 0 … 1, premultiplied; ground (channels − 1,): the colour of the
    empty tank, 0 … 1.
    """
    alpha = picture[..., -1]
    visible = alpha > _VISIBLE
    area = max(int(visible.sum()), 1)
    apart = np.abs(picture[..., :-1] - alpha[..., None] * ground.astype(np.float32)).mean(-1)
    inside = cv2.erode(visible.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    solid, grey = (alpha > _SOLID).astype(np.float32), picture[..., :-1].mean(-1)
    around = cv2.GaussianBlur(grey * solid, (0, 0), _DETAIL) / np.maximum(
        cv2.GaussianBlur(solid, (0, 0), _DETAIL), _FAINT
    )
    detail = (grey - around)[solid > 0]
    logs = [
        area,
        apart[visible].sum() / area + _FAINT,
        (detail.std() if detail.size else 0) + _FAINT,
    ]
    return np.append(np.log(logs), (inside & (alpha < _OPAQUE)).sum() / area)


def measure_ghosts(edit: pd.DataFrame, pictures: Pictures, ground: Floats) -> GhostTicks:
    """Return how far the cross-faded ticks of an edit list look beyond both their pictures.

    ground: the colour of the empty tank, 0 … 1.
    """
    fades = edit[edit["weight"] > 0]
    shown = fades, fades.assign(weight=0.0), fades.assign(weight=1.0)  # both, and each alone
    looks = np.array([
        [measure_look(picture, ground) for picture in drawn]
        for drawn in zip(*(draw_edit_list(rows, pictures) for rows in shown), strict=True)
    ]).reshape(-1, 3, len(LOOKS))  # fmt: skip
    drawn, low, high = looks[:, 0], looks[:, 1:].min(1), looks[:, 1:].max(1)
    beyond = np.maximum(np.maximum(drawn - high, low - drawn), 0)
    beyond[:, -1] = np.maximum(drawn - high, 0)[:, -1]  # less half transparent is no ghost
    return GhostTicks(fades["tick"].to_numpy(), beyond, film_look_changes(pictures, ground))


def film_look_changes(pictures: Pictures, ground: Floats) -> Floats:
    """Return the 99.5th percentile (4,) of how `LOOKS` change from frame to frame of the film.

    ground: the colour of the empty tank, 0 … 1.
    """
    reel = pictures.reel
    rows = spread_rows(np.flatnonzero(reel.has_next_frame), _PAIRS)
    if not len(rows):
        return np.full(len(LOOKS), np.inf)
    looks = [
        [measure_look(reel.draw_rows(np.array([row]), pictures.size, FILM)[0], ground)
         for row in (first, first + 1)]
        for first in rows
    ]  # fmt: skip
    return np.asarray(np.quantile(np.abs(np.diff(looks, axis=1)[:, 0]), _QUANTILE, axis=0))
