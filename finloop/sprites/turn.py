"""Turn a cut-out about its mass centre, without fringes and without clipping (fish paper §3.3).

Pictures are premultiplied (h, w, channels) uint8, alpha last: only such neighbours may be mixed,
else the colour under transparent pixels bleeds into the edge. Angles are degrees, anticlockwise as
seen; y is down. Pixel centres lie at integers.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.cutout import Cutout

_REACH = 4  # px that a Lanczos kernel of four lobes reaches beyond a pixel


def rotation(angle_deg: float) -> Floats:
    """Return the matrix (2, 2) that turns points (x right, y down) anticlockwise as seen.

    It is exact at multiples of 90°.
    """
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    if angle_deg % 90 == 0:
        c, s = np.round([c, s])
    return np.array([[c, s], [-s, c]])


def reflection(axis_deg: float) -> Floats:
    """Return the matrix (2, 2) that mirrors points (x right, y down) about a line through 0.

    axis_deg: the direction of that line, anticlockwise as seen.
    """
    return rotation(axis_deg) @ np.diag([1.0, -1.0]) @ rotation(-axis_deg)


def turn_cutout(
    source: Cutout, x_px: float, y_px: float, angle_deg: float, mirror_axis_deg: float | None = None
) -> Cutout:
    """Return a cut-out turned by `angle_deg` anticlockwise as seen about (x_px, y_px).

    x_px, y_px: px of the film; this point stays in place. With `mirror_axis_deg` the cut-out is
    first mirrored about the line of that direction through the same point. Both are one resampling
    (Lanczos, four lobes), trimmed to the visible pixels. A turn by 0, or by any angle that maps
    pixels to pixels, is exact.
    """
    angle_deg %= 360
    if angle_deg == 0 and mirror_axis_deg is None:
        return source
    linear = rotation(angle_deg)
    if mirror_axis_deg is not None:
        linear = linear @ reflection(mirror_axis_deg)
    return _transform_cutout(source, np.array([x_px, y_px]), linear)


def _transform_cutout(source: Cutout, pivot: Floats, linear: Floats) -> Cutout:
    """Apply the rigid map p ↦ pivot + linear (p − pivot) to `source`."""
    h, w = source.pixels.shape[:2]
    origin = np.array([source.x0_px, source.y0_px])
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]) + origin
    there = (corners - pivot) @ linear.T + pivot
    low = np.floor(there.min(0)).astype(int) - _REACH
    high = np.ceil(there.max(0)).astype(int) + _REACH
    back = linear.T  # rigid: the inverse
    offset = pivot - origin + back @ (low - pivot)  # in the source, under the canvas's first pixel
    matrix = np.column_stack([back, offset])
    width, height = (high - low + 1).tolist()
    canvas = cv2.warpAffine(
        source.pixels.astype(np.float32), matrix, (width, height),
        flags=cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT,
    )  # fmt: skip
    left, top, pixels = trim_picture(_limit_colours(canvas))
    return source._replace(pixels=pixels, x0_px=int(low[0]) + left, y0_px=int(low[1]) + top)


def _limit_colours(canvas: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Limit the canvas to 0 ≤ colour ≤ alpha ≤ 255, which the filter overshoots.

    Where alpha exceeds 255, the colour is lowered with it; otherwise edges would shine.
    """
    alpha = canvas[..., -1:]
    level = canvas * (255 / np.maximum(alpha, 255))
    pixels = np.rint(np.clip(level, 0, 255)).astype(np.uint8)
    np.minimum(pixels[..., :-1], pixels[..., -1:], out=pixels[..., :-1])
    return pixels


def trim_picture(pixels: NDArray[np.uint8]) -> tuple[int, int, NDArray[np.uint8]]:
    """Return left and top [px], and the smallest part (h, w, channels) that has all visible pixels.

    A wholly transparent picture is trimmed to its first pixel.
    """
    rows = np.flatnonzero(pixels[..., -1].any(1))
    columns = np.flatnonzero(pixels[..., -1].any(0))
    if not rows.size:
        return 0, 0, pixels[:1, :1]
    top, left = int(rows[0]), int(columns[0])
    return left, top, np.ascontiguousarray(pixels[top : rows[-1] + 1, left : columns[-1] + 1])
