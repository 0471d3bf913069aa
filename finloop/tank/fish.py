"""One fish of an edit list, tick after tick: its surface in the tank, and its skin."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture, Reals
from finloop.base.stretches import spread_rows
from finloop.tank.body import arc_lengths, fish_surfaces
from finloop.tank.skin import FishSkins, SurfaceAndSkin
from finloop.tank.swim import TankPoses

_BATCH = 16  # ticks whose surfaces are made at once: a sixth of the time of one by one


@dataclass(frozen=True)
class FishSurface:
    """The surface and the skin of one fish in the tank, tick by tick.

    place (ticks, 3): px of its mass centre in the tank; skins: by row of the film; typical (p,):
    its half widths in body lengths; length_px: its body length.
    """

    poses: TankPoses
    place: Reals
    skins: FishSkins
    typical: Reals
    length_px: float

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.poses)

    def _compute_surfaces(self, batch: int) -> tuple[Reals, Reals]:
        """Return points and normals of the surface, (k, rings, around, 3), for a batch of k ticks.

        Points are px about the mass centre; batch: the batch's number, from 0.
        """
        ticks, poses = slice(batch * _BATCH, (batch + 1) * _BATCH), self.poses
        return fish_surfaces(
            poses.backbone[ticks], poses.half_width[ticks], self.typical, self.length_px
        )

    @cached_property
    def _cached_batch(self) -> Callable[[int], tuple[Reals, Reals]]:
        """Return `_compute_surfaces` with a cache of one result, as ticks follow each other."""
        return lru_cache(1)(self._compute_surfaces)

    def surface_and_skin_at(self, tick: int) -> SurfaceAndSkin:
        """Return the surface and the skin of the fish at a tick."""
        batch, index = divmod(tick, _BATCH)
        points, normals = self._cached_batch(batch)
        return SurfaceAndSkin(points[index] + self.place[tick], normals[index], self.skin(tick))

    def skin(self, tick: int) -> Picture:
        """Return the skin at a tick, a picture wrapped around the body, (around, lengthwise, 3)."""
        first, second, weight = self.poses.first, self.poses.second, self.poses.weight[tick]
        return self.skins.mix_skins(
            int(first.row[tick]), bool(first.mirrored[tick]),
            int(second.row[tick]), bool(second.mirrored[tick]), weight,
        )  # fmt: skip

    def points_of_all_ticks(self) -> NDArray[np.float32]:
        """Return the surface's points at every tick, (ticks, rings · around, 3) px.

        They are relative to the mass centre.
        """
        batches = range(math.ceil(len(self) / _BATCH))
        surfaces = [self._compute_surfaces(batch)[0].astype(np.float32) for batch in batches]
        return np.concatenate(surfaces).reshape(len(self), -1, 3)

    def typical_skin(self, most: int = 25) -> Picture:
        """Return the skin's median colours over at most `most` ticks, (around, lengthwise, 3)."""
        ticks = spread_rows(np.arange(len(self)), most).tolist()
        return np.rint(np.median([self.skin(tick) for tick in ticks], axis=0)).astype(np.uint8)

    def find_strongly_bent_tick(self) -> int:
        """Return a tick at which the fish is more bent than at nine of ten ticks."""
        line = self.poses.backbone
        straightness = np.linalg.norm(line[:, -1] - line[:, 0], axis=-1) / arc_lengths(line)
        return int(np.argsort(straightness, kind="stable")[len(straightness) // 10])
