"""Light in the tank: ripples of the water, their light on the floor, and the fish's shadow.

The sun stands still; all that moves is a sum of waves of fixed frequencies, so that the same tick
always has the same light.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Reals
from finloop.render.living import LivingTank
from finloop.tank.camera import TankSize

SUN = np.array([-0.28, 0.34, 0.9]) / np.linalg.norm([-0.28, 0.34, 0.9])
_WAVES = (  # direction rad, length in depths of the water, turns per second, phase
    (0.3, 1.05, 0.41, 0.0), (1.5, 0.83, 0.47, 1.3), (2.6, 0.67, 0.55, 4.0), (3.9, 0.95, 0.38, 2.2),
    (5.2, 0.58, 0.61, 5.1),
)  # fmt: skip
_STEEP = 0.045  # slope of the steepest wave
WATER = (0.80, 0.95, 1.0)  # red, green and blue that the water lets through
_BRIGHTEST = 1.25  # of the floor, where light gathers
_GATHERS = 0.17  # how strongly light gathers
_SHADE = 0.55  # how much a shadow takes away
_CELL_PX = 10  # of the pattern of light
_FLOOR_PX = 960  # longest side of the floor's picture
_WATER_CELLS = 44  # of the water's grid, along its longer side


def wave_heights_and_slopes(
    x: Reals, y: Reals, depth: float, time_s: float
) -> tuple[Reals, Reals, Reals]:
    """Return the water's height [px, 0 at rest] and slopes along x and y, at places and a time.

    x, y: px, arrays of one shape, which the results share; depth: of the water, px.
    """
    height, slope_x, slope_y = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    for angle, length, rate, phase in _WAVES:
        wave_number = 2 * math.pi / (length * depth)  # plain floats: single precision stays single
        cos, sin = math.cos(angle), math.sin(angle)
        shift = math.remainder(2 * math.pi * rate * time_s - phase, 2 * math.pi)
        wave = wave_number * cos * x + wave_number * sin * y - shift
        height += _STEEP / wave_number * np.sin(wave)
        slope = _STEEP * np.cos(wave)
        slope_x += cos * slope
        slope_y += sin * slope
    return height, slope_x, slope_y


class LitFloor:
    """The floor of the tank under moving light, with the shadows of fish."""

    def __init__(
        self, background: NDArray[np.uint8], tank: TankSize, living: LivingTank | None = None
    ) -> None:
        """Shrink the background to `_FLOOR_PX` a side at most; lay a grid for the light over it.

        background: the film without fish, (H, W) or (H, W, 3) uint8. living: how it changes from
        tick to tick, None = not at all.
        """
        self._scale = min(1.0, _FLOOR_PX / max(background.shape[:2]))  # of the floor's picture
        small = self.plain = self._shrink(background)
        self._living = living
        self._pictures = [self._shrink(picture) for picture in living.pictures] if living else []
        self._tank = tank
        row_count, column_count = (max(2, round(side / _CELL_PX)) for side in small.shape[:2])
        columns = np.linspace(0, tank.width, column_count, dtype=np.float32)
        rows = np.linspace(0, -tank.height, row_count, dtype=np.float32)
        self._x, self._y = np.meshgrid(columns, rows)

    def _shrink(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture of the floor at the scale at which it is drawn."""
        if self._scale == 1:
            return np.ascontiguousarray(picture)
        width, height = (max(2, round(self._scale * side)) for side in picture.shape[1::-1])
        return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)

    def draw_floor(self, fish: Sequence[Reals], time_s: float, tick: int = 0) -> NDArray[np.uint8]:
        """Return the lit floor at a time, (h, w) or (h, w, 3) uint8, with the fish's shadows.

        fish: points (rings, around, 3) of each, px of the tank. tick: of the animation, for a
        living tank.
        """
        plain, brightest = self.plain, _BRIGHTEST
        if self._living is not None:
            plain = self._pictures[self._living.number_at(tick)]
            brightest *= self._living.light_at(tick)
        height, width = self.plain.shape[:2]
        light = cv2.resize(
            self._light_pattern(time_s), (width, height), interpolation=cv2.INTER_LINEAR
        )
        for points in fish:
            self._subtract_shadow(light, points)
        if plain.ndim == 3:
            light = cv2.merge([light] * 3)
        # A light of 255 makes the plain floor `_BRIGHTEST` times as bright.
        return cv2.multiply(plain, light, scale=brightest / 255)

    def _light_pattern(self, time_s: float) -> NDArray[np.uint8]:
        """Return the pattern of moving bright lines that waves cast on the floor at a time, uint8.

        The lines lie where waves of one set do not slope, and are bent by waves of another set. A
        light of 255 is `_BRIGHTEST` times as bright as the plain floor. Factors are chosen for the
        looks.
        """
        x, y, depth = self._x, self._y, self._tank.depth
        _, bend_x, bend_y = wave_heights_and_slopes(x, y, depth, 0.7 * time_s)
        reach = 2.2 * depth
        _, slope_x, slope_y = wave_heights_and_slopes(
            x + reach * bend_x, y + reach * bend_y, 1.35 * depth, 0.9 * time_s + 7
        )
        line = 1 - np.minimum(np.abs(slope_x + 0.6 * slope_y) / (1.6 * _STEEP), 1)
        light = (1 - 0.3 * _GATHERS + _GATHERS * line**3) / _BRIGHTEST
        return np.rint(np.clip(255 * light, 0, 255)).astype(np.uint8)

    def _subtract_shadow(self, light: NDArray[np.uint8], fish: Reals) -> None:
        """Darken the light (h, w), in place, where the shadow of a fish falls.

        fish (rings, around, 3): its points, px of the tank. The higher the fish swims, the softer
        its shadow is. A shadow beside the floor changes nothing.
        """
        on_floor = fish[..., :2] - fish[..., 2:] * (SUN[:2] / SUN[2])
        pixels = (on_floor * (1, -1) * self._scale).astype(np.float32)  # of the floor's picture
        blur_px = max(1.0, 0.03 * float(fish[..., 2].mean()) * self._scale)  # grows with the height
        mask, (left, top) = _draw_soft_shadow(pixels, blur_px)
        # The part of the mask that lies in the picture.
        x0, x1 = max(left, 0), min(left + mask.shape[1], light.shape[1])
        y0, y1 = max(top, 0), min(top + mask.shape[0], light.shape[0])
        if x0 < x1 and y0 < y1:
            inside = mask[y0 - top : y1 - top, x0 - left : x1 - left]
            darkened = light[y0:y1, x0:x1] * (1 - _SHADE / 255 * inside)
            light[y0:y1, x0:x1] = np.rint(darkened).astype(np.uint8)


def _draw_soft_shadow(
    rings: NDArray[np.float32], blur_px: float
) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Return a shadow's mask (h, w), 0 … 255, with a soft edge, and its first column and row.

    rings (rings, around, 2): x, y px of the picture; the hull of each two neighbours is filled.
    """
    rim = int(np.ceil(3 * blur_px)) + 1  # space for the edge
    low = np.floor(rings.min((0, 1))).astype(int) - rim
    high = np.ceil(rings.max((0, 1))).astype(int) + rim + 1
    mask = np.zeros((high - low)[::-1], np.uint8)
    for neighbours in pairwise(rings):
        hull = cv2.convexHull(np.concatenate(neighbours) - low.astype(np.float32))
        sixteenths = np.rint(16 * hull).astype(np.int32)  # 4 bits below one pixel
        cv2.fillConvexPoly(mask, sixteenths, 255, cv2.LINE_AA, shift=4)
    left, top = low.tolist()
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), blur_px)), (left, top)


class WaterSurface:
    """The surface of the water as a grid (m, n) of points over the tank."""

    def __init__(self, tank: TankSize) -> None:
        """Lay the grid over the tank."""
        row_count = max(8, round(_WATER_CELLS * tank.height / max(tank.width, tank.height)))
        column_count = max(8, round(_WATER_CELLS * tank.width / max(tank.width, tank.height)))
        columns = np.linspace(-0.5, tank.width - 0.5, column_count, dtype=np.float32)
        rows = np.linspace(-tank.height + 0.5, 0.5, row_count, dtype=np.float32)
        self.x, self.y = np.meshgrid(columns, rows)
        self._tank = tank

    def points_and_colours(
        self, time_s: float, camera: Reals, parallel: bool
    ) -> tuple[Reals, NDArray[np.uint8]]:
        """Return the surface's points (m · n, 3), px, and their colours RGBA (m · n, 4) uint8.

        The water mirrors the sky and the sun; factors are chosen for the looks. time_s: of the
        waves; camera (3,): its place, px; parallel: whether the view is parallel, from above.
        """
        height, slope_x, slope_y = wave_heights_and_slopes(self.x, self.y, self._tank.depth, time_s)
        points = np.stack([self.x, self.y, self._tank.depth + height], -1)
        normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], -1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        view = np.array([0, 0, 1], np.float32) if parallel else camera.astype(np.float32) - points
        view = view / np.linalg.norm(view, axis=-1, keepdims=True)
        facing = np.abs((view * normal).sum(-1))
        mirror = 0.03 + 0.97 * (1 - facing) ** 5  # Schlick's share of what is reflected
        halfway = view + SUN.astype(np.float32)  # between the camera and the sun (Blinn)
        halfway /= np.linalg.norm(halfway, axis=-1, keepdims=True)
        glint = np.clip((halfway * normal).sum(-1), 0, 1) ** 160
        tilt = (12 * (slope_x - slope_y))[..., None].clip(-1, 1)
        sky = np.array([176, 212, 228], np.float32) + 22 * tilt
        colour = sky + glint[..., None] * (255 - sky)
        alpha = np.clip(0.05 + 0.75 * mirror + 0.75 * glint, 0, 0.95)
        rgba = np.concatenate([colour.clip(0, 255), 255 * alpha[..., None]], -1)
        return points.reshape(-1, 3), np.rint(rgba).astype(np.uint8).reshape(-1, 4)
