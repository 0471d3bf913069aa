"""Whether a fish may be shown mirrored: how much its two sides differ."""

import numpy as np

from finloop.base.arrays import Ints
from finloop.distance.picture import apart
from finloop.jumps.signature import Straight

_ROWS = 300  # pictures at most


def sides_apart(straight: Straight, track: Ints, seed: int = 0) -> float:
    """How many times as far a fish is from its mirror image as its pictures are from each other.

    All are drawn in one posture, and compared by Eq. 5; medians over rows spread over the film, of
    which each is compared with a random one of the same track (n,). About 1 or less: the sides are
    alike.
    """
    n = len(track)
    rng = np.random.default_rng(seed)
    rows = np.unique(np.linspace(0, n - 1, min(n, _ROWS)).astype(np.intp))
    first, last = np.searchsorted(track, track[rows]), np.searchsorted(track, track[rows], "right")
    one, other = straight(rows), straight(rng.integers(first, last))
    mirror, usual = (float(np.median(apart(one, two))) for two in (one[:, ::-1], other))
    return mirror / max(usual, 1e-12)
