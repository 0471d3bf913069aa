"""Number the points of two curves so that they correspond: start point and direction (§4.1).

Both curves have n points of equal arc length. The second curve is renumbered so that its points lie
nearest to those of the first, least Σ ‖a_i − b_i‖². The candidates are all start points (n if
closed, 1 if open), in both directions unless both curves are closed and simple. Both curves are
centred on their mean, so their position does not matter.

Pins are corresponding places that a user names. Between two of them, points have equal distances.

An open and a closed curve become curves of one kind in two ways. The one with the smaller sum Σ is
the result: the open curve doubled, there and back, which opens like a mouth; or the closed curve
cut at a point, whose ends part. With pins, it is the second way.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, nearest_on_curve, resample_curve, signed_area
from finloop.curve.wavelet import drop_details, find_wavelet
from finloop.morph.folds import is_simple

LEAST_CONTROL = 4
"""Fewest control points of a contour: fewer make a point or a line of it."""
THIN = 1e-4
"""Half the width of a doubled open curve, as a share of the diagonal of its box: no pixel shows it.
It is less where an edge is short or a bend is sharp."""
CUT = 1e-3  # edges: gap between the ends of a closed curve that is cut; no pixel shows it
SAME = 1e-9  # of a curve's length: places nearer than that are one


class Resolution(NamedTuple):
    """How coarse contours are: each is rebuilt from n / 2^level of its n points (Eq. 2.11, Fig. 2).

    At level 0 contours keep all their points. wavelet: of the control points, and of the stiffness.
    """

    level: int = 0
    wavelet: str = "coif2"

    def reduce_curves(self, points: Floats, closed: bool) -> Floats:
        """Return curves (…, n, 2) at this resolution; FinloopError if n points do not allow it."""
        self.check(points.shape[-2])
        return drop_details(points, self.wavelet, self.level, closed) if self.level else points

    def check(self, points: int) -> None:
        """Raise FinloopError if there is no such wavelet, or no such level for so many points."""
        find_wavelet(self.wavelet)
        if self.level and (self.level < 0 or points >> self.level < LEAST_CONTROL):
            most = max(0, (points // LEAST_CONTROL).bit_length() - 1)
            raise FinloopError(
                f"level {self.level} of contours of {points} points",
                f"0 to {most}: a contour needs {LEAST_CONTROL} control points",
                "set a lower level, or more points",
            )


FULL = Resolution()
"""All points of a contour."""


class Pins(NamedTuple):
    """Points of two curves that correspond, (k, 2) each: row i of one goes to row i of the other.

    A pin counts at the place of its curve that is nearest to it.
    """

    first: Floats
    second: Floats


def match_curves(
    a: Curve, b: Curve, n: int, resolution: Resolution = FULL, pins: Pins | None = None
) -> tuple[Floats, Floats]:
    """Return two curves as n points each, (n, 2), evenly spaced; point i of one corresponds to i.

    The order of a is kept. b is renumbered, and perhaps reversed, so that the points lie nearest to
    those of a. With pins, closed curves begin at the first pin, and distances are equal between
    pins. Then both lose the details that `resolution` leaves out. FinloopError if one curve is
    closed and the other open, the resolution does not exist for n points, or pins have another
    order along b than along a.
    """
    if a.closed == b.closed and pins is not None and len(pins.first):
        pair = _number_points_by_pins(a, b, n, pins)
    else:
        pair = _number_points_alike(a, b, n)
    first, second = resolution.reduce_curves(np.stack(pair), a.closed)
    return first, second


def match_any_curves(
    a: Curve, b: Curve, n: int, resolution: Resolution = FULL, pins: Pins | None = None
) -> tuple[Floats, Floats, bool]:
    """Return two curves as corresponding points (n, 2), and whether they are paired as closed.

    One may be open and the other closed; if such a pair has pins, the closed one is cut between
    them. FinloopError as in `match_curves`.
    """
    if a.closed == b.closed:
        return *match_curves(a, b, n, resolution, pins), a.closed
    line, ring = (b, a) if a.closed else (a, b)
    if pins is not None and len(pins.first):
        on_line, on_ring = pins[::-1] if a.closed else pins
        as_lines = _cut_ring_by_pins(line, ring, n, Pins(on_line, on_ring))
        points = resolution.reduce_curves(np.stack(as_lines[::-1] if a.closed else as_lines), False)
        return points[0], points[1], False
    doubled = _double_line(resample_curve(line, n // 2 + 1).points)
    if n % 2:
        doubled = np.concatenate([doubled, doubled[[0, -1]].mean(axis=0, keepdims=True)])
    as_rings = doubled, _number_ring_alike(doubled, resample_curve(ring, n).points)
    as_lines = _cut_ring(resample_curve(line, n).points, resample_curve(ring, n).points)
    closed = _misfit(*as_rings) <= _misfit(*as_lines)
    pair = as_rings if closed else as_lines
    points = resolution.reduce_curves(np.stack(pair[::-1] if a.closed else pair), closed)
    return points[0], points[1], closed


def _misfit(first: Floats, second: Floats) -> float:
    """Return the squared distance of two curves (n, 2), each centred: Σ ‖a_i − b_i‖²."""
    difference = first - second
    return float(((difference - difference.mean(axis=0)) ** 2).sum())


def _double_line(points: Floats) -> Floats:
    """Return a closed polygon (2 m − 2, 2) that runs along an open curve (m, 2) there and back."""
    edges = np.diff(points, axis=0)
    lengths = np.hypot(*edges.T)
    along = edges / np.maximum(lengths, 1e-300)[:, None]
    bisector = along[:-1] + along[1:]
    size = np.hypot(*bisector.T)
    normal = np.stack([-bisector[:, 1], bisector[:, 0]], axis=1) / np.maximum(size, 1e-9)[:, None]
    # At a sharp bend, an offset moves along the curve: keep it well within an edge.
    half = np.minimum(THIN * np.hypot(*np.ptp(points, axis=0)), 0.1 * lengths.min())
    side = half * normal * np.minimum(1, size / 2)[:, None]
    return np.concatenate(
        [points[:1], points[1:-1] + side, points[-1:], (points[1:-1] - side)[::-1]]
    )


def _cut_ring(line: Floats, ring: Floats) -> tuple[Floats, Floats]:
    """Return an open curve (n, 2), and a closed one cut open (n, 2) so that it fits the first best.

    The ends of the cut curve are CUT edges apart.
    """
    candidates = []
    for points in (ring, ring[::-1]):
        start = int(misfit_by_start(line, points).argmin())
        rolled = np.roll(points, -start, axis=0)
        # The ends meet, so the n points have n − 1 edges and the gap: half an edge at either end.
        begin = (rolled[0] + rolled[-1]) / 2
        gap = CUT * (rolled[0] - rolled[-1]) / 2
        whole = np.concatenate([[begin + gap], rolled, [begin - gap]])
        candidates.append(resample_curve(Curve(whole, False), len(line)).points)
    return line, min(candidates, key=lambda points: _misfit(line, points))


def _cut_ring_by_pins(line: Curve, ring: Curve, n: int, pins: Pins) -> tuple[Floats, Floats]:
    """Return an open curve (n, 2), and a closed one (n, 2) cut between its last and first pin.

    The cut divides that part as the ends of the open curve beyond its pins compare. FinloopError if
    the pins have another order along the one than along the other.
    """
    shares = _length_shares(line, pins.first)
    first, last = int(shares.argmin()), int(shares.argmax())
    before, after = float(shares[first]), 1 - float(shares[last])
    candidates, problems = [], []
    for way in (ring, Curve(ring.points[::-1], True)):
        places = _length_shares(way, pins.second)
        part = (places[first] - places[last]) % 1.0 or 1.0  # of the ring; all of it for one pin
        cut = places[last] + part * after / max(before + after, 1e-300)
        along, gap = _lengths(way), CUT / (2 * n)
        corners = np.sort((along[:-1] / along[-1] - cut) % 1.0)
        corners = corners[(corners > gap) & (corners < 1 - gap)]
        opened = Curve(_points_at(way, cut + np.r_[gap, corners, 1 - gap]), False)
        try:
            candidates.append(_number_points_by_pins(line, opened, n, pins))
        except FinloopError as error:
            problems.append(error)
    if not candidates:
        raise problems[0]
    return min(candidates, key=lambda pair: _misfit(*pair))


def _number_ring_alike(first: Floats, second: Floats) -> Floats:
    """Return the second of two closed polygons (n, 2), renumbered to lie nearest to the first."""
    areas = [signed_area(Curve(points, closed=True)) for points in (first, second)]
    second = second[::-1] if areas[0] * areas[1] < 0 else second
    return np.roll(second, -int(misfit_by_start(first, second).argmin()), axis=0)


def _number_points_by_pins(a: Curve, b: Curve, n: int, pins: Pins) -> tuple[Floats, Floats]:
    """Return two curves as n corresponding points, (n, 2) each, with points at the pins.

    FinloopError if the pins have another order along b than along a, or are too many.
    """
    b = _run_alike(a, b, pins)
    places = [_length_shares(curve, side) for curve, side in zip((a, b), pins, strict=True)]
    order = np.argsort(places[0], kind="stable")
    places = [share[order] for share in places]
    starts = [float(share[0]) if a.closed else 0.0 for share in places]
    spans = np.stack([
        np.diff(np.r_[(share - start) % 1.0, 1.0] if a.closed else np.r_[0.0, share, 1.0])
        for share, start in zip(places, starts, strict=True)
    ])  # fmt: skip
    spans = spans[:, ~(abs(spans) < SAME).all(axis=0)]  # ends that are pinned to ends
    edges = n if a.closed else n - 1
    if spans.min() < SAME or spans.shape[1] > edges:
        raise FinloopError(
            f"{len(pins.first)} pins that do not follow each other alike along both curves",
            f"at most {edges}, in one order along both curves, each at a place of its own",
            "exchange the pins, or omit some; ends of open curves go to ends",
        )
    counts = _whole_parts(spans.mean(axis=0), edges)
    first, second = (
        _points_at(curve, start + _marks_along(widths, counts, not a.closed))
        for curve, start, widths in zip((a, b), starts, spans, strict=True)
    )
    return first, second


def _run_alike(a: Curve, b: Curve, pins: Pins) -> Curve:
    """Return curve b, reversed if it runs in the other direction than curve a."""
    backwards = Curve(b.points[::-1], b.closed)
    if a.closed:
        return backwards if signed_area(a) * signed_area(b) < 0 else b
    ways = [_length_shares(curve, side) for curve, side in zip((a, b), pins, strict=True)]
    one, other = (way - way.mean() for way in ways)
    trend = float(one @ other)  # 0 for a single pin
    if trend == 0:
        first, *both = (resample_curve(curve, 64).points for curve in (a, b, backwards))
        trend = _misfit(first, both[1]) - _misfit(first, both[0])
    return backwards if trend < 0 else b


def _length_shares(curve: Curve, points: Floats) -> Floats:
    """Return the shares (k,) of a curve's length at which it is nearest to points (k, 2)."""
    along = _lengths(curve)
    places, _ = nearest_on_curve(points, curve)
    return np.asarray(np.interp(places, np.arange(len(along)), along) / along[-1])


def _points_at(curve: Curve, shares: Floats) -> Floats:
    """Return the points (n, 2) of a curve at shares (n,) of its length."""
    along, points = _lengths(curve), curve.points
    points = np.concatenate([points, points[:1]]) if curve.closed else points
    marks = along[-1] * (shares % 1.0 if curve.closed else shares)
    return np.stack([np.interp(marks, along, values) for values in points.T], axis=1)


def _lengths(curve: Curve) -> Floats:
    """Return the length (n,) of a curve up to each of its points; closed: and of all, (n + 1,)."""
    points = curve.points
    points = np.concatenate([points, points[:1]]) if curve.closed else points
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]


def _whole_parts(shares: Floats, total: int) -> Ints:
    """Return whole numbers (k,) ≥ 1 that sum to total, in proportion to shares (k,)."""
    wanted = (total - len(shares)) * shares / shares.sum()
    parts = np.floor(wanted).astype(np.int64)
    missing = total - len(shares) - int(parts.sum())
    parts[np.argsort(parts - wanted, kind="stable")[:missing]] += 1
    return parts + 1


def _marks_along(widths: Floats, counts: Ints, with_end: bool) -> Floats:
    """Return marks that divide each of k spans into equal parts; the spans lie end to end.

    widths (k,): of the spans, with the sum 1; counts (k,): of parts; with_end: also the mark 1.
    """
    lows = np.r_[0.0, np.cumsum(widths)[:-1]]
    marks = [low + width * np.arange(count) / count
             for low, width, count in zip(lows, widths, counts, strict=True)]  # fmt: skip
    return np.concatenate([*marks, [1.0]] if with_end else marks)


def _number_points_alike(a: Curve, b: Curve, n: int) -> tuple[Floats, Floats]:
    """Return two curves as n points, (n, 2) each, the second numbered to fit the first best.

    FinloopError if one curve is open and the other closed.
    """
    if a.closed != b.closed:
        kinds = ["closed" if curve.closed else "open" for curve in (a, b)]
        raise FinloopError(
            f"a curve that is {kinds[0]} and one that is {kinds[1]}",
            "two closed curves or two open ones",
            "close the open curve, open the closed curve, or omit the pair",
        )
    first, second = resample_curve(a, n).points, resample_curve(b, n).points
    directions = [second, second[::-1]]
    if not a.closed:
        centred = first - first.mean(axis=0)

        def misfit(points: Floats) -> float:
            """Return the sum of squared distances between points of b and of a, both centred."""
            return float(((centred - points + points.mean(axis=0)) ** 2).sum())

        return first, min(directions, key=misfit)
    if is_simple(first) and is_simple(second):  # if they turned opposite ways, the morph would fold
        areas = [signed_area(Curve(points, closed=True)) for points in (first, second)]
        opposite = areas[0] * areas[1] <= 0
        directions = directions[1:] if opposite else directions[:1]
    misfits = [misfit_by_start(first, points) for points in directions]
    best = int(np.argmin([misfit.min() for misfit in misfits]))
    start = int(misfits[best].argmin())
    return first, np.roll(directions[best], -start, axis=0)


def misfit_by_start(first: Floats, second: Floats) -> Floats:
    """Return how badly polygon b fits a, for each first point s: Σ_i ‖a_i − b_{i+s}‖², (n,).

    first, second (n, 2): closed polygons a, b, which are centred first.
    """
    a, b = ((points - points.mean(axis=0)) @ [1, 1j] for points in (first, second))
    product = np.fft.ifft(np.fft.fft(b) * np.fft.fft(a).conj()).real
    return (abs(a) ** 2).sum() + (abs(b) ** 2).sum() - 2 * product
