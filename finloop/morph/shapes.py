"""Pair the contours of two shapes, and number their points so that they correspond."""

from collections.abc import Sequence

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, nearest_on_curve
from finloop.morph.folds import ContourLayout
from finloop.morph.match import FULL, Pins, Resolution, match_any_curves
from finloop.morph.regions import Region, match_regions, pair_regions


def match_shapes(
    a: Sequence[Curve], b: Sequence[Curve], points: int, resolution: Resolution = FULL,
    pins: Pins | None = None, needs_regions: bool = True,
) -> list[tuple[Points, Points, ContourLayout]]:  # fmt: skip
    """Return the contours of two shapes as corresponding points (n, 2), part by part.

    A part is one contour, or a region: its outer contour and its holes, side by side. a, b: the
    contours, px; points: n; resolution: at which they are matched; pins: places that must
    correspond, px; needs_regions: whether closed contours that form no regions, as those that meet,
    are refused; else they pair in their order, as open ones do. FinloopError if the shapes have not
    as many separate parts or open contours, or a pin joins contours that do not correspond.
    """
    pinned = _PinnedContours(a, b, pins)
    matched = list[tuple[Points, Points, ContourLayout]]()
    for first, second in _pair_parts(a, b, needs_regions):
        if isinstance(first, Region) and isinstance(second, Region):
            ends = match_regions(first, second, points, resolution, pinned.take)
            layout = ContourLayout((points,) * len(ends[0]))
            matched.append((np.concatenate(ends[0]), np.concatenate(ends[1]), layout))
        elif isinstance(first, Curve) and isinstance(second, Curve):
            taken = pinned.take(first, second)
            one, other, closed = match_any_curves(first, second, points, resolution, taken)
            matched.append((one, other, ContourLayout((points,), closed)))
    pinned.require_none_left()
    return matched


def _pair_parts(
    a: Sequence[Curve], b: Sequence[Curve], needs_regions: bool
) -> list[tuple[Region, Region]] | list[tuple[Curve, Curve]]:
    """Return the parts of two shapes in pairs: regions by place, open contours in their order.

    needs_regions: raise FinloopError if closed contours form no regions that can be paired; else
    these are paired in their order, too. FinloopError if one shape has more parts than the other.
    """
    if max(len(a), len(b)) > 1 and all(curve.closed for curve in (*a, *b)):
        try:
            return pair_regions(a, b)
        except FinloopError as error:
            if len(a) != len(b):
                raise
            if needs_regions:  # other methods pair these contours in their order
                do = f"{error.do}; or use the method linear"
                raise FinloopError(error.came, error.wanted, do) from error
    if len(a) != len(b):
        raise FinloopError(
            f"contours: {len(a)} in the first drawing, {len(b)} in the second, some of them open",
            "as many open contours in both",
            "give each contour a path and an id of its own",
        )
    return list(zip(a, b, strict=True))


class _PinnedContours:
    """The pins of two shapes, with the two contours that each pin joins."""

    def __init__(self, a: Sequence[Curve], b: Sequence[Curve], pins: Pins | None) -> None:
        """Find the contours that are nearest to the two ends of each pin."""
        self._pins = pins or Pins(np.zeros((0, 2)), np.zeros((0, 2)))
        self._contours = [
            [_nearest_contour(place, curves) for place in side]
            for side, curves in zip(self._pins, (a, b), strict=True)
        ]
        self._left = set(range(len(self._pins.first)))

    def take(self, first: Curve, second: Curve) -> Pins | None:
        """Return the pins that join two contours, and mark them as used; None if there are none."""
        rows = [
            row
            for row, (one, other) in enumerate(zip(*self._contours, strict=True))
            if one is first and other is second
        ]
        self._left -= set(rows)
        return Pins(self._pins.first[rows], self._pins.second[rows]) if rows else None

    def require_none_left(self) -> None:
        """Raise FinloopError if a pin is unused: it joins contours that do not correspond."""
        if self._left:
            places = [side[min(self._left)].round(2).tolist() for side in self._pins]
            raise FinloopError(
                f"a pin from {places[0]} to {places[1]}, on contours that do not correspond",
                "both ends of a pin on contours of one pair",
                "move the pin, or give each contour a path and an id of its own",
            )


def _nearest_contour(place: Points, curves: Sequence[Curve]) -> Curve:
    """Return the contour that is nearest to a place (2,)."""
    gaps = [float(np.hypot(*nearest_on_curve(place[None], curve)[1][0])) for curve in curves]
    return curves[int(np.argmin(gaps))]
