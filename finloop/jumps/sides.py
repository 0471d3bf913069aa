"""Whether a fish may be mirrored: how much its two sides differ, in look and in motion."""

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.stretches import spread_rows
from finloop.distance.picture import distance_pair_by_pair
from finloop.jumps.signature import SignatureParts, StraightPictures

_ROWS = 300  # most pictures that are compared


def sides_apart(straight: StraightPictures, track: Ints, seed: int = 0) -> float:
    """Return how much a fish differs from its mirror image, over how much its pictures differ.

    1 or less: the sides are alike. All pictures are drawn in one posture; their distance is
    Euclidean (Eq. 5). Both distances are medians over rows spread over the film; the second picture
    is of a random row of the same track. track (n,): rising ids; seed: of the random rows.
    """
    n = len(track)
    rng = np.random.default_rng(seed)
    rows = spread_rows(np.arange(n), _ROWS)
    first, last = np.searchsorted(track, track[rows]), np.searchsorted(track, track[rows], "right")
    own, random = straight(rows), straight(rng.integers(first, last))
    mirror, usual = (
        float(np.median(distance_pair_by_pair(own, against))) for against in (own[:, ::-1], random)
    )
    return mirror / max(usual, 1e-12)


def handedness(parts: SignatureParts, block: int) -> float:
    """Return how much more a fish bends, drifts or turns to one side than to the other, 0 … 1.

    0: both sides alike, as far as the film can show; 1: only one side. It is a lower limit, the
    largest of the three. Each takes the odd part, which changes sign in the mirror: its mean, less
    twice that mean's standard error, over its root mean square. The error is that of means over
    `block` rows, since a circling fish repeats itself within a block. A single block gives 0.
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
