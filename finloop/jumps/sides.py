"""Whether a fish may be shown mirrored: how much its two sides differ, in look and in motion."""

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.stretches import spread
from finloop.distance.picture import apart
from finloop.jumps.signature import SignatureParts, Straight

_ROWS = 300  # pictures at most


def sides_apart(straight: Straight, track: Ints, seed: int = 0) -> float:
    """Distance of a fish from its mirror image, over the distance of two pictures of its track.

    All pictures are drawn in one posture and compared by Eq. 5. Both distances are medians over
    rows spread over the film; the second picture is a random row of the same track (n,). About 1 or
    less: the sides are alike.
    """
    n = len(track)
    rng = np.random.default_rng(seed)
    rows = spread(np.arange(n), _ROWS)
    first, last = np.searchsorted(track, track[rows]), np.searchsorted(track, track[rows], "right")
    own, random = straight(rows), straight(rng.integers(first, last))
    mirror, usual = (float(np.median(apart(own, against))) for against in (own[:, ::-1], random))
    return mirror / max(usual, 1e-12)


def handedness(parts: SignatureParts, block: int) -> float:
    """How much more a fish bends, drifts or turns to one side than to the other, 0 … 1, at least.

    The odd part of each is what changes sign in the mirror. Its mean, less twice the standard error
    of that, over its root mean square is taken, of the three the largest. 0: both sides alike, as
    far as the film can tell; 1: one side alone. The error is that of means over `block` rows: in a
    block a fish that circles tells the same thing again. Of a single block nothing is told.
    """
    largest = 0.0
    for both in (parts.pose, parts.motion[..., 1:2], parts.motion[..., 2:]):
        odd = (both[0] - both[1]) / 2
        blocks = np.array_split(odd, max(1, len(odd) // block))
        if len(blocks) == 1:
            break
        means = np.stack([one.mean(0) for one in blocks])
        error = float(means.var(0, ddof=1).sum() / len(means)) ** 0.5
        mean = max(float(np.linalg.norm(odd.mean(0))) - 2 * error, 0.0)
        square = float((odd**2).mean(0).sum())
        largest = max(largest, mean / max(square, 1e-24) ** 0.5)
    return largest
