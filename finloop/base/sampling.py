"""Interpolation weights between pixels."""

import numpy as np

from finloop.base.kernel import kernel


@kernel
def keys(t):  # type: ignore[no-untyped-def]
    """Return Keys' weights (a = −1/2) of pixels −1, 0, 1, 2 at t in [0, 1) after pixel 0."""
    return (
        np.float32(((2 - t) * t - 1) * t / 2),
        np.float32(((3 * t - 5) * t * t + 2) / 2),
        np.float32(((4 - 3 * t) * t + 1) * t / 2),
        np.float32((t - 1) * t * t / 2),
    )
