"""Pictures of fewer pixels, to be measured."""

import math

import cv2
import numpy as np

SAMPLE_PIXELS = 5e5  # most pixels of a thinned picture


def thin_frame(frame: np.ndarray) -> np.ndarray:
    """Return a frame (h, w[, 3]) thinned to every k-th row and column, so that measuring is quick.

    k is the least number that leaves at most `SAMPLE_PIXELS` pixels.
    """
    step = math.ceil(math.sqrt(frame.shape[0] * frame.shape[1] / SAMPLE_PIXELS))
    if frame.ndim == 3 and frame.dtype == np.uint8:  # OpenCV takes less time
        size = math.ceil(frame.shape[1] / step), math.ceil(frame.shape[0] / step)
        grid = np.array([[step, 0, 0], [0, step, 0]], np.float32)
        nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpAffine(frame, grid, size, flags=nearest))
    return frame[::step, ::step].copy()
