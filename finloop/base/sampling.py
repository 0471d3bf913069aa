"""Interpolation weights between pixels."""

import numpy as np

from finloop.base.kernel import kernel


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
