"""Draw a film of carp from above from a seed, with exact ground truth.

Coordinates are pixels, centres at integers, x right, y down. Angles and bends are + for left, that
is anticlockwise as seen on screen.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Picture
from finloop.drawn.carp.draw import OVERSAMPLE, CarpPicture, blur_drawing, draw_carp
from finloop.drawn.carp.midline import (
    midline_bend,
    midline_curvature,
    midline_heading,
    midline_of_pose,
)
from finloop.drawn.carp.motion import CarpMotion, allowed_rectangle, simulate_swimming
from finloop.drawn.carp.settings import CarpFilm
from finloop.drawn.carp.skin import FishColours, Image, paint_fish, paint_floor

Row = dict[str, Any]

SHADOW_OFFSET = (0.050, 0.075)  # of the shadow on the floor, body lengths right and down
SHADOW_BLUR = 0.040  # SD, body lengths
_GREY = np.array([0.299, 0.587, 0.114], np.float32)  # BT.601
NOISE_PAD = 160  # px by which the noise bank exceeds a frame, for random offsets


def is_tank_large_enough(params: CarpFilm) -> bool:
    """Return whether the tank has room for all fish.

    The rectangle in which mass centres may be is at least 1.2 × 1.2 body lengths. Of several fish,
    each needs an area of 2.2 × 2.2 body lengths of the tank.
    """
    x0, y0, x1, y1 = allowed_rectangle(params.width_px, params.height_px, params.body_length_px)
    wide, high = x1 - x0, y1 - y0  # of that rectangle; bodies reach 0.7 beyond it
    if wide < 1.2 or high < 1.2:
        return False
    return params.fish == 1 or params.fish <= (wide + 1.4) * (high + 1.4) / 2.2**2


class _RandomGenerators(NamedTuple):
    """Independent random generators, one for each random property of a film."""

    motion: np.random.Generator
    floor: np.random.Generator
    skin: np.random.Generator
    noise: np.random.Generator
    light: np.random.Generator


def _random_generators(seed: int) -> _RandomGenerators:
    """Return new random generators from a seed."""
    return _RandomGenerators(*map(np.random.default_rng, np.random.SeedSequence(seed).spawn(5)))


def carp_motion(params: CarpFilm) -> CarpMotion:
    """Return the poses of all fish in all frames of the film."""
    return simulate_swimming(
        params.frames,
        params.fish,
        allowed_rectangle(params.width_px, params.height_px, params.body_length_px),
        params.frame_rate_hz,
        fins=params.fins_open_ratio,
        rng=_random_generators(params.seed).motion,
    )


def midline_px(params: CarpFilm, poses: CarpMotion, frame: int, fish: int) -> Floats:
    """Return the midline of a fish in a frame, (65, 2) px, head to tail."""
    index = (frame, fish)
    return params.body_length_px * midline_of_pose(
        poses.x[index], poses.y[index], poses.axis[index], poses.beat[index],
        poses.amplitude[index], poses.bend[index], poses.ripple[index],
    )  # fmt: skip


def fish_colours(params: CarpFilm) -> tuple[FishColours, ...]:
    """Return the colours of every fish, with skin pictures at the resolution of the drawing."""
    columns = max(160, round(params.body_length_px * OVERSAMPLE * 1.5))
    return _paint_all_fish(params.seed, params.fish, columns)


@lru_cache(maxsize=2)  # painting takes as long as drawing some dozen frames
def _paint_all_fish(seed: int, fish: int, columns: int) -> tuple[FishColours, ...]:
    """Return the colours of all fish, from a seed, with skin pictures `columns` px wide."""
    random = _random_generators(seed)
    first_coat = int(random.light.integers(4))  # there are four coats, taken in turn
    return tuple(
        paint_fish(rng, columns, first_coat + i) for i, rng in enumerate(random.skin.spawn(fish))
    )


def light_levels(params: CarpFilm) -> Floats:
    """Return the brightness (frames,) of the light in every frame, about 1."""
    # The generator's first number chooses the colours of the fish, so three others are used.
    phases = _random_generators(params.seed).light.uniform(0, 2 * np.pi, 4)[1:]
    time_s, variation = np.arange(params.frames) / params.frame_rate_hz, np.zeros(params.frames)
    # Three slow waves whose periods do not repeat together.
    for share, period_s, phase in zip((0.62, 0.28, 0.10), (41.0, 17.0, 6.1), phases, strict=True):
        variation += share * np.sin(2 * np.pi * time_s / period_s + phase)
    return 1 + params.light_drift * variation


def empty_tank(params: CarpFilm) -> Image:
    """Return the picture of the tank without fish or noise, in the mean light.

    Grey levels (height, width, 3) RGB, or (height, width, 1) for a grey film.
    """
    empty = paint_floor(params.width_px, params.height_px, _random_generators(params.seed).floor)
    return empty if params.colour else np.ascontiguousarray((empty @ _GREY)[..., None])


def _truth_row(fish: int, frame: int, line: Floats, drawing: CarpPicture, poses: CarpMotion) -> Row:
    """Return the true features of a fish in a frame: a row of `finloop.drawn.truth.TRUTH`.

    fish: its number; line (65, 2): its midline, px; drawing: its picture; poses: of all fish.
    """
    x, y = drawing.centre_px()
    return {
        "fish_id": fish,
        "frame": frame,
        "x_px": x,
        "y_px": y,
        "head_x_px": float(line[0, 0]),
        "head_y_px": float(line[0, 1]),
        "tail_x_px": float(line[-1, 0]),
        "tail_y_px": float(line[-1, 1]),
        "heading_deg": midline_heading(line),
        "body_length_px": float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()),
        "bend": midline_bend(line),
        "curvature_deg": midline_curvature(line),
        "swimming_type": int(poses.swimming_type[frame, fish]),
        "mask_area_px": drawing.area_px(),
        "fins_open": float(poses.fins[frame, fish].mean()),
        "backbone_x_px": line[:, 0].astype(np.float32),
        "backbone_y_px": line[:, 1].astype(np.float32),
    }


def draw_fish_alone(
    params: CarpFilm, poses: CarpMotion, frame: int, fish: int
) -> tuple[Image, Image]:
    """Return a fish of a frame without tank, shadow and noise: premultiplied colour and opacity.

    They are (height, width, 3 or 1) grey levels in the light of the frame, and (height, width) 0-1:
    the true alpha of its cut-out.
    """
    left_fin, right_fin = poses.fins[frame, fish]
    line, colours = midline_px(params, poses, frame, fish), fish_colours(params)[fish]
    drawing = draw_carp(line, (float(left_fin), float(right_fin)), colours)
    empty = np.zeros((params.height_px, params.width_px, 3 if params.colour else 1), np.float32)
    black, white = empty, empty + 255
    vignette = _vignette(empty_tank(params))
    for ground in (black, white):
        _paint_carp(ground, drawing, vignette)
    opacity = 1 - (white - black).mean(axis=2) / 255
    return black * np.float32(light_levels(params)[frame]), opacity


def _vignette(empty: Image) -> Image:
    """Return how bright the light is at each place (h, w) of an empty tank (h, w, 3 or 1)."""
    vignette = cv2.blur(empty.mean(axis=2), (61, 61))
    return np.asarray(vignette / vignette.max(), np.float32)


def _sensor_noise(params: CarpFilm, rng: np.random.Generator) -> Image:
    """Return sensor noise (h, w, 1 or 3), larger than a frame by NOISE_PAD px, for random crops.

    Its SD is `noise_grey` grey levels. A film in colour also has noise of hue, which keeps the grey
    level and is half as strong, as after a camera's denoising.
    """
    shape = (params.height_px + NOISE_PAD, params.width_px + NOISE_PAD)
    grey = rng.standard_normal(shape, np.float32)
    if not params.colour:
        return np.asarray(grey[..., None] * params.noise_grey, np.float32)
    tint = 0.5 * rng.standard_normal((*shape, 3), np.float32)
    tint -= (tint @ _GREY)[..., None]
    return np.asarray((grey[..., None] + tint) * params.noise_grey, np.float32)


def _shade_floor(picture: Image, drawing: CarpPicture, params: CarpFilm) -> tuple[slice, slice]:
    """Darken the floor under a fish in a picture (h, w, 3 or 1), in place.

    Return the rows and columns that have changed.
    """
    sigma = SHADOW_BLUR * params.body_length_px
    pad = int(np.ceil(3 * sigma))
    shadow = cv2.copyMakeBorder(drawing.coverage, pad, pad, pad, pad, cv2.BORDER_CONSTANT)
    shadow = cv2.GaussianBlur(shadow, (0, 0), sigma)
    dx, dy = (round(part * params.body_length_px) for part in SHADOW_OFFSET)
    window, inner = _overlap_windows(
        picture, drawing.x0 + dx - pad, drawing.y0 + dy - pad, shadow.shape
    )
    picture[window] *= 1 - params.shadow * shadow[inner][..., None]
    return window


def _overlap_windows(
    picture: Image, x0: int, y0: int, shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the overlap of a picture and a patch, as slices of each.

    x0, y0: place of the patch in the picture, px; shape: of the patch. They must overlap.
    """
    left, top = max(x0, 0), max(y0, 0)
    right = min(x0 + shape[1], picture.shape[1])
    bottom = min(y0 + shape[0], picture.shape[0])
    return np.s_[top:bottom, left:right], np.s_[top - y0 : bottom - y0, left - x0 : right - x0]


def film_frames(
    params: CarpFilm, poses: CarpMotion | None = None
) -> Iterator[tuple[Picture, list[Row]]]:
    """Yield the frames of the film, each with the true features of its fish.

    poses: of all fish, by default those of `carp_motion`. Fish of higher number cover the others. A
    frame is (height, width, 3) RGB or (height, width) grey, uint8, a new array each time. The
    features are one dictionary per fish, keys as in `finloop.drawn.truth.TRUTH`, sorted by fish_id.
    """
    poses = carp_motion(params) if poses is None else poses
    skins, brightness = fish_colours(params), light_levels(params)
    noise_rng = _random_generators(params.seed).noise
    empty = empty_tank(params)
    vignette = _vignette(empty)  # 1 = brightest, also on the fish
    noise = _sensor_noise(params, noise_rng)
    tank = empty.copy()
    for frame in range(params.frames):
        lines = [midline_px(params, poses, frame, i) for i in range(params.fish)]
        drawings = []
        for i, line in enumerate(lines):
            left_fin, right_fin = poses.fins[frame, i]
            drawings.append(draw_carp(line, (float(left_fin), float(right_fin)), skins[i]))
        # Shadows, then fish, painted into `tank`, which is emptied again where they changed it.
        changed = [_shade_floor(tank, drawing, params) for drawing in drawings]
        changed += [_paint_carp(tank, drawing, vignette) for drawing in drawings]
        y, x = noise_rng.integers(0, NOISE_PAD, 2)  # another part of the noise, perhaps inverted
        sign = 1 - 2 * int(noise_rng.integers(2))
        grain = noise[y : y + params.height_px, x : x + params.width_px]
        picture = cv2.addWeighted(tank, float(brightness[frame]), grain, sign, 0, dtype=cv2.CV_8U)
        for window in changed:
            tank[window] = empty[window]
        rows = [_truth_row(i, frame, lines[i], drawings[i], poses) for i in range(params.fish)]
        yield np.asarray(picture), rows


def _paint_carp(picture: Image, drawing: CarpPicture, vignette: Image) -> tuple[slice, slice]:
    """Paint a fish into a picture (h, w, 3 or 1), in place; return the changed rows and columns.

    vignette (h, w): how bright the light is at each place, 1 = brightest.
    """
    colour, opacity = blur_drawing(drawing)
    if picture.shape[2] == 1:
        colour = (colour @ _GREY)[..., None]
    window, inner = _overlap_windows(picture, drawing.x0, drawing.y0, opacity.shape)
    transparency = 1 - opacity[inner][..., None]
    lit_colour = colour[inner] * vignette[window][..., None]
    picture[window] = picture[window] * transparency + lit_colour
    return window
