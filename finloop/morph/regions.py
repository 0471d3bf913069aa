"""Pair regions with holes and their contours; keep small holes away from other contours.

A region is one closed contour and the holes in it, as of the letters d and B. Its contours lie one
after the other in one array of vertices, the outer one first (`ContourLayout`).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
import skimage.measure

from finloop.base.arrays import Mask, Points
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, nearest_on_curve, resample_curve, signed_area
from finloop.morph.folds import ContourLayout, count_contour_folds
from finloop.morph.match import FULL, Pins, Resolution, match_curves

SMALL = 1e-3
"""Area, as a share of that within the outer contour, to which holes shrink: they have room there
whatever the shape around them. With a hundredth, 32 of 150 pairs of glyphs find no path."""
FLAT = 1e-9  # area of a contour, as a share of its extent squared, that counts as none
POINT = 1e-6  # area, likewise, of a hole that grows from a point: less than a pixel
CLEAR = 3.0  # radii of a small hole: its distance from other contours; 1 and 6 do as well
ROUNDS = 8  # of moving holes that are too near to another contour
LINES, SHARES = 64, (0.1, 0.3, 0.5, 0.7, 0.9)
"""Lines across a region, and places on each of their stretches inside: one becomes a new hole."""
FEW = 256  # points of a contour to which the distance of a place is measured

PinsOfPair = Callable[[Curve, Curve], Pins | None]
"""Gives the pins of two contours, None for none."""


def no_pins(_a: Curve, _b: Curve) -> None:
    """Return no pins, for any two contours."""


class Region(NamedTuple):
    """The contours of a region: the outer one, and its holes."""

    outer: Curve
    holes: list[Curve]


def split_regions(contours: Sequence[Curve]) -> list[Region]:
    """Return the regions (outer contour and holes) that closed contours enclose, largest first.

    By the even-odd rule a contour within an odd number of others is a hole, of the smallest region
    around it; any other one begins a region. FinloopError if there is no contour, or one of them is
    open, has no area, meets itself or another one.
    """
    _require_apart(contours)
    regions: list[Region] = []
    for curve in sorted(contours, key=lambda curve: -abs(signed_area(curve))):
        around = [
            region for region in regions if _is_inside(curve.points[:1], region.outer.points)[0]
        ]
        in_hole = [
            region
            for region in around
            if any(_is_inside(curve.points[:1], hole.points)[0] for hole in region.holes)
        ]
        if len(around) > len(in_hole):
            around[-1].holes.append(curve)  # the smallest is the last
        else:
            regions.append(Region(curve, []))
    return regions


def _require_apart(contours: Sequence[Curve]) -> None:
    """Raise FinloopError unless contours are closed, have an area, and meet nowhere."""
    own = "a path and an id of its own"
    if not contours or not all(curve.closed for curve in contours):
        raise FinloopError(
            "a region with an open contour, or without any",
            "closed contours",
            f"close them (Z), or give each {own}",
        )
    if any(abs(signed_area(curve)) <= FLAT * np.ptp(curve.points, axis=0).max() ** 2
           for curve in contours):  # fmt: skip
        raise FinloopError(
            "a region with a contour that has no area", "contours with an area", f"give it {own}"
        )
    layout = ContourLayout(tuple(len(curve.points) for curve in contours))
    if count_contour_folds(np.concatenate([curve.points for curve in contours]), layout)[0]:
        raise FinloopError(
            "a region whose contours meet each other or themselves",
            "contours that are apart",
            f"correct the drawing, or give each contour {own}",
        )


def pair_regions(a: Sequence[Curve], b: Sequence[Curve]) -> list[tuple[Region, Region]]:
    """Return the regions of two shapes in pairs by place, such as the dots and stems of i and j.

    Pairs are by place in the shapes' boxes, so that the sum of distances is least. FinloopError if
    one shape has more separate regions than the other, or a contour is open.
    """
    groups = group_regions(split_regions(a), split_regions(b))
    first, second = (sum(len(group[side]) for group in groups) for side in (0, 1))
    if first != second:
        raise FinloopError(
            f"separate parts: {first} in the first drawing, {second} in the second",
            "as many in both",
            "pair the drawings first (match_drawings), which cuts a part into several",
        )
    return [(one, other) for (one,), (other,) in groups]


def group_regions(
    first: Sequence[Region], second: Sequence[Region]
) -> list[tuple[list[Region], list[Region]]]:
    """Return which regions become which; one may become several, or several one.

    Pairs are by place in the boxes around all of them, so that the sum of distances is least. A
    region that is left goes to the nearest one of the other side, which becomes several.
    """
    boxes = [np.concatenate([region.outer.points for region in side]) for side in (first, second)]
    places = [
        np.stack([_place_in_box(region.outer.points.mean(axis=0), box) for region in side])
        for side, box in zip((first, second), boxes, strict=True)
    ]
    pairs = _nearest_pairs(*places)
    groups = [([row], [column]) for row, column in pairs]
    for side in (0, 1):
        for left in sorted(set(range(len(places[side]))) - {pair[side] for pair in pairs}):
            others = places[1 - side][[group[1 - side][0] for group in groups]]
            groups[int(np.hypot(*(others - places[side][left]).T).argmin())][side].append(left)
    return [([first[row] for row in rows], [second[column] for column in columns])
            for rows, columns in groups]  # fmt: skip


def match_regions(
    a: Region,
    b: Region,
    points: int,
    resolution: Resolution = FULL,
    pins: PinsOfPair = no_pins,
) -> tuple[list[Points], list[Points]]:
    """Return the contours of two regions as corresponding points (points, 2), outer ones first.

    Holes are paired by their places in the outer contours' boxes, so that the sum of distances is
    least. A hole without a partner gets one as small as a point, at that place of the other region
    or as near to it as there is room. pins: gives the pins of two contours.
    """
    outer_a, outer_b = match_curves(a.outer, b.outer, points, resolution, pins(a.outer, b.outer))
    contours_a, contours_b = [outer_a], [outer_b]
    places_a, places_b = (
        np.array([_place_in_box(hole.points.mean(axis=0), outer) for hole in holes]).reshape(-1, 2)
        for holes, outer in ((a.holes, outer_a), (b.holes, outer_b))
    )
    pairs = _nearest_pairs(places_a, places_b)
    for row, column in pairs:
        hole_a, hole_b = a.holes[row], b.holes[column]
        points_a, points_b = match_curves(hole_a, hole_b, points, resolution, pins(hole_a, hole_b))
        contours_a.append(points_a)
        contours_b.append(points_b)
    for row in set(range(len(a.holes))) - {row for row, _ in pairs}:
        hole = resample_curve(a.holes[row], points).points
        contours_a.append(resolution.reduce_curves(hole, closed=True))
        contours_b.append(_new_hole(contours_a[-1], places_a[row], contours_b))
    for column in set(range(len(b.holes))) - {column for _, column in pairs}:
        hole = resample_curve(b.holes[column], points).points
        contours_b.append(resolution.reduce_curves(hole, closed=True))
        contours_a.append(_new_hole(contours_b[-1], places_b[column], contours_a))
    return contours_a, contours_b


def _nearest_pairs(places: Points, other_places: Points) -> list[tuple[int, int]]:
    """Return which positions (k, 2) and (m, 2) are paired so that distances sum to the least."""
    distances = np.hypot(*(places[:, None] - other_places).transpose(2, 0, 1))
    rows, columns = scipy.optimize.linear_sum_assignment(distances)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _place_in_box(point: Points, outer: Points) -> Points:
    """Return where a point (2,) lies in a contour's bounding box, in shares 0–1 of its sides."""
    low = outer.min(axis=0)
    return np.asarray((point - low) / np.maximum(np.ptp(outer, axis=0), 1e-300))


def _new_hole(hole: Points, place: Points, contours: Sequence[Points]) -> Points:
    """Return a new hole (n, 2), as small as a point, near a position in a region.

    hole (n, 2): its shape; place (2,): in shares of the outer contour's box; contours: those of the
    region, the outer one first.
    """
    outer = contours[0]
    area = POINT * abs(signed_area(Curve(outer, closed=True)))
    middle = hole.mean(axis=0)
    small = (hole - middle) * np.sqrt(area / abs(signed_area(Curve(hole, closed=True))))
    # It needs room for the size of other small holes, as it has theirs for a part of the way.
    room = 2 * CLEAR * float(np.hypot(*small.T).max()) * np.sqrt(SMALL / POINT)
    places = _places_inside(contours)
    few = [contour[:: max(1, len(contour) // FEW)] for contour in contours]
    gaps = [nearest_on_curve(places, Curve(contour, closed=True))[1] for contour in few]
    clearance = np.min([np.hypot(*gap.T) for gap in gaps], axis=0)
    has_room = clearance >= min(room, clearance.max() / 2)
    low, high = outer.min(axis=0), outer.max(axis=0)
    far = np.hypot(*(places - low - place * (high - low)).T)
    return np.asarray(places[np.where(has_room, far, np.inf).argmin()] + small)


def _places_inside(contours: Sequence[Points]) -> Points:
    """Return points (k, 2) inside a region, spread along horizontal lines across it.

    contours (n, 2): of the region, the outer one first.
    """
    low, high = contours[0].min(axis=0), contours[0].max(axis=0)
    places = []
    for y in low[1] + (np.arange(LINES) + 0.5) / LINES * (high[1] - low[1]):
        crossings = []
        for contour in contours:
            after = np.roll(contour, -1, axis=0)
            (x0, y0), (x1, y1) = contour.T, after.T
            crosses = (y0 <= y) != (y1 <= y)
            share = (y - y0[crosses]) / (y1[crosses] - y0[crosses])
            crossings.append(x0[crosses] + share * (x1[crosses] - x0[crosses]))
        left, right = np.sort(np.concatenate(crossings)).reshape(-1, 2).T
        x = left + np.array(SHARES)[:, None] * (right - left)
        places.append(np.stack([x.ravel(), np.full(x.size, y)], axis=1))
    return np.concatenate(places)


def move_holes_inside(pose: Points, outer: slice, holes: Sequence[slice]) -> None:
    """Move the small holes of a pose (n, 2) away from other contours that are too near, in place.

    A hole is small if its area is at most about the share SMALL of the outer contour's. It is kept
    away from all other contours by CLEAR times the radius of a hole of just that area. outer,
    holes: slices of the contours.
    """
    least = 1.01 * SMALL * abs(signed_area(Curve(pose[outer], closed=True)))
    areas = [abs(signed_area(Curve(pose[hole], closed=True))) for hole in holes]
    small = [
        (hole, np.sqrt(least / area))
        for hole, area in zip(holes, areas, strict=True)
        if area <= least
    ]
    for _ in range(ROUNDS if small else 0):
        moved = False
        for hole, growth in small:
            middle = pose[hole].mean(axis=0)
            radius = growth * np.hypot(*(pose[hole] - middle).T).max()
            for other in (outer, *(sibling for sibling in holes if sibling is not hole)):
                _, (gap,) = nearest_on_curve(middle[None], Curve(pose[other], closed=True))
                is_inside = _is_inside(middle[None], pose[other])[0]
                distance = float(np.hypot(*gap))
                side = 1 if is_inside == (other is outer) else -1  # −1: on the wrong one
                lacking = (1 + CLEAR) * radius - side * distance
                if lacking > 0:
                    pose[hole] += side * gap * lacking / max(distance, 1e-300)
                    middle, moved = pose[hole].mean(axis=0), True
        if not moved:
            break


def _is_inside(points: Points, polygon: Points) -> Mask:
    """Return whether each point (k, 2) is inside a closed polygon (n, 2): (k,)."""
    return np.asarray(skimage.measure.points_in_poly(points, polygon))
