"""Cut one shape into pieces, one for each of the several shapes that it becomes.

A region is cut along chords, in two again and again. Of all chords within it, the best is short,
gives both sides their share of the area, and lies across the direction in which they part. An open
curve is cut at points. The edges along cuts are known, since no line shows them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import skimage.measure

from finloop.base.arrays import Floats, Mask, Points
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, area_centroids, nearest_on_curve, signed_area
from finloop.morph.regions import Region

PLACES = 96  # along an outline, where a cut may begin or end
LENGTH_WEIGHT, AREA_WEIGHT, DIRECTION_WEIGHT = 1.0, 6.0, 1.0
"""Costs of a cut as long as the root of the region's area, of an area share that is off by 1, and
of sides that part at right angles to the wanted direction."""
OVERLAP_END = 0.02  # of a cut: within that of both ends, pieces do not overlap


class Piece(NamedTuple):
    """A piece of a region; cuts: ends (k, 2, 2) of the edges of its outline that lie along cuts."""

    region: Region
    cuts: Points | None  # None for a whole region


class _Part(NamedTuple):
    """A part of a region: its outline (n, 2), which edges are cuts (n,), and the holes in it."""

    outline: Points
    is_cut: Mask
    holes: list[Curve]


def split_region(region: Region, goals: Sequence[Region], overlap: float = 0.0) -> list[Piece]:
    """Return pieces of a region, one for each of the goal regions, in their order.

    overlap: how far pieces reach beyond their cuts, which hides the seams of filled ones.
    FinloopError if no straight cut within the region leaves its holes whole.
    """
    outline = region.outer.points
    whole = _Part(outline, np.zeros(len(outline), bool), region.holes)
    parts = dict[int, _Part]()

    def cut_part(part: _Part, wanted: Sequence[int]) -> None:
        """Cut a part until each of the wanted goals has a piece."""
        if len(wanted) == 1:
            parts[wanted[0]] = part
            return
        centres = np.stack([_centre(goals[goal]) for goal in wanted])
        axis = np.linalg.svd(centres - centres.mean(axis=0))[2][0]
        order = np.argsort(centres @ axis, kind="stable")
        sides = [[wanted[k] for k in rows] for rows in np.array_split(order, 2)]
        areas = [sum(_area(goals[goal]) for goal in side) for side in sides]
        middles = [
            np.average([_centre(goals[goal]) for goal in side], axis=0,
                       weights=[_area(goals[goal]) for goal in side])
            for side in sides
        ]  # fmt: skip
        pieces = _cut_in_two(part, areas[0] / sum(areas), middles[1] - middles[0])
        for piece, side in zip(pieces, sides, strict=True):
            cut_part(piece, side)

    cut_part(whole, range(len(goals)))
    return [_as_piece(parts[goal], region.outer, overlap) for goal in range(len(goals))]


def split_line(line: Curve, goals: Sequence[Curve]) -> list[Curve]:
    """Return pieces of an open curve, one for each of the goal curves, in their order.

    They lie along it in the order of the goals, which is that of the places nearest to them, and
    have their shares of the length.
    """
    points = line.points
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    boxes = points, np.concatenate([goal.points for goal in goals])
    lows, spans = ([step(box, axis=0) for box in boxes] for step in (np.min, np.ptp))
    middles = np.stack([goal.points.mean(axis=0) for goal in goals])
    middles = lows[0] + (middles - lows[1]) / np.maximum(spans[1], 1e-300) * spans[0]
    order = np.argsort(nearest_on_curve(middles, line)[0], kind="stable")
    lengths = np.array([np.hypot(*np.diff(goal.points, axis=0).T).sum() for goal in goals])
    ends = along[-1] * np.r_[0.0, np.cumsum(lengths[order])] / lengths.sum()
    parts: list[Curve] = [line] * len(goals)
    for goal, low, high in zip(order, ends[:-1], ends[1:], strict=True):
        marks = np.r_[low, along[(along > low) & (along < high)], high]
        x, y = (np.interp(marks, along, values) for values in points.T)
        parts[goal] = Curve(np.stack([x, y], axis=1), False)
    return parts


def _area(region: Region) -> float:
    """Return the area within a region's outer contour."""
    return abs(signed_area(region.outer))


def _centre(region: Region) -> Points:
    """Return the centre (2,) of the area within a region's outer contour."""
    return area_centroids(region.outer.points)


def _cut_in_two(part: _Part, share: float, direction: Points) -> tuple[_Part, _Part]:
    """Return the two sides of a part, cut along the best chord.

    share: of the area that the first side gets; direction (2,): from the first to the second.
    FinloopError if every chord leaves the part or meets a hole.
    """
    outline, places = _mark_outline(part)
    marks = outline.outline[places]
    lengths = np.hypot(*(marks[:, None] - marks).transpose(2, 0, 1))
    areas, centres, total = _sides_of_chords(marks)
    shares = areas / total
    inside = (shares > 0.01) & (shares < 0.99)
    middle = area_centroids(marks)
    # Both sides' centres lie on a line through that of the whole.
    away = (middle - centres) / np.maximum(1 - shares, 1e-9)[..., None]
    reach = np.maximum(np.hypot(*away.transpose(2, 0, 1)), 1e-300)
    turn = away @ direction / (reach * max(float(np.hypot(*direction)), 1e-300))
    cost = (LENGTH_WEIGHT * lengths / np.sqrt(abs(total)) + AREA_WEIGHT * abs(shares - share)
            + DIRECTION_WEIGHT * (1 - turn))  # fmt: skip
    cost[~inside] = np.inf
    for flat in np.argsort(cost, axis=None):
        i, j = divmod(int(flat), len(marks))
        if not np.isfinite(cost[i, j]):
            break
        if _is_chord_inside(marks[[i, j]], outline):
            return _take_side(outline, places[i], places[j]), _take_side(
                outline, places[j], places[i]
            )
    raise FinloopError(
        "a shape that no straight cut divides without cutting a hole",
        "a shape with room for a cut between its holes",
        "cut it in the drawing, and give each piece an id of its own",
    )


def _mark_outline(part: _Part) -> tuple[_Part, list[int]]:
    """Return a part with PLACES evenly spaced points added to its outline, and their rows."""
    points = np.concatenate([part.outline, part.outline[:1]])
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    equal = np.linspace(0, 1, PLACES, endpoint=False)
    shares = np.r_[equal, along[:-1] / along[-1]]
    marks, numbers = np.unique(np.round(shares, 9), return_inverse=True)  # each place once
    marks = marks * along[-1]
    x, y = (np.interp(marks, along, values) for values in points.T)
    edge = np.searchsorted(along, marks + 1e-9 * along[-1], side="right") - 1
    marked = _Part(np.stack([x, y], axis=1), part.is_cut[edge], part.holes)
    return marked, numbers[:PLACES].tolist()


def _sides_of_chords(marks: Points) -> tuple[Floats, Points, float]:
    """Return area (n, n) and centre (n, n, 2) of one side of each chord i j, and the whole area.

    marks (n, 2): of an outline. Areas have the sign of the whole.
    """
    corner = marks - marks[0]
    after = np.roll(corner, -1, axis=0)
    cross = corner[:, 0] * after[:, 1] - corner[:, 1] * after[:, 0]
    areas = np.r_[0.0, np.cumsum(cross)] / 2
    moments = (
        np.concatenate([np.zeros((1, 2)), np.cumsum((corner + after) * cross[:, None], axis=0)]) / 6
    )
    i, j = np.indices((len(marks), len(marks)))
    wraps = j < i
    chord = (corner[j, 0] * corner[i, 1] - corner[j, 1] * corner[i, 0]) / 2
    area = areas[j] - areas[i] + wraps * areas[-1] + chord
    moment = moments[j] - moments[i] + wraps[..., None] * moments[-1]
    moment = moment + (corner[i] + corner[j]) * chord[..., None] / 3
    safe = np.where(abs(area) < 1e-12 * abs(areas[-1]), areas[-1], area)
    return area, marks[0] + moment / safe[..., None], float(areas[-1])


def _is_chord_inside(ends: Points, part: _Part) -> bool:
    """Return whether a chord, its ends (2, 2) on the outline, lies inside a part and in no hole."""
    inner = ends.mean(axis=0) + (ends - ends.mean(axis=0)) * (1 - 1e-6)
    contours = [part.outline, *(hole.points for hole in part.holes)]
    start = np.concatenate(contours)
    end = np.concatenate([np.roll(contour, -1, axis=0) for contour in contours])

    def side(a: Points, b: Points, c: Points) -> Floats:
        """Return a number (…): > 0 where point c (…, 2) lies right of the line a → b, as seen."""
        return np.asarray(
            (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
            - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        )

    p, q = inner
    crosses = (side(p, q, start) * side(p, q, end) <= 0) & (
        side(start, end, p) * side(start, end, q) <= 0
    )
    checks = np.linspace(0, 1, 9)[:, None] * (q - p) + p
    return not crosses.any() and bool(skimage.measure.points_in_poly(checks, part.outline).all())


def _take_side(part: _Part, first: int, last: int) -> _Part:
    """Return the side of a part between two points of its outline, closed by a cut."""
    numbers = np.arange(first, last + 1 + (last < first) * len(part.outline)) % len(part.outline)
    outline, is_cut = part.outline[numbers], part.is_cut[numbers]
    is_cut[-1] = True
    holes = [
        hole for hole in part.holes if skimage.measure.points_in_poly(hole.points[:1], outline)[0]
    ]
    return _Part(outline, is_cut, holes)


def _as_piece(part: _Part, whole: Curve, overlap: float) -> Piece:
    """Return a part of a region as a piece that reaches beyond its cuts by `overlap`."""
    outline, is_cut = part.outline, part.is_cut
    edges = np.roll(outline, -1, axis=0) - outline
    before = np.roll(edges, 1, axis=0)
    bends = edges[:, 0] * before[:, 1] - edges[:, 1] * before[:, 0]
    along = is_cut & np.roll(is_cut, 1) & (abs(bends) <= 1e-9 * (edges**2).sum(axis=1).max())
    outline, is_cut = outline[~along], is_cut[~along]  # cuts of one edge each
    if overlap:
        way = (np.roll(outline, -1, axis=0) - outline)[is_cut]
        normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.hypot(*way.T)[:, None]
        beyond = outline[is_cut] + np.sign(signed_area(whole)) * overlap * normal
        at = np.repeat(np.flatnonzero(is_cut) + 1, 2)
        bulge = np.stack([beyond + share * way for share in (OVERLAP_END, 1 - OVERLAP_END)], axis=1)
        outline = np.insert(outline, at, bulge.reshape(-1, 2), axis=0)
        is_cut = np.insert(is_cut, at, True)
    cuts = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)[is_cut]
    return Piece(Region(Curve(outline, True), part.holes), cuts)
