"""Kernels of the painter: they sample turned pictures, and lay them over the canvas."""

import math

import numpy as np

from finloop.base.kernel import kernel, leaf_kernel
from finloop.base.sampling import keys_weights

_ONE = np.float32(1)


@leaf_kernel
def _sample(pixels, near, u, v):  # type: ignore[no-untyped-def]
    """Return red, green, blue (grey: thrice), alpha at (u, v), 0 ≤ colour ≤ alpha ≤ 255."""
    channels = pixels.shape[2]
    column, row = math.floor(u), math.floor(v)
    red = green = blue = alpha = np.float32(0)
    if near[row, column]:
        across, down = keys_weights(u - column), keys_weights(v - row)
        for j in range(4):
            r = g = b = a = np.float32(0)
            line = pixels[row - 1 + j]
            if channels == 4:
                for i in range(4):
                    weight = across[i]
                    r += weight * line[column - 1 + i, 0]
                    g += weight * line[column - 1 + i, 1]
                    b += weight * line[column - 1 + i, 2]
                    a += weight * line[column - 1 + i, 3]
            else:
                for i in range(4):
                    r += across[i] * line[column - 1 + i, 0]
                    a += across[i] * line[column - 1 + i, 1]
            red += down[j] * r
            green += down[j] * g
            blue += down[j] * b
            alpha += down[j] * a
        if channels == 2:
            green = blue = red
        # Where alpha overshoots, the colour follows: a fish of the tank's colour stays invisible.
        alpha, share = max(alpha, np.float32(0)), min(np.float32(255) / max(alpha, _ONE), _ONE)
        alpha *= share
        red = min(max(red * share, np.float32(0)), alpha)
        green = min(max(green * share, np.float32(0)), alpha)
        blue = min(max(blue * share, np.float32(0)), alpha)
    return red, green, blue, alpha


@leaf_kernel
def _span(m, y, shape, ends):  # type: ignore[no-untyped-def]
    """Return the half-open range of x, within `ends`, where the kernel can read for row y."""
    start, stop = ends
    for slope, offset, most in (
        (m[0], m[1] * y + m[2], shape[1] - 2), (m[3], m[4] * y + m[5], shape[0] - 2),
    ):  # fmt: skip
        if abs(slope) < 1e-9:
            if not 1 <= offset < most:
                return 0, 0
            continue
        low, high = (1 - offset) / slope, (most - offset) / slope
        if slope < 0:
            low, high = high, low
        start, stop = max(start, math.ceil(low - 1e-6)), min(stop, math.floor(high + 1e-6) + 1)
    return start, stop


@leaf_kernel
def _locate_pixel(m, x, y, shape):  # type: ignore[no-untyped-def]
    """Return where (x, y) lies in a picture, (u, v), and whether the kernel can read around it."""
    u, v = m[0] * x + m[1] * y + m[2], m[3] * x + m[4] * y + m[5]
    return u, v, 1 <= u < shape[1] - 2 and 1 <= v < shape[0] - 2


@kernel
def lay(canvas, box, fish, partner, share):  # type: ignore[no-untyped-def]
    """Lay (1 − share) fish + share partner, both a `painter.Layer`, over the canvas, in place.

    canvas: (H, W, 1 or 3) uint8; box: top, left, bottom, right of what is drawn; share: 0 … 1.
    """
    top, left, bottom, right = box
    # Unpacked here: within the loop every access to a tuple would count its references.
    pixels, near, m = fish
    other, other_near, n = partner
    shape, other_shape = near.shape, other_near.shape
    keep, share = np.float32(1 - share), np.float32(share)
    for y in range(top, bottom):
        start, stop = _span(m, y, shape, (left, right)) if keep > 0 else (right, left)
        if share > 0:
            first, last = _span(n, y, other_shape, (left, right))
            if first < last:
                start, stop = min(start, first), max(stop, last)
        for x in range(start, stop):
            red = green = blue = alpha = np.float32(0)
            u, v, seen = _locate_pixel(m, x, y, shape)
            if keep > 0 and seen:
                r, g, b, a = _sample(pixels, near, u, v)
                red, green, blue, alpha = keep * r, keep * g, keep * b, keep * a
            if share > 0:
                u, v, seen = _locate_pixel(n, x, y, other_shape)
                if seen:
                    r, g, b, a = _sample(other, other_near, u, v)
                    red += share * r
                    green += share * g
                    blue += share * b
                    alpha += share * a
            if alpha > 0:
                through = 1 - alpha / np.float32(255)
                pixel = canvas[y, x]
                pixel[0] = np.uint8(red + through * pixel[0] + np.float32(0.5))
                if canvas.shape[2] == 3:
                    pixel[1] = np.uint8(green + through * pixel[1] + np.float32(0.5))
                    pixel[2] = np.uint8(blue + through * pixel[2] + np.float32(0.5))


@kernel
def lay_pixels(canvas, drawn):  # type: ignore[no-untyped-def]
    """Lay a premultiplied picture (h, w, 2 or 4), 0 … 1, over a canvas (h, w, 1 or 3) uint8."""
    height, width, channels = drawn.shape
    for y in range(height):
        for x in range(width):
            alpha = drawn[y, x, channels - 1]
            if alpha > 0:
                through = _ONE - alpha
                for c in range(canvas.shape[2]):
                    level = np.float32(255) * drawn[y, x, min(c, channels - 2)]
                    canvas[y, x, c] = np.uint8(level + through * canvas[y, x, c] + np.float32(0.5))
