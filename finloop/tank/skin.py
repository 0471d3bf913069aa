"""The skin of a fish: the pixels of its own cut-out, seen from above, wrapped around the body.

A point of the body's side shows the pixel that lies over it. Below, which the film does not show,
it is the same pixels but paler, like the bellies of most fish.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture, Reals
from finloop.base.cutout import Cutout
from finloop.puppet import second_shares
from finloop.tank.body import build_surface_grid, limit_half_widths, top_view_points
from finloop.tank.swim import FilmBodies

LENGTHWISE, AROUND = 128, 64  # pixels of a skin: from head to tail, from below over left and right
_INSIDE = 0.85  # of the half width: the outermost pixels are half water
_SOLID = 200  # alpha from which a pixel's own colour is sure
_BELLY_GREY, _BELLY_SHARE = 236.0, 0.5  # grey level of a belly, and how much of it is mixed in
_EYE = 0.075, 0.42, 0.021  # place along the body; around, 0 = back, 1 = belly; radius, body lengths
_PUPIL, _IRIS = 22.0, 206.0
_KEPT = 256  # skins that stay in memory


class SurfaceAndSkin(NamedTuple):
    """A fish at one tick: its surface and the picture around it.

    points, normals (rings, around, 3): px of the tank, and unit vectors; skin (AROUND, LENGTHWISE,
    3): uint8.
    """

    points: Reals
    normals: Reals
    skin: Picture


class FishSkins:
    """The skins of a fish, made of its film pictures.

    `skin(row)` is that of a row of the film, (AROUND, LENGTHWISE, 3) float32, 0 … 255.
    """

    def __init__(
        self, film: FilmBodies, typical: Reals, centres_px: Reals,
        load_cutout: Callable[[int], Cutout],
    ) -> None:  # fmt: skip
        """Compute what all skins share: the places of their pixels, the belly and the eyes.

        typical (p,): median half widths in body lengths; centres_px (n, 2): mass centres, px of the
        film, y down; load_cutout: returns the cut-out of a row.
        """
        self._film, self._typical, self._centres = film, typical, centres_px
        self._load_cutout = load_cutout
        # Angles from the back, from below (π) over the left and the back to below again (−π).
        around = np.pi * (1 - 2 * (np.arange(AROUND) + 0.5) / AROUND)
        along = (np.arange(LENGTHWISE, dtype=np.float32) + 0.5) / LENGTHWISE
        self._along = along
        self._grid = build_surface_grid(along, around, film.backbone.shape[1])
        below = np.clip((-np.cos(around) + 0.1) / 0.9, 0, 1)  # 0 on the back, 1 on the belly
        belly_share = _BELLY_SHARE * below * below * (3 - 2 * below)  # smooth at both ends
        self._belly_share = belly_share.astype(np.float32)[:, None]
        self._eyes = _eye_layers(along, around)
        self.skin = lru_cache(_KEPT)(self._wrap_cutout)

    def _wrap_cutout(self, row: int) -> NDArray[np.float32]:
        """Return a film row's cut-out wrapped around the body, with belly and eyes added.

        The skin is (AROUND, LENGTHWISE, 3), 0 … 255. A grey cut-out gives three equal colours.
        """
        cutout, line = self._load_cutout(row), self._film.backbone[row : row + 1]
        width = limit_half_widths(self._film.half_width[row : row + 1], line, self._typical)
        # Each pixel of the skin takes its colour from a place in the cut-out, a little within the
        # outline, whose own pixels are half water.
        points = top_view_points(self._grid, line, _INSIDE * width)[0].swapaxes(0, 1)
        origin = np.array([cutout.x0_px, cutout.y0_px])
        places = (points * (1, -1) + (self._centres[row] - origin)).astype(np.float32)
        pixels = cv2.remap(
            _opaque_colours(cutout.pixels), places[..., 0], places[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        skin = pixels.reshape(AROUND, LENGTHWISE, -1)
        if skin.shape[2] == 1:
            skin = skin.repeat(3, axis=2)
        skin = skin + self._belly_share[..., None] * (_BELLY_GREY - skin)
        for share, level in self._eyes:
            skin += share[..., None] * (level - skin)
        return skin

    def mix_skins(
        self, row: int, mirrored: bool, partner: int, partner_mirrored: bool, weight: float
    ) -> Picture:
        """Return the skin between those of two film rows, (AROUND, LENGTHWISE, 3) uint8.

        weight: share of the second row, `partner`, 0 … 1, which the first replaces from the tail
        on; mirrored, partner_mirrored: whether each is mirrored.
        """
        # A mirrored skin has the rows, which go around the body, in reverse order.
        skin = self.skin(row)[:: -1 if mirrored else 1]
        if weight > 0:
            partner_skin = self.skin(partner)[:: -1 if partner_mirrored else 1]
            skin = skin + second_shares(self._along, weight)[:, None] * (partner_skin - skin)
        return np.rint(np.clip(skin, 0, 255)).astype(np.uint8)


def _opaque_colours(pixels: Picture) -> NDArray[np.float32]:
    """Return a cut-out's colours (0 … 255) without alpha; faint pixels take those around them.

    pixels (h, w, c): premultiplied by alpha, the last channel. The result has one channel less.
    """
    premultiplied = pixels.astype(np.float32)
    blurred = cv2.GaussianBlur(premultiplied, (0, 0), 2.0)
    alpha = premultiplied[..., -1:]
    mean_around = blurred[..., :-1] / np.maximum(blurred[..., -1:], 1e-3)
    pixel_colour = premultiplied[..., :-1] / np.maximum(alpha, 1)
    return 255 * np.where(alpha >= _SOLID, pixel_colour, mean_around)


def _eye_layers(
    along: NDArray[np.float64], around: NDArray[np.float64]
) -> list[tuple[NDArray, float]]:
    """Return the shares of each skin pixel that iris and pupil cover, and their grey levels.

    Two pairs: share (n, m), level 0 … 255. along (m,), around (n,): places of the pixels, 0-1 from
    head to tail, and rad from the back. The film, from above, hardly shows the eyes, which are at
    the sides of the head.
    """
    eye_along, eye_around, radius = _EYE
    half_girth = 0.3  # from the back around the head to the belly, in body lengths
    across = ((np.abs(around) / np.pi - eye_around) * half_girth)[:, None]
    distance = np.hypot(along - eye_along, across) / radius

    def disc(edge: float) -> NDArray[np.float32]:
        """Return a disc with a soft edge, 1 inside, 0 outside; edge: its radius, 1 = the eye's."""
        return np.clip((edge - distance) / 0.4 + 0.5, 0, 1).astype(np.float32)

    return [(disc(1.0), _IRIS), (disc(0.68), _PUPIL)]
