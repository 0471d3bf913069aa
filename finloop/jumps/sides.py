"""Whether a fish may be shown mirrored: how much its two sides differ, in look and in motion."""

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.stretches import spread
from finloop.distance.picture import apart
from finloop.jumps.signature import Parts, Straight

_ROWS = 300  # pictures at most


def sides_apart(straight: Straight, track: Ints, seed: int = 0) -> float:
    """How many times as far a fish is from its mirror image as its pictures are from each other.

    All are drawn in one posture, and compared by Eq. 5; medians over rows spread over the film, of
    which each is compared with a random one of the same track (n,). About 1 or less: the sides are
    alike.
    """
    n = len(track)
    rng = np.random.default_rng(seed)
    rows = spread(np.arange(n), _ROWS)
    first, last = np.searchsorted(track, track[rows]), np.searchsorted(track, track[rows], "right")
    one, other = straight(rows), straight(rng.integers(first, last))
    mirror, usual = (float(np.median(apart(one, two))) for two in (one[:, ::-1], other))
    return mirror / max(usual, 1e-12)


def handedness(made: Parts) -> float:
    """How much more a fish bends, goes aside or turns to one side than to the other.

    Of each the length of its mean to the root mean square, of what changes in the mirror; the
    largest. 0: all is done to both sides alike; 1: to one side alone.
    """
    largest = 0.0
    for both in (made.pose, made.motion[..., 1:2], made.motion[..., 2:]):
        odd = (both[0] - both[1]) / 2
        square = float((odd**2).mean(0).sum())
        largest = max(largest, float(np.linalg.norm(odd.mean(0))) / max(square, 1e-24) ** 0.5)
    return largest
