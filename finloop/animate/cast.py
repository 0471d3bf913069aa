"""The cast of a film: its sprites, and the outlines of all pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.company import Discs, Hulls, discs_of
from finloop.base.arrays import Floats, Reals
from finloop.base.kernel import kernel


@dataclass(frozen=True)
class FrameHulls:
    """Outlines (n, k, 2) of a film's frames, px ahead of and to the left of the mass centre.

    They are computed on access: those of a film of hours stay in their file. outline_px (n, k, 2):
    x, y as filmed; centre_px (n, 2), heading_rad (n,), scale (n,): of each frame; scale is drawn
    size / filmed size.
    """

    outline_px: Reals
    centre_px: Floats
    heading_rad: Floats
    scale: Floats

    def __len__(self) -> int:
        return len(self.centre_px)

    def __getitem__(self, rows: slice) -> NDArray[np.float32]:
        """Return the outlines (m, k, 2) of some frames."""
        frames = self.centre_px[rows], self.heading_rad[rows], self.scale[rows]
        return np.asarray(_own_axes(self.outline_px[rows], *frames))

    @property
    def reach_px(self) -> Floats:
        """Return how far (n,), px as drawn, each outline reaches from the mass centre."""
        return _farthest(self.outline_px, self.centre_px) * self.scale


@kernel
def _own_axes(points, centre, heading_rad, scale):  # type: ignore[no-untyped-def]
    """Return points (n, k, 2) relative to each centre (n, 2), scaled, along each heading."""
    made = np.empty(points.shape, np.float32)
    for row in range(len(points)):
        cos, sin = scale[row] * np.cos(heading_rad[row]), scale[row] * np.sin(heading_rad[row])
        for k in range(points.shape[1]):
            dx, dy = points[row, k, 0] - centre[row, 0], points[row, k, 1] - centre[row, 1]
            made[row, k, 0], made[row, k, 1] = dx * cos - dy * sin, -dx * sin - dy * cos
    return made


@kernel
def _farthest(points, centre):  # type: ignore[no-untyped-def]
    far = np.zeros(len(points))
    for row in range(len(points)):
        for k in range(points.shape[1]):
            dx, dy = points[row, k, 0] - centre[row, 0], points[row, k, 1] - centre[row, 1]
            far[row] = max(far[row], dx * dx + dy * dy)
    return np.sqrt(far)


@dataclass(frozen=True)
class Cast:
    """What is drawn: the table of sprites (s rows), and the outlines of all pictures.

    sprite_hulls: the outline (k, 2) of every sprite, px ahead of and to the left of the mass
    centre, as drawn; frame_hulls: the same of every frame.
    """

    sprites: pd.DataFrame
    sprite_hulls: Sequence[Floats]
    frame_hulls: Hulls

    @cached_property
    def sprite_scale(self) -> Floats:
        """Return the drawn size as a multiple of the filmed size (s,) of every sprite."""
        return self.sprites["scale"].to_numpy(float)

    @cached_property
    def discs(self) -> Discs:
        """Return the discs that together hold the body, for every frame and sprite."""
        return discs_of(self.frame_hulls, self.sprite_hulls)
