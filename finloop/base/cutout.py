"""A fish of a frame as a small picture with alpha, and stores of such pictures by number."""

from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from finloop.base.arrays import Picture


class Cutout(NamedTuple):
    """One animal of a frame, or one sprite, as a small picture with transparency, and its place.

    pixels (h, w, 2 or 4) uint8: grey or RGB, premultiplied by the last channel, alpha. x0_px,
    y0_px: column and row of its upper left pixel in the frame. sprite, orientation (1 … n): number
    and orientation of a sprite, None for a cut-out as filmed.
    """

    track_id: int
    frame: int
    x0_px: int
    y0_px: int
    pixels: Picture
    sprite: int | None = None
    orientation: int | None = None

    def blend_over(self, background: Picture) -> Picture:
        """Lay the cut-out over its place in the tank; return these pixels, (h, w[, 3]) uint8.

        background (H, W) or (H, W, 3) uint8: the whole tank, in which the cut-out must lie.
        """
        h, w = self.pixels.shape[:2]
        tank = background[self.y0_px : self.y0_px + h, self.x0_px : self.x0_px + w]
        through = (255 - self.pixels[..., -1:].astype(np.uint16)) * tank.reshape(h, w, -1)
        film = self.pixels[..., :-1] + (through + 127) // 255
        return film.reshape(tank.shape).astype(np.uint8)


class Cutouts(Protocol):
    """A store that returns cut-outs by row number; `finloop.io.cutouts.open_cutouts` opens one."""

    @property
    def index(self) -> pd.DataFrame:
        """Return a row per cut-out: track_id, frame, place and size; of sprites also their key."""
        ...

    def __len__(self) -> int:
        """Return the number of cut-outs."""
        ...

    def __getitem__(self, row: int) -> Cutout:
        """Return the cut-out of a row."""
        ...
