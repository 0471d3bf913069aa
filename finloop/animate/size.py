"""The size at which a film is drawn, and which of its frames fit into the tank."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.arena import choose_fish_area, scale_that_fits
from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.silhouettes import FilmOutlines, FrameOutlines
from finloop.base.arrays import Floats, Mask, Picture
from finloop.distance.reel import Reel
from finloop.sprites.orient import sprite_outlines


class ScaledFilm(NamedTuple):
    """A film at its drawn size: pictures, outlines, tank area, and frames too wide to be shown.

    reel: its pictures; outlines: of its frames; area (h, w): where its fish may be; reach_px:
    how far the fish reaches from its centre; barred (n,): whether a frame reaches farther, and is
    not shown.
    """

    reel: Reel
    outlines: FrameOutlines
    area: Mask
    reach_px: float
    barred: Mask


def scale_film(
    reel: Reel, outlines: FilmOutlines, arena: Mask, p: CommonSettings, floor: Picture | None
) -> ScaledFilm:
    """Return the film at the drawn size `p.fish_scale`, or for "auto" at one that fits the tank.

    reel: the film's cut-outs and sprites; outlines: of its rows; arena (h, w): true where fish can
    be; floor: the empty tank as filmed, None if unknown. Frames that reach farther than the
    quantile `p.reach_quantile` of all are barred: the animation does not show them.
    """
    scale = (reel.length_px / reel.lengths_px).astype(float)
    filmed = FrameOutlines(outlines, scale)
    of_sprites = sprite_outlines(reel) if len(reel.sprites) else []
    reach_px, barred = measure_reach(of_sprites, filmed, p.reach_quantile)
    size = 1.0 if p.fish_scale == "auto" else p.fish_scale
    area = choose_fish_area(arena, outlines.hulls, size * reach_px, p.tank, floor)
    size = scale_that_fits(area, reach_px) if p.fish_scale == "auto" else size
    drawn = FrameOutlines(outlines, size * scale)
    return ScaledFilm(reel.scale_to(size), drawn, area, size * reach_px, barred)


def measure_reach(
    of_sprites: Sequence[Floats], of_frames: FrameOutlines, quantile: float
) -> tuple[float, Mask]:
    """Return how far a fish reaches from its centre, px, and which frames (n,) reach farther.

    of_sprites: outlines (k, 2), all of which count; of_frames: outlines; quantile: 0-1, of the
    frames' reach, as the widest are mostly faults.
    """
    frame_reach = of_frames.reach_px
    sprite_reach = max((float(np.hypot(*outline.T).max()) for outline in of_sprites), default=0.0)
    reach_px = max(sprite_reach, float(np.quantile(frame_reach, quantile)))
    return reach_px, frame_reach > reach_px


def head_ahead_px(features: pd.DataFrame, size: float) -> float:
    """Return the median distance, px, of the head from the mass centre, at a drawn size.

    features: as filmed; size: the drawn size as a multiple of the filmed one.
    """
    dx, dy = (features[f"head_{axis}_px"] - features[f"{axis}_px"] for axis in "xy")
    return float(np.hypot(dx, dy).median() * size)
