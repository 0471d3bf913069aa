"""Decide which shapes of two drawings become each other: by file, by id, or by place and form.

A shape is a contour, or all contours of one path (`d`, `d#2` …). A file of pairs goes first; then
equal ids belong together; the others of one kind, closed or open, are paired so that place, size
and shape differ least. What is left vanishes to a point, or grows from one.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
import skimage.measure
import yaml
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Points
from finloop.base.drawing import LARGEST, Drawing
from finloop.base.errors import FinloopError
from finloop.base.paint import PART, layers_by_shape
from finloop.base.style import Fill, Paint, scale_paint
from finloop.base.yaml_limits import refuse_yaml_bomb
from finloop.curve.contour import Curve, nearest_on_curve, orient_clockwise, resample_curve
from finloop.morph.layers import fit_drawing
from finloop.morph.match import Pins
from finloop.morph.regions import Region, group_regions, split_regions
from finloop.morph.split import Piece, split_line, split_region

Complexes = NDArray[np.complex128]

POINT = 1e-3
"""Size of a shape that vanishes, as a share of what it was: less than a pixel."""
POINTS = 64  # of a contour whose shape is compared
PLACE_WEIGHT, SIZE_WEIGHT = 4.0, 0.5
"""Cost of a place that is off by the picture's side, and of a double size. A shape that is off by
its own radius (RMS) costs 1. By place weights of 2 and 4 all 42 shapes of the shipped face, dog and
fish find their partners without ids; by 1 and 8, 40. Size tells an eye from its pupil."""
OPAQUE_OVERLAP = 2e-3  # sides of the picture, about a pixel: how far filled pieces cover a seam
FITS_BETTER, TOGETHER, INSIDE, APART = 0.1, 0.6, 0.5, 0.1
"""A shape that is left counts as a part of another one, if with it the common share of the boxes of
the whole and of its parts rises by that, to that at least; if at least that share of its own box is
within that of the whole, and at most that share within those of the other parts."""
FORM = (
    "pairs: {eye: left_eye, body: [head, tail]}, vanish: [hat], appear: [beard],"
    " pins: {eye: [[[1, 2], [3, 4]]]}"
)


@dataclass(frozen=True)
class Pairing:
    """Which shapes of a first drawing become which of a second, by id; which vanish, which appear.

    pairs: first → second; several of the first may become one. splits: first → several of the
    second. pins: corresponding points (k, 2, 2) of a pair, by the id of the first: k times a point
    of the first and one of the second drawing, each in px of its picture. proposed: shapes of the
    first drawing that place, shape or the beginning of an id have paired.
    """

    pairs: Mapping[str, str]
    vanish: Sequence[str] = ()
    appear: Sequence[str] = ()
    proposed: Sequence[str] = field(default=())
    splits: Mapping[str, Sequence[str]] = field(default_factory=dict)
    pins: Mapping[str, Points] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """Return in words which shapes were not paired by id; "" if all were."""
        merged = dict[str, list[str]]()
        for name in self.proposed:
            if name in self.pairs:
                merged.setdefault(self.pairs[name], []).append(name)
        pairs = [f"{' + '.join(names)} → {other}" for other, names in merged.items()]
        pairs += [
            f"{name} → {' + '.join(self.splits[name])}"
            for name in self.proposed
            if name in self.splits
        ]
        parts = [f"paired by place and shape: {', '.join(pairs)}"] if pairs else []
        parts += [
            f"{verb}: {', '.join(names)}"
            for verb, names in (("vanish", self.vanish), ("appear", self.appear))
            if names
        ]
        return "; ".join(parts)


class _StrictLoader(yaml.SafeLoader):
    """A YAML loader that refuses a key that stands twice in a mapping."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; ConstructorError if a key stands twice."""
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            raise yaml.constructor.ConstructorError(
                None, None, "a key stands twice", node.start_mark
            )
        return mapping


def load_pairing(path: Path) -> Pairing:
    """Return which shapes become which, as a YAML file says; FinloopError if it is unlike FORM."""
    try:
        text = path.read_text(encoding="utf-8")
        refuse_yaml_bomb(text)
        values: Any = yaml.load(text, _StrictLoader) or {}
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise FinloopError(f"{path} cannot be read: {error}", FORM, "correct it") from error
    problems = []
    if not isinstance(values, dict):
        values, problems = {}, ["it has no keys"]
    elif unknown := set(values) - {"pairs", "vanish", "appear", "pins"}:
        problems.append(f"it has {', '.join(sorted(map(str, unknown)))}")
    pairs = values.get("pairs") or {}
    lists = {key: values.get(key) or [] for key in ("vanish", "appear")}
    if not isinstance(pairs, dict) or not all(map(_is_partner, pairs.values())):
        problems.append("its pairs are no `id: id` or `id: [id, id]`")
        pairs = {}
    problems += [f"its {key} is no list" for key, names in lists.items() if type(names) is not list]
    pins = dict[str, Points]()
    try:
        for name, places in dict(values.get("pins") or {}).items():
            pins[str(name)] = np.asarray(places, np.float64).reshape(len(places), 2, 2)
            if not (np.abs(pins[str(name)]) <= LARGEST).all():
                raise ValueError
    except (TypeError, ValueError):
        problems.append("its pins are no `id: [[[x, y], [x, y]], …]`")
    if problems:
        raise FinloopError(f"{path} has no pairs: {'; '.join(problems)}", FORM, "correct it")
    vanish, appear = ([str(name) for name in names] for names in lists.values())
    return Pairing(
        {str(name): other for name, other in pairs.items() if isinstance(other, str)},
        vanish,
        appear,
        splits={str(name): other for name, other in pairs.items() if isinstance(other, list)},
        pins=pins,
    )


def _is_partner(value: object) -> bool:
    """Return whether a value under `pairs` is an id, or a list of at least two ids."""
    if isinstance(value, list):
        return len(value) > 1 and all(isinstance(name, str) for name in value)
    return isinstance(value, str)


def pair_shapes(a: Drawing, b: Drawing, given: Pairing | None = None) -> Pairing:
    """Return which shapes of drawing `a` become which of `b`; the drawings have one size.

    given: goes first. FinloopError if it names a shape that is not there, or one twice.
    """
    given = given or Pairing({})
    first, second = shape_contours(a), shape_contours(b)
    split_names = [name for names in given.splits.values() for name in names]
    _require_shapes(first, [*given.pairs, *given.splits, *given.vanish], "first")
    _require_shapes(second, [*set(given.pairs.values()), *split_names, *given.appear], "second")
    pairs, splits = dict(given.pairs), dict(given.splits)
    used = {*pairs, *splits, *given.vanish}
    used_second = {*pairs.values(), *split_names, *given.appear}
    left = [name for name in first if name not in used]
    right = [name for name in second if name not in used_second]
    pairs |= {name: name for name in left if name in right}
    proposed = list[str]()

    def still_left() -> tuple[list[str], list[str]]:
        """Return the ids of each drawing's shapes that have no partner yet."""
        taken = {*pairs.values(), *(name for names in splits.values() for name in names)}
        return (
            [name for name in left if name not in pairs and name not in splits],
            [name for name in right if name not in taken],
        )

    lone, lone_second = still_left()
    for name in lone:  # eye → eye_left + eye_right
        if parts := _parts_by_id(name, lone_second):
            splits[name] = parts
            proposed.append(name)
    lone, lone_second = still_left()
    for other in lone_second:
        if parts := _parts_by_id(other, lone):
            pairs |= dict.fromkeys(parts, other)
            proposed += parts
    lone, lone_second = still_left()
    costs = _pair_costs(
        [first[name] for name in lone],
        [second[name] for name in lone_second],
        max(a.width, a.height),
    )
    finite = np.where(np.isfinite(costs), costs, 1e9)
    for row, column in zip(*scipy.optimize.linear_sum_assignment(finite), strict=True):
        if np.isfinite(costs[row, column]):
            pairs[lone[row]] = lone_second[column]
            proposed.append(lone[row])
    by_place = {name: pairs[name] for name in lone if name in pairs}
    lone, lone_second = still_left()
    for name, parts in _parts_by_place((a, first), (b, second), by_place, lone_second).items():
        splits[name] = [pairs.pop(name), *parts]
    backwards = {other: name for name, other in by_place.items() if name in pairs}
    for other, parts in _parts_by_place((b, second), (a, first), backwards, lone).items():
        pairs |= dict.fromkeys(parts, other)
        proposed += parts
    lone, lone_second = still_left()
    return Pairing(
        pairs, [*given.vanish, *lone], [*given.appear, *lone_second], proposed, splits, given.pins
    )


def _parts_by_id(name: str, others: Sequence[str]) -> list[str]:
    """Return the ids of parts of a shape, two or more: eye_left and eye-2 are parts of eye."""
    part = re.compile(re.escape(name) + r"[^a-z].*", re.DOTALL)
    parts = [other for other in others if part.fullmatch(other)]
    return parts if len(parts) > 1 else []


def _parts_by_place(
    whole: tuple[Drawing, Mapping[str, list[Curve]]],
    parts: tuple[Drawing, Mapping[str, list[Curve]]],
    pairs: Mapping[str, str],
    left: Sequence[str],
) -> dict[str, list[str]]:
    """Return ids of unpaired shapes that are further pieces of a whole shape, by the whole's id.

    They have the fill of the shape that the whole is paired with, lie beside it, and together they
    fill the place of the whole. whole, parts: drawings and their shapes; pairs: from whole to
    parts; left: ids of unpaired parts.
    """
    found = dict[str, list[str]]()
    names = list(pairs)
    if not names or not left:
        return found
    fills = [repr(_fill_of(parts[0], pairs[name])) for name in names]
    are_closed = np.array([all(curve.closed for curve in whole[1][name]) for name in names])
    places = np.stack([_box(whole[1][name]) for name in names])
    so_far = np.stack([_box(parts[1][pairs[name]]) for name in names])
    for extra in left:
        box = _box(parts[1][extra])
        apart = _common_area(so_far, box) <= APART * np.minimum(_box_area(so_far), _box_area(box))
        inside = _common_area(places, box) >= INSIDE * _box_area(box)
        fill = repr(_fill_of(parts[0], extra))
        joined = np.stack(
            [np.minimum(so_far[:, 0], box[0]), np.maximum(so_far[:, 1], box[1])], axis=1
        )
        share = _common_share(places, joined)
        fits = apart & inside & are_closed & (share >= TOGETHER)
        fits &= np.array([fill == other for other in fills])
        rise = np.where(fits, share - _common_share(places, so_far), 0.0)
        best = int(rise.argmax())
        if rise[best] > FITS_BETTER and all(curve.closed for curve in parts[1][extra]):
            found.setdefault(names[best], []).append(extra)
            so_far[best] = joined[best]
    return found


def _fill_of(drawing: Drawing, name: str) -> Fill:
    """Return the fill of a shape, None if nothing fills it."""
    return drawing.styles[name].fill if name in drawing.styles else None


def _box(contours: Sequence[Curve]) -> Points:
    """Return the bounding box of contours: lowest and highest x and y, (2, 2)."""
    points = np.concatenate([curve.points for curve in contours])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _box_area(box: Points) -> Floats:
    """Return the areas (…) of boxes (…, 2, 2): low x, y, and high x, y; px²."""
    return np.asarray((box[..., 1, :] - box[..., 0, :]).prod(axis=-1))


def _common_area(first: Points, second: Points) -> Floats:
    """Return the area (…) that boxes (…, 2, 2) have in common."""
    low = np.maximum(first[..., 0, :], second[..., 0, :])
    high = np.minimum(first[..., 1, :], second[..., 1, :])
    return np.asarray(np.maximum(high - low, 0).prod(axis=-1))


def _common_share(first: Points, second: Points) -> Floats:
    """Return the common area (…) of boxes, divided by the area that they cover together."""
    common = _common_area(first, second)
    return np.asarray(common / np.maximum(_box_area(first) + _box_area(second) - common, 1e-300))


def shape_contours(drawing: Drawing) -> dict[str, list[Curve]]:
    """Return the contours of each shape of a drawing by id, in drawing order."""
    shapes = layers_by_shape(drawing.curves)
    return {name: [drawing.curves[layer] for layer in layers] for name, layers in shapes.items()}


def _require_shapes(shapes: Iterable[str], names: Sequence[str], which: str) -> None:
    """Raise FinloopError if a name is not a shape of the drawing, or is there twice."""
    unknown = [name for name in names if name not in shapes]
    twice = sorted({name for name in names if names.count(name) > 1})
    if unknown or twice:
        problems = [f"no shape {name!r}" for name in unknown]
        problems += [f"{name!r} twice in the pairs" for name in twice]
        raise FinloopError(
            f"the {which} drawing: {', '.join(problems)}",
            f"each of its shapes at most once: {', '.join(shapes)}",
            "correct the file of pairs",
        )


def _pair_costs(
    first: Sequence[Sequence[Curve]], second: Sequence[Sequence[Curve]], side: float
) -> Floats:
    """Return how badly shapes fit each other, (n, m): by place, size, and form.

    side: of the picture. Infinite if one shape is open and the other closed.
    """
    (places, sizes, forms, kinds), other = (_measure_shapes(shapes) for shapes in (first, second))
    costs = np.empty((len(first), len(second)))
    spectra = np.fft.fft(other[2], axis=-1)
    for row, (place, size, form, kind) in enumerate(zip(places, sizes, forms, kinds, strict=True)):
        if kind == "closed":  # from the best of all start points
            fit = np.fft.ifft(spectra * np.fft.fft(form).conj(), axis=-1).real.max(axis=-1)
        else:  # from the better end
            fit = np.maximum(
                *((other[2] * way.conj()).real.sum(axis=-1) for way in (form, form[::-1]))
            )
        misfit = np.sqrt(np.maximum(2 - 2 * fit / POINTS, 0))
        costs[row] = PLACE_WEIGHT * abs(other[0] - place) / side + misfit
        costs[row] += SIZE_WEIGHT * abs(np.log2(other[1] / size))
        costs[row, [kind != one for one in other[3]]] = np.inf
    return costs


def _measure_shapes(
    shapes: Sequence[Sequence[Curve]],
) -> tuple[Complexes, Floats, Complexes, list[str]]:
    """Return mean, size, form and kind of the largest contour of each shape.

    Means and forms are complex, x + i y. A form has mean 0 and size 1 (RMS radius), and a closed
    one runs clockwise. A kind says whether contours are open or closed.
    """
    curves = [orient_clockwise(max(contours, key=_extent)) for contours in shapes]
    points = np.array([resample_curve(curve, POINTS).points for curve in curves])
    z = points.reshape(len(curves), POINTS, 2) @ np.array([1, 1j])
    means = z.mean(axis=1)
    centred = z - means[:, None]
    sizes = np.maximum(np.sqrt((abs(centred) ** 2).mean(axis=1)), 1e-300)
    kinds = [" ".join(sorted({"closed" if curve.closed else "open" for curve in contours}))
             for contours in shapes]  # fmt: skip
    return means, sizes, centred / sizes[:, None], kinds


def _extent(curve: Curve) -> float:
    """Return the diagonal of a contour's bounding box."""
    return float(np.hypot(*np.ptp(curve.points, axis=0)))


def match_drawings(
    a: Drawing, b: Drawing, path: Path | None = None
) -> tuple[Drawing, Drawing, str]:
    """Return two drawings with one size and the same ids, and in words how they were paired.

    b: is fitted into the picture of a; path: of a file of pairs, None = there is none.
    """
    given = None if path is None else load_pairing(path)
    pins = given.pins if given else {}
    a, b = (
        replace(drawing, pins={name: places[:, side] for name, places in pins.items()})
        for side, drawing in enumerate((a, b))
    )
    b = fit_drawing(b, a.width, a.height)
    pairing = pair_shapes(a, b, given)
    return *pair_drawings(a, b, pairing), pairing.summary


class _Row(NamedTuple):
    """A shape that becomes another: its id, and for each drawing its origin, contours and cuts."""

    name: str
    sources: tuple[str | None, str | None]  # ids in the drawings; None = it is not there
    contours: tuple[Sequence[Curve], Sequence[Curve]]
    cuts: tuple[Points | None, Points | None] = (None, None)


def pair_drawings(a: Drawing, b: Drawing, pairing: Pairing) -> tuple[Drawing, Drawing]:
    """Return two drawings with shapes of the same ids, ready for `morph_drawings`.

    A shape that vanishes is in the second as small as a point, one that appears in the first. It
    lies above the shape that is below it in the second drawing. A shape that becomes several is cut
    into as many, which have their ids; so is one with more separate parts in the other drawing. The
    pins of both drawings, by the ids of the first, stay at their shapes, or go to the nearest
    piece. FinloopError if a shape cannot be cut, or one with pins has no partner.
    """
    first, second = shape_contours(a), shape_contours(b)
    merged = dict[str, list[str]]()
    for name, other in pairing.pairs.items():
        merged.setdefault(other, []).append(name)
    order = list(first), list(second)
    placed = list[tuple[list[int], _Row]]()  # with their places in either drawing
    families = list[tuple[str, ...]]()
    for name, contours in first.items():
        others = (
            pairing.splits.get(name) or [pairing.pairs[name]] if name not in pairing.vanish else []
        )
        if not others:
            placed.append(([order[0].index(name), 0], _Row(name, (name, None), (contours, ()))))
        elif (
            others[0] not in merged or merged[others[0]][0] == name
        ):  # all of one shape at its first
            names, before = merged.get(others[0], [name]), len(placed)
            for row in _join_shapes((a, names), (b, others)):
                used = {*(other.name for _, other in placed), *(first.keys() - set(names))}
                places = [
                    side.index(source or usual)
                    for side, source, usual in zip(
                        order, row.sources, (name, others[0]), strict=True
                    )
                ]
                placed.append((places, row._replace(name=_unused_name(row.name, used))))
            families.append(tuple(row.name for _, row in placed[before:]))
    rows = [row for _, row in sorted(placed, key=lambda item: item[0])]
    below: str | None = None  # the shape below in the second drawing
    for other in second:
        if other in pairing.appear:
            at = max(
                (k + 1 for k, row in enumerate(rows) if row.sources[1] == below and below),
                default=0,
            )
            name = _unused_name(other, [row.name for row in rows])
            rows.insert(at, _Row(name, (None, other), ((), second[other])))
        below = other
    pins = _pins_by_row(a, b, rows)
    cut = tuple(family for family in families if len(family) > 1)
    first_side, second_side = _take_side(a, b, rows, 0, pins), _take_side(b, a, rows, 1, pins)
    return replace(first_side, families=cut), replace(second_side, families=cut)


def _pins_by_row(a: Drawing, b: Drawing, rows: Sequence[_Row]) -> dict[str, Pins]:
    """Return the pins of each row, by the row's name; both drawings have pins by the first's ids.

    A pin of a shape that is cut goes to the piece with the least sum of distances from both ends.
    FinloopError if a shape with pins has no partner.
    """
    by_row = dict[str, Pins]()
    for name, places in a.pins.items():
        parts = [row for row in rows if row.sources[0] == name and row.sources[1]]
        if not parts:
            raise FinloopError(
                f"pins of {name!r}: not in the first drawing, or vanishing",
                "pins of shapes that become others",
                "correct the pins in the file of pairs",
            )
        far = np.sum(
            [
                [_distances(side, row.contours[number]) for row in parts]
                for number, side in enumerate((places, b.pins[name]))
            ],
            axis=0,
        )  # (parts, pins)
        for number, row in enumerate(parts):
            if (own := far.argmin(axis=0) == number).any():
                by_row[row.name] = Pins(places[own], b.pins[name][own])
    return by_row


def _distances(places: Points, contours: Sequence[Curve]) -> Floats:
    """Return the distances (k,) of places (k, 2) from the nearest of several contours."""
    gaps = [np.hypot(*nearest_on_curve(places, curve)[1].T) for curve in contours]
    return np.asarray(np.min(gaps, axis=0))


def _join_shapes(
    first: tuple[Drawing, Sequence[str]], second: tuple[Drawing, Sequence[str]]
) -> list[_Row]:
    """Return a `_Row` for each two shapes, or pieces of shapes, that become each other.

    first, second: drawings, and the ids of their shapes: one each, or one and several. FinloopError
    if a shape cannot be cut.
    """
    sides = [
        [(name, contours) for name in names for contours in [shape_contours(drawing)[name]]]
        for drawing, names in (first, second)
    ]
    names = ", ".join(first[1])
    contours = [[curve for _, curves in side for curve in curves] for side in sides]
    is_pair = len(sides[0]) == len(sides[1]) == 1
    whole = _Row(first[1][0], (first[1][0], second[1][0]), (contours[0], contours[1]))
    kinds = [[curve.closed for curve in side] for side in contours]
    if not all(kinds[0] + kinds[1]):
        if is_pair and (kinds[0] == kinds[1] or len(kinds[0]) == len(kinds[1]) == 1):
            return [whole]
    elif is_pair and len(contours[0]) == len(contours[1]) == 1:
        return [whole]
    try:
        if not all(kinds[0] + kinds[1]):
            return _join_kinds(first[0], second[0], *sides)
        regions = [
            [(name, region) for name, curves in side for region in split_regions(curves)]
            for side in sides
        ]
        if is_pair and len(regions[0]) == len(regions[1]):
            return [whole]
        return _join_regions(first[0], second[0], regions[0], regions[1], len(sides[1]) > 1)
    except FinloopError as error:
        if is_pair and kinds[0] == kinds[1]:
            return [whole]  # contours that meet; a method may take them as they are
        raise FinloopError(f"shape {names!r}: {error.came}", error.wanted, error.do) from error


def _join_regions(
    a: Drawing, b: Drawing,
    first: Sequence[tuple[str, Region]], second: Sequence[tuple[str, Region]], by_one: bool,
) -> list[_Row]:  # fmt: skip
    """Return a `_Row` for each two regions, or pieces of regions, that become each other.

    by_one: whether rows have the ids of the second drawing, else those of the first.
    """
    sources = [{id(region.outer): name for name, region in side} for side in (first, second)]
    rows = list[_Row]()
    for ones, others in group_regions([r for _, r in first], [r for _, r in second]):
        pieces = [[Piece(region, None) for region in side] for side in (ones, others)]
        if len(ones) != len(others):
            cut = int(len(others) < len(ones))  # the side that is one
            drawing, (whole,) = ((a, ones), (b, others))[cut]
            paint = drawing.styles.get(sources[cut][id(whole.outer)])
            is_opaque = paint is not None and paint.fill is not None and paint.fill_opacity == 1
            overlap = OPAQUE_OVERLAP * max(a.width, a.height) * is_opaque
            pieces[cut] = split_region(whole, (others, ones)[cut], overlap)
        ones, others = (side * (len(pieces[0]) // len(side)) for side in (ones, others))
        for one, other, piece, other_piece in zip(ones, others, *pieces, strict=True):
            both = sources[0][id(one.outer)], sources[1][id(other.outer)]
            contours = [[p.region.outer, *p.region.holes] for p in (piece, other_piece)]
            rows.append(
                _Row(both[by_one], both, (contours[0], contours[1]), (piece.cuts, other_piece.cuts))
            )
    return rows


_Parts = list[tuple[str, Region]]
"""Parts of shapes with the ids of these: regions, or lines in the form of regions without holes."""


def _join_kinds(
    a: Drawing, b: Drawing,
    first: Sequence[tuple[str, list[Curve]]], second: Sequence[tuple[str, list[Curve]]],
) -> list[_Row]:  # fmt: skip
    """Return the `_Row`s of shapes with open contours: lines become lines, and regions regions.

    If one drawing has only lines and the other one only regions, lines close to regions without
    holes. A part without a partner vanishes, or appears. first, second: contours by the ids of
    shapes. FinloopError if regions meet, or a filled shape has a line within a region: it would be
    a hole.
    """
    sides: list[tuple[_Parts, _Parts]] = []  # regions and lines
    for drawing, shapes in ((a, first), (b, second)):
        regions, lines = _Parts(), _Parts()
        for name, curves in shapes:
            closed = [curve for curve in curves if curve.closed]
            own = split_regions(closed) if closed else []
            single = [curve for curve in curves if not curve.closed]
            _require_no_line_inside(drawing.styles.get(name), own, single)
            regions += [(name, region) for region in own]
            lines += [(name, Region(curve, [])) for curve in single]
        sides.append((regions, lines))
    (regions_a, lines_a), (regions_b, lines_b) = sides
    by_one = len(second) > 1
    rows = list[_Row]()
    if regions_a and regions_b:
        rows += _join_regions(a, b, regions_a, regions_b, by_one)
        regions_a, regions_b = [], []
    if lines_a and lines_b:
        rows += _join_lines(lines_a, lines_b, by_one)
        lines_a, lines_b = [], []
    left_a, left_b = regions_a + lines_a, regions_b + lines_b
    if left_a and left_b and not any(region.holes for _, region in left_a + left_b):
        sources = [{id(part.outer): name for name, part in left} for left in (left_a, left_b)]
        paired = set[int]()
        for ones, others in group_regions([r for _, r in left_a], [r for _, r in left_b]):
            pair = ones[0].outer, others[0].outer
            paired |= set(map(id, pair))
            ids = sources[0][id(pair[0])], sources[1][id(pair[1])]
            rows.append(_Row(ids[by_one], ids, ([pair[0]], [pair[1]])))
        left_a, left_b = (
            [part for part in left if id(part[1].outer) not in paired] for left in (left_a, left_b)
        )
    rows += [_Row(name, (name, None), ([r.outer, *r.holes], ())) for name, r in left_a]
    rows += [_Row(name, (None, name), ((), [r.outer, *r.holes])) for name, r in left_b]
    return rows


def _require_no_line_inside(
    paint: Paint | None, regions: Sequence[Region], lines: Sequence[Curve]
) -> None:
    """Raise FinloopError if a filled shape has an open contour within a closed one."""
    if paint is None or paint.fill is None:
        return
    outlines = [region.outer.points for region in regions]
    if any(skimage.measure.points_in_poly(line.points, outline).any()
           for outline in outlines for line in lines):  # fmt: skip
        raise FinloopError(
            "a filled shape with an open contour within a closed one",
            "holes that are closed",
            "close the open contour (Z), or give it a path and an id of its own",
        )


def _join_lines(first: _Parts, second: _Parts, by_one: bool) -> list[_Row]:
    """Return a `_Row` for each two lines, or pieces of lines, that become each other.

    by_one: whether rows have the ids of the second drawing.
    """
    sources = [{id(line.outer): name for name, line in side} for side in (first, second)]
    rows = list[_Row]()
    for ones, others in group_regions([line for _, line in first], [line for _, line in second]):
        lines = [[line.outer for line in side] for side in (ones, others)]
        ids = [
            [names[id(line)] for line in side] for names, side in zip(sources, lines, strict=True)
        ]
        if len(lines[0]) != len(lines[1]):
            cut = int(len(lines[1]) < len(lines[0]))  # the side that is one
            lines[cut] = split_line(lines[cut][0], lines[1 - cut])
            ids[cut] *= len(lines[cut])
        rows += [
            _Row(both[by_one], both, ([one], [other]))
            for both, one, other in zip(zip(*ids, strict=True), *lines, strict=True)
        ]
    return rows


def _take_side(
    drawing: Drawing,
    other: Drawing,
    rows: Sequence[_Row],
    side: int,
    pins: Mapping[str, Pins],
) -> Drawing:
    """Return one drawing with the shapes of all rows; those that it lacks are as small as points.

    other: the other drawing, from which these come. side: 0 for the first drawing, 1 for the
    second; pins: by the names of rows.
    """
    curves, cuts = dict[str, Curve](), dict[str, Points]()
    styles, groups = dict[str, Paint](), dict[str, tuple[str, ...]]()
    for row in rows:
        source, partner = row.sources[side], str(row.sources[1 - side])
        contours, paint = row.contours[side], drawing.styles.get(str(source))
        if source is None:
            contours = row.contours[1 - side]
            middle = _find_middle(contours)
            contours = [_shrink(curve, middle) for curve in contours]
            paint = other.styles.get(partner)
            paint = paint and scale_paint(paint, POINT, middle * (1 - POINT))
        names = [f"{row.name}{PART}{k}" if k > 1 else row.name for k in range(1, len(contours) + 1)]
        curves |= dict(zip(names, contours, strict=True))
        if paint:
            styles |= dict.fromkeys(names, paint)
        if source in drawing.groups:
            groups |= dict.fromkeys(names, drawing.groups[source])
        if (row_cuts := row.cuts[side]) is not None and len(row_cuts):
            cuts[row.name] = row_cuts
    own_pins = {name: pair[side] for name, pair in pins.items()}
    return replace(drawing, curves=curves, styles=styles, groups=groups, cuts=cuts, pins=own_pins)


def _unused_name(name: str, used: Collection[str]) -> str:
    """Return the name, or if it is used already, the name with a number."""
    number, unique = 1, name
    while unique in used:
        number += 1
        unique = f"{name}-{number}"
    return unique


def _find_middle(contours: Sequence[Curve]) -> Points:
    """Return the middle (2,) of the largest of a shape's contours."""
    return resample_curve(max(contours, key=_extent), POINTS).points.mean(axis=0)


def _shrink(curve: Curve, middle: Points) -> Curve:
    """Return a curve shrunk to nearly a point, at `middle` (2,) px."""
    return Curve(middle + (curve.points - middle) * POINT, curve.closed)
