"""Distance between pictures of fish (fish paper Eq. 5): D = ‖F − F′‖₂ over centred cut-outs."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

SPAN = 1.5  # body lengths across a centred picture: a fish in any direction, its bends too


def centred(
    pixels: NDArray[np.uint8],
    centre: tuple[float, float],
    length_px: float,
    size: int,
    turn_deg: float = 0.0,
) -> NDArray[np.float32]:
    """A premultiplied cut-out (h, w, c) with its mass centre in the middle of (size, size, c).

    `centre` is x, y in the cut-out, `length_px` its body length: all fish come out equally long.
    `turn_deg` turns it anticlockwise as seen.
    """
    scale = size / (SPAN * length_px)
    matrix = cv2.getRotationMatrix2D(centre, turn_deg, scale)
    matrix[:, 2] += (size - 1) / 2 - np.array(centre)
    # A linear filter thins out where it shrinks: blur first, as an area filter would.
    source = pixels.astype(np.float32)
    if scale < 0.75:
        source = cv2.GaussianBlur(source, (0, 0), 0.4 / scale)
    return cv2.warpAffine(source, matrix, (size, size), flags=cv2.INTER_LINEAR)


def distance(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float64]:
    """Eq. 5 between pictures (n, …) and (m, …) of one size, as (n, m)."""
    return cdist(a.reshape(len(a), -1), b.reshape(len(b), -1))


def steps(pictures: NDArray[np.float32]) -> NDArray[np.float64]:
    """Eq. 5 from each picture (n, …) to the next, as (n − 1,)."""
    flat = pictures.reshape(len(pictures), -1)
    return np.linalg.norm(np.diff(flat, axis=0), axis=1).astype(float)
