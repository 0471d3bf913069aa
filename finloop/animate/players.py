"""Everything that swims, from what the stages before have made: one player a mode."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.arena import tank
from finloop.animate.edit_list import HYBRID, LOOPS, NETWORK
from finloop.animate.hybrid import HybridMode
from finloop.animate.loops import LoopMode
from finloop.animate.motion import Motion
from finloop.animate.network import NetworkMode
from finloop.animate.swim import Cast, Mode, Player
from finloop.bpn.model import MotionModel

_WIDE = 0.99  # quantile of the frames' reach; wider ones, mostly faults, are not shown

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
    sprite_hulls: Sequence[Floats], hulls: NDArray[np.float32]
) -> tuple[float, NDArray[np.bool_]]:
    """How far from its centre a fish reaches [px], and the frames (n,) that reach farther."""
    frames = np.hypot(hulls[..., 0], hulls[..., 1]).max(axis=1)
    sprites = max(float(np.hypot(*hull.T).max()) for hull in sprite_hulls)
    most = max(sprites, float(np.quantile(frames, _WIDE)))
    return most, frames > most


def players(
    cast: Cast, motion: Motion, model: MotionModel, gateways: pd.DataFrame,
    arena: NDArray[np.bool_], reach_px: float, head_px: float, goal_radius: float, stay_s: float,
    fade_s: float, step: float,
) -> dict[str, Player]:  # fmt: skip
    """A player for every mode; without loops there is no such mode, and the hybrid is the network.

    gateways: with the columns of `GATEWAYS`; goal_radius in body lengths; step: the median distance
    of successive frames.

    Raises
    ------
    FinloopError
        If the tank (`arena`) is smaller than the fish.
    """
    room, touch = tank(arena, reach_px), goal_radius * motion.body_length_px
    network = NetworkMode(motion, cast.order, model, room, touch, head_px)
    modes: dict[str, Mode] = {NETWORK: network, HYBRID: network}
    if (cast.film.endless & cast.film.more).any():
        loops = LoopMode(cast.film, motion, room, touch, head_px, stay_s)
        hybrid = HybridMode(network, loops, gateways, step)
        modes = {NETWORK: network, LOOPS: loops, HYBRID: hybrid}
    fade = round(fade_s * motion.rate_hz)
    return {name: Player(mode, cast, fade) for name, mode in modes.items()}
