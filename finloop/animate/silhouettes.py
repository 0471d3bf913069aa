"""The sprites of a film, and the outlines of all pictures that can be shown."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.arena import FilmHulls
from finloop.animate.obstacles import Discs, Outlines, cover_with_discs
from finloop.base.arrays import Floats, Reals
from finloop.base.kernel import kernel
from finloop.base.parallel import map_row_blocks
from finloop.edit.schema import FRAME


@dataclass(frozen=True)
class FilmOutlines:
    """Outlines (n, k, 2) of a film's rows, x, y px as filmed, and what is measured of them.

    Each is measured once, at its first use, as the modes of one film share them. centre_px (n, 2):
    x, y of the mass centres; heading_rad (n,).
    """

    outline_px: Reals
    centre_px: Floats
    heading_rad: Floats

    @classmethod
    def from_rows(cls, outline_px: Reals, rows: pd.DataFrame) -> "FilmOutlines":
        """Return the outlines of n rows with columns x_px, y_px and heading_deg.

        outline_px (n, k, 2): x, y in the film.
        """
        heading = np.radians(rows["heading_deg"].to_numpy(float))
        return cls(outline_px, rows[["x_px", "y_px"]].to_numpy(float), heading)

    @cached_property
    def reach_px(self) -> Floats:
        """Return how far (n,), px as filmed, each outline reaches from the mass centre."""
        blocks = map_row_blocks(
            lambda rows: _reach_from_centre(self.outline_px[rows], self.centre_px[rows]),
            len(self.centre_px),
        )
        return np.concatenate(blocks)

    @cached_property
    def hulls(self) -> FilmHulls:
        """Return the convex hulls of all outlines, and of those of the film's halves."""
        return FilmHulls(self.outline_px)


@dataclass(frozen=True)
class FrameOutlines:
    """Outlines (n, k, 2) of a film's frames, px ahead of and to the left of the mass centre.

    They are computed on access: those of a film of hours stay in their file. filmed: the outlines
    as filmed; scale (n,): drawn size / filmed size.
    """

    filmed: FilmOutlines
    scale: Floats

    def __len__(self) -> int:
        """Return the number n of frames."""
        return len(self.scale)

    def __getitem__(self, rows: slice) -> NDArray[np.float32]:
        """Return the outlines (m, k, 2) of a slice of frames."""
        film = self.filmed
        frames = film.centre_px[rows], film.heading_rad[rows], self.scale[rows]
        return np.asarray(_to_body_axes(film.outline_px[rows], *frames))

    @property
    def reach_px(self) -> Floats:
        """Return how far (n,), px as drawn, each outline reaches from the mass centre."""
        return self.filmed.reach_px * self.scale


@kernel
def _to_body_axes(
    points: Reals, centres: Floats, headings_rad: Floats, scale: Floats
) -> NDArray[np.float32]:
    """Return points (n, k, 2) of the film as px ahead and left of each mass centre, as drawn.

    points: x, y px as filmed; centres (n, 2): x, y px; headings_rad (n,); scale (n,): drawn /
    filmed size.
    """
    body = np.empty(points.shape, np.float32)
    for row in range(len(points)):
        cos, sin = scale[row] * np.cos(headings_rad[row]), scale[row] * np.sin(headings_rad[row])
        for k in range(points.shape[1]):
            dx, dy = points[row, k, 0] - centres[row, 0], points[row, k, 1] - centres[row, 1]
            body[row, k, 0], body[row, k, 1] = dx * cos - dy * sin, -dx * sin - dy * cos
    return body


@kernel
def _reach_from_centre(points: Reals, centres: Reals) -> Floats:
    """Return the largest distance (n,) of points (n, k, 2) from their centres (n, 2), px."""
    squares = np.zeros(len(points))
    for row in range(len(points)):
        for k in range(points.shape[1]):
            dx, dy = points[row, k, 0] - centres[row, 0], points[row, k, 1] - centres[row, 1]
            squares[row] = max(squares[row], dx * dx + dy * dy)
    return np.sqrt(squares)


@dataclass(frozen=True)
class Silhouettes:
    """The table of sprites (s rows), and the outlines of all pictures: sprites and frames.

    sprite_outlines: the outline (k, 2) of every sprite, px ahead of and to the left of the mass
    centre, as drawn; frame_outlines: the outlines of the film's frames.
    """

    sprites: pd.DataFrame
    sprite_outlines: Sequence[Floats]
    frame_outlines: Outlines

    @cached_property
    def sprite_scale(self) -> Floats:
        """Return the drawn size of every sprite (s,), as a multiple of the filmed size."""
        return self.sprites["scale"].to_numpy(float)

    @cached_property
    def discs(self) -> Discs:
        """Return the discs that together cover the body, for every frame and sprite."""
        return cover_with_discs(self.frame_outlines, self.sprite_outlines)

    def outline(self, kind: str, source: int) -> Floats:
        """Return the outline (p, 2) of a frame or sprite, px ahead and left of its mass centre.

        kind: FRAME or SPRITE; source: row of the film, or number of the sprite.
        """
        if kind == FRAME:
            return self.frame_outlines[source : source + 1][0].astype(float)
        return self.sprite_outlines[source]
