"""Paint the drawn carp and its tank: outline, skin, fins, floor.

Colours are RGB in grey levels (0-255, float32). Body coordinates: s = 0 at the snout, 1 at the end
of the tail; v = distance from the midline in body lengths, + on the fish's left.
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats

Image = NDArray[np.float32]

SKIN_HALF = 0.125  # the skin picture reaches this far to both sides of the midline
FIN_HALF = 0.5  # a fin picture reaches this far across, in fin lengths
SKIN_PER_LENGTH = 1024  # px per body length of the painted skin, before it is scaled down

# Half width of the body from above: blunt head, widest at a third, thin peduncle, then the caudal
# fin on edge, a blade about 0.03 BL thick.
_STATIONS = (
    (0.0, 0.0), (0.008, 0.024), (0.03, 0.043), (0.07, 0.059), (0.13, 0.073), (0.20, 0.083),
    (0.30, 0.090), (0.40, 0.088), (0.50, 0.079), (0.60, 0.064), (0.70, 0.045), (0.78, 0.0300),
    (0.84, 0.0205), (0.89, 0.0165), (0.94, 0.0150), (0.985, 0.0135), (1.0, 0.0),
)  # fmt: skip
TAIL_BLADE = 0.86  # the caudal fin begins here


@cache
def _squared_width_curve() -> "scipy.interpolate.PchipInterpolator":
    """Return the squared half width [body lengths²] along the body as an interpolating curve."""
    # Interpolate the square: it is linear at the tips, which makes both ends round.
    s, w = np.array(_STATIONS).T
    return scipy.interpolate.PchipInterpolator(s, w**2)


def half_width(s: Floats) -> Floats:
    """Return half the body's width at s (0 snout, 1 tail end), in body lengths; 0 at both ends."""
    return np.sqrt(np.clip(_squared_width_curve()(np.clip(s, 0, 1)), 0, None))


@cache
def width_table() -> tuple[Floats, Floats, Floats]:
    """Return a table along the body: s, squared half width, and its slope, (2048,) each.

    s runs from −0.05 to 1.05 (0 snout, 1 tail end); outside the body the table is extended
    linearly. Widths are in body lengths; the slope is against s.
    """
    s = np.linspace(-0.05, 1.05, 2048)
    curve, inside = _squared_width_curve(), np.clip(s, 0, 1)
    slope = curve.derivative()(inside)
    return s, curve(inside) + (s - inside) * slope, slope


@dataclass(frozen=True)
class FishColours:
    """Pictures of one carp's skin and fin; colours are grey levels 0-255."""

    # (rows, columns, 4) RGB and opacity 0-1; columns are s, rows v from left to right side
    skin: Image
    # (rows, columns, 5) a paired fin, root at column 0: premultiplied RGB, opacity, coverage
    fin: Image


def _clouds(shape: tuple[int, int], sizes: tuple[float, ...], rng: np.random.Generator) -> Image:
    """Return a random cloudy texture of mean 0 and SD 1: a sum of noise blurred by `sizes` [px]."""
    total = np.zeros(shape, np.float32)
    for size in sizes:
        # A coarse grid scaled up looks like a wide blur, and is much faster.
        step = max(1, int(size / 2))
        rows, columns = shape[0] // step + 3, shape[1] // step + 3
        noise = rng.standard_normal((rows, columns), np.float32)
        blurred = cv2.GaussianBlur(noise, (0, 0), max(size / step, 0.4))
        wide = cv2.resize(blurred, (columns * step, rows * step), interpolation=cv2.INTER_CUBIC)
        cloud = np.asarray(wide, np.float32)[: shape[0], : shape[1]]
        total += cloud / cloud.std()
    total -= total.mean()
    return np.asarray(total / total.std(), np.float32)


def _tint(picture: Image, colour: tuple[float, ...] | Image, weight: Image) -> Image:
    """Return a picture with a colour laid over it, `weight` (0-1) opaque at each pixel."""
    over = np.asarray(colour, np.float32)
    return np.asarray(picture + (over - picture) * weight[..., None], np.float32)


def _ramp(x: Image, low: float, high: float) -> Image:
    """Return a smooth ramp: 0 where x is below `low`, 1 above `high`."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)


# Colours of back, flank and patches. All are darker than the sand, as real carp look in water.
_COATS = (
    ((58, 54, 38), (112, 92, 50), (34, 31, 26), (176, 84, 34)),  # bronze, with orange
    ((70, 58, 34), (128, 96, 44), (42, 36, 26), (96, 74, 36)),  # wild carp
    ((54, 62, 70), (96, 88, 76), (26, 28, 32), (158, 70, 34)),  # slate blue, with red
    ((150, 66, 26), (176, 88, 36), (30, 27, 25), (44, 40, 38)),  # orange, with black
)


class _BodyCoordinates(NamedTuple):
    """The coordinates on the body of each pixel of a skin picture.

    s (1, columns): from 0 (snout) to 1 (tail end); v (rows, 1): from left (+) to right, body
    lengths; r (rows, columns): v as a share of the half width, ±1 at the body's edges.
    """

    s: Image
    v: Image
    r: Image


# The numbers in the functions that paint are drawn by eye after photographs: places in body
# lengths, shares of light.


def paint_fish(rng: np.random.Generator, columns: int, coat: int) -> FishColours:
    """Return pictures of the skin and of a paired fin of one carp, painted with random spots.

    columns: width of the skin picture, px; coat: number of the colouring; those of _COATS repeat in
    turn. rng: source of chance.
    """
    back, flank, dark, _ = _COATS[coat % len(_COATS)]
    length_px = SKIN_PER_LENGTH  # it is painted at this size, and then scaled
    rows = int(2 * SKIN_HALF * length_px)
    s = ((np.arange(length_px) + 0.5) / length_px).astype(np.float32)[None, :]
    v = (((np.arange(rows) + 0.5) / rows * 2 - 1) * -SKIN_HALF).astype(np.float32)[:, None]
    width = np.maximum(half_width(s[0].astype(np.float64)), 0.004).astype(np.float32)[None, :]
    places = _BodyCoordinates(s, v, v / width)
    skin = _paint_patches(places, coat, rng)
    skin *= _scales_light(places)[..., None]
    _shade_head(skin, places, rng)
    _shade_back(skin, places)
    skin = _paint_eyes(skin, places)
    # Caudal fin on edge: dark membrane, rays along it, clearer towards its end.
    blade = _ramp(s, TAIL_BLADE - 0.03, TAIL_BLADE + 0.04) + 0 * v
    tone = np.asarray(dark, np.float32) * 0.7 + np.asarray(flank, np.float32) * 0.3
    skin = _tint(skin, tone, blade * 0.75)
    skin *= (1 + blade * 0.12 * np.sin(v * 2 * np.pi / 0.0075))[..., None]
    opaque = 1 - 0.28 * _ramp(s, TAIL_BLADE, 1.0) + 0 * v
    scaled = cv2.resize(
        np.dstack([np.clip(skin, 4, 176), opaque]).astype(np.float32),
        (columns, max(8, round(columns * 2 * SKIN_HALF))),
        interpolation=cv2.INTER_AREA if columns < length_px else cv2.INTER_LINEAR,
    )
    fin = _paint_fin_picture(rng, max(24, round(columns * 0.25)), back, flank, dark)
    return FishColours(np.ascontiguousarray(scaled, np.float32), fin)


def _paint_patches(places: _BodyCoordinates, coat: int, rng: np.random.Generator) -> Image:
    """Return a skin picture (rows, columns, 3) of back and flanks, with koi-like patches.

    The coloured patches are fewer on the head. coat: number of the colouring, as in `paint_fish`.
    """
    back, flank, dark, patch = _COATS[coat % len(_COATS)]
    s, v, r = places
    skin = np.empty((*r.shape, 3), np.float32)
    skin[:] = back
    skin = _tint(skin, flank, _ramp(np.abs(r) + 0.12 * _clouds(r.shape, (30,), rng), 0.35, 0.95))
    body = np.abs(r) < 1
    # Coloured patches on the 30 % of the body where clouds are densest, dark ones on 16 %.
    clouds = _clouds(r.shape, (70, 34), rng) + 0.10 * _clouds(r.shape, (5,), rng)
    edge = float(np.quantile(clouds[body], 0.70))
    behind_head = _ramp(s + 0 * v, 0.05, 0.2)
    skin = _tint(skin, patch, _ramp(clouds, edge - 0.08, edge + 0.08) * behind_head * 0.92)
    clouds = _clouds(r.shape, (46, 22), rng) + 0.12 * _clouds(r.shape, (5,), rng)
    edge = float(np.quantile(clouds[body], 0.84))
    return _tint(skin, dark, _ramp(clouds, edge - 0.09, edge + 0.09) * 0.85)


def _scales_light(places: _BodyCoordinates) -> Image:
    """Return by how much the scales brighten each pixel of the skin, a factor (rows, columns)."""
    s, v, _ = places
    size = 0.026
    scale_row = np.floor(v / (size * 0.5))
    cell = np.mod(s / size + 0.5 * np.mod(scale_row, 2), 1.0) - 0.5
    across = np.mod(v / (size * 0.5), 1.0) - 0.5
    scale_edges = _ramp(np.hypot(cell - 0.18, across * 0.9), 0.34, 0.58)
    scale_area = _ramp(s, 0.20, 0.27) * (1 - _ramp(s, 0.84, 0.90))
    return 1 + scale_area * (0.12 - 0.34 * scale_edges)


def _shade_head(skin: Image, places: _BodyCoordinates, rng: np.random.Generator) -> None:
    """Shade bony plates, gill covers, nostrils and mouth in a skin picture, in place."""
    s, v, r = places
    head = 1 - _ramp(s, 0.18, 0.25)
    skin *= (1 + head * 0.07 * _clouds(r.shape, (16, 7), rng))[..., None]
    gill = np.exp(-(((s - (0.205 - 0.045 * r**2)) / 0.007) ** 2)) * _ramp(np.abs(r), 0.25, 0.6)
    skin *= (1 - 0.45 * gill)[..., None]
    plate = np.exp(-(((s - 0.165 + 0.02 * r**2) / 0.02) ** 2)) * _ramp(1 - np.abs(r), 0.1, 0.6)
    skin *= (1 + 0.10 * plate)[..., None]
    for side in (-1, 1):
        nostril = np.exp(-(((s - 0.042) / 0.006) ** 2 + ((v - side * 0.018) / 0.005) ** 2))
        skin *= (1 - 0.5 * nostril)[..., None]
    skin *= (1 - 0.25 * np.exp(-((s / 0.012) ** 2)) * np.ones_like(v))[..., None]


def _shade_back(skin: Image, places: _BodyCoordinates) -> None:
    """Shade the folded dorsal fin and the round body in a skin picture, in place."""
    s, v, r = places
    spine = 0.0016 * np.sin(s * 40) * _ramp(s, 0.3, 0.5)
    dorsal = _ramp(s, 0.36, 0.41) * (1 - _ramp(s, 0.66, 0.74))
    skin *= (1 - 0.40 * dorsal * np.exp(-(((v - spine) / 0.0065) ** 2)))[..., None]
    skin *= (1 + 0.35 * dorsal * np.exp(-(((v - spine - 0.009) / 0.004) ** 2)))[..., None]
    rounded = np.sqrt(np.clip(1 - 0.93 * np.clip(r * r, 0, 1), 0, 1))
    trunk = 1 - _ramp(s, TAIL_BLADE - 0.06, TAIL_BLADE + 0.03)
    skin *= (trunk * (0.40 + 0.70 * rounded) + (1 - trunk))[..., None]


def _paint_eyes(skin: Image, places: _BodyCoordinates) -> Image:
    """Return a skin picture with eyes at the sides of the head: dark, a pale rim, a glint."""
    s, v, _ = places
    for side in (-1, 1):
        eye_distance = np.hypot((s - 0.088) / 1.15, v - side * 0.0535)
        skin = _tint(skin, (150, 132, 84), (1 - _ramp(eye_distance, 0.0125, 0.0160)) * 0.7)
        skin = _tint(skin, (12, 12, 12), 1 - _ramp(eye_distance, 0.0090, 0.0118))
        glint_distance = np.hypot(s - 0.0845, v - side * 0.0515)
        skin = _tint(skin, (170, 172, 168), (1 - _ramp(glint_distance, 0.0012, 0.0036)) * 0.8)
    return skin


def _paint_fin_picture(
    rng: np.random.Generator, columns: int, back: tuple[float, ...], flank: tuple[float, ...],
    dark: tuple[float, ...],
) -> Image:  # fmt: skip
    """Return a painted fin, spread: rays in a clear membrane, (columns, columns, 5).

    They are premultiplied RGB, opacity and coverage; the root is at column 0. columns: px; back,
    flank, dark: RGB colours of the fish, 0-255.
    """
    # The numbers are drawn by eye. Places on the fin, in its lengths: along it, and across from the
    # leading edge (−) to the trailing one.
    size = 256
    along = ((np.arange(size) + 0.5) / size).astype(np.float32)[None, :]
    across = (((np.arange(size) + 0.5) / size * 2 - 1) * FIN_HALF).astype(np.float32)[:, None]
    # Paddle outline: narrow root, broad round end, the leading edge (across < 0) longer.
    half = 0.66 * np.sqrt(np.clip(along * (1.0 - along**3), 0, None)) * (0.22 + 0.56 * along)
    middle = -0.05 * along
    inside = 1 - _ramp(np.abs(across - middle) - half, -0.012, 0.012)
    angle = np.arctan2(across, along + 0.12)
    rays = 0.5 + 0.5 * np.cos(angle * 62 + 0.4 * _clouds((size, size), (40,), rng))
    opaque = (0.74 - 0.32 * along) * (0.72 + 0.28 * rays)
    leading_edge = np.exp(-(((across - middle + half) / 0.035) ** 2))
    opaque = np.clip(opaque + 0.3 * leading_edge, 0, 0.92)
    colour = np.empty((size, size, 3), np.float32)
    colour[:] = np.asarray(flank, np.float32) * 0.55 + np.asarray(back, np.float32) * 0.35
    colour = _tint(colour, dark, 0.5 * rays * np.ones_like(along))
    picture = np.dstack([colour * (opaque * inside)[..., None], opaque * inside])
    layers = [
        cv2.resize(layer.astype(np.float32), (columns, columns), interpolation=cv2.INTER_AREA)
        for layer in (picture, inside)
    ]
    return np.dstack(layers)


def paint_floor(width_px: int, height_px: int, rng: np.random.Generator) -> Image:
    """Return the painted empty tank, (height, width, 3) RGB, 0-255: sand, pebbles, light, walls."""
    shape = (height_px, width_px)
    grey = 172 + 5.5 * _clouds(shape, (0.7, 1.3), rng) + 2.6 * _clouds(shape, (5, 9), rng)
    grey += 4.0 * _clouds(shape, (60, 130), rng)
    tint = 0.8 * _clouds(shape, (12, 40), rng)
    grey += _pebbles(width_px, height_px, rng)
    picture = np.dstack([grey * 1.035 + tint, grey * 1.0, grey * 0.90 - 1.5 * tint])
    # Shares of the light near walls and away from the lamp.
    y, x = np.mgrid[:height_px, :width_px].astype(np.float32)
    wall_distance = np.minimum.reduce([x, y, width_px - 1 - x, height_px - 1 - y])
    wall = 1 - 0.42 * np.exp(-((wall_distance / 9.0) ** 2)) - 0.10 * np.exp(-wall_distance / 30.0)
    corner = (x / (width_px - 1) - 0.5) ** 2 + (y / (height_px - 1) - 0.5) ** 2
    lamp = 1 - 0.30 * corner + 0.035 * (0.5 - y / height_px)
    picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 0.7)
    return np.ascontiguousarray(picture * (wall * lamp)[..., None], np.float32)


def _pebbles(width_px: int, height_px: int, rng: np.random.Generator) -> Image:
    """Return the grey levels (h, w) that pebbles add to the floor, lit from one side."""
    scale = 3  # subpixels per px, for smooth edges
    layer = np.zeros((height_px * scale, width_px * scale), np.float32)
    for _ in range(width_px * height_px // 170):  # one for 170 px²
        radius = float(np.clip(0.9 * rng.pareto(2.4) + 1.0, 1.0, 6.5)) * scale
        flatness = float(rng.uniform(0.6, 1.0))
        centre = rng.uniform(0, [layer.shape[1], layer.shape[0]])
        turn = float(rng.uniform(0, 180))
        tone = float(rng.normal(0, 9.0))
        # Its shade, the stone itself, and a smaller highlight, each with its shift.
        for shift, level in ((0.30, tone - 9.0), (0.0, tone), (-0.25, tone + 4.0)):
            size = radius * (1.0 if shift >= 0 else 0.6)
            place = (float(centre[0] + shift * radius), float(centre[1] + shift * radius))
            box = (place, (2 * size, 2 * size * flatness), turn)
            cv2.ellipse(layer, box, (level,), -1)
    small = cv2.resize(layer, (width_px, height_px), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)
