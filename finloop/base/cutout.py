"""A fish of a frame as a small picture with alpha, and stores of such pictures by number."""

from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from finloop.base.arrays import Picture


class Cutout(NamedTuple):
    """One picture (h, w, 2 or 4) uint8, premultiplied; x0_px, y0_px: its upper left pixel.

    sprite, orientation (1 … n): which one it is; None of a frame as filmed.
    """

    track_id: int
    frame: int
    x0_px: int
    y0_px: int
    pixels: Picture
    sprite: int | None = None
    orientation: int | None = None

    def over(self, background: Picture) -> Picture:
        """Draw the cut-out over `background` (H, W[, 3]); return the part under the cut-out."""
        h, w = self.pixels.shape[:2]
        tank = background[self.y0_px : self.y0_px + h, self.x0_px : self.x0_px + w]
        through = (255 - self.pixels[..., -1:].astype(np.uint16)) * tank.reshape(h, w, -1)
        film = self.pixels[..., :-1] + (through + 127) // 255
        return film.reshape(tank.shape).astype(np.uint8)


class Cutouts(Protocol):
    """Cut-outs by number; `finloop.io.cutouts.open_cutouts` opens them.

    `index` has a row per cut-out in the store's order: track_id, frame, place and size. The
    sprites' store also has sprite and orientation.
    """

    @property
    def index(self) -> pd.DataFrame:
        """Return the table of all cut-outs, a row each."""
        ...

    def __len__(self) -> int: ...
    def __getitem__(self, row: int) -> Cutout: ...
