"""A drawn insect that walks, seen from above, with the truth about its axis in every frame.

Its body is stiff and its head is the thin end. Six legs step in two groups of three: while one
group is on the ground and moves back under the body, the other swings forward. Two antennae swing.
The insect walks round an ellipse, and its axis is the tangent.

*Body frame*: x forward, y to the left, in body lengths; the origin is the middle of the axis.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Picture

_BODY = ((-0.2, 0.3, 0.155), (0.13, 0.18, 0.12), (0.37, 0.13, 0.085))  # middle, half length, width
_HIPS = np.array([0.22, 0.12, 0.0])  # x, of the fore, middle and hind legs
_FEET = np.array([[0.5, 0.3], [0.1, 0.42], [-0.3, 0.4]])  # x, y in the middle of a step
_STEP = 0.2  # range of a foot under the body
_ANTENNA = (0.48, 0.25, 0.5, 0.35)  # root, length, mean angle and swing [radians]
_FINER = 4  # the insect is drawn so many times as large, and reduced: thin legs keep their width
_SUBPIXEL = 4  # bits of a pixel's fraction in the drawing
_FLOOR, _COAT, _LEG = 205, 60, 95  # grey levels
_BLUR_PX = 0.7


@dataclass(frozen=True)
class WalkerFilm:
    """A film of the drawn insect; lengths of its parts are in body lengths."""

    frames: int = 60
    frame_rate_hz: float = 25.0
    width_px: int = 320
    height_px: int = 240
    body_length_px: float = 60.0
    leg_width: float = 0.05
    steps_hz: float = 3.0
    noise_grey: float = 1.5
    seed: int = 1


def walker_truth(film: WalkerFilm) -> pd.DataFrame:
    """Return the truth about the insect: a row per frame, with columns of `finloop.drawn.TRUTH`.

    These are `frame`, `x_px`, `y_px` (the middle of the axis), `head_x_px`, `head_y_px`,
    `tail_x_px`, `tail_y_px`, `heading_deg` and `body_length_px`.
    """
    length, frame = film.body_length_px, np.arange(film.frames)
    size = np.array([film.width_px, film.height_px])
    radius = 0.5 * size - 0.85 * length  # legs stay in the picture
    # Each foot on the ground stays there: the body advances by a step in half a period.
    speed_px = 2 * _STEP * length * film.steps_hz / film.frame_rate_hz  # per frame
    angle = 0.4 + speed_px / np.hypot(*radius) * np.sqrt(2) * frame
    middle = 0.5 * (size - 1) + radius * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    ahead = radius * np.stack([-np.sin(angle), -np.cos(angle)], axis=1)
    ahead /= np.hypot(*ahead.T)[:, None]
    head, tail = middle + 0.5 * length * ahead, middle - 0.5 * length * ahead
    return pd.DataFrame(
        {
            "frame": frame,
            **{"x_px": middle[:, 0], "y_px": middle[:, 1]},
            **{"head_x_px": head[:, 0], "head_y_px": head[:, 1]},
            **{"tail_x_px": tail[:, 0], "tail_y_px": tail[:, 1]},
            "heading_deg": np.degrees(np.arctan2(-ahead[:, 1], ahead[:, 0])),
            "body_length_px": length,
        }
    )


def walker_frames(film: WalkerFilm) -> Iterator[Picture]:
    """Yield the frames of the insect's film, (height, width) uint8."""
    rng = np.random.default_rng(film.seed)
    shape = (film.height_px, film.width_px)
    large_shape = (_FINER * film.height_px, _FINER * film.width_px)
    for row in walker_truth(film).itertuples():
        middle = _FINER * (np.array([row.x_px, row.y_px]) + 0.5) - 0.5  # pixel centres: integers
        ahead = np.array([row.head_x_px - row.x_px, row.head_y_px - row.y_px]) * 2 * _FINER
        axes = np.stack([ahead, [ahead[1], -ahead[0]]])  # y points down, so the left is so
        large = np.full(large_shape, _FLOOR, np.uint8)
        phase = row.frame * film.steps_hz / film.frame_rate_hz
        for line, thickness in _limbs_at(phase):
            points = middle + line @ axes
            width = max(1, round(_FINER * thickness * film.leg_width * film.body_length_px))
            cv2.polylines(large, [_subpixels(points)], False, _LEG, width, cv2.LINE_AA, _SUBPIXEL)
        circle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        for forward, half_length, half_width in _BODY:
            ring = [forward + half_length * np.cos(circle), half_width * np.sin(circle)]
            points = middle + np.stack(ring, axis=1) @ axes
            cv2.fillPoly(large, [_subpixels(points)], _COAT, cv2.LINE_AA, _SUBPIXEL)
        picture = cv2.resize(large, shape[::-1], interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(picture, (0, 0), _BLUR_PX)
        noise = film.noise_grey * rng.standard_normal(shape, np.float32)
        yield np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)


def _subpixels(points: Floats) -> Picture:
    """Return points (n, 2) px as whole subpixels, for OpenCV."""
    return np.rint(points * (1 << _SUBPIXEL)).astype(np.int32)


def _limbs_at(phase: float) -> list[tuple[Floats, float]]:
    """Return the lines (k, 2) of legs and antennae from root to tip, and their relative widths.

    The lines are in the body frame. phase: steps since the film began.
    """
    lines = []
    for leg, (hip, foot) in enumerate(zip(_HIPS, _FEET, strict=True)):
        for side in (1, -1):
            share = (phase + 0.5 * (leg % 2 == (side > 0))) % 1
            # Back under the body in the first half, forward in the second.
            reach = _STEP * (0.5 - 2 * share if share < 0.5 else 2 * share - 1.5)
            tip = foot + np.array([reach, 0.0])
            knee = 0.55 * tip + 0.45 * np.array([hip, 0.06]) + np.array([0.0, 0.06])
            lines.append((np.array([[hip, 0.06], knee, tip]) * (1, side), 1.0))
    root, length, mean, swing = _ANTENNA
    for side in (1, -1):
        angle = mean + swing * np.sin(2 * np.pi * 0.37 * phase + side)
        tip = root + length * np.cos(angle), length * np.sin(angle)
        lines.append((np.array([[root, 0.02], tip]) * (1, side), 0.5))
    return lines
