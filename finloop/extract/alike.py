"""Fish of one film drawn and measured like those of another: of one size, in one light.

Cut-outs are (h, w, channels) uint8, colour premultiplied by alpha, the last channel.
"""

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture
from finloop.base.cutout import Cutout

_OPAQUE = 250  # least alpha of a pixel that shows only the fish
# Smaller differences are ignored, because every resampling blurs: tracks of one zebrafish film
# differ by up to 8 % from its typical length, and its light drifts by 2 %, the carp's by 3 %.
_SAME_LENGTH, _SAME_LIGHT = 0.1, 0.05
_MOST_LIGHT = 3.0  # a larger gain would show noise instead of a fish


class Likeness(NamedTuple):
    """The change that makes a film's fish like those of the first film."""

    scale: float = 1.0  # factor on lengths
    gains: tuple[float, ...] = ()  # factor on each channel's light; none: as filmed
    grey: bool = False  # whether colours are dropped

    @property
    def none(self) -> bool:
        """Return whether the change leaves every fish as it is filmed."""
        return self == Likeness()


def levels(cutouts: Iterable[Cutout], grey: bool) -> Floats:
    """Return the median levels (channels,), 0 … 255, of the fish in cut-outs, grey or RGB.

    Only opaque pixels count. grey: convert colour to grey first, so there is one channel.
    """
    opaque = []
    for one in cutouts:
        pixels = as_grey(one.pixels) if grey else one.pixels
        opaque.append(pixels[pixels[..., -1] >= _OPAQUE][:, :-1])
    return np.median(np.concatenate(opaque), axis=0)


def likeness(
    length_px: float, first_length_px: float, light: Floats, first_light: Floats, grey: bool
) -> Likeness:
    """Return the change that makes fish of this length and light like those of the first film.

    light, first_light (channels,): as `levels` gives them; grey: whether colours are dropped.
    Differences that also occur within one film are ignored.
    """
    scale = first_length_px / length_px
    if abs(scale - 1) <= _SAME_LENGTH:
        scale = 1.0
    gains = np.clip(first_light / np.maximum(light, 1.0), 1 / _MOST_LIGHT, _MOST_LIGHT)
    same = bool((np.abs(gains - 1) <= _SAME_LIGHT).all())
    return Likeness(scale, () if same else tuple(gains.tolist()), grey)


def as_grey(pixels: Picture) -> Picture:
    """Return the pixels (h, w, 4) of a cut-out as grey and alpha (h, w, 2), uint8."""
    mono = cv2.cvtColor(np.ascontiguousarray(pixels[..., :-1]), cv2.COLOR_RGB2GRAY)
    return np.dstack([mono, pixels[..., -1]])


def match_cutout(one: Cutout, like: Likeness) -> Cutout:
    """Return a cut-out in the first film's size and light; its place is scaled about (0, 0)."""
    pixels = as_grey(one.pixels) if like.grey else one.pixels
    if like.gains:
        lit = pixels[..., :-1] * np.array(like.gains)
        lit = np.minimum(np.rint(lit), pixels[..., -1:]).astype(np.uint8)
        pixels = np.concatenate([lit, pixels[..., -1:]], axis=-1)
    if like.scale == 1.0:
        return one._replace(pixels=pixels)
    return _resample(one._replace(pixels=pixels), like.scale)


def _resample(one: Cutout, scale: float) -> Cutout:
    """Resample a cut-out on the first film's grid: pixel X shows what X / scale showed."""
    h, w = one.pixels.shape[:2]
    x0, y0 = (int(np.floor(scale * (start - 0.5))) for start in (one.x0_px, one.y0_px))
    x1, y1 = (
        int(np.ceil(scale * (start + size - 0.5))) + 1
        for start, size in ((one.x0_px, w), (one.y0_px, h))
    )
    pixels = one.pixels
    if scale < 1:  # avoids aliasing
        blur = 0.4 * float(np.sqrt(scale**-2 - 1))
        pixels = cv2.GaussianBlur(pixels, (0, 0), blur, borderType=cv2.BORDER_CONSTANT)
    to_film = np.array([
        [1 / scale, 0, x0 / scale - one.x0_px], [0, 1 / scale, y0 / scale - one.y0_px],
    ])  # fmt: skip
    how = cv2.INTER_LINEAR if scale < 1 else cv2.INTER_CUBIC
    drawn = cv2.warpAffine(pixels, to_film, (x1 - x0, y1 - y0), flags=how | cv2.WARP_INVERSE_MAP)
    drawn = np.minimum(drawn, drawn[..., -1:])  # a colour never exceeds its alpha
    return one._replace(x0_px=x0, y0_px=y0, pixels=drawn)


def match_measures(tracks: pd.DataFrame, like: Likeness) -> pd.DataFrame:
    """Return rows of the table of tracks, with lengths and contrast scaled to the first film's.

    Columns in px are multiplied by the scale, the area by its square. Contrast, in the film's own
    grey levels, is multiplied by the mean gain.
    """
    if like.none:
        return tracks
    made = tracks.copy()
    for name in tracks.columns[tracks.columns.str.endswith("_px")]:
        power = 2 if name == "area_px" else 1
        made[name] = [one * like.scale**power for one in tracks[name]]
    if like.gains:
        made["contrast"] = tracks["contrast"] * np.float32(np.mean(like.gains))
    return made
