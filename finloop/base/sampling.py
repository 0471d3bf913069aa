"""Weights of pixels between pixels."""

import numpy as np

from finloop.base.kernel import kernel


@kernel
def keys(t):  # type: ignore[no-untyped-def]
    """Weights of the pixels −1, 0, 1, 2 for a place t in [0, 1) after pixel 0 (Keys, a = −1/2)."""
    return (
        np.float32(((2 - t) * t - 1) * t / 2),
        np.float32(((3 * t - 5) * t * t + 2) / 2),
        np.float32(((4 - 3 * t) * t + 1) * t / 2),
        np.float32((t - 1) * t * t / 2),
    )
