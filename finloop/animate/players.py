"""Everything that swims, from what the stages before have made: one player a mode."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.crossing import Crossing
from finloop.animate.edit_list import HYBRID, LOOPS, NETWORK
from finloop.animate.loops import FilmSwimmer
from finloop.animate.network import SpriteSwimmer
from finloop.animate.policies import HybridPolicy, LoopsPolicy, NetworkPolicy, Policy
from finloop.animate.state import Waters
from finloop.animate.swim import Cast, Player
from finloop.bpn.model import MotionModel

Floats = NDArray[np.float64]


def frame_hulls(
    outline_px: NDArray[np.floating], places: pd.DataFrame, scale: Floats
) -> NDArray[np.float32]:
    """Outlines (n, k, 2) of the film's frames, px ahead of and to the left of the mass centre.

    outline_px (n, k, 2): x, y as filmed; places: x_px, y_px, heading_deg of each; scale (n,):
    drawn size / filmed size.
    """
    centre = places[["x_px", "y_px"]].to_numpy(float)
    offset = (outline_px - centre[:, None]) * scale[:, None, None]
    angle = np.radians(places["heading_deg"].to_numpy(float))[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    ahead = offset[..., 0] * cos - offset[..., 1] * sin
    left = -offset[..., 0] * sin - offset[..., 1] * cos
    return np.stack([ahead, left], axis=-1).astype(np.float32)


def reach(
    sprite_hulls: Sequence[Floats], hulls: NDArray[np.float32], quantile: float
) -> tuple[float, NDArray[np.bool_]]:
    """How far from its centre a fish reaches [px], and the frames (n,) that reach farther.

    quantile: of the frames' reach; wider ones are mostly faults.
    """
    frames = np.hypot(hulls[..., 0], hulls[..., 1]).max(axis=1)
    sprites = max(float(np.hypot(*hull.T).max()) for hull in sprite_hulls)
    most = max(sprites, float(np.quantile(frames, quantile)))
    return most, frames > most


def players(
    waters: Waters, cast: Cast, model: MotionModel, gateways: pd.DataFrame, step: float
) -> dict[str, Player]:
    """A player for every mode; without loops there is no such mode, and the hybrid is the network.

    gateways: with the columns of `GATEWAYS`; step: the median distance of successive frames.
    """
    sprites = SpriteSwimmer(waters, model)
    policies: dict[str, Policy] = dict.fromkeys((NETWORK, HYBRID), NetworkPolicy(sprites))
    if (waters.film.endless & waters.film.more).any():
        crossing = Crossing(sprites, FilmSwimmer(waters), gateways, step)
        policies = {
            NETWORK: NetworkPolicy(sprites, crossing),
            LOOPS: LoopsPolicy(crossing),
            HYBRID: HybridPolicy(crossing),
        }
    fade = waters.ticks(waters.settings.fade_s)
    return {mode: Player(policy, waters, cast, fade) for mode, policy in policies.items()}
