"""Corresponding points of two poses whose parts turn, as limbs and tails do.

A closed contour is renumbered so that it is most like the other contour, up to a turn. Contours are
complex here, a = x + iy about their mean, and likeness is |z| + UPRIGHT · Re z with
z = Σ a_i conj(b_j): |z| is the likeness after the best turn. The second part decides for contours
that look the same turned, such as an eye: they should not turn.
"""

from collections.abc import Mapping

import numpy as np

from finloop.base.arrays import Complex, Ints, Points
from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, orient_clockwise, resample_curve
from finloop.gait.model import Symmetry, partner, reversal

UPRIGHT = 0.02
FINE = 8  # start points tried between two points of a contour


def match_poses(
    key1: Drawing, key2: Drawing, symmetry: Symmetry, points: int
) -> tuple[dict[str, Points], dict[str, Points]]:
    """Return the contours (points, 2) of both key poses by id, with corresponding rows.

    In a swap the rows of left and right limbs correspond too: the first of the pair in drawing
    order numbers all four contours. FinloopError if a limb is closed and its partner or its other
    pose open.
    """
    first, second = dict[str, Points](), dict[str, Points]()
    for name, curve in key1.curves.items():
        twin = partner(name, key1.curves) if symmetry == "swap" else name
        kinds = {which.closed for which in (curve, key1.curves[twin], key2.curves[name])}
        if len(kinds) > 1:
            raise FinloopError(
                f"one of {name!r} and {twin!r} is closed, the other open",
                "contours that are closed in every pose, left and right, or open in every pose",
                "close all of them, or none",
            )
        model = first.get(twin, resample_curve(orient_clockwise(curve), points).points)
        first[name] = renumber_curve(model, curve) if twin in first else model
        second[name] = renumber_curve(model, key2.curves[name])
    return first, second


def renumber_curve(model: Points, curve: Curve) -> Points:
    """Return the curve resampled to n points (n, 2), numbered to be most like `model` (n, 2).

    A closed curve may start between two points: an error of half a step would make feet slide.
    """
    a, n = _complex(model), len(model)
    if not curve.closed:
        points = resample_curve(curve, n).points
        ways = [points, points[::-1]]
        return max(ways, key=lambda way: float(likeness(a @ _complex(way).conj())))
    points = resample_curve(orient_clockwise(curve), n * FINE).points
    ways = [points[start::FINE] for start in range(FINE)]
    # Entry s is Σ a_(i+s) conj(b_i): point 0 of the curve goes to point s of the model.
    b = np.stack([_complex(way) for way in ways])
    alike = likeness(np.fft.ifft(np.fft.fft(a) * np.fft.fft(b).conj()))
    start, shift = np.unravel_index(int(alike.argmax()), alike.shape)
    return np.roll(ways[int(start)], int(shift), axis=0)


def mirror_orders(
    key1: Mapping[str, Points], key2: Mapping[str, Points], closed: Mapping[str, bool]
) -> dict[str, Ints]:
    """Return, by id, the point order (n,) that makes mirrored key poses most like the other key.

    key1, key2: contours (n, 2) by id; closed: by id. `gait.model.four_keys` mirrors key 1 into 1'
    and key 2 into 2' with these orders. The cycle blends 1' with 2 and 2' with 1. An id and its
    partner share one order.
    """
    orders = dict[str, Ints]()
    for name in key1:
        twin = partner(name, key1)
        if twin in orders:
            orders[name] = orders[twin]
            continue
        pairs = [
            (_complex(here[name]), _complex(there[twin] * [1, -1]))
            for here, there in ((key2, key1), (key1, key2))
        ]
        n = len(key1[name])
        if closed[name]:
            product = [np.fft.ifft(np.fft.fft(a) * np.fft.fft(b.conj())) for a, b in pairs]
            orders[name] = reversal(n, int(np.sum([likeness(z) for z in product], axis=0).argmax()))
        else:
            ways = (np.arange(n), np.arange(n)[::-1])
            orders[name] = max(
                ways, key=lambda way: float(sum(likeness(a @ b[way].conj()) for a, b in pairs))
            )
    return orders


def likeness(product: Complex) -> Points:
    """Return how alike two contours are, from z = Σ a conj(b) of any shape.

    a, b: the contours' points as centred complex numbers. A turn of one contour lowers the likeness
    a little.
    """
    return np.abs(product) + UPRIGHT * product.real


def _complex(points: Points) -> Complex:
    return (points - points.mean(axis=0)) @ np.array([1, 1j])
