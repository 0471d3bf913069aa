"""Where animals can be: a mask of the picture.

Masks are (height, width) bool, True inside. x runs right, y down, and the centre of pixel (row 0,
column 0) is the point (0, 0).
"""

import numpy as np

from finloop.base.errors import FinloopError


def rectangle_arena(
    width: int, height: int, left_px: float, top_px: float, width_px: float, height_px: float
) -> np.ndarray:
    """Return the mask (height, width) of the picture's pixels whose centres lie in a rectangle.

    width, height: the picture's size, px; left_px, top_px: the rectangle's upper left corner. Its
    left and top edges belong to it, the right and bottom ones do not: 10 px wide from 0 is the
    columns 0 … 9. FinloopError if no pixel of the picture lies in it.
    """
    x, y = np.arange(width), np.arange(height)[:, None]
    mask = (x >= left_px) & (x < left_px + width_px) & (y >= top_px) & (y < top_px + height_px)
    shape = (
        f"rectangle of {width_px:g}×{height_px:g} px with its corner at ({left_px:g}, {top_px:g})"
    )
    return _not_empty(mask, shape)


def circle_arena(width: int, height: int, x_px: float, y_px: float, radius_px: float) -> np.ndarray:
    """Return the mask (height, width) of the picture's pixels whose centres lie in or on a circle.

    width, height: the picture's size, px; x_px, y_px: the circle's centre. FinloopError if no pixel
    of the picture lies in it.
    """
    x, y = np.arange(width), np.arange(height)[:, None]
    mask = (x - x_px) ** 2 + (y - y_px) ** 2 <= radius_px**2
    return _not_empty(mask, f"circle of radius {radius_px:g} px about ({x_px:g}, {y_px:g})")


def _not_empty(mask: np.ndarray, shape: str) -> np.ndarray:
    if not mask.any():
        height, width = mask.shape
        raise FinloopError(
            came=f"the arena lies outside the picture: a {shape}",
            wanted=f"an arena that covers part of the picture, x 0 … {width - 1}, "
            f"y 0 … {height - 1} (x right, y down, in the upright picture)",
            do="correct clip.arena",
        )
    return mask
