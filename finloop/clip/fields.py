"""Interlaced film: two fields, half a frame apart in time, are woven into one picture.

Where something moves, every other row then belongs to another moment. The later field of a frame
and the earlier one of the next are one step of time apart, the earlier and the later three; in
whole pictures both pairs are two steps apart.
"""

import numpy as np

from finloop.base.arrays import Picture

_THIN = 4  # every 4th column is enough
_MOTION = 12  # least change [grey levels] from frame to frame of a moved pixel
_FEW = 50  # least number of moved pixels of a frame that is judged


def field_order(before: Picture, frame: Picture) -> float:
    """Return a number that tells which field of interlaced film is earlier: above 0 the upper one.

    Below 0 it is the lower one. before, frame (h, w): two successive grey frames. The number is the
    relative difference between two mean squares: lower field before against upper field now, and
    the reverse. Only what moved counts: whole pictures give 0, interlaced ones up to ±0.8. NaN
    where too little moved.
    """
    last, here = (picture[:, ::_THIN].astype(np.float64) for picture in (before, frame))
    motion = np.abs(here - last) >= _MOTION
    rows = (len(last) - 1) // 2 * 2
    near = motion[:rows:2] | motion[1:rows:2] | motion[2 : rows + 1 : 2]
    if near.sum() < _FEW:
        return float("nan")
    # A row of the lower field lies between two of the upper: it is compared with their mean.
    upper = [(picture[:rows:2] + picture[2 : rows + 1 : 2]) / 2 for picture in (last, here)]
    lower = [picture[1:rows:2] for picture in (last, here)]
    if_upper = float(((lower[0] - upper[1])[near] ** 2).mean())
    if_lower = float(((upper[0] - lower[1])[near] ** 2).mean())
    whole = if_upper + if_lower
    return (if_lower - if_upper) / whole if whole else 0.0
