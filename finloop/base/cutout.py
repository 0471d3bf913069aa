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
        """Return the part of a frame that the cut-out covers, blended over a background.

        background (H, W) or (H, W, 3) uint8: the empty tank as a whole frame, in which the cut-out
        must lie; it does not change. The result is (h, w) or (h, w, 3) uint8.
        """
        h, w = self.pixels.shape[:2]
        behind = background[self.y0_px : self.y0_px + h, self.x0_px : self.x0_px + w]
        transparency = 255 - self.pixels[..., -1:].astype(np.uint16)
        seen_behind = (transparency * behind.reshape(h, w, -1) + 127) // 255  # rounded
        blended = self.pixels[..., :-1] + seen_behind
        return blended.reshape(behind.shape).astype(np.uint8)


class Cutouts(Protocol):
    """A store that returns cut-outs by row number; `finloop.io.cutouts.open_cutouts` opens one."""

    @property
    def index(self) -> pd.DataFrame:
        """Return a table with a row per cut-out: track_id, frame, place, size.

        A sprite's row also has its number and orientation: see `finloop.io.cutouts`.
        """
        ...

    def __len__(self) -> int:
        """Return the number of cut-outs."""
        ...

    def __getitem__(self, row: int) -> Cutout:
        """Return the cut-out of a row of `index`, counted from 0."""
        ...
