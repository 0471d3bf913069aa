"""Interpolation between pixels by Keys' cubic kernel, a = −1/2, and the blur of it undone."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.base.kernel import kernel

_OVERLAP = 57 / 70, 71 / 560, -1 / 28, 1 / 560  # integrals of the kernel times itself k px aside
_REACH = 5  # px that the sharpening reaches: beyond, its weights are below a thousandth


@kernel
def keys_cubic_weights(t: float) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return the weights of pixels −1, 0, 1 and 2 in Keys' cubic interpolation, four float32.

    t: place in [0, 1) between pixel 0 and pixel 1. Keys' parameter a is −1/2.
    """
    return (
        np.float32(((2 - t) * t - 1) * t / 2),
        np.float32(((3 * t - 5) * t * t + 2) / 2),
        np.float32(((4 - 3 * t) * t + 1) * t / 2),
        np.float32((t - 1) * t * t / 2),
    )


def sharpen_for_interpolation(pixels: Picture) -> NDArray[np.float32]:
    """Return a picture (h, w, c) float32 sharpened by as much as cubic interpolation blurs it.

    Over all shifts by parts of a pixel, the mean sum of squares is then that of `pixels`: the
    integral over the square of the interpolated picture is the sum over their squares (as of the
    orthonormal splines of Battle and Lemarié). Values may leave 0 … 255; outside of the picture all
    is 0.
    """
    weights = _sharpening_weights()
    return np.asarray(
        cv2.sepFilter2D(pixels, cv2.CV_32F, weights, weights, borderType=cv2.BORDER_CONSTANT)
    ).reshape(pixels.shape)


@cache
def _sharpening_weights() -> Floats:
    """Return the weights of the 2 _REACH + 1 pixels in a row that sharpen it, whose sum is 1."""
    frequency = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    power = _OVERLAP[0] + 2 * sum(
        overlap * np.cos(k * frequency) for k, overlap in enumerate(_OVERLAP[1:], start=1)
    )
    weights = np.fft.fftshift(np.fft.ifft(power**-0.5).real)[32 - _REACH : 33 + _REACH]
    return np.asarray(weights / weights.sum())
