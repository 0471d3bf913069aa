"""An exact test of whether two edges meet (Shewchuk 1997).

*Adaptive precision floating-point arithmetic and fast robust geometric predicates*: the test
computes an orientation in floats, and repeats it without rounding if rounding could change its
sign. Products must neither overflow nor underflow: magnitudes 0 or 1e-70 … 1e70 are safe.
"""

import numpy as np

from finloop.base.arrays import Points
from finloop.base.kernel import kernel

_SURE = (3 + 16 * 2.0**-53) * 2.0**-53  # Shewchuk's ccwerrboundA
_SPLIT = 134217729.0  # 2^27 + 1


@kernel
def _two_product(a: float, b: float) -> tuple[float, float]:
    """Return a·b as a float, and its rounding error (Dekker)."""
    product = a * b
    wide = _SPLIT * a
    a_high = wide - (wide - a)
    a_low = a - a_high
    wide = _SPLIT * b
    b_high = wide - (wide - b)
    b_low = b - b_high
    rest = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, rest


@kernel
def _exact_sign(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return the determinant's sign, adding its six products without rounding (grow-expansion)."""
    left = (ax, -ay, bx, -by, cx, -cy)
    right = (by, bx, cy, cx, ay, ax)
    sums = np.zeros(12)
    count = 0
    for k in range(6):
        high, low = _two_product(left[k], right[k])
        for term in (low, high):
            q = term
            for m in range(count):
                total = q + sums[m]
                part = total - q
                sums[m] = (q - (total - part)) + (sums[m] - part)
                q = total
            sums[count] = q
            count += 1
    for k in range(11, -1, -1):
        if sums[k] > 0:
            return 1
        if sums[k] < 0:
            return -1
    return 0


@kernel
def _orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return the exact sign of (a − c) × (b − c)."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    det = left - right
    if abs(det) > _SURE * (abs(left) + abs(right)):
        return 1 if det > 0 else -1
    return _exact_sign(ax, ay, bx, by, cx, cy)


@kernel
def segments_meet(points: Points, a: int, b: int, c: int, d: int) -> bool:
    """Return whether the segments ab and cd share a point, without rounding errors.

    points (n, 2): corners of a polygon; a, b, c, d: rows of the segments' ends. The bounding boxes
    of the two segments must overlap.
    """
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    cx, cy, dx, dy = points[c, 0], points[c, 1], points[d, 0], points[d, 1]
    abc = _orientation(ax, ay, bx, by, cx, cy)
    abd = _orientation(ax, ay, bx, by, dx, dy)
    if abc * abd > 0:
        return False
    # If all four lie on one line, overlapping boxes are overlapping segments.
    return _orientation(cx, cy, dx, dy, ax, ay) * _orientation(cx, cy, dx, dy, bx, by) <= 0


@kernel
def turns_back(px: float, py: float, qx: float, qy: float, rx: float, ry: float) -> bool:
    """Return whether the edges pq and qr, both longer than 0, share more than their corner q."""
    if _orientation(px, py, qx, qy, rx, ry) != 0:
        return False
    return ((px > qx) == (rx > qx) and px != qx) or ((py > qy) == (ry > qy) and py != qy)
